"""Derivatives by the index of smooth glass, which bends what is seen through it.

Along a path the derivatives of its rays and points by the index are carried on, one index at a time. A ray that a
smooth surface turns moves with the index, and so does the point that it meets. As in `vertices.py`, a point that a
matt surface's sample leads to keeps its place, and the factors of a path are those between points; edges of what is
seen have no derivative. Densities of samples stay as they are, as for all gradients.
"""

from dataclasses import replace
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_by_viewer, model_of
from wrt.kernels.core.bsdf import no_lobes, slot_values
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.registry import model_number
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.gradients.bsdf import bending_slot, make_own_slots
from wrt.kernels.gradients.lights import environment_change
from wrt.kernels.gradients.sums import GradientSums, add_number
from wrt.kernels.gradients.values import make_by_place
from wrt.kernels.gradients.vertices import PointAdjoint, across, edges_of, normal_scale
from wrt.kernels.gradients.vertices import reason_against as reason_against_vertices
from wrt.kernels.integrators.path_state import SurfaceVertex
from wrt.kernels.materials.values import disperses, make_slot_count
from wrt.kernels.media.medium import medium_of


def reason_against(features: Features) -> str:
    """Return what in a scene of these features has no derivatives by the index of glass; "" if it has them."""
    clear = replace(features, media="none") if features.media == "absorbing" and not features.grid_media else features
    smooth = [model for model in map(model_of, features.models) if model.delta and not model.straight]
    reasons = [
        reason_against_vertices(clear),
        "dispersion" if disperses(features.models) else "",
        "smooth models without `specular`" if any(model.specular is None for model in smooth) else "",
    ]
    return ", ".join(reason for reason in reasons if reason)


@wp.struct
class RayTangent:
    """Derivatives of a ray by an index. If `point_stays`, its direction follows from the point that it meets."""

    origin: wp.vec3
    direction: wp.vec3
    point_stays: bool


@wp.struct
class PointTangent:
    """Derivatives of a point by an index: its place, the weights of two corners, normal and direction to the viewer.

    `length` is the derivative of the distance to the point before.
    """

    position: wp.vec3
    length: float
    weights: wp.vec2
    normal: wp.vec3
    viewer: wp.vec3


@wp.func
def mirrored_tangent(d: wp.vec3, n: wp.vec3, by_d: wp.vec3, by_n: wp.vec3) -> wp.vec3:
    """Return the derivative of d − 2 (d·n) n, a mirrored direction, from those of d and n."""
    change = wp.dot(by_d, n) + wp.dot(d, by_n)
    return by_d - 2.0 * (n * change + by_n * wp.dot(d, n))


@wp.func
def refracted_tangent(d: wp.vec3, n: wp.vec3, eta: float, by_d: wp.vec3, by_n: wp.vec3, by_eta: float) -> wp.vec3:
    """Return the derivative of a refracted direction (`refracted_by`), where d meets a surface with the normal n.

    With c = −d·n and eta = n_t / n_i it is d / eta + a n for a = c / eta − √(1 − (1 − c²) / eta²).
    """
    scale = 1.0 / eta
    by_scale = -scale * scale * by_eta
    c = -wp.dot(d, n)
    by_c = -wp.dot(by_d, n) - wp.dot(d, by_n)
    cos_t = wp.sqrt(1.0 - (1.0 - c * c) * scale * scale)
    by_cos_t = (c * by_c * scale * scale - (1.0 - c * c) * scale * by_scale) / cos_t
    by_a = by_c * scale + c * by_scale - by_cos_t
    return by_d * scale + d * by_scale + by_n * (c * scale - cos_t) + n * by_a


@specialised()
def _make_index_of(names: tuple[str, ...]) -> wp.Function:
    """Return (model, slots) -> float, the sum of the row of the index of a smooth model, 0 for others."""
    if not names:
        return _no_index
    slot, number, following = bending_slot(names[0]), model_number(names[0]), _make_index_of(names[1:])
    if slot < 0:
        return following

    @wp.func
    def index_of(of: int, slots: slot_values) -> float:
        if of == wp.static(number):
            row = slots[wp.static(slot)]
            return row[0] + row[1] + row[2]
        return following(of, slots)

    return index_of


@wp.func
def _no_index(of: int, slots: slot_values) -> float:
    return 0.0


class IndexGradients(NamedTuple):
    """Functions of one vertex of a path; `sums.index` gets the derivative by the index of `sums.material`.

    Attributes:
        met: (scene, ray tangent, surface, hit, ray) -> PointTangent.
        dimmed: (sums, scene, stack, length, throughput, gradient): by the length of a way through the bodies `stack`,
            whose derivative is `length`, from the derivatives of the loss by the emission at its end and by the
            logarithm of the light that comes along.
        emitted: (sums, scene, surface, hit, moved, gradient): by what a surface emits, whose derivative is `gradient`.
        escaped: (sums, scene, ray tangent, ray, gradient): by the environment's radiance.
        leave: (sums, scene, moved, vertex, direction, slots, by), for a vertex met in a direction, with the derivatives
            by the slots of its BSDF.
        turned: (sums, moved, vertex, direction, ray) -> RayTangent of a ray that a smooth lobe has made of a direction.
    """

    met: wp.Function
    dimmed: wp.Function
    emitted: wp.Function
    escaped: wp.Function
    leave: wp.Function
    turned: wp.Function


