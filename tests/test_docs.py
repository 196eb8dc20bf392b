"""What README and docs say is so: examples run, commands parse, tables match the code, links lead somewhere."""

from __future__ import annotations

import argparse
import ast
import inspect
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from conftest import ROOT

import wrt
from wrt.camera import CAMERAS
from wrt.cli.options import EXAMPLES, make_parser, parse
from wrt.environment import ENVIRONMENTS, ConstantEnvironment
from wrt.formats import scene_keys, scene_toml
from wrt.formats.images import load_environment
from wrt.formats.scene_toml import load_scene
from wrt.lights import LIGHTS
from wrt.materials import MATERIALS
from wrt.medium import MEDIA

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/*.md")))
}
README = PAGES["README.md"]
SCENE_FORMAT = PAGES["docs/scene-format.md"]
ARCHITECTURE = PAGES["docs/architecture.md"]


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def inline_code(text: str) -> list[str]:
    return re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL))


def write_files(folder: Path) -> None:
    """Write every file that an example names."""
    ball = wrt.sphere((0.0, 0.5, 0.0), 0.5, subdivisions=2)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices] + [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]
    for name in ("bunny", "tree", "flag0", "flag1"):
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    rng = np.random.default_rng(0)
    for name in ("wood", "robot", "robot-orm", "leaf", "leaf-mask", "letters"):
        wrt.save_image(folder / f"{name}.png", rng.uniform(0.0, 1.0, (4, 4, 3)))
    wrt.save_image(folder / "robot-bumps.png", np.full((4, 4, 3), (0.2, 0.2, 1.0)))
    wrt.save_image(folder / "sky.exr", rng.uniform(0.0, 2.0, (4, 8, 3)))


# --- Examples --------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every renderer make a small picture, of few samples: what examples show is large."""
    start, passes = wrt.Renderer.__init__, wrt.Renderer.passes

    def small_start(self: wrt.Renderer, scene: wrt.Scene, **options: Any) -> None:
        start(self, scene, **{**options, "width": 16, "height": 12})

    def few_passes(self: wrt.Renderer, *, spp: int | None = None, **_: Any) -> Any:
        return passes(self, spp=max(1, (spp or 64) // 64))

    monkeypatch.setattr(wrt.Renderer, "__init__", small_start)
    monkeypatch.setattr(wrt.Renderer, "passes", few_passes)


@pytest.mark.slow
def test_python_examples_run_and_write_what_they_say(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    # That of docs/own-bsdf.md is a program of its own, which tests/test_own_bsdf.py runs.
    pages = {page: text for page, text in PAGES.items() if page != "docs/own-bsdf.md"}
    examples = [(page, code) for page, text in pages.items() for code in blocks(text, "python")]
    assert len([page for page, _ in examples if page == "README.md"]) >= 2
    for page, code in examples:
        names: dict[str, Any] = {}
        exec(compile(code, page, "exec"), names)
        written = re.findall(r'save_(?:image|checkpoint)\("([^"]+)"', code)
        assert written
        for name in written:
            assert (tmp_path / name).is_file()
        for name in written:
            if Path(name).suffix in (".png", ".exr"):
                assert wrt.load_image(tmp_path / name).any(), f"{page}: {name} is black"
    assert re.fullmatch(r"(\d+ of 4 samples per pixel\n)+", capsys.readouterr().out)


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

READER = scene_toml._Reader
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


def test_every_public_name_is_in_the_readme() -> None:
    table = {code for code in inline_code(README) if re.fullmatch(r"\w+", code)}
    assert set(wrt.__all__) <= table, set(wrt.__all__) - table


@pytest.mark.parametrize("page", PAGES)
def test_names_written_as_wrt_something_exist(page: str) -> None:
    for code in inline_code(PAGES[page]):
        if found := re.match(r"wrt\.(\w+)", code):
            module = (ROOT / found[1], ROOT / "wrt" / f"{found[1]}.py")
            assert hasattr(wrt, found[1]) or any(path.exists() for path in module), f"{page}: {code}"


# --- Files and links -------------------------------------------------------------------------------


def test_architecture_names_every_source_file() -> None:
    files = {
        path.relative_to(ROOT).as_posix() for folder in ("wrt", "kernels") for path in (ROOT / folder).rglob("*.py")
    }
    named = re.findall(r"^\| `([\w/.]+\.py)` \|", ARCHITECTURE, re.MULTILINE)
    assert sorted(named) == sorted(files)


@pytest.mark.parametrize("page", PAGES)
def test_paths_in_the_text_exist(page: str) -> None:
    for code in inline_code(PAGES[page]):
        path = code.split(" ")[0]
        if re.match(r"(wrt|kernels|meshes|scripts|tests|docs)/", path) and "NAME" not in path:
            assert (ROOT / path).exists(), f"{page}: {code}"


def slug(heading: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_lead_somewhere(page: str) -> None:
    text = re.sub(r"^```.*?^```$", "", PAGES[page], flags=re.MULTILINE | re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    for target in targets:
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        path = (ROOT / page).parent / file if file else ROOT / page
        assert path.is_file(), f"{page}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {slug(heading) for heading in headings}, f"{page}: {target}"


def test_pictures_in_the_readme_are_of_the_scenes_it_says() -> None:
    from wrt.meshes import scene_names

    pictures = re.findall(r'src="docs/pictures/([\w-]+)\.png"', README)
    assert pictures
    assert set(pictures) <= set(scene_names())
    assert all(f"`wrt render {name}`" in README for name in pictures)


def test_readme_is_short() -> None:
    assert len(README.splitlines()) < 120


def test_version_has_a_place_in_the_changelog() -> None:
    assert re.search(rf"\b{re.escape(wrt.__version__)}\b", PAGES["CHANGELOG.md"])


# --- Layers ----------------------------------------------------------------------------------------


def imports(path: Path) -> set[str]:
    """Return the modules that a file imports anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, path
            found.add(node.module or "")
    return found


def test_kernels_know_nothing_of_the_host() -> None:
    for path in (ROOT / "kernels").rglob("*.py"):
        found = {name for name in imports(path) if name.partition(".")[0] == "wrt" or name == "numpy"}
        assert all(name.startswith("wrt.kernels") for name in found), path


def test_a_scene_knows_nothing_of_warp() -> None:
    described = ("scene", "mesh", "shapes", "textures", "lights", "environment", "camera", "values")
    paths = [ROOT / "wrt" / f"{name}.py" for name in described] + sorted((ROOT / "wrt" / "materials").glob("*.py"))
    for path in paths:
        found = imports(path)
        if path.parent.name == "materials" and path.name == "__init__.py":
            found -= {"wrt.kernels.bsdf", "wrt.kernels.bsdf.record"}  # `register_material`, once it is called
        assert not [module for module in found if module.startswith(("warp", "wrt.kernels", "wrt.build", "wrt.device"))]
