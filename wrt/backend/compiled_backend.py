"""The backend that runs already compiled kernels on the CPU without importing Warp.

It takes kernels, structs and constants from the notes of `recording.py`. It lays out arrays and structs as Warp does;
`tests/running/test_without_warp.py` compares the two.
"""

from __future__ import annotations

import ctypes
import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.builds import Builds, NotCompiled
from wrt.backend.cuda.gpus import CudaVersions, Gpu
from wrt.backend.memory import LARGE, zeros
from wrt.backend.recording import SUFFIXES, call_name

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

_COMPOSITE = re.compile(r"(?:vec(\d+)|mat(\d+)x(\d+))(\D*)")
_NUMBERS = {suffix: name for name, suffix in SUFFIXES.items()}


class Bounds(ctypes.Structure):
    """The number of threads of a launch (`launch_bounds_t<1>` in Warp's builtin.h)."""

    _fields_ = (("shape", ctypes.c_uint32), ("size", ctypes.c_size_t), ("multiple", ctypes.c_size_t))


class Layout:
    """The memory layout of a struct or of the arguments of a kernel; calling it creates a struct.

    Attributes:
        kinds: The type of each field, as in the notes.
        structs: The layout of each field that is a struct.
    """

    def __init__(self, backend: CompiledBackend, size: int, fields: list[tuple[str, str, int]]) -> None:
        names, kinds, offsets = zip(*fields, strict=True)
        self.kinds = dict(zip(names, kinds, strict=True))
        self.structs = {name: backend.struct(kind[7:]) for name, kind, _ in fields if kind.startswith("struct ")}
        formats = [self.structs[name].numpy if name in self.structs else _dtype(kind) for name, kind, _ in fields]
        layout: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
        self.numpy: Any = np.dtype(layout)

    def __call__(self) -> Struct:
        return Struct(self, np.zeros((), self.numpy))

    def numpy_dtype(self) -> Any:
        """Return the NumPy type."""
        return self.numpy


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
        self.__dict__.update(_layout=layout, _memory=memory, _bytes=_bytes(memory), _objects=objects)

    def __getattr__(self, name: str) -> Any:
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
            if isinstance(value, Array):
                self._objects[name] = value
            self._memory[name] = _packed(value)


class Array:
    """An array in memory.

    Attributes:
        rows: The memory as a NumPy array.
        dtype: The NumPy type of an element, which may be a vector.
        shape: Its dimensions, without those of elements.
    """

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

    def numpy(self) -> NDArray[Any]:
        """Return the memory as a NumPy array."""
        return self.rows

    def fill_(self, value: Any) -> None:
        """Set all elements."""
        self.rows[...] = value

    def zero_(self) -> None:
        """Set all elements to zero."""
        self.rows.view(np.uint8)[...] = 0


def _packed(value: Any) -> Any:
    """Return a value that is no struct as a kernel argument."""
    if not isinstance(value, Array):
        return value
    header, count = np.zeros((), HEADER), len(value.shape)
    header["data"], header["ndim"] = value.ptr, count
    header["shape"][:count], header["strides"][:count] = value.shape, value.rows.strides[:count]
    return header


class NotedModule(SimpleNamespace):
    """The noted constants, structs and kernels of a module of `kernels/`."""

    def __getattr__(self, name: str) -> Any:
        raise NotCompiled(name)


