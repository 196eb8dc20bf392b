"""Faults in device functions of users, in one line; Warp's message repeats every function that leads to them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wrt.errors import InputError

_PLACE = re.compile(r'Error while parsing function "(\w+)" at (.*):(\d+):\n(.*)\n')

_OF_WRT = Path(__file__).parents[1], Path(__file__).parents[1] / "kernels"


@contextmanager
def naming_faults() -> Iterator[None]:
    """Within the context, raise InputError with file, line and cause for code that Warp cannot compile.

    Faults of wrt's own kernels stay as they are.
    """
    try:
        yield
    except Exception as error:
        text = str(error.args[0]) if error.args else ""
        places = list(_PLACE.finditer(text))
        if not places or any(Path(places[-1][2]).resolve().is_relative_to(folder.resolve()) for folder in _OF_WRT):
            raise
        name, file, line, source = places[-1].groups()
        cause = " ".join(text[places[-1].end() :].lstrip(";").split())
        raise InputError(f"{file}, line {line}: {name}: `{source.strip()}`: {cause}") from None
