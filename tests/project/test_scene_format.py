"""docs/scene-format.md has the keys and defaults of the code; the JSON schema agrees with the reader."""

from __future__ import annotations

import functools
import inspect
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import jsonschema
import numpy as np
import pytest
from conftest import ROOT
from support.pages import PAGES, blocks, parsed
from support.scene_files import COMPOSITES, FULL, MISTAKES, MOVING, QUAD, write_beside

import wrt
from wrt.cli import main
from wrt.io.images import load_environment
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import _SceneReader, load_scene
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS
from wrt.scene.medium import MEDIA

SCENE_FORMAT = PAGES["docs/scene-format.md"]
SHAPES: dict[str, Callable[..., Any]] = {
    **{maker.__name__: maker for maker in (wrt.quad, wrt.box, wrt.sphere, wrt.disk, wrt.cylinder)},
    **{kind: getattr(_SceneReader, kind) for kind in ("polygon", "polygons", "spheres", "quadrics")},
    "mesh": _SceneReader.mesh_file,
    "many-triangles": _SceneReader.many_triangles,
}
MAKERS: dict[str, dict[str, Callable[..., Any]]] = {
    "[camera]": CAMERAS,
    "[environment]": {**ENVIRONMENTS, "image": load_environment},
    "[[lights]]": LIGHTS,
    "[media.NAME]": MEDIA,
    "[materials.NAME]": MATERIALS,
    "[[shapes]]": SHAPES,
}
TABLES = {"[settings]": wrt.RenderSettings}
TABLES |= {f"{section} {kind}": maker for section, makers in MAKERS.items() for kind, maker in makers.items()}
COMMON = {"[camera]": wrt.Camera, "[materials.NAME]": wrt.Material, "[[shapes]]": wrt.Shape}
TEXTURES = "### Textures"


@functools.cache
def documented(column: str = "default") -> dict[str, dict[str, str]]:
    """Return the tables of keys: what heading they stand under, then key and text of the default or the meaning."""
    result: dict[str, dict[str, str]] = {}
    section = heading = ""
    for line in SCENE_FORMAT.splitlines():
        if found := re.match(r"## `(.+)`$", line):
            section = heading = found[1]
        elif found := re.match(r'### type = "(.+)"$', line):
            heading = f"{section} {found[1]}"
        elif line == TEXTURES:
            heading = line
        elif found := re.match(r"\| `(\w+)` \| (?P<default>.+?) \| (?P<meaning>.+) \|$", line):
            result.setdefault(heading, {})[found[1]] = found[column]
    return result


def plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def value_of(text: str) -> Any:
    """Return the TOML value in backticks, or None where the default is told in words."""
    found = re.fullmatch(r"`(.+)`", text)
    return None if found is None else plain(parsed(f"x = {found[1]}")["x"])


def parameters_of(maker: Callable[..., Any], *without: str) -> dict[str, inspect.Parameter]:
    return {name: p for name, p in inspect.signature(maker).parameters.items() if name not in without}


def test_every_kind_of_table_is_documented_and_no_other() -> None:
    assert set(documented()) == {*TABLES, *COMMON, TEXTURES}
    with pytest.raises(wrt.InputError) as caught:
        _SceneReader(Path("x"), None).meshes({"type": "?"})
    assert set(re.findall(r"'([\w-]+)'", str(caught.value).partition(", not ")[0])) == set(SHAPES)


@pytest.mark.parametrize("heading", TABLES)
def test_keys_and_defaults_are_those_of_the_code(heading: str) -> None:
    section, maker, table = heading.partition(" ")[0], TABLES[heading], documented()[heading]
    common = inspect.signature(COMMON[section]).parameters if section in ("[camera]", "[materials.NAME]") else ()
    parameters = parameters_of(maker, "self", "path", *common)
    assert set(table) == set(parameters) | ({"file"} if maker is load_environment else set())
    assert maker is not load_environment or table["file"] == "required"
    for name, parameter in parameters.items():
        if parameter.default is inspect.Parameter.empty:
            assert table[name] == "required", name
        elif parameter.default is None or repr(parameter.default) == "<factory>":
            assert value_of(table[name]) is None, name
            assert section == "[materials.NAME]" or "`" not in table[name].replace("`target`", ""), name
        else:
            assert value_of(table[name]) == plain(parameter.default), name
    if section == "[materials.NAME]":
        said = {key for key, text in documented("meaning")[heading].items() if text.endswith("Varies")}
        varying = {key for key, hint in get_type_hints(maker).items() if wrt.ImageTexture in get_args(hint)}
        assert said == varying - {"opacity"}


