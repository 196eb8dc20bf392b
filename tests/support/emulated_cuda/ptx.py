"""Read PTX, as NVRTC writes it, into statements (PTX ISA, NVIDIA)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple


class NotTranslated(Exception):
    """A module contains PTX that the emulator does not know."""


class Instruction(NamedTuple):
    """One instruction."""

    guard: str  # the predicate that it depends on, with a leading "!" if negated
    opcode: tuple[str, ...]  # such as ("add", "rn", "f32")
    operands: tuple[str, ...]  # those in braces, brackets or parentheses are one


class Label(NamedTuple):
    """A place to jump to."""

    name: str


class Brace(NamedTuple):
    text: str


class Registers(NamedTuple):
    """Registers `name`0 to `name`(count − 1), or a single one if count is None."""

    kind: str
    name: str
    count: int | None

    @property
    def names(self) -> list[str]:
        return [self.name] if self.count is None else [f"{self.name}{i}" for i in range(self.count)]


class Variable(NamedTuple):
    """A variable in memory."""

    space: str  # "param" for the arguments of a function
    align: int
    kind: str
    name: str
    count: int | None  # None if it is not an array
    values: tuple[str, ...] = ()  # what its first elements start with; all others are 0

    @property
    def size(self) -> int:
        return bits_of(self.kind) // 8 * (1 if self.count is None else self.count)


Statement = Instruction | Label | Brace | Registers | Variable


class Entry(NamedTuple):
    """A kernel, or a function that kernels call."""

    name: str
    parameters: tuple[str, ...]
    body: tuple[Statement, ...]
    results: tuple[str, ...] = ()


class Module(NamedTuple):
    target: str
    variables: tuple[Variable, ...]
    entries: tuple[Entry, ...]
    functions: tuple[Entry, ...] = ()


def bits_of(kind: str) -> int:
    """Return the width of a type such as "f32"; a predicate has one bit."""
    return 1 if kind == "pred" else int(kind.lstrip("busf"))


_IGNORED = (".version", ".address_size", ".file", ".loc ", ".pragma", ".maxntid", ".minnctapersm", ".maxnreg")
_LABEL = re.compile(r"([\w$]+):\s*(?!:)(.*)")
_REGISTERS = re.compile(r"\.reg \.(\w+)\s+(.*);")
_VARIABLE = re.compile(
    r"(?:\.(?:visible|weak|extern|common) )*\.(global|const|shared|local|param)\s+(?:\.align (\d+) )?\.(\w+)\s+([\w$]+)"
    r"(?:\[(\d*)\])?(?:\s*=\s*(.*))?;"
)


def parse(text: str) -> Module:
    """Parse a module.

    Raises:
        NotTranslated: on functions of other modules, and on what is no PTX.
    """
    lines = _Lines(text)
    target, variables, entries, functions = "", [], [], []
    for line in lines:
        if line.startswith(".target"):
            target = line.split()[1].rstrip(",")
        elif re.match(r"(?:\.(?:visible|weak) )*\.entry ", line):
            entries.append(_entry(line, lines))
        elif re.match(r"(?:\.(?:visible|weak) )*\.func ", line):
            functions += _function(line, lines)
        elif not line.startswith(_IGNORED):
            variables.append(_variable(lines.statement(line)))
    return Module(target, tuple(variables), tuple(entries), tuple(functions))


class _Lines:
    """The lines of a file without empty ones and comments."""

    def __init__(self, text: str) -> None:
        self._rest = iter(text.rstrip("\0").split("\n"))

    def __iter__(self) -> Iterator[str]:
        for line in self._rest:
            if text := line.split("//", 1)[0].split():
                yield " ".join(text)

    def until(self, line: str, end: str) -> str:
        while end not in line:
            line += " " + next(iter(self))
        return line

    def statement(self, line: str) -> str:
        return self.until(line, ";")


_HEAD = re.compile(r"\.(?:entry|func) (?:\((.*?)\) ?)?([\w$]+) ?\((.*?)\)")


def _entry(line: str, lines: _Lines) -> Entry:
    found = _HEAD.search(lines.until(line, ")"))
    assert found is not None
    return Entry(found[2], _names(found[3]), tuple(_body(lines)))


def _function(line: str, lines: _Lines) -> Iterator[Entry]:
    """Yield a function; nothing if it is only declared here."""
    while not line.endswith((";", "{")):
        line += " " + next(iter(lines))
    found = _HEAD.search(line)
    if found is None:
        raise NotTranslated(line[:100])
    if line.endswith("{"):
        yield Entry(found[2], _names(found[3]), tuple(_body(lines, depth=1)), _names(found[1] or ""))


def _names(parameters: str) -> tuple[str, ...]:
    return tuple(part.partition("[")[0].split()[-1] for part in parameters.split(",") if part.strip())


def _body(lines: _Lines, depth: int = 0) -> Iterator[Statement]:
    for line in lines:
        if line in ("{", "}"):
            depth += 1 if line == "{" else -1
            if depth == 0:
                return
            if depth > 1 or line == "}":
                yield Brace(line)
        elif found := _LABEL.fullmatch(line):
            yield Label(found[1])
            if found[2]:
                yield _statement(lines.statement(found[2]))
        elif not line.startswith(_IGNORED):
            yield _statement(lines.statement(line))


def _statement(text: str) -> Statement:
    if found := _REGISTERS.fullmatch(text):
        name, _, count = found[2].rstrip(">").partition("<")
        return Registers(found[1], name.strip(), int(count) if count else None)
    if text.startswith("."):
        return _variable(text)
    return instruction(text)


def instruction(text: str) -> Instruction:
    """Parse one instruction, such as "@%p1 add.s32 %r1, %r2, 3;"."""
    text = " ".join(text.rstrip("; ").split())
    guard = ""
    if text.startswith("@"):
        guard, _, text = text[1:].partition(" ")
    opcode, _, arguments = text.partition(" ")
    operands = re.split(r",(?![^{\[(]*[}\])])", arguments) if arguments else []
    return Instruction(guard, tuple(opcode.split(".")), tuple(operand.strip() for operand in operands))


def _variable(text: str) -> Variable:
    found = _VARIABLE.fullmatch(text)
    if found is None:
        raise NotTranslated(text[:100])
    space, align, kind, name, count, start = found.groups()
    values = () if start is None else tuple(value.strip() for value in start.strip("{} ").split(","))
    size = bits_of(kind) // 8
    return Variable(space, int(align or size), kind, name, None if count is None else int(count or 0), values)
