"""Compile a Warp module to PTX, that to C++, and that to code for this CPU, with the compilers of Warp."""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from support.emulated_cuda.ptx import NotTranslated, parse
from support.emulated_cuda.translation import to_cpp

BLOCK = 256
"""Threads of a block, Warp's default."""

_serial = itertools.count()


class Library:
    """The kernels of a module, translated, compiled and loaded into this process."""

    def __init__(self, binary: bytes) -> None:
        from warp._src import context

        self._clang, self._handle = context.runtime.llvm, f"emulated_cuda_{next(_serial)}".encode()
        if self._clang.wp_load_obj_from_bytes(binary, len(binary), self._handle, False) != 0:
            raise RuntimeError("Warp cannot load a translated module")

    def run(
        self, kernel: str, count: int, arguments: list[Any], *, block: int = BLOCK, threads: range | None = None
    ) -> None:
        """Run the grid that covers `count` threads, one after another; or warps, where threads wait for one another.

        `threads` are those of the grid that run. If they wait for others that never come, a RuntimeError says so.
        """
        address = self._clang.wp_lookup(self._handle, kernel.replace("$", "_").encode())
        if not address:
            raise NotTranslated(f"no kernel {kernel}")
        blocks = -(-count // block)
        places = (ctypes.c_void_p * len(arguments))(*[ctypes.addressof(argument) for argument in arguments])
        threads = range(blocks * block) if threads is None else threads
        numbers = (ctypes.c_uint64, ctypes.c_uint64, ctypes.c_uint32, ctypes.c_uint32)
        run = ctypes.CFUNCTYPE(None, ctypes.c_void_p, *numbers)
        run(address)(ctypes.addressof(places), threads.start, threads.stop, block, blocks)
        if self._variable(b"stuck").value:
            self._variable(b"stuck").value = 0
            raise RuntimeError(f"{kernel}: threads of a warp wait for others that never come")

    def divide_warps(self, divides: bool) -> None:
        """Choose whether threads with odd and even numbers are never active together, as GPUs may have it."""
        self._variable(b"divided").value = int(divides)

    def _variable(self, name: bytes) -> ctypes.c_uint64:
        return ctypes.c_uint64.from_address(self._clang.wp_lookup(self._handle, name))


def compiled(ptx: str, *, optimization: int = 1) -> bytes:
    """Return PTX as an object file for this CPU; it is kept beside Warp's kernels and found there the next time.

    Raises:
        NotTranslated: if it contains what the emulator does not know.
    """
    from warp._src.build import build_cpu

    cpp = to_cpp(parse(ptx))
    digest = hashlib.sha256(f"{optimization}\n{cpp}".encode()).hexdigest()
    cached = _folder() / f"{digest[:32]}.o"
    if cached.is_file():
        return cached.read_bytes()
    with tempfile.TemporaryDirectory(dir=cached.parent) as folder:
        source, binary = Path(folder) / "module.cpp", Path(folder) / "module.o"
        source.write_text(cpp, encoding="utf-8")
        # PTX says where operations are fused; nothing else may be.
        build_cpu(str(binary), str(source), fuse_fp=False, optimization_level=optimization, extra_flags="-w")
        data = binary.read_bytes()
        os.replace(binary, cached)
    return data


def ptx_of(module: Any, arch: int) -> str:
    """Return a Warp module as NVRTC compiles it for an architecture such as 90; kept like `compiled`."""
    import warp as wp

    cached = _folder() / f"{module.name[:80]}-{module.get_module_hash(BLOCK).hex()}-{arch}.ptx"
    if not cached.is_file():
        with tempfile.TemporaryDirectory(dir=cached.parent) as folder:
            built = wp.compile_aot_module(module, arch=arch, use_ptx=True, module_dir=Path(folder))
            os.replace(built[0], cached)
    return cached.read_text(encoding="latin-1")


@cache
def _folder() -> Path:
    import warp as wp

    folder = Path(wp.config.kernel_cache_dir) / "emulated-cuda"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
