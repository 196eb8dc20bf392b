"""Read Mitsuba's sensors with their films, filters and samplers, and its integrators."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wrt.io.mitsuba.plugin import Plugin
from wrt.linalg import product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.scene import RenderSettings, Scene

SENSORS = ("perspective", "thinlens", "orthographic")
"""Types of sensors that are cameras."""

UNLIMITED = 65536  # path depth where Mitsuba sets no limit
_MOST_SCATTERINGS = 65535  # highest limit of scattering events that settings may have

_SAMPLERS = {
    "independent": "independent",
    "stratified": "stratified",
    "multijitter": "stratified",
    "orthogonal": "stratified",
    "ldsampler": "sobol",
}
_FILTERS = {
    "box": "box",
    "tent": "tent",
    "gaussian": "shared",
    "mitchell": "blackman-harris",
    "catmullrom": "blackman-harris",
    "lanczos": "blackman-harris",
}
_WIDTHS = {"gaussian": ("stddev", 0.5), "tent": ("radius", 1.0)}
"""Parameters that change the width of a filter, and the widths that wrt has."""
_IN_MEDIA = ("volpath", "volpathmis", "prbvolpath")
_PATHS = ("path", "prb", "prb_basic", *_IN_MEDIA)
_LAYERS = {
    "albedo": "albedo",
    "depth": "depth",
    "position": "position",
    "uv": "uv",
    "geo_normal": "geometric_normal",
    "sh_normal": "normal",
    "shape_index": "object",
}
"""wrt's layers by their names in the integrator `aov`."""


def settings_of(sensor: Plugin | None, integrator: Plugin | None) -> RenderSettings:
    """Return the render settings that a sensor and an integrator ask for."""
    film, sampler = (None if sensor is None else sensor.only(kind) for kind in ("film", "sampler"))
    path = {} if integrator is None else _integrator(integrator)
    return RenderSettings(**{"max_depth": UNLIMITED, **_film(film), **_sampler(sampler), **path})


def _film(film: Plugin | None) -> dict[str, Any]:
    if film is None:
        return {"width": 768, "height": 576, "filter": "shared"}
    width, height = film.integer("width", 768), film.integer("height", 576)
    values: dict[str, Any] = {"width": width, "height": height, "filter": _filter(film.only("rfilter"))}
    names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
    if any(film.has(name) for name in names):
        x, y, across, down = (film.integer(n, d) for n, d in zip(names, (0, 0, width, height), strict=True))
        values["crop"] = (x, y, x + across, y + down)
    film.ignore("file_format", "pixel_format", "component_format", "sample_border", "compensate", "banner")
    film.ignore("high_quality_edges", "gamma", "tonemap_method", "exposure", "key", "burn", "filename")
    with film.locating():
        RenderSettings(**values)
    return values


def _filter(plugin: Plugin | None) -> str:
    if plugin is None:
        return "shared"
    name = _FILTERS.get(plugin.type, "shared")
    if plugin.type not in _FILTERS or name == "blackman-harris":
        plugin.warn_of_all(f"{name!r} stands in for this filter")
    elif plugin.type in _WIDTHS and plugin.number(*_WIDTHS[plugin.type]) != _WIDTHS[plugin.type][1]:
        plugin.warn("the width of a filter is left out: 'gaussian' has a stddev of 0.5, 'tent' a radius of 1")
    plugin.ignore("radius")
    return name


def _sampler(plugin: Plugin | None) -> dict[str, Any]:
    if plugin is None:
        return {"spp": 4, "sampler": "independent"}
    if plugin.type not in _SAMPLERS:
        plugin.warn("'independent' stands in for this sampler")
    plugin.ignore("seed", "jitter", "scramble", "strength", "dimension")
    values: dict[str, Any] = {
        "spp": plugin.integer("sample_count", 4),
        "sampler": _SAMPLERS.get(plugin.type, "independent"),
    }
    with plugin.locating():
        RenderSettings(**values)
    return values


def _integrator(plugin: Plugin) -> dict[str, Any]:
    values: dict[str, Any] = {}
    if plugin.type == "depth":
        values |= {"integrator": "aov", "layers": ("depth",)}
    elif plugin.type == "direct":
        plugin.ignore("shading_samples", "emitter_samples", "bsdf_samples")
        values["integrator"] = "direct"
    elif plugin.type in ("aov", "moment", "stokes"):
        if plugin.type == "stokes":
            plugin.warn("polarisation is not simulated: without Stokes vectors")
        inner = next(plugin.of_kind("integrator"), None)
        values |= {"integrator": "aov"} if inner is None else _integrator(inner)
        if plugin.type == "aov":
            values["layers"] = _layers(plugin)
    else:
        if plugin.type not in _PATHS:
            plugin.warn_of_all("'path' stands in for this integrator")
        depth = plugin.integer("max_depth", -1)
        if depth == 0:
            plugin.warn("a 'max_depth' of 0, a black picture, is taken as 1")
        values["max_depth"] = UNLIMITED if depth < 0 else max(depth, 1)
        if plugin.type in _IN_MEDIA and depth > 0:
            # Mitsuba's depth counts scattering too: a path of n segments scatters at most n - 1 times.
            values["max_scatterings"] = min(depth - 1, _MOST_SCATTERINGS)
    if plugin.boolean("hide_emitters", False):
        values["transparent"] = True
    # Russian roulette changes no expected value, so its depth does not matter.
    plugin.ignore("rr_depth", "samples_per_pass", "block_size", "timeout", "use_spectral_mis")
    return values


