"""The backend that compiles and runs kernels with Warp, on the CPU and on CUDA."""

from __future__ import annotations

import importlib
import os
import sys
import time
import weakref
from functools import cache
from pathlib import Path
from typing import Any

from wrt.backend import cache_folders, kernel_cache
from wrt.backend.cuda.gpus import CudaVersions, Gpu
from wrt.backend.cuda.staging import LARGEST_PINNED, Staging
from wrt.backend.cuda.warp_errors import on_device, plain, ran_out
from wrt.backend.memory import LARGE, forget_code, trim, zeros
from wrt.backend.recording import call_name

LOAD_SECONDS = 0.2
"""A module that takes longer was compiled, which leaves 40 MB in the heap, and 27 MB of the compiler's own code."""

# Lines that Warp writes at every start and that users cannot act on: that there is no GPU or its driver is too old,
# which wrt reports in one line when it matters, and that its next release will drop the oldest Python.
_HELD_BACK = (
    b"Could not find or load the NVIDIA CUDA driver",
    b"Warp UserWarning: \n",
    b"Insufficient CUDA driver version",
    b"The minimum required CUDA driver version",
    b"Visit https://nvidia.github.io/warp",
    b"Support for Python",
)

_NO_SUM = -1.0
"""What stands in place of a sum until it is there."""


