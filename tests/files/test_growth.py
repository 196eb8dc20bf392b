"""Small files that would take gigabytes are refused by a limit that is named, in a process of little memory."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image
from support.meshes import gltf_box

import wrt
from wrt.errors import InputWarning
from wrt.io import memory_limits
from wrt.io.safe_read import read_file

CHILD = """
import resource, sys, warnings
warnings.simplefilter("ignore")
import wrt
import wrt.io.mitsuba.scene, wrt.io.gltf.reader, wrt.io.toml.reader
from wrt.io.images import load_image
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 30), resource.RLIM_INFINITY))
for path in sys.argv[1:]:
    try:
        (load_image if path.endswith(".png") else wrt.load)(path)
        print("read")
    except wrt.InputError as error:
        print(error)
"""

QUAD = 'type = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'


def scene(body: str) -> str:
    return f'<scene version="3.0.0">{body}</scene>'


def gltf(primitives: int, meshes: int = 1, nodes: int | None = None) -> str:
    """A file in which all primitives share the same accessors."""
    count, places = 5000, meshes if nodes is None else nodes
    faces = (np.arange(2 * count)[:, None] // 2 + np.array([0, 1, 7])) % count
    tree = gltf_box(np.random.default_rng(0).random((count, 3)), faces)
    tree["meshes"] = [{"primitives": tree["meshes"][0]["primitives"] * primitives}] * meshes
    tree["nodes"] = [{"mesh": i % meshes} for i in range(places)]
    return json.dumps(tree)


def doubled() -> str:
    first = '<default name="a0" value="aaaaaaaaaa"/>'
    return scene(first + "".join(f'<default name="a{i}" value="{f"$a{i - 1}" * 10}"/>' for i in range(1, 10)))


def write_copies(folder: Path) -> str:
    ball = wrt.sphere(subdivisions=7)
    np.savez_compressed(folder / "ball.npz", vertices=ball.vertices, faces=ball.faces)
    return "".join(f'[[shapes]]\ntype = "mesh"\nfile = "ball.npz"\ntranslate = [{i}, 0, 0]\n' for i in range(3000))


def write_part(folder: Path) -> str:
    (folder / "part.xml").write_text(scene('<shape type="rectangle"/>' * 100))
    return scene('<include filename="part.xml"/>' * 999)


def write_image(folder: Path) -> bytes:
    Image.new("L", (16384, 8192)).save(folder / "black.png", optimize=True)
    return (folder / "black.png").read_bytes()


GROUP = '<shape type="shapegroup" id="g">' + '<shape type="cube"/>' * 1000 + "</shape>"
# Exact spheres keep their form, so this becomes triangles.
ELLIPSOID = '<shape type="sphere"><transform name="to_world"><scale y="2"/></transform></shape>'
LONG_VALUE = f'<default name="a" value="{"a" * 60000}"/>'

BOMBS: dict[str, tuple[str, str | bytes | Callable[[Path], str | bytes], str]] = {
    "defaults": ("xml", doubled(), "longer than 65536 characters"),
    "values": ("xml", scene(LONG_VALUE + '<shape type="$a"/>' * 5000), "XML elements and texts would take"),
    "includes": ("xml", write_part, "shapes would take"),
    "groups": ("xml", scene(GROUP + '<shape type="instance"><ref id="g"/></shape>' * 1800), "shapes would take"),
    "ellipsoids": ("xml", scene(ELLIPSOID * 2000), "round shapes would take"),
    "dotted": ("toml", "x = 1\na" + ".a" * 50000 + " = 1\n", "line 2: a dotted key has more than 64 parts"),
    "arrays": ("toml", "a = " + "[" * 50000 + "]" * 50000 + "\n", "nested too deeply"),
    "copies": ("toml", write_copies, "meshes would take"),
    "default-spheres": ("toml", '[[shapes]]\ntype = "sphere"\n' * 9000, "round shapes would take"),
    "image": ("png", write_image, "images would take 2.15 GB; .* 512 times the file size"),
    "meshes": ("gltf", gltf(1, 3000), "meshes would take"),
    "nodes": ("gltf", gltf(100, 1, 20000), "shapes would take"),
}


def test_a_file_counts_once_under_several_names(tmp_path):
    """Many links to one file do not raise the limits, which are multiples of the bytes read."""
    (tmp_path / "a").write_bytes(bytes(1000))
    (tmp_path / "b").symlink_to("a")
    with memory_limits.one_load():
        for name in ("a", "b", "./a"):
            read_file(tmp_path / name)
        memory_limits.take(memory_limits.Limit("things", 10, 1), 1010)
        with pytest.raises(wrt.InputError, match=r"its things would take 1.01 kB; for files of 1 kB"):
            memory_limits.take(memory_limits.Limit("things", 10, 1), 1)


@pytest.mark.slow
def test_bombs_are_refused(tmp_path):
    """One after the other, in a process that may take 1 GB more than when it began."""
    paths = []
    for name, (suffix, content, _) in BOMBS.items():
        folder = tmp_path / name
        folder.mkdir()
        data = content(folder) if callable(content) else content
        paths.append(folder / f"{name}.{suffix}")
        paths[-1].write_bytes(data if isinstance(data, bytes) else data.encode())
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", CHILD, *map(str, paths)]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert result.returncode == 0, result.stderr
    for path, message, (_, _, reason) in zip(paths, result.stdout.splitlines(), BOMBS.values(), strict=True):
        assert str(path) in message
        assert re.search(reason, message), message


@pytest.mark.slow
def test_large_honest_scenes_are_read(tmp_path):
    place = '<shape type="instance"><ref id="g"/><transform name="to_world"><translate x="{}"/></transform></shape>'
    places = "".join(place.format(3 * i) for i in range(10_000))
    group = '<shape type="shapegroup" id="g"><shape type="cube"/></shape>'
    boxes = (f'[[shapes]]\ntype = "box"\nlow = [{2 * i}, 0, 0]\nhigh = [{2 * i + 1}, 1, 1]\n' for i in range(2000))
    for name, text, count in (
        ("instances.xml", scene(group + places), 10_000),
        ("boxes.toml", "# 1.2.3.4\n" + "".join(boxes), 2000),
        ("parts.gltf", gltf(20), 20),  # each holds all vertices of their mesh
    ):
        (tmp_path / name).write_text(text)
        assert len(wrt.load(tmp_path / name).shapes) >= count
    Image.new("L", (8192, 4096)).save(tmp_path / "black.png")
    assert wrt.load_image(tmp_path / "black.png").shape == (4096, 8192, 3)


@pytest.mark.slow
def test_polygons_that_take_too_long_are_warned_of(tmp_path):
    points = np.random.default_rng(0).random((3000, 2))
    text = "".join(f"v {x} {y} 0\n" for x, y in points) + "f " + " ".join(map(str, range(1, 3001))) + "\n"
    (tmp_path / "crossing.obj").write_text(text)
    with pytest.warns(InputWarning, match=r"crossing\.obj: its concave polygons take too long"):
        wrt.load_mesh(tmp_path / "crossing.obj")
