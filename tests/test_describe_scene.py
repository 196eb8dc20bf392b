"""`wrt info` tells what is in a scene."""

from __future__ import annotations

import numpy as np
import pytest

import wrt
from wrt.cli import main
from wrt.describe.scene import MOST_ROWS, scene_text


def row(text: str, name: str) -> list[str]:
    """Return the words of the only line that begins with `name`."""
    (line,) = [line for line in text.splitlines() if line.split()[:1] == [name]]
    return line.split()


def test_counts_and_tables() -> None:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(fov_degrees=30.0), environment=wrt.ConstantEnvironment(0.5))
    image = np.full((4, 8, 3), 0.5, np.float32)
    wood = wrt.ImageTexture(image, "wood.png")
    floor = wrt.quad((0, 0, 0), (1, 0, 0), (0, 2, 0))
    paint = wrt.Principled(wood, roughness=wrt.ImageTexture(image, "wood.png", channel="g"))
    scene.add(floor, material=paint, name="floor")
    scene.add(floor, material=wrt.Mix(paint, wrt.Diffuse(0.25)), name="wall")
    scene.add(wrt.sphere((0, 0, 0), 1.0, subdivisions=2), emission=2.0, name="lamp")
    scene.add_light(wrt.PointLight((1.0, 2.0, 3.0), intensity=4.0))
    text = scene_text(scene)
    first = text.splitlines()[0]
    triangles = 4 + len(scene.shapes[2].mesh.faces)
    vertices = 4 + len(scene.shapes[2].mesh.vertices)
    assert first.startswith(
        f"3 shapes of 2 meshes, {triangles} triangles, {vertices} vertices, 4 materials, 1 texture;"
    )
    assert "camera      PerspectiveCamera: fov_degrees 30" in text
    assert "environment ConstantEnvironment: radiance 0.5" in text
    assert row(text, "floor") == ["floor", "2", "4", "uvs", "0"]
    assert row(text, "lamp")[-2:] == ["emission", "3"]
    assert "0          principled  base_color from wood.png, roughness from wood.png (g)" in text
    assert "1          mix         first 0, second 2" in text
    assert row(text, "wood.png")[1:] == ["8", "x", "4", "base_color,", "roughness"]
    assert "PointLight: position (1, 2, 3), intensity 4" in text


def test_long_tables_end() -> None:
    scene = wrt.Scene()
    for number in range(MOST_ROWS + 3):
        scene.add(wrt.quad((number, 0, 0), (1, 0, 0), (0, 1, 0)), name=f"tile{number}")
    text = scene_text(scene)
    assert f"  tile{MOST_ROWS - 1} " in text
    assert f"  tile{MOST_ROWS} " not in text
    assert "  and 3 more" in text


@pytest.mark.filterwarnings("default")
def test_the_command(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "cornell-box"]) == 0
    assert row(capsys.readouterr().out, "floor") == ["floor", "2", "4", "-", "0"]
    (tmp_path / "one.obj").write_text("mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(["info", str(tmp_path / "one.obj")]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("1 shape of 1 mesh, 1 triangle, 3 vertices, 1 material, 0 textures;")
    assert printed.err.count("\n") == 1
    assert "wrt: warning:" in printed.err
    assert main(["info", str(tmp_path / "none.obj")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_arrays_have_the_material_that_is_rendered(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    np.savez(tmp_path / "one.npz", vertices=mesh.vertices, faces=mesh.faces)
    np.savez(tmp_path / "two.npz", vertices=mesh.vertices, faces=mesh.faces, colors=np.full((4, 3), 0.5))
    for name, reflectance in (("one", "(0.62, 0.6, 0.57)"), ("two", "vertex-colors")):
        assert main(["info", str(tmp_path / f"{name}.npz")]) == 0
        assert f"diffuse  reflectance {reflectance}" in capsys.readouterr().out
        shown = wrt.load(tmp_path / f"{name}.npz")
        assert f"diffuse  reflectance {reflectance}" in scene_text(shown)
