"""The processor's features: how many lanes the wide kernel has there, and which digits it computes."""

from __future__ import annotations

import contextlib
import os
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wrt.backend.device import Device

SWITCH = "WRT_WIDE"
"""Environment variable: 0 leaves only the scalar kernel; 4, 8 or 16 sets the number of lanes."""

NEEDED = {16: frozenset(("avx512f", "avx512bw", "avx512dq", "avx512vl", "bmi2")), 8: frozenset(("avx2", "fma", "bmi2"))}
"""Processor features by number of lanes, most lanes first: registers of as many numbers, and masks for them."""

WIDTHS = (4, 8, 16)
"""Numbers of lanes for which there is a wide kernel; clang splits vectors that are too wide for the processor."""

VECTOR_SETS = (
    *("avx", "avx2", "fma", "fma4", "avx512f", "avx512cd", "avx512dq", "avx512bw", "avx512vl", "avx512_fp16"),
    *("asimd", "sve", "sve2"),
)
"""Instruction sets for which compilers and NumPy have other code, with other rounding."""


def processor_flags() -> frozenset[str]:
    """Return the processor's feature flags, or none if they are unknown."""
    # Stop at the first core: there may be hundreds.
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        for line in file:
            if line.startswith(("flags", "Features")):
                return frozenset(line.partition(":")[2].split())
    return frozenset()


def lanes_here() -> int:
    """Return the lanes of the wide kernel on this machine: as many as fill a register; 0 if there is no wide kernel."""
    setting = os.environ.get(SWITCH, "")
    if setting == "0" or setting in map(str, WIDTHS):
        return int(setting)
    if setting:
        allowed = ", ".join(map(str, WIDTHS))
        warnings.warn(f"{SWITCH}={setting} is ignored: it may be 0, {allowed} or empty", stacklevel=2)
    return lanes_of(processor_flags())


def lanes_of(flags: frozenset[str]) -> int:
    """Return the lanes of the wide kernel on processors with these features, or 0."""
    return next((lanes for lanes, required in NEEDED.items() if flags >= required), 0)


def arithmetic_of(device: Device) -> dict[str, str]:
    """Return by name what the digits of a picture depend on besides wrt and Warp.

    Machines that agree in all compute the same bits. CPUs differ by instruction set, GPUs by compute capability; NumPy
    makes the tables for both.
    """
    import platform

    import numpy as np

    flags = processor_flags()
    sets = [name for name in VECTOR_SETS if name in flags]
    libc = " ".join(platform.libc_ver()) if os.name == "posix" else platform.system()
    return {
        "device": "cpu" if device.is_cpu else f"cuda {device.backend.architecture_of(device.name)}",
        "processor": " ".join([platform.machine(), *sets]),
        "libraries": f"NumPy {np.__version__}, {libc}",
    }
