"""What of a file was used: a reader names what it met and did not use, which is then warned of.

What has no effect on a picture stands in a table of the reader, with the reason; everything else is a loss.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Set
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
    """An object of a JSON file that records which of its keys are asked for; it takes the place of a plain one.

    Attributes:
        asked: the keys that were asked for, whether the object has them or not.
    """

    asked: Set[str] = frozenset()  # of the class until a key is asked for: a file may have millions of objects

    def _ask(self, key: object) -> None:
        if not isinstance(self.asked, set):
            self.asked = set()
        self.asked.add(str(key))

    def __getitem__(self, key: str) -> Any:
        self._ask(key)
        return super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        self._ask(key)
        return super().__contains__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value of a key, or the default."""
        self._ask(key)
        return super().get(key, default)


def unused_keys(
    value: Any, place: str = "", containers: Container[str] = (), words: Mapping[str, Container[Any]] | None = None
) -> Iterator[str]:
    """Yield the path of each key below a JSON value that the reader did not ask for, such as "materials.alphaMode".

    Numbers of arrays are left out of paths. Keys below an unused key are not yielded, and neither
    are objects in arrays that were never read.

    Args:
        value: the JSON value.
        place: its path.
        containers: keys such as "extensions", whose contents are yielded in their place.
        words: the values of enumerations by path; of a key that was asked for, another value is yielded after the path.
    """
    if isinstance(value, TrackedObject):
        for key, inner in value.items():
            path = f"{place}.{key}" if place else key
            if key in value.asked or (key in containers and isinstance(inner, TrackedObject)):
                yield from unused_keys(inner, path, containers, words)
                if words and path in words and inner not in words[path]:
                    yield f"{path} {inner!r}"
            else:
                yield path
    elif isinstance(value, list):
        for each in value:
            if isinstance(each, list) or (isinstance(each, TrackedObject) and each.asked):
                yield from unused_keys(each, place, containers, words)
