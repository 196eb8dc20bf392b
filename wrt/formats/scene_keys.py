"""Keys of scene files that are no fields of a dataclass: what they are called, hold and mean.

The reader takes from here what it knows, and the JSON schema what it says. Everything else in a scene file has the keys
of a class or a function of `wrt`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from wrt.docstrings import meanings_of
from wrt.scene import Shape

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string", "minLength": 1}
BOOLEAN: Schema = {"type": "boolean"}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        meaning: in one line.
        schema: the JSON schema of its value.
        required: whether it must be there.
    """

    meaning: str
    schema: Schema
    required: bool = False


Keys = Mapping[str, Key]


def definition(name: str) -> Schema:
    """Return what stands for a part of the schema that has a name."""
    return {"$ref": f"#/definitions/{name}"}


def array_of(items: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of an array of some length."""
    length = {key: value for key, value in (("minItems", least), ("maxItems", most)) if value}
    return {"type": "array", "items": items, **length}


VECTOR = definition("vector")
POINTS = array_of(VECTOR, 3)


def own_fields(cls: type[Any]) -> list[str]:
    """Return the fields of what is made from a file that a table may give: all but the file's content and its name."""
    return [field.name for field in fields(cls) if field.name not in ("pixels", "name")]


SECTIONS: Keys = {
    "settings": Key("Size, samples, exposure. Options of the command line win over them.", definition("settings")),
    "camera": Key("Where the picture is taken from; by default where every shape is seen.", definition("camera")),
    "environment": Key("Light from infinitely far away; by default none.", definition("environment")),
    "lights": Key("Lights without a surface of triangles.", array_of(definition("light"))),
    "media": Key(
        "What fills bodies or the whole scene, by name.",
        {"type": "object", "additionalProperties": definition("medium")},
    ),
    "medium": Key("Name of the medium that fills the scene outside of bodies.", TEXT),
    "materials": Key(
        "How surfaces reflect, by name.", {"type": "object", "additionalProperties": definition("material")}
    ),
    "shapes": Key("What can be hit, and lights that have a surface.", array_of(definition("shape"))),
}

TURN: Keys = {
    "axis": Key("Axis to turn about, of any length.", VECTOR, required=True),
    "degrees": Key("Counter-clockwise for who is looked at by the axis.", NUMBER, required=True),
}

TRANSFORM: Keys = {
    "scale": Key("First: a factor, or one for each axis; not 0.", {"anyOf": [NUMBER, VECTOR]}),
    "rotate": Key(
        "Second: a turn about the origin, or several in order.",
        {"anyOf": [definition("turn"), array_of(definition("turn"))]},
    ),
    "translate": Key("Last: metres.", VECTOR),
}

_CENTER = Key("The point that stays where it is when turned and scaled.", VECTOR)

EVEN_MOTION: Keys = {
    "times": Key("From when to when, seconds.", array_of(NUMBER, 2, 2), required=True),
    "rotate": Key("An even turn of any number of degrees between the times.", definition("turn")),
    "translate": Key("The way gone between the times, metres.", VECTOR),
    "center": _CENTER,
}

KEYFRAMES: Keys = {
    "keys": Key("Where it is at which time, in the order of time.", array_of(definition("keyframe"), 1), required=True),
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
    "times": Key("When the mesh is like which of them, seconds, ascending.", array_of(NUMBER, 1), required=True),
}

PLACES: Keys = {
    "motion": Key("How it moves after its transform.", definition("motion")),
    "instances": Key(
        "The places where it is; or a NumPy file of matrices (N, 4, 4).",
        {"anyOf": [array_of(definition("instance"), 1), TEXT]},
    ),
    "deformation": Key("How its vertices move.", definition("deformation")),
}

_OF_SHAPES = meanings_of(Shape)

SHAPE: Keys = {
    "type": Key("What it is.", TEXT, required=True),
    "name": Key("For messages.", TEXT),
    "material": Key("A name from [materials]; without it the file's own, or a diffuse one.", TEXT),
    "emission": Key(_OF_SHAPES["emission"], definition("color_that_varies")),
    "two_sided_emission": Key(_OF_SHAPES["two_sided_emission"], BOOLEAN),
    **TRANSFORM,
    **PLACES,
}

TEXTURE: Keys = {
    "texture": Key("The image file.", TEXT, required=True),
    "linear": Key("Take an 8-bit file's values as they are, not as sRGB: for numbers, not colours.", BOOLEAN),
}

NORMAL_MAP: Keys = {"texture": Key("The image file, as in glTF.", TEXT, required=True)}

VERTEX_COLORS: Keys = {"vertex_colors": Key("The mesh's own colours.", {"const": True}, required=True)}

IMAGE_ENVIRONMENT: Keys = {"file": Key("OpenEXR, Radiance HDR or .npy; also PNG and the like.", TEXT, required=True)}
