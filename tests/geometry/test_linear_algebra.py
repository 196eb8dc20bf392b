"""wrt's linear algebra: as accurate as NumPy's, also for hard matrices, and the same bits on every processor."""

from __future__ import annotations

import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from conftest import ROOT

from wrt.backend.processor import processor_flags
from wrt.errors import InputError
from wrt.linalg import determinant, dot, gauss_legendre, inverse, norm, polar, product, singular_values, weighted_sum
from wrt.scene.motion import check_affine, rotation_matrix

EPS = float(np.finfo(np.float64).eps)
RANDOM = np.random.default_rng(11)
TURN = rotation_matrix((1.0, 2.0, 3.0), 50.0)
OTHER = rotation_matrix((-2.0, 1.0, 0.4), 130.0)

HARD = {
    "rotation": TURN,
    "half turn": np.diag([-1.0, -1.0, 1.0]),
    "mirror": np.diag([1.0, 1.0, -1.0]) @ TURN,
    "zero pivots": np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 0.0]]),
    "one size": 1e-15 * TURN,
    "flat": TURN @ np.diag([1.0, 1.0, 1e-9]) @ OTHER,
    "needle": TURN @ np.diag([1e6, 1e-6, 1e-6]) @ OTHER,
    "sheared": np.array([[1.0, 1e6, 0.0], [0.0, 1.0, 1e6], [0.0, 0.0, 1.0]]),
    "huge": 1e30 * RANDOM.normal(size=(3, 3)),
    "tiny": 1e-30 * RANDOM.normal(size=(3, 3)),
}


@pytest.mark.parametrize("name", HARD)
def test_inverses_are_as_near_as_numpys(name: str) -> None:
    matrix = HARD[name]
    found, theirs = inverse(matrix), np.linalg.inv(matrix)
    condition = np.linalg.cond(matrix)
    assert np.abs(found - theirs).max() <= 8.0 * EPS * condition * np.abs(theirs).max()
    # NumPy's determinants are exponentials of sums of logarithms, which are less accurate.
    a, b, c = ([Fraction(x) for x in row] for row in matrix.tolist())
    minors = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    exact = float(sum(x * y for x, y in zip(a, minors, strict=True)))
    assert determinant(matrix) == pytest.approx(exact, rel=8.0 * EPS * condition)
    # The residual on one side is as small as a backward stable method leaves it.
    assert np.abs(found @ matrix - np.eye(3)).max() <= 8.0 * EPS * condition


def test_a_stack_has_the_bits_of_its_matrices() -> None:
    stack = np.stack([*HARD.values(), *RANDOM.normal(size=(100, 3, 3))])
    for function in (inverse, determinant):
        np.testing.assert_array_equal(function(stack), [function(matrix) for matrix in stack])
    affine = np.tile(np.eye(4), (len(stack), 1, 1))
    affine[:, :3, :3], affine[:, :3, 3] = stack, 1.0
    np.testing.assert_array_equal(inverse(affine)[:, :3, :3], inverse(stack))
    regular = stack[len(HARD) :]
    for matrices in (regular, regular[:, :, :2]):
        assert np.allclose(singular_values(matrices), np.linalg.svd(matrices, compute_uv=False), rtol=1e-12)
    rotations, stretches = polar(regular)
    assert np.allclose(rotations @ stretches, regular, atol=1e-13)


def test_matrices_that_have_no_inverse_are_refused() -> None:
    for matrix in (np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0]), np.outer([1.0, 2.0, 4.0], [1.0, 0.5, 0.25])):
        assert determinant(matrix) == 0.0
        with pytest.raises(np.linalg.LinAlgError):
            inverse(matrix)
        with pytest.raises(np.linalg.LinAlgError):
            inverse(np.stack([np.eye(3), matrix]))
        affine = np.eye(4)
        affine[:3, :3] = matrix
        with pytest.raises(InputError, match="the place is not invertible"):
            check_affine(affine, "the place")
    affine[:3, :3] = np.diag([1.0, 1.0, 1e-39])
    with pytest.raises(InputError, match="the place scales by over 1e38 or by under 1e-38"):
        check_affine(affine, "the place")


@pytest.mark.parametrize("name", HARD)
def test_polar_factors_are_a_rotation_and_a_stretch(name: str) -> None:
    matrix = HARD[name]
    rotation, stretch = polar(matrix)
    size = np.linalg.norm(matrix, 2)
    assert np.abs(rotation.T @ rotation - np.eye(3)).max() <= 16.0 * EPS
    assert np.abs(stretch - stretch.T).max() <= 2.0 * EPS * size
    assert np.abs(rotation @ stretch - matrix).max() <= 16.0 * EPS * size
    u, sizes, vt = np.linalg.svd(matrix)
    assert np.abs(stretch - vt.T @ np.diag(sizes) @ vt).max() <= 32.0 * EPS * size
    # The rotation is as sure as the two smallest singular values are large.
    assert np.abs(rotation - u @ vt).max() <= 64.0 * EPS * size / (sizes[1] + sizes[2])
    assert np.abs(singular_values(matrix) - sizes).max() <= 8.0 * EPS * size