def _layers(plugin: Plugin) -> tuple[str, ...]:
    kinds = [word.rpartition(":")[2] for word in plugin.text("aovs", "").replace(",", " ").split()]
    for kind in kinds:
        if kind not in _LAYERS:
            plugin.warn(f"the layer {kind!r} is not known; left out")
    return tuple(dict.fromkeys(_LAYERS[kind] for kind in kinds if kind in _LAYERS))


def camera_of(plugin: Plugin, settings: RenderSettings) -> Camera | None:
    """Return a sensor as a camera, or None if its type is not supported."""
    if plugin.type not in SENSORS:
        plugin.warn_of_all("this kind of sensor is not known; the camera is placed to show the whole scene")
        return None
    matrix = plugin.transform()
    axes, stretch = plugin.axes()
    if not math.isclose(abs(stretch[0]), stretch[1], rel_tol=1e-4):
        plugin.warn("'to_world' scales x and y differently; left out")
    if stretch[0] < 0.0:
        plugin.warn("'to_world' mirrors; the picture is not mirrored here")
    place: dict[str, Any] = {
        "origin": tuple(matrix[:3, 3].tolist()),
        "target": tuple((matrix[:3, 3] + axes[:, 2]).tolist()),
        "up": tuple(axes[:, 1].tolist()),
        "shutter_open": plugin.number("shutter_open", 0.0),
        "shutter_close": plugin.number("shutter_close", 0.0),
    }
    with plugin.locating():
        camera = _camera(plugin, place, stretch, settings.width / settings.height)
    plugin.ignore("near_clip", "far_clip", "srf")
    return camera


def _camera(plugin: Plugin, place: dict[str, Any], stretch: np.ndarray, aspect: float) -> Camera:
    if plugin.type == "orthographic":
        # Before `to_world`, the picture is 2 wide.
        return OrthographicCamera(**place, view_height=2.0 * float(stretch[1]) / aspect)
    slope = math.tan(0.5 * math.radians(vertical_degrees(plugin, aspect))) * float(stretch[1] / stretch[2])
    lens: dict[str, Any] = {"fov_degrees": 2.0 * math.degrees(math.atan(slope))}
    if plugin.type == "thinlens":
        lens["aperture_radius"] = plugin.number("aperture_radius", 0.1, positive=True) * float(stretch[1])
        focus = plugin.number("focus_distance", plugin.number("far_clip", 1e4), positive=True)
        lens["focus_distance"] = focus * float(stretch[2])
    else:
        plugin.ignore("focus_distance", "aperture_radius")
        lens["shift_x"] = plugin.number("principal_point_offset_x", 0.0) * aspect
        lens["shift_y"] = -plugin.number("principal_point_offset_y", 0.0)
    return PerspectiveCamera(**place, **lens)


def vertical_degrees(plugin: Plugin, aspect: float) -> float:
    """Return the vertical field of view of the whole film, converted from the axis that `fov_axis` names."""
    focal_length = 50.0  # millimetres, for 35 mm film of 36 mm by 24 mm
    if plugin.has("focal_length") and not plugin.has("fov"):
        text = plugin.text("focal_length", "").lower().removesuffix("mm")
        try:
            focal_length = float(text)
        except ValueError:
            focal_length = 0.0
        if focal_length <= 0.0:
            raise plugin.error(f"'focal_length' must be millimetres such as 50mm, not {text!r}")
        plugin.ignore("fov_axis")
        axis = "diagonal"
    else:
        axis = plugin.choice("fov_axis", "x", "y", "diagonal", "smaller", "larger")
    degrees = plugin.number("fov", 2.0 * math.degrees(math.atan(0.5 * math.hypot(36.0, 24.0) / focal_length)))
    if not 0.0 < degrees < 180.0:
        raise plugin.error(f"'fov' must be above 0 and below 180 degrees, not {degrees:g}")
    slope = math.tan(0.5 * math.radians(degrees))
    if axis == "diagonal":
        slope /= math.hypot(aspect, 1.0)
    elif axis == "x" or (axis == "smaller" and aspect < 1.0) or (axis == "larger" and aspect > 1.0):
        slope /= aspect
    return 2.0 * math.degrees(math.atan(slope))


def warn_of_clipping(plugin: Plugin, scene: Scene) -> None:
    """Warn if Mitsuba's near or far plane would clip a vertex before the camera."""
    camera = scene.camera
    if camera is None:
        return
    _, stretch = plugin.axes()
    near, far = (plugin.number(n, d) * float(stretch[2]) for n, d in (("near_clip", 1e-2), ("far_clip", 1e4)))
    forward = camera.frame()[2]
    for shape in scene.shapes:
        place = np.eye(4) if shape.transform is None else shape.transform_at(0.0)
        points = product(shape.mesh.vertices, place[:3, :3].T) + place[:3, 3] - np.array(camera.origin)
        depth = product(points, forward)
        if ((depth > 0.0) & ((depth < near) | (depth > far))).any():
            plugin.warn("'near_clip' and 'far_clip' are left out; they would clip something before the camera")
            return
