"""The cache of compiled kernels: each build is checked against its digests before it is loaded.

Warp compiles kernels to machine code and loads it unchecked: one flipped bit may crash the process or change the
picture. Each build therefore has a file of digests, which are compared before either backend loads the build; a build
that does not match is compiled again.

Kernels are compiled in this process's work folder, which is checked for free space first, because LLVM ends the process
when the disk is full. The files are then copied into the cache under a lock, the digests last. A reader checks without
the lock first. If the digests are missing or do not match, it checks again with the lock, so that it never mistakes a
build that another process is writing for a damaged one. A process that waits for the lock in vain writes nothing.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import warnings
import zlib
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import ROOM, locked, put, say_unwritable, work_folder

DIGEST = ".checksum"
"""Suffix of the file with two digests: that of a binary, and that of Warp's `.meta` file."""


COMPILING_SECONDS = 120.0
"""Longest wait for another process that compiles the same module."""

EMPTY = "wrt.empty"
"""Name of the module without kernels."""

_collected: list[set[str]] = []


@contextlib.contextmanager
def compiled_modules() -> Iterator[set[str]]:
    """Yield a set to which this process adds the names of the modules that it compiles within the context."""
    _collected.append(names := set[str]())
    try:
        yield names
    finally:
        _collected[:] = [each for each in _collected if each is not names]


class State(Enum):
    """The state of a build in the cache."""

    WHOLE = "as it was made"
    UNKNOWN = "missing, or without a digest"
    DAMAGED = "changed"


def digest(data: bytes) -> bytes:
    """Return a checksum of 16 characters, the same in every version of Python."""
    # Importing hashlib takes longer than reading the cache.
    return b"%08x%08x" % (zlib.crc32(data), len(data) & 0xFFFFFFFF)


def state(binary: Path, meta: Path | None = None) -> State:
    """Check a build and return its state.

    Args:
        binary: the compiled file.
        meta: Warp's `.meta` file, if it is to be checked too.
    """
    found = _state(binary, meta)
    if found is State.WHOLE or not binary.parent.is_dir():
        return found
    with locked(binary.parent.parent) as is_free:
        found = _state(binary, meta)
    # Without the lock it may be half written: a process of low priority can be stopped in the middle for long.
    return found if is_free or found is State.WHOLE else State.UNKNOWN


def _state(binary: Path, meta: Path | None) -> State:
    try:
        said = Path(f"{binary}{DIGEST}").read_bytes().split(b" ")
        found = [digest(path.read_bytes()) for path in (binary, meta) if path is not None]
    except FileNotFoundError:
        return State.UNKNOWN
    except OSError:
        return State.DAMAGED
    return State.WHOLE if len(said) == 2 and said[: len(found)] == found else State.DAMAGED


def seal(binary: Path, meta: Path) -> None:
    """Write the digests of a new build."""
    put(Path(f"{binary}{DIGEST}"), b" ".join(digest(path.read_bytes()) for path in (binary, meta)))


def provide(module: Any, device: str) -> Path:
    """Return the file of an intact build of a module; compile it if it is damaged or missing.

    It is in the cache, or in the work folder of this process if the cache cannot be written to.

    Raises:
        OSError: when there is not enough disk space to compile it.
    """
    build = Build(module, device)
    kept = Path(sys.modules["warp"].config.kernel_cache_dir, build.identifier)
    if state(kept / build.binary, kept / build.meta) is State.WHOLE:
        return kept / build.binary
    with contextlib.suppress(OSError):
        kept.mkdir(exist_ok=True)
    with locked(kept, seconds=COMPILING_SECONDS):
        return _provide(build, kept)


def _provide(build: Build, kept: Path) -> Path:
    """Compile a build and put it into the cache, unless another process has just done so; return its file."""
    import shutil

    found = state(kept / build.binary, kept / build.meta)
    if found is State.WHOLE:
        return kept / build.binary
    if found is State.DAMAGED:
        warnings.warn(f"{kept / build.binary}: the compiled kernel was damaged, and is compiled again", stacklevel=2)
    own = work_folder() / "kernels" / build.identifier
    if state(own / build.binary, own / build.meta) is not State.WHOLE:
        build.compile(own)
    try:
        is_kept = _publish(own, kept, build.binary)
    except OSError as error:
        say_unwritable(kept.parent, error)
        is_kept = False
    if is_kept:
        shutil.rmtree(own, ignore_errors=True)
    return (kept if is_kept else own) / build.binary


