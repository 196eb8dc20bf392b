"""The JSON schema of scene files: it lets pass what the reader reads, and marks what is misspelt or no such value."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from support.pages import blocks
from support.scene_files import COMPOSITES, FULL, MOVING, QUAD
from test_docs import COMMON, COMMON_OF_CAMERAS, COMMON_OF_MATERIALS, SCENE_FORMAT, TABLES, TEXTURES, documented
from test_scene_mistakes import MISTAKES

import wrt
from wrt.cli import main
from wrt.io.toml.reader import load_scene
from wrt.io.toml.schema import scene_schema, schema_text
from wrt.io.toml.writer import save_scene

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
FILES = [
    *sorted((ROOT / "meshes").glob("*.toml")),
    *sorted((ROOT / "tests" / "corpus" / "seeds").glob("*.toml")),
    *sorted((ROOT / "tests" / "corpus" / "failures").glob("many-spheres.toml")),
]
SEEN_BY_THE_READER_ALONE = (
    "no such file",
    "not a known mesh format",
    "there is no [",
    "must differ",
    "crop must",
    "before shutter_open",
    "takes one of",
    "must not emit",
    "is made of itself",
    "are nested",
    "must not be 0",
    "must not be zero",
    "must be finite",
)
"""Words of complaints about what no schema knows: other files, names, and values that must go together."""


@functools.cache
def schema() -> dict[str, Any]:
    return scene_schema()


@functools.cache
def validator() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(schema())


def is_valid(text: str) -> bool:
    return validator().is_valid(tomllib.loads(text))


def is_marked(text: str) -> bool:
    try:
        return not is_valid(text)
    except (tomllib.TOMLDecodeError, RecursionError):  # marked by every editor
        return True


def test_the_published_schema_is_the_one_of_the_code(capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema.Draft7Validator.check_schema(schema())
    assert (ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8") == schema_text()
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == schema_text()


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_scene_files_are_valid(file: Path) -> None:
    validator().validate(tomllib.loads(file.read_text(encoding="utf-8")))


@pytest.mark.parametrize("text", [*blocks(SCENE_FORMAT, "toml"), FULL, COMPOSITES, MOVING, QUAD, "# nothing\n"])
def test_all_that_the_reader_reads_is_valid(text: str) -> None:
    validator().validate(tomllib.loads(text))


def test_written_scenes_are_valid(tmp_path: Path) -> None:
    for name in ("cornell-box", "still-life"):
        save_scene(tmp_path / f"{name}.toml", wrt.load(name))
        validator().validate(tomllib.loads((tmp_path / f"{name}.toml").read_text()))


def test_mistakes_are_marked(report: Any) -> None:
    """All but those that only somebody sees who reads the other files, or several keys at a time."""
    unmarked = {text: message for text, message in MISTAKES.items() if not is_marked(text) and "0" * 400 not in text}
    report("mistakes that the schema marks", f"{len(MISTAKES) - len(unmarked)} of {len(MISTAKES)}")
    assert [m for m in unmarked.values() if not any(words in m for words in SEEN_BY_THE_READER_ALONE)] == []


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("[settings]\nwidth = 65536", True),
        ("[settings]\nwidth = 65537", False),
        ("[settings]\nspp = 1.5", False),
        ("[settings]\nfilter = 'bell'", False),
        ("[settings]\nlayers = ['albedo', 'depth']", True),
        ("[settings]\nlayers = ['albedo', 'depht']", False),
        ("[settings]\ncrop = [0, 0, 4, 4]", True),
        ("[settings]\ncrop = [0, 0, 4]", False),
        ("[camera]\nfov_degrees = 179.9", True),
        ("[camera]\nfov_degrees = 180", False),
        ("[camera]\ntype = 'fisheye'\nfov_degrees = 360", True),
        ("[camera]\ntype = 'fisheye'\naperture = 'disk'", False),
        ("[[lights]]\ntype = 'spot'\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\ninner_degrees = 80\n"
         "outer_degrees = 90\npower = 1", True),
        ("[[lights]]\ntype = 'spot'\nposition = [0, 1, 0]\npower = 1", False),
        ("[environment]\ntype = 'spherical-harmonics'\ncoefficients = [1, 0, 0, 0]", True),
        ("[environment]\ntype = 'spherical-harmonics'\ncoefficients = ['bright']", False),
        ("[materials.m]\ntype = 'rough-conductor'\nalpha = [0.1, 0.2]\nmasking = 'smith'\nmetal = 'Au'", True),
        ("[materials.m]\ntype = 'rough-conductor'\nalpha = 2", False),
        ("[materials.m]\ntype = 'rough-conductor'\ndistribution = 'sgd'\nalpha = [0.1, 5]", True),
        ("[materials.m]\ntype = 'rough-conductor'\nmasking = 'smithy'", False),
        ("[materials.m]\ntype = 'rough-dielectric'\ndistribution = 'beckmann'\nmasking = 'walter'", True),
        ("[materials.m]\ntype = 'principled'\nior = 0\nthin_walled = true", True),
        ("[materials.m]\ntype = 'principled'\nior = 'Diamond'", True),
        ("[materials.m]\ntype = 'principled'\nior = -1", False),
        ("[materials.m]\ntype = 'diffuse'\nreflectance = {texture = 'a.png', wrap = ['clamp', 'mirror']}", True),
        ("[materials.m]\ntype = 'diffuse'\nreflectance = {texture = 'a.png', wrap = 'clammp'}", False),
        ("[materials.m]\ntype = 'diffuse'\nreflectance = 'a.png'", False),
        ("[media.m]\ng = 0.9", True),
        ("[media.m]\ntype = 'color'\ng = 0.9\ncolor = 0.5", False),
    ],
)  # fmt: skip
def test_limits_words_and_forms(tmp_path: Path, text: str, valid: bool) -> None:
    """The schema and the reader agree."""
    assert is_valid(text) == valid
    (tmp_path / "scene.toml").write_text(text)
    if "a.png" in text and valid:
        wrt.save_image(tmp_path / "a.png", [[[1.0, 1.0, 1.0]]])
    if valid:
        load_scene(tmp_path / "scene.toml")
    else:
        with pytest.raises(wrt.InputError):
            load_scene(tmp_path / "scene.toml")


def properties_of(heading: str) -> dict[str, Any]:
    section, _, kind = heading.partition(" ")
    what = {"[media.NAME]": "medium", "[materials.NAME]": "material", "[[lights]]": "light", "[[shapes]]": "shape"}
    name = what.get(section, section.strip("[]")) + (f"-{kind}" if kind else "")
    properties: dict[str, Any] = schema()["definitions"][name]["properties"]
    return properties


@pytest.mark.parametrize("heading", [*TABLES, TEXTURES])
def test_every_documented_key_is_known_with_a_description(heading: str) -> None:
    if heading == TEXTURES:
        properties, expected = properties_of("texture"), {*documented()[TEXTURES], "texture"}
    else:
        commons = {"[camera]": COMMON_OF_CAMERAS, "[materials.NAME]": COMMON_OF_MATERIALS, "[[shapes]]": COMMON}
        common = documented().get(commons.get(heading.partition(" ")[0], ""), {})
        properties, expected = properties_of(heading), {*documented()[heading], *common}
        expected |= {"type"} if heading != "[settings]" else set()
    assert set(properties) == expected
    assert [name for name, schema in properties.items() if len(schema["description"]) < 5] == []
