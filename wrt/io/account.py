"""What of a file was used: a reader names what it met and did not use, which is then warned of.

What has no effect on a picture stands in a table of the reader, with the reason; everything else is a loss.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

from wrt.errors import warn

MOST_WARNINGS = 20
"""Maximum number of kinds that are named one by one; a damaged file may have thousands."""


def warn_of_unused(source: object, unused: Iterable[str], without_effect: Mapping[str, str]) -> None:
    """Warn, once a kind, of content that a reader met and did not use.

    Args:
        source: the file, for the message.
        unused: the kind of each thing, such as "map_Kd -type", as often as it occurs.
        without_effect: kinds that do not change a picture, or patterns of them for `fnmatch`, with the reason.
    """
    counts = Counter(unused)
    lost = [kind for kind in counts if not any(fnmatchcase(kind, pattern) for pattern in without_effect)]
    for kind in lost[:MOST_WARNINGS]:
        times = f" ({counts[kind]} times)" if counts[kind] > 1 else ""
        warn(f"{source}: {kind} is unknown to wrt and left out{times}")
    if len(lost) > MOST_WARNINGS:
        warn(f"{source}: {len(lost) - MOST_WARNINGS} other kinds of content are left out")


class TrackedObject(dict[str, Any]):
    """An object of a JSON file that records which of its keys are asked for."""

    def __init__(self, *items: Any, **named: Any) -> None:
        super().__init__(*items, **named)
        self.asked: set[str] = set()

    def __getitem__(self, key: str) -> Any:
        self.asked.add(key)
        return super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        self.asked.add(str(key))
        return super().__contains__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value of a key, or the default."""
        self.asked.add(key)
        return super().get(key, default)


def unused_keys(value: Any, place: str = "") -> Iterator[str]:
    """Yield the path of each key below a JSON value that nobody asked for, such as "materials.alphaMode".

    Numbers of arrays are left out of paths. What stands below a key that nobody asked for is not yielded, and neither
    are objects that nobody has looked into: they are not reached.
    """
    if isinstance(value, TrackedObject):
        if not value.asked:
            return
        for key in value.keys() - value.asked:
            yield f"{place}.{key}" if place else key
        for key in value.asked & value.keys():
            yield from unused_keys(dict.__getitem__(value, key), f"{place}.{key}" if place else key)
    elif isinstance(value, list):
        for each in value:
            yield from unused_keys(each, place)
