"""The pages of the documentation fit the code and each other: references, paths, links, questions, messages."""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path

import pytest
from conftest import ROOT
from support.pages import PAGES, inline_code, slug, without_code

import wrt

README = PAGES["README.md"]
ARCHITECTURE = PAGES["docs/architecture.md"]


# --- References ------------------------------------------------------------------------------------


def test_every_public_name_is_in_the_reference() -> None:
    """It is listed, and mkdocstrings shows its docstring."""
    page = PAGES["docs/python.md"]
    listed = set(re.findall(r"^\| \[`(\w+)`\]", page, re.MULTILINE))
    detailed = {path.rpartition(".")[2] for path in re.findall(r"^::: ([\w.]+)$", page, re.MULTILINE)}
    public = {name for name in wrt.__all__ if not name.startswith("__")}
    assert listed == detailed == public


def test_generated_parts_are_current(capsys: pytest.CaptureFixture[str]) -> None:
    import reference

    assert reference.main(["--check"]) == 0, capsys.readouterr().out


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2].partition("\nexclude_docs:")[0]
    shown = [page.removeprefix("docs/") for page in PAGES if page != "README.md"]
    assert sorted(re.findall(r": ([\w/.-]+\.md)$", nav, re.MULTILINE)) == sorted(shown)


def test_every_page_is_reached_from_the_index() -> None:
    """By links alone, and from the README."""
    found, queue = set(), ["README.md"]
    while queue:
        page = queue.pop()
        if page in found or page not in PAGES:
            continue
        found.add(page)
        targets = re.findall(r"\]\(([^)#\s]+)", without_code(PAGES[page]))
        queue += [os.path.normpath(Path(page).parent / target) for target in targets if "://" not in target]
    assert found == set(PAGES), set(PAGES) - found


@pytest.mark.parametrize("page", PAGES)
def test_names_written_as_wrt_something_exist(page: str) -> None:
    for code in inline_code(PAGES[page]):
        if found := re.match(r"wrt\.(\w+)", code):
            module = (ROOT / found[1], ROOT / "wrt" / found[1], ROOT / "wrt" / f"{found[1]}.py")
            assert hasattr(wrt, found[1]) or any(path.exists() for path in module), f"{page}: {code}"


# --- Files and links -------------------------------------------------------------------------------


def test_architecture_names_every_folder() -> None:
    """Every folder of the host and of the kernels has a line, and no other."""
    files = [path for top in ("wrt", "kernels") for path in (ROOT / top).rglob("*") if path.is_file()]
    folders = {path.parent.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    linked = ("wrt/kernels", "wrt/meshes")
    folders = {folder for folder in folders if not folder.startswith(linked)}
    named = re.findall(r"^\| `([\w/]+)` \|", ARCHITECTURE, re.MULTILINE)
    assert sorted(named) == sorted(folders)


WHERE = re.findall(r"^\| (.+\?) \| `(.+)` \| `(.+)` \|$", PAGES["docs/where-to-look.md"], re.MULTILINE)


def names_in(path: Path) -> set[str]:
    """Return what a file defines: functions, classes, their methods and constants; in a header every name."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return set(re.findall(r"\w+", text))
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


@pytest.mark.parametrize(("question", "path", "name"), WHERE, ids=[name for *_, name in WHERE])
def test_questions_lead_to_what_answers_them(question: str, path: str, name: str) -> None:
    assert name in names_in(ROOT / path), question


def test_the_questions_of_a_newcomer_are_answered() -> None:
    asked = "Fresnel|shadow ray|work for threads|GGX|many lights|PNG and EXR|OBJ|roulette|checkpoint|BVH|option|Sobol"
    for subject in asked.split("|"):
        assert any(subject in question for question, *_ in WHERE), subject
    assert len(WHERE) >= 12


@pytest.mark.parametrize("page", PAGES)
def test_paths_in_the_text_exist(page: str) -> None:
    for code in inline_code(PAGES[page]):
        path = code.split(" ")[0]
        if re.match(r"(wrt|kernels|meshes|scripts|tests|docs)/", path) and "NAME" not in path:
            assert (ROOT / path).exists(), f"{page}: {code}"


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_lead_somewhere(page: str) -> None:
    text = without_code(PAGES[page])
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


def test_pictures_in_the_readme_are_of_the_scenes_it_says() -> None:
    from wrt.meshes import scene_names

    pictures = re.findall(r'src="docs/pictures/([\w-]+)\.png"', README)
    assert pictures
    assert set(pictures) <= set(scene_names())
    assert all(f"`wrt render {name}`" in README for name in pictures)


def test_readme_is_short() -> None:
    assert len(README.splitlines()) <= 80


def test_version_has_a_place_in_the_changelog() -> None:
    assert re.search(rf"\b{re.escape(wrt.__version__)}\b", PAGES["CHANGELOG.md"])


# --- Messages --------------------------------------------------------------------------------------


def messages_of(path: Path) -> set[str]:
    """Return the texts of a file, with … in the place of what is filled in."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            found.add("".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def test_messages_that_are_explained_are_those_of_the_code() -> None:
    """The parts between … of each message stand in one text of the code, in their order."""
    page = PAGES["docs/troubleshooting.md"]
    shown = re.findall(r"^\| `([^`]*[…:][^`]*)` \|", page, re.MULTILINE)
    assert len(shown) >= 20
    texts = {text for path in (ROOT / "wrt").rglob("*.py") for text in messages_of(path)}
    for message in shown:
        pattern = ".*".join(re.escape(part) for part in message.split("…"))
        assert any(re.search(pattern, text) for text in texts), message
