"""Shadow catchers: what the other shapes of a scene do to the light on them.

A second film holds the scene without the shapes that are neither catchers nor lights (differential rendering, Debevec
1998). It has the random numbers of the picture, sample by sample, so both are equal to the bit where the other
shapes do nothing. Shapes that emit stay in both films: theirs is the light that the catchers have of their own.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.develop.denoise import denoise
from wrt.linalg import weighted_sum
from wrt.scene.camera import Camera
from wrt.scene.layers import CATCHER
from wrt.scene.scene import Scene

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

Image = NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class Caught:
    """A picture with shadow catchers.

    Attributes:
        foreground: (H, W, 3) radiance of the other shapes, times their coverage.
        coverage: (H, W) of the other shapes.
        added: (H, W, 3) radiance that they add to the catchers, times the coverage of those.
        alpha: (H, W) share of the light from behind the picture that it takes away.
        shadow: (H, W, 3) radiance of the catchers over that without other shapes; 1 where there are no catchers, or
            they would be black.
    """

    foreground: Image
    coverage: Image
    added: Image
    alpha: Image
    shadow: Image

    @property
    def image(self) -> Image:
        """(H, W, 3) radiance in front of a background: it becomes image + (1 - alpha) · background."""
        image: Image = self.foreground + self.added
        return image

    def for_codes(self, gain: float) -> tuple[Image, Image]:
        """Return image and alpha for 8-bit codes, whose colours are at most white times alpha.

        Light that is added, multiplied by `gain`, covers there what is behind it by its luminance, and colours beyond
        that are cut: over white even red light must hardly be seen.
        """
        room = np.minimum(gain * weighted_sum(self.added, _LUMINANCE), 1.0 - self.coverage)
        alpha: Image = np.maximum(self.alpha, self.coverage + room).astype(np.float32)
        image: Image = self.foreground + np.minimum(self.added, room[..., None] / gain).astype(np.float32)
        return image, alpha


def caught(total: Image, coverage: Image, lit: Image, unshaded: Image) -> Caught:
    """Return the picture of two films.

    Over a background like the unshaded catchers it has the luminance of the whole scene.

    Args:
        total: (H, W, 3) radiance of the whole scene.
        coverage: (H, W) share of samples that see a surface.
        lit: (H, W, 4) radiance of the samples that see a catcher, over all samples, and their share.
        unshaded: the same without other shapes.
    """
    share = lit[..., 3].astype(np.float64)
    with_shapes, alone = _per_share(lit), _per_share(unshaded)
    light = weighted_sum(alone, _LUMINANCE)
    kept = np.divide(
        weighted_sum(np.minimum(with_shapes, alone), _LUMINANCE), light, out=np.ones_like(light), where=light > 0.0
    )
    known = (alone > 0.0) & (share[..., None] > 0.0)
    of_shapes = np.maximum(coverage - share, 0.0)
    return Caught(
        foreground=np.maximum(total - lit[..., :3], 0.0),
        coverage=of_shapes.astype(np.float32),
        added=(share[..., None] * np.maximum(with_shapes - alone, 0.0)).astype(np.float32),
        alpha=(of_shapes + share * (1.0 - kept)).astype(np.float32),
        shadow=np.divide(with_shapes, alone, out=np.ones_like(alone), where=known).astype(np.float32),
    )


def _per_share(layer: Image) -> NDArray[np.float64]:
    """Return (H, W, 3) mean radiance of the samples that see a catcher; 0 where there are none."""
    values = layer.astype(np.float64)
    radiance, share = values[..., :3], values[..., 3:]
    return np.divide(radiance, share, out=np.zeros_like(radiance), where=share > 0.0)


def any_catchers(scene: Scene) -> bool:
    """Return whether any shape of a scene is a shadow catcher."""
    return any(shape.shadow_catcher for shape in scene.shapes)


def without_others(scene: Scene) -> Scene:
    """Return a scene with its shadow catchers and lights alone."""
    kept = [shape for shape in scene.shapes if shape.shadow_catcher or shape.emits]
    return dataclasses.replace(scene, shapes=kept)


class Catchers:
    """The second film of a renderer's picture: a function of its scene, its seed and the samples of its pixels.

    It is rendered when it is needed, so checkpoints, passes and workers do without it.
    """

    def __init__(self, renderer: Renderer) -> None:
        """Prepare nothing yet for a renderer."""
        self._renderer = renderer
        self._camera = renderer.camera
        self._alone: Renderer | None = None

    def look_from(self, camera: Camera) -> None:
        """Look from another camera."""
        self._camera = camera

    def forget(self) -> None:
        """Build the second film again when it is needed, for other values of the scene."""
        self._alone = None

    def prepare(self) -> Renderer:
        """Return the renderer of the second film, which is built the first time."""
        if self._alone is None:
            alone = dataclasses.replace(without_others(self._renderer.scene), camera=self._camera)
            self._alone = self._renderer._beside(alone)
        return self._alone

    def caught(self, *, denoised: bool = False) -> Caught:
        """Return the picture so far."""
        alone, film = self._up_to_date(), self._renderer.film
        blended = not denoised  # see `Renderer.denoised`
        layers = film.aovs.arrays(film.fetch("count"), names=("alpha", CATCHER), blended=blended)
        lit = layers[CATCHER]
        unshaded = alone.film.aovs.arrays(alone.film.fetch("count"), names=(CATCHER,), blended=blended)[CATCHER]
        if not denoised:
            return caught(film.mean(), layers["alpha"], lit, unshaded)
        total = film.means().astype(np.float32)
        guides, threads = self._renderer._film_guides(), self._renderer._denoising_threads
        foreground = denoise(np.maximum(total - lit[..., :3], 0.0), **guides, threads=threads)
        lit = _denoised(lit, guides, threads)
        unshaded = _denoised(unshaded, alone._film_guides(), threads)
        read = film.reading.picture
        return caught(read(foreground + lit[..., :3]), read(layers["alpha"]), read(lit), read(unshaded))

    def _up_to_date(self) -> Renderer:
        """Return the renderer of the second film, each of whose pixels has as many samples as in the picture."""
        alone = self.prepare()
        if alone.camera != self._camera:
            alone.set_camera(self._camera)
        counts = self._renderer.film.fetch("count").copy()
        if (alone.film.fetch("count") > counts).any():  # the picture has restarted
            alone.film.clear()
        for target in np.unique(counts[counts > 0]).tolist():
            fewer = counts < target
            with alone.film.leaving_out(fewer if fewer.any() else None, target):
                for _ in alone.passes(spp=target, pass_seconds=alone.longest_pass):
                    pass
        return alone


def _denoised(layer: Image, guides: dict[str, Any], threads: int | None) -> Image:
    """Return a film's layer of catchers with its radiance denoised."""
    return np.dstack([denoise(layer[..., :3], **guides, threads=threads), layer[..., 3]])
