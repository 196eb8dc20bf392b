"""Operands of PTX instructions as C++: registers, numbers, addresses."""

from __future__ import annotations

import re

from support.emulated_cuda.ptx import NotTranslated, bits_of

SPECIAL = {f"%{name}.{axis}": f"{name}_{axis}" if axis == "x" else ("1" if name.startswith("n") else "0")
           for name in ("tid", "ntid", "ctaid", "nctaid") for axis in "xyz"}  # fmt: skip
SPECIAL["%laneid"] = "(tid_x & 31)"

_UNSIGNED = {1: "pred", 8: "u8", 16: "u16", 32: "u32", 64: "u64"}
_FLOAT = re.compile(r"0[fFdD]([0-9A-Fa-f]{8}|[0-9A-Fa-f]{16})")
_INTEGER = re.compile(r"-?\d+U?|0[xX][0-9A-Fa-f]+U?")


def name_of(text: str) -> str:
    return text.replace("%", "r_").replace("$", "_").replace(".", "_")


def unsigned(width: int) -> str:
    return _UNSIGNED[width]


class Operands:
    """The names that an instruction may use."""

    def __init__(self, addresses: dict[str, str]) -> None:
        self.registers: dict[str, int] = {}  # their widths in bits
        self.lane: frozenset[str] = frozenset()  # registers that a thread keeps while it waits
        self.addresses = addresses  # C++ for those of variables and parameters
        self.functions: frozenset[str] = frozenset()
        self.stops: int | None = None  # how many instructions so far wait for other threads; None where none may

    def register(self, text: str) -> str:
        return f"lane.{name_of(text)}" if text in self.lane else name_of(text)

    def value(self, text: str, kind: str) -> str:
        """Return an operand as a value of a type.

        Raises:
            NotTranslated: on a name that is not known.
        """
        if text.startswith("!"):
            return f"!{self.value(text[1:], kind)}"
        if text in self.registers:
            return _read(self.register(text), self.registers[text], kind)
        if text in SPECIAL:
            return _read(SPECIAL[text], 32, kind)
        if found := _FLOAT.fullmatch(text):
            return _read(f"0x{found[1]}{'u' if len(found[1]) == 8 else 'ull'}", 4 * len(found[1]), kind)
        if _INTEGER.fullmatch(text):
            number = int(text.rstrip("U"), 0)
            if kind == "pred":
                return str(int(number != 0)) if number in (0, 1, -1) else _unknown(text)
            return f"({kind}){number & (1 << 64) - 1:#x}ull"
        base, sign, offset = text.partition("+")
        if sign and re.fullmatch(r"-?\d+", offset):
            return f"({kind})({self.value(base, 'u64')} + {int(offset) & (1 << 64) - 1:#x}ull)"
        if text in self.addresses:
            return f"({kind}){self.addresses[text]}"
        return _unknown(text)

    def assign(self, target: str, value: str, kind: str) -> str:
        """Return the assignment of a value of a type to a register, which may be wider."""
        if target == "_":
            return f"(void)({value});"
        width = self.registers[target]
        if width == 1 or kind == "pred":
            return f"{self.register(target)} = {value};"
        if kind.startswith("f"):
            value = f"bits({value})"
        # The type of the value decides how it is widened.
        return f"{self.register(target)} = ({unsigned(width)})({kind if kind[0] != 'f' else 'u' + kind[1:]})({value});"

    def address(self, text: str, space: str) -> str:
        """Return the address in brackets; shared memory has its own numbers."""
        address = self.value(text.strip("[] "), "u64")
        return f"((u64)shared + (u32)({address}))" if space == "shared" else address


def members(text: str) -> list[str]:
    """Return the members of an operand in braces or parentheses, or the operand alone."""
    return [member.strip() for member in text.strip("{}() ").split(",") if member.strip()]


def _read(text: str, width: int, kind: str) -> str:
    """Return bits of a width as a value of a type."""
    if kind == "pred":
        return text
    if not kind.startswith("f"):
        return f"({kind}){text}"
    if bits_of(kind) != width:
        raise NotTranslated(f"{text}: {width} bits as {kind}")
    return f"{'F' if width == 32 else 'D'}({text})"


def _unknown(text: str) -> str:
    raise NotTranslated(text)
