"""Derivatives by what dims a shadow ray: panes, and homogeneous media.

The ray is followed once more. The derivative of a product by what one of its factors depends on is the product times
the logarithmic derivative of the factor.
"""

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.bsdf import make_is_any, models_with
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT
from wrt.kernels.core.rays import Ray, to_local
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import traces_alone
from wrt.kernels.geometry.surface import make_surface_at
from wrt.kernels.gradients.bsdf import differentiable, make_weighted, over
from wrt.kernels.gradients.materials import make_add_to_material
from wrt.kernels.gradients.media import make_add_to_extinction
from wrt.kernels.gradients.sums import GradientSums
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows, make_mapped
from wrt.kernels.materials.choice import MOST_PASSED, leaves_of, make_next_leaf
from wrt.kernels.materials.values import make_bsdf_at, make_share_passed
from wrt.kernels.media.bodies import Crossing, crossed_at, is_there
from wrt.kernels.media.medium import medium_of
from wrt.kernels.media.skin import Skin, hit_or_skin


def dims_shadows(features: Features) -> bool:
    """Return whether anything that has derivatives dims shadow rays."""
    return features.media != "none" or bool(models_with(differentiable(features.models), "straight"))


@specialised(*("instances", "media", "composite", "nested"), *make_mapped.fields, *make_share_passed.fields)
def make_add_to_shadow(features: Features) -> wp.Function:
    """Return (sums, scene, ray, t_max, stack, skin, gradient): to what dims the shadow ray of a light that arrives.

    `gradient` is the derivative of the loss by the logarithm of the light, `stack` are the bodies at the ray's origin,
    and `skin` is the surface beside its receiver.
    """
    intersect, surface_at = make_intersect(features.geometry), make_surface_at(features.geometry)
    add_to_extinction, add_to_material = make_add_to_extinction(features.media), make_add_to_material(features)
    mapped, next_leaf = make_mapped(features), make_next_leaf(features.uv2_alpha, False, features.procedures)
    bsdf_at, share_passed = make_bsdf_at(features), make_share_passed(features)
    models = differentiable(features.models)
    panes = models_with(models, "straight")
    weighted_straight, is_pane = make_weighted(models).straight, make_is_any(panes)

    @wp.func
    def add_to_stretch(sums: GradientSums, scene: SceneData, inside: BodyStack, length: float, gradient: wp.vec3):
        medium = medium_of(scene, inside)
        if medium >= 0 and length < 0.5 * INFINITE_DISTANCE:
            if scene.media[medium].grid < 0:
                add_to_extinction(sums, medium, gradient * -length)

    @wp.func
    @traces_alone
    def add_to_shadow(
        sums: GradientSums,
        scene: SceneData,
        ray: Ray,
        t_max: float,
        stack: BodyStack,
        skin: Skin,
        gradient: wp.vec3,
    ):
        if wp.static(not can_attenuate_shadows(features)):
            add_to_stretch(sums, scene, stack, t_max, gradient)
        else:
            hit = intersect.closest_hit_before(scene, ray, t_max)
            if wp.static(features.media == "scattering"):
                hit = hit_or_skin(skin, ray, hit)
            last = Crossing()
            last.stack = stack
            t_before = float(0.0)
            surfaces_passed = int(0)
            goes_on = bool(True)
            while goes_on:
                if wp.static(features.media != "none"):
                    add_to_stretch(sums, scene, last.stack, hit.t - t_before, gradient)
                    t_before = hit.t
                goes_on = hit.triangle != NO_HIT and surfaces_passed < MOST_PASSED
                if goes_on:
                    surface = surface_at(scene, ray, hit)
                    is_solid = bool(True)
                    if wp.static(features.bodies):
                        body = scene.shapes[surface.shape].body
                        if body >= 0:
                            crossing = crossed_at(last, body, surface.front, hit.t)
                            if wp.static(features.nested):
                                is_solid = is_there(scene, surface, last.stack, crossing.stack)
                            last = crossing
                    # Here, not in a function: Warp emits one with a `wp.grad` after all callers that have none.
                    if wp.static(bool(panes)):
                        if is_solid:
                            surface = mapped(scene, hit, surface, ray.direction)
                            wo = to_local(surface.frame, -ray.direction)
                            material = scene.shapes[surface.shape].material
                            weight = over(gradient, share_passed(scene, material, surface, wo))
                            leaves = leaves_of(material)
                            while leaves.remaining > 0:
                                leaves = next_leaf(scene, leaves, surface)
                                bsdf = bsdf_at(scene, leaves.leaf, surface)
                                if leaves.share > 0.0 and is_pane(bsdf):
                                    of_leaf = weight * leaves.share
                                    by_share, _0, _1 = wp.grad(weighted_straight)(bsdf, wo, of_leaf)
                                    add_to_material(sums, scene, leaves.leaf, bsdf, surface, by_share.slots)
                    hit = intersect.next_hit(scene, ray, hit, t_max)
                    surfaces_passed += 1

    return add_to_shadow
