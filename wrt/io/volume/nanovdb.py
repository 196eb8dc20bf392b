"""NanoVDB files (.nvdb), as a dense grid.

Format: Museth, "NanoVDB: A GPU-friendly and portable VDB data structure for real-time rendering and simulation", 2021,
and the layout that its header documents: a file has segments of grids; a grid has a tree of a root, nodes of 32³ nodes,
nodes of 16³ leaves, and leaves of 8³ values.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits

_MAGIC = (b"NanoVDB0", b"NanoVDB1", b"NanoVDB2")
_SEGMENT = struct.Struct("<8sIHH")
_CODECS = {0: "none", 1: "zip", 2: "blosc"}

_META = np.dtype({"names": ["grid_size", "name_size"], "formats": ["<u8", "<u4"],
                  "offsets": [0, 136], "itemsize": 176})  # fmt: skip
_GRID = np.dtype({"names": ["magic", "name", "matrix", "shift", "type"],
                  "formats": ["S8", "S256", ("<f8", (3, 3)), ("<f8", 3), "<u4"],
                  "offsets": [0, 40, 384, 528, 636], "itemsize": 672})  # fmt: skip
_TREE = np.dtype([("offsets", "<i8", 4), ("nodes", "<u4", 3), ("others", "V20")])
_LEAF = np.dtype({"names": ["origin", "values"], "formats": [("<i4", 3), ("<f4", (8, 8, 8))],
                  "offsets": [0, 96], "itemsize": 2144})  # fmt: skip
_LOWER = np.dtype({"names": ["origin", "active", "children", "table"],
                   "formats": [("<i4", 3), ("u1", 512), ("u1", 512), ("<f4", (4096, 2))],
                   "offsets": [0, 32, 544, 1088], "itemsize": 33856})  # fmt: skip
_UPPER = np.dtype({"names": ["active", "children"], "formats": [("u1", 4096), ("u1", 4096)],
                   "offsets": [32, 4128], "itemsize": 270400})  # fmt: skip
_ROOT = np.dtype({"names": ["entries"], "formats": ["<u4"], "offsets": [24], "itemsize": 64})
_ROOT_ENTRY = np.dtype({"names": ["child", "active"], "formats": ["<i8", "<u4"], "offsets": [8, 16], "itemsize": 32})
_FLOAT = 1
_LEAF_SIDE, _LOWER_SIDE = 8, 128


def chosen_name(names: list[str], grid: str | None) -> str | None:
    """Return the name of the grid to read: the one that is given, or "density", or the only one."""
    if grid is not None:
        return grid
    return "density" if "density" in names else names[0] if len(names) == 1 else None


def read_nanovdb(data: bytes, grid: str | None = None) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Return a grid of a file as the (nz, ny, nx) values of a box around its leaves, and the box's place in the world.

    Raises:
        InputError: when the file is damaged, has no such grid, or the box of the grid is too large.
    """
    grids = list(_grids(data))
    names = [name for name, _ in grids]
    name = chosen_name(names, grid)
    if name not in names:
        advice = "name one" if grid is None else f"there is no {grid!r}"
        raise InputError(f"its grids are {', '.join(map(repr, names))}; {advice}")
    return _dense(grids[names.index(name)][1])


