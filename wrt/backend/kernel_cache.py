"""The cache of compiled kernels: each build is checked against its digests before it is loaded.

Warp compiles kernels to machine code and loads it unchecked: one flipped bit may crash the process or change the
picture. Each build therefore has a file of digests, which are compared before the build is loaded; a build that does
not match is compiled again.

Kernels are compiled in this process's work folder, which is checked for free space first, because LLVM ends the process
when the disk is full. The files are then copied into the cache: the old digests are removed first, and the new ones
come last, so that a reader finds no digests while another process writes. One process at a time compiles a module; one
that does not get the lock in time keeps its build to itself.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import sys
import warnings
from enum import Enum
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import ROOM, digest, locked, put, say_unwritable, work_folder

DIGEST = ".checksum"
"""Suffix of the file with two digests: the binary's, and that of Warp's `.meta` file."""

COMPILING_SECONDS = 120.0
"""Longest wait for another process that compiles the same module."""

COMPILED: list[str] = []
"""The modules that this process has compiled, in order."""


class State(Enum):
    """The state of a build in the cache."""

    WHOLE = "as it was made"
    UNKNOWN = "missing, or without a digest"
    DAMAGED = "changed"


def state(binary: Path, meta: Path | None = None) -> State:
    """Check a build and return its state.

    Args:
        binary: the compiled file.
        meta: Warp's `.meta` file, if it is to be checked too.
    """
    try:
        expected = Path(f"{binary}{DIGEST}").read_bytes().split(b" ")
        found = [digest(path.read_bytes()) for path in (binary, meta) if path is not None]
    except (FileNotFoundError, NotADirectoryError):
        return State.UNKNOWN
    except OSError:
        return State.DAMAGED
    return State.WHOLE if len(expected) == 2 and expected[: len(found)] == found else State.DAMAGED


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
    def name(self) -> str:
        """The name of the module."""
        return str(self._module.name)

    @property
    def identifier(self) -> str:
        """The name of its folder in the cache, which contains Warp's digest of its code."""
        return str(self._module.get_module_identifier(self._block))

    def files_in(self, folder: Path) -> tuple[Path, Path]:
        """Return the compiled file and Warp's `.meta` file in a folder."""
        binary = self._module._get_compile_output_name(self._device, block_dim=self._block)
        return folder / str(binary), folder / str(self._module._get_meta_name(self._block))

    def provide(self) -> Path:
        """Return the folder of an intact build; compile it if it is damaged or missing.

        It is in the cache, or in the work folder of this process if the cache cannot be written to.

        Raises:
            OSError: when there is not enough disk space to compile it.
        """
        identifier = self.identifier
        cached = Path(sys.modules["warp"].config.kernel_cache_dir, identifier)
        if state(*self.files_in(cached)) is State.WHOLE:
            return cached
        with contextlib.suppress(OSError):
            cached.mkdir(exist_ok=True)
        with locked(cached, seconds=COMPILING_SECONDS) as is_free:
            found = state(*self.files_in(cached))
            if found is State.WHOLE:  # another process has just compiled it
                return cached
            if found is State.DAMAGED and is_free:
                binary, _ = self.files_in(cached)
                warnings.warn(f"{binary}: the compiled kernel was damaged, and is compiled again", stacklevel=2)
            private = work_folder() / "kernels" / identifier
            if state(*self.files_in(private)) is not State.WHOLE:
                self._compile(private)
            try:
                if is_free:
                    publish(private, cached)
                    return cached
            except OSError as error:
                say_unwritable(cached.parent, error)
            return private

    def _compile(self, folder: Path) -> None:
        """Compile it into a folder."""
        from wrt.backend.headers import share_headers

        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            if self._device.is_cpu:
                share_headers(compile_nothing)
            self.run_compiler(folder)
            digests = b" ".join(digest(path.read_bytes()) for path in self.files_in(folder))
            put(Path(f"{self.files_in(folder)[0]}{DIGEST}"), digests)
        except Exception as error:
            room = os.statvfs(folder.parent)
            if room.f_bavail * room.f_frsize < ROOM // 4 and not isinstance(error, OSError):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder.parent)) from error
            if type(error) is Exception:  # clang rejects the code
                raise RuntimeError(f"{self.name}: {error}") from error
            raise
        COMPILED.append(self.name)

    def run_compiler(self, folder: Path) -> None:
        """Compile it, and nothing else."""
        # Warp does not repeat a build that failed before, for instance because the disk was full.
        self._module.failed_builds.pop((self._device.context, self._block), None)
        arch = self._module._get_compile_arch(self._device)
        self._module._compile(self._device, folder, self.files_in(folder)[0].name, arch, options=self.options)

    @property
    def options(self) -> dict[str, Any]:
        """Warp's options for it."""
        self._module.get_module_hash(self._block)  # it resolves them as a side effect
        return dict(self._module.resolved_options[self._block])

    def generate(self) -> tuple[str, dict[str, Any]]:
        """Return its code for this device, and what Warp's `.meta` file says."""
        source, _, meta, _, _ = self._module._run_codegen(self.options, self._device.is_cpu)
        return source, meta

    def load(self) -> None:
        """Have Warp load it, compiled if necessary."""
        binary, meta = self.files_in(self.provide())
        arch = self._module._get_compile_arch(self._device)
        self._module.load(self._device, self._block, output_arch=arch, binary_path=binary, meta_path=meta)


def compile_nothing() -> None:
    """Compile a module without kernels for CPUs, so that Warp precompiles its headers."""
    context: Any = sys.modules["warp._src.context"]
    Build(context.Module("wrt.empty", None), "cpu").run_compiler(work_folder() / "kernels" / "wrt.empty")


def publish(build: Path, cached: Path) -> None:
    """Move the files of a complete build into the cache, where other processes find it.

    Raises:
        OSError: when the cache cannot be written to.
    """
    cached.mkdir(parents=True, exist_ok=True)
    for abandoned in cached.glob(".*"):  # by a process that was killed here
        abandoned.unlink(missing_ok=True)
    *files, seals = sorted(build.iterdir(), key=lambda file: file.suffix == DIGEST)
    (cached / seals.name).unlink(missing_ok=True)
    for file in (*files, seals):
        put(cached / file.name, file.read_bytes())
    shutil.rmtree(build, ignore_errors=True)
