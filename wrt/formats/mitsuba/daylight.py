"""Sun and sky: Mitsuba's `sunsky`, by the same model and tables, with its sun as its RGB variants add it up."""

from __future__ import annotations

import dataclasses
import math
from datetime import date

import numpy as np
from numpy.typing import NDArray

from wrt.environment import ConstantEnvironment, Environment, SunSkyEnvironment
from wrt.formats.mitsuba.observer import OBSERVER
from wrt.formats.mitsuba.observer import WAVELENGTHS as OBSERVED
from wrt.formats.mitsuba.plugin import Plugin
from wrt.formats.mitsuba.spectra import RGB_FROM_XYZ
from wrt.formats.mitsuba.textures import Textures
from wrt.formats.mitsuba.transforms import axis_and_degrees, rotation_part
from wrt.hosek_wilkie import WAVELENGTHS, sun_spectrum
from wrt.lights import DirectionalLight
from wrt.values import Vec3

Array = NDArray[np.float64]

SCALE = 1.0 / 106.7502593994140625
"""From W·sr⁻¹·m⁻² to Mitsuba's radiance, which is a mean over wavelengths."""

_DIAMETER = 0.5358
"""Of Mitsuba's sun, degrees."""

_SUM = 467.069280386 / 11.0 * 0.9989
"""Mitsuba takes 467.07 nm times the mean of eleven wavelengths that are 40 nm apart for an integral, which is 6 % too
much. The other factor is what its table of irradiance has less than the model, at all heights and hazes alike."""

_Y_UP = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
"""From the axes of `sunsky`, with z upwards, to those of the older `sky` and `sun`."""

