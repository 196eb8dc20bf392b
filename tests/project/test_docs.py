"""README and docs are true: examples run, commands parse, links lead somewhere, messages are those of the code."""

import argparse
import ast
import os
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import reference
from conftest import ROOT
from support.covering_kernels import OF_PICTURES, covering, render_with
from support.pages import PAGES, blocks, inline_code, parsed, slug, without_code

import wrt
from wrt.cli.arguments.options import EXAMPLES, make_parser, parse
from wrt.io.measured.measurement import save_measurement
from wrt.io.toml import scene_keys
from wrt.io.toml.reader import load_scene
from wrt.meshes import scene_names

README = PAGES["README.md"]
SCENE_FORMAT = PAGES["docs/scene-format.md"]


def write_files(folder: Path) -> None:
    """Write every file that an example names."""
    np.save(folder / "cloud.npy", np.ones((2, 3, 4), np.float32))
    ball = wrt.sphere((0.0, 0.5, 0.0), 0.5, subdivisions=2)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices] + [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]
    (folder / "meshes").mkdir(exist_ok=True)
    for place in (folder, folder / "meshes"):
        shutil.copy(ROOT / "meshes" / "teapot.ply", place)
    for name in ("bunny", "tree", "flag0", "flag1"):
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    rng = np.random.default_rng(0)
    for name in ("wood", "robot", "robot-orm", "leaf", "leaf-mask", "letters"):
        wrt.save_image(folder / f"{name}.png", rng.uniform(0.0, 1.0, (4, 4, 3)))
    with (folder / "felt_rgb.bsdf").open("wb") as file:
        save_measurement(file, wrt.Measured.example().measurement)
    wrt.save_image(folder / "robot-bumps.png", np.full((4, 4, 3), (0.2, 0.2, 1.0)))
    wrt.save_image(folder / "sky.exr", rng.uniform(0.0, 2.0, (4, 8, 3)))


# Other tests run these pages: the first has programs, the next quotes a kernel, the last shows a widget.
OWN = ("docs/own.md", "docs/spmd.md", "docs/view.md")
WITH_LAYERS = covering("diffuse", "rough_conductor:ggx:smith:conductor", sampler="sobol", aovs=True)
PROGRAMS = [(page, code) for page, text in PAGES.items() if page not in OWN for code in blocks(text, "python")]


@pytest.mark.slow
def test_python_examples_run_and_write_what_they_say(tmp_path, monkeypatch, capsys):
    """With small pictures of few samples: what examples show is large as a rule."""
    start, passes = wrt.Renderer.__init__, wrt.Renderer.passes

    def small_start(self, scene, **options):
        if (options.get("width") or scene.settings.width) > 64:
            options = {**options, "width": 16, "height": 12}
        start(self, scene, **options)

    def few_passes(self, *, spp=None, noise=None, **_):
        samples = spp if spp is not None and spp <= 16 else (spp or 64) // 64
        return passes(self, spp=samples) if noise is None else passes(self, noise=noise)

    monkeypatch.setattr(wrt.Renderer, "__init__", small_start)
    monkeypatch.setattr(wrt.Renderer, "passes", few_passes)
    render_with([OF_PICTURES, WITH_LAYERS], monkeypatch)
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert "README.md" in {page for page, _ in PROGRAMS}
    for page, code in PROGRAMS:
        exec(compile(code, page, "exec"), {})
        written = re.findall(r'save(?:_image|_checkpoint)?\(f?"([^"]+)"', code)
        assert written or "ender" not in code, page
        for name in written:
            files = list(tmp_path.glob(re.sub(r"\{[^}]*\}", "*", name)))
            assert files, f"{page}: {name} was not written"
            for file in files:
                if file.suffix in (".png", ".exr"):
                    assert wrt.load_image(file).any(), f"{page}: {name} is black"
    printed = capsys.readouterr().out
    assert re.fullmatch(r"(\d+ of 4 samples per pixel\n)+\d+ samples per pixel, noise 0\.0\d+\n", printed)


def test_scene_files_and_parts_of_them_are_read(tmp_path, monkeypatch):
    """Also a mistake gives the message that the page shows."""
    complete = blocks(SCENE_FORMAT, "toml")[0]
    assert set(parsed(complete)) == set(scene_keys.SECTIONS) - {"medium"}
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    for page, text in PAGES.items():
        if page != "docs/own.md":  # what these name is registered by their programs
            for part in blocks(text, "toml"):
                Path("room.toml").write_text(part)
                load_scene(Path("room.toml"))
    (shown,) = re.findall(r"^    (room\.toml: .*)$", SCENE_FORMAT, re.MULTILINE)
    Path("room.toml").write_text(complete.replace('material = "glass"', 'materal = "glass"'))
    with pytest.raises(wrt.InputError) as caught:
        wrt.load("room.toml")
    assert str(caught.value) == shown


def commands(text: str) -> list[str]:
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    return [code.strip() for code in [*lines, *inline_code(text)]]


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    found: set[str] = set()
    for action in parser._actions:
        found |= set(action.option_strings)
        if isinstance(action, argparse._SubParsersAction):
            found |= {option for command in action.choices.values() for option in options_of(command)}
    return found


