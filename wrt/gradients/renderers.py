"""What a Renderer does with parameters: set them, and differentiate by them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.gradients.backward import Backward, require_gradients
from wrt.gradients.parameters import edited as edited
from wrt.gradients.parameters import known, mapping_of, parameters, places_of, require_shape
from wrt.gradients.places import BendingIndex, Points, Texels
from wrt.gradients.sums import DeviceSums
from wrt.rendering.renderer import Renderer
from wrt.scene.scene import MAX_SPP
from wrt.values import array, integer


def gradients(
    renderer: Renderer, d_image: Any, names: Iterable[str] | None, spp: int, seed: int | None
) -> dict[str, NDArray[np.float32]]:
    """Return the derivatives of a loss by parameters; see `Renderer.gradients`."""
    places = places_of(renderer.scene)
    of_values = [name for name, place in places.items() if not isinstance(place, (Points, BendingIndex))]
    wanted = of_values if names is None else [names] if isinstance(names, str) else names
    if not isinstance(wanted, Iterable):
        raise InputError(f"names must be names of parameters, not {names!r}")
    chosen = [known(name, places) for name in wanted]
    d_image = array(d_image, "d_image", np.float32)
    moved = {name: place for name in chosen if isinstance(place := places[name], Points)}
    with_normals = {place.number for place in moved.values() if place.field == "normals"}
    for name, place in moved.items():
        places[name] = dataclasses.replace(place, normals_follow=place.number not in with_normals)
    if moved and renderer.has_updated_vertices:
        raise InputError("vertices were updated, so that the scene lacks them; set them by set_parameters")
    glasses = [place.material for name in chosen if isinstance(place := places[name], BendingIndex)]
    backward = Backward(renderer, "index" if glasses else "vertices" if moved else "values")
    if any(isinstance(places[name], Texels) for name in chosen):
        renderer.make_texels_editable()
    seed = renderer.seed if seed is None else seed
    built = renderer._built
    numbers = sorted({built.values.materials.number_of(glass) for glass in glasses})
    of_glasses = {number: backward.run(d_image, spp, seed, number) for number in numbers}
    if moved and glasses:
        backward = Backward(renderer, "vertices")
    arrays = of_glasses[numbers[0]] if numbers and not moved else backward.run(d_image, spp, seed)
    indices = {number: float(each["index"][0, 0]) for number, each in of_glasses.items()}
    sums = DeviceSums(built.values, built.data, arrays, built.world.first_vertices, indices)
    found = {name: np.asarray(places[name].gradient(sums), np.float32) for name in chosen}
    if names is not None and np.any(d_image) and (without := [name for name in chosen if not found[name].any()]):
        warn(f"the picture does not depend on {', '.join(without)}: all derivatives are 0")
    return found


BETWEEN_SEEDS = 2**31
"""From the seed of a picture to that of its gradients in other libraries, whose losses mostly square the noise."""


class Differentiable:
    """A picture of a renderer as a function of parameters, for libraries that differentiate."""

    def __init__(
        self, renderer: Renderer, values: Mapping[str, Any], spp: int, gradient_spp: int | None, seed: int | None
    ) -> None:
        """Keep the samples per pixel, of gradients by default as many, and the seed, by default the renderer's.

        Raises:
            InputError: also if the integrator has no gradients, or `values` have unknown names or wrong shapes, which
                JAX would report as its own error.
        """
        if not isinstance(renderer, Renderer):
            raise InputError(f"the first argument must be a wrt.Renderer, not {type(renderer).__name__}")
        require_gradients(renderer)
        places = places_of(renderer.scene)
        for name, value in mapping_of(values).items():
            require_shape(name, places[known(name, places)], tuple(np.shape(value)))
        self._renderer = renderer
        self._spp = integer(spp, "spp", minimum=1, maximum=MAX_SPP)
        of_gradients = spp if gradient_spp is None else gradient_spp
        self._gradient_spp = integer(of_gradients, "gradient_spp", minimum=1, maximum=MAX_SPP)
        self._seed = renderer.seed if seed is None else integer(seed, "seed", minimum=0, maximum=2**32 - 1)

    @property
    def shape(self) -> tuple[int, int, int]:
        """The shape of the picture."""
        width, height = self._renderer.film.picture_size
        return height, width, 3

    def render(self, values: Mapping[str, Any]) -> None:
        """Have the renderer's film hold the picture."""
        self._renderer.set_parameters(values)
        self._renderer.seed = self._seed
        for _ in self._renderer.passes(spp=self._spp):
            pass

    def gradients(
        self, values: Mapping[str, Any], names: Iterable[str], d_image: Any
    ) -> dict[str, NDArray[np.float32]]:
        """Return the derivatives by some of the values; see `wrt.Renderer.gradients`."""
        now = parameters(self._renderer)
        if any(not np.array_equal(now[name], np.asarray(value, np.float32)) for name, value in values.items()):
            self._renderer.set_parameters(values)  # another picture has been rendered since
        seed = (self._seed + BETWEEN_SEEDS) % 2**32
        # Normals that are given do not follow vertices.
        names = list(names)
        given = [name for name in values if name.endswith(".normals") and name[:-7] + "vertices" in names]
        found = self._renderer.gradients(d_image, {*names, *given}, spp=self._gradient_spp, seed=seed)
        return {name: found[name] for name in names}
