"""Lights and cameras of USD files.

Format: OpenUSD, UsdLux and UsdGeomCamera. A light's radiance is its intensity times two to its exposure times its
colour; with `normalize` that divided by its area.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.lights import DirectionalLight, DiskLight, Light, PointLight, RectangleLight, SphereLight
from wrt.values import Vec3, vec3

Matrix = NDArray[np.float64]

LIGHT_KINDS = ("SphereLight", "RectLight", "DiskLight", "DistantLight")


def radiance_of(prim: Any) -> Vec3:
    """Return the radiance of a light before it is normalised."""
    from pxr import UsdLux

    light = UsdLux.LightAPI(prim)
    color = np.array(light.GetColorAttr().Get(), np.float64)
    if light.GetEnableColorTemperatureAttr().Get():
        color = color * _white(float(light.GetColorTemperatureAttr().Get()))
    return vec3(color * float(light.GetIntensityAttr().Get()) * 2.0 ** float(light.GetExposureAttr().Get()))


def _white(kelvin: float) -> NDArray[np.float64]:
    """Return the colour of a black body, of luminance 1."""
    from wrt.io.mitsuba.spectra import blackbody, emitted

    color = np.maximum(np.asarray(emitted(blackbody(kelvin)), np.float64), 0.0)
    return np.asarray(color / product(color, np.array([0.2126, 0.7152, 0.0722])))


def light_of(prim: Any, kind: str, matrix: Matrix) -> Light:
    """Return a light; all but those far away are exact shapes."""
    from pxr import UsdLux

    radiance = np.array(radiance_of(prim))
    normalized = bool(UsdLux.LightAPI(prim).GetNormalizeAttr().Get())
    x, y, z, center = matrix[:3].T
    if kind == "DistantLight":
        angle = float(UsdLux.DistantLight(prim).GetAngleAttr().Get())
        # Of a disk of radiance L; given as the irradiance E if normalised or a point.
        sine = math.sin(math.radians(0.5 * angle))
        irradiance = radiance if normalized or angle == 0.0 else radiance * math.pi * sine * sine
        return DirectionalLight(vec3(-z), irradiance=vec3(irradiance), angle_degrees=angle if angle >= 1e-3 else 0.0)
    if kind == "RectLight":
        given = UsdLux.RectLight(prim)
        u = x * float(given.GetWidthAttr().Get())
        v = y * float(given.GetHeightAttr().Get())
        v = v - u * product(u, v) / product(u, u)
        area = norm(np.cross(u, v))
        radiance = radiance / area if normalized else radiance
        # It shines along −z: its edges run the other way round.
        return RectangleLight(vec3(center - 0.5 * (u + v)), vec3(v), vec3(u), vec3(radiance))
    if kind == "DiskLight":
        radius = float(UsdLux.DiskLight(prim).GetRadiusAttr().Get()) * norm(x)
        radiance = radiance / (math.pi * radius * radius) if normalized else radiance
        return DiskLight(vec3(center), vec3(-z), radius, vec3(radiance))
    ball = UsdLux.SphereLight(prim)
    radius = float(ball.GetRadiusAttr().Get()) * norm(x)
    area = 4.0 * math.pi * radius * radius
    if ball.GetTreatAsPointAttr().Get() or radius == 0.0:
        return PointLight(vec3(center), intensity=vec3(radiance / 4.0 if normalized else 0.25 * area * radiance))
    return SphereLight(vec3(center), radius, vec3(radiance / area if normalized else radiance))


def camera_of(camera: Any, matrix: Matrix, scale: float) -> Camera:
    """Return a camera that looks along −z of its node; its apertures and focal length are in tenths of a unit."""
    origin, back, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
    forward = -back / norm(back)
    place: dict[str, Any] = {"origin": vec3(origin), "target": vec3(origin + forward), "up": vec3(up)}
    height = float(camera.GetVerticalApertureAttr().Get())
    if str(camera.GetProjectionAttr().Get()) == "orthographic":
        return OrthographicCamera(**place, view_height=0.1 * height * scale)
    focal = float(camera.GetFocalLengthAttr().Get())
    f_stop, distance = float(camera.GetFStopAttr().Get() or 0.0), float(camera.GetFocusDistanceAttr().Get() or 0.0)
    lens: dict[str, Any] = {}
    if f_stop > 0.0 and distance > 0.0:
        lens = {"aperture_radius": 0.05 * focal * scale / f_stop, "focus_distance": distance * scale}
    return PerspectiveCamera(**place, **lens, fov_degrees=math.degrees(2.0 * math.atan(0.5 * height / focal)))
