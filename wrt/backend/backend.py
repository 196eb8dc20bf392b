"""Run kernels on the CPU and on GPUs; Warp compiles them.

Kernels, structs and constants of `kernels/` come from the table of artefacts. If one is missing, Warp is imported and
provides it, and it is added. On the CPU arrays are wrt's own, and compiled kernels are called without Warp. On GPUs
arrays are Warp's, and Warp launches.
"""

from __future__ import annotations

import ctypes
import importlib
import sys
import threading
import time
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from wrt.backend import arrays
from wrt.backend.arrays import Array, Layout, Struct, attribute_of
from wrt.backend.artefacts import Artefacts
from wrt.backend.cache_folders import remove_leftovers
from wrt.backend.cuda.gpus import CudaVersions
from wrt.backend.cuda.staging import LARGEST_PINNED, Staging
from wrt.backend.cuda.warp_errors import on_device, plain, ran_out
from wrt.backend.describe import COOPERATIVE, call_name, describe, describe_arguments
from wrt.backend.kernel_cache import Build
from wrt.backend.memory import LARGE, trim
from wrt.backend.user_code import naming_faults
from wrt.backend.warp_start import initialize_warp

LOAD_SECONDS = 0.2
"""A module that takes longer was compiled, which leaves 40 MB in the heap."""

FLAGS = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
    " -mllvm=-slp-recursion-max-depth=4"
)
"""Warp's own flags for compiling for the CPU."""

_NO_SUM = -1.0
"""A result that no sum has, to see whether Warp has written one."""

_DESCRIBING = threading.RLock()
"""Held while Warp's structs are described."""


class Bounds(ctypes.Structure):
    """The number of threads of a launch (`launch_bounds_t<1>` in Warp's builtin.h)."""

    _fields_ = (("shape", ctypes.c_uint32), ("size", ctypes.c_size_t), ("multiple", ctypes.c_size_t))


class Kernel:
    """A kernel of `kernels/`, whether or not Warp is imported.

    Attributes:
        module: The name of Warp's module.
        key: The qualified name of its Python function.
        function: The compiled function for the CPU; None until it is loaded.
        arguments: The layout of its arguments; None until it is loaded.
    """

    def __init__(self, module: str, key: str, declare: Callable[[], Any]) -> None:
        """Describe a kernel; `declare` returns Warp's."""
        self.module, self.key = module, key
        self.function: Any = None
        self.arguments: Layout | None = None
        self._declare = declare

    def declared(self) -> Any:
        """Return Warp's kernel."""
        return self._declare()


class KernelModule:
    """The constants, structs and kernels of a module of `kernels/`."""

    def __init__(self, attribute: Callable[[str], Any]) -> None:
        """Take the function that returns an attribute by name."""
        self._attribute = attribute

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        value = self._attribute(name)
        setattr(self, name, value)
        return value


