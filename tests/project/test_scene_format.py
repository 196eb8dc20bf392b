"""The JSON schema, whose keys docs/scene-format.md explains, agrees with the code and with the reader."""

import functools
import inspect
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from conftest import ROOT
from support.pages import PAGES, blocks, parsed
from support.scene_files import COMPOSITES, FULL, MISTAKES, MOVING, QUAD, write_beside

import wrt
from wrt.cli import main
from wrt.io.images import load_environment
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import _SceneReader, load_scene, shape_makers
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS
from wrt.scene.medium import MEDIA

SCENE_FORMAT = PAGES["docs/scene-format.md"]
SCHEMA = (ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8")
DEFINITIONS: dict[str, Any] = json.loads(SCHEMA)["definitions"]
KINDS: dict[str, Mapping[str, Callable[..., Any]]] = {
    "camera": CAMERAS,
    "environment": {**ENVIRONMENTS, "image": load_environment},
    "light": LIGHTS,
    "medium": MEDIA,
    "material": MATERIALS,
    "shape": shape_makers(),
}
TABLES = {"settings": wrt.RenderSettings, "texture": wrt.ImageTexture, "normal_map": wrt.NormalMap}
TABLES |= {f"{name}-{kind}": make for name, kinds in KINDS.items() for kind, make in kinds.items()}
FROM_FILES = {"path": "file", "pixels": "texture"}
"""Parameters that a scene file gives as a file, and their keys."""


def plain(value: Any) -> Any:
    """Return a default as JSON has it."""
    return list(map(plain, value)) if isinstance(value, tuple) else value


def test_every_kind_of_table_is_in_the_schema_and_on_the_page():
    for name, kinds in KINDS.items():
        assert DEFINITIONS[name]["properties"]["type"]["enum"] == list(kinds)
        for kind in kinds:
            assert f'### type = "{kind}"' in SCENE_FORMAT
    for name in ("camera", "medium"):  # the others have no default type
        assert "required" not in DEFINITIONS[name]
    with pytest.raises(wrt.InputError) as caught:
        _SceneReader(Path("x"), None).meshes({"type": "?"})
    assert set(re.findall(r"'([\w-]+)'", str(caught.value).partition(", not ")[0])) == set(KINDS["shape"])


@pytest.mark.parametrize("name", TABLES)
def test_keys_and_defaults_are_those_of_the_code(name):
    found, parameters = DEFINITIONS[name], inspect.signature(TABLES[name]).parameters
    keys = {FROM_FILES.get(key, key): parameter for key, parameter in parameters.items()}
    shared = set(scene_keys.SHAPE) if name.startswith("shape-") else {"type"} if "-" in name else set()
    shared = shared | ({"name"} if name.startswith("light-") else set())
    read_otherwise = {"texture": {"linear"}}.get(name, set())
    nameless = set() if name.startswith("material-") else {"name"} - shared
    assert set(found["properties"]) == (set(keys) - nameless) | shared | read_otherwise
    for key in set(keys) & set(found["properties"]) - shared:
        default = keys[key].default
        assert (key in found.get("required", ())) == (default is inspect.Parameter.empty), key
        if isinstance(default, (bool, int, float, str)) or (isinstance(default, tuple) and default):
            assert found["properties"][key]["default"] == plain(default), key
        else:
            assert "default" not in found["properties"][key], key
    for key, schema in found["properties"].items():
        assert len(schema["description"]) >= 5, key


@functools.cache
def validator() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(json.loads(SCHEMA))


def test_the_published_schema_is_the_one_of_the_code(capsys):
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
"""Values at their limits, words and forms that the reader accepts."""


def test_all_that_the_reader_reads_or_the_writer_writes_is_valid(tmp_path):
    corpus = ROOT / "tests" / "corpus"
    files = [*(ROOT / "meshes").glob("*.toml"), *(corpus / "seeds").glob("*.toml")]
    for name in ("cornell-box", "still-life"):
        wrt.save_scene(tmp_path / f"{name}.toml", wrt.load(name))
        files.append(tmp_path / f"{name}.toml")
    texts = [file.read_text(encoding="utf-8") for file in files]
    write_beside(tmp_path)
    (tmp_path / "limits.toml").write_text(LIMITS)
    load_scene(tmp_path / "limits.toml")
    texts.append('materials.felt = { type = "measured", measurement = "felt.bsdf", opacity = 0.5 }')
    for text in (*texts, *blocks(SCENE_FORMAT, "toml"), FULL, COMPOSITES, MOVING, QUAD, LIMITS, "# nothing\n"):
        validator().validate(parsed(text))


SEEN_BY_THE_READER_ALONE = re.compile(
    r"no such file|it is an image|there is no \[|must differ|crop must|before shutter_open|takes one of"
    "|must not emit|is made of itself|are nested|must not be (0|zero)|must be finite"
)
"""Words of complaints about what no schema knows: other files, names, and values that must go together."""


def is_marked(text: str) -> bool:
    try:
        return not validator().is_valid(parsed(text))
    except (ValueError, RecursionError):  # marked by every editor
        return True


def test_mistakes_are_marked(report):
    """Except where other files, or several keys at a time, must be read."""
    unmarked = {text: message for text, message in MISTAKES.items() if not is_marked(text) and "0" * 400 not in text}
    report("mistakes that the schema marks", f"{len(MISTAKES) - len(unmarked)} of {len(MISTAKES)}")
    assert [m for m in unmarked.values() if not SEEN_BY_THE_READER_ALONE.search(m)] == []