_PLACE = {"latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0}
_DATE = {"year": 2010, "month": 7, "day": 10}
_TIME = {"hour": 15.0, "minute": 0.0, "second": 0.0}


def daylight(plugin: Plugin, textures: Textures) -> tuple[Environment, DirectionalLight | None]:
    """Return the sky of a `sunsky`, and its sun; no light where the sun is below the horizon.

    Raises:
        InputError: where a number in it is out of range.
    """
    axes, _, plain = rotation_part(plugin.transform())
    if not plain:
        plugin.warn("'to_world' slants, which is left out")
    if plugin.type != "sunsky":
        plugin.warn("taken as a 'sunsky' of Mitsuba 3")
        plugin.ignore("sun_radius_scale", "resolution", "stretch", "extend")
        axes = axes @ _Y_UP
    if plugin.boolean("complex_sun", False):
        plugin.warn("the sun's limb is not darkened; it is as bright all over as in the mean")
    to_sun = _to_sun(plugin, axes)
    up = axes @ (0.0, 0.0, 1.0)
    height = float(np.clip(to_sun @ up, -1.0, 1.0))
    turbidity = plugin.number("turbidity", 3.0)
    scale = plugin.number("scale", 1.0)
    sky_scale, sun_scale = (scale * plugin.number(name, 1.0) for name in ("sky_scale", "sun_scale"))
    diameter = plugin.number("sun_aperture", _DIAMETER)
    upright = _upright(up)
    sky = SunSkyEnvironment(
        sun_direction=_vec(upright @ (to_sun if height > 0.0 else up)),
        turbidity=turbidity,
        ground_albedo=textures.constant(plugin, "albedo", 0.3),
        sky_scale=0.0 if plugin.type == "sun" else SCALE * sky_scale,
        sun_scale=0.0,
        ground=False,
    )
    if height <= 0.0:
        plugin.warn("the sun is below the horizon: no light")
        return ConstantEnvironment(0.0), None
    sun = None
    if sun_scale > 0.0 and plugin.type != "sky":
        # Radiance times solid angle, 1 − cos of half the diameter, stays; irradiance is radiance times π sin².
        share = (1.0 - math.cos(0.5 * math.radians(_DIAMETER))) * (1.0 + math.cos(0.5 * math.radians(diameter)))
        irradiance = sun_scale * math.pi * share * sun_radiance(math.asin(height), turbidity)
        sun = DirectionalLight(_vec(-to_sun), _vec(irradiance), angle_degrees=diameter)
    if np.allclose(upright, np.eye(3)):
        return sky, sun
    image, _ = sky.image_and_sun()
    axis, degrees = axis_and_degrees(upright.T)
    return dataclasses.replace(image, rotation_degrees=degrees, rotation_axis=axis), sun


def sun_radiance(elevation: float, turbidity: float) -> Array:
    """Return the radiance of Mitsuba's sun in its RGB variants, (3,), not below 0.

    Its table has a height every three degrees, from two on; between them it is straight.

    Args:
        elevation: of the sun above the horizon, radians.
        turbidity: 1 to 10.
    """
    place = min(max((math.degrees(elevation) - 2.0) / 3.0, 0.0), 29.0)
    low = min(int(place), 28)
    lower, upper = (sun_spectrum(math.radians(2.0 + 3.0 * i), turbidity) for i in (low, low + 1))
    spectrum = lower + (place - low) * (upper - lower)
    observer = np.stack([np.interp(WAVELENGTHS, OBSERVED, column, left=0.0) for column in OBSERVER.T], axis=1)
    radiance = RGB_FROM_XYZ @ (spectrum @ observer)
    return np.asarray(np.maximum(radiance, 0.0) * _SUM * SCALE)


def _to_sun(plugin: Plugin, axes: Array) -> Array:
    """Return the unit vector to the sun in the world: given there, or by date and place in the sky's own axes."""
    if plugin.has("sun_direction"):
        if any(plugin.has(name) for name in (*_PLACE, *_DATE, *_TIME)):
            raise plugin.error("the sun is given by 'sun_direction', or by date and place: choose one of both")
        direction = np.array(plugin.point("sun_direction", (0.0, 0.0, 1.0)))
        length = float(np.linalg.norm(direction))
        if length == 0.0:
            raise plugin.error("'sun_direction' must not be zero")
        return np.asarray(direction / length)
    values = {name: plugin.number(name, default) for name, default in (_PLACE | _TIME).items()}
    values |= {name: plugin.whole(name, default) for name, default in _DATE.items()}
    for name, value in values.items():
        if not abs(value) < 1e6:
            raise plugin.error(f"{name!r} is out of range: {str(value)[:20]}")
    hours = values["hour"] - values["timezone"] + (values["minute"] + values["second"] / 60.0) / 60.0
    year, month, day = (int(values[name]) for name in _DATE)
    zenith, azimuth = sun_position(year, month, day, hours, values["latitude"], values["longitude"])
    # x is south, as Mitsuba computes it, whatever its page says.
    flat = math.sin(zenith)
    local = (flat * math.cos(azimuth - math.pi), flat * math.sin(azimuth - math.pi), math.cos(zenith))
    return np.asarray(axes @ np.array(local))


def sun_position(
    year: int, month: int, day: int, hours: float, latitude: float, longitude: float
) -> tuple[float, float]:
    """Return where the sun stands: its angle to the zenith and from north towards east, radians.

    Blanco-Muriel et al., "Computing the Solar Vector" (Solar Energy 70(5), 2001): within half a minute of arc from
    1999 to 2015, without refraction.

    Args:
        year: of the Gregorian calendar.
        month: 1 to 12.
        day: of the month.
        hours: of the day in Universal Time; may be below 0 or above 24.
        latitude: degrees, north is positive.
        longitude: degrees, east is positive.
    """
    # Days since noon of 1 January 2000. Python's ordinal 730120 is that day.
    first = (month - 1) % 12
    start = date(min(max(year + (month - 1) // 12, 1), 9999), first + 1, 1).toordinal()
    days = start + day - 1 - 730120 - 0.5 + hours / 24.0

    # Where on the ecliptic, and how that leans.
    node = 2.1429 - 0.0010394594 * days
    anomaly = 6.2400600 + 0.0172019699 * days
    along = 4.8950630 + 0.017202791698 * days + 0.03341607 * math.sin(anomaly) + 0.00034894 * math.sin(2.0 * anomaly)
    along -= 0.0001134 + 0.0000203 * math.sin(node)
    lean = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(node)

    # On the sky, and as seen from the place.
    ascension = math.atan2(math.cos(lean) * math.sin(along), math.cos(along))
    declination = math.asin(math.sin(lean) * math.sin(along))
    sidereal = math.radians((6.6974243242 + 0.0657098283 * days + hours) * 15.0 + longitude)
    angle, north = sidereal - ascension, math.radians(latitude)
    cosine = math.cos(north) * math.cos(angle) * math.cos(declination) + math.sin(declination) * math.sin(north)
    zenith = math.acos(min(max(cosine, -1.0), 1.0))
    azimuth = math.atan2(-math.sin(angle), math.tan(declination) * math.cos(north) - math.sin(north) * math.cos(angle))
    # From the surface the sun is lower than from the middle of the earth.
    return zenith + 6371.01 / 149597890.0 * math.sin(zenith), azimuth % (2.0 * math.pi)


def _upright(up: Array) -> Array:
    """Return the turn by which a direction becomes y."""
    if np.allclose(up, (0.0, 1.0, 0.0), atol=1e-6):
        return np.eye(3)
    # The rows are where x, y and z of the upright world are.
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)])


def _vec(value: Array) -> Vec3:
    x, y, z = (float(each) for each in value)
    return x, y, z
