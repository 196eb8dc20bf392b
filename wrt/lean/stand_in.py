"""What stands in for the module `warp` where all kernels that are needed have been compiled before.

It declares kernels without reading their code, makes arrays and launches what Warp compiled. Whatever it does not know
raises Missing, upon which Warp itself takes its place.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from wrt.lean import types
from wrt.lean.builds import RENDER, Builds, Missing
from wrt.lean.types import Array, Record


class Bounds(ctypes.Structure):
    """How many threads a launch has (`launch_bounds_t<1>` in Warp's builtin.h)."""

    _fields_ = (("shape", ctypes.c_uint32), ("size", ctypes.c_size_t), ("multiple", ctypes.c_size_t))


class DeclaredKernel:
    """A kernel: its name, and how its arguments lie in memory."""

    def __init__(self, function: Any, module: Any) -> None:
        """Take the Python function and the module that Warp would put it into."""
        self.key, self.module = function.__qualname__, module
        self.kinds = [kind for name, kind in function.__annotations__.items() if name != "return"]
        fields = [(str(k), types.c_type(kind)) for k, kind in enumerate(self.kinds)]
        self._arguments: Any = type("Arguments", (ctypes.Structure,), {"_fields_": fields})
        self._function: Any = None

    def launch(self, builds: Builds, count: int, inputs: Sequence[Any]) -> None:
        """Run threads 0 to count − 1, on this core."""
        if self._function is None:
            self._function = builds.function(self.module.name, self.key)
        values = [types.packed(value, kind) for value, kind in zip(inputs, self.kinds, strict=True)]
        arguments, bounds = self._arguments(*values), Bounds(count, count, 1)
        self._function(ctypes.byref(bounds), ctypes.byref(arguments))


class StandIn(ModuleType):
    """The module.

    Attributes:
        rendered: whether any ray of a picture has been traced.
        builds: what was compiled.
    """

    def __init__(self, builds: Builds) -> None:
        """Take what was compiled."""
        super().__init__("warp", __doc__)
        self.__path__: list[str] = []
        for name, number in types.NUMBERS.items():
            setattr(self, name, number)
        self.array = Array
        for count in (2, 3, 4):
            for suffix, of in (("", float), ("d", types.float64), ("i", int), ("ui", types.NUMBERS["uint32"])):
                setattr(self, f"vec{count}{suffix}", types.several((count,), of))
            setattr(self, f"mat{count}{count}", types.several((count, count), float))
        self.inf = math.inf
        self.LOG_WARNING = 30
        self.config = SimpleNamespace(log_level=self.LOG_WARNING, version=builds.warp_version)
        self.types = SimpleNamespace(
            vector=lambda length, dtype: types.several((length,), dtype),
            matrix=lambda shape, dtype: types.several(tuple(shape), dtype),
            type_size_in_bytes=_size,
        )
        self.utils = SimpleNamespace(array_scan=_scan)
        self.rendered = False
        self.builds = builds
        self._modules: dict[str, SimpleNamespace] = {}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise Missing(f"warp.{name}")

    # Declarations.

    Function = Kernel = object

    def constant(self, value: Any) -> Any:
        """Return the value."""
        return value

    def struct(self, described: type) -> Record:
        """Return the type of records that the class describes."""
        return Record(described)

    def func(self, function: Any = None, **_: Any) -> Any:
        """Leave a function of the device as it is."""
        return function if function is not None else lambda function: function

    def func_native(self, *_: Any, **__: Any) -> Any:
        """Leave a function of the device as it is."""
        return lambda function: function

    def kernel(self, function: Any = None, *, module: Any = None, **_: Any) -> Any:
        """Declare a kernel."""
        if function is None:
            return lambda function: self.kernel(function, module=module)
        return DeclaredKernel(function, module or self.get_module(function.__module__))

    def get_module(self, name: str) -> SimpleNamespace:
        """Return the module of kernels of that name."""
        return self._modules.setdefault(name, SimpleNamespace(name=name))

    def set_module_options(self, options: dict[str, Any]) -> None:
        """Do nothing: they were there when it was compiled."""

    def array2d(self, dtype: Any) -> Array:
        """Return the type of arrays of two dimensions."""
        return Array(dtype=dtype, ndim=2)

    # Memory.

    def empty(self, shape: Any, dtype: Any = float, device: str | None = None) -> Array:
        """Return an array of any content."""
        outer = (shape,) if isinstance(shape, (int, np.integer)) else tuple(shape)
        kind = types.number_type(dtype)
        rows = types.memory((*outer, *getattr(kind, "_shape_", ())), types.numpy_type(kind))
        return Array(rows, kind, copy=False)

    def zeros(self, shape: Any, dtype: Any = float, device: str | None = None) -> Array:
        """Return an array of zeros."""
        array = self.empty(shape, dtype)
        if array.rows.nbytes < types.LARGE:
            array.zero_()
        return array

    def full(self, shape: Any, value: Any, dtype: Any = float, device: str | None = None) -> Array:
        """Return an array of one value."""
        array = self.empty(shape, dtype)
        array.fill_(value)
        return array

    def empty_like(self, array: Array) -> Array:
        """Return an array of the same size."""
        return self.empty(array.shape, array.dtype)

    def clone(self, array: Array) -> Array:
        """Return a copy."""
        return Array(array.rows, array.dtype)

    def copy(self, dest: Array, src: Array, dest_offset: int = 0, src_offset: int = 0, count: int = 0) -> None:
        """Copy elements."""
        count = count or len(src)
        dest.rows[dest_offset : dest_offset + count] = src.rows[src_offset : src_offset + count]

    def dtype_to_numpy(self, number: Any) -> Any:
        """Return NumPy's type for numbers."""
        return types.numpy_type(number)

    # Running.

    def init(self) -> None:
        """Do nothing."""

    def load_module(self, module: Any, device: str) -> None:
        """Load what was compiled.

        Raises:
            Missing: where nothing was.
        """
        self.builds.load(module.name)

    def launch(self, kernel: DeclaredKernel, dim: int, inputs: Sequence[Any], device: str) -> None:
        """Run a kernel."""
        kernel.launch(self.builds, dim, inputs)
        self.rendered = self.rendered or kernel.module.name.startswith(RENDER)


def _size(dtype: Any) -> int:
    """Return how many bytes an element takes."""
    kind = types.number_type(dtype)
    return int(types.numpy_type(kind).itemsize * math.prod(getattr(kind, "_shape_", ())))


def _scan(counts: Array, sums: Array, inclusive: bool = True) -> None:
    """Write the sums up to each number, or before it."""
    total = np.cumsum(counts.rows, dtype=counts.rows.dtype)
    sums.rows[...] = total if inclusive else total - counts.rows
