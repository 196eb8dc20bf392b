"""Numbers, vectors, records and arrays as Warp lays them out in memory, as far as the host's side uses them."""

from __future__ import annotations

import ctypes
import math
import mmap
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

MOST_DIMENSIONS = 4
"""Of a Warp array."""

ALIGNMENT = 64
"""Bytes: a line of the cache, and no vector is larger."""

LARGE = 1 << 20
"""Bytes from which on memory comes from the system as it is first touched, as where Warp asks for it."""


class Number:
    """A number of Warp's: what it is in C and for NumPy."""

    c_type: ClassVar[Any]
    numpy: ClassVar[str]

    def __init__(self, value: Any = 0) -> None:
        """Take the value."""
        self.value = value


def _number(name: str, c_type: Any, numpy: str) -> type[Number]:
    return type(name, (Number,), {"c_type": c_type, "numpy": numpy})


float32, float64 = _number("float32", ctypes.c_float, "<f4"), _number("float64", ctypes.c_double, "<f8")
int32, bool_ = _number("int32", ctypes.c_int32, "<i4"), _number("bool", ctypes.c_bool, "?")
_OTHERS = {
    f"{kind}{bits}": _number(f"{kind}{bits}", getattr(ctypes, f"c_{kind}{bits}"), f"<{kind[0]}{bits // 8}")
    for bits in (8, 16, 32, 64)
    for kind in ("int", "uint")
}
NUMBERS = _OTHERS | {"float32": float32, "float64": float64, "int32": int32, "bool": bool_}
"""Types of numbers by their names."""

_PYTHON: dict[Any, type[Number]] = {int: int32, float: float32, bool: bool_}


def number_type(dtype: Any) -> Any:
    """Return Warp's type for one of Python's; others are returned as they are."""
    return _PYTHON.get(dtype, dtype) if isinstance(dtype, type) else dtype


class _Several(ctypes.Array):  # type: ignore[type-arg]
    """Vectors and matrices; one number fills them."""

    _length_ = 1
    _type_ = ctypes.c_float

    def __init__(self, *values: Any) -> None:
        if len(values) == 1:
            values *= self._length_
        super().__init__(*(getattr(value, "value", value) for value in values))


