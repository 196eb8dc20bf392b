"""What Warp has compiled for the kernels as they are now, remembered from one process to the next."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import json
import os
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from wrt.cache_folders import keep_latest, put, wrt_folder
from wrt.kernel_cache import State, digest, state

TESTED = ("1.19.0",)
"""Versions of Warp whose memory layout `wrt/lean` has been tested against; with others, Warp itself is imported."""

FORMAT = 2
"""Version of the notes' format: one line of digest, then JSON."""

KEPT = 16
"""Notes about so many versions of kernels, Warp and processors."""

FILM = "wrt.kernels.film"
RENDER = "wrt.render."
"""Names of modules of kernels: of one, and what those begin with that trace rays."""

_COOPERATIVE = b"wp_cpu_"
"""How names of functions begin that kernels call whose threads wait for one another."""


class Missing(Exception):
    """Something is needed that only Warp itself has."""


class Builds:
    """The compiled modules that are known, and those loaded into this process.

    Attributes:
        path: The file of the notes.
        elsewhere: A folder for the notes if that file cannot be written, or None.
        warp_version: The version of the Warp that made them.
    """

    def __init__(self, path: Path, warp: Path, warp_version: str, modules: dict[str, Any]) -> None:
        """Take the file that they are noted in, Warp's folder, and what is noted."""
        self.path, self.warp_version = path, warp_version
        self.elsewhere: Path | None = None
        self._warp, self._modules = warp, modules
        self._clang: Any = None
        self._loaded: dict[str, bytes] = {}
        self._lock = threading.RLock()

    @classmethod
    def known(cls) -> Builds | None:
        """Return the builds of the kernels as they are, on this machine; None with a Warp that is not known well."""
        spec = importlib.util.find_spec("warp")
        if spec is None or spec.origin is None or not sys.platform.startswith("linux"):
            return None
        warp = Path(spec.origin).parent
        try:
            version = _version(warp)
            if version not in TESTED:
                return None
            path = wrt_folder() / f"builds-{fingerprint(warp)}.json"
        except OSError:
            return None
        builds = cls(path, warp, version, {})
        builds.refresh()
        return builds

    def refresh(self) -> None:
        """Read again what others may have noted."""
        for folder in (self.path.parent, *filter(None, [self.elsewhere])):
            path = folder / self.path.name
            with contextlib.suppress(OSError):
                said, _, text = path.read_bytes().partition(b"\n")
                if said == digest(text):
                    self._modules |= json.loads(text)
                else:
                    warnings.warn(f"{path}: notes of compiled kernels were damaged, and are written anew", stacklevel=2)

    def __bool__(self) -> bool:
        """Whether there is what every render needs at its end, when it would be late to miss that."""
        return FILM in self._modules

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Within the context, be the only process of this user that is in one; wait for others first."""
        import fcntl

        with contextlib.ExitStack() as stack:
            with contextlib.suppress(OSError):  # without a lock, processes compile in parallel
                self.path.parent.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context(open(self.path.parent / "compiling.lock", "a"))
                fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def has(self, name: str) -> bool:
        """Return whether a module was compiled and is still there."""
        found = self._modules.get(name)
        try:
            return found is not None and os.path.getsize(found["file"]) == found["bytes"]
        except OSError:
            return False

    def load(self, name: str) -> None:
        """Load a module into this process.

        Raises:
            Missing: where it was never compiled, or is there no longer as it was.
        """
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = self._load(name)

    def _load(self, name: str) -> bytes:
        if not self.has(name) or state(Path(self._modules[name]["file"])) is not State.WHOLE:
            raise Missing(name)  # the path through Warp then reports the damage
        handle = f"wrt_{len(self._loaded)}".encode()
        if self._native().wp_load_obj(os.fsencode(self._modules[name]["file"]), handle, False) != 0:
            raise Missing(name)
        return handle

    def function(self, name: str, key: str) -> Any:
        """Return a kernel's function of a module.

        Raises:
            Missing: see `load`.
        """
        self.load(name)
        symbol = self._modules[name]["kernels"].get(key)
        address = symbol and self._native().wp_lookup(self._loaded[name], symbol.encode())
        if not address:
            raise Missing(f"{name}: {key}")
        return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(address)

    def _native(self) -> Any:
        """Return the library of Warp that loads what was compiled."""
        if self._clang is None:
            clang = ctypes.CDLL(str(self._warp / "bin" / "warp-clang.so"))
            clang.wp_load_obj.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_bool]
            clang.wp_lookup.argtypes = [ctypes.c_char_p, ctypes.c_char_p]
            clang.wp_lookup.restype = ctypes.c_uint64
            # It asks for functions of warp.so (`wp_cpu_block_runtime_api`), which would take 96 MB more. They are for
            # kernels whose threads wait for one another, of which none is noted.
            abort = ctypes.cast(ctypes.CDLL(None).abort, ctypes.c_void_p)
            if not clang.wp_llvm_set_cpu_block_runtime((ctypes.c_void_p * 5)(*[abort.value] * 5)):
                raise Missing("the runtime of kernels")
            self._clang = clang
        return self._clang

    def note(self, loaded: Iterable[tuple[str, dict[str, Any]]]) -> None:
        """Note what `loaded_by_warp` found in this process, for others to come."""
        modules = {name: found for name, found in loaded if self._modules.get(name) != found}
        if not modules:
            return
        self._modules |= modules
        text = json.dumps(self._modules).encode()
        for folder in (self.path.parent, *filter(None, [self.elsewhere])):
            with contextlib.suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                # If two processes write at once, one loses its notes; it writes them again after its next render.
                put(folder / self.path.name, digest(text) + b"\n" + text)
                keep_latest(folder, "builds-*.json", KEPT)
                return


def loaded_by_warp() -> list[tuple[str, dict[str, Any]]]:
    """Return wrt's modules that Warp has loaded on the CPU: file, its size, and symbols by the kernels' names."""
    import warp as wp
    from warp._src.context import runtime, user_modules

    if runtime is None:  # Warp was imported, but not started
        return []
    device, found = runtime.get_device("cpu"), []
    for name, module in user_modules.items():
        execs = [(block, each) for (context, block), each in module.execs.items() if context == device.context]
        if not name.startswith("wrt.") or len(execs) != 1:
            continue
        ((block, each),) = execs
        if each.module_hash != module.get_module_hash(block):
            continue
        folder = os.path.join(wp.config.kernel_cache_dir, module.get_module_identifier(block))
        file = os.path.join(folder, module._get_compile_output_name(device, block_dim=block))
        kernels = {
            kernel.func.__qualname__: f"{each.get_kernel_mangled_name(kernel)}_cpu_forward"
            for kernel in module.hashers[block].get_unique_kernels()
            if kernel.adj.kernel_dim == 1
        }
        if len(kernels) < len(module.hashers[block].get_unique_kernels()):
            continue  # some that their names do not tell apart, or whose threads have more than one number
        with contextlib.suppress(OSError):
            built = Path(file).read_bytes()
            if _COOPERATIVE not in built:
                found.append((name, {"file": file, "bytes": len(built), "kernels": kernels}))
    return found


def _kernels() -> Path:
    """Return the folder of the kernels' sources."""
    spec = importlib.util.find_spec("wrt.kernels")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("wrt.kernels")
    return Path(spec.origin).parent


def _version(warp: Path) -> str:
    """Return the version of Warp in a folder, without importing it."""
    for line in (warp / "config.py").read_text(encoding="utf-8").splitlines():
        if line.startswith("version"):
            return line.partition("=")[2].strip().strip("\"'")
    return ""


def fingerprint(warp: Path) -> str:
    """Return a digest of all that a build depends on: kernels, Warp, the processor, Python, the environment."""
    things: list[object] = [FORMAT]
    folder = _kernels()
    for root, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            if name.endswith((".py", ".h")):
                with open(os.path.join(root, name), "rb") as file:
                    things += [os.path.relpath(root, folder), name, file.read()]
    things += [sys.version]
    things += sorted((k, v) for k, v in os.environ.items() if k.startswith("WARP_"))
    return _digest([*things, *_warp_and_processor(warp)])


def digest_of_warp(warp: Path) -> str:
    """Return a digest of Warp, its headers as they are, and the processor."""
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
    # What Python tells changed sources by: hashlib takes longer to import than all this.
    return importlib.util.source_hash(repr(things).encode("utf-8", "surrogateescape")).hex()
