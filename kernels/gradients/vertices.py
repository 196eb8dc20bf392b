"""Derivatives by vertices and normals: those of a path's own factors, without those of the edges of what it sees.

The material form of Zhang, Miller, Yan, Gkioulekas and Zhao, "Path-space differentiable rendering" (2020): the point
that a ray of the camera meets stays on the ray. Each later point of the path, also one on a light, keeps its weights of
the three corners of its triangle, and moves with them. Each segment to such a point then has the factor
f |cosθ| |N·d| / |d|³ for the vector d and the product N of the triangle's edges, which is twice its normal times its
area. It depends on three points, one normal and N alone. Densities of samples stay as they are, as for all gradients.

A smooth lobe leads to a point that no weights fix; what follows counts as met by a ray that stays in place.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import model_of, models_with
from wrt.kernels.core.bsdf import slot_values
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT, Hit
from wrt.kernels.core.rays import Frame, Ray, to_world
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, normal_of_mesh
from wrt.kernels.gradients.bsdf import differentiable, make_own_slots
from wrt.kernels.gradients.sums import GradientSums, add_color
from wrt.kernels.gradients.values import make_by_place
from wrt.kernels.integrators.path_state import SurfaceVertex
from wrt.kernels.lights.record import LightSample
from wrt.kernels.materials.values import make_slot_count


def reason_against(features: Features) -> str:
    """Return what in a scene of these features has no derivatives by vertices; "" if it has them."""
    filmed = [name for name in features.models if name not in differentiable(features.models)]
    reasons = {
        "instances or motion": features.instances != "none",
        "exact shapes": features.has_exact,
        "media or nested bodies": features.bodies,
        "normal maps or anisotropic materials": features.tangents,
        "mixed or partly transparent materials": features.mixed,
        "lights with a shape, such as spots": bool(features.light_shapes),
        "panes": bool(models_with(features.models, "straight")),
        "single-sided or unlit shapes": features.single_sided,
        "second texture coordinates": features.uv2_alpha,
        "materials under a film": any(model_of(name).slots for name in filmed),
    }
    return ", ".join(reason for reason, applies in reasons.items() if applies)


@wp.struct
class PathPoint:
    """A point of a path on a triangle, or NO_HIT for one that stays where it is.

    `u` and `v` are its weights of the second and third corner. `direction` is that of the ray on which it stays, 0 if
    it keeps its weights.
    """

    triangle: int
    u: float
    v: float
    position: wp.vec3
    direction: wp.vec3


@wp.struct
class PointAdjoint:
    """Derivatives by a point, by N, by the sum of the corners' normals, and by the weights of two corners.

    `viewer` is the derivative by the direction to the viewer, and `turn` that by a turn of all directions about the
    axes of space, except that one.
    """

    position: wp.vec3
    area: wp.vec3
    normal: wp.vec3
    weights: wp.vec2
    viewer: wp.vec3
    turn: wp.vec3


@wp.func
def point_of(hit: Hit, position: wp.vec3) -> PathPoint:
    """Return a point that keeps its weights."""
    point = PathPoint()
    point.triangle = hit.triangle
    point.u = hit.u
    point.v = hit.v
    point.position = position
    return point


@wp.func
def edges_of(scene: SceneData, triangle: int) -> wp.mat33:
    """Return a corner of a triangle and its two edges from there, as rows."""
    i = scene.corners[triangle]
    p = scene.points[i[0]]
    return wp.matrix_from_rows(p, scene.points[i[1]] - p, scene.points[i[2]] - p)


@wp.func
def across(unit: wp.vec3, gradient: wp.vec3) -> wp.vec3:
    """Return the part of a derivative that is normal to a unit vector."""
    return gradient - unit * wp.dot(unit, gradient)


@wp.func
def add_to_corners(sums: GradientSums, scene: SceneData, point: PathPoint, by: PointAdjoint):
    """Add to the corners of a point's triangle, and to their normals."""
    i = scene.corners[point.triangle]
    edges = edges_of(scene, point.triangle)
    e1 = edges[1]
    e2 = edges[2]
    n = wp.cross(e1, e2)
    moved = by.position  # by the displacement of the point that keeps its weights
    if wp.length_sq(point.direction) > 0.0:
        along = (wp.cross(e2, n) * by.weights[0] + wp.cross(n, e1) * by.weights[1]) / wp.length_sq(n)
        moved = n * (wp.dot(by.position + along, point.direction) / wp.dot(n, point.direction)) - along
    by_e1 = wp.cross(e2, by.area)
    by_e2 = wp.cross(by.area, e1)
    w = 1.0 - point.u - point.v
    add_color(sums.vertices, i[0], moved * w - by_e1 - by_e2)
    add_color(sums.vertices, i[1], moved * point.u + by_e1)
    add_color(sums.vertices, i[2], moved * point.v + by_e2)
    if wp.length_sq(by.normal) > 0.0:
        add_color(sums.normals, i[0], by.normal * w)
        add_color(sums.normals, i[1], by.normal * point.u)
        add_color(sums.normals, i[2], by.normal * point.v)


