"""Decode buffer views compressed by meshoptimizer.

Format: EXT_meshopt_compression (Kapoulkine 2021), appendices A (bitstream, version 0 of attributes) and B (filters).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

_GROUP = 16
"""Elements whose bytes are packed with the same number of bits."""


def decoded(data: bytes, count: int, stride: int, mode: str, kind: str = "NONE") -> bytes:
    """Return the bytes of a compressed view.

    Args:
        data: the compressed bytes.
        count: number of elements.
        stride: bytes of an element.
        mode: "ATTRIBUTES", "TRIANGLES" or "INDICES".
        kind: the filter, "NONE", "OCTAHEDRAL", "QUATERNION" or "EXPONENTIAL".

    Raises:
        ValueError: where the data are not as specified, or TypeError or LookupError.
    """
    packed = np.frombuffer(data, np.uint8)
    if mode == "ATTRIBUTES":
        rows = _attributes(packed, count, stride)
        return bytes(_FILTERS[kind](rows).tobytes())
    indices = _triangles(data, count) if mode == "TRIANGLES" else _sequence(data, count)
    return np.array(indices, np.uint32).astype({2: np.uint16, 4: np.uint32}[stride]).tobytes()


def _attributes(packed: Bytes, count: int, stride: int) -> Bytes:
    """Return (count, stride) bytes of vertices."""
    if packed[0] != 0xA0:
        raise ValueError(f"version 0x{packed[0]:02x} of the attributes is not supported")
    out = np.empty((count, stride), np.uint8)
    last = packed[len(packed) - stride :].copy()
    block = min((8192 // stride) & ~15, 256)
    at = 1
    for start in range(0, count, block):
        rows = min(block, count - start)
        groups = -(-rows // _GROUP)
        for k in range(stride):
            sizes = packed[at : at + -(-groups // 4)]
            at += len(sizes)
            codes = ((sizes[:, None] >> np.array([0, 2, 4, 6], np.uint8)) & 3).ravel()[:groups]
            deltas = np.zeros((groups, _GROUP), np.uint8)
            for number, code in enumerate(codes.tolist()):
                at = _group(packed, at, code, deltas[number])
            zigzag = deltas.ravel()[:rows]
            steps = (zigzag >> 1) ^ (np.uint8(0) - (zigzag & 1))
            out[start : start + rows, k] = np.cumsum(steps, dtype=np.uint8) + last[k]
        last = out[start + rows - 1].copy()
    return out


def _group(packed: Bytes, at: int, code: int, out: Bytes) -> int:
    """Write the 16 bytes of a group, and return where the next one begins."""
    if code == 0:
        return at
    if code == 3:
        out[:] = packed[at : at + _GROUP]
        return at + _GROUP
    shifts = np.array([6, 4, 2, 0] if code == 1 else [4, 0], np.uint8)
    escape = 3 if code == 1 else 15
    length = _GROUP // len(shifts)
    out[:] = ((packed[at : at + length, None] >> shifts) & escape).ravel()
    at += length
    large = np.flatnonzero(out == escape)  # their bytes follow in full
    out[large] = packed[at : at + len(large)]
    return at + len(large)


def _triangles(data: bytes, count: int) -> list[int]:
    """Return the corners of triangles, which are coded by recent edges and vertices."""
    if data[0] not in (0xE0, 0xE1):
        raise ValueError(f"version 0x{data[0]:02x} of the triangles is not supported")
    most = 13 if data[0] == 0xE1 else 15
    reader = _Varints(data, 1 + count // 3)
    table = data[-16:]
    edges: list[tuple[int, int]] = [(0, 0)] * 16  # the latest last, as below
    recent = [0] * 16
    following = 0
    out: list[int] = []
    for code in data[1 : 1 + count // 3]:
        if code < 0xF0:
            a, b = edges[15 - (code >> 4)]
            third = code & 15
            if 0 < third < most:
                c = recent[15 - third]
            else:
                if third == 0:
                    c, following = following, following + 1
                elif third == 15:
                    c = reader.index()
                else:
                    c = reader.last = reader.last + (1 if third == 14 else -1)
                recent = [*recent[1:], c]
            edges = [*edges[2:], (c, b), (a, c)]
        else:
            pair = table[code & 15] if code < 0xFE else reader.byte()
            if code >= 0xFE and pair == 0:
                following = 0
            corners, added = [], []
            for each in (15 if code == 0xFF else 0, pair >> 4, pair & 15):
                if each == 0:
                    corner, following = following, following + 1
                else:
                    corner = reader.index() if each == 15 else recent[16 - each]
                corners.append(corner)
                added += [corner] if each in (0, 15) else []
            a, b, c = corners
            recent = [*recent, *added][-16:]
            edges = [*edges[3:], (b, a), (c, b), (a, c)]
        out += (a, b, c)
    return out


def _sequence(data: bytes, count: int) -> list[int]:
    """Return indices, each coded by its difference to one of two before it."""
    if data[0] != 0xD1:
        raise ValueError(f"version 0x{data[0]:02x} of the indices is not supported")
    reader, last, out = _Varints(data, 1), [0, 0], []
    for _ in range(count):
        value = reader.varint()
        which, value = value & 1, value >> 1
        last[which] += (value >> 1) ^ -(value & 1)
        out.append(last[which])
    return out


class _Varints:
    """Reads numbers of seven bits a byte, the lowest first; `last` is the index that was read last."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at, self.last = data, at, 0

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def varint(self) -> int:
        value, shift = 0, 0
        while shift < 35:
            byte = self.byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7
        raise ValueError("a number has more than five bytes")

    def index(self) -> int:
        value = self.varint()
        self.last += (value >> 1) ^ -(value & 1)
        return self.last


