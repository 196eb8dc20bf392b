"""The cameras of a file, and the choice of one of them by its name or number."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from wrt.errors import InputError, did_you_mean, warn
from wrt.scene.scene import Scene


def unique(names: Iterable[str]) -> list[str]:
    """Return a different name for each camera: of several with one name, the later ones get a number."""
    found: dict[str, None] = {}
    for name in names:
        free, count = name or "camera", 1
        while free in found:
            free, count = f"{name or 'camera'}_{count}", count + 1
        found[free] = None
    return list(found)


def number_of(source: object, names: Sequence[str], choice: int | str) -> int:
    """Return which of the cameras with these names has a name, or a number counted from 0.

    Raises:
        InputError: where there is none; the message lists the cameras of `source`.
    """
    if choice in names:
        return names.index(str(choice))
    number = int(choice) if str(choice).isdecimal() else -1
    if 0 <= number < len(names):
        return number
    reason = f"it has {listed(names)}" if names else "it has none"
    raise InputError(f"{source}: there is no camera {choice!r}; {reason}{did_you_mean(choice, names)}")


def with_camera(source: object, scene: Scene, choice: int | str | None) -> Scene:
    """Return a scene with another camera of its file, by name or number; None keeps the first."""
    if choice is None:
        return scene
    names = list(scene.cameras)
    return dataclasses.replace(scene, camera=scene.cameras[names[number_of(source, names, choice)]])


def note_several(source: object, names: Sequence[str]) -> None:
    """Warn that the first of several cameras is taken; `strict` allows it, as nothing is wrong with such a file."""
    if len(names) > 1:
        warn(f"{source}: of its cameras, {listed(names)}, the first is taken; --camera chooses another", UserWarning)


def listed(names: Sequence[str]) -> str:
    """Return the numbers and names of cameras for a message."""
    return ", ".join(f"{number} {name!r}" for number, name in enumerate(names))
