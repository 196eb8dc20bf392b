"""What the digits of a picture depend on besides wrt and Warp: device, processor, libraries."""

from __future__ import annotations

import os
import platform

import numpy as np

from wrt.backend.device import Device
from wrt.backend.processor import processor_flags

VECTOR_SETS = (
    "avx",
    "avx2",
    "fma",
    "fma4",
    "avx512f",
    "avx512cd",
    "avx512dq",
    "avx512bw",
    "avx512vl",
    "avx512_fp16",
) + ("asimd", "sve", "sve2")
"""Instruction sets for which compilers and NumPy have other code, with other rounding."""


def arithmetic_of(device: Device) -> dict[str, str]:
    """Return by name what the digits of a picture depend on; machines that agree in all compute the same bits.

    Processors are told apart by instruction sets, GPUs by their compute capability; NumPy makes the tables for both.
    """
    flags = processor_flags()
    sets = [name for name in VECTOR_SETS if name in flags]
    libc = " ".join(platform.libc_ver()) if os.name == "posix" else platform.system()
    return {
        "device": "cpu" if device.is_cpu else f"cuda {device.backend.architecture_of(device.name)}",
        "processor": " ".join([platform.machine(), *sets]),
        "libraries": f"NumPy {np.__version__}, {libc}",
    }
