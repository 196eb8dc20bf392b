"""Environments: light from infinitely far away in every direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import norm, product, weighted_sum
from wrt.scene.description import Color, Description, Flag, GroupName, NotNegative, Number, optional
from wrt.scene.lights import DirectionalLight
from wrt.scene.skies.hosek_wilkie import sky_rgb, sun_rgb
from wrt.values import ColorLike, Vec3, color, image, number, owned, sealed, vec3, vector

SUN_DIAMETER_DEGREES = 0.53
"""The sun's mean angular diameter."""

_SKY_HEIGHT = 512
"""Rows of the image of a sky; even, so the horizon lies between two rows."""

_HARMONICS_ROWS = 64
"""Image rows per degree of spherical harmonics; see `SphericalHarmonicsEnvironment`."""

_MOST_DEGREE = 16


def _axis(value: Vec3, name: str) -> Vec3:
    axis = vector(value, name)
    if not any(axis):
        raise InputError(f"{name} must not be zero")
    return axis


def _direction(value: Vec3, name: str) -> Vec3:
    axis = _axis(value, name)
    return vec3(np.array(axis) / norm(axis))


@dataclass(frozen=True, eq=False)
class _Environment(Description):
    """Base of all environments.

    Attributes:
        group: name of its light group; without one it is in the group "rest".
    """

    group: GroupName = field(default=None, kw_only=True)


@dataclass(frozen=True)
class ConstantEnvironment(_Environment):
    """The same radiance from every direction.

    Attributes:
        radiance: per channel, W·sr⁻¹·m⁻².
    """

    radiance: Color = 1.0


@dataclass(frozen=True, eq=False)
class ImageEnvironment(_Environment):
    """Radiance from an image in latitude-longitude layout, importance-sampled by luminance.

    Row 0 is straight up (+y). At rotation 0 the centre column is the direction −z and columns to its right turn
    towards +x, as seen when looking along −z.

    Attributes:
        pixels: (H, W, 3) float32, linear radiance, W·sr⁻¹·m⁻².
        scale: multiplies the pixels.
        rotation_degrees: turns the environment about +y, counter-clockwise seen from above.
        name: source of the pixels, for messages.
        rotation_axis: axis to turn about instead, counter-clockwise seen from its tip.
    """

    pixels: Annotated[NDArray[np.float32], image] = field(repr=False)
    scale: NotNegative = 1.0
    rotation_degrees: Number = 0.0
    name: str = "environment"
    rotation_axis: Annotated[Vec3, _axis] = (0.0, 1.0, 0.0)

    def _label(self, name: str) -> str:
        return f"environment {self.name}: {name}" if name == "pixels" else name


def _coefficients(value: ArrayLike, name: str) -> NDArray[np.float64]:
    values = owned(value, name, np.float64)
    if values.ndim == 1:
        values = sealed(np.repeat(values[:, None], 3, axis=1))
    count = len(values) if values.ndim else 0
    if values.ndim != 2 or values.shape[1] != 3 or math.isqrt(count) ** 2 != count or count == 0:
        raise InputError(f"{name} must be 1, 4, 9, 16, ... rows of three numbers, not {values.shape}")
    if count > (_MOST_DEGREE + 1) ** 2:
        raise InputError(f"{name} must be at most {(_MOST_DEGREE + 1) ** 2}, not {count}")
    if not np.isfinite(values).all():
        raise InputError(f"{name} must be finite numbers")
    return values


@dataclass(frozen=True, eq=False)
class SphericalHarmonicsEnvironment(_Environment):
    """Radiance as a sum of real spherical harmonics; negative values count as 0.

    The basis is orthonormal, in the world's x, y and z with z as the polar axis, without the Condon-Shortley sign
    (`wrt.scene.environment.harmonics`). A constant radiance L has the single coefficient L √(4π).

    It is converted to an image of 64 rows per degree l. Along any great circle, a sum of harmonics up to degree l
    changes no faster than l times its maximum (Bernstein). So the error of interpolation between texels is at most
    (π/64)²/4 = 0.06 % of the maximum, and π/128 = 2.5 % within half a texel of the poles.

    Attributes:
        coefficients: ((l + 1)², 3), row l² + l + m, W·sr⁻¹·m⁻²; for greys also ((l + 1)²,). l is 16 at most.
        scale: multiplies the coefficients.
    """

    coefficients: Annotated[ArrayLike, _coefficients] = field(repr=False)
    scale: NotNegative = 1.0

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
        pixels = sealed(pixels.astype(np.float32))
        return ImageEnvironment(pixels, self.scale, name="spherical harmonics", group=self.group)