def test_products_are_those_of_the_operator() -> None:
    a, b, stack = RANDOM.normal(size=(4, 4)), RANDOM.normal(size=(4, 4)), RANDOM.normal(size=(7, 5, 4))
    for x, y in ((a, b), (stack, a), (stack[:, :4], stack[:, :4]), (a[0], b), (a, b[0]), (a[0], b[0])):
        found = product(x, y)
        assert found.shape == np.shape(x @ y)
        assert np.allclose(found, x @ y, rtol=0.0, atol=32.0 * EPS)
    assert product(a.astype(np.float32), b.astype(np.float32)).dtype == np.float32
    assert product([1, 2], [3, 4]) == dot([1, 2], [3, 4]) == 11
    assert norm([2.0, 3.0, 6.0]) == 7.0
    with pytest.raises(ValueError, match="broadcast"):
        product(a, b[:3])
    colors = RANDOM.random((7, 5, 3), dtype=np.float32)
    found = weighted_sum(colors, (0.2, 0.7, 0.1))
    assert found.dtype == np.float32
    assert np.allclose(found, colors @ np.array([0.2, 0.7, 0.1]), rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 24, 128])
def test_quadrature_is_exact_for_polynomials(count: int) -> None:
    nodes, weights = gauss_legendre(count)
    assert np.abs(nodes - np.polynomial.legendre.leggauss(count)[0]).max() <= 2.0 * EPS
    assert (np.diff(nodes) > 0.0).all()
    for power in range(0, 2 * count, max(1, count // 8)):
        exact = 2.0 / (power + 1) if power % 2 == 0 else 0.0
        assert abs((weights * nodes**power).sum() - exact) <= 32.0 * EPS


# --- The same on every processor ----------------------------------------------------------------------

CORES = "Haswell", "SkylakeX" if "avx512f" in processor_flags() else "Sandybridge"
"""Processors whose code in OpenBLAS differs and runs here: with AVX2, and with AVX-512 or without fused operations."""

ARRAYS = """
import hashlib
import numpy as np
import wrt
from wrt.backend.arrays import Struct
from wrt.backend.device import Device
from wrt.scene.motion import rotation_matrix
from wrt.upload.scene_data import SceneUpload

random = np.random.default_rng(3)
turns = np.tile(np.eye(4), (9, 1, 1))
for k, turn in enumerate(turns):
    turn[:3, :3] = rotation_matrix((1.0, 2.0, 3.0), 40.0 * k) @ np.diag([1.0, 1.0 + k, 0.3])
    turn[:3, 3] = random.normal(size=3)
motion = wrt.Motion(np.arange(9.0), turns, (0.1, 0.2, 0.3)).after(turns[4])
turned = np.diag([1.7, 1.7, 1.7, 1.0])
turned[:3, :3] = 1.7 * rotation_matrix((3.0, 1.0, 2.0), 77.0)
camera = wrt.PerspectiveCamera((0.1, 0.7, 3.3), (0.31, -0.2, 0.17), (0.1, 1.0, 0.2), shutter_close=8.0)
scene = wrt.Scene(camera=camera, environment=wrt.SunSkyEnvironment())
soup = wrt.Mesh(random.random((300, 3)), np.arange(300).reshape(-1, 3), normals=random.normal(size=(300, 3)))
for mesh in (soup, wrt.disk(), wrt.cylinder(), wrt.spheres([[0.1, 0.2, 0.3]], [0.7])):
    scene.add(mesh.transformed(turned), emission=1.0)
scene.add_instances(wrt.sphere(subdivisions=5), turns)
scene.add(wrt.box(), transform=motion)
u, v = 0.7 * rotation_matrix((0.3, 0.1, 0.9), 33.0)[:2]
scene.add_light(wrt.RectangleLight((0.1, 0.2, 0.3), tuple(u), tuple(v), (1.0, 1.0, 1.0)))

def show(name, value):
    if name == "scene.placed.meshes":  # holds addresses
        return
    if hasattr(value, "numpy"):
        print(name, hashlib.sha256(np.ascontiguousarray(value.numpy()).tobytes()).hexdigest())
    elif isinstance(value, Struct):
        for field, each in value.fields().items():
            show(f"{name}.{field}", each)

show("scene", SceneUpload(scene, Device("cpu")).finish().data)
for array in (motion.at(np.linspace(0.0, 8.0, 333)), camera.frame()):
    print(hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_scenes_are_built_the_same_by_the_code_of_another_processor() -> None:
    """In processes whose OpenBLAS uses the code of different processors."""
    printed = []
    for core in CORES:
        environment = {**os.environ, "OPENBLAS_CORETYPE": core, "PYTHONPATH": str(ROOT)}
        run = subprocess.run(
            [sys.executable, "-c", ARRAYS], env=environment, capture_output=True, text=True, check=True
        )
        printed.append(run.stdout.splitlines())
    assert len(printed[0]) > 24
    assert printed[0] == printed[1]