# --- Filters ---------------------------------------------------------------------------------------


def _octahedral(rows: Bytes) -> NDArray[Any]:
    """Return unit vectors from octahedral coordinates of 4 or 8 bytes each; the last quarter is kept as it is."""
    kind = np.dtype(np.int8 if rows.shape[1] == 4 else np.int16)
    values = rows.view(kind)
    x, y, one = (values[:, k].astype(np.float64) for k in range(3))
    z = one - abs(x) - abs(y)
    fold = np.maximum(-z, 0.0)
    x -= np.copysign(fold, x)
    y -= np.copysign(fold, y)
    scale = np.iinfo(kind.name).max / np.sqrt(x * x + y * y + z * z)
    return np.stack([*(np.rint(each * scale).astype(kind) for each in (x, y, z)), values[:, 3]], axis=1)


def _quaternion(rows: Bytes) -> NDArray[Any]:
    """Return unit quaternions of three components of theirs, and the number of the largest in the last two bits."""
    values = rows.view(np.int16)
    scale = 1.0 / np.sqrt(2.0) / (values[:, 3] | 3)
    x, y, z = (values[:, k] * scale for k in range(3))
    w = np.sqrt(np.maximum(1.0 - x * x - y * y - z * z, 0.0))
    out = np.empty_like(values)
    for shift, each in zip((1, 2, 3, 0), (x, y, z, w), strict=True):
        out[np.arange(len(values)), ((values[:, 3] & 3) + shift) & 3] = np.rint(each * 32767.0)
    return out


def _exponential(rows: Bytes) -> NDArray[Any]:
    """Return numbers of 8 bits of exponent and 24 bits of mantissa as floating-point numbers."""
    values = rows.view(np.int32)
    return np.asarray(np.ldexp((values << 8 >> 8).astype(np.float64), values >> 24), np.float32)


_FILTERS: dict[str, Callable[[Bytes], NDArray[Any]]] = {
    "NONE": lambda rows: rows,
    "OCTAHEDRAL": _octahedral,
    "QUATERNION": _quaternion,
    "EXPONENTIAL": _exponential,
}
