"""Render parts and windows of a picture with a scene that is built once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.parts.cut import windows_of_part
from wrt.parts.part import Part, header_of
from wrt.rendering.film_aovs import material_numbers
from wrt.rendering.passes import LONGEST_PASS, Progress
from wrt.rendering.renderer import Renderer
from wrt.scene.scene import MAX_SPP
from wrt.upload.camera import CropWindow
from wrt.values import integer

Watch = Callable[[int, Progress], object]
"""Called after each pass with the number of the window, from 0, and its progress."""


def render_part(
    renderer: Renderer,
    number: int,
    of: int,
    *,
    spp: int | None = None,
    begun: Part | None = None,
    watch: Watch = lambda window, progress: None,
) -> Part:
    """Render part `number` of `of` of a renderer's picture, whose own film is not touched.

    Args:
        renderer: the renderer.
        number: which part, from 1.
        of: how many parts the picture has.
        spp: samples per pixel; by default those of the settings.
        begun: the same part with fewer samples, to go on from.
        watch: called after each pass.

    Raises:
        InputError: if there is no such part, or `begun` is of another picture or has more samples.
    """
    if renderer.has_updated_vertices:
        raise InputError("no part of a picture whose vertices were updated; make a new Renderer")
    if spp is None and renderer.settings.noise is not None:
        raise InputError("the scene sets a target of noise, which is for whole pictures; give the samples of a part")
    spp = integer(renderer.settings.spp if spp is None else spp, "spp", minimum=1, maximum=MAX_SPP)
    windows = windows_of_part(renderer.crop, number, of)
    header = header_of(renderer)
    state = None
    if begun is not None:
        if (begun.number, begun.of) != (number, of):
            raise InputError(f"{begun.name}: cannot resume, it is part {begun.number} of {begun.of}")
        begun.require_fit(header, what="cannot resume, these differ", pair="{} there, {} here")
        if begun.spp > spp:
            raise InputError(f"{begun.name}: cannot resume, it has {begun.spp} samples per pixel, more than {spp}")
        state = begun.arrays
    arrays, seconds, _ = render_windows(renderer, windows, spp, state=state, watch=watch)
    seconds += 0.0 if begun is None else begun.header["seconds"]
    materials = np.array(material_numbers([shape.material for shape in renderer.scene.shapes]), np.int32)
    header = {"part": [number, of], **header, "spp": spp, "seconds": seconds}
    return Part(f"part {number} of {of}", header, arrays, materials)


def render_windows(
    renderer: Renderer,
    windows: Sequence[CropWindow],
    spp: int,
    *,
    state: dict[str, NDArray[Any]] | None = None,
    watch: Watch = lambda window, progress: None,
    seconds_left: float | None = None,
) -> tuple[dict[str, NDArray[Any]], float, int]:
    """Bring the pixels of windows to `spp` samples each.

    Args:
        renderer: a renderer of the whole picture; its own film is not touched.
        windows: windows of it, in pixels of the whole picture.
        spp: samples per pixel in the end.
        state: arrays of a film for the pixels of the windows, to go on from; by default it is empty.
        watch: called after each pass.
        seconds_left: estimated time until the whole picture is finished; with it, a window is one pass, which nothing
            interrupts.

    Returns:
        The arrays of a film for the pixels of the windows, one window after the other; the seconds of rendering, and
        the rays that were traced.
    """
    films: list[dict[str, NDArray[Any]]] = []
    seconds, rays, first = 0.0, 0, 0
    for index, window in enumerate(windows):
        one = renderer.sharing(crop=window)
        if state is not None:
            one.film.restore({name: array[first : first + one.film.pixels] for name, array in state.items()})
        first += one.film.pixels
        if seconds_left is not None:
            one._trace(spp, seconds_left)
        else:
            for progress in one.passes(spp=spp, pass_seconds=LONGEST_PASS):
                watch(index, progress)
        films.append(one.film.arrays())
        seconds += one.seconds_render
        rays += one.rays
    return {name: np.concatenate([each[name] for each in films]) for name in films[0]}, seconds, rays
