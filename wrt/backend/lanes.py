"""How many lanes the wide kernel has on this machine: as many as fill a register of the processor."""

from __future__ import annotations

import os
import warnings

from wrt.backend.processor import processor_flags

SWITCH = "WRT_WIDE"
"""Environment variable: 0 leaves only the scalar kernel; 4, 8 or 16 sets the number of lanes."""

NEEDED = {16: frozenset(("avx512f", "avx512bw", "avx512dq", "avx512vl", "bmi2")), 8: frozenset(("avx2", "fma", "bmi2"))}
"""Processor features by number of lanes, most lanes first: registers of so many numbers, and masks for them."""

WIDTHS = (4, 8, 16)
"""Numbers of lanes for which there is a wide kernel; clang splits vectors that are too wide for the processor."""


def lanes_here() -> int:
    """Return the lanes of the wide kernel on this machine, or 0 if it has only the scalar one."""
    told = os.environ.get(SWITCH, "")
    if told == "0" or told in map(str, WIDTHS):
        return int(told)
    if told:
        warnings.warn(f"{SWITCH}={told} is ignored: it may be 0, {', '.join(map(str, WIDTHS))} or empty", stacklevel=2)
    return lanes_of(processor_flags())


def lanes_of(flags: frozenset[str]) -> int:
    """Return the lanes of the wide kernel on processors with these features, or 0."""
    return next((lanes for lanes, needed in NEEDED.items() if flags >= needed), 0)
