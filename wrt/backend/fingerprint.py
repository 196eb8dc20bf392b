"""Digests of everything that compiled kernels and the table of artefacts depend on, without importing Warp."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

TESTED = ("1.19.0",)
"""Versions of Warp whose memory layout wrt was tested against; with others, Warp is always imported."""


def folder_of(package: str) -> Path:
    """Return the folder of a package's sources, without importing it.

    Raises:
        FileNotFoundError: if there is no such package.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(package)
    return Path(spec.origin).parent


def version_of(warp: Path) -> str:
    """Return the version of Warp in a folder, without importing it."""
    for line in (warp / "config.py").read_text(encoding="utf-8").splitlines():
        if line.startswith("version"):
            return line.partition("=")[2].strip().strip("\"'")
    return ""


def digest_of_code(version: str) -> str:
    """Return a digest of what compiled kernels are made of: the code, in whatever folder, and the version of Warp."""
    things: list[object] = [version]
    for package in ("wrt.kernels", "wrt.spmd", "wrt.backend"):
        folder = folder_of(package)
        for root, folders, files in os.walk(folder):
            folders.sort()
            for name in sorted(files):
                if name.endswith((".py", ".h")):
                    with open(os.path.join(root, name), "rb") as file:
                        things += [os.path.relpath(root, folder), name, file.read()]
    return _digest(things)


def fingerprint(warp: Path, code: str) -> str:
    """Return a digest of all that the table of artefacts depends on: code, Warp, processor, Python, environment.

    Args:
        warp: Warp's folder.
        code: see `digest_of_code`.
    """
    things: list[object] = [code, sys.version]
    things += sorted((k, v) for k, v in os.environ.items() if k.startswith("WARP_"))
    return _digest([*things, *_warp_and_processor(warp)])


def digest_of_warp(warp: Path) -> str:
    """Return a digest of Warp, its headers, and the processor."""
    headers = [(path.name, path.stat()) for path in sorted((warp / "native").rglob("*.h"))]
    return _digest([*_warp_and_processor(warp), *((name, at.st_size, at.st_mtime_ns) for name, at in headers)])


def _warp_and_processor(warp: Path) -> list[object]:
    things: list[object] = [str(warp), (warp / "config.py").read_bytes()]
    for name in ("warp.so", "warp-clang.so"):
        found = (warp / "bin" / name).stat()
        things += [name, found.st_size, found.st_mtime_ns]
    processor = Path("/proc/cpuinfo").read_bytes().partition(b"\n\n")[0]
    kind = (b"vendor", b"cpu family", b"model", b"flags")
    return things + [line for line in processor.splitlines() if line.startswith(kind)]


def _digest(things: list[object]) -> str:
    # The hash by which Python detects changed sources: importing hashlib takes longer than all of this.
    return importlib.util.source_hash(repr(things).encode("utf-8", "surrogateescape")).hex()
