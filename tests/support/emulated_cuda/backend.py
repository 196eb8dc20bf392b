"""A backend with a GPU that is not there: `device="cuda"` runs kernels as NVRTC compiles them, on the CPU."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator
from typing import Any

import wrt.backend
from support.emulated_cuda.libraries import BLOCK, Library, compiled, ptx_of
from wrt.backend.backend import Backend, Kernel
from wrt.backend.cuda.gpus import CudaVersions
from wrt.backend.memory import memory_left
from wrt.backend.warp_start import initialize_warp

ARCH = 90
"""Hopper."""

GPU = "cuda:0"

RUNS_LONG = "wrt.coat.", "wrt.missing"
"""What names of modules begin with that are always optimised: tables of materials run for half a minute otherwise."""


class EmulatedBackend(Backend):
    """The backend, with one GPU that shares the memory of the CPU; it counts `launches` by names of kernels."""

    def __init__(self, arch: int = ARCH, *, optimization: int = 1) -> None:
        """Make a GPU; modules compile in a third of the time without `optimization`."""
        super().__init__()
        self.launches: dict[str, int] = {}
        self._arch, self._optimization = arch, optimization
        self._libraries: dict[tuple[str, bytes], Library] = {}
        self._lock = threading.RLock()

    def library(self, kernel: Any) -> Library:
        kernel = declared(kernel)
        module = kernel.module
        key = module.name, module.get_module_hash(BLOCK)
        with self._lock:
            if key not in self._libraries:
                level = max(self._optimization, 1) if module.name.startswith(RUNS_LONG) else self._optimization
                binary = compiled(ptx_of(module, self._arch), optimization=level)
                self._libraries[key] = Library(binary)
            return self._libraries[key]

    def run(self, kernel: Any, shape: tuple[int, ...], arguments: list[Any]) -> None:
        from warp._src.context import pack_arg
        from warp._src.types import launch_bounds_t

        declared = kernel.adj.args
        packed = [pack_arg(kernel, a.type, a.label, v, "cpu") for a, v in zip(declared, arguments, strict=True)]
        self.launches[kernel.key] = self.launches.get(kernel.key, 0) + 1
        if count := math.prod(shape):
            self.run_grid(kernel, count, [launch_bounds_t(shape), *packed])

    def run_grid(self, kernel: Any, count: int, packed: list[Any]) -> None:
        self.library(kernel).run(entry_of(kernel), count, packed)

    def is_loaded(self, kernel: Any, device: str) -> bool:
        if device == "cpu":
            return super().is_loaded(kernel, device)
        kernel = declared(kernel)
        return (kernel.module.name, kernel.module.get_module_hash(BLOCK)) in self._libraries

    def load(self, kernel: Any, device: str) -> None:
        if device == "cpu":
            super().load(kernel, device)
        else:
            self.library(declared(kernel))

    def launch(
        self, kernel: Any, first: int, count: int, inputs: list[Any], device: str, *, waits: bool = True
    ) -> None:
        """Run threads `first` to first + count − 1 of a kernel; on the GPU too they are done afterwards."""
        if device == "cpu":
            super().launch(kernel, first, count, inputs, device)
        else:
            self.run(declared(kernel), (count,), [first, *inputs])

    def fetch(self, array: Any, *, beside: bool = False) -> Any:
        """Return an array as NumPy data; what is copied beside is a copy here too, though the memory is the CPU's."""
        numbers = super().fetch(array, beside=beside)
        return numbers.copy() if beside else numbers

    def gpus(self) -> int:
        return 1

    def describe_gpu(self, name: str) -> str:
        return f"Emulated GPU, sm_{self._arch}"

    def cuda_versions(self) -> CudaVersions:
        return CudaVersions((13, 4), (13, 4), (13, 0))

    def architecture_of(self, gpu: str) -> int:
        return self._arch

    def memory_of(self, gpu: str) -> int:
        return memory_left()


def declared(kernel: Any) -> Any:
    """Return Warp's kernel."""
    return kernel.declared() if isinstance(kernel, Kernel) else kernel


def entry_of(kernel: Any) -> str:
    """Return the name of a kernel in PTX."""
    return f"{kernel.get_mangled_name()}_cuda_kernel_forward"


@contextlib.contextmanager
def emulated_cuda(
    arch: int = ARCH, *, optimization: int = 1, counting: EmulatedBackend | None = None
) -> Iterator[EmulatedBackend]:
    """Give this process an `EmulatedBackend`, a new one or `counting`, and Warp a GPU with the CPU's memory."""
    import warp as wp
    from warp._src import context

    initialize_warp()
    backend = counting or EmulatedBackend(arch, optimization=optimization)
    before, real, gpu = wrt.backend._backend, wp.launch, context.runtime.device_map.get(GPU)

    def launch(
        kernel: Any, dim: Any, inputs: Any = (), outputs: Any = (), *, device: Any = None, **options: Any
    ) -> Any:
        if not str(device).startswith("cuda"):
            return real(kernel, dim, inputs, outputs, device=device, **options)
        if options:
            raise NotImplementedError(f"emulated launches take no {', '.join(options)}")
        backend.run(kernel, (dim,) if isinstance(dim, int) else tuple(dim), [*inputs, *outputs])
        return None

    context.runtime.device_map[GPU] = context.runtime.device_map["cpu"]
    wrt.backend._backend, wp.launch = backend, launch
    try:
        yield backend
    finally:
        wrt.backend._backend, wp.launch = before, real
        del context.runtime.device_map[GPU]
        if gpu is not None:
            context.runtime.device_map[GPU] = gpu
