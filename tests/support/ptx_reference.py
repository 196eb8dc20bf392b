"""What PTX instructions compute, by the pseudo-code of the manual and by exact fractions: rows for tests.

A row is an opcode, the types of its operands and of its result, and cases: operands, then the result.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

Row = tuple[str, str, list[tuple[Any, ...]]]


# Instructions on bits, by the loops of the manual.
def _bfe(a: int, position: int, length: int, width: int, signed: bool) -> int:
    position, length, top = position & 255, length & 255, width - 1
    sign = a >> min(position + length - 1, top) & 1 if signed and length else 0
    return sum((a >> position + i & 1 if i < length and position + i <= top else sign) << i for i in range(width))


def _bfi(a: int, b: int, position: int, length: int, width: int) -> int:
    position, length = position & 255, length & 255
    for i in range(length):
        if position + i < width:
            b = b & ~(1 << position + i) | (a >> i & 1) << position + i
    return b


def _prmt(a: int, b: int, selector: int) -> int:
    data, result = (b << 32 | a).to_bytes(8, "little"), 0
    for i in range(4):
        choice = selector >> 4 * i & 15
        byte = data[choice & 7]
        result |= (byte if choice < 8 else 255 * (byte >> 7)) << 8 * i
    return result


def _funnel(low: int, high: int, count: int, left: bool, clamp: bool) -> int:
    count = min(count, 32) if clamp else count & 31
    both = high << 32 | low
    return (both << count >> 32 if left else both >> count) & 2**32 - 1


def _lop3(a: int, b: int, c: int, table: int) -> int:
    return sum((table >> (4 * (a >> i & 1) + 2 * (b >> i & 1) + (c >> i & 1)) & 1) << i for i in range(32))


def random_rows() -> list[Row]:
    random_ = random.Random(1)

    def word(width: int = 32) -> int:
        return random_.choice((0, 1, 2**width - 1, 1 << width - 1, *[random_.getrandbits(width) for _ in range(4)]))

    def place() -> int:
        return random_.choice((0, 1, 7, 15, 31, 32, 33, 63, 64, 100, 255, 256, 288))

    rows: list[Row] = []
    for width in (32, 64):
        for kind in "us":
            cases = [(word(width), place(), place()) for _ in range(100)]
            done = [(*c, _bfe(*c, width, kind == "s")) for c in cases]
            rows.append((f"bfe.{kind}{width}", f"u{width} u32 u32 -> u{width}", done))
        fields = [(word(width), word(width), place(), place()) for _ in range(100)]
        rows.append(
            (f"bfi.b{width}", f"u{width} u{width} u32 u32 -> u{width}", [(*c, _bfi(*c, width)) for c in fields])
        )
    triples = [(word(), word(), random_.getrandbits(16)) for _ in range(50)]
    rows.append(("prmt.b32", "u32 u32 u32 -> u32", [(*c, _prmt(*c)) for c in triples]))
    for side in "lr":
        for how in ("wrap", "clamp"):
            shifts = [(word(), word(), place()) for _ in range(50)]
            done = [(*c, _funnel(*c, side == "l", how == "clamp")) for c in shifts]
            rows.append((f"shf.{side}.{how}.b32", "u32 u32 u32 -> u32", done))
    tables = [(word(), word(), word(), random_.getrandbits(8)) for _ in range(50)]
    rows.append(("lop3.b32", "u32 u32 u32 u32 -> u32", [(*c, _lop3(*c)) for c in tables]))
    return rows


# Arithmetic in each rounding mode, by exact fractions.
def _rounded(exact: Fraction, mode: str, kind: Any) -> float:
    """Return the number of a NumPy type that a fraction is rounded to."""
    near = kind(float(exact))  # not always the nearest: it was rounded twice
    below, above = sorted((Fraction(float(np.nextafter(near, kind(s)))), s) for s in (-math.inf, math.inf))
    numbers = sorted({below[0], Fraction(float(near)), above[0]})
    lower = max(x for x in numbers if x <= exact)
    upper = min(x for x in numbers if x >= exact)
    if mode == "rn":
        middle = (lower + upper) / 2
        even = int(np.array(kind(float(lower))).view(np.uint32 if kind is np.float32 else np.uint64)) % 2 == 0
        return float(lower if exact < middle or (exact == middle and even) else upper)
    toward_zero = lower if exact > 0 else upper
    return float({"rm": lower, "rp": upper, "rz": toward_zero}[mode])


_EXACT: dict[str, tuple[int, Callable[..., Fraction]]] = {
    "add": (2, lambda a, b: a + b),
    "sub": (2, lambda a, b: a - b),
    "mul": (2, lambda a, b: a * b),
    "div": (2, lambda a, b: a / b),
    "fma": (3, lambda a, b, c: a * b + c),
}


def rounding_rows() -> list[Row]:
    random_, rows = random.Random(2), []
    for kind, number in (("f32", np.float32), ("f64", np.float64)):
        for name, (count, exact) in _EXACT.items():
            for mode in ("rn", "rz", "rm", "rp"):
                cases = []
                while len(cases) < 40:
                    given = [float(number(random_.gauss(0, 1) * 2.0 ** random_.randint(-9, 9))) for _ in range(count)]
                    value = exact(*map(Fraction, given))
                    if value:
                        cases.append((*given, _rounded(value, mode, number)))
                rows.append((f"{name}.{mode}.{kind}", f"{kind} " * count + f"-> {kind}", cases))
    return rows
