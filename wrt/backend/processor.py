"""The processor's features."""

from __future__ import annotations

import contextlib


def processor_flags() -> frozenset[str]:
    """Return the processor's feature flags, or none if they are unknown."""
    # Stop at the first core: there may be hundreds.
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        for line in file:
            if line.startswith(("flags", "Features")):
                return frozenset(line.partition(":")[2].split())
    return frozenset()
