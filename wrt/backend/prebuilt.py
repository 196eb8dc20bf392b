"""Kernels that come compiled with the package, for processors of two levels of x86-64.

`wrt/prebuilt/LEVEL` holds compiled files and a table of artefacts as in the user's cache (see `artefacts.py`), named by
a digest of the code of kernels and of the version of Warp. It is only read, and as trusted as the code beside it.
`wrt.prebuilding` makes it, for wheels and checkouts; where there is none, kernels are compiled on first use.
"""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from wrt.backend.cache_folders import read_checked, warn_once, write_checked
from wrt.backend.processor import processor_flags

SWITCH = "WRT_PREBUILT"
"""Environment variable: 0 uses no prebuilt kernels; the name of a level uses those of that level."""

FOLDER = Path(__file__).resolve().parents[1] / "prebuilt"

_V3 = frozenset(("abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"))
NEEDED = {"v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "v3": _V3}
"""Processor features by level of x86-64, the best first, as Linux names them (System V ABI, AMD64 supplement)."""

LANES = {"v4": 16, "v3": 8}
"""Lanes of the wide kernels of each level."""


def level_of(flags: frozenset[str]) -> str:
    """Return the best level of processors with these features, or ""."""
    return next((level for level, needed in NEEDED.items() if flags >= needed), "")


def level_here() -> str:
    """Return the level whose kernels this process uses, or ""."""
    setting = os.environ.get(SWITCH, "")
    return (setting if setting in NEEDED else "") if setting else level_of(processor_flags())


def table_path(level: str, digest: str) -> Path:
    """Return the path of a level's table for a digest (see `fingerprint.digest_of_code`)."""
    return FOLDER / level / f"artefacts-{digest}.json"


def read_prebuilt(digest: str) -> dict[str, dict[str, Any]]:
    """Return the table of the prebuilt kernels for this processor and digest; it is empty if there are none."""
    table: dict[str, dict[str, Any]] = {"files": {}, "structs": {}, "values": {}}
    if level := level_here():
        path = table_path(level, digest)
        with contextlib.suppress(OSError):
            if (text := read_checked(path)) is None:
                warn_once(f"{path}: the table of prebuilt kernels is damaged; install wrt again to be faster")
                return table
            table |= json.loads(text)
            for entry in table["files"].values():
                entry["file"] = str(path.with_name(entry["file"]))
    return table


def write_prebuilt(level: str, digest: str, table: dict[str, dict[str, Any]]) -> None:
    """Write the table of a level whose compiled files lie in its folder.

    Raises:
        OSError: when it cannot be written.
    """
    files = {module: entry | {"file": Path(entry["file"]).name} for module, entry in table["files"].items()}
    text = json.dumps(table | {"files": files}, separators=(",", ":"), sort_keys=True)
    write_checked(table_path(level, digest), text.encode())
