"""A pilot picture, which decides where adaptive sampling stops without looking at the picture itself.

A tile that decides by its own samples whether to take more of them is biased: it stops when it looks good, which it
does when it has missed a rare bright path. The samples of a pilot with another seed tell as much about the noise, and
nothing about the errors of the picture. The mean of each pixel is then unbiased, whatever the pilot decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.rendering.film import Film
from wrt.rendering.noise.noise_target import NoiseEstimate

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

_PREFIX = "pilot_"
"""Before the names of its arrays in checkpoints."""

_SEED = 0x9E3779B9
"""The pilot's seed differs from the picture's by these bits."""

_BLOCK = 2
"""The pilot has one pixel of each block of this side: a quarter of the work is enough to judge a tile."""


class Pilot:
    """The pilot of one renderer.

    Attributes:
        film: its samples; most pixels have none.
        estimate: its noise, which stands for that of the picture, and the tiles that have stopped.
    """

    def __init__(self, renderer: Renderer) -> None:
        """Start without samples.

        Raises:
            InputError: when memory does not suffice for another film.
        """
        width, height = renderer.film.width, renderer.film.height
        self.film = Film(width, height, renderer.device, renderer.settings.film_layers)
        self._measured = one_of_each_block(width, height)
        self.estimate = NoiseEstimate(self.film, self._measured)
        self._seed = renderer.seed ^ _SEED

    def trace(self, renderer: Renderer, target: int) -> None:
        """Bring its pixels in tiles that go on to `target` samples."""
        stopped = self.estimate.stopped_pixels()
        left_out = ~self._measured if stopped is None else ~self._measured | stopped
        with self.film.leaving_out(left_out, target):
            renderer.trace_film(self.film, target, self._seed)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays to save for resuming, by name, without those of `estimate`."""
        return {_PREFIX + name: array for name, array in self.film.state().items()}

    def restore(self, state: dict[str, NDArray[Any]], shapes: int) -> None:
        """Continue from saved arrays; `shapes` is the number of shapes in the scene.

        Raises:
            InputError: if no render can have produced them.
        """
        own = {name.removeprefix(_PREFIX): array for name, array in state.items() if name.startswith(_PREFIX)}
        self.film.check(own, shapes)
        if own["count"][~self._measured].any():
            raise InputError("its pilot has samples where it takes none")
        self.film.restore(own)
        self.estimate.restore({**state, "count": own["count"]})


def has_pilot(state: dict[str, NDArray[Any]]) -> bool:
    """Return whether a checkpoint holds a pilot."""
    return any(name.startswith(_PREFIX) for name in state)


def one_of_each_block(width: int, height: int) -> NDArray[np.bool_]:
    """Return (pixels,) bool, true for one pixel of each block of 2x2, at changing places in the blocks."""
    y, x = np.mgrid[0 : -(-height // _BLOCK), 0 : -(-width // _BLOCK)]
    # Multiples of the powers of the inverse of the plastic number are evenly spread (Roberts 2018, "R2").
    place = np.floor((x * 0.7548776662466927 + y * 0.5698402909980532) % 1.0 * _BLOCK**2).astype(int)
    measured = np.zeros((height, width), bool)
    rows = np.minimum(_BLOCK * y + place // _BLOCK, height - 1)
    measured[rows, np.minimum(_BLOCK * x + place % _BLOCK, width - 1)] = True
    return measured.reshape(-1)