class CompiledBackend:
    """Runs already compiled kernels, with the methods of WarpBackend; anything not noted raises NotCompiled."""

    def __init__(self, builds: Builds) -> None:
        self.builds, self.version = builds, builds.warp_version
        self._modules: dict[str, NotedModule] = {}
        self._structs: dict[str, Layout] = {}

    def start(self) -> None:
        pass

    def kernels(self, module: str) -> Any:
        if module not in self._modules:
            noted = self._noted("modules", module)
            self._modules[module] = NotedModule(**{name: self._value(value) for name, value in noted.items()})
        return self._modules[module]

    def call(self, module: str, function: str, *arguments: Any) -> Any:
        return self._value(self._noted("calls", call_name(module, function, arguments)))

    def struct(self, name: str) -> Layout:
        """Return a struct by its name in the notes."""
        if name not in self._structs:
            self._structs[name] = Layout(self, *self._noted("structs", name))
        return self._structs[name]

    def _noted(self, table: str, name: str) -> Any:
        if name not in self.builds.notes[table]:
            raise NotCompiled(name)
        return self.builds.notes[table][name]

    def _value(self, note: dict[str, Any]) -> Any:
        ((kind, value),) = note.items()
        if kind == "kernel":
            return SimpleNamespace(module=SimpleNamespace(name=value[0]), key=value[1], function=None, arguments=None)
        if kind == "struct":
            return self.struct(value)
        if kind == "fields":
            return SimpleNamespace(**value)
        return tuple(value) if isinstance(value, list) else value

    def array(self, data: Any, dtype: Any, device: str = "cpu", *, copy: bool = True) -> Any:
        kind = _dtype(dtype)
        if isinstance(data, list) and isinstance(dtype, Layout):
            data = np.stack([struct._memory for struct in data])
        rows = np.asarray(data, kind.base)
        rows = rows.reshape(-1, *kind.shape) if kind.shape else rows
        if not copy:
            return Array(np.ascontiguousarray(rows), kind)
        array = Array(_memory(rows.shape, kind.base), kind)
        array.fill_(rows)
        return array

    def empty(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        kind = _dtype(dtype)
        return Array(_memory((*_shape(shape), *kind.shape), kind.base), kind)

    empty_large = empty

    def zeros(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        array = self.empty(shape, dtype)
        if array.rows.nbytes < LARGE:
            array.zero_()
        return array

    def view(self, array: Array, dtype: Any, shape: Any) -> Any:
        kind, whole = _dtype(dtype), _shape(shape)
        flat = array.rows.reshape(-1).view(kind.base)
        whole = (*whole, *kind.shape)
        return Array(flat[: math.prod(whole)].reshape(whole), kind)

    def clone(self, array: Array) -> Any:
        return self.array(array.rows, array.dtype)

    def copy(self, target: Array, source: Array, dest_offset: int = 0, count: int = 0) -> None:
        count = count or len(source)
        target.rows[dest_offset : dest_offset + count] = source.rows[:count]

    def fetch(self, array: Array, *, beside: bool = False) -> NDArray[Any]:
        return array.rows

    def sums_before(self, counts: Array) -> Any:
        return self.array(np.cumsum(counts.rows, dtype=counts.rows.dtype) - counts.rows, counts.dtype)

    def fields(self, value: Any) -> dict[str, Any]:
        return {name: getattr(value, name) for name in value._layout.kinds} if isinstance(value, Struct) else {}

    def is_loaded(self, kernel: Any, device: str) -> bool:
        return kernel.arguments is not None

    def load(self, kernel: Any, device: str) -> None:
        kernel.function, layout = self.builds.function(kernel.module.name, kernel.key)
        kernel.arguments = Layout(self, *layout)

    def launch(self, kernel: Any, first: int, count: int, inputs: list[Any], device: str) -> None:
        layout = kernel.arguments.numpy
        arguments = np.zeros(layout.itemsize, np.uint8)
        for name, value in zip(kernel.arguments.kinds, [first, *inputs], strict=True):
            # Only bytes: NumPy copies a struct field by field, and half a millisecond a launch is 5 % of a short pass.
            kind, offset, *_ = layout.fields[name]
            packed = value._bytes if isinstance(value, Struct) else _bytes(np.asarray(_packed(value), kind))
            arguments[offset : offset + len(packed)] = packed
        kernel.function(ctypes.byref(Bounds(count, count, 1)), arguments.__array_interface__["data"][0])

    def queue(self, kernel: Any, first: int, count: int, inputs: list[Any], device: str) -> None:
        raise NotCompiled("kernels for CUDA")

    def sum_before(self, counts: Array, sums_out: Array) -> None:
        raise NotCompiled("kernels for CUDA")

    def total(self, values: Array) -> float:
        raise NotCompiled("kernels for CUDA")

    def sort_pairs(self, keys: Array, values: Array, count: int) -> None:
        raise NotCompiled("kernels for CUDA")

    def gpus(self) -> int:
        raise NotCompiled("kernels for CUDA")

    def architecture_of(self, gpu: str) -> int:
        raise NotCompiled("kernels for CUDA")

    def gpu(self, name: str) -> Gpu:
        raise NotCompiled("kernels for CUDA")

    def cuda_versions(self) -> CudaVersions:
        raise NotCompiled("kernels for CUDA")

    def memory_of(self, gpu: str) -> int:
        raise NotCompiled("kernels for CUDA")


def _bytes(value: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the memory of an array byte by byte."""
    return value.reshape(-1).view(np.uint8)


def _dtype(dtype: Any) -> Any:
    """Return the NumPy type of a `dtype` of the interface, or of a type in the notes."""
    if isinstance(dtype, Layout):
        return dtype.numpy
    if dtype in (int, float):
        return np.dtype("int32" if dtype is int else "float32")
    if dtype == "array":
        return HEADER
    if isinstance(dtype, str) and (found := _COMPOSITE.fullmatch(dtype)):
        *sizes, suffix = found.groups()
        return np.dtype((_NUMBERS[suffix], tuple(int(size) for size in sizes if size)))
    return np.dtype(dtype)


def _shape(shape: Any) -> tuple[int, ...]:
    return (int(shape),) if isinstance(shape, (int, np.integer)) else tuple(shape)


def _memory(shape: tuple[int, ...], number: Any) -> NDArray[Any]:
    """Return an uninitialised array; large ones are zero."""
    size = math.prod(shape) * number.itemsize
    if size >= LARGE:
        return zeros(shape, number)
    block = np.empty(size + ALIGNMENT, np.uint8)
    start = -block.__array_interface__["data"][0] % ALIGNMENT
    aligned: NDArray[Any] = block[start : start + size].view(number)
    return aligned.reshape(shape)
