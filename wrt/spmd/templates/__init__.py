"""C++ templates with placeholders such as `$STEPS$` for generated text."""

import re
from pathlib import Path

_PLACE_HOLDER = re.compile(r"\$(\w+)\$")


def fill(template: str, **values: str) -> str:
    """Return the text of a template of this folder with its placeholders filled in.

    Raises:
        ValueError: The values are not exactly those of the placeholders.
    """
    text = (Path(__file__).parent / template).read_text(encoding="utf-8")
    if set(_PLACE_HOLDER.findall(text)) != set(values):
        raise ValueError(f"{template}: {sorted(set(_PLACE_HOLDER.findall(text)) ^ set(values))}")
    return _PLACE_HOLDER.sub(lambda m: values[m[1]], text)
