"""What makes large files fast changes nothing: shared arrays, keys of positions, lines of OBJ taken together."""

import numpy as np
import pytest

import wrt
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
