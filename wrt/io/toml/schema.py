"""The JSON schema of scene files, by which editors complete keys, show what they mean and mark what is wrong.

It is generated from what the reader uses: the classes and functions behind the tables, with their types, docstrings and
checks, and `scene_keys`. It does not check combinations of keys.
"""

from __future__ import annotations

import inspect
import json
import math
import re
import typing
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from wrt.describe.docstrings import meanings_of, summary_of
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import shape_makers
from wrt.io.toml.scene_keys import BOOLEAN, NUMBER, TEXT, VECTOR, Keys, Schema, array_of, definition, own_fields
from wrt.scene.camera import CAMERAS
from wrt.scene.description import checks_of
from wrt.scene.environment import ENVIRONMENTS, ImageEnvironment
from wrt.scene.integrators import Integrator
from wrt.scene.layers import GROUPS, SELECTABLE
from wrt.scene.lights import LIGHTS
from wrt.scene.lights.light import unit_vector
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.dielectrics import refractive_index
from wrt.scene.materials.dispersion import MOST as MOST_DISPERSION
from wrt.scene.materials.material import color_source, value_source
from wrt.scene.materials.measured import Measurement
from wrt.scene.materials.microfacet import LEAST_ALPHA, MASKINGS
from wrt.scene.medium import MEDIA, DensityGrid, Medium
from wrt.scene.motion import Motion
from wrt.scene.procedural import TEXTURES
from wrt.scene.scene import RenderSettings
from wrt.scene.shapes import MAX_SUBDIVISIONS
from wrt.scene.textures import WRAPS, ImageTexture, NormalMap, VertexColor
from wrt.values import Vec3, boolean, color, integer, number, vector

_UNLIMITED = 1e30  # larger limits are those of float32

_PAIR = array_of(NUMBER, 2, 2)

_OBJECTS: dict[Any, Schema] = {
    **dict.fromkeys((Material, Medium, Measurement), TEXT),  # the name of a table or a file
    Motion: definition("motion"),
    NormalMap: definition("normal_map"),
    DensityGrid: definition("density"),
    ImageTexture: definition("texture"),
}
"""Arguments that are objects in Python."""


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
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"


def _definitions() -> Iterable[tuple[str, Schema]]:
    yield "vector", array_of(NUMBER, 3, 3)
    yield "texture", _made(ImageTexture, scene_keys.TEXTURE, only=own_fields(ImageTexture))
    yield "normal_map", _made(NormalMap, scene_keys.NORMAL_MAP, only=own_fields(NormalMap))
    yield "vertex_colors", _made(VertexColor, scene_keys.VERTEX_COLORS)
    yield "color_that_varies", {"anyOf": [*_color(), *_that_vary()]}
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
    yield from _kinds("procedure", TEXTURES)
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
    parameters, hints = inspect.signature(make).parameters, typing.get_type_hints(make, include_extras=True)
    table = _table(keys or {}, description=summary_of(make))
    for name in parameters if only is None else only:
        default = parameters[name].default
        described = _described(_value(name, hints.get(name, Any)), _meaning(make, name))
        if isinstance(default, (bool, int, float, str)) or (isinstance(default, tuple) and default):
            described["default"] = default
        elif default is inspect.Parameter.empty:
            table.setdefault("required", []).append(name)
        table["properties"][name] = described
    return table


def _meaning(make: Callable[..., Any], name: str) -> str:
    """Return the meaning of an argument; "as for CLASS" is replaced by the meaning in that class."""
    meaning = meanings_of(make).get(name, "")
    if found := re.match(r"as for (\w+)\.?$", meaning):
        return next((_meaning(cls, name) for cls in MATERIALS.values() if cls.__name__ == found[1]), meaning)
    return meaning


def _value(name: str, hint: Any) -> Schema:
    """Return the schema of an argument, whose type may be `Annotated` by its schema or by its check."""
    note = None
    if typing.get_origin(hint) is typing.Annotated:
        hint, note, *_ = typing.get_args(hint)
        if isinstance(note, dict):
            return dict(note)
    kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind is not type(None)]
    if kinds[0] in _OBJECTS:
        return _OBJECTS[kinds[0]]
    if "numpy" in str(hint):
        return array_of({"anyOf": [NUMBER, VECTOR]}, 1)
    options = _of_check(note) or _UNCHECKED.get(name) or _of_type(name, hint, kinds)
    if str in kinds and not any("enum" in each for each in options):
        options = [*options, TEXT]
    if Integrator in kinds:
        options = [*options, {"type": "object", "required": ["type"]}]
    if ImageTexture in kinds:
        options = [*options, *_that_vary()]
    return options[0] if len(options) == 1 else {"anyOf": options}