@wp.func
def normal_scale(scene: SceneData, hit: Hit, surface: Surface, direction: wp.vec3) -> float:
    """Return what the sum of the corners' normals is to be multiplied by; 0 where the triangle's own normal is taken.

    The surface is met in a direction.
    """
    normal = wp.vec3()
    if scene.shapes[surface.shape].smooth != 0:
        normal = normal_of_mesh(scene, hit, 0)
    side = wp.where(wp.dot(normal, surface.normal) < 0.0, -1.0, 1.0)
    scale = float(0.0)
    if wp.dot(normal, direction) * side < 0.0:  # as `make_surface_at` decides
        scale = side / wp.length(normal)
    return scale


@wp.func
def with_normal(
    scene: SceneData, point: PathPoint, surface: Surface, direction: wp.vec3, gradient: wp.vec3, by: PointAdjoint
) -> PointAdjoint:
    """Return `by` with the derivative by the shading normal of a surface that a ray in a direction meets."""
    i = scene.corners[point.triangle]
    hit = Hit()
    hit.triangle = point.triangle
    hit.u = point.u
    hit.v = point.v
    edges = edges_of(scene, point.triangle)
    flat = wp.cross(edges[1], edges[2])
    tangential = across(surface.frame.n, gradient)
    scale = normal_scale(scene, hit, surface, direction)
    if scale != 0.0:
        by.normal = tangential * scale
        n = scene.normals[i[0]]
        by.weights += wp.vec2(wp.dot(by.normal, scene.normals[i[1]] - n), wp.dot(by.normal, scene.normals[i[2]] - n))
    else:
        side = wp.where(wp.dot(flat, surface.normal) < 0.0, -1.0, 1.0)
        by.area += tangential * (side / wp.length(flat))
    return by


class VertexGradients(NamedTuple):
    """Functions of one vertex of a path, whose derivatives are kept until `leave`; PointAdjoint() is none.

    `by_wo` and `by_wi` are derivatives of the loss by the directions in the BSDF's frame, through f |cosθ| alone;
    `gradient` is the derivative by the logarithm of the light that comes along.

    Attributes:
        towards_light: (sums, scene, by, start, frame, light, by_wo, by_wi, gradient) -> by.
        towards_next: (sums, scene, by, start, frame, ray, by_wo, by_wi, gradient) -> by.
        emitted: (sums, scene, surface, point, gradient): by what a surface emits, whose derivative is `gradient`.
        leave: (sums, scene, previous, point, vertex, direction, slots, by), for a vertex met in a direction, with the
            derivatives by the slots of its BSDF.
    """

    towards_light: wp.Function
    towards_next: wp.Function
    emitted: wp.Function
    leave: wp.Function


