"""The GPUs of this machine, and the reasons why one cannot be used."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from wrt.errors import InputError

if TYPE_CHECKING:
    from wrt.backend.backend import Backend

Version = tuple[int, int]


class CudaVersions(NamedTuple):
    """Versions of CUDA.

    Attributes:
        toolkit: the version that compiles kernels.
        driver: the highest that the installed driver supports; None if no driver was found.
        required: the lowest that a driver must support.
    """

    toolkit: Version
    driver: Version | None
    required: Version

    @property
    def problem(self) -> str:
        """Why the driver lets no GPU be used, and what to do; empty if it is no obstacle."""
        if self.driver is None:
            return "no NVIDIA driver was found; use cpu"
        if self.driver < self.required:
            has, needs = dotted(self.driver), dotted(self.required)
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
        gpus = "is only cuda:0" if count == 1 else f"are only cuda:0 to cuda:{count - 1}"
        raise InputError(f"device {device!r}: there {gpus}")