class Backend:
    """Arrays, structs and kernels of the CPU and of GPUs.

    A `dtype` is `int` or `float` (32 bits), the name of a type such as "vec3", "uint16" or "vec8", the `dtype` of
    another array, or a struct from a module of `kernels/`.

    Attributes:
        artefacts: What is compiled.
        flags: Warp's flags for compiling for the CPU: what is compiled with others is not for other processes.
    """

    def __init__(self) -> None:
        """Read what is compiled."""
        self.flags = FLAGS
        self.artefacts = Artefacts()
        self._modules: dict[str, KernelModule] = {}
        self._structs: dict[str, Layout] = {}
        self._kernels: weakref.WeakKeyDictionary[Any, Kernel] = weakref.WeakKeyDictionary()
        # By the names of GPUs, as Warp's devices have no hash.
        self._streams: dict[str, Any] = {}
        self._staging: dict[tuple[str, bool], Staging] = {}

    @property
    def version(self) -> str:
        """The version of Warp."""
        return self.artefacts.warp_version

    @property
    def _wp(self) -> Any:
        """Warp, which this imports and starts."""
        import warp

        initialize_warp()
        return warp

    # --- Modules of kernels -----------------------------------------------------------------------------------------

    def kernels(self, module: str) -> Any:
        """Return a module of `kernels/`, with its kernels, structs and constants, by its full name."""
        if module not in self._modules:
            self._modules[module] = KernelModule(lambda name: self._attribute(module, name))
        return self._modules[module]

    def _attribute(self, module: str, name: str) -> Any:
        key = f"{module}.{name}"
        if self.artefacts.get("values", key) is None:
            _ = self._wp
            for each, value in vars(importlib.import_module(module)).items():
                if not each.startswith("_") and (entry := self._describe(value)) is not None:
                    self.artefacts.add("values", f"{module}.{each}", entry)
        if (entry := self.artefacts.get("values", key)) is None:
            raise AttributeError(f"{module} has no constant, struct or kernel {name}")
        return self._value(entry, partial(attribute_of, module, name))

    def call(self, module: str, function: str, *arguments: Any) -> Any:
        """Call a function of a module of `kernels/` that returns a kernel, a number, a name, or a description."""
        name = call_name(module, function, arguments)
        registry = sys.modules.get("wrt.kernels.core.registry")
        is_shared = registry is None or not registry.names_user_model(name)
        entry = self.artefacts.get("values", name) if is_shared else None
        if entry is None:
            _ = self._wp
            value = attribute_of(module, function)(*arguments)
            entry = self._describe(value)
            if entry is None:
                return value
            if is_shared:
                self.artefacts.add("values", name, entry)
            elif "kernel" in entry:
                return self.kernel_of(value)
        return self._value(entry, lambda: attribute_of(module, function)(*arguments))

    def _describe(self, value: Any) -> dict[str, Any] | None:
        with _DESCRIBING:
            return describe(value, self._add_struct)

    def _add_struct(self, name: str, entry: list[Any]) -> None:
        self.artefacts.add("structs", name, entry)

    def _value(self, entry: dict[str, Any], declare: Callable[[], Any]) -> Any:
        """Return what an entry of the table describes; `declare` returns it from Warp."""
        ((kind, value),) = entry.items()
        if kind == "kernel":
            module, key = value
            return Kernel(module, key, declare)
        if kind == "struct":
            return self.struct(value)
        if kind == "fields":
            return SimpleNamespace(**value)
        return tuple(value) if isinstance(value, list) else value

    def struct(self, name: str) -> Layout:
        """Return a struct by its name in the table."""
        if name not in self._structs:
            size, fields = self.artefacts.get("structs", name)
            self._structs[name] = Layout(name, size, fields, self.struct)
        return self._structs[name]

    def kernel_of(self, kernel: Any) -> Kernel:
        """Return a kernel of Warp's, which a user or a test has declared, as one of this backend's."""
        if isinstance(kernel, Kernel):
            return kernel
        if kernel not in self._kernels:
            declared = weakref.ref(kernel)
            self._kernels[kernel] = Kernel(kernel.module.name, "", declared)
        return self._kernels[kernel]

    # --- Compiling and launching ------------------------------------------------------------------------------------

    def is_loaded(self, kernel: Any, device: str) -> bool:
        """Return whether a kernel can be launched at once."""
        kernel = self.kernel_of(kernel)
        if device == "cpu" and self.artefacts.can_launch:
            return kernel.function is not None
        return Build(kernel.declared().module, device).is_loaded

    def load(self, kernel: Any, device: str) -> None:
        """Load a kernel's module, and compile it if necessary."""
        kernel, start = self.kernel_of(kernel), time.perf_counter()
        if device != "cpu" or not self.artefacts.can_launch:
            with naming_faults():
                build = Build(kernel.declared().module, device)
                if not build.is_loaded:
                    build.load()
        elif (found := self.artefacts.kernel(kernel.module, kernel.key)) is not None:
            kernel.function, (size, fields) = found
            kernel.arguments = Layout("", size, fields, self.struct)
            return
        else:
            self._compile(kernel)
        if time.perf_counter() - start > LOAD_SECONDS:
            trim()

    def _compile(self, kernel: Kernel) -> None:
        """Compile a kernel's module for the CPU, load it, and add it to the table."""
        wp, declared = self._wp, kernel.declared()
        build = Build(declared.module, "cpu")
        with naming_faults():
            file, _ = build.files_in(build.provide())
        symbols = build.symbols()
        with _DESCRIBING:
            entries = {
                each.func.__qualname__: [symbol, *describe_arguments(each, self._add_struct)]
                for each, symbol in symbols.items()
                if each.adj.kernel_dim == 1
            }
            size, fields = describe_arguments(declared, self._add_struct)
        function = self.artefacts.load(file, symbols[declared])
        if function is None:
            raise RuntimeError(f"{file}: the compiled kernel cannot be loaded")
        kernel.function, kernel.arguments = function, Layout("", size, fields, self.struct)
        # Left out: kernels of one name, or with more than one dimension of threads, and those of users.
        if len(entries) == len(symbols) and kernel.module.startswith("wrt.") and kernel.key:
            self.add_file(kernel.module, file, entries, wp.config.cpu_compiler_flags)

    def add_file(self, module: str, file: Path, kernels: dict[str, Any], flags: str) -> None:
        """Add a module, compiled with these flags, to the table; `kernels` are symbols and layouts of arguments."""
        binary = file.read_bytes()
        if flags == self.flags and COOPERATIVE not in binary:
            entry = {"file": str(file), "bytes": len(binary), "kernels": kernels}
            self.artefacts.add("files", module, entry)

    def launch(
        self, kernel: Any, first: int, count: int, inputs: list[Any], device: str, *, waits: bool = True
    ) -> None:
        """Run threads `first` to first + count − 1 of a loaded kernel, on this core or a GPU, and wait for them.

        On a GPU they run on Warp's current stream, and nothing else is waited for. With `waits` unset it returns at
        once; later work on the stream finds them done.
        """
        kernel = self.kernel_of(kernel)
        if device == "cpu" and self.artefacts.can_launch:
            _call(kernel, count, [first, *inputs])
            return
        try:
            self._wp.launch(kernel.declared(), dim=count, inputs=[first, *map(_for_warp, inputs)], device=device)
        except RuntimeError as error:  # the stack of a kernel may need memory
            raise plain(error, device) from None
        if waits and device != "cpu":
            self._wp.synchronize_stream(device)

    def finish(self) -> None:
        """After the last render, keep what was compiled for later processes, and remove what killed ones left."""
        self.artefacts.save()
        if "warp" not in sys.modules:  # which removes them when it starts
            remove_leftovers()

    # --- Arrays -----------------------------------------------------------------------------------------------------

    def array(self, data: Any, dtype: Any, device: str = "cpu", *, copy: bool = True) -> Any:
        """Return an array of NumPy data or structs; on the CPU it shares their memory unless `copy` is set."""
        if device == "cpu":
            return arrays.from_numpy(data, dtype, copy=copy)
        if isinstance(dtype, Layout):
            rows = arrays.from_numpy(data, dtype, copy=False).rows
            data = np.frombuffer(rows.tobytes(), dtype.warp_struct().numpy_dtype())
        with on_device(device):
            return self._wp.array(data, dtype=self._type(dtype), device=device, copy=copy)

    def empty(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        """Return an uninitialised array."""
        if device == "cpu":
            return arrays.empty(shape, dtype)
        with on_device(device):
            return self._wp.empty(shape, dtype=self._type(dtype), device=device)

    def zeros(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        """Return an array of zeros."""
        if device == "cpu":
            array = arrays.empty(shape, dtype)
            if array.rows.nbytes < LARGE:
                array.zero_()
            return array
        with on_device(device):
            return self._wp.zeros(shape, dtype=self._type(dtype), device=device)

    def view(self, array: Any, dtype: Any, shape: Any) -> Any:
        """Return the memory of an array as one of another type and shape, which keeps the array alive."""
        if isinstance(array, Array):
            return arrays.view(array, dtype, shape)
        view = self._wp.array(ptr=array.ptr, dtype=self._type(dtype), shape=shape, device=array.device)
        view._ref = array  # as Warp's own views do
        return view

    def to_warp(self, array: Any, dtype: str) -> Any:
        """Return an array as Warp's, of the type with this name, which shares its memory."""
        if not isinstance(array, Array):
            return array
        return self._wp.array(array.rows, dtype=self._type(dtype), shape=array.shape, device="cpu", copy=False)

    def from_warp(self, array: Any, dtype: Any) -> Any:
        """Return an array of Warp, which is contiguous, as one of this backend's, which shares its memory."""
        return self.array(array.numpy(), dtype, copy=False) if array.device.is_cpu else array

    def clone(self, array: Any) -> Any:
        """Return a copy of an array on its device."""
        if isinstance(array, Array):
            copied = arrays.empty(array.shape, array.dtype)
            copied.fill_(array.rows)
            return copied
        with on_device(array.device):
            return self._wp.clone(array)

    def copy(self, target: Any, source: Any, dest_offset: int = 0, count: int = 0) -> None:
        """Copy the first `count` elements of an array, by default all, into another."""
        if isinstance(target, Array):
            count = count or len(source)
            target.rows[dest_offset : dest_offset + count] = source.rows[:count]
        else:
            self._wp.copy(target, source, dest_offset=dest_offset, count=count)

    def sums_before(self, counts: Any) -> Any:
        """Return the exclusive prefix sums of an array."""
        sums = self.clone(counts)
        self.sum_before(counts, sums)
        return sums

    def sum_before(self, counts: Any, sums_out: Any) -> None:
        """Write the exclusive prefix sums of an array."""
        if isinstance(counts, Array):
            sums_out.fill_(np.cumsum(counts.rows, dtype=counts.rows.dtype) - counts.rows)
            return
        with on_device(counts.device):
            self._wp.utils.array_scan(counts, sums_out, inclusive=False)

    def total(self, values: Any) -> float:
        """Return the sum of an array of floats that are not negative."""
        if isinstance(values, Array):
            return float(values.rows.sum(dtype=np.float64))
        with on_device(values.device):
            sum_out = self._wp.array([_NO_SUM], dtype=float, device=values.device)
            self._wp.utils.array_sum(values, out=sum_out)
        total = float(self.fetch(sum_out)[0])
        if total == _NO_SUM:
            raise ran_out(values.device)
        return total

    def sort_pairs(self, keys: Any, values: Any, count: int) -> None:
        """Sort the first `count` keys and their values; both arrays have room for twice as many.

        Where a GPU lacks memory for that, nothing is sorted, and Warp does not say so: look at the keys, and raise
        `warp_errors.ran_out` unless they ascend.
        """
        with on_device(keys.device):
            self._wp.utils.radix_sort_pairs(keys, values, count)

    def fetch(self, array: Any, *, beside: bool = False) -> Any:
        """Return an array as NumPy data, of a CPU its own memory; on a GPU only one stream is waited for.

        That is the current one, which writes the array; or, with `beside` set, one for copies alone: the array must be
        complete, and other threads may launch kernels at the same time.
        """
        if isinstance(array, Array) or array.device.is_cpu:
            return array.numpy()
        name = str(array.device)
        if beside and name not in self._streams:
            self._streams[name] = self._wp.Stream(array.device)
        stream = self._streams[name] if beside else array.device.stream
        # Pinning much memory takes longer than copying it once; what is copied beside is a picture after each pass.
        if 0 < array.capacity <= (LARGEST_PINNED if beside else LARGE):
            staging = self._staging.setdefault((name, beside), Staging())
            with on_device(array.device):
                return staging.fetch(self._wp, array, stream)
        copy = self._wp.empty(array.shape, dtype=array.dtype, device="cpu")
        self._wp.copy(copy, array, stream=stream)
        self._wp.synchronize_stream(stream)
        return copy.numpy()

    # --- GPUs ---------------------------------------------------------------------------------------------------------

    def gpus(self) -> int:
        """Return the number of GPUs."""
        return int(self._wp.get_cuda_device_count())

    def describe_gpu(self, name: str) -> str:
        """Return the model, the architecture and the memory of a GPU in words."""
        gpu = self._wp.get_device(name)
        memory = f"{gpu.total_memory / 1e9:.1f} GB of memory, {gpu.free_memory / 1e9:.1f} GB free"
        return f"{gpu.name}, sm_{gpu.arch}, {memory}"

    def cuda_versions(self) -> CudaVersions:
        """Return the versions of CUDA of Warp and of the driver."""
        _ = self._wp
        from warp._src.context import runtime

        toolkit = runtime.toolkit_version or (0, 0)
        return CudaVersions(toolkit, runtime.driver_version, runtime.min_driver_version or toolkit)

    def architecture_of(self, gpu: str) -> int:
        """Return the compute capability of a GPU, such as 90."""
        return int(self._wp.get_device(gpu).arch)

    def memory_of(self, gpu: str) -> int:
        """Return the bytes of memory of a GPU that are free."""
        self._wp.synchronize_device(gpu)  # until then the pool keeps what was released
        return int(self._wp.get_device(gpu).free_memory)

    def _type(self, dtype: Any) -> Any:
        """Return Warp's type."""
        if isinstance(dtype, Layout):
            return dtype.warp_struct()
        if dtype == "vec8":
            return self._wp.types.vector(length=8, dtype=self._wp.float32)
        return getattr(self._wp, dtype) if isinstance(dtype, str) else dtype


def _call(kernel: Kernel, count: int, values: list[Any]) -> None:
    """Run the first `count` threads of a loaded kernel on this core."""
    assert kernel.arguments is not None
    layout = kernel.arguments.numpy
    arguments = np.zeros(layout.itemsize, np.uint8)
    for name, value in zip(kernel.arguments.kinds, values, strict=True):
        # Only bytes: NumPy copies a struct field by field, and half a millisecond a launch is 5 % of a short pass.
        kind, offset, *_ = layout.fields[name]
        if isinstance(value, Struct):
            of_value = value._bytes
        else:
            # Not as the kind itself: of a vector NumPy would make one for each of its numbers.
            of_value = arrays.bytes_of(np.asarray(arrays.packed(value, kind), kind.base))
        arguments[offset : offset + len(of_value)] = of_value
    kernel.function(ctypes.byref(Bounds(count, count, 1)), arguments.__array_interface__["data"][0])


def _for_warp(value: Any) -> Any:
    """Return an argument as Warp's launches take it."""
    if not isinstance(value, Array):
        return value
    from warp._src.types import array_t

    return array_t.from_buffer_copy(arrays.packed(value, arrays.HEADER).tobytes())
