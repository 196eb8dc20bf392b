"""Sun and sky: Mitsuba's `sunsky`, by the same model and tables, with the sun's colour of its RGB variants."""

from __future__ import annotations

import dataclasses
import math
from datetime import date

import numpy as np
from numpy.typing import NDArray

from wrt.io.measured.observer import OBSERVER, RGB_FROM_XYZ
from wrt.io.measured.observer import WAVELENGTHS as OBSERVED
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.textures import Textures
from wrt.io.mitsuba.transforms import axis_and_degrees
from wrt.linalg import norm, product
from wrt.scene.environment import ConstantEnvironment, Environment, SunSkyEnvironment
from wrt.scene.lights import DirectionalLight
from wrt.scene.skies.hosek_wilkie import WAVELENGTHS, sun_spectrum
from wrt.values import vec3

Array = NDArray[np.float64]

SCALE = 1.0 / 106.7502593994140625  # converts W·sr⁻¹·m⁻² to Mitsuba's radiance, which is a mean over wavelengths
_DIAMETER = 0.5358  # angular diameter of Mitsuba's sun, degrees

_SUM = 467.069280386 / 11.0 * 0.9989
"""Mitsuba integrates over wavelengths as 467.07 nm times the mean of eleven samples 40 nm apart, which is 6 % too much.
The last factor is the ratio of its irradiance table to the model, the same at all elevations and turbidities."""

_Y_UP = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
"""Rotates the axes of `sunsky`, with z up, to those of the older `sky` and `sun`, and of all three before version 2."""

