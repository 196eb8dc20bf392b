"""Environments: light from infinitely far away in every direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import norm, product, weighted_sum
from wrt.scene.lights import DirectionalLight
from wrt.scene.skies.harmonics import harmonics
from wrt.scene.skies.hosek_wilkie import sky_rgb, sun_rgb
from wrt.scene.skies.preetham import rgb_from_xyz, sky_xyz, sun_xyz
from wrt.values import ColorLike, Vec3, boolean, color, image, number, one_of, owned, sealed, vector

SUN_DIAMETER_DEGREES = 0.53
"""The sun's mean angular diameter."""

_SKY_HEIGHT = 512
"""Rows of the image of a sky; even, so the horizon lies between two rows."""

SKY_MODELS = {"hosek-wilkie": 1.0, "preetham": 2.0}
"""Models of clear skies, with their minimum turbidity."""

_HARMONICS_ROWS = 64
"""Image rows per degree of spherical harmonics; see `SphericalHarmonicsEnvironment`."""

_MOST_DEGREE = 16


@dataclass(frozen=True)
class ConstantEnvironment:
    """The same radiance from every direction.

    Attributes:
        radiance: per channel, W·sr⁻¹·m⁻².
    """

    radiance: ColorLike = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radiance", color(self.radiance, "radiance"))


@dataclass(frozen=True, eq=False)
class ImageEnvironment:
    """Radiance from an image in latitude-longitude layout, importance-sampled by luminance.

    Row 0 is straight up (+y). At rotation 0 the centre column is the direction −z and columns to its right turn
    towards +x, as seen when looking along −z.

    Attributes:
        pixels: (H, W, 3) float32, linear radiance, W·sr⁻¹·m⁻².
        scale: multiplies the pixels.
        rotation_degrees: turns the environment about +y, counter-clockwise seen from above.
        name: source of the pixels, for messages.
        rotation_axis: axis to turn about instead, counter-clockwise for an observer whom it points at.
    """

    pixels: NDArray[np.float32] = field(repr=False)
    scale: float = 1.0
    rotation_degrees: float = 0.0
    name: str = "environment"
    rotation_axis: Vec3 = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", image(self.pixels, f"environment {self.name}"))
        object.__setattr__(self, "scale", number(self.scale, "scale", minimum=0.0))
        object.__setattr__(self, "rotation_degrees", number(self.rotation_degrees, "rotation_degrees"))
        object.__setattr__(self, "rotation_axis", vector(self.rotation_axis, "rotation_axis"))
        if not any(self.rotation_axis):
            raise InputError("rotation_axis must not be zero")


@dataclass(frozen=True, eq=False)
class SphericalHarmonicsEnvironment:
    """Radiance as a sum of real spherical harmonics; negative values count as 0.

    The basis is that of `wrt.scene.skies.harmonics`: orthonormal, in the world's x, y and z with z as the polar axis,
    without the Condon-Shortley sign. A constant radiance L has the single coefficient L √(4π).

    It is converted to an image of 64 rows per degree l. Along any great circle, a sum of harmonics up to degree l
    changes no faster than l times its maximum (Bernstein). So the error of interpolation between texels is at most
    (π/64)²/4 = 0.06 % of the maximum, and π/128 = 2.5 % within half a texel of the poles.

    Attributes:
        coefficients: ((l + 1)², 3), row l² + l + m, W·sr⁻¹·m⁻²; for greys also ((l + 1)²,). l is 16 at most.
        scale: multiplies the coefficients.
    """

    coefficients: ArrayLike = field(repr=False)
    scale: float = 1.0

    def __post_init__(self) -> None:
        try:
            values = owned(self.coefficients, "coefficients", np.float64)
        except InputError:
            values = np.full(1, np.nan)
        if values.ndim == 1:
            values = sealed(np.repeat(values[:, None], 3, axis=1))
        count = len(values)
        if values.ndim != 2 or values.shape[1] != 3 or math.isqrt(count) ** 2 != count or count == 0:
            raise InputError(f"coefficients must be 1, 4, 9, 16, ... rows of three numbers, not {values.shape}")
        if count > (_MOST_DEGREE + 1) ** 2:
            raise InputError(f"coefficients must be at most {(_MOST_DEGREE + 1) ** 2}, not {count}")
        if not np.isfinite(values).all():
            raise InputError("coefficients must be finite numbers")
        object.__setattr__(self, "coefficients", values)
        object.__setattr__(self, "scale", number(self.scale, "scale", minimum=0.0))

    @property
    def degree(self) -> int:
        """The largest degree l."""
        return math.isqrt(len(self.coefficients)) - 1  # type: ignore[arg-type]

    def image(self) -> ImageEnvironment:
        """Return the environment as an image."""
        height = max(_HARMONICS_ROWS * self.degree, 1)
        directions = image_directions(height, 2 * height)
        pixels = product(harmonics(self.degree, directions.reshape(-1, 3)), np.asarray(self.coefficients))
        pixels = np.maximum(pixels, 0.0).reshape(height, 2 * height, 3)
        return ImageEnvironment(sealed(pixels.astype(np.float32)), self.scale, name="spherical harmonics")


