"""README and docs are true: examples run, commands parse, tables match the code."""

from __future__ import annotations

import argparse
import inspect
import re
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from conftest import ROOT
from support.pages import PAGES, blocks, inline_code

import wrt
from wrt.cli.arguments.options import EXAMPLES, make_parser, parse
from wrt.io.images import load_environment
from wrt.io.measured.measurement import save_measurement
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import _SceneReader, load_scene
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS, ConstantEnvironment
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS
from wrt.scene.medium import MEDIA

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

README = PAGES["README.md"]
SCENE_FORMAT = PAGES["docs/scene-format.md"]


def write_files(folder: Path) -> None:
    """Write every file that an example names."""
    np.save(folder / "cloud.npy", np.ones((2, 3, 4), np.float32))
    ball = wrt.sphere((0.0, 0.5, 0.0), 0.5, subdivisions=2)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices] + [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]
    shutil.copy(ROOT / "meshes" / "teapot.ply", folder)
    for name in ("bunny", "tree", "flag0", "flag1"):
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    rng = np.random.default_rng(0)
    for name in ("wood", "robot", "robot-orm", "leaf", "leaf-mask", "letters"):
        wrt.save_image(folder / f"{name}.png", rng.uniform(0.0, 1.0, (4, 4, 3)))
    with (folder / "felt_rgb.bsdf").open("wb") as file:
        save_measurement(file, wrt.Measured.example().measurement)
    wrt.save_image(folder / "robot-bumps.png", np.full((4, 4, 3), (0.2, 0.2, 1.0)))
    wrt.save_image(folder / "sky.exr", rng.uniform(0.0, 2.0, (4, 8, 3)))


# --- Examples --------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every renderer make a small picture, of few samples: what examples show is large as a rule."""
    start, passes = wrt.Renderer.__init__, wrt.Renderer.passes

    def small_start(self: wrt.Renderer, scene: wrt.Scene, **options: Any) -> None:
        if not options.get("width") or options["width"] > 64:
            options = {**options, "width": 16, "height": 12}
        start(self, scene, **options)

    def few_passes(self: wrt.Renderer, *, spp: int | None = None, noise: float | None = None, **_: Any) -> Any:
        few = spp if spp is not None and spp <= 16 else (spp or 64) // 64
        return passes(self, spp=few) if noise is None else passes(self, noise=noise)

    monkeypatch.setattr(wrt.Renderer, "__init__", small_start)
    monkeypatch.setattr(wrt.Renderer, "passes", few_passes)


