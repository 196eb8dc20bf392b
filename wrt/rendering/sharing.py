"""Renderers that share a built scene: of other sizes, integrators and layers, for previews and views."""

from __future__ import annotations

import dataclasses
from typing import Any

from wrt.rendering.film import Film
from wrt.rendering.renderer import Renderer
from wrt.upload.integrators import choose_integrator


def sharing(renderer: Renderer, **changes: Any) -> Renderer:
    """Return a renderer with other settings and a film of its own that shares the scene on the device.

    Nothing is built again, and nothing is compiled unless the integrator or the layers need another kernel. All
    renderers of a scene share its camera: after `set_camera` on one, call it on another before that renders again.

    Args:
        renderer: the renderer whose scene to share.
        changes: settings of `wrt.RenderSettings` that differ, except the filter's and the sampler's.

    Raises:
        InputError: on unusable settings, or when memory does not suffice for the film.
    """
    other: Renderer = object.__new__(Renderer)
    other.__dict__.update(renderer.__dict__)
    other.settings = dataclasses.replace(renderer.settings, **changes)
    other.integrator = choose_integrator(renderer.scene, other.settings)
    x0, y0, x1, y1 = other.crop
    other.film = Film(x1 - x0, y1 - y0, other.device, other.settings.film_layers)
    other._estimate_noise(None)
    other._guides = None
    with other.device.compiling() as compile:
        other._choose_kernel(other._built.features, compile, other._built.read)
    other._inputs = other._prepare()
    other._kernel.share_wide(renderer._kernel)
    other.seconds_render, other.paths = 0.0, 0
    return other
