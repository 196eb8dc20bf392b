"""Folders with files that wrt must not replace, and renders that write to these folders."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

import wrt
from wrt.cli import main

CUBE = wrt.box((-1, -1, -1), (1, 1, 1))
SMALL = ("--size", "8x8", "--spp", "1", "--quiet")


def write_obj(folder: Path, texture: str = "fuze.png") -> Path:
    """Write a textured triangle as an OBJ file with its material and its image."""
    (folder / "fuze.obj").write_text(
        "mtllib fuze.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    )
    (folder / "fuze.mtl").write_text(f"newmtl a\nmap_Kd {texture}\n")
    Image.new("RGB", (4, 4), (200, 100, 50)).save(folder / texture)
    return folder / "fuze.obj"


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_only_added(before: dict[str, bytes], folder: Path, *added: str) -> None:
    found = contents(folder)
    assert {name: found.get(name) for name in before} == before
    assert set(found) - set(before) == set(added)


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])