def test_keys_that_several_kinds_share_are_those_of_the_code() -> None:
    materials, cameras, shapes = (documented()[name] for name in ("[materials.NAME]", "[camera]", "[[shapes]]"))
    assert set(materials) == {"type", *parameters_of(wrt.Material)}
    assert [materials["type"], value_of(materials["opacity"]), materials["normal_map"]] == ["required", 1.0, "none"]
    assert set(cameras) == {"type", *parameters_of(wrt.Camera)}
    assert value_of(cameras["type"]) == next(iter(CAMERAS))
    for name, parameter in parameters_of(wrt.Camera).items():
        assert value_of(cameras[name]) == plain(parameter.default), name
    assert set(shapes) == set(scene_keys.SHAPE)
    shape = parameters_of(wrt.Shape)
    for name in ("emission", "two_sided_emission"):
        assert value_of(shapes[name]) == plain(shape[name].default)
    given = {name: value_of(shapes[name]) for name in ("scale", "translate")}
    np.testing.assert_array_equal(_SceneReader(Path("x"), None).transform(given), np.eye(4))
    textures = parameters_of(wrt.ImageTexture, "pixels", "name")
    assert set(documented()[TEXTURES]) == {"linear", *textures}
    for name, parameter in textures.items():
        assert value_of(documented()[TEXTURES][name]) == plain(parameter.default), name


# --- Schema ----------------------------------------------------------------------------------------


SCHEMA = (ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8")
DEFINITIONS: dict[str, Any] = json.loads(SCHEMA)["definitions"]


@functools.cache
def validator() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(json.loads(SCHEMA))


def test_the_published_schema_is_the_one_of_the_code(capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema.Draft7Validator.check_schema(json.loads(SCHEMA))
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == SCHEMA


LIMITS = """
camera = { type = "fisheye", fov_degrees = 360 }
environment = { type = "spherical-harmonics", coefficients = [1, 0, 0, 0] }
lights = [{ type = "spot", position = [0, 1, 0], direction = [0, 0, 1], power = 1, outer_degrees = 90 }]
settings = { width = 65536, layers = ["albedo", "depth"], crop = [0, 0, 4, 4] }
media.m = { g = 0.9 }
materials.metal = { type = "rough-conductor", alpha = [0.1, 0.2], masking = "smith", metal = "Au" }
materials.sgd = { type = "rough-conductor", distribution = "sgd", alpha = [0.1, 5], f0 = 0.9 }
materials.paint = { type = "principled", ior = "Diamond" }
materials.wood = { type = "diffuse", reflectance = { texture = "wood.png", wrap = ["clamp", "mirror"] } }
"""
"""Values at their limits, words and forms, all of which the reader takes."""


def test_all_that_the_reader_reads_or_the_writer_writes_is_valid(tmp_path: Path) -> None:
    corpus = ROOT / "tests" / "corpus"
    files = [*(ROOT / "meshes").glob("*.toml"), *(corpus / "seeds").glob("*.toml")]
    for name in ("cornell-box", "still-life"):
        wrt.save_scene(tmp_path / f"{name}.toml", wrt.load(name))
        files.append(tmp_path / f"{name}.toml")
    texts = [file.read_text(encoding="utf-8") for file in files]
    write_beside(tmp_path)
    (tmp_path / "limits.toml").write_text(LIMITS)
    load_scene(tmp_path / "limits.toml")
    for text in (*texts, *blocks(SCENE_FORMAT, "toml"), FULL, COMPOSITES, MOVING, QUAD, LIMITS, "# nothing\n"):
        validator().validate(parsed(text))


SEEN_BY_THE_READER_ALONE = re.compile(
    r"no such file|not a known mesh format|there is no \[|must differ|crop must|before shutter_open|takes one of"
    "|must not emit|is made of itself|are nested|must not be (0|zero)|must be finite"
)
"""Words of complaints about what no schema knows: other files, names, and values that must go together."""


def is_marked(text: str) -> bool:
    try:
        return not validator().is_valid(parsed(text))
    except (ValueError, RecursionError):  # marked by every editor
        return True


def test_mistakes_are_marked(report: Any) -> None:
    """All but those that only somebody sees who reads the other files, or several keys at a time."""
    unmarked = {text: message for text, message in MISTAKES.items() if not is_marked(text) and "0" * 400 not in text}
    report("mistakes that the schema marks", f"{len(MISTAKES) - len(unmarked)} of {len(MISTAKES)}")
    assert [m for m in unmarked.values() if not SEEN_BY_THE_READER_ALONE.search(m)] == []


def test_every_documented_key_is_in_the_schema_with_a_description() -> None:
    names = {"[media.NAME]": "medium", "[materials.NAME]": "material", "[[lights]]": "light", "[[shapes]]": "shape"}
    for heading in [*TABLES, TEXTURES]:
        section, _, kind = heading.partition(" ")
        common = documented()[section] if section in COMMON else {}
        expected = {*documented()[heading], *common} | ({"type"} if heading != "[settings]" else set())
        name = names.get(section, section.strip("[]")) + (f"-{kind}" if kind else "")
        if heading == TEXTURES:
            name, expected = "texture", {*documented()[TEXTURES], "texture"}
        properties: dict[str, Any] = DEFINITIONS[name]["properties"]
        assert set(properties) == expected, heading
        assert [name for name, schema in properties.items() if len(schema["description"]) < 5] == []
