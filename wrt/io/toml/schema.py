"""The JSON schema of scene files, by which editors complete keys, show what they mean and mark what is wrong.

It is generated from what the reader uses: the classes and functions behind the tables, with their types, docstrings and
checks, and `scene_keys`. It does not check combinations of keys.
"""

from __future__ import annotations

import inspect
import json
import re
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from wrt.describe.docstrings import meanings_of, summary_of
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import shape_makers
from wrt.io.toml.scene_keys import BOOLEAN, NUMBER, TEXT, VECTOR, Keys, Schema, array_of, definition, own_fields
from wrt.io.toml.value_ranges import FORMS, Limits
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS, ImageEnvironment
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.measured import Measurement
from wrt.scene.medium import MEDIA, DensityGrid, Medium
from wrt.scene.motion import Motion
from wrt.scene.scene import RenderSettings
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor

_FOUND_BY_NAME = (Material, Medium, Measurement)
"""Given by the name of a table or a file in a scene file, and as objects in Python."""


_LONGEST_LINE = 110


def scene_schema() -> Schema:
    """Return the JSON schema, draft 7, of a scene file as nested dictionaries."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Scene of wrt",
        "description": "Right-handed, y up; metres, seconds, degrees; colours are linear Rec. 709.",
        **_table(scene_keys.SECTIONS),
        "definitions": dict(_definitions()),
    }


def schema_text() -> str:
    """Return the schema as JSON text."""
    text = json.dumps(scene_schema(), indent=1, ensure_ascii=False)

    def joined(found: re.Match[str]) -> str:
        line = re.sub(r"\n\s*", " ", found[0]).replace("[ ", "[").replace(" ]", "]")
        return line if len(line) <= _LONGEST_LINE else found[0]

    for _ in range(3):  # put short objects on one line, innermost first
        text = re.sub(r"\{[^{}\[\]]*\}|\[[^{}\[\]]*\]|\{\n[^\n]*\n\s*\}", joined, text)
    return text + "\n"


def _definitions() -> Iterable[tuple[str, Schema]]:
    yield "vector", array_of(NUMBER, 3, 3)
    yield "texture", _made(ImageTexture, scene_keys.TEXTURE, only=own_fields(ImageTexture))
    yield "normal_map", _made(NormalMap, scene_keys.NORMAL_MAP, only=own_fields(NormalMap))
    yield "vertex_colors", _made(VertexColor, scene_keys.VERTEX_COLORS)
    color = Limits(VertexColor).forms("factor")
    yield "color_that_varies", {"anyOf": [*_numbers(color, whole=False), *_that_vary()]}
    yield "turn", _table(scene_keys.TURN)
    yield "keyframe", {"anyOf": [_table(scene_keys.KEYFRAME), _table(scene_keys.MATRIX_KEYFRAME)]}
    yield "motion", {"anyOf": [_table(scene_keys.KEYFRAMES), _table(scene_keys.EVEN_MOTION)]}
    yield "instance", _table(scene_keys.INSTANCE)
    yield (
        "deformation",
        {"anyOf": [_table(scene_keys.DEFORMATION_FILES), _table(scene_keys.DEFORMATION_ARCHIVE)]},
    )
    yield "density", _made(DensityGrid, scene_keys.DENSITY, only=scene_keys.DENSITY_OWN)
    yield "settings", _made(RenderSettings)
    yield from _kinds("camera", CAMERAS, default="perspective")
    yield from _kinds("environment", ENVIRONMENTS)
    yield from _kinds("light", LIGHTS)
    yield from _kinds("medium", MEDIA, default="coefficients")
    yield from _kinds("material", MATERIALS)
    yield from _kinds("shape", shape_makers(), common=scene_keys.SHAPE)


def _kinds(
    what: str, kinds: Mapping[str, Callable[..., Any]], *, default: str | None = None, common: Keys | None = None
) -> Iterable[tuple[str, Schema]]:
    """Yield the schema of a table with a `type`, and of each of its types.

    Conditions select the type, so that editors mark a mistake at its key; with `anyOf` they would mark the whole table.
    """
    tables: dict[str, Schema] = {}
    for kind, make in kinds.items():
        keys = dict(common or {})
        keys["type"] = scene_keys.Key(summary_of(make), {"const": kind}, required=kind != default)
        if make is ImageEnvironment:
            tables[kind] = _made(make, {**keys, **scene_keys.IMAGE_ENVIRONMENT}, only=own_fields(make))
        else:
            tables[kind] = _made(make, keys)
    properties: Schema = {"type": {"description": "What it is.", "enum": list(kinds)}}
    for name in dict.fromkeys(name for table in tables.values() for name in table["properties"] if name != "type"):
        found = [table["properties"][name] for table in tables.values() if name in table["properties"]]
        alike = all(each == found[0] for each in found)
        properties[name] = found[0] if alike else {"description": found[0]["description"]}
    cases = []
    for kind in kinds:
        missing: Schema = {} if kind == default else {"required": ["type"]}
        cases.append({"if": {"properties": {"type": {"const": kind}}, **missing}, "then": definition(f"{what}-{kind}")})
    required: Schema = {} if default else {"required": ["type"]}
    yield what, {"type": "object", "properties": properties, **required, "allOf": cases}
    for kind, table in tables.items():
        yield f"{what}-{kind}", table


def _described(schema: Schema, meaning: str) -> Schema:
    """Return a schema with a description; a bare reference cannot have one."""
    return {"description": meaning, **({"allOf": [schema]} if "$ref" in schema else schema)}


def _table(keys: Keys, properties: Schema | None = None, description: str = "") -> Schema:
    """Return the schema of a table with keys, and with further properties."""
    described = {name: _described(key.schema, key.meaning) for name, key in keys.items()}
    required = [name for name, key in keys.items() if key.required]
    return {
        **({"description": description} if description else {}),
        "type": "object",
        "properties": {**described, **(properties or {})},
        **({"required": required} if required else {}),
        "additionalProperties": False,
    }


def _made(make: Callable[..., Any], keys: Keys | None = None, only: list[str] | None = None) -> Schema:
    """Return the schema of a table whose keys are arguments of a class or function, all or some, and further keys."""
    limits = Limits(make)
    parameters = inspect.signature(make).parameters
    properties: Schema = {}
    for name in limits.hints if only is None else only:
        default = parameters[name].default
        properties[name] = _described(_value(limits, name), _meaning(make, name))
        if isinstance(default, (bool, int, float, str)) or (isinstance(default, tuple) and default):
            properties[name]["default"] = default
    table = _table(keys or {}, properties, summary_of(make))
    if required := [*table.get("required", []), *(name for name in limits.required if name in properties)]:
        table["required"] = required
    return table


def _meaning(make: Callable[..., Any], name: str) -> str:
    """Return the meaning of an argument; "as for CLASS" is replaced by the meaning in that class."""
    meaning = meanings_of(make).get(name, "")
    if found := re.match(r"as for (\w+)\.?$", meaning):
        return next((_meaning(cls, name) for cls in MATERIALS.values() if cls.__name__ == found[1]), meaning)
    return meaning


def _value(limits: Limits, name: str) -> Schema:
    """Return the schema of an argument."""
    hint = limits.hints[name]
    if typing.get_origin(hint) is typing.Annotated:
        return dict(typing.get_args(hint)[1])
    kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind is not type(None)]
    if any(kind in _FOUND_BY_NAME for kind in kinds):
        return TEXT
    if Motion in kinds or NormalMap in kinds:
        return definition("motion" if Motion in kinds else "normal_map")
    if kinds == [DensityGrid]:
        return definition("density")
    if kinds == [bool]:
        return BOOLEAN
    if kinds == [ImageTexture]:
        return definition("texture")
    if "numpy" in str(hint):
        return array_of({"anyOf": [NUMBER, VECTOR]}, 1)
    options = _words(limits, name, kinds) or _arrays(limits, name, hint) or []
    if not options:
        options = _numbers(limits.forms(name) if str not in kinds[:1] else {}, whole=int in kinds)
    if str in kinds and name not in limits.words:
        names = limits.known_names(name)
        options += [{"enum": names}, TEXT] if names else [TEXT]
    if ImageTexture in kinds:
        options += _that_vary()
    return options[0] if len(options) == 1 else {"anyOf": options}


def _words(limits: Limits, name: str, kinds: list[Any]) -> list[Schema]:
    """Return the schemas of an argument that is one of several words, or a pair of them."""
    if name not in limits.words:
        return []
    word: Schema = {"enum": limits.words[name]}
    several = any(typing.get_origin(kind) is not None for kind in kinds)
    return [word, array_of(word, 2, 2)] if several else [word]


def _arrays(limits: Limits, name: str, hint: Any) -> list[Schema]:
    """Return the schemas of an argument that is a tuple."""
    options = (hint, *typing.get_args(hint))
    items = next((typing.get_args(option) for option in options if typing.get_origin(option) is tuple), ())
    if not items:
        return []
    if str in items:
        return [array_of({"enum": limits.known_names(name)})]
    if tuple(items) == (float, float, float):
        return [VECTOR]
    item = {"type": "integer" if int in items else "number", **limits.of_items(name, len(items))}
    return [array_of(item, len(items), len(items))]


def _numbers(forms: Mapping[str, Schema], *, whole: bool) -> list[Schema]:
    """Return the schemas of numbers by their form."""
    kind = "integer" if whole else "number"
    numbers: list[Schema] = []
    for form, limits in forms.items():
        number: Schema = {"type": kind, **limits}
        numbers.append(array_of(number, FORMS[form], FORMS[form]) if FORMS[form] else number)
    return numbers


def _that_vary() -> list[Schema]:
    """Return the schemas of a value that varies over a surface."""
    return [definition("texture"), {"const": "vertex-colors"}, definition("vertex_colors")]
