"""Lights without a mesh. Emissive meshes are shapes with an `emission` (see Scene.add).

**Punctual colour.** Real-time shading models give a point, spot or directional light a colour c and write
L = π f c (n·l) (Hoffman, "Background: Physics and Math of Shading", SIGGRAPH 2013). A white Lambertian surface
(f = 1/π) that faces the light then has the radiance c and receives the irradiance π c. `color` has this meaning; for
a point or a spot it holds at a distance of one metre, so the intensity is π c.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrt.scene.lights.area import DiskLight as DiskLight
from wrt.scene.lights.area import RectangleLight as RectangleLight
from wrt.scene.lights.area import SphereLight as SphereLight
from wrt.scene.lights.directional import DirectionalLight as DirectionalLight
from wrt.scene.lights.light import Light as Light
from wrt.scene.lights.light import LightExtent as LightExtent
from wrt.scene.lights.light import unit_vector as unit_vector
from wrt.scene.lights.projector import ProjectorLight as ProjectorLight
from wrt.scene.lights.punctual import FALLOFFS as FALLOFFS
from wrt.scene.lights.punctual import PointLight as PointLight
from wrt.scene.lights.punctual import SpotLight as SpotLight
from wrt.scene.registration import register_class

if TYPE_CHECKING:
    from wrt.kernels.lights.record import LightModel

LIGHTS: dict[str, type[Light]] = {
    cls.type_name: cls
    for cls in (PointLight, SpotLight, ProjectorLight, DirectionalLight, RectangleLight, DiskLight, SphereLight)
}
"""Lights by their `type` in scene files."""


def register_light(cls: type[Light], model: LightModel) -> None:
    """Make a custom light known to scenes and scene files.

    A class of the same name from the same module replaces the one registered before, as when a notebook cell runs
    again. Existing renderers are not affected.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions.

    Raises:
        InputError: if `type_name` is empty or taken by another light, or the model lacks a function.
    """
    from wrt.kernels.lights.shapes import LIGHT_SHAPES

    register_class(LIGHTS, cls, lambda name, owner: LIGHT_SHAPES.register(name, model, owner))