def test_commands_of_wrt_parse():
    count = 0
    for page, text in {**PAGES, "wrt --help": "".join(f"`{line.strip()}`\n" for line in EXAMPLES.splitlines())}.items():
        for command in commands(text):
            if re.match(r"(python -m )?wrt ", command):
                arguments = shlex.split(command, comments=True)[command.startswith("python") * 2 + 1 :]
                count += 1
                try:
                    parse(arguments)
                except SystemExit:
                    assert "--help" in arguments or "--version" in arguments
                except wrt.InputError as error:
                    pytest.fail(f"{page}: {command}: {error}")
    assert count > 100


def test_what_the_readme_renders_is_in_a_clone():
    given = [re.match(r"wrt (?:render|view) (\S+)", command) for command in commands(README)]
    read = re.findall(r'wrt\.(?:render|load|load_mesh)\("([^"]+)"', README)
    inputs = [found[1] for found in given if found] + read
    assert len(inputs) >= 8
    for name in inputs:
        assert name in scene_names() or (ROOT / name).is_file(), name


def test_options_and_commands_of_the_repository_exist():
    of_tests = re.findall(r'addoption\(\s*"(--[a-z-]+)"', (ROOT / "tests" / "conftest.py").read_text())
    options = options_of(make_parser()) | set(of_tests)
    for page, text in PAGES.items():
        for command in commands(text):
            program, _, arguments = command.partition(" ")
            if program.startswith("scripts/") and " " not in program:
                assert (ROOT / program).exists(), f"{page}: {command}"
            if program.startswith(("scripts/", "--")):
                script = (ROOT / program).read_text() if (ROOT / program).is_file() else ""
                for option in re.findall(r"--[a-z][a-z-]*", program + " " + arguments.partition("#")[0]):
                    assert option in options or option in script, f"{page}: {command}: {option}"


def test_the_reference_is_current_and_has_every_public_name(capsys):
    assert reference.main(["--check"]) == 0, capsys.readouterr().out
    shown = re.findall(r"^### wrt\.(\w+)$", PAGES["docs/python.md"], re.MULTILINE)
    assert sorted(shown) == sorted(name for name in wrt.__all__ if not name.startswith("__"))


def test_every_page_is_in_the_navigation_and_is_reached_by_links():
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2].partition("\nexclude_docs:")[0]
    shown = [page.removeprefix("docs/") for page in PAGES if page != "README.md"]
    assert sorted(re.findall(r": ([\w/.-]+\.md)$", nav, re.MULTILINE)) == sorted(shown)
    found, queue = set(), ["README.md"]
    while queue:
        page = queue.pop()
        if page in found or page not in PAGES:
            continue
        found.add(page)
        targets = re.findall(r"\]\(([^)#\s]+)", without_code(PAGES[page]))
        queue += [os.path.normpath(Path(page).parent / target) for target in targets if "://" not in target]
    assert found == set(PAGES), set(PAGES) - found


def test_names_and_paths_in_the_text_exist():
    for page, text in PAGES.items():
        for code in inline_code(text):
            if found := re.match(r"wrt\.(\w+)", code):
                module = (ROOT / found[1], ROOT / "wrt" / found[1], ROOT / "wrt" / f"{found[1]}.py")
                assert hasattr(wrt, found[1]) or any(path.exists() for path in module), f"{page}: {code}"
            path = code.split(" ")[0]
            if re.match(r"(wrt|kernels|meshes|scripts|tests|docs)/", path) and "NAME" not in path:
                assert (ROOT / path).exists(), f"{page}: {code}"


def test_links_and_pictures_lead_somewhere():
    for page, raw in PAGES.items():
        text = without_code(raw)
        targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
        for target in targets:
            if target.startswith("https://"):
                continue
            file, _, anchor = target.partition("#")
            path = (ROOT / page).parent / file if file else ROOT / page
            assert path.is_file(), f"{page}: {target}"
            if anchor:
                headings = re.findall(r"^#+ (.+)$", without_code(path.read_text(encoding="utf-8")), re.MULTILINE)
                assert anchor in {slug(heading) for heading in headings}, f"{page}: {target}"


def test_architecture_names_every_folder_and_files_that_there_are():
    files = [path for top in ("wrt", "kernels") for path in (ROOT / top).rglob("*") if path.is_file()]
    folders = {path.parent.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    apart = ("wrt/kernels", "wrt/meshes", "wrt/prebuilt")  # links, and what scripts make
    folders = {folder for folder in folders if not folder.startswith(apart)}
    rooms = re.findall(r"^\| `([\w/]+)` \|", PAGES["docs/architecture.md"], re.MULTILINE)
    assert sorted(rooms) == sorted(folders)
    drawn = re.findall(r"^ *((?:wrt|kernels)/\S+\.py) +(\w+)", PAGES["docs/architecture.md"], re.MULTILINE)
    assert len(drawn) >= 12
    for path, name in drawn:
        assert re.search(rf"\b{name}\b", (ROOT / path).read_text(encoding="utf-8")), f"{path}: {name}"


def messages_of(path: Path) -> set[str]:
    """Return the texts of a file, with … in the place of what is filled in."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            found.add("".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def test_messages_that_are_explained_are_those_of_the_code():
    """Each is a text of the code, with … for what is filled in."""
    shown = re.findall(r"^\| `([^`]*[…:][^`]*)` \|", PAGES["docs/troubleshooting.md"], re.MULTILINE)
    assert len(shown) >= 20
    texts = {text for path in (ROOT / "wrt").rglob("*.py") for text in messages_of(path)}
    for message in shown:
        pattern = ".*".join(re.escape(part) for part in message.split("…"))
        assert any(re.search(pattern, text) for text in texts), message
