"""Structs and arrays of the CPU in memory, laid out as kernels that Warp has compiled read them.

A struct holds arrays of the CPU, or Warp's arrays of a GPU. Warp takes both as arguments of its launches.
`tests/running/test_artefacts.py` compares the layouts with Warp's own.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.memory import LARGE, MEMORY_ADVICE, zeros
from wrt.errors import NotEnoughMemory

ALIGNMENT = 64
"""Bytes: a cache line, and the largest vector."""

HEADER: Any = np.dtype(
    {
        "names": ["data", "grad", "shape", "strides", "ndim", "flags"],
        "formats": ["<u8", "<u8", ("<i4", 4), ("<i4", 4), "<u2", "<u2"],
        "itemsize": 56,
    }
)
"""An array as a kernel argument (`array_t` in Warp's array.h)."""

SUFFIXES = {"float32": "", "float64": "d", "int32": "i", "uint32": "ui"}
"""Suffixes of vector and matrix names by number type, as in Warp."""

_COMPOSITE = re.compile(r"(?:vec(\d+)|mat(\d+)x(\d+))(\D*)")
_NUMBERS = {suffix: name for name, suffix in SUFFIXES.items()}

Field = tuple[str, str, int]
"""Name, type and offset of a field. A type is "int8", "float32" and so on, "vec3" or "mat3x3" with one of SUFFIXES,
"array", or "struct NAME"."""


def attribute_of(module: str, name: str) -> Any:
    """Return a struct, kernel or function of a module of `kernels/` by name; imports the module, and so Warp."""
    return getattr(importlib.import_module(module), name)


class Layout:
    """The memory layout of a struct or of the arguments of a kernel; calling it creates a struct.

    Attributes:
        name: The module and name of the struct; empty for the arguments of a kernel.
        kinds: The type of each field.
        structs: The layout of each field that is a struct.
        numpy: The NumPy type.
    """

    def __init__(self, name: str, size: int, fields: list[Field], struct: Callable[[str], Layout]) -> None:
        """Lay out `size` bytes; `struct` returns the layout of a struct by its name."""
        names, kinds, offsets = zip(*fields, strict=True)
        self.name = name
        self.kinds = dict(zip(names, kinds, strict=True))
        self.structs = {field: struct(kind[7:]) for field, kind, _ in fields if kind.startswith("struct ")}
        formats = [
            self.structs[field].numpy if field in self.structs else numpy_type(kind) for field, kind, _ in fields
        ]
        layout: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
        self.numpy: Any = np.dtype(layout)

    def __call__(self) -> Struct:
        """Return a struct of zeros."""
        return Struct(self, np.zeros((), self.numpy))

    def numpy_dtype(self) -> Any:
        """Return the NumPy type."""
        return self.numpy

    def warp_struct(self) -> Any:
        """Return Warp's struct of this name."""
        module, _, name = self.name.rpartition(".")
        return attribute_of(module, name)


class Struct:
    """A struct on the host. Values are copied into it, except for arrays.

    Attributes:
        _layout: Its layout.
        _memory: Its fields, as a zero-dimensional NumPy array.
        _bytes: The same memory byte by byte.
        _objects: Its arrays and nested structs by name.
    """

    _layout: Layout
    _memory: NDArray[Any]
    _bytes: NDArray[np.uint8]
    _objects: dict[str, Any]

    def __init__(self, layout: Layout, memory: NDArray[Any]) -> None:
        objects: dict[str, Any] = {name: None for name, kind in layout.kinds.items() if kind == "array"}
        objects |= {name: Struct(inner, memory[name]) for name, inner in layout.structs.items()}
        self.__dict__.update(_layout=layout, _memory=memory, _bytes=bytes_of(memory), _objects=objects)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name in self._objects:
            return self._objects[name]
        if name not in self._layout.kinds:
            raise AttributeError(name)
        value = self._memory[name]
        return value if value.ndim else value.item()

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self._layout.kinds:
            raise AttributeError(f"a struct has no field {name!r}")
        if isinstance(value, Struct):
            for field in value._layout.kinds:
                setattr(self._objects[name], field, getattr(value, field))
        elif value is not None:
            if self._layout.kinds[name] == "array":
                self._objects[name] = value
            self._memory[name] = packed(value, self._memory.dtype[name])

    def __ctype__(self) -> Any:
        """Return the struct as an argument of Warp's launches."""
        return self._layout.warp_struct().ctype.from_buffer_copy(self._bytes)

    def fields(self) -> dict[str, Any]:
        """Return the values by name."""
        return {name: getattr(self, name) for name in self._layout.kinds}


class Array:
    """An array in the memory of the CPU.

    Attributes:
        rows: The memory as a NumPy array.
        dtype: The NumPy type of an element, which may be a vector.
        shape: Its dimensions, without those of elements.
        device: "cpu", as of Warp's arrays there.
    """

    device = "cpu"

    def __init__(self, rows: NDArray[Any], dtype: Any) -> None:
        self.rows, self.dtype = rows, dtype
        self.shape = rows.shape[: rows.ndim - dtype.ndim]

    def __len__(self) -> int:
        return int(self.shape[0])

    def __getitem__(self, part: slice) -> Array:
        return Array(self.rows[part], self.dtype)

    @property
    def ptr(self) -> int:
        """Its address."""
        return int(self.rows.__array_interface__["data"][0])

    @property
    def __array_interface__(self) -> dict[str, Any]:
        return self.rows.__array_interface__

    @property
    def size(self) -> int:
        """The number of its elements."""
        return math.prod(self.shape)

    @property
    def capacity(self) -> int:
        """Its bytes."""
        return self.rows.nbytes

    def numpy(self) -> NDArray[Any]:
        """Return the memory as a NumPy array."""
        return self.rows

    def fill_(self, value: Any) -> None:
        """Set all elements."""
        self.rows[...] = value

    def zero_(self) -> None:
        """Set all elements to zero."""
        self.rows.view(np.uint8)[...] = 0


def packed(value: Any, kind: Any) -> Any:
    """Return a value as a field of a NumPy type: an array's header, a struct's bytes, or the value."""
    if isinstance(value, Struct):
        return value._memory
    if isinstance(value, Array):
        header, count = np.zeros((), HEADER), len(value.shape)
        header["data"], header["ndim"] = value.ptr, count
        header["shape"][:count], header["strides"][:count] = value.shape, value.rows.strides[:count]
        return header
    if hasattr(value, "__ctype__"):  # Warp's arrays and structs
        return np.frombuffer(bytes(value.__ctype__()), kind)[0]
    return value


def bytes_of(value: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the memory of an array byte by byte."""
    return value.reshape(-1).view(np.uint8)


def numpy_type(dtype: Any) -> Any:
    """Return the NumPy type of a struct's layout, of `int` or `float` (32 bits), or of a type of a Field."""
    if isinstance(dtype, Layout):
        return dtype.numpy
    if dtype is int or dtype is float:  # NumPy's types of 64 bits are equal to these
        return np.dtype("int32" if dtype is int else "float32")
    if dtype == "array":
        return HEADER
    if isinstance(dtype, str) and (found := _COMPOSITE.fullmatch(dtype)):
        *sizes, suffix = found.groups()
        return np.dtype((_NUMBERS[suffix], tuple(int(size) for size in sizes if size)))
    return np.dtype(dtype)


def from_numpy(data: Any, dtype: Any, *, copy: bool) -> Array:
    """Return an array of NumPy data or of a list of structs, which shares their memory unless `copy` is set."""
    kind = numpy_type(dtype)
    if isinstance(data, list) and isinstance(dtype, Layout):
        data = np.stack([struct._memory for struct in data])
    rows = np.asarray(data, kind.base)
    rows = rows.reshape(-1, *kind.shape) if kind.shape else rows
    if not copy:
        return Array(np.ascontiguousarray(rows), kind)
    array = empty(rows.shape[: rows.ndim - len(kind.shape)], kind)
    array.fill_(rows)
    return array


def empty(shape: Any, dtype: Any) -> Array:
    """Return an uninitialised array; a large one is zero."""
    kind = numpy_type(dtype)
    numbers, number = (*dimensions(shape), *kind.shape), kind.base
    size = math.prod(numbers) * number.itemsize
    try:
        if size >= LARGE:
            return Array(zeros(numbers, number), kind)
        block = np.empty(size + ALIGNMENT, np.uint8)
    except MemoryError:
        shortage = f"{size / 1e9:.2f} GB more were needed"
        raise NotEnoughMemory(f"memory ran out on cpu: {shortage}; {MEMORY_ADVICE}") from None
    start = -block.__array_interface__["data"][0] % ALIGNMENT
    return Array(block[start : start + size].view(number).reshape(numbers), kind)


def view(array: Array, dtype: Any, shape: Any) -> Array:
    """Return the memory of an array as one of another type and shape."""
    kind = numpy_type(dtype)
    numbers = (*dimensions(shape), *kind.shape)
    flat = array.rows.reshape(-1).view(kind.base)
    return Array(flat[: math.prod(numbers)].reshape(numbers), kind)


def dimensions(shape: Any) -> tuple[int, ...]:
    """Return a shape as a tuple."""
    return (int(shape),) if isinstance(shape, (int, np.integer)) else tuple(shape)
