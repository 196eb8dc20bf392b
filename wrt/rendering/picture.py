"""The picture that a film holds: its radiance, coverage and layers, and the file they are written to."""

from __future__ import annotations

import functools
import json
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.develop.exposure import stops
from wrt.develop.picture import Composed, Developed, covered
from wrt.errors import InputError
from wrt.io.images import picture_path, require_room, save_image
from wrt.io.safe_read import PathLike
from wrt.rendering.catchers import Caught
from wrt.rendering.film import Film
from wrt.rendering.film_aovs import Labels
from wrt.scene.cryptomatte import TYPES, metadata_of
from wrt.scene.developing import DEVELOPED_SUFFIXES, Exposure
from wrt.scene.layers import LIGHT_GROUPS, NOISY, SHADOW, group_layer
from wrt.scene.scene import RenderSettings
from wrt.scene.srgb import linear_from_srgb


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

    @property
    def has_picture(self) -> bool:
        """True if there is a picture besides the layers: of radiance, or a wireframe."""
        return self.renders_light or self.settings.wireframe

    def image(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32, the current estimate of linear radiance in the rendered part of the picture.

        Raises:
            InputError: before the first pass.
        """
        self._require_samples()
        picture = self._caught()
        return self.film.mean() if picture is None else picture.image

    def _caught(self, *, denoised: bool = False) -> Caught | None:
        """Return the picture of a scene with shadow catchers, else None."""
        return None

    def finished(self) -> NDArray[np.float32]:
        """Return `image`, denoised, with lines and over its background if the settings say so; alpha is channel 4.

        A picture that is transparent, and has no background, is (H, W, 4); see `alpha`.
        """
        self._require_samples()
        return self._composed(self._caught(denoised=self.settings.denoise))

    def _shown(self, picture: Caught | None, *, denoised: bool) -> NDArray[np.float32]:
        if picture is not None:
            return picture.image
        return self.denoised() if denoised and self.renders_light else self.image()

    def _composed(self, picture: Caught | None) -> NDArray[np.float32]:
        image, parts = self._shown(picture, denoised=self.settings.denoise), self._parts(picture)
        composed = Composed.of(image, **parts)
        is_plain = parts["lines"] is None and (parts["alpha"] is None or parts["background"] is None)
        return np.asarray(composed) if is_plain else composed

    def _undeveloped(
        self, exposure: Exposure = None, *, denoised: bool = False
    ) -> tuple[NDArray[np.float32], dict[str, Any], float]:
        """Return what 8-bit codes are developed from: the image, its parts, and the exposure in stops.

        Args:
            exposure: as for `wrt.develop_image`; by default the settings' exposure.
            denoised: whether the image is denoised.
        """
        picture = self._caught(denoised=denoised)
        image, parts = self._shown(picture, denoised=denoised), self._parts(picture)
        # Shadows do not count.
        shown = (image, parts["alpha"]) if picture is None else (picture.foreground, picture.coverage)
        chosen = stops(covered(*shown), self.settings.exposure if exposure is None else exposure)
        if picture is not None:
            image, parts["alpha"] = picture.for_codes(2.0**chosen)
        return image, parts, chosen

    def _parts(self, picture: Caught | None) -> dict[str, Any]:
        """Return what belongs to the image, as `develop` takes it. Lines come after denoising, so they stay sharp."""
        settings = self.settings
        lines = self._share("edges") if settings.edges or settings.wireframe else None
        alpha = lines if settings.wireframe else self._coverage() if picture is None else picture.alpha
        return {"alpha": alpha, "background": settings.paper, "lines": lines, "line_color": settings.edge_color}

    def _require_samples(self) -> None:
        if not self.film.tally().samples:
            raise InputError("there is no picture yet: call render(spp=16), or go through passes(spp=16)")

    @abstractmethod
    def denoised(self) -> NDArray[np.float32]:
        """Return `image` without most of its noise."""

    def alpha(self) -> NDArray[np.float32] | None:
        """Return (H, W) float32 coverage of a transparent picture, 0 to 1, or None.

        It is how much of a pixel shows a surface, or a line of a wireframe. `image` holds the radiance of those alone
        (associated alpha). Shadow catchers count only as far as they are in shadow, and `image` has the light that
        other shapes send there.
        """
        picture = self._caught()
        return self._coverage() if picture is None else picture.alpha

    def _coverage(self) -> NDArray[np.float32] | None:
        """Return `alpha` with shadow catchers as surfaces."""
        name = "edges" if self.settings.wireframe else "alpha"
        return self._share(name) if self.settings.transparent else None

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the selected layers by name: (H, W, channels), or (H, W) for one channel.

        "light_groups" are several: "light_" and the name of each group, whose sum is `image`, and "light_rest". Layers
        are float32, or uint32 for object and material numbers, which count from 1; 0 is the background. Ranked
        coverage is (H, W, 6, 2), pairs of id and coverage; see `wrt.cryptomatte_mask`.

        Raises:
            InputError: before the first pass.
        """
        if not self.settings.layers:
            return {}
        self._require_samples()
        layers = self._film_layers()
        if (picture := self._caught()) is not None:
            layers |= {"alpha": picture.alpha, SHADOW: picture.shadow}
        of_groups = [name for name in layers if name.startswith(group_layer(""))]
        names = [name for name in self.settings.layers if name != LIGHT_GROUPS]
        return {name: layers[name] for name in (*names, *of_groups)}

    def _share(self, name: str) -> NDArray[np.float32]:
        """Return (H, W), the layer "alpha" or "edges", without the work for all others."""
        share: NDArray[np.float32] = self.film.aovs.arrays(self.film.fetch("count"), names=(name,))[name]
        return share

    def _film_layers(self) -> dict[str, NDArray[Any]]:
        return self.film.aovs.arrays(self.film.fetch("count"), self._labels())

    @abstractmethod
    def _labels(self) -> Labels:
        """Return what the numbers of the film's layers stand for."""

    def _names_for(self, path: Path) -> dict[str, str]:
        """Return metadata of a file that name the objects and materials of its layers."""
        labels, names = self._labels(), {}
        for layer, key, listed in (
            ("object", "Objects", labels.objects),
            ("material", "Materials", labels.material_names),
        ):
            if layer in self.settings.layers and path.suffix.lower() in (".exr", ".png"):
                names[key] = json.dumps(dict(enumerate(listed, 1)))
            if f"crypto_{layer}" in self.settings.layers and path.suffix.lower() == ".exr":
                names |= metadata_of(f"crypto_{layer}", listed)
        return names

    def save(
        self, path: PathLike, *, tone: str | None = None, exposure: Exposure = None, force: bool = False
    ) -> Developed | None:
        """Write the picture as `wrt render` does, with its layers, and the settings as metadata.

        Develops a PNG or JPEG with `tone` and `exposure` (see `wrt.develop_image`), by default those of the
        settings, and returns how.

        Raises:
            InputError: see `wrt.save_image`, also for `force`; and when the file cannot hold the layers.
        """
        path, settings, layers = picture_path(path), self.settings, self.layers()
        check_contents(path, self)
        self._require_samples()
        metadata = {
            "Software": f"wrt {__version__}",
            "Integrator": self.integrator,
            "Samples per pixel": self.spp,
            "Seed": self.seed,
            "Render seconds": f"{self.seconds_render:.1f}",
            **self._names_for(path),
        }
        save = functools.partial(save_image, path, metadata=metadata, force=force)
        suffix = path.suffix.lower()
        if not self.has_picture:
            if suffix == ".exr":
                return save(None, layers=layers)
            ((name, values),) = layers.items()
            return save(layer_colors(name, values), tone="none", exposure=0.0)
        if suffix not in DEVELOPED_SUFFIXES:
            picture = self._caught(denoised=settings.denoise)
            if picture is not None and SHADOW in layers:
                layers[SHADOW] = picture.shadow
            if settings.denoise and self.renders_light and suffix == ".exr":
                layers[NOISY] = self.image()
            return save(self._composed(picture), layers=layers)
        image, parts, chosen = self._undeveloped(exposure, denoised=settings.denoise)
        return save(
            image,
            alpha=parts["alpha"],
            tone=settings.tone if tone is None else tone,
            exposure=chosen,
            background=settings.paper,
            edges=parts["lines"],
            edge_color=settings.edge_color,
        )


def check_contents(path: Path, picture: Picture) -> None:
    """Raise InputError if a file cannot hold a render, with its layers and its alpha.

    OpenEXR files hold all layers. Without light, as with integrator "aov", a PNG or JPEG may show a single one.
    """
    layers, has_light = picture.settings.layers, picture.has_picture
    if not has_light and not layers:
        raise InputError("integrator aov renders only layers; name some, such as albedo,normal,depth")
    shown = path.suffix.lower() in DEVELOPED_SUFFIXES and not has_light and len(layers) == 1
    if layers and path.suffix.lower() != ".exr" and not shown:
        raise InputError(f"{path}: layers go into OpenEXR files; give it a name that ends in .exr")
    require_room(
        path,
        *picture.film.picture_size,
        alpha=picture.settings.transparent and picture.settings.paper is None and has_light,
    )


def layer_colors(name: str, values: NDArray[Any]) -> NDArray[np.float32]:
    """Return a layer as (H, W, 3) float32 linear colours, for an 8-bit picture.

    Albedo, coverage and edges are unchanged. Normals map -1 to 1 to 0 to 255. Depth and z are white at the nearest
    point, black at the farthest. Each coordinate of positions runs from black at its lowest to full at its highest.
    Texture coordinates repeat every 1, in red and green. Zero motion is grey, and the longest reaches the limits. Each
    object and material has its own colour, weighted by its coverage if it is ranked.
    """
    if name == "albedo":
        shown = np.asarray(values, np.float64)
    elif name in ("alpha", "edges"):
        shown = np.repeat(np.asarray(values, np.float64)[..., None], 3, axis=2)
    elif name in ("object", "material"):
        shown = _colors(values)
    elif name in TYPES:
        ids, coverage = np.ascontiguousarray(values[..., 0]).view(np.uint32), values[..., 1, None]
        shown = (_colors(ids) * coverage).sum(axis=2)
    else:
        shown = linear_from_srgb(np.clip(_codes(name, np.asarray(values, np.float64)), 0.0, 1.0))
    return shown.astype(np.float32)


def _codes(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sRGB values 0 to 1, so that equal differences of a layer are equal differences of 8-bit codes."""
    if name in ("normal", "geometric_normal"):
        return 0.5 + 0.5 * values
    if name in ("depth", "z"):
        finite = np.isfinite(values)
        low, high = (values[finite].min(), values[finite].max()) if finite.any() else (0.0, 0.0)
        near = np.where(finite, (high - np.where(finite, values, high)) / max(high - low, 1e-30), 0.0)
        # Keep the farthest point distinct from the background.
        return np.repeat((near * 0.95 + 0.05 * finite)[..., None], 3, axis=2)
    if name == "position":
        low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
        scaled: NDArray[np.float64] = (values - low) / np.maximum(high - low, 1e-30)
        return scaled
    red_green = values % 1.0 if name == "uv" else 0.5 + 0.5 * values / max(float(np.abs(values).max()), 1e-30)
    blue = np.full(values.shape[:2], 0.0 if name == "uv" else 0.5)
    return np.concatenate([red_green, blue[..., None]], axis=2)


def _colors(numbers: NDArray[Any]) -> NDArray[np.float64]:
    """Return colours that differ strongly between low numbers; 0 is black."""
    hue = (np.asarray(numbers, np.float64) * 0.6180339887498949) % 1.0
    wave = np.abs((hue[..., None] + np.array([0.0, 2.0 / 3.0, 1.0 / 3.0])) % 1.0 * 6.0 - 3.0) - 1.0
    colors: NDArray[np.float64] = (0.08 + 0.8 * np.clip(wave, 0.0, 1.0)) * (np.asarray(numbers) > 0)[..., None]
    return colors
