"""Keys of scene files that are not fields of a dataclass: their names, types and meanings.

The reader and the JSON schema share them. All other keys are parameters of classes and functions of `wrt`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from wrt.describe.docstrings import meanings_of
from wrt.scene.scene import Shape

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string", "minLength": 1}
BOOLEAN: Schema = {"type": "boolean"}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        meaning: one line.
        schema: the JSON schema of its value.
        required: whether a table must have it.
    """

    meaning: str
    schema: Schema
    required: bool = False


Keys = Mapping[str, Key]


def definition(name: str) -> Schema:
    """Return a reference to a named definition of the schema."""
    return {"$ref": f"#/definitions/{name}"}


def array_of(items: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of an array with limits on its length."""
    length = {key: value for key, value in (("minItems", least), ("maxItems", most)) if value}
    return {"type": "array", "items": items, **length}


VECTOR = definition("vector")
POINTS = array_of(VECTOR, 3)


def own_fields(cls: type[Any]) -> list[str]:
    """Return the fields of an object from a file that a table may set: all but the content and the name."""
    return [field.name for field in fields(cls) if field.name not in ("pixels", "name")]


SECTIONS: Keys = {
    "settings": Key("Size, samples, exposure. Options of the command line win over them.", definition("settings")),
    "camera": Key("The camera; by default one that sees every shape.", definition("camera")),
    "environment": Key("Light from infinitely far away; by default none.", definition("environment")),
    "lights": Key("Lights without a surface of triangles.", array_of(definition("light"))),
    "media": Key(
        "Participating media in bodies or in the whole scene, by name.",
        {"type": "object", "additionalProperties": definition("medium")},
    ),
    "medium": Key("Name of the medium that fills the scene outside of bodies.", TEXT),
    "materials": Key(
        "Materials of surfaces, by name.", {"type": "object", "additionalProperties": definition("material")}
    ),
    "shapes": Key("Surfaces, those that emit light included.", array_of(definition("shape"))),
}

TURN: Keys = {
    "axis": Key("Axis to turn about, of any length.", VECTOR, required=True),
    "degrees": Key("Counter-clockwise when the axis points at the viewer.", NUMBER, required=True),
}

TRANSFORM: Keys = {
    "scale": Key("First: a factor, or one for each axis; not 0.", {"anyOf": [NUMBER, VECTOR]}),
    "rotate": Key(
        "Second: a turn about the origin, or several in order.",
        {"anyOf": [definition("turn"), array_of(definition("turn"))]},
    ),
    "translate": Key("Last: metres.", VECTOR),
}

_CENTER = Key("Fixed point of the rotation and the scale.", VECTOR)

EVEN_MOTION: Keys = {
    "times": Key("Begin and end, seconds.", array_of(NUMBER, 2, 2), required=True),
    "rotate": Key("Rotation at constant speed between the times, any number of degrees.", definition("turn")),
    "translate": Key("Translation between the times, metres.", VECTOR),
    "center": _CENTER,
}

KEYFRAMES: Keys = {
    "keys": Key("Keyframes in ascending order of time.", array_of(definition("keyframe"), 1), required=True),
    "center": _CENTER,
}

KEYFRAME: Keys = {"time": Key("Seconds.", NUMBER, required=True), **TRANSFORM}

MATRIX_KEYFRAME: Keys = {
    "time": KEYFRAME["time"],
    "matrix": Key("The three upper rows of an affine matrix.", array_of(array_of(NUMBER, 4, 4), 3, 3), required=True),
}

INSTANCE: Keys = {**TRANSFORM, "motion": Key("How this instance moves.", definition("motion"))}

DEFORMATION_ARCHIVE: Keys = {
    "file": Key("A NumPy archive of times, vertices (K, N, 3) and perhaps normals.", TEXT, required=True)
}

DEFORMATION_FILES: Keys = {
    "files": Key("Mesh files of the same vertices and faces.", array_of(TEXT, 1), required=True),
    "times": Key("Time of each file, seconds, ascending.", array_of(NUMBER, 1), required=True),
}

PLACES: Keys = {
    "motion": Key("How it moves after its transform.", definition("motion")),
    "instances": Key(
        "Transforms of its instances; or a NumPy file of matrices (N, 4, 4).",
        {"anyOf": [array_of(definition("instance"), 1), TEXT]},
    ),
    "deformation": Key("How its vertices move.", definition("deformation")),
}

_OF_SHAPES = meanings_of(Shape)  # empty under python -OO

SHAPE: Keys = {
    "type": Key("What it is.", TEXT, required=True),
    "name": Key("For messages, and for layers of objects.", {"type": "string"}),
    "material": Key("A name from [materials]; without it the file's own, or a diffuse one.", TEXT),
    "emission": Key(_OF_SHAPES.get("emission", ""), definition("color_that_varies")),
    "two_sided_emission": Key(_OF_SHAPES.get("two_sided_emission", ""), BOOLEAN),
    "double_sided": Key(_OF_SHAPES.get("double_sided", ""), BOOLEAN),
    "shadow_catcher": Key(_OF_SHAPES.get("shadow_catcher", ""), BOOLEAN),
    "edges": Key(_OF_SHAPES.get("edges", ""), BOOLEAN),
    "group": Key(_OF_SHAPES.get("group", ""), TEXT),
    **TRANSFORM,
    **PLACES,
}

TEXTURE: Keys = {
    "texture": Key("The image file.", TEXT, required=True),
    "linear": Key("Read an 8-bit file as linear values, not as sRGB: for data, not colours.", BOOLEAN),
}

NORMAL_MAP: Keys = {"texture": Key("The image file, as in glTF.", TEXT, required=True)}

DENSITY: Keys = {
    "file": Key("The densities: .npy, .npz, Mitsuba's .vol, or NanoVDB.", TEXT, required=True),
    "grid": Key("Name of the array or grid, in a file of several.", TEXT),
    "albedo": Key("File of a grid of albedos, in place of the medium's own.", TEXT),
    "emission": Key("File of a grid of factors on the emission.", TEXT),
    **TRANSFORM,
}

DENSITY_OWN = ["lower", "upper", "factor"]  # fields of DensityGrid that a table may set
VERTEX_COLORS: Keys = {"vertex_colors": Key("The mesh's own colours.", {"const": True}, required=True)}

IMAGE_ENVIRONMENT: Keys = {"file": Key("OpenEXR, Radiance HDR or .npy; also PNG and the like.", TEXT, required=True)}
