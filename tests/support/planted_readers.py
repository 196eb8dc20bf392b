"""Faulty readers, with which tests/files/test_fuzz.py checks that scripts/fuzz.py finds faults."""

from __future__ import annotations

import os
import signal
import time
import warnings
from pathlib import Path

from wrt.errors import InputError, warn


def readers(kind: str) -> list:
    return [read]


def read(path: Path) -> None:
    fault, name = path.read_bytes().decode(), str(path)
    if fault == "raise":
        raise KeyError(fault)
    if fault == "spin":
        while True:
            pass
    if fault == "sleep":
        time.sleep(1e6)
    if fault == "warn":
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    if fault == "fill":
        pages = [os.urandom(1) * 2**24 for _ in range(1000)]
        assert len(pages) == 1000
    if fault == "print":
        os.write(2, b"libfault: something is odd\n")
    if fault == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if fault == "exit":
        os._exit(3)
    if fault == "refuse in two lines":
        error = InputError()
        error.args = (f"{name}: something\nis wrong",)
        raise error
    if fault.startswith("refuse"):
        raise InputError("something is wrong" if "without" in fault else f"{name}: something is wrong")
    if fault == "tell":
        warn(f"{name}: something is left out")
