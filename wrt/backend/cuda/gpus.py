"""The GPUs of this machine, and the reasons why one cannot be used."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.backend.backend import Backend

Version = tuple[int, int]


class Gpu(NamedTuple):
    """A GPU.

    Attributes:
        device: its name for `device=`, "cuda:N".
        model: its name by its maker.
        architecture: its compute capability, such as 90.
        memory: its bytes of memory.
        free: those of them that are free.
    """

    device: str
    model: str
    architecture: int
    memory: int
    free: int

    @property
    def description(self) -> str:
        """Its model, architecture and memory in words."""
        memory = f"{self.memory / 1e9:.1f} GB of memory, {self.free / 1e9:.1f} GB free"
        return f"{self.model}, sm_{self.architecture}, {memory}"


class CudaVersions(NamedTuple):
    """Versions of CUDA.

    Attributes:
        toolkit: that which compiles kernels.
        driver: the highest that the installed driver supports; None if no driver was found.
        needed: the lowest that a driver must support.
    """

    toolkit: Version
    driver: Version | None
    needed: Version

    @property
    def problem(self) -> str:
        """Why no GPU can be used, whatever there are, and what to do; empty if the driver is no obstacle."""
        if self.driver is None:
            return "no NVIDIA driver was found; use cpu"
        if self.driver < self.needed:
            has, needs = dotted(self.driver), dotted(self.needed)
            return f"the NVIDIA driver is too old, for CUDA {has} instead of {needs}; update it, or use cpu"
        return ""


def dotted(version: Version) -> str:
    """Return a version as it is written."""
    return ".".join(map(str, version))


def require_gpus(backend: Backend, device: str, numbers: Iterable[int]) -> None:
    """Raise InputError, which names `device`, unless the GPUs with these numbers can be used."""
    count = backend.gpus()
    if count == 0:
        problem = backend.cuda_versions().problem or "no CUDA GPU was found; use cpu"
        raise InputError(f"device {device!r}: {problem}")
    if max(numbers, default=0) >= count:
        there = "cuda:0" if count == 1 else f"cuda:0 to cuda:{count - 1}"
        raise InputError(f"device {device!r}: there {'is' if count == 1 else 'are'} only {there}")
