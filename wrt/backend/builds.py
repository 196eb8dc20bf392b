"""Read the notes on compiled kernels, and load these kernels without importing Warp.

The notes are in the user's cache folder, named by a digest of everything that a build depends on; `recording.py`
describes them.
"""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import json
import math
import os
import sys
import threading
import warnings
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import is_private, keep_latest, locked, make_private, put, wrt_folder
from wrt.backend.fingerprint import TESTED, fingerprint, folder_of, version_of
from wrt.backend.kernel_cache import State, digest, state

KEPT = 16
"""Note files that are kept, for different versions of the kernels and of Warp, and for different processors."""


_HANDLES = itertools.count()
"""Numbers of the kernel modules that this process has loaded."""


class NotCompiled(Exception):
    """A render needs something from `kernels/` that is not compiled or not noted; Warp must run it."""


class Builds:
    """The compiled kernels that are known, and those loaded into this process.

    Attributes:
        path: The file of the notes.
        folders: The folders that are searched for notes; they are written to the first writable one.
        warp_version: The version of Warp that compiled the kernels.
        notes: The notes; see `recording.py`.
    """

    def __init__(self, path: Path, warp: Path, warp_version: str) -> None:
        """Start without notes; `path` is their file, `warp` the folder of Warp."""
        self.path, self.warp_version = path, warp_version
        self.folders = [path.parent]
        self.notes: dict[str, dict[str, Any]] = {"files": {}, "structs": {}, "modules": {}, "calls": {}}
        self._warp = warp
        self._clang: Any = None
        self._loaded: dict[str, bytes] = {}
        self._damaged: set[Path] = set()
        self._lock = threading.RLock()

    @classmethod
    def known(cls) -> Builds | None:
        """Return the builds of the current kernels on this machine; None if the version of Warp is not tested."""
        if not sys.platform.startswith("linux"):
            return None
        try:
            warp = folder_of("warp")
            version = version_of(warp)
            if version not in TESTED:
                return None
            path = wrt_folder() / f"builds-{fingerprint(warp)}.json"
        except OSError:
            return None
        builds = cls(path, warp, version)
        builds.refresh()
        return builds

    def refresh(self) -> None:
        """Read notes that other processes may have written."""
        for folder in self.folders:
            path = folder / self.path.name
            with contextlib.suppress(OSError):
                said, _, text = path.read_bytes().partition(b"\n")
                if said == digest(text):
                    self._add(json.loads(text))
                elif path not in self._damaged:
                    self._damaged.add(path)
                    warnings.warn(f"{path}: notes on compiled kernels were damaged; they are replaced", stacklevel=2)

    def _add(self, notes: dict[str, dict[str, Any]]) -> None:
        for table, found in notes.items():
            self.notes[table] |= found

    def __bool__(self) -> bool:
        """Return whether there are any notes."""
        return bool(self.notes["files"])

    def alone(self) -> AbstractContextManager[bool]:
        """Return a context that only one process of a user can hold at a time."""
        with contextlib.suppress(OSError):  # without a lock, processes compile in parallel
            make_private(self.path.parent)
        return locked(self.path.parent, seconds=math.inf)

    def has(self, call: str) -> bool:
        """Return whether the kernel that a call returns is compiled and in the cache (see `recording.call_name`)."""
        kernel = self.notes["calls"].get(call, {}).get("kernel")
        return kernel is not None and self._is_there(kernel[0])

    def _is_there(self, name: str) -> bool:
        found = self.notes["files"].get(name)
        try:
            return found is not None and os.path.getsize(found["file"]) == found["bytes"]
        except OSError:
            return False

    def function(self, name: str, key: str) -> tuple[Any, list[Any]]:
        """Load a Warp module into this process, and return one of its kernels with the layout of its arguments.

        Raises:
            NotCompiled: when it is not compiled, or the file is missing or damaged.
        """
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = self._load(name)
            symbol, *layout = self.notes["files"][name]["kernels"].get(key, ("",))
            address = symbol and self._native().wp_lookup(self._loaded[name], symbol.encode())
        if not address:
            raise NotCompiled(f"{name}: {key}")
        return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(address), layout

    def _load(self, name: str) -> bytes:
        if not self._is_there(name) or state(file := Path(self.notes["files"][name]["file"])) is not State.WHOLE:
            raise NotCompiled(name)  # Warp's backend then reports the damage
        if not is_private(file.parent):
            raise NotCompiled(f"{file}: others can replace it")
        handle = f"wrt_{next(_HANDLES)}".encode()
        if self._native().wp_load_obj(os.fsencode(file), handle, False) != 0:
            raise NotCompiled(name)
        return handle

    def _native(self) -> Any:
        """Return Warp's library that loads compiled kernels."""
        if self._clang is None:
            clang = ctypes.CDLL(str(self._warp / "bin" / "warp-clang.so"))
            clang.wp_load_obj.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_bool]
            clang.wp_lookup.argtypes = [ctypes.c_char_p, ctypes.c_char_p]
            clang.wp_lookup.restype = ctypes.c_uint64
            # The library wants functions of warp.so (`wp_cpu_block_runtime_api`), which would take 96 MB more. Only
            # cooperative kernels call them, and none of those is noted. Where Warp runs, users may have such kernels.
            abort = ctypes.cast(ctypes.CDLL(None).abort, ctypes.c_void_p)
            set_runtime = clang.wp_llvm_set_cpu_block_runtime
            if not _is_warp_running() and not set_runtime((ctypes.c_void_p * 5)(*[abort.value] * 5)):
                raise NotCompiled("the runtime of kernels")
            self._clang = clang
        return self._clang

    def note(self, notes: dict[str, dict[str, Any]]) -> None:
        """Save the notes of `compiled_by_warp` for later processes."""
        if all(self.notes[table].get(name) == note for table in notes for name, note in notes[table].items()):
            return
        self.refresh()  # other processes may have noted something while this one compiled
        self._add(notes)
        text = json.dumps(self.notes).encode()
        for folder in self.folders:
            with contextlib.suppress(OSError):
                make_private(folder)
                # If two processes write at once, one loses its notes; it writes them again after its next render.
                put(folder / self.path.name, digest(text) + b"\n" + text)
                keep_latest(folder, "builds-*.json", KEPT)
                return


def _is_warp_running() -> bool:
    """Return whether Warp has started in this process."""
    context = sys.modules.get("warp._src.context")
    return context is not None and getattr(context, "runtime", None) is not None
