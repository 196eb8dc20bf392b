"""How scenes, meshes and renderers show themselves in notebooks: small pictures, and live views."""

from __future__ import annotations

import dataclasses
from typing import Any

from wrt.errors import InputError
from wrt.rendering.passes import LONGEST_PASS
from wrt.rendering.renderer import Renderer
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene
from wrt.view.picture import Look, develop, png

LARGEST_SIDE = 320
"""Pixels of the longer side of the picture of a scene or mesh."""

SAMPLES, SECONDS = 16, 2.0
"""Limits of that picture's rendering."""


def view_renderer(renderer: Renderer, *, spp: int | None = None) -> Any:
    """Return the widget of a renderer, whose samples it shows and continues."""
    from wrt.view.widget import view_widget

    return view_widget(lambda: renderer, spp=spp)


def view_scene(scene: Scene, *, spp: int | None = None, **options: Any) -> Any:
    """Return the widget of a scene; `options` are those of `wrt.Renderer`."""
    from wrt.view.widget import view_widget

    renderer = Renderer(scene, **options)
    return view_widget(lambda: renderer, spp=spp)


def picture_of_renderer(renderer: Renderer) -> bytes | None:
    """Return the picture of a renderer so far as a PNG file; None before the first sample."""
    if renderer.spp == 0 or not renderer.renders_light:
        return None
    return png(develop(renderer.image(), Look.of(renderer.settings)))


def picture_of_scene(scene: Scene) -> bytes | None:
    """Return a small picture of a scene as a PNG file; None if it cannot be rendered."""
    settings = scene.settings
    scale = min(1.0, LARGEST_SIDE / max(settings.width, settings.height))
    width, height = (max(1, round(scale * side)) for side in (settings.width, settings.height))
    small = dataclasses.replace(settings, width=width, height=height, crop=None, layers=())
    if small.integrator == "aov":
        small = dataclasses.replace(small, integrator=None)
    try:
        renderer = Renderer(dataclasses.replace(scene, settings=small))
    except InputError:  # it is still being put together
        return None
    for _ in renderer.passes(spp=SAMPLES, time=SECONDS, pass_seconds=min(SECONDS, LONGEST_PASS)):
        pass
    return picture_of_renderer(renderer)


def picture_of_mesh(mesh: Mesh) -> bytes | None:
    """Return a small picture of a mesh in the studio as a PNG file."""
    from wrt.api import load

    try:
        return picture_of_scene(load(mesh))
    except InputError:  # its colours are not those of a material
        return None
