"""The picture that a film holds: its radiance, coverage and layers, and the file they are written to."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.develop.exposure import stops
from wrt.develop.picture import Developed
from wrt.develop.settings import DEVELOPED_SUFFIXES, Exposure
from wrt.errors import InputError
from wrt.io.images import picture_path, require_room, save_image
from wrt.io.safe_read import PathLike
from wrt.rendering.film import Film
from wrt.rendering.layer_colors import layer_colors
from wrt.scene.layers import NOISY
from wrt.scene.scene import RenderSettings


class Picture(ABC):
    """What a film, its settings and its integrator show; the base of `wrt.Renderer` and of merged parts.

    Attributes:
        settings: the settings of the picture.
        film: its film.
        integrator: the integrator.
        seed: the seed.
        seconds_render: seconds spent on it.
    """

    settings: RenderSettings
    film: Film
    integrator: str
    seed: int
    seconds_render: float

    @property
    def spp(self) -> int:
        """Smallest number of samples of a pixel."""
        return self.film.tally().least

    @property
    def renders_light(self) -> bool:
        """True if there is a picture of radiance; integrator "aov" renders only layers."""
        return self.integrator != "aov"

    def image(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32, the current estimate of linear radiance in the rendered part of the picture."""
        return self.film.mean()

    @abstractmethod
    def denoised(self) -> NDArray[np.float32]:
        """Return `image` without most of its noise."""

    def alpha(self) -> NDArray[np.float32] | None:
        """Return (H, W) float32 coverage of a transparent picture, 0 to 1; None for others.

        It is how much of a pixel shows a surface. `image` holds the radiance of those alone (associated alpha).
        """
        return self._film_layers()["alpha"] if self.settings.transparent else None

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the selected layers by name: (H, W, channels), or (H, W) for one channel.

        They are float32, or uint32 for object and material numbers, which count from 1; 0 is the background.
        """
        return {name: values for name, values in self._film_layers().items() if name in self.settings.layers}

    def _film_layers(self) -> dict[str, NDArray[Any]]:
        return self.film.aovs.arrays(self.film.counts, self._materials())

    @abstractmethod
    def _materials(self) -> list[int]:
        """Return the number of each shape's material."""

    def save(
        self, path: PathLike, *, tone: str | None = None, exposure: Exposure = None, force: bool = False
    ) -> Developed | None:
        """Write the picture as `wrt render` does, with its layers, and the settings as metadata.

        A PNG or JPEG is developed with `tone` and `exposure` (see `wrt.develop_image`), by default those of the
        settings; the result says how.

        Raises:
            InputError: see `wrt.save_image`, also for `force`; and when the file cannot hold the layers.
        """
        return _write_picture(self, picture_path(path), tone, exposure, force=force)


def check_contents(path: Path, picture: Picture) -> None:
    """Raise InputError if a file cannot hold a render, with its layers and its alpha.

    OpenEXR files hold all layers. Without light, as with integrator "aov", a PNG or JPEG may show a single one.
    """
    layers, has_light = picture.settings.layers, picture.renders_light
    if not has_light and not layers:
        raise InputError("integrator aov renders only layers; name some, such as albedo,normal,depth")
    shown = path.suffix.lower() in DEVELOPED_SUFFIXES and not has_light and len(layers) == 1
    if layers and path.suffix.lower() != ".exr" and not shown:
        raise InputError(f"{path}: layers go into OpenEXR files; give it a name that ends in .exr")
    require_room(path, picture.film.width, picture.film.height, alpha=picture.settings.transparent and has_light)


def _write_picture(
    picture: Picture, path: Path, tone: str | None, exposure: Exposure, *, force: bool
) -> Developed | None:
    """Write a render with its layers and metadata; see `Picture.save`.

    Returns:
        How radiance was developed to 8 bits, or None if it was not.

    Raises:
        InputError: see `check_contents` and `wrt.save_image`.
    """
    settings, layers, alpha = picture.settings, picture.layers(), picture.alpha()
    save = functools.partial(save_image, path, metadata=_metadata(picture), force=force)
    check_contents(path, picture)
    suffix = path.suffix.lower()
    if not picture.renders_light:
        if suffix == ".exr":
            return save(None, layers=layers)
        ((name, values),) = layers.items()
        return save(layer_colors(name, values), tone="none", exposure=0.0)
    image = picture.denoised() if settings.denoise else picture.image()
    if suffix not in DEVELOPED_SUFFIXES:
        if settings.denoise and suffix == ".exr":
            layers[NOISY] = picture.image()
        return save(image, alpha=alpha, layers=layers)
    # What is not covered has no say in the exposure.
    seen = image if alpha is None or not alpha.any() else image[alpha > 0.0] / alpha[alpha > 0.0, None]
    chosen = stops(seen if seen.ndim == 3 else seen[None], settings.exposure if exposure is None else exposure)
    return save(image, alpha=alpha, tone=settings.tone if tone is None else tone, exposure=chosen)


def _metadata(picture: Picture) -> dict[str, object]:
    return {
        "Software": f"wrt {__version__}",
        "Integrator": picture.integrator,
        "Samples per pixel": picture.spp,
        "Seed": picture.seed,
        "Render seconds": f"{picture.seconds_render:.1f}",
    }
