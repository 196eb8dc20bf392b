"""`wrt materials` tells of every material what its class says, in lines that fit a terminal, at once."""

from __future__ import annotations

import dataclasses
import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import pytest
from test_cli import ENVIRONMENT, run

import wrt
from wrt.cli import main
from wrt.describe.materials import WIDTH, explain_material, list_materials, parameters_of
from wrt.scene.materials import MATERIALS

COMMON = {"opacity", "normal_map"}


def sections(text: str) -> dict[str, list[str]]:
    """Return the indented lines under each heading."""
    found: dict[str, list[str]] = {}
    for paragraph in text.split("\n\n"):
        head, *rows = paragraph.split("\n")
        if rows and all(row.startswith("  ") for row in rows):
            found[head.partition(":")[0]] = rows
    return found


def test_the_list_has_every_material_and_every_parameter_in_columns(tmp_path: Path) -> None:
    result = run(tmp_path, "materials")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == list_materials() + "\n"
    assert max(map(len, result.stdout.splitlines())) <= WIDTH
    listed = sections(result.stdout)
    assert list(listed) == [*MATERIALS, "every material"]
    columns = set()
    for name, rows in listed.items():
        cls = MATERIALS.get(name, wrt.Material)
        own = {field.name for field in dataclasses.fields(cls)}
        own = own if cls is wrt.Material else own - COMMON
        found = [re.fullmatch(r"  (\w+)(\*?) +(\S+) +(\S.*)", row) for row in rows]
        assert all(found), rows
        assert {match[1] for match in found if match} == own
        columns |= {match.start(group) for match in found if match for group in (3, 4)}
    assert len(columns) == 2, "defaults and meanings each begin in one column"


@pytest.mark.parametrize("name", MATERIALS)
def test_one_is_explained_in_full(name: str, tmp_path: Path) -> None:
    text = explain_material(name)
    assert max(map(len, text.splitlines())) <= WIDTH
    cls = MATERIALS[name]
    assert text.startswith(f"{name} (in Python wrt.{cls.__name__})\n")
    # Nothing that the class says is left out: the same words in the same order, paragraph by paragraph.
    description, _, attributes = (inspect.getdoc(cls) or "").replace("`", "").partition("\nAttributes:\n")
    words = text.split()
    for said in [
        *description.split("\n\n"),
        *re.findall(r"^    [\w, ]+: (.*(?:\n        .*)*)", attributes, re.MULTILINE),
    ]:
        assert " ".join(said.split()) in " ".join(words)


@pytest.mark.parametrize("name", MATERIALS)
def test_every_parameter_has_a_meaning(name: str) -> None:
    for parameter in parameters_of(MATERIALS[name]):
        assert parameter.meaning, f"{name}: {parameter.name} is not in the Attributes of {MATERIALS[name].__name__}"


def test_defaults_are_written_as_in_scene_files() -> None:
    shown = {p.name: (p.default, p.varies) for p in parameters_of(wrt.RoughConductor)}
    assert shown["alpha"] == ("0.1", True)
    assert shown["distribution"] == ('"ggx"', False)
    assert shown["multiple_bounces"] == ("false", False)
    assert shown["metal"] == ("none", False)
    assert {p.name: p.default for p in parameters_of(wrt.Mix, inherited=False)} == {
        "first": "diffuse",
        "second": "diffuse",
        "weight": "0.5",
    }


def test_an_unknown_name_is_one_line_and_status_2(tmp_path: Path) -> None:
    result = run(tmp_path, "materials", "difuse")
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "wrt: error: there is no material 'difuse' (did you mean 'diffuse'?)\n"
    result = run(tmp_path, "materials", "xyzzy")
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "wrt: error: there is no material 'xyzzy'; 'wrt materials' lists them\n"


def test_nothing_heavy_is_imported(tmp_path: Path) -> None:
    for arguments in (["materials"], ["materials", "diffuse"]):
        result = subprocess.run(
            [sys.executable, "-X", "importtime", "-m", "wrt", *arguments],
            cwd=tmp_path,
            env=ENVIRONMENT,
            capture_output=True,
            text=True,
            check=True,
        )
        imported = {line.rpartition("|")[2].strip() for line in result.stderr.splitlines()}
        assert "wrt.describe.materials" in imported
        assert not imported & {"warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO", "wrt.kernels", "scipy"}


def test_a_material_of_ones_own_is_listed_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @dataclasses.dataclass(frozen=True)
    class Chalk(wrt.Diffuse):
        """Soft white limestone.

        Attributes:
            dust: how much of it lies about; a share.
            crumbs, size: of what fell off.
        """

        dust: float = 0.25
        crumbs: tuple[float, ...] = (1.0, 2.0)
        size: str = "small"

        type_name: ClassVar[str] = "chalk"

    monkeypatch.setitem(MATERIALS, "chalk", Chalk)
    assert main(["materials"]) == 0
    rows = [" ".join(row.split()) for row in sections(capsys.readouterr().out)["chalk"]]
    assert rows == [
        "reflectance* 0.18 fraction of light reflected per channel, 0 to 1",
        "dust 0.25 how much of it lies about",
        "crumbs [1.0, 2.0] of what fell off",
        'size "small" of what fell off',
    ]
    assert main(["materials", "chalk"]) == 0
    assert capsys.readouterr().out.startswith(f"chalk (in Python {__name__}.Chalk)\n\nSoft white limestone.\n\n  refl")
