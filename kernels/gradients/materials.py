"""Derivatives by the values of a material, from those by the slots of its BSDF at a point."""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, slot_values
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.gradients.bsdf import make_own_slots
from wrt.kernels.gradients.sums import GradientSums
from wrt.kernels.gradients.values import make_add_to_slot
from wrt.kernels.materials.values import make_slot_count


@specialised("models", "nested", "textured", "uv2_alpha", "mipmapped")
def make_add_to_material(features: Features) -> wp.Function:
    """Return the device function (sums, scene, material, bsdf, surface, gradients)."""
    own_slots, slot_count = make_own_slots(features.models), make_slot_count(features.models)
    add_to_slot = make_add_to_slot(features)

    @wp.func
    def add_to_material(
        sums: GradientSums, scene: SceneData, material: int, bsdf: Bsdf, surface: Surface, gradients: slot_values
    ):
        record = scene.materials[material]
        between_bodies = bool(False)
        if wp.static(features.nested):
            between_bodies = scene.shapes[surface.shape].body >= 0
        own = own_slots(bsdf, gradients, between_bodies, record.coat_normal_map >= 0)
        for k in range(slot_count(record.model)):
            add_to_slot(sums, scene, record.first_slot + k, surface, own[k])

    return add_to_material