@dataclass(frozen=True)
class SunSkyEnvironment:
    """A clear daytime sky with the sun, above a flat diffuse ground.

    The model is "hosek-wilkie" (Hošek and Wilkie 2012, 2013; `wrt.scene.skies.hosek_wilkie`) or "preetham" (Preetham,
    Shirley and Smits 1999; `wrt.scene.skies.preetham`). The sun is a uniform disk of 0.53 degrees. The ground reflects
    the irradiance of sun and sky uniformly. Radiance is absolute: a few W·sr⁻¹·m⁻² in the sky and over 10⁶ in the sun.
    Irradiance exceeds 100 W·m⁻², so pictures are exposed automatically unless an exposure is given. At −5.5 stops a
    white surface (reflectance 0.8) under a sun at 45 degrees has three quarters of full brightness; a low sun needs
    about −5.

    Attributes:
        elevation_degrees: elevation of the sun above the horizon, above 0 to 90.
        azimuth_degrees: azimuth of the sun, from −z towards +x.
        sun_direction: direction to the sun, instead of both angles; any length but zero.
        turbidity: haziness of the air: 2 very clear, 3 clear, 6 hazy, 10 thick haze. At least 1, or 2 for Preetham's
            model.
        ground_albedo: reflectance of the ground per channel, 0 to 1. In Hošek and Wilkie's model it also brightens the
            sky.
        sky_scale: multiplies the radiance of sky and ground.
        sun_scale: multiplies the radiance of the sun; 0 removes it from the sky, but not from the light on the ground.
        ground: whether to show the ground; otherwise everything below the horizon is black.
        model: "hosek-wilkie" or "preetham".
    """

    elevation_degrees: float = 45.0
    azimuth_degrees: float = 0.0
    sun_direction: Vec3 | None = None
    turbidity: float = 3.0
    ground_albedo: ColorLike = 0.2
    sky_scale: float = 1.0
    sun_scale: float = 1.0
    ground: bool = True
    model: str = "hosek-wilkie"

    def __post_init__(self) -> None:
        one_of(self.model, tuple(SKY_MODELS), "model")
        boolean(self.ground, "ground")
        if self.sun_direction is not None:
            direction = np.array(vector(self.sun_direction, "sun_direction"))
            length = norm(direction)
            if length == 0.0:
                raise InputError("sun_direction must not be zero")
            x, y, z = (float(v) for v in direction / length)
            elevation, azimuth = math.degrees(math.asin(y)), math.degrees(math.atan2(x, -z))
            if elevation <= 0.0:
                raise InputError(f"sun_direction must point above the horizon; its elevation is {elevation:g} degrees")
            object.__setattr__(self, "sun_direction", (x, y, z))
            object.__setattr__(self, "elevation_degrees", elevation)
            object.__setattr__(self, "azimuth_degrees", azimuth)
        for name, limits in {
            "elevation_degrees": {"above": 0.0, "maximum": 90.0},
            "azimuth_degrees": {},
            "turbidity": {"minimum": SKY_MODELS[self.model], "maximum": 10.0},
            "sky_scale": {"minimum": 0.0},
            "sun_scale": {"minimum": 0.0},
        }.items():
            object.__setattr__(self, name, number(getattr(self, name), name, **limits))
        object.__setattr__(self, "ground_albedo", color(self.ground_albedo, "ground_albedo", maximum=1.0))

    @property
    def to_sun(self) -> Vec3:
        """Unit vector towards the sun."""
        elevation, azimuth = math.radians(self.elevation_degrees), math.radians(self.azimuth_degrees)
        flat = math.cos(elevation)
        return flat * math.sin(azimuth), math.sin(elevation), -flat * math.cos(azimuth)

    def image_and_sun(self) -> tuple[ImageEnvironment, DirectionalLight | None]:
        """Return the image of sky and ground, and the sun, or None without it."""
        directions = image_directions(_SKY_HEIGHT, 2 * _SKY_HEIGHT)
        upper = directions[: _SKY_HEIGHT // 2]
        cos_zenith, cos_sun = upper[..., 1], weighted_sum(upper, self.to_sun)
        elevation = math.radians(self.elevation_degrees)
        if self.model == "preetham":
            sky = rgb_from_xyz(sky_xyz(cos_zenith, cos_sun, 0.5 * math.pi - elevation, self.turbidity))
            sun = rgb_from_xyz(sun_xyz(0.5 * math.pi - elevation, self.turbidity))
        else:
            sky = sky_rgb(cos_zenith, cos_sun, elevation, self.turbidity, self.ground_albedo)  # type: ignore[arg-type]
            sun = sun_rgb(elevation, self.turbidity)
        irradiance = sun * math.pi * math.sin(0.5 * math.radians(SUN_DIAMETER_DEGREES)) ** 2

        pixels = np.zeros((*directions.shape[:2], 3), np.float32)
        pixels[: len(sky)] = sky
        if self.ground:
            down = self._received(sky) + irradiance * math.sin(elevation)
            pixels[len(sky) :] = np.asarray(self.ground_albedo) * down / math.pi
        image = ImageEnvironment(sealed(pixels), self.sky_scale, name="sky")
        if self.sun_scale == 0.0:
            return image, None
        direction = tuple(-x for x in self.to_sun)
        return image, DirectionalLight(
            direction,  # type: ignore[arg-type]
            tuple(float(x) for x in irradiance * self.sun_scale),
            angle_degrees=SUN_DIAMETER_DEGREES,
        )

    @staticmethod
    def _received(sky: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the irradiance, (3,), of the upper half of an image on the ground."""
        edges = np.cos(np.linspace(0.0, 0.5 * math.pi, len(sky) + 1))
        # The integral of the cosine over the solid angle of a texel, for each row.
        received = 0.5 * (edges[:-1] ** 2 - edges[1:] ** 2) * (2.0 * math.pi / sky.shape[1])
        result: NDArray[np.float64] = (sky * received[:, None, None]).sum(axis=(0, 1))
        return result


Environment: TypeAlias = ConstantEnvironment | ImageEnvironment | SphericalHarmonicsEnvironment | SunSkyEnvironment


def image_directions(height: int, width: int) -> NDArray[np.float64]:
    """Return the unit vectors (height, width, 3) to the centres of an environment image's texels."""
    polar = np.pi * (np.arange(height)[:, None] + 0.5) / height
    azimuth = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    sine = np.sin(polar)
    return np.stack(np.broadcast_arrays(sine * np.sin(azimuth), np.cos(polar), -sine * np.cos(azimuth)), axis=-1)


ENVIRONMENTS: dict[str, type[Any]] = {
    "constant": ConstantEnvironment,
    "image": ImageEnvironment,
    "spherical-harmonics": SphericalHarmonicsEnvironment,
    "sun-sky": SunSkyEnvironment,
}
"""Environments by their `type` in scene files."""
