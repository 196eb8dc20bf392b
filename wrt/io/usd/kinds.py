"""Which prims of a stage are described, and by which of their attributes."""

from __future__ import annotations

LIGHTS = ("SphereLight", "RectLight", "DiskLight", "DistantLight")

SOLIDS = ("Cube", "Sphere", "Plane", "Cylinder", "Cone", "Capsule")
"""Shapes that triangles are made of."""

SILENT = ("Xform", "Scope", "Material", "Shader", "GeomSubset", "NodeGraph", "SkelRoot", "")
"""Types that hold others, or are read with those that use them."""

_OF_LIGHTS = (
    "inputs:color",
    "inputs:intensity",
    "inputs:exposure",
    "inputs:normalize",
    "inputs:enableColorTemperature",
    "inputs:colorTemperature",
)

ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "Mesh": ("points", "faceVertexCounts", "faceVertexIndices", "orientation"),
    "PointInstancer": ("protoIndices",),
    "Camera": ("verticalAperture", "projection", "focalLength", "fStop", "focusDistance"),
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Plane": ("width", "length", "axis"),
    **dict.fromkeys(("Cylinder", "Cone", "Capsule"), ("radius", "height", "axis")),
    "SphereLight": (*_OF_LIGHTS, "inputs:radius", "treatAsPoint"),
    "RectLight": (*_OF_LIGHTS, "inputs:width", "inputs:height"),
    "DiskLight": (*_OF_LIGHTS, "inputs:radius"),
    "DistantLight": (*_OF_LIGHTS, "inputs:angle"),
    "DomeLight": (*_OF_LIGHTS, "inputs:texture:file"),
}
"""The attributes of each type."""
