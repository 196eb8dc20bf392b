"""Materials: how surfaces reflect and transmit light."""

from __future__ import annotations

# The built-in materials in the order in which lists show them. A line here makes a material known to `wrt`, scene files
# and their schema, the command line and the reference.
# isort: off
from wrt.scene.description import by_type_name
from wrt.scene.materials.material import Material as Material
from wrt.scene.materials.simple import Diffuse as Diffuse
from wrt.scene.materials.simple import OrenNayar as OrenNayar
from wrt.scene.materials.simple import Mirror as Mirror
from wrt.scene.materials.simple import Glossy as Glossy
from wrt.scene.materials.metals import Conductor as Conductor
from wrt.scene.materials.metals import RoughConductor as RoughConductor
from wrt.scene.materials.dielectrics import Dielectric as Dielectric
from wrt.scene.materials.dielectrics import RoughDielectric as RoughDielectric
from wrt.scene.materials.dielectrics import ThinDielectric as ThinDielectric
from wrt.scene.materials.body import Null as Null
from wrt.scene.materials.plastics import Plastic as Plastic
from wrt.scene.materials.plastics import RoughPlastic as RoughPlastic
from wrt.scene.materials.principled import Principled as Principled
from wrt.scene.materials.principled import Burley as Burley
from wrt.scene.materials.measured import Measured as Measured
from wrt.scene.materials.measured import Measurement as Measurement
from wrt.scene.materials.composite import Mix as Mix
from wrt.scene.materials.composite import TwoSided as TwoSided
from wrt.scene.materials.composite import Emissive as Emissive
from wrt.scene.materials.composite import Unlit as Unlit
# isort: on

MATERIALS: dict[str, type[Material]] = by_type_name(globals(), Material)
"""Materials by their `type` in scene files."""