def _of_check(check: Any) -> list[Schema]:
    """Return the schemas of the values that a check of `wrt.scene` accepts; none if it is of another kind."""
    options: dict[str, Any] = {}
    while isinstance(check, partial):
        options = {**check.keywords, **options}
        check = options.pop("check", check.func)
    if check in (vector, unit_vector):
        return [VECTOR]
    if check is boolean:
        return [BOOLEAN]
    if check is refractive_index:
        return [_number(above=0.0)]
    if "words" in options:
        return [{"enum": list(options["words"])}]
    if check not in (number, integer, color, value_source, color_source):
        return []
    defaults = {name: parameter.default for name, parameter in inspect.signature(check).parameters.items()}
    options = {**defaults, **options}
    kind = "integer" if check is integer else "number"
    if check in (color, color_source):
        return _color(maximum=options["maximum"])
    return [_number(kind, **{name: options[name] for name in ("minimum", "maximum", "above") if name in options})]


def _of_type(name: str, hint: Any, kinds: list[Any]) -> list[Schema]:
    """Return the schemas of an argument by its type."""
    if Vec3 in (hint, kinds[0]):
        return [VECTOR]
    if hint is float:
        return [_number(above=0.0 if name in ("radius", "distance") else -math.inf)]
    if bool in kinds:
        return [BOOLEAN]
    return _color() if float in kinds else []


def _number(
    kind: str = "number", minimum: float = -math.inf, maximum: float = math.inf, above: float = -math.inf
) -> Schema:
    """Return the schema of a number, without limits that only float32 sets."""
    lowest = {"exclusiveMinimum": above} if above >= minimum else {"minimum": minimum}
    limits = {key: x for key, x in {"maximum": maximum, **lowest}.items() if abs(x) < _UNLIMITED}
    return {"type": kind, **{key: int(x) if x == int(x) else float(f"{x:g}") for key, x in limits.items()}}


def _color(maximum: float = math.inf) -> list[Schema]:
    grey = _number(minimum=0.0, maximum=maximum)
    return [grey, array_of(grey, 3, 3), {"type": "string"}]


def _that_vary() -> list[Schema]:
    """Return the schemas of a value that varies over a surface."""
    return [definition("texture"), {"const": "vertex-colors"}, definition("vertex_colors"), definition("procedure")]


def _unchecked() -> dict[str, list[Schema]]:
    """Return the schemas of arguments that checks of fields leave to other code, by name."""
    layer, wrap, share = {"enum": [*SELECTABLE, *GROUPS]}, {"enum": list(WRAPS)}, _number(minimum=0.0, maximum=1.0)
    maskings = dict.fromkeys(masking for maskings in MASKINGS.values() for masking in maskings)
    return {
        "ior": [_number(minimum=0.0)],
        "albedo": _color(maximum=1.0),
        "alpha": [_number(minimum=LEAST_ALPHA, maximum=1.0), _PAIR],
        "anisotropy": [share],
        "crop": [array_of(_number("integer", minimum=0, maximum=65536), 4, 4)],
        "distortion": [array_of(NUMBER, 0, 8)],
        "dispersion": [_number(minimum=0.0, maximum=MOST_DISPERSION)],
        "distribution": [{"enum": list(MASKINGS)}],
        "f0": _color(maximum=1.0),
        "g": _of_check(checks_of(Medium)["g"]),
        "inner_degrees": [_number(minimum=0.0, maximum=180.0)],
        "layers": [array_of(layer), layer, TEXT],
        "masking": [{"enum": list(maskings)}],
        "offset": [_PAIR],
        "scale": [NUMBER, _PAIR],
        "subdivisions": [_number("integer", minimum=0, maximum=MAX_SUBDIVISIONS)],
        "uv_offset": [_PAIR],
        "uv_scale": [NUMBER, _PAIR],
        "wrap": [wrap, array_of(wrap, 2, 2)],
    }


_UNCHECKED = _unchecked()
