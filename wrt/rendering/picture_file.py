"""Write a render to a picture file: its radiance or its layers, and metadata."""

from __future__ import annotations

import functools
from collections.abc import Collection
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.develop.exposure import stops
from wrt.develop.picture import Developed
from wrt.developing import Exposure
from wrt.errors import InputError
from wrt.io.images import save_image
from wrt.rendering.layer_colors import layer_colors
from wrt.scene.layers import NOISY
from wrt.scene.scene import RenderSettings


class Rendered(Protocol):
    """What is written of a `wrt.Renderer`, or of a picture merged of parts; see there."""

    settings: RenderSettings
    integrator: str
    seed: int
    seconds_render: float

    @property
    def spp(self) -> int:
        """Samples per pixel."""

    @property
    def renders_light(self) -> bool:
        """Whether there is radiance, not only layers."""

    def image(self) -> NDArray[np.float32]:
        """Return the radiance."""

    def denoised(self) -> NDArray[np.float32]:
        """Return the radiance without most of its noise."""

    def alpha(self) -> NDArray[np.float32] | None:
        """Return the coverage of a transparent picture."""

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the layers by name."""


def check_layers(path: Path, layers: Collection[str], *, has_light: bool) -> None:
    """Raise InputError if a file cannot hold the layers of a render.

    OpenEXR files hold all layers. Without light, as with integrator "aov", a PNG may show a single one.
    """
    if not has_light and not layers:
        raise InputError("integrator aov renders only layers; name some, such as albedo,normal,depth")
    shown = path.suffix.lower() == ".png" and not has_light and len(layers) == 1
    if layers and path.suffix.lower() != ".exr" and not shown:
        raise InputError(f"{path}: layers go into OpenEXR files; give it a name that ends in .exr")


def write_picture(
    renderer: Rendered, path: Path, tone: str | None, exposure: Exposure, *, force: bool
) -> Developed | None:
    """Write a render with its layers and metadata; see `Renderer.save`.

    Returns:
        How radiance was developed to 8 bits, or None if it was not.

    Raises:
        InputError: see `check_layers` and `wrt.save_image`.
    """
    settings, layers, alpha = renderer.settings, renderer.layers(), renderer.alpha()
    save = functools.partial(save_image, path, metadata=_metadata(renderer), force=force)
    check_layers(path, layers, has_light=renderer.renders_light)
    suffix = path.suffix.lower()
    if not renderer.renders_light:
        if suffix == ".exr":
            return save(None, layers=layers)
        ((name, values),) = layers.items()
        return save(layer_colors(name, values), tone="none", exposure=0.0)
    image = renderer.denoised() if settings.denoise else renderer.image()
    if suffix != ".png":
        if settings.denoise and suffix == ".exr":
            layers[NOISY] = renderer.image()
        return save(image, alpha=alpha, layers=layers)
    # What is not covered has no say in the exposure.
    seen = image if alpha is None or not alpha.any() else image[alpha > 0.0] / alpha[alpha > 0.0, None]
    chosen = stops(seen if seen.ndim == 3 else seen[None], settings.exposure if exposure is None else exposure)
    return save(image, alpha=alpha, tone=settings.tone if tone is None else tone, exposure=chosen)


def _metadata(renderer: Rendered) -> dict[str, object]:
    return {
        "Software": f"wrt {__version__}",
        "Integrator": renderer.integrator,
        "Samples per pixel": renderer.spp,
        "Seed": renderer.seed,
        "Render seconds": f"{renderer.seconds_render:.1f}",
    }