@specialised("models", "textured", "uv2_alpha", "mipmapped", "environment")
def make_index_gradients(features: Features) -> IndexGradients:
    """Return the functions for scenes with these features."""
    by_place, slot_count = make_by_place(features.mipmapped), make_slot_count(features.models)
    own_slots, index_of = make_own_slots(features.models), _make_index_of(features.models)
    specular = make_by_viewer(features.models, "specular", no_lobes)

    @wp.func
    def met(scene: SceneData, tangent: RayTangent, surface: Surface, hit: Hit, ray: Ray) -> PointTangent:
        moved = PointTangent()
        if tangent.point_stays:
            moved.viewer = across(ray.direction, tangent.origin) / hit.t
            moved.length = -wp.dot(ray.direction, tangent.origin)
        else:
            moved.viewer = -tangent.direction
            beside = tangent.origin + tangent.direction * hit.t
            n = surface.normal
            moved.length = -wp.dot(n, beside) / wp.dot(n, ray.direction)
            moved.position = beside + ray.direction * moved.length
            edges = edges_of(scene, hit.triangle)
            e1 = edges[1]
            e2 = edges[2]
            flat = wp.cross(e1, e2)
            moved.weights = wp.vec2(
                wp.dot(wp.cross(moved.position, e2), flat), wp.dot(wp.cross(e1, moved.position), flat)
            ) / wp.length_sq(flat)
            scale = normal_scale(scene, hit, surface, ray.direction)
            if scale != 0.0:
                i = scene.corners[hit.triangle]
                first = scene.normals[i[0]]
                turn = (scene.normals[i[1]] - first) * moved.weights[0]
                turn += (scene.normals[i[2]] - first) * moved.weights[1]
                moved.normal = across(surface.frame.n, turn) * scale
        return moved

    @wp.func
    def dimmed(
        sums: GradientSums, scene: SceneData, stack: BodyStack, length: float, throughput: wp.vec3, gradient: wp.vec3
    ):
        medium = medium_of(scene, stack)
        if medium >= 0:
            record = scene.media[medium]
            change = wp.dot(throughput, record.emission) - wp.dot(gradient, record.absorption)
            add_number(sums.index, 0, change * length)

    @wp.func
    def emitted(
        sums: GradientSums, scene: SceneData, surface: Surface, hit: Hit, moved: PointTangent, gradient: wp.vec3
    ):
        if wp.static(features.textured):
            slot = scene.shapes[surface.shape].emission_slot
            if slot >= 0:
                by_weights = by_place(scene, slot, hit.triangle, surface, gradient)
                add_number(sums.index, 0, wp.dot(by_weights, moved.weights))

    @wp.func
    def escaped(sums: GradientSums, scene: SceneData, tangent: RayTangent, ray: Ray, gradient: wp.vec3):
        if wp.static(features.environment == "image"):
            if scene.environment.width > 0:
                if not tangent.point_stays and wp.length_sq(tangent.direction) > 0.0:
                    change = environment_change(scene.environment, ray.direction, tangent.direction)
                    add_number(sums.index, 0, wp.dot(gradient, change))

    @wp.func
    def leave(
        sums: GradientSums,
        scene: SceneData,
        moved: PointTangent,
        vertex: SurfaceVertex,
        direction: wp.vec3,
        slots: slot_values,
        by: PointAdjoint,
    ):
        surface = vertex.surface
        if vertex.material == sums.material:
            add_number(sums.index, 0, index_of(vertex.bsdf.model, slots))
        # A turn of the frame is one of all directions the other way.
        turn = by.turn - wp.cross(direction, by.viewer)
        change = wp.dot(by.position, moved.position) + wp.dot(by.viewer, moved.viewer)
        change -= wp.dot(wp.cross(surface.frame.n, moved.normal), turn)
        if wp.static(features.textured):
            if wp.length_sq(moved.weights) > 0.0:
                record = scene.materials[vertex.material]
                own = own_slots(vertex.bsdf, slots, False, False)
                for k in range(slot_count(record.model)):
                    by_weights = by_place(scene, record.first_slot + k, vertex.hit.triangle, surface, own[k])
                    change += wp.dot(by_weights, moved.weights)
        add_number(sums.index, 0, change)

    @wp.func
    def turned(
        sums: GradientSums, moved: PointTangent, vertex: SurfaceVertex, direction: wp.vec3, ray: Ray
    ) -> RayTangent:
        tangent = RayTangent()
        tangent.origin = moved.position
        n = vertex.surface.frame.n
        if wp.dot(ray.direction, n) > 0.0:
            tangent.direction = mirrored_tangent(direction, n, -moved.viewer, moved.normal)
        else:
            eta = specular(vertex.bsdf, vertex.wo).eta
            by_eta = float(0.0)
            if vertex.material == sums.material:
                by_eta = wp.where(vertex.bsdf.front, 1.0, -eta * eta)
            tangent.direction = refracted_tangent(direction, n, eta, -moved.viewer, moved.normal, by_eta)
        return tangent

    return IndexGradients(met, dimmed, emitted, escaped, leave, turned)
