"""Lights without a mesh. Emissive meshes are shapes with an `emission` (see Scene.add).

**Punctual colour.** Real-time shading models give a point, spot or directional light a colour c and write
L = π f c (n·l) (Hoffman, "Background: Physics and Math of Shading", SIGGRAPH 2013). A white Lambertian surface
(f = 1/π) that faces the light then has the radiance c and receives the irradiance π c. `color` has this meaning; for
a point or a spot it holds at a distance of one metre, so the intensity is π c.
"""

from __future__ import annotations

# The built-in lights in the order in which lists show them. A line here makes a light known to `wrt`, scene files and
# their schema, and the reference.
# isort: off
from wrt.scene.description import by_type_name
from wrt.scene.lights.light import Light as Light
from wrt.scene.lights.punctual import PointLight as PointLight
from wrt.scene.lights.punctual import SpotLight as SpotLight
from wrt.scene.lights.punctual import ProjectorLight as ProjectorLight
from wrt.scene.lights.punctual import DirectionalLight as DirectionalLight
from wrt.scene.lights.area import RectangleLight as RectangleLight
from wrt.scene.lights.area import DiskLight as DiskLight
from wrt.scene.lights.area import SphereLight as SphereLight
# isort: on

LIGHTS: dict[str, type[Light]] = by_type_name(globals(), Light)
"""Lights by their `type` in scene files."""