@specialised("models", "textured", "uv2_alpha", "mipmapped", "instances", "exact")
def make_vertex_gradients(features: Features, *, ends: bool = True) -> VertexGradients:
    """Return the functions for scenes with these features; without `ends` the ends of segments get no derivatives."""
    intersect = make_intersect(features.geometry)
    by_place, slot_count = make_by_place(features.mipmapped), make_slot_count(features.models)
    own_slots = make_own_slots(features.models)

    @wp.func
    def towards(
        sums: GradientSums,
        scene: SceneData,
        by: PointAdjoint,
        start: PathPoint,
        frame: Frame,
        to: PathPoint,
        by_wo: wp.vec3,
        by_wi: wp.vec3,
        gradient: float,
    ) -> PointAdjoint:
        d = to.position - start.position
        distance = wp.length(d)
        wi = d / distance
        by_direction = to_world(frame, by_wi)
        by.viewer += to_world(frame, by_wo)
        by.turn += wp.cross(wi, by_direction)
        by_end = across(wi, by_direction) / distance
        if to.triangle >= 0:
            edges = edges_of(scene, to.triangle)
            n = wp.cross(edges[1], edges[2])
            share = gradient / wp.dot(n, d)
            by_end += n * share - wi * (3.0 * gradient / distance)
            if wp.static(ends):
                at_end = PointAdjoint()
                at_end.area = d * share
                at_end.position = by_end
                add_to_corners(sums, scene, to, at_end)
        else:
            by_end -= wi * (2.0 * gradient / distance)
        by.position -= by_end
        return by

    @wp.func
    def in_direction(by: PointAdjoint, frame: Frame, wi: wp.vec3, by_wo: wp.vec3, by_wi: wp.vec3) -> PointAdjoint:
        by.viewer += to_world(frame, by_wo)
        by.turn += wp.cross(wi, to_world(frame, by_wi))
        return by

    @wp.func
    def towards_light(
        sums: GradientSums,
        scene: SceneData,
        by: PointAdjoint,
        start: PathPoint,
        frame: Frame,
        light: LightSample,
        by_wo: wp.vec3,
        by_wi: wp.vec3,
        gradient: float,
    ) -> PointAdjoint:
        to = PathPoint()
        to.triangle = NO_HIT
        to.position = start.position + light.wi * light.distance
        if not light.delta and light.point.triangle >= 0:
            edges = edges_of(scene, light.point.triangle)
            at = edges[0] + edges[1] * light.point.u + edges[2] * light.point.v
            to = point_of(light.point, at)
        if light.distance < 0.5 * INFINITE_DISTANCE:
            by = towards(sums, scene, by, start, frame, to, by_wo, by_wi, gradient)
        else:
            by = in_direction(by, frame, light.wi, by_wo, by_wi)
        return by

    @wp.func
    def towards_next(
        sums: GradientSums,
        scene: SceneData,
        by: PointAdjoint,
        start: PathPoint,
        frame: Frame,
        ray: Ray,
        by_wo: wp.vec3,
        by_wi: wp.vec3,
        gradient: float,
    ) -> PointAdjoint:
        hit = intersect.closest_hit(scene, ray)
        if hit.triangle >= 0:
            edges = edges_of(scene, hit.triangle)
            to = point_of(hit, edges[0] + edges[1] * hit.u + edges[2] * hit.v)
            by = towards(sums, scene, by, start, frame, to, by_wo, by_wi, gradient)
        else:
            by = in_direction(by, frame, ray.direction, by_wo, by_wi)
        return by

    @wp.func
    def emitted(sums: GradientSums, scene: SceneData, surface: Surface, point: PathPoint, gradient: wp.vec3):
        if wp.static(features.textured):
            slot = scene.shapes[surface.shape].emission_slot
            if slot >= 0:
                by = PointAdjoint()
                by.weights = by_place(scene, slot, point.triangle, surface, gradient)
                add_to_corners(sums, scene, point, by)

    @wp.func
    def leave(
        sums: GradientSums,
        scene: SceneData,
        previous: PathPoint,
        point: PathPoint,
        vertex: SurfaceVertex,
        direction: wp.vec3,
        slots: slot_values,
        by: PointAdjoint,
    ):
        surface = vertex.surface
        if previous.triangle >= 0:
            distance = wp.length(previous.position - point.position)
            before = PointAdjoint()
            before.position = across(direction, by.viewer) / distance
            by.position -= before.position
            add_to_corners(sums, scene, previous, before)
        # A turn of the frame is one of all directions the other way.
        turn = by.turn - wp.cross(direction, by.viewer)
        by = with_normal(scene, point, surface, direction, wp.cross(surface.frame.n, turn), by)
        if wp.static(features.textured):
            if previous.triangle < 0:  # else it keeps its place in textures
                record = scene.materials[vertex.material]
                own = own_slots(vertex.bsdf, slots, False, False)
                for k in range(slot_count(record.model)):
                    by.weights += by_place(scene, record.first_slot + k, point.triangle, surface, own[k])
        add_to_corners(sums, scene, point, by)

    return VertexGradients(towards_light, towards_next, emitted, leave)
