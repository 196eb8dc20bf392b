"""What makes large files fast changes nothing: shared arrays, keys of positions, lines of OBJ taken together."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.backend.memory import zeros
from wrt.cli.process import importing
from wrt.errors import InputError
from wrt.io.mesh import obj
from wrt.scene import normals


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize("name", ["a.obj", "a.npz", "a.toml"])
def test_what_nobody_can_write_to_is_in_memory_once_and_stays_as_it_was(name, tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
    square = wrt.load_mesh(tmp_path / "a.obj")
    np.savez(tmp_path / "a.npz", vertices=square.vertices, faces=square.faces)
    shapes = 'shapes = [{ type = "many-triangles", triangles = 1000 }]\n'
    (tmp_path / "a.toml").write_text(shapes + 'environment = { type = "constant" }\n')
    scene = wrt.load(tmp_path / name)
    mesh = scene.shapes[0].mesh
    before = mesh.vertices.copy()
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1.0
    renderer = wrt.Renderer(scene, width=8, height=8)
    assert np.shares_memory(mesh.vertices, renderer._built.data.points.numpy())
    renderer.update_vertices(0, before + np.float32(0.25))
    assert not np.shares_memory(mesh.vertices, renderer._built.data.points.numpy())
    np.testing.assert_array_equal(mesh.vertices, before)


def test_zeros_take_no_memory_until_they_are_written_however_often_there_were_some_before():
    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    size = 24 << 20
    for _ in range(3):
        before = resident()
        rows = zeros((size // 12, 3), np.float32)
        assert resident() - before < size // 8
        assert not rows.any()
        rows += 1.0
        assert resident() - before > size // 2
        del rows
    assert zeros((2, 3), np.int32).tolist() == [[0, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize("collide", [False, True])
@pytest.mark.parametrize("distinct", [3, 5000])
def test_equal_positions_are_found_whatever_their_keys(collide, distinct, monkeypatch):
    points = np.random.default_rng(distinct).integers(-5, 5, (distinct, 3)).astype(np.float32) * np.float32(0.5)
    vertices = np.concatenate([points, points[: distinct // 3], -points[:1] * 0.0])
    if collide:
        monkeypatch.setattr(normals, "_keys", lambda rows: (rows[:, 0] > 0.0).astype(np.uint64))
    index = normals.same_positions(vertices)
    _, expected = np.unique(vertices + np.float32(0.0), axis=0, return_inverse=True)
    pairs = np.unique(np.stack([index, expected.reshape(-1)], axis=1), axis=0)
    assert len(pairs) == index.max() + 1 == expected.max() + 1  # one to one, without gaps


@pytest.mark.parametrize("welded", [True, False])
def test_normals_of_large_meshes_are_those_of_small_ones_whatever_the_threads(welded, monkeypatch):
    ball = wrt.sphere(subdivisions=5)
    points = ball.vertices * (1.0 + 0.2 * np.sin(9.0 * ball.vertices[:, :1]))
    soup = np.arange(ball.faces.size).reshape(-1, 3)
    mesh = wrt.Mesh(points * 1e-12, ball.faces) if welded else wrt.Mesh(points[ball.faces].reshape(-1, 3), soup)
    assert len(mesh.faces) < normals.CREASE_LIMIT
    expected = normals.with_normals(mesh, 180.0)
    monkeypatch.setattr(normals, "CREASE_LIMIT", 0)
    found = []
    for threads in (1, 3, 7):
        monkeypatch.setattr("wrt.backend.device.available_threads", lambda threads=threads: threads)
        found.append(normals.with_normals(mesh))
        np.testing.assert_array_equal(found[-1].normals, found[0].normals)
    of_corners = [each.normals[each.faces] for each in (expected, found[0])]
    np.testing.assert_allclose(of_corners[1], of_corners[0], atol=3e-7)


def test_corners_of_thin_triangles_weigh_by_their_angles_and_normals_that_cancel_are_mended(monkeypatch):
    # At the tip of a needle, in a plane, of 0.0001 degrees, and a triangle upright at its tip.
    width = np.tan(np.deg2rad(1e-4))
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0, width], [0, 2 * width, 0], [1, width, 0]], np.float32)
    needle = wrt.Mesh(points, np.array([[0, 2, 1], [0, 1, 4]]))
    expected = normals.with_normals(needle, 180.0).normals
    assert (np.abs(expected[0, 1:]) > 0.5).all()
    monkeypatch.setattr(normals, "CREASE_LIMIT", 0)
    np.testing.assert_allclose(normals.with_normals(needle).normals, expected, atol=1e-5)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    mended = normals.with_normals(wrt.Mesh(square, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])))
    flat = np.array([[0, 0, 1]] * 2 + [[0, 0, -1]] * 2)
    np.testing.assert_allclose(mended.normals[mended.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)


def test_modules_are_imported_beside_other_work_and_mistakes_of_theirs_are_told_by_whoever_needs_them():
    interval = sys.getswitchinterval()
    sys.modules.pop("wave", None)
    with importing(["no_such_module_of_anybody"]), importing(["wave"]):
        for _ in range(1000):
            if "wave" in sys.modules:
                break
            time.sleep(0.01)
    assert "wave" in sys.modules
    assert sys.getswitchinterval() == interval


def test_lines_of_obj_taken_together_say_what_they_say_one_by_one():
    faces = ["f 1 2 3", "f 1/1 2/2 3/3", "f 1//1 2//1 3//1", "f 1/1/1 2/2/1 3/3/1", "f 1 2 3 4", "f 1/1 2/1 3/1 4/1"]
    lines = ["v 0 0 0"] * 1200 + ["vt  0 0 "] * 3 + ["vn 0 0 1", "# no more", ""]
    for face in faces:
        lines += [face] * 3 + ["usemtl m"]
    plain = obj._plain(Path("a.obj"), "\n".join(lines) + "\n").split("\n")
    said = [" ".join(line.split()) for line in lines if line and not line.startswith("#")]
    assert [line for line in plain if line and not line.startswith("g ")] == said
    groups = ["g 3 0 False", "g 3 3 False", "g 3 6 True", "g 3 6 False", "g 4 0 False", "g 4 4 False"]
    assert [line for line in plain if line.startswith("g ")] == groups
    text = "v 0 0 0\n" * 1300 + "f 1 2 3\n" * 700 + "f 1 2 -1301\n"
    with pytest.raises(InputError, match="line 2001: face corner '-1301'"):
        obj._plain(Path("a.obj"), text)