def _grids(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the names and the bytes of the grids of all segments."""
    at = 0
    while at < len(data):
        magic, _, count, codec = _SEGMENT.unpack(_part(data, at, _SEGMENT.size))
        if magic not in _MAGIC:
            raise InputError("not a NanoVDB file, or damaged")
        if _CODECS.get(codec) not in ("none", "zip"):
            raise InputError("is compressed by a codec that cannot be read; write it with codec 'zip' or 'none'")
        at += _SEGMENT.size
        metas, names = [], []
        for _ in range(count):
            (meta,) = _records(data, at, 1, _META)
            at += _META.itemsize
            text = _part(data, at, int(meta["name_size"]))
            metas.append(meta)
            names.append(text.rstrip(b"\0").decode("utf-8", "replace"))
            at += len(text)
        for meta, name in zip(metas, names, strict=True):
            size = int(meta["grid_size"])
            if _CODECS[codec] == "none":
                grid, at = _part(data, at, size), at + size
            else:
                grid, at = _unzipped(data, at, size)
            yield name, grid


def _part(data: bytes, first: int, size: int) -> bytes:
    """Return some bytes, which must be there."""
    if first < 0 or size < 0 or first + size > len(data):
        raise InputError("the file is damaged, or not whole")
    return data[first : first + size]


def _unzipped(data: bytes, first: int, size: int) -> tuple[bytes, int]:
    """Return a compressed grid, and where its chunks end; before each is its length."""
    memory_limits.take(memory_limits.VOLUMES, size)
    grid, at = bytearray(), first
    while len(grid) < size:
        (length,) = struct.unpack("<Q", _part(data, at, 8))
        chunk = _part(data, at + 8, length)
        at += 8 + length
        try:
            unzipped = zlib.decompressobj().decompress(chunk, size - len(grid))
        except zlib.error:
            unzipped = b""
        if not unzipped:
            raise InputError("the file is damaged: a grid cannot be decompressed")
        grid += unzipped
    return bytes(grid), at


def _dense(data: bytes) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Return a grid as an array, with the place of its box."""
    (grid,) = _records(data, 0, 1, _GRID)
    if grid["magic"] not in _MAGIC:
        raise InputError("the file is damaged: a grid does not begin as it must")
    if grid["type"] != _FLOAT:
        raise InputError(f"the grid has values of kind {grid['type']}; only float32 numbers can be read")
    (tree,) = _records(data, _GRID.itemsize, 1, _TREE)
    starts = [_GRID.itemsize + int(offset) for offset in tree["offsets"]]
    leaves, lower_nodes, upper_nodes = (
        _records(data, starts[level], int(tree["nodes"][level]), kind)
        for level, kind in enumerate((_LEAF, _LOWER, _UPPER))
    )
    if any(len(_tile_numbers(node)) for node in upper_nodes):
        raise InputError("it has blocks of 128 x 128 x 128 cells of one value, which cannot be read; voxelise them")
    (root,) = _records(data, starts[3], 1, _ROOT)
    entries = _records(data, starts[3] + _ROOT.itemsize, int(root["entries"]), _ROOT_ENTRY)
    if ((entries["child"] == 0) & (entries["active"] != 0)).any():
        raise InputError("it has blocks of 4096 x 4096 x 4096 cells of one value, which cannot be read")
    corners = [leaves["origin"].astype(np.int64) & -_LEAF_SIDE]
    blocks = [*leaves["values"]]
    for node in lower_nodes:  # blocks of one value have no leaves
        numbers = _tile_numbers(node)
        steps = np.stack([numbers >> 8, (numbers >> 4) & 15, numbers & 15], axis=1)
        corners.append((node["origin"].astype(np.int64) & -_LOWER_SIDE) + _LEAF_SIDE * steps)
        blocks += node["table"][numbers, 0].tolist()
    places = np.concatenate(corners)
    if not len(places):
        raise InputError("the grid is empty")
    low, high = places.min(axis=0), places.max(axis=0) + _LEAF_SIDE
    nx, ny, nz = (high - low).tolist()
    memory_limits.take(memory_limits.VOLUMES, 4 * nx * ny * nz)
    values = np.zeros((nx, ny, nz), np.float32)
    for (x, y, z), block in zip((places - low).tolist(), blocks, strict=True):
        values[x : x + _LEAF_SIDE, y : y + _LEAF_SIDE, z : z + _LEAF_SIDE] = block
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = grid["matrix"], grid["shift"]
    # A value belongs to the point of its index, which is the centre of its cell.
    box = {"lower": tuple((low - 0.5).tolist()), "upper": tuple((high - 0.5).tolist()), "transform": transform}
    return np.ascontiguousarray(values.transpose(2, 1, 0)), box


def _records(data: bytes, first: int, count: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return records at an offset, which must be whole."""
    return np.frombuffer(_part(data, first, count * kind.itemsize), kind)


def _tile_numbers(node: Any) -> NDArray[np.int64]:
    """Return which entries of a node are blocks of one value."""
    active, children = (np.unpackbits(node[name], bitorder="little").astype(bool) for name in ("active", "children"))
    return np.nonzero(active & ~children)[0]
