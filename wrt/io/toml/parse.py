"""Parsing of TOML files."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from wrt.errors import InputError
from wrt.io.encodings import as_utf8
from wrt.io.safe_read import read_file

MOST_LEVELS = 64
"""Most parts of a dotted key. The parser takes time and memory quadratic in their number."""

_PART = r"""(?:(?<![\w-])[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_TOO_LONG = re.compile(rf"(?:{_PART}[ \t]*\.[ \t]*){{{MOST_LEVELS}}}", re.ASCII)


def _require_short_keys(text: str) -> None:
    """Raise InputError where a dotted key in a TOML file has more than MOST_LEVELS parts."""
    if found := _TOO_LONG.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"line {line}: a dotted key has more than {MOST_LEVELS} parts")


def _require_short_integers(value: Any, key: str = "") -> None:
    """Raise InputError where an integer has more than 64 bits, which TOML forbids and Python may not print."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _require_short_integers(inner, name)
    elif isinstance(value, list):
        for inner in value:
            _require_short_integers(inner, key)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError(f"not TOML: {key} is an integer of more than 64 bits")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        InputError: where it cannot be read or is not valid TOML; the message does not name the file.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    try:
        text = as_utf8(read_file(path)).decode("utf-8")
        _require_short_keys(text)
        tables = dict(tomllib.loads(text))
        _require_short_integers(tables)
        return tables
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {error}") from None
    except InputError:
        raise
    except RecursionError:
        raise InputError("not TOML: arrays or tables are nested too deeply") from None
    except (OverflowError, ValueError) as error:
        too_long = "integer string conversion" in str(error)  # Python converts at most 4,300 digits
        what = "an integer of more than 64 bits" if too_long else type(error).__name__
        raise InputError(f"not TOML: {what}") from None
