"""Names that no file can have, or that few have, end in one line wherever a file is named."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import ROOM, SMALL

import wrt
from wrt.cli import main
from wrt.errors import LONGEST_MESSAGE

IMPOSSIBLE = {
    "long": "a" * 100_000,
    "deep": "/".join(["a" * 200] * 500),
    "too deep to be created": "a/" * 2000 + "a",
    "NUL": "a\0b",
}
ODD = {"newlines": "a\nb\n\nc", "escape": "a\x1b[31mb", "not UTF-8": "a\udcff\udcfeb"}
NAMES = {**IMPOSSIBLE, **ODD}

READ = (
    *(f"render {{}}.{suffix}" for suffix in ("toml", "xml", "obj", "ply", "stl", "glb", "usda", "step", "npz", "dae")),
    "render room.toml {}.toml",
    "render room.toml -o x.png --environment {}.hdr",
    "render room.toml -o x.png --tone ocio:{}",
    "info {}.obj",
    "info --memory {}.toml",
    "convert {}.obj x.toml",
    "develop {}.exr",
    "develop radiance.npy --tone ocio:{}",
    "merge {}.wrt -o x.png",
    "view {}.toml --no-browser",
    "compile {}.toml",
)
WRITTEN = (
    *(f"render room.toml -o {{}}{suffix}" for suffix in (".png", ".exr", "/")),
    "render room.toml -o x.png --checkpoint {}",
    "render room.toml -o x.png --checkpoint {} --resume",
    "render room.toml --part 1/2 -o {}.wrt",
    "render room.toml --turntable 2 -o {}_%d.png",
    "convert room.toml {}.toml",
    "convert room.toml {}.glb",
    "develop radiance.npy -o {}.png",
    "merge x.wrt -o {}.png",
    "merge x.wrt -o x.png --checkpoint {}",
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("room.toml").write_text(ROOM)
    np.save("radiance.npy", np.ones((2, 2, 3), np.float32))
    return tmp_path


def one_line_of(command: str, name: str, capsys: Any) -> str:
    """Return what a command says that is refused."""
    words = [word.replace("{}", name) for word in command.split()]
    if words[0] == "render":
        words += [*SMALL, "--quiet"]
    assert main(words) in (1, 2)
    printed: str = capsys.readouterr().err
    assert printed.startswith("wrt: error: ")
    assert printed.count("\n") == 1, command
    assert printed[:-1].isprintable()
    assert len(printed) < LONGEST_MESSAGE + 20
    return printed


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_files_that_are_read(name, capsys):
    for command in READ:
        if "render room.toml {}" not in command or name not in ODD.values():  # of several inputs others are rendered
            one_line_of(command, name, capsys)


@pytest.mark.parametrize("name", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_files_that_are_written(name, folder, capsys):
    before = sorted(folder.iterdir())
    for command in WRITTEN:
        one_line_of(command, name, capsys)
    assert sorted(folder.iterdir()) == before


TOML = '[[shapes]]\ntype = "mesh"\nfile = {}\n', '[materials.m]\ntype = "diffuse"\nreflectance = {{ texture = {} }}\n'
XML = '<shape type="obj"><string name="filename" value="{}"/></shape>', '<include filename="{}"/>'


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_files_that_scenes_name(name):
    for text in TOML:
        Path("a.toml").write_text(ROOM + text.format(json.dumps(name)), errors="ignore")
        with pytest.raises(wrt.InputError, match=r"a\.toml"):
            wrt.load("a.toml")
    for text in XML:
        Path("a.xml").write_text(f'<scene version="3.0.0">{text.format(name)}</scene>', errors="ignore")
        with pytest.raises(wrt.InputError, match=r"a\.xml"):
            wrt.load("a.xml")