@pytest.mark.slow
def test_python_examples_run_and_write_what_they_say(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    # Other tests run these pages: the first three are programs, the next quotes a kernel, the last shows a widget.
    own = ("docs/own-bsdf.md", "docs/own-camera.md", "docs/own-light.md", "docs/spmd.md", "docs/view.md")
    pages = {page: text for page, text in PAGES.items() if page not in own}
    examples = [(page, code) for page, text in pages.items() for code in blocks(text, "python")]
    assert len([page for page, _ in examples if page == "README.md"]) >= 2
    for page, code in examples:
        names: dict[str, Any] = {}
        exec(compile(code, page, "exec"), names)
        written = re.findall(r'save(?:_image|_checkpoint)?\(f?"([^"]+)"', code)
        assert written
        for name in written:
            files = list(tmp_path.glob(re.sub(r"\{[^}]*\}", "*", name)))
            assert files, f"{page}: {name} was not written"
            for file in files:
                if file.suffix in (".png", ".exr"):
                    assert wrt.load_image(file).any(), f"{page}: {name} is black"
    said = capsys.readouterr().out
    assert re.fullmatch(r"(\d+ of 4 samples per pixel\n)+\d+ samples per pixel, noise 0\.0\d+\n", said)


@pytest.mark.slow
def test_the_scene_file_renders(tmp_path: Path) -> None:
    complete, *parts = blocks(SCENE_FORMAT, "toml")
    write_files(tmp_path)
    (tmp_path / "room.toml").write_text(complete)
    assert set(tomllib.loads(complete)) == set(scene_keys.SECTIONS) - {"medium"}
    image = wrt.render(tmp_path / "room.toml", width=24, height=16, spp=4)
    assert np.isfinite(image).all()
    assert (image.max(axis=2) > 0.0).mean() > 0.9
    for part in parts:
        (tmp_path / "part.toml").write_text(part)
        load_scene(tmp_path / "part.toml")


OTHER_TOML = [(page, text) for page in PAGES if page != "docs/scene-format.md" for text in blocks(PAGES[page], "toml")]


@pytest.mark.parametrize(("page", "text"), OTHER_TOML, ids=[page for page, _ in OTHER_TOML])
def test_parts_of_scene_files_on_other_pages_are_read(page: str, text: str, tmp_path: Path) -> None:
    if page.startswith("docs/own-"):  # what it names is registered by the program of the page
        return
    write_files(tmp_path)
    (tmp_path / "part.toml").write_text(text)
    load_scene(tmp_path / "part.toml")


def test_the_message_shown_for_a_mistake_is_the_one_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (shown,) = re.findall(r"^    (room\.toml: .*)$", SCENE_FORMAT, re.MULTILINE)
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    Path("room.toml").write_text(blocks(SCENE_FORMAT, "toml")[0].replace('material = "glass"', 'materal = "glass"'))
    with pytest.raises(wrt.InputError) as caught:
        wrt.load("room.toml")
    assert str(caught.value) == shown


# --- Commands --------------------------------------------------------------------------------------


def commands(text: str) -> list[str]:
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    return [code.strip() for code in [*lines, *inline_code(text)]]


@pytest.mark.parametrize("page", [*PAGES, "wrt --help"])
def test_commands_of_wrt_parse(page: str) -> None:
    text = PAGES.get(page)
    found = [line.strip() for line in EXAMPLES.splitlines()] if text is None else commands(text)
    found = [command for command in found if re.match(r"(python -m )?wrt ", command)]
    if page in ("README.md", "wrt --help"):
        assert len(found) >= 4
    for command in found:
        arguments = shlex.split(command, comments=True)[command.startswith("python") * 2 + 1 :]
        try:
            parse(arguments)
        except SystemExit:
            assert "--help" in arguments or "--version" in arguments
        except wrt.InputError as error:
            pytest.fail(f"{page}: {command}: {error}")


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    found: set[str] = set()
    for action in parser._actions:
        found |= set(action.option_strings)
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                found |= options_of(command)
    return found


@pytest.mark.parametrize("page", PAGES)
def test_options_and_commands_of_the_repository_exist(page: str) -> None:
    known = options_of(make_parser()) | {"--device"}
    for command in commands(PAGES[page]):
        program, _, rest = command.partition(" ")
        if program.startswith("scripts/") and " " not in program:
            assert (ROOT / program).exists(), f"{page}: {command}"
        if program.startswith(("scripts/", "--")):
            script = (ROOT / program).read_text() if (ROOT / program).is_file() else ""
            for option in re.findall(r"--[a-z][a-z-]*", program + " " + rest.partition("#")[0]):
                assert option in known or option in script, f"{page}: {command}: {option}"


# --- Tables ----------------------------------------------------------------------------------------

READER = _SceneReader
TABLES: dict[str, Callable[..., Any]] = {
    "[settings]": wrt.RenderSettings,
    **{f"[camera] {kind}": cls for kind, cls in CAMERAS.items()},
    "[environment] constant": ConstantEnvironment,
    "[environment] image": load_environment,
    "[environment] spherical-harmonics": wrt.SphericalHarmonicsEnvironment,
    "[environment] sun-sky": wrt.SunSkyEnvironment,
    **{f"[[lights]] {kind}": cls for kind, cls in LIGHTS.items()},
    **{f"[media.NAME] {kind}": maker for kind, maker in MEDIA.items()},
    **{f"[materials.NAME] {kind}": cls for kind, cls in MATERIALS.items()},
    "[[shapes]] quad": wrt.quad,
    "[[shapes]] box": wrt.box,
    "[[shapes]] sphere": wrt.sphere,
    "[[shapes]] polygon": READER.polygon,
    "[[shapes]] polygons": READER.polygons,
    "[[shapes]] spheres": READER.spheres,
    "[[shapes]] disk": wrt.disk,
    "[[shapes]] cylinder": wrt.cylinder,
    "[[shapes]] quadrics": READER.quadrics,
    "[[shapes]] mesh": READER.mesh_file,
    "[[shapes]] many-triangles": READER.many_triangles,
}
COMMON = "[[shapes]]"
COMMON_OF_MATERIALS = "[materials.NAME]"
COMMON_OF_CAMERAS = "[camera]"
TEXTURES = "### Textures"
MATERIAL_TABLES = [heading for heading in TABLES if heading.startswith(COMMON_OF_MATERIALS)]
CAMERA_TABLES = [heading for heading in TABLES if heading.startswith(COMMON_OF_CAMERAS)]


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
    return None if found is None else tomllib.loads(f"x = {found[1]}")["x"]


def test_every_kind_of_table_is_documented_and_no_other() -> None:
    assert set(documented()) == {*TABLES, COMMON, COMMON_OF_MATERIALS, COMMON_OF_CAMERAS, TEXTURES}
    kinds = {
        "[environment]": ENVIRONMENTS,
        "[[lights]]": LIGHTS,
        "[media.NAME]": MEDIA,
        "[materials.NAME]": MATERIALS,
    }
    for section, known in kinds.items():
        assert {f"{section} {kind}" for kind in known} == {name for name in TABLES if name.startswith(f"{section} ")}
    with pytest.raises(wrt.InputError) as caught:
        READER(Path("x"), None).meshes({"type": "?"})
    shapes = set(re.findall(r"'([\w-]+)'", str(caught.value).partition(", not ")[0]))
    assert {f"[[shapes]] {kind}" for kind in shapes} == {name for name in TABLES if name.startswith("[[shapes]] ")}


@pytest.mark.parametrize("heading", TABLES)
def test_keys_and_defaults_are_those_of_the_code(heading: str) -> None:
    maker = TABLES[heading]
    parameters = dict(inspect.signature(maker).parameters)
    for other in ("self", "path"):
        parameters.pop(other, None)
    for headings, common in ((MATERIAL_TABLES, wrt.Material), (CAMERA_TABLES, wrt.Camera)):
        if heading in headings:
            for other in inspect.signature(common).parameters:
                parameters.pop(other)
    table = documented()[heading]
    expected = set(parameters)
    if maker is load_environment:  # whose path the file calls `file`
        expected.add("file")
        assert table["file"] == "required"
    assert set(table) == expected
    for name, parameter in parameters.items():
        if parameter.default is inspect.Parameter.empty:
            assert table[name] == "required", name
        elif parameter.default is None or repr(parameter.default) == "<factory>":
            assert value_of(table[name]) is None, name
            assert heading in MATERIAL_TABLES or "`" not in table[name].replace("`target`", ""), name
        else:
            assert plain(value_of(table[name])) == plain(parameter.default), name


def test_keys_of_every_material_are_those_of_the_code() -> None:
    table = documented()[COMMON_OF_MATERIALS]
    assert set(table) == {"type", *inspect.signature(wrt.Material).parameters}
    assert (table["type"], value_of(table["opacity"]), table["normal_map"]) == (
        "required",
        wrt.Diffuse().opacity,
        "none",
    )


def test_keys_of_textures_are_those_of_the_code() -> None:
    table = documented()[TEXTURES]
    parameters = dict(inspect.signature(wrt.ImageTexture).parameters)
    for given_by_the_file in ("pixels", "name"):
        parameters.pop(given_by_the_file)
    assert set(table) == {"linear", *parameters}
    for name, parameter in parameters.items():
        expected = None if parameter.default is None else plain(parameter.default)
        assert plain(value_of(table[name])) == expected, name


def test_keys_of_every_camera_are_those_of_the_code() -> None:
    table = documented()[COMMON_OF_CAMERAS]
    parameters = inspect.signature(wrt.Camera).parameters
    assert set(table) == {"type", *parameters}
    assert value_of(table["type"]) == next(iter(CAMERAS))
    for name, parameter in parameters.items():
        assert plain(value_of(table[name])) == plain(parameter.default), name


@pytest.mark.parametrize("heading", MATERIAL_TABLES)
def test_what_varies_is_said_to(heading: str) -> None:
    hints = get_type_hints(TABLES[heading])
    said = {key for key, text in documented("meaning")[heading].items() if text.endswith("Varies")}
    varying = {key for key, hint in hints.items() if wrt.ImageTexture in get_args(hint)}
    assert said == varying - {"opacity"}


def test_keys_of_every_shape_are_those_of_the_code() -> None:
    table = documented()[COMMON]
    assert set(table) == set(scene_keys.SHAPE)
    shape = inspect.signature(wrt.Shape).parameters
    for name in ("emission", "two_sided_emission"):
        assert value_of(table[name]) == shape[name].default
    reader = READER(Path("x"), None)
    given = {name: value_of(table[name]) for name in ("scale", "translate")}
    np.testing.assert_array_equal(reader.transform(given), np.eye(4))