@dataclass(frozen=True)
class SunSkyEnvironment(_Environment):
    """A clear daytime sky with the sun, above a flat diffuse ground.

    The model is that of Hošek and Wilkie (2012, 2013; `wrt.scene.skies.hosek_wilkie`). The sun is a uniform disk of
    0.53 degrees. The ground reflects the irradiance of sun and sky uniformly. Radiance is absolute: a few W·sr⁻¹·m⁻² in
    the sky and over 10⁶ in the sun. Irradiance exceeds 100 W·m⁻², so pictures are exposed automatically unless an
    exposure is given. At −5.5 stops a white surface (reflectance 0.8) under a sun at 45 degrees has three quarters of
    full brightness; a low sun needs about −5.

    Attributes:
        elevation_degrees: elevation of the sun above the horizon, above 0 to 90.
        azimuth_degrees: azimuth of the sun, from −z towards +x.
        sun_direction: direction to the sun, instead of both angles; any length but zero.
        turbidity: haziness of the air, 1 to 10: 2 very clear, 3 clear, 6 hazy, 10 thick haze.
        ground_albedo: reflectance of the ground per channel, 0 to 1. It also brightens the sky.
        sky_scale: multiplies the radiance of sky and ground.
        sun_scale: multiplies the radiance of the sun; 0 removes it from the sky, not from the light on the ground.
        ground: whether there is ground; otherwise it is black below the horizon.
    """

    elevation_degrees: Annotated[float, partial(number, above=0.0, maximum=90.0)] = 45.0
    azimuth_degrees: Number = 0.0
    sun_direction: Annotated[Vec3 | None, optional(_direction)] = None
    turbidity: Annotated[float, partial(number, minimum=1.0, maximum=10.0)] = 3.0
    ground_albedo: Annotated[ColorLike, partial(color, maximum=1.0)] = 0.2
    sky_scale: NotNegative = 1.0
    sun_scale: NotNegative = 1.0
    ground: Flag = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sun_direction is not None:
            x, y, z = self.sun_direction
            elevation, azimuth = math.degrees(math.asin(y)), math.degrees(math.atan2(x, -z))
            if elevation <= 0.0:
                raise InputError(f"sun_direction must point above the horizon; its elevation is {elevation:g} degrees")
            self._set(elevation_degrees=elevation, azimuth_degrees=azimuth)

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
        sky = sky_rgb(cos_zenith, cos_sun, elevation, self.turbidity, self.ground_albedo)  # type: ignore[arg-type]
        sun = sun_rgb(elevation, self.turbidity)
        irradiance = sun * math.pi * math.sin(0.5 * math.radians(SUN_DIAMETER_DEGREES)) ** 2

        pixels = np.zeros((*directions.shape[:2], 3), np.float32)
        pixels[: len(sky)] = sky
        if self.ground:
            down = self._received(sky) + irradiance * math.sin(elevation)
            pixels[len(sky) :] = np.asarray(self.ground_albedo) * down / math.pi
        image = ImageEnvironment(sealed(pixels), self.sky_scale, name="sky", group=self.group)
        if self.sun_scale == 0.0:
            return image, None
        direction = tuple(-x for x in self.to_sun)
        return image, DirectionalLight(
            direction,  # type: ignore[arg-type]
            tuple(float(x) for x in irradiance * self.sun_scale),
            angle_degrees=SUN_DIAMETER_DEGREES,
            group=self.group,
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


def harmonics(degree: int, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of all real spherical harmonics up to a degree, (N, (degree + 1)²), at unit vectors (N, 3).

    They are orthonormal over the sphere, in the world's x, y and z with z as the polar axis, without the
    Condon-Shortley sign: the convention of Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance
    Environment Maps" (2001), equation 3, and of Sloan, "Stupid Spherical Harmonics Tricks" (2008), except for his sign
    (−1)^m:

        Y₀₀ = 0.282095,  Y₁₋₁ = 0.488603 y,  Y₁₀ = 0.488603 z,  Y₁₁ = 0.488603 x,
        Y₂₋₂ = 1.092548 xy,  Y₂₋₁ = 1.092548 yz,  Y₂₀ = 0.315392 (3z² − 1),  Y₂₁ = 1.092548 xz,
        Y₂₂ = 0.546274 (x² − y²).

    The coefficient of Y_lm has the index l² + l + m.

    sin^m θ cos mφ and sin^m θ sin mφ are the real and the imaginary part of (x + iy)^m. The other factor of the
    associated Legendre functions is a polynomial in z, given by the usual recurrence (Sloan 2008, appendix A1).
    """
    x, y, z = np.asarray(directions, np.float64).T
    values = np.empty((len(z), (degree + 1) ** 2))
    turning = np.ones(len(z), np.complex128)
    diagonal = 1.0
    for m in range(degree + 1):
        before, legendre = np.zeros_like(z), np.full_like(z, diagonal)
        for l in range(m, degree + 1):  # noqa: E741 (the customary name)
            norm = math.sqrt((2 * l + 1) / (4.0 * math.pi) * math.factorial(l - m) / math.factorial(l + m))
            if m == 0:
                values[:, l * l + l] = norm * legendre
            else:
                values[:, l * l + l + m] = math.sqrt(2.0) * norm * legendre * turning.real
                values[:, l * l + l - m] = math.sqrt(2.0) * norm * legendre * turning.imag
            before, legendre = legendre, ((2 * l + 1) * z * legendre - (l + m) * before) / (l - m + 1)
        turning = turning * (x + 1j * y)
        diagonal *= 2 * m + 1
    return values