def several(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return the type of vectors or matrices of numbers."""
    number = number_type(dtype)
    fields = {
        "_length_": math.prod(shape),
        "_type_": number.c_type,
        "_shape_": shape,
        "_wp_scalar_type_": number,
    }
    return type(f"several_{shape}_{number.__name__}", (_Several,), fields)


def numpy_type(dtype: Any) -> Any:
    """Return what NumPy calls a type, its own dimensions apart."""
    dtype = number_type(dtype)
    if isinstance(dtype, Record):
        layout: Any = dtype.numpy_dtype()
        return np.dtype(layout)
    if isinstance(dtype, Array):
        return np.dtype(ArrayHeader)
    return np.dtype(getattr(dtype, "_wp_scalar_type_", dtype).numpy)


class ArrayHeader(ctypes.Structure):
    """An array as kernels are given it (`array_t` in Warp's array.h)."""

    _fields_: ClassVar[list[tuple[str, Any]]] = [
        ("data", ctypes.c_uint64),
        ("grad", ctypes.c_uint64),
        ("shape", ctypes.c_int32 * MOST_DIMENSIONS),
        ("strides", ctypes.c_int32 * MOST_DIMENSIONS),
        ("ndim", ctypes.c_uint16),
        ("flags", ctypes.c_uint16),
    ]


class Array:
    """An array in memory, or, without data, the type of such arrays in an annotation."""

    device = "cpu"

    def __init__(
        self,
        data: Any = None,
        dtype: Any = None,
        shape: int | tuple[int, ...] | None = None,
        *,
        ndim: int = 1,
        ptr: int | None = None,
        device: str | None = None,
        copy: bool = True,
    ) -> None:
        """Make an array of numbers or of what is at an address; of neither, a type."""
        self.dtype, self.ndim = number_type(dtype), ndim
        if ptr is not None:
            data = _at(ptr, shape, self.dtype)
            copy = False
        if data is None:
            return
        scalar = numpy_type(self.dtype)
        rows = np.asarray(data, scalar)
        inner: tuple[int, ...] = getattr(self.dtype, "_shape_", ())
        rows = rows.reshape(-1, *inner) if inner else rows
        if copy:
            kept = memory(rows.shape, scalar)
            kept[...] = rows
            rows = kept
        self.rows: NDArray[Any] = np.ascontiguousarray(rows)
        self.shape = self.rows.shape[: self.rows.ndim - len(inner)]
        self.ndim = len(self.shape)

    def __len__(self) -> int:
        return int(self.shape[0])

    def __getitem__(self, part: slice) -> Array:
        return Array(self.rows[part], self.dtype, copy=False)

    @property
    def ptr(self) -> int:
        """Where it is in memory."""
        return int(self.rows.__array_interface__["data"][0])

    def numpy(self) -> NDArray[Any]:
        """Return the same memory as NumPy sees it."""
        return self.rows

    def contiguous(self) -> Array:
        """Return itself: it never is anything else."""
        return self

    def fill_(self, value: Any) -> None:
        """Set all of it."""
        self.rows[...] = value

    def zero_(self) -> None:
        """Set all of it to zero."""
        self.rows.view(np.uint8)[...] = 0

    def header(self) -> ArrayHeader:
        """Return what kernels are given."""
        header = ArrayHeader()
        header.data, header.ndim = self.ptr, self.ndim
        for axis, (count, stride) in enumerate(zip(self.shape, self.rows.strides, strict=False)):
            header.shape[axis], header.strides[axis] = count, stride
        return header


def memory(shape: tuple[int, ...], scalar: Any) -> NDArray[Any]:
    """Return an array of any content, or of zeros where it is large."""
    size = math.prod(shape) * scalar.itemsize
    if size >= LARGE:
        try:
            return np.frombuffer(mmap.mmap(-1, size), scalar).reshape(shape)
        except OSError as error:
            raise MemoryError(f"{size} bytes") from error
    block = np.empty(size + ALIGNMENT, np.uint8)
    start = -block.__array_interface__["data"][0] % ALIGNMENT
    aligned: NDArray[Any] = block[start : start + size].view(scalar)
    return aligned.reshape(shape)


def _at(ptr: int, shape: Any, dtype: Any) -> NDArray[Any]:
    """Return the array of a shape at an address."""
    scalar = numpy_type(dtype)
    whole = ((shape,) if isinstance(shape, int) else tuple(shape)) + getattr(dtype, "_shape_", ())
    block = (ctypes.c_byte * (math.prod(whole) * scalar.itemsize)).from_address(ptr)
    return np.frombuffer(block, scalar).reshape(whole)


class Record:
    """The type of records that a class with annotations describes, as `warp.struct` makes it; called, it makes one."""

    def __init__(self, described: type) -> None:
        """Take the class."""
        self.fields: dict[str, Any] = {name: number_type(kind) for name, kind in described.__annotations__.items()}
        layout = [(name, c_type(kind)) for name, kind in self.fields.items()]
        self.c_type: Any = type(described.__name__, (ctypes.Structure,), {"_fields_": layout or [("_", ctypes.c_byte)]})

    def __call__(self) -> RecordValue:
        """Return one of zeros and without arrays."""
        return RecordValue(self)

    def numpy_dtype(self) -> dict[str, Any]:
        """Return the layout for NumPy."""
        return {
            "names": list(self.fields),
            "formats": [(numpy_type(kind), getattr(kind, "_shape_", ())) for kind in self.fields.values()],
            "offsets": [getattr(self.c_type, name).offset for name in self.fields],
            "itemsize": ctypes.sizeof(self.c_type),
        }


class RecordValue:
    """A record on the host: what is set is copied, but for arrays."""

    _record: Record

    def __init__(self, record: Record) -> None:
        """Make one of zeros."""
        values: dict[str, Any] = {}
        for name, kind in record.fields.items():
            if isinstance(kind, Record):
                values[name] = kind()
            elif isinstance(kind, Array):
                values[name] = None
            else:
                values[name] = kind() if issubclass(kind, ctypes.Array) else kind.c_type().value
        self.__dict__.update(values, _record=record)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self._record.fields:
            raise AttributeError(f"a record has no field {name!r}")
        self.__dict__[name] = value.copied() if isinstance(value, RecordValue) else value

    def copied(self) -> RecordValue:
        """Return another one of the same values."""
        other = RecordValue(self._record)
        for name in self._record.fields:
            setattr(other, name, self.__dict__[name])
        return other

    def packed(self) -> Any:
        """Return the record as kernels are given it."""
        out = self._record.c_type()
        for name, kind in self._record.fields.items():
            value = self.__dict__[name]
            if value is not None:
                setattr(out, name, packed(value, kind))
        return out


def c_type(kind: Any) -> Any:
    """Return what a field or an argument of a kernel is in C."""
    if isinstance(kind, Array):
        return ArrayHeader
    kind = number_type(kind)
    return kind if isinstance(kind, type) and issubclass(kind, ctypes.Array) else kind.c_type


def packed(value: Any, kind: Any) -> Any:
    """Return a value of a field or an argument as kernels are given it."""
    if isinstance(kind, Array):
        return ArrayHeader() if value is None else value.header()
    if isinstance(value, RecordValue):
        return value.packed()
    kind = number_type(kind)
    if issubclass(kind, ctypes.Array):
        return value if isinstance(value, kind) else kind(*value)
    value = getattr(value, "value", value)
    number = float(value) if kind in (float32, float64) else int(value)
    return kind.c_type(number).value