class WarpBackend:
    """Runs kernels with Warp. Except for notes, its public methods are the interface of a backend.

    A `dtype` is `int` or `float` (32 bits), the name of a Warp type such as "vec3", "uint16" or "vec8", the `dtype` of
    another array, or a struct from a module of `kernels/`.

    Attributes:
        version: The version of Warp that compiles, or compiled, the kernels.
        builds: The notes that kernels are loaded from; None if Warp compiles them.
        modules: For the notes, the modules of `kernels/` that the host has used.
        calls: For the notes, the results of calls by name.
    """

    def __init__(self) -> None:
        import warp

        self.builds, self.version = None, str(warp.config.version)
        self._wp: Any = warp
        self.modules: set[str] = set()
        self.calls: dict[str, Any] = {}
        # By the names of GPUs, as Warp's devices have no hash.
        self._streams: dict[str, Any] = {}
        self._staging: dict[str, Staging] = {}
        self._staging_beside: weakref.WeakValueDictionary[str, Staging] = weakref.WeakValueDictionary()

    def start(self) -> None:
        """Start the backend; further calls do nothing."""
        initialize_warp()

    def kernels(self, module: str) -> Any:
        """Return a module of `kernels/`, with its kernels, structs and constants, by its full name."""
        self.modules.add(module)
        return importlib.import_module(module)

    def call(self, module: str, function: str, *arguments: Any) -> Any:
        """Call a function of a module of `kernels/` that returns a kernel, a number, a name, or a description."""
        result = getattr(importlib.import_module(module), function)(*arguments)
        self.calls[call_name(module, function, arguments)] = result
        return result

    def array(self, data: Any, dtype: Any, device: str = "cpu", *, copy: bool = True) -> Any:
        """Return an array of NumPy data; on the CPU it shares their memory unless `copy` is set."""
        with on_device(device):
            return self._wp.array(data, dtype=self._type(dtype), device=device, copy=copy)

    def empty(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        """Return an uninitialised array."""
        with on_device(device):
            return self._wp.empty(shape, dtype=self._type(dtype), device=device)

    def zeros(self, shape: Any, dtype: Any = float, device: str = "cpu") -> Any:
        """Return an array of zeros."""
        with on_device(device):
            return self._wp.zeros(shape, dtype=self._type(dtype), device=device)

    def empty_large(self, count: int, dtype: Any = float, device: str = "cpu") -> Any:
        """Return an uninitialised array for large data such as a ray tree.

        On the CPU it asks for huge pages: with small ones, most reads of a tree over millions of triangles also miss
        the TLB (docs/performance.md has the gain).
        """
        wp, kind = self._wp, self._type(dtype)
        if device != "cpu":
            return self.empty(count, kind, device)
        number = {float: wp.float32, int: wp.int32}.get(kind) or getattr(kind, "_wp_scalar_type_", kind)
        rows = zeros((count, *getattr(kind, "_shape_", ())), wp.dtype_to_numpy(number), huge=0)
        return self.array(rows, kind, copy=False)

    def view(self, array: Any, dtype: Any, shape: Any) -> Any:
        """Return the memory of an array as one of another type and shape, which keeps the array alive."""
        seen = self._wp.array(ptr=array.ptr, dtype=self._type(dtype), shape=shape, device=array.device)
        seen._ref = array  # as Warp's own views do
        return seen

    def clone(self, array: Any) -> Any:
        """Return a copy of an array on its device."""
        with on_device(array.device):
            return self._wp.clone(array)

    def copy(self, target: Any, source: Any, dest_offset: int = 0, count: int = 0) -> None:
        """Copy the first `count` elements of an array, by default all, into another."""
        self._wp.copy(target, source, dest_offset=dest_offset, count=count)

    def sums_before(self, counts: Any) -> Any:
        """Return the exclusive prefix sums of an array."""
        sums = self.empty(counts.shape, counts.dtype, str(counts.device))
        self.sum_before(counts, sums)
        return sums

    def sum_before(self, counts: Any, sums_out: Any) -> None:
        """Write the exclusive prefix sums of an array."""
        with on_device(counts.device):
            self._wp.utils.array_scan(counts, sums_out, inclusive=False)

    def total(self, values: Any) -> float:
        """Return the sum of an array of float, none of which is negative."""
        sum_out = self.array([_NO_SUM], float, str(values.device))
        with on_device(values.device):
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

    def fields(self, value: Any) -> dict[str, Any]:
        """Return the fields of a struct by name; nothing for other values."""
        return {name: getattr(value, name) for name in value._cls.vars} if hasattr(value, "_cls") else {}

    def is_loaded(self, kernel: Any, device: str) -> bool:
        """Return whether a kernel can be launched at once."""
        build = kernel_cache.Build.of(kernel.module, device)
        return build is not None and build.is_loaded

    def load(self, kernel: Any, device: str) -> None:
        """Load a kernel's module, and compile it if necessary."""
        start = time.perf_counter()
        kernel_cache.provide(kernel.module, device)
        self._wp.load_module(kernel.module, device=device)
        if time.perf_counter() - start > LOAD_SECONDS:
            trim()
            forget_code(*_libraries())

    def launch(self, kernel: Any, first: int, count: int, inputs: list[Any], device: str) -> None:
        """Run threads `first` to first + count − 1 of a loaded kernel, on this core or a GPU, and wait for them.

        On a GPU they run on Warp's current stream, and nothing else is waited for.
        """
        self.queue(kernel, first, count, inputs, device)
        if device != "cpu":
            self._wp.synchronize_stream(device)

    def fetch(self, array: Any, *, beside: bool = False) -> Any:
        """Return an array as NumPy data, of a CPU its own memory; on a GPU only one stream is waited for.

        That is the current one, which writes the array; or one for copies alone, if the array is complete and other
        threads may launch kernels meanwhile.
        """
        if array.device.is_cpu:
            return array.numpy()
        stream = self._copies(array.device) if beside else array.device.stream
        # Pinning much memory takes longer than copying it once; what is copied beside is a picture after each pass.
        if 0 < array.capacity <= (LARGEST_PINNED if beside else LARGE):
            staging = self.staging_beside(array) if beside else self._staging.setdefault(str(array.device), Staging())
            with on_device(array.device):
                return staging.fetch(self._wp, array, stream)
        copy = self._wp.empty(array.shape, dtype=array.dtype, device="cpu")
        self._wp.copy(copy, array, stream=stream)
        self._wp.synchronize_stream(stream)
        return copy.numpy()

    def staging_beside(self, array: Any) -> Staging:
        """Return the pinned memory through which arrays of this one's GPU are fetched `beside`.

        Who holds it keeps it for the next fetch: it is up to LARGEST_PINNED bytes, which nothing else can use.
        """
        return self._staging_beside.setdefault(str(array.device), Staging())

    def _copies(self, device: Any) -> Any:
        """Return the stream for copies of a GPU."""
        name = str(device)
        if name not in self._streams:
            self._streams[name] = self._wp.Stream(device)
        return self._streams[name]

    def queue(self, kernel: Any, first: int, count: int, inputs: list[Any], device: str) -> None:
        """Launch threads as `launch` does, but on a GPU return at once: later work on its stream finds them done."""
        try:
            self._wp.launch(kernel, dim=count, inputs=[first, *inputs], device=device)
        except RuntimeError as error:  # the stack of a kernel may need memory
            raise plain(error, device) from None

    def gpus(self) -> int:
        """Return the number of GPUs."""
        return int(self._wp.get_cuda_device_count())

    def gpu(self, name: str) -> Gpu:
        """Return what a GPU is."""
        device = self._wp.get_device(name)
        return Gpu(name, str(device.name), int(device.arch), int(device.total_memory), int(device.free_memory))

    def cuda_versions(self) -> CudaVersions:
        """Return the versions of CUDA of Warp and of the driver."""
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
        if dtype == "vec8":
            return self._wp.types.vector(length=8, dtype=self._wp.float32)
        return getattr(self._wp, dtype) if isinstance(dtype, str) else dtype


def initialize_warp() -> None:
    """Start Warp quietly.

    Its native library writes directly to file descriptor 2. The lines of _HELD_BACK are removed, all others pass.
    """
    import tempfile

    import warp as wp

    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    _prepare_folders()
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with tempfile.TemporaryFile() as caught:
            os.dup2(caught.fileno(), 2)
            try:
                wp.init()
            finally:
                os.dup2(kept, 2)
            caught.seek(0)
            for line in caught:
                if not any(text in line for text in _HELD_BACK):
                    os.write(2, line)
    finally:
        os.close(kept)
    _forget_start()


@cache
def _forget_start() -> None:
    """Release 90 MB of code of Warp's libraries, once: the code that runs when they load is spread all over them."""
    forget_code(*_libraries())


@cache
def _prepare_folders() -> None:
    """Choose the folder of compiled kernels, and remove leftovers of killed processes."""
    import warp as wp

    cache_folders.choose_warp_folder()
    version = wp.config.version
    kernels = Path(wp.config.kernel_cache_dir)
    kernels = kernels if kernels.name == version else kernels / version  # Warp adds the version when it starts
    notes = cache_folders.wrt_folder()
    cache_folders.remove_leftovers(kernels, notes, *notes.glob("headers-*"))


def _libraries() -> list[Path]:
    """Return Warp's libraries."""
    import warp as wp

    return [Path(wp.__file__).parent / "bin" / name for name in ("warp.so", "warp-clang.so")]
