"""The built-in scenes, by name."""

from __future__ import annotations

from pathlib import Path

from wrt.errors import InputError

_DESCRIPTIONS = {
    "cornell-box": "The Cornell box, from the published measurements.",
    "teapot": "The Utah teapot on a studio sweep.",
    "still-life": "A copper teapot, glass, gold and painted objects in soft light, with slight depth of field.",
    "many-triangles": "Mountains of a million triangles in evening sun.",
}


def scene_names() -> list[str]:
    """Return the names of the built-in scenes."""
    return list(_DESCRIPTIONS)


def scene_descriptions() -> dict[str, str]:
    """Return a one-line description of each built-in scene, by name, in the order of `scene_names`."""
    return dict(_DESCRIPTIONS)


def scene_path(name: str) -> Path:
    """Return the TOML file of a built-in scene.

    Raises:
        InputError: if no scene has that name.
    """
    if name not in _DESCRIPTIONS:
        raise InputError(f"no built-in scene is called {name!r}; there are {', '.join(_DESCRIPTIONS)}")
    return Path(__file__).resolve().parent / f"{name}.toml"
