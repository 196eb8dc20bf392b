"""Meshes without normals get sensible ones."""

from __future__ import annotations

import numpy as np
import pytest
from support.meshes import SQUARE, triangles, write

import wrt
from wrt.io.load_mesh import load_mesh
from wrt.scene.normals import with_normals


def test_normals_of_a_sphere_converge_to_its_own_whatever_its_seams():
    errors = []
    for subdivisions in (2, 3, 4):
        sphere = wrt.sphere(subdivisions=subdivisions)
        soup = wrt.Mesh(triangles(sphere).reshape(-1, 3), np.arange(3 * len(sphere.faces)).reshape(-1, 3))
        welded, split = with_normals(wrt.Mesh(sphere.vertices, sphere.faces)), with_normals(soup)
        assert len(welded.vertices) == len(sphere.vertices)
        assert len(split.vertices) == len(soup.vertices)
        np.testing.assert_allclose(split.normals[split.faces], welded.normals[welded.faces], atol=1e-6)
        errors.append(float(np.abs(welded.normals - welded.vertices).max()))
    # At least first order: half the edge length, half the error.
    assert errors[1] < 0.55 * errors[0]
    assert errors[2] < 0.55 * errors[1]


def test_normals_are_weighted_by_angle_not_by_triangles():
    # One side of the cube's corner is cut into many slivers; the corner's normal must not lean to it.
    fan = [[np.cos(t), np.sin(t), 0.0] for t in np.linspace(0, np.pi / 2, 20)]
    points = np.array([[0, 0, 0], *fan, [0, 0, 1]])
    faces = [[0, k, k + 1] for k in range(1, 20)] + [[0, 20, 21], [0, 21, 1]]
    mesh = with_normals(wrt.Mesh(points, np.array(faces)), 180.0)
    np.testing.assert_allclose(mesh.normals[0], [3**-0.5] * 3, atol=1e-6)


@pytest.mark.parametrize(("fold", "crease", "smooth"), [(30, 40, True), (50, 40, False), (50, 60, True), (1, 0, False)])
def test_creases_split_where_the_surface_folds(fold, crease, smooth):
    t = np.deg2rad(fold)
    x, y = np.cos(t), np.sin(t)
    points = np.array([[0, 0, 0], [0, 0, 1], [-1, 0, 0], [-1, 0, 1], [x, y, 0], [x, y, 1]])
    faces = np.array([[2, 3, 1], [2, 1, 0], [0, 1, 5], [0, 5, 4]])
    mesh = with_normals(wrt.Mesh(points, faces), crease)
    on_ridge = (np.abs(mesh.vertices[:, :2]) < 1e-6).all(axis=1)
    assert on_ridge.sum() == (2 if smooth else 4)
    expected = [[-np.sin(t / 2), np.cos(t / 2), 0]] if smooth else [[0, 1, 0], [-np.sin(t), np.cos(t), 0]]
    for normal in mesh.normals[on_ridge]:
        assert min(np.abs(normal - e).max() for e in expected) < 1e-6


def test_surfaces_back_to_back_keep_their_own_normals():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    mesh = with_normals(wrt.Mesh(square, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])), 180.0)
    flat = np.array([[0, 0, 1]] * 2 + [[0, 0, -1]] * 2)
    np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)


def test_given_normals_are_made_unit_and_mended(tmp_path):
    text = SQUARE + "vn 0 0 5\nvn 0 0 0\nvn nan 0 1\nvn 0.6 0 0.8\nf 1//1 2//2 3//3 4//4\n"
    mesh = load_mesh(write(tmp_path, "mesh.obj", text))
    expected = {(0, 0): [0, 0, 1], (1, 0): [0, 0, 1], (1, 1): [0, 0, 1], (0, 1): [0.6, 0, 0.8]}
    for vertex, normal in zip(mesh.vertices, mesh.normals, strict=True):
        np.testing.assert_allclose(normal, expected[int(vertex[0]), int(vertex[1])], atol=1e-6)


def test_normals_do_not_depend_on_scale():
    ball = wrt.sphere(subdivisions=2)
    for scale in (1e-18, 1e15):
        mesh = with_normals(wrt.Mesh(ball.vertices.astype(np.float64) * scale, ball.faces))
        np.testing.assert_allclose(mesh.normals, ball.normals, atol=0.02)
