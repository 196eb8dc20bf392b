"""Compiled kernels and what the host knows of `kernels/`, kept for processes that then need not import Warp.

An artefact is a file that Warp has compiled, with the symbol and the argument layout of each of its kernels. The table
of artefacts is a file in the user's cache folder, named by a digest of everything that they depend on. It has three
parts by name:

- `files`: Warp's modules: the compiled file, its size, and the symbol and argument layout of each kernel;
- `structs`: size in bytes, and name, type and offset of each field (see `arrays.Field`);
- `values`: constants, structs and kernels of the modules of `kernels/` that the host uses, and what their functions
  return (see `describe.call_name`).
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
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import (
    is_private,
    keep_latest,
    locked,
    make_private,
    read_checked,
    warn_once,
    write_checked,
    wrt_folder,
)
from wrt.backend.fingerprint import TESTED, digest_of_code, fingerprint, folder_of, version_of
from wrt.backend.kernel_cache import State, state
from wrt.backend.prebuilt import read_prebuilt

KEPT = 16
"""Tables that are kept, for different versions of the kernels and of Warp, and for different processors."""

_HANDLES = itertools.count()
"""Numbers of the files that this process has loaded."""

Table = dict[str, dict[str, Any]]


class Artefacts:
    """The compiled kernels that are in the cache, and those loaded into this process.

    Attributes:
        can_launch: Whether compiled kernels run without Warp: on Linux, with a version of Warp that was tested.
        path: The file of the table; nothing is kept without one.
        folders: The folders that are searched for the table; it is written to the first writable one.
        warp_version: The version of Warp that compiles the kernels.
        code: The digest of the kernels' code (see `fingerprint.digest_of_code`).
        table: The table of what is in the cache.
        prebuilt: The table of what came with the package, for what the other lacks.
    """

    def __init__(self) -> None:
        """Read the table for the current kernels, if this machine has one."""
        self._warp = folder_of("warp")
        self.warp_version = version_of(self._warp)
        self.can_launch = sys.platform.startswith("linux") and self.warp_version in TESTED
        self.path: Path | None = None
        self.folders: list[Path] = []
        self.table: Table = {"files": {}, "structs": {}, "values": {}}
        self.prebuilt: Table = {part: {} for part in self.table}
        self._clang: Any = None
        self._loaded: dict[str, bytes] = {}
        self._lock = threading.RLock()
        self._added: Table = {part: {} for part in self.table}
        self._is_saved = True
        self.code = ""
        if self.can_launch:
            self.code = digest_of_code(self.warp_version)
            self.prebuilt = read_prebuilt(self.code)
            with contextlib.suppress(OSError):
                self.path = wrt_folder() / f"artefacts-{fingerprint(self._warp, self.code)}.json"
                self.folders.append(self.path.parent)
                self.refresh()

    def refresh(self) -> None:
        """Read what other processes may have added."""
        for folder in self.folders:
            assert self.path is not None
            path = folder / self.path.name
            with contextlib.suppress(OSError):
                if (text := read_checked(path)) is None:
                    warn_once(f"{path}: the table of compiled kernels was damaged; it is replaced")
                else:
                    for part, entries in json.loads(text).items():
                        self.table[part] |= entries | self._added[part]

    def lock(self) -> AbstractContextManager[bool]:
        """Return a context that only one process of a user can hold at a time."""
        if self.path is None:
            return contextlib.nullcontext(False)
        with contextlib.suppress(OSError):  # without a lock, processes compile in parallel
            make_private(self.path.parent)
        return locked(self.path.parent, seconds=math.inf)

    def get(self, part: str, name: str) -> Any:
        """Return an entry of a part of the table, or else of the prebuilt one, or None."""
        entry = self.table[part].get(name)
        return self.prebuilt[part].get(name) if entry is None else entry

    def add(self, part: str, name: str, entry: Any) -> None:
        """Add an entry, which the next `save` keeps for other processes."""
        if self.table[part].get(name) != entry:
            self.table[part][name] = self._added[part][name] = entry
            self._is_saved = False

    def has(self, call: str) -> bool:
        """Return whether the kernel that a call returns is compiled and in the cache (see `describe.call_name`)."""
        kernel = (self.get("values", call) or {}).get("kernel")
        return kernel is not None and any(self._builds(kernel[0]))

    def _builds(self, module: str) -> Iterator[dict[str, Any]]:
        """Return the entries of a module, of the cache and of the package, if their files exist."""
        for table in (self.table, self.prebuilt):
            entry = table["files"].get(module)
            with contextlib.suppress(OSError):
                if entry is not None and os.path.getsize(entry["file"]) == entry["bytes"]:
                    yield entry

    def kernel(self, module: str, key: str) -> tuple[Any, list[Any]] | None:
        """Load one of Warp's modules into this process, and return one of its kernels with its argument layout.

        Return None if it is not compiled, or if its file is missing, damaged or open to others.
        """
        for entry in self._builds(module):
            symbol, *layout = entry["kernels"].get(key, [None])
            file = Path(entry["file"])
            with self._lock:
                is_ours = entry is self.prebuilt["files"].get(module) or is_private(file.parent)
                if symbol and (str(file) in self._loaded or (is_ours and state(file) is State.WHOLE)):
                    function = self.load(file, symbol)
                    if function is not None:
                        return function, layout
        return None

    @property
    def loaded(self) -> set[str]:
        """The compiled files that this process has loaded."""
        return set(self._loaded)

    def load(self, file: Path, symbol: str) -> Any:
        """Load a compiled file, unless it is loaded, and return the function with a symbol; None if it has none."""
        with self._lock:
            if str(file) not in self._loaded:
                handle = f"wrt_{next(_HANDLES)}".encode()
                if self._native().wp_load_obj(os.fsencode(file), handle, False) != 0:
                    return None
                self._loaded[str(file)] = handle
            address = self._native().wp_lookup(self._loaded[str(file)], symbol.encode())
        return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(address) if address else None

    def _native(self) -> Any:
        """Return Warp's library that loads compiled kernels."""
        if self._clang is None:
            clang = ctypes.CDLL(str(self._warp / "bin" / "warp-clang.so"))
            clang.wp_load_obj.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_bool]
            clang.wp_lookup.argtypes = [ctypes.c_char_p, ctypes.c_char_p]
            clang.wp_lookup.restype = ctypes.c_uint64
            # The library expects functions of warp.so (`wp_cpu_block_runtime_api`), which would take 96 MB more. Only
            # cooperative kernels call them, and wrt has none. If Warp runs, users may have such kernels.
            if getattr(sys.modules.get("warp._src.context"), "runtime", None) is None:
                abort = ctypes.cast(ctypes.CDLL(None).abort, ctypes.c_void_p)
                clang.wp_llvm_set_cpu_block_runtime((ctypes.c_void_p * 5)(*[abort.value] * 5))
            self._clang = clang
        return self._clang

    def save(self) -> None:
        """Keep what was added for later processes."""
        if self._is_saved or self.path is None:
            return
        self._is_saved = True
        self.refresh()  # other processes may have added something while this one compiled
        text = json.dumps(self.table).encode()
        for folder in self.folders:
            with contextlib.suppress(OSError):
                make_private(folder)
                # If two processes write at once, one loses its entries; it writes them again after its next render.
                write_checked(folder / self.path.name, text)
                keep_latest(folder, "artefacts-*.json", KEPT)
                return
