"""Lights and cameras of USD files.

Format: OpenUSD, UsdLux and UsdGeomCamera. A light's radiance is its intensity times two to its exposure times its
colour; with `normalize` that divided by its area.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io.mesh.parts import viewpoint
from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.lights import DirectionalLight, DiskLight, Light, PointLight, RectangleLight, SphereLight
from wrt.values import Vec3, number, vec3, vector

Matrix = NDArray[np.float64]

_MOST_STOPS = 1000.0
"""Exposure at which a radiance is still a floating-point number."""


class Values:
    """The values of a prim's attributes."""

    def __init__(self, values: dict[str, Any], name: str) -> None:
        """Take values as the process that read them sent them; `name` is what messages call the prim."""
        self._values, self._name = values, name

    def number(self, key: str, **limits: float) -> float:
        """Return a number within limits, or raise InputError."""
        return number(self._values.get(key), f"{self._name}: its {key.removeprefix('inputs:')}", **limits)

    def color(self) -> NDArray[np.float64]:
        """Return the colour of a light, or raise InputError."""
        return np.array(vector(self._values.get("inputs:color"), f"{self._name}: its color"))

    def flag(self, key: str) -> bool:
        """Return whether a flag is set."""
        return self._values.get(key) is True

    def word(self, key: str) -> str:
        """Return a word, or "" if there is none."""
        return str(self._values.get(key) or "")

    def asset(self, key: str) -> str:
        """Return the path of a file, or "" if there is none."""
        return path_of(self._values.get(key))


def path_of(value: Any) -> str:
    """Return the path of an asset; of one within a USDZ archive, `archive[path]`."""
    return str(value.get("asset", "")).replace("\\", "/") if isinstance(value, dict) else ""


def radiance_of(values: Values) -> Vec3:
    """Return the radiance of a light before it is normalised."""
    color = values.color()
    if values.flag("inputs:enableColorTemperature"):
        color = color * _white(values.number("inputs:colorTemperature", above=0.0))
    return vec3(
        color * values.number("inputs:intensity") * 2.0 ** values.number("inputs:exposure", maximum=_MOST_STOPS)
    )


def _white(kelvin: float) -> NDArray[np.float64]:
    """Return the colour of a black body, of luminance 1."""
    from wrt.io.mitsuba.spectra import blackbody, emitted

    color = np.maximum(np.asarray(emitted(blackbody(kelvin)), np.float64), 0.0)
    return np.asarray(color / product(color, np.array([0.2126, 0.7152, 0.0722])))


def light_of(values: Values, kind: str, matrix: Matrix) -> Light:
    """Return a light; all but those far away are exact shapes."""
    radiance = np.array(radiance_of(values))
    normalized = values.flag("inputs:normalize")
    x, y, z, center = matrix[:3].T
    if kind == "DistantLight":
        angle = values.number("inputs:angle")
        # Of a disk of radiance L; given as the irradiance E if normalised or a point.
        sine = math.sin(math.radians(0.5 * angle))
        irradiance = radiance if normalized or angle == 0.0 else radiance * math.pi * sine * sine
        return DirectionalLight(vec3(-z), irradiance=vec3(irradiance), angle_degrees=angle if angle >= 1e-3 else 0.0)
    if kind == "RectLight":
        u = x * values.number("inputs:width")
        v = y * values.number("inputs:height")
        v = v - u * product(u, v) / product(u, u)
        area = norm(np.cross(u, v))
        radiance = radiance / area if normalized else radiance
        # It emits along −z: its edges run the other way round.
        return RectangleLight(vec3(center - 0.5 * (u + v)), vec3(v), vec3(u), vec3(radiance))
    radius = values.number("inputs:radius") * norm(x)
    if kind == "DiskLight":
        radiance = radiance / (math.pi * radius * radius) if normalized else radiance
        return DiskLight(vec3(center), vec3(-z), radius, vec3(radiance))
    area = 4.0 * math.pi * radius * radius
    if values.flag("treatAsPoint") or radius == 0.0:
        return PointLight(vec3(center), intensity=vec3(radiance / 4.0 if normalized else 0.25 * area * radiance))
    return SphereLight(vec3(center), radius, vec3(radiance / area if normalized else radiance))


def camera_of(values: Values, matrix: Matrix, scale: float) -> Camera:
    """Return a camera that looks along −z of its node; its apertures and focal length are in tenths of a unit."""
    height = values.number("verticalAperture")
    right, upwards = (values.number(f"{axis}ApertureOffset") for axis in ("horizontal", "vertical"))
    if values.word("projection") == "orthographic":
        move = np.eye(4)
        move[:2, 3] = 0.1 * right, 0.1 * upwards
        return OrthographicCamera(**viewpoint(product(matrix, move)), view_height=0.1 * height * scale)
    focal = values.number("focalLength", above=0.0)
    f_stop, distance = values.number("fStop"), values.number("focusDistance")
    lens: dict[str, Any] = viewpoint(matrix)
    if height > 0.0:
        lens |= {"shift_x": right / height, "shift_y": upwards / height}
    if f_stop > 0.0 and distance > 0.0:
        lens |= {"aperture_radius": 0.05 * focal * scale / f_stop, "focus_distance": distance * scale}
    return PerspectiveCamera(**lens, fov_degrees=math.degrees(2.0 * math.atan(0.5 * height / focal)))
