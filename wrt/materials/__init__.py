"""Materials: how a surface reflects and transmits light, one file a kind of stuff."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrt.errors import InputError
from wrt.materials.body import Null
from wrt.materials.composite import Emissive, Mix, TwoSided
from wrt.materials.dielectrics import Dielectric, RoughDielectric, ThinDielectric
from wrt.materials.diffuse import Diffuse, OrenNayar
from wrt.materials.glossy import Glossy
from wrt.materials.material import Material
from wrt.materials.metals import Conductor, Mirror, RoughConductor
from wrt.materials.plastics import Plastic, RoughPlastic
from wrt.materials.principled import Principled

if TYPE_CHECKING:
    from wrt.kernels.bsdf.record import Model

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
        Mix,
        TwoSided,
        Emissive,
    )
}
"""Materials by their `type` in scene files."""

_BUILT_IN = frozenset(MATERIALS)


def register_material(cls: type[Material], model: Model | None = None) -> None:
    """Let scene files and `wrt materials` know a material of one's own.

    A class of the same name in the same module takes the place of the one registered before, as when a cell of a
    notebook runs again. Renderers that exist go on with what they were made with.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions, where it does not use the model of another material.

    Raises:
        InputError: where it has no `type_name`, or a built-in or somebody else's material has that name.
    """
    known = MATERIALS.get(cls.type_name, cls)
    if not cls.type_name or cls.type_name in _BUILT_IN or _origin(known) != _origin(cls):
        raise InputError(f"{cls.__name__}: type_name {cls.type_name!r} is empty or taken")
    if model is not None:
        from wrt.kernels.bsdf import register_model

        try:
            register_model(cls.type_name.replace("-", "_"), model, _origin(cls))
        except ValueError as error:
            raise InputError(f"{cls.__name__}: {error}") from None
    MATERIALS[cls.type_name] = cls


def _origin(cls: type[Material]) -> str:
    """Return where a class was written."""
    return f"{cls.__module__}.{cls.__qualname__}"


__all__ = [
    "MATERIALS",
    "Conductor",
    "Dielectric",
    "Diffuse",
    "Emissive",
    "Glossy",
    "Material",
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
