"""Lines along the edges of triangles, of a width in pixels.

A sample is on a line if the point that its camera ray meets is at most half the width from an edge of that triangle, as
the film shows both. The nearest point of the edge is found with the film taken as linear around the point, which serves
cameras that distort as well, since lines are a few pixels wide; then its true distance decides. Averaged over a pixel's
samples, this antialiases by the picture's own filter, and lines are out of focus and blurred by motion as the surface
is that they lie on.
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.camera.camera import Camera, CameraRay
from wrt.kernels.camera.models import make_camera
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, leave, make_surface_at
from wrt.kernels.integrators.first_surface import FirstSurface
from wrt.kernels.materials.choice import MOST_PASSED

ALL_SIDES = wp.constant(7)
"""The number in `SceneData.edges` of a triangle whose three sides are all drawn (`wrt.scene.mesh.ALL_SIDES`)."""

_ROUNDING = wp.constant(2.0**-16)
"""Least step for differences, relative to the point's distance from the origin: rounding is 0.4 % of it."""


@wp.struct
class Nearest:
    """The point of a triangle's lines that is nearest on the film: its squared distance and its offset in space."""

    squared: float
    offset: wp.vec3


@wp.func
def nearer(known: Nearest, p: wp.vec2, q: wp.vec2, p_offset: wp.vec3, q_offset: wp.vec3) -> Nearest:
    """Return the nearest point to the origin of those known and of the segment from p to q on the film."""
    along = q - p
    share = wp.clamp(-wp.dot(p, along) / wp.max(wp.dot(along, along), 1.0e-30), 0.0, 1.0)
    place = p + along * share
    result = known
    if wp.dot(place, place) < known.squared:
        result.squared = wp.dot(place, place)
        result.offset = p_offset + (q_offset - p_offset) * share
    return result


@specialised("cameras")
def make_on_edge(features: Features) -> wp.Function:
    """Return the device function (scene, camera, hit, surface, pixel_width, time, line_width) -> bool.

    `pixel_width` is about the width of a pixel at the surface, metres, and `line_width` that of lines, pixels.
    """
    film_position = make_camera(features.cameras).film_position

    @wp.func
    def on_film(camera: Camera, point: wp.vec3, time: float) -> wp.vec2:
        return film_position(camera, point, False, time)

    @wp.func
    def on_edge(
        scene: SceneData,
        camera: Camera,
        hit: Hit,
        surface: Surface,
        pixel_width: float,
        time: float,
        line_width: float,
    ) -> bool:
        drawn = scene.edges[hit.triangle]
        if drawn == 0 or scene.shapes[surface.shape].edges == 0:
            return False
        # The film's derivatives along two axes in the plane of the triangle, by central differences over two pixels.
        point = surface.position
        step = wp.max(pixel_width, wp.length(point) * _ROUNDING)
        x = wp.normalize(surface.e1)
        y = wp.cross(surface.normal, x)
        by_x = on_film(camera, point + x * step, time) - on_film(camera, point - x * step, time)
        by_y = on_film(camera, point + y * step, time) - on_film(camera, point - y * step, time)
        scale = 0.5 / step
        side = by_x * (wp.length(surface.e1) * scale)
        other = by_x * (wp.dot(surface.e2, x) * scale) + by_y * (wp.dot(surface.e2, y) * scale)
        p = -(side * hit.u + other * hit.v)
        q = p + side
        r = p + other
        p_offset = -(surface.e1 * hit.u + surface.e2 * hit.v)
        q_offset = p_offset + surface.e1
        r_offset = p_offset + surface.e2
        nearest = Nearest()
        nearest.squared = line_width * line_width
        if (drawn & 1) != 0:
            nearest = nearer(nearest, p, q, p_offset, q_offset)
        if (drawn & 2) != 0:
            nearest = nearer(nearest, q, r, q_offset, r_offset)
        if (drawn & 4) != 0:
            nearest = nearer(nearest, r, p, r_offset, p_offset)
        if drawn != ALL_SIDES:  # ends of lines that other triangles of the polygon have at its corners
            nearest = nearer(nearest, p, p, p_offset, p_offset)
            nearest = nearer(nearest, q, q, q_offset, q_offset)
            nearest = nearer(nearest, r, r, r_offset, r_offset)
        if nearest.squared >= line_width * line_width:
            return False
        # The film may be bent between the two points.
        apart = on_film(camera, point + nearest.offset, time) - on_film(camera, point, time)
        return wp.dot(apart, apart) <= 0.25 * line_width * line_width

    return on_edge


@wp.struct
class Line:
    """Whether a camera ray meets a line, and how many rays it took to find it."""

    is_met: bool
    rays: int


@specialised("edges", "instances", "exact", *make_on_edge.fields)
def make_find_line(features: Features) -> wp.Function:
    """Return the device function (scene, camera, seen, first, line_width) -> Line, on the surface `first`.

    If Features.edges is "wires", the ray goes on through all surfaces to the first line.
    """
    closest_hit, surface_at = make_intersect(features.geometry).closest_hit, make_surface_at(features.geometry)
    on_edge = make_on_edge(features)

    @wp.func
    def line_on_surface(
        scene: SceneData, camera: Camera, seen: CameraRay, first: FirstSurface, line_width: float
    ) -> Line:
        line = Line()
        if first.hit.triangle != NO_HIT:
            pixel_width = seen.footprint[0] + seen.footprint[1] * first.distance
            line.is_met = on_edge(scene, camera, first.hit, first.surface, pixel_width, seen.ray.time, line_width)
        return line

    @wp.func
    def line_of_wires(
        scene: SceneData, camera: Camera, seen: CameraRay, first: FirstSurface, line_width: float
    ) -> Line:
        ray = seen.ray
        line = Line()
        distance = float(0.0)
        is_open = bool(True)
        while is_open and line.rays <= MOST_PASSED:
            hit = closest_hit(scene, ray)
            line.rays = line.rays + 1
            is_open = hit.triangle != NO_HIT
            if is_open:
                surface = surface_at(scene, ray, hit)
                pixel_width = seen.footprint[0] + seen.footprint[1] * (distance + hit.t)
                line.is_met = on_edge(scene, camera, hit, surface, pixel_width, ray.time, line_width)
                is_open = not line.is_met
                beyond = leave(surface, -1.0)
                distance = distance + wp.length(beyond - ray.origin)
                ray.origin = beyond
        return line

    return line_of_wires if features.edges == "wires" else line_on_surface
