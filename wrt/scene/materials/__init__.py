"""Materials: how surfaces reflect and transmit light."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrt.scene.materials.body import Null
from wrt.scene.materials.burley import Burley
from wrt.scene.materials.composite import Emissive, Mix, TwoSided
from wrt.scene.materials.dielectrics import Dielectric, RoughDielectric, ThinDielectric
from wrt.scene.materials.diffuse import Diffuse, OrenNayar
from wrt.scene.materials.material import Material
from wrt.scene.materials.measured import Measured
from wrt.scene.materials.metals import Conductor, Glossy, Mirror, RoughConductor
from wrt.scene.materials.plastics import Plastic, RoughPlastic
from wrt.scene.materials.principled import Principled
from wrt.scene.registration import register_class

if TYPE_CHECKING:
    from wrt.kernels.core.bsdf import Model

MATERIALS: dict[str, type[Material]] = {
    cls.type_name: cls
    for cls in (
        Diffuse,
        OrenNayar,
        Mirror,
        Glossy,
        Conductor,
        RoughConductor,
        Dielectric,
        RoughDielectric,
        ThinDielectric,
        Null,
        Plastic,
        RoughPlastic,
        Principled,
        Burley,
        Measured,
        Mix,
        TwoSided,
        Emissive,
    )
}
"""Materials by their `type` in scene files."""


def register_material(cls: type[Material], model: Model | None = None) -> None:
    """Make a custom material known to scene files and `wrt materials`.

    A class of the same name from the same module replaces the one registered before, as when a notebook cell runs
    again. Existing renderers are not affected.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions, unless it uses the model of another material.

    Raises:
        InputError: if `type_name` is empty or taken by another material.
    """
    if model is None:
        register_class(MATERIALS, cls, None)
        return
    from wrt.kernels.bsdf import register_model

    register_class(MATERIALS, cls, lambda name, owner: register_model(name, model, owner))


__all__ = [
    "MATERIALS",
    "Burley",
    "Conductor",
    "Dielectric",
    "Diffuse",
    "Emissive",
    "Glossy",
    "Material",
    "Measured",
    "Mirror",
    "Mix",
    "Null",
    "OrenNayar",
    "Plastic",
    "Principled",
    "RoughConductor",
    "RoughDielectric",
    "RoughPlastic",
    "ThinDielectric",
    "TwoSided",
    "register_material",
]
