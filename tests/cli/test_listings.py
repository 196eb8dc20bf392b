"""`wrt materials` describes every material in the words of its class; `wrt info` counts and lists a scene."""

import dataclasses
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.cli import main
from wrt.describe.materials import WIDTH, explain_material, parameters_of
from wrt.describe.scene import MOST_ROWS, scene_text
from wrt.scene.materials import MATERIALS

COMMON = {"opacity", "normal_map", "name"}


def sections(text: str) -> dict[str, list[str]]:
    """Return the indented lines under each heading."""
    found: dict[str, list[str]] = {}
    for paragraph in text.split("\n\n"):
        head, *rows = paragraph.split("\n")
        if rows and all(row.startswith("  ") for row in rows):
            found[head.partition(":")[0]] = rows
    return found


def test_the_list_has_every_material_and_every_parameter(capsys):
    assert main(["materials"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= WIDTH
    listed = sections(text)
    assert list(listed) == [*MATERIALS, "every material"]
    for name, rows in listed.items():
        cls = MATERIALS.get(name, wrt.Material)
        names = {field.name for field in dataclasses.fields(cls)} - (set() if cls is wrt.Material else COMMON)
        assert {row.split()[0].rstrip("*") for row in rows} == names


def test_one_material_is_explained_in_full():
    """Nothing that the class says is left out: the same words in the same order, paragraph by paragraph."""
    for name, cls in MATERIALS.items():
        text = explain_material(name)
        assert max(map(len, text.splitlines())) <= WIDTH
        assert text.startswith(f"{name} (in Python wrt.{cls.__name__})\n")
        description, _, attributes = (inspect.getdoc(cls) or "").replace("`", "").partition("\nAttributes:\n")
        meanings = re.findall(r"^    [\w, ]+: (.*(?:\n        .*)*)", attributes, re.MULTILINE)
        words = " ".join(text.split())
        assert [
            printed for printed in (*description.split("\n\n"), *meanings) if " ".join(printed.split()) not in words
        ] == []
        assert [parameter.name for parameter in parameters_of(cls) if not parameter.meaning] == [], name


def row(text: str, name: str) -> list[str]:
    """Return the words of the only line that begins with `name`."""
    (line,) = [line for line in text.splitlines() if line.split()[:1] == [name]]
    return line.split()


def test_a_scene_is_told_in_counts_and_tables():
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(fov_degrees=30.0), environment=wrt.ConstantEnvironment(0.5))
    image = np.full((4, 8, 3), 0.5, np.float32)
    floor = wrt.quad((0, 0, 0), (1, 0, 0), (0, 2, 0))
    roughness = wrt.ImageTexture(image, "wood.png", channel="g")
    paint = wrt.Principled(wrt.ImageTexture(image, "wood.png"), roughness=roughness)
    scene.add(floor, material=paint, name="floor")
    scene.add(floor, material=wrt.Mix(paint, wrt.Diffuse(0.25)), name="wall")
    scene.add(wrt.sphere((0, 0, 0), 1.0, subdivisions=2), emission=2.0, name="lamp")
    scene.add_light(wrt.PointLight((1.0, 2.0, 3.0), intensity=4.0))
    text = scene_text(scene)
    triangles, vertices = 4 + len(scene.shapes[2].mesh.faces), 4 + len(scene.shapes[2].mesh.vertices)
    counts = f"3 shapes of 2 meshes, {triangles} triangles, {vertices} vertices, 4 materials, 1 texture;"
    assert text.startswith(counts)
    assert row(text, "floor") == ["floor", "2", "4", "uvs", "0"]
    assert row(text, "lamp")[-2:] == ["emission", "3"]
    assert row(text, "wood.png")[1:] == ["8", "x", "4", "base_color,", "roughness"]
    for line in (
        "camera      PerspectiveCamera: fov_degrees 30",
        "0          principled  base_color from wood.png, roughness from wood.png (g)",
        "1          mix         first 0, second 2",
        "PointLight: position (1, 2, 3), intensity 4",
    ):
        assert line in text
    for number in range(MOST_ROWS):
        scene.add(floor, name=f"tile{number}")
    text = scene_text(scene)
    assert f"  tile{MOST_ROWS - 4} " in text
    assert f"  tile{MOST_ROWS - 3} " not in text
    assert "  and 3 more" in text


@pytest.mark.filterwarnings("default")
def test_info_prints_it(tmp_path, capsys):
    (tmp_path / "one.obj").write_text("mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(["info", str(tmp_path / "one.obj")]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("1 shape of 1 mesh, 1 triangle, 3 vertices, 1 material, 0 textures;")
    assert printed.err.count("\n") == 1
    assert "wrt: warning:" in printed.err
    mesh = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    np.savez(tmp_path / "mesh.npz", vertices=mesh.vertices, faces=mesh.faces, colors=np.full((4, 3), 0.5))
    assert main(["info", str(tmp_path / "mesh.npz")]) == 0
    assert "diffuse  reflectance vertex-colors" in capsys.readouterr().out


@pytest.mark.filterwarnings("default")
def test_info_convert_and_view_load_like_render(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 2\n")
    Path("lost.obj").write_text("mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(["info", "points.obj", "--point-radius", "0.5", "--up", "z"]) == 0
    assert "size 2 x 3 x 1" in capsys.readouterr().out
    assert main(["convert", "points.obj", "a.toml", "--point-radius", "0.5"]) == 0
    assert wrt.load("a.toml").shapes[0].mesh.radii.tolist() == [0.5] * 3
    chosen = ["--define", "a=1", "--camera", "b", "--confined", "--up", "z", "--crease", "3", "--double-sided"]
    for words in (["info", "lost.obj"], ["convert", "lost.obj", "b.toml"]):
        assert main([*words, "--strict"]) == 2
        assert "no.mtl" in capsys.readouterr().err
        assert main([*words, *chosen]) == 2
        assert "parameters are only for Mitsuba scenes" in capsys.readouterr().err
    loaded = []
    monkeypatch.setattr("wrt.api.load_with_settings", lambda source, _, **loading: loaded.append(loading))
    monkeypatch.setattr("wrt.view.session.Session", lambda open_scene, **_: open_scene())
    assert main(["view", "lost.obj", "--strict", *chosen]) != 0  # there is no scene to render
    expected = {"parameters": {"a": "1"}, "camera": "b", "confined": True, "strict": True, "up": "z"}
    assert loaded == [expected | {"smooth_degrees": 3, "double_sided": True, "point_radius": None, "cameras": None}]
