"""Start Warp quietly, with wrt's folders."""

from __future__ import annotations

import os
import sys
import threading
from functools import cache
from pathlib import Path

from wrt.backend.cache_folders import choose_warp_folder, remove_leftovers, wrt_folder

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

_STARTING = threading.Lock()


def initialize_warp() -> None:
    """Start Warp quietly, once."""
    with _STARTING:
        _initialize()


@cache
def _initialize() -> None:
    """Start Warp, whose native library writes directly to file descriptor 2; the lines of _HELD_BACK are removed."""
    import tempfile

    import warp as wp

    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    choose_warp_folder()
    sys.stderr.flush()
    stderr = os.dup(2)
    try:
        with tempfile.TemporaryFile() as caught:
            os.dup2(caught.fileno(), 2)
            try:
                wp.init()
            finally:
                os.dup2(stderr, 2)
            caught.seek(0)
            for line in caught:
                if not any(text in line for text in _HELD_BACK):
                    os.write(2, line)
    finally:
        os.close(stderr)
    kernels, folder = Path(wp.config.kernel_cache_dir), wrt_folder()
    remove_leftovers(kernels, folder, *folder.glob("headers-*"))