_PLACE = {"latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0}
_DATE = {"year": 2010, "month": 7, "day": 10}
_TIME = {"hour": 15.0, "minute": 0.0, "second": 0.0}


def daylight(plugin: Plugin, textures: Textures) -> list[Environment | DirectionalLight]:
    """Return the sky of a `sunsky` and its sun; a black sky alone if the sun is below the horizon."""
    axes, _ = plugin.axes()
    if plugin.type != "sunsky" or plugin.document.old:
        plugin.warn("taken as a 'sunsky' of Mitsuba 3")
        plugin.ignore("sun_radius_scale", "resolution", "stretch", "extend")
        axes = product(axes, _Y_UP)
    if plugin.boolean("complex_sun", False):
        plugin.warn("limb darkening of the sun is left out; it is uniform with the same mean")
    to_sun = _to_sun(plugin, axes)
    up = product(axes, (0.0, 0.0, 1.0))
    height = float(np.clip(product(to_sun, up), -1.0, 1.0))
    turbidity = plugin.number("turbidity", 3.0)
    scale = plugin.number("scale", 1.0)
    sky_scale, sun_scale = (scale * plugin.number(name, 1.0) for name in ("sky_scale", "sun_scale"))
    diameter = plugin.number("sun_aperture", _DIAMETER)
    upright = _upright(up)
    sky = SunSkyEnvironment(
        sun_direction=vec3(product(upright, to_sun if height > 0.0 else up)),
        turbidity=turbidity,
        ground_albedo=textures.constant(plugin, "albedo", 0.3),
        sky_scale=0.0 if plugin.type == "sun" else SCALE * sky_scale,
        sun_scale=0.0,
        ground=False,
    )
    if height <= 0.0:
        plugin.warn("the sun is below the horizon: no light")
        return [ConstantEnvironment(0.0)]
    made: list[Environment | DirectionalLight] = [sky]
    if not np.allclose(upright, np.eye(3)):
        image, _ = sky.image_and_sun()
        axis, degrees = axis_and_degrees(upright.T)
        made = [dataclasses.replace(image, rotation_degrees=degrees, rotation_axis=axis)]
    if sun_scale > 0.0 and plugin.type != "sky":
        # Keep radiance times solid angle, which grows as 1 − cos(diameter / 2); irradiance is radiance times π sin².
        share = (1.0 - math.cos(0.5 * math.radians(_DIAMETER))) * (1.0 + math.cos(0.5 * math.radians(diameter)))
        irradiance = sun_scale * math.pi * share * sun_radiance(math.asin(height), turbidity)
        made.append(DirectionalLight(vec3(-to_sun), vec3(irradiance), angle_degrees=diameter))
    return made


def sun_radiance(elevation: float, turbidity: float) -> Array:
    """Return the radiance (3,) of Mitsuba's sun in its RGB variants, at an elevation in radians.

    Like Mitsuba's table, it interpolates linearly between elevations three degrees apart, from two degrees on.
    """
    place = min(max((math.degrees(elevation) - 2.0) / 3.0, 0.0), 29.0)
    low = min(int(place), 28)
    lower, upper = (sun_spectrum(math.radians(2.0 + 3.0 * i), turbidity) for i in (low, low + 1))
    spectrum = lower + (place - low) * (upper - lower)
    observer = np.stack([np.interp(WAVELENGTHS, OBSERVED, column, left=0.0) for column in OBSERVER.T], axis=1)
    radiance = product(RGB_FROM_XYZ, product(spectrum, observer))
    return np.asarray(np.maximum(radiance, 0.0) * _SUM * SCALE)


def _to_sun(plugin: Plugin, axes: Array) -> Array:
    """Return the unit vector to the sun in world space, given directly or by date and place in the sky's axes."""
    if plugin.has("sun_direction"):
        if any(plugin.has(name) for name in (*_PLACE, *_DATE, *_TIME)):
            raise plugin.error("the sun is given by 'sun_direction' or by date and place, not both")
        direction = np.array(plugin.point("sun_direction", (0.0, 0.0, 1.0)))
        length = norm(direction)
        if length == 0.0:
            raise plugin.error("'sun_direction' must not be zero")
        return np.asarray(direction / length)
    values = {name: plugin.number(name, default) for name, default in (_PLACE | _TIME).items()}
    values |= {name: plugin.integer(name, default) for name, default in _DATE.items()}
    for name, value in values.items():
        if not abs(value) < 1e6:
            raise plugin.error(f"{name!r} is out of range: {str(value)[:20]}")
    hours = values["hour"] - values["timezone"] + (values["minute"] + values["second"] / 60.0) / 60.0
    year, month, day = (int(values[name]) for name in _DATE)
    zenith, azimuth = sun_position(year, month, day, hours, values["latitude"], values["longitude"])
    # Mitsuba computes with x to the south, although its documentation says otherwise.
    flat = math.sin(zenith)
    local = (flat * math.cos(azimuth - math.pi), flat * math.sin(azimuth - math.pi), math.cos(zenith))
    return np.asarray(product(axes, np.array(local)))


def sun_position(
    year: int, month: int, day: int, hours: float, latitude: float, longitude: float
) -> tuple[float, float]:
    """Return the zenith angle of the sun, and its azimuth from north towards east, in radians.

    Hours are in Universal Time and may be below 0 or above 24; latitude and longitude are in degrees, positive to north
    and east. Blanco-Muriel et al., "Computing the Solar Vector" (Solar Energy 70(5), 2001): accurate to half an
    arcminute from 1999 to 2015, without refraction.
    """
    # Days since noon of 1 January 2000, which is Python's ordinal 730120.
    first = (month - 1) % 12
    start = date(min(max(year + (month - 1) // 12, 1), 9999), first + 1, 1).toordinal()
    days = start + day - 1 - 730120 - 0.5 + hours / 24.0

    # Ecliptic longitude, and obliquity of the ecliptic.
    node = 2.1429 - 0.0010394594 * days
    anomaly = 6.2400600 + 0.0172019699 * days
    along = 4.8950630 + 0.017202791698 * days + 0.03341607 * math.sin(anomaly) + 0.00034894 * math.sin(2.0 * anomaly)
    along -= 0.0001134 + 0.0000203 * math.sin(node)
    lean = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(node)

    # Celestial coordinates, then local ones.
    ascension = math.atan2(math.cos(lean) * math.sin(along), math.cos(along))
    declination = math.asin(math.sin(lean) * math.sin(along))
    sidereal = math.radians((6.6974243242 + 0.0657098283 * days + hours) * 15.0 + longitude)
    angle, north = sidereal - ascension, math.radians(latitude)
    cosine = math.cos(north) * math.cos(angle) * math.cos(declination) + math.sin(declination) * math.sin(north)
    zenith = math.acos(min(max(cosine, -1.0), 1.0))
    azimuth = math.atan2(-math.sin(angle), math.tan(declination) * math.cos(north) - math.sin(north) * math.cos(angle))
    # Parallax: the sun is lower seen from the surface than from the centre of the earth.
    return zenith + 6371.01 / 149597890.0 * math.sin(zenith), azimuth % (2.0 * math.pi)


def _upright(up: Array) -> Array:
    """Return the rotation that takes a direction to y."""
    if np.allclose(up, (0.0, 1.0, 0.0), atol=1e-6):
        return np.eye(3)
    # The rows are the axes x, y and z of the rotated frame.
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 0.0, 1.0))
    side /= norm(side)
    return np.stack([side, up, np.cross(side, up)])