class Build:
    """A module of kernels as Warp compiles it for a device."""

    def __init__(self, module: Any, device: str) -> None:
        """Take one of Warp's modules, and the device."""
        context: Any = sys.modules["warp._src.context"]
        self._module, self._device = module, context.runtime.get_device(device)
        self._block = context._resolve_launch_block_dim(
            self._device, None if self._device.is_cpu else module.options["block_dim"]
        )

    @property
    def is_loaded(self) -> bool:
        """True if Warp has loaded the current version."""
        found = self._module.execs.get((self._device.context, self._block))
        return found is not None and bool(found.module_hash == self._module.get_module_hash(self._block))

    def symbols(self) -> dict[Any, str]:
        """Return the names in the binary of the kernels, for the CPU, without duplicates of the same code."""
        self._module.get_module_hash(self._block)
        hashes = self._module.hashers[self._block].kernel_hashes
        return {kernel: f"{kernel.get_mangled_name(kernel_hash=hashes[kernel])}_cpu_forward" for kernel in hashes}

    @property
    def identifier(self) -> str:
        """The name of its folder in the cache."""
        return str(self._module.get_module_identifier(self._block))

    @property
    def binary(self) -> str:
        """The name of the compiled file."""
        return str(self._module._get_compile_output_name(self._device, block_dim=self._block))

    @property
    def meta(self) -> str:
        """The name of Warp's `.meta` file."""
        return str(self._module._get_meta_name(self._block))

    def compile(self, folder: Path) -> None:
        """Compile it into a folder."""
        import shutil

        from wrt.backend.headers import keep_headers, lend_headers

        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            if self._device.is_cpu:
                lend_headers(compile_nothing)
            self.run_compiler(folder)
            seal(folder / self.binary, folder / self.meta)
        except Exception as error:
            room = os.statvfs(folder.parent)
            if room.f_bavail * room.f_frsize < ROOM // 4 and not isinstance(error, OSError):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder.parent)) from error
            raise
        for names in _collected:
            names.add(str(self._module.name))
        if self._device.is_cpu:
            keep_headers()

    def run_compiler(self, folder: Path) -> None:
        """Compile it, and nothing else."""
        # Warp does not repeat a build that failed before, for instance because the disk was full.
        self._module.failed_builds.pop((self._device.context, self._block), None)
        self._module.get_module_hash(self._block)  # it resolves the options as a side effect
        options = self._module.resolved_options[self._block]
        arch = self._module._get_compile_arch(self._device)
        self._module._compile(self._device, folder, self.binary, arch, options=options)

    def load(self, folder: Path) -> None:
        """Have Warp load it from a folder."""
        arch = self._module._get_compile_arch(self._device)
        files = {"binary_path": folder / self.binary, "meta_path": folder / self.meta}
        self._module.load(self._device, self._block, output_arch=arch, **files)


def compile_nothing() -> None:
    """Compile a module without kernels for CPUs, so that Warp precompiles its headers."""
    import shutil

    context: Any = sys.modules["warp._src.context"]
    folder = work_folder() / "kernels" / EMPTY
    Build(context.Module(EMPTY, None), "cpu").run_compiler(folder)
    shutil.rmtree(folder, ignore_errors=True)  # else Warp would not compile it again in another thread


def _publish(own: Path, kept: Path, binary: str) -> bool:
    """Copy a complete build into the cache, where other processes find it; return False if the cache stays locked."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    with locked(kept.parent) as is_free:
        if not is_free:
            return False
        kept.mkdir(exist_ok=True)
        for left in kept.glob(".*"):  # left by a process that was killed here
            with contextlib.suppress(OSError):
                left.unlink()
        seals = f"{binary}{DIGEST}"
        (kept / seals).unlink(missing_ok=True)
        for file in sorted(own.iterdir(), key=lambda file: file.name == seals):
            put(kept / file.name, file.read_bytes())
    return True
