"""Exact shapes as meshes: their files, their triangles, refused values, and shapes after transforms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.exact_shapes import QUADRICS, ellipse, local

import wrt
from wrt.backend.device import Device
from wrt.io.npy import arrays_of_exact
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.upload.scene_data import SceneUpload


def test_scene_files_keep_exact_shapes(tmp_path: Path) -> None:
    """To the bit, turned and inverted ones too; types of shape for them make the same."""
    rng = np.random.default_rng(2)
    grains = wrt.spheres(rng.random((5, 3)), rng.uniform(0.1, 0.2, 5), colors=rng.random((5, 4)))
    ball, tube = wrt.sphere((1, 2, 3), 0.5, exact=True).rotated((1, 2, 3), 40.0), QUADRICS["cylinder"]
    scene = wrt.Scene()
    for mesh in (grains, *(each for one in (ball, ellipse(), tube) for each in (one, one.turned_inside_out()))):
        scene.add(mesh)
    wrt.save_scene(tmp_path / "scene.toml", scene)
    for shape, read in zip(scene.shapes, wrt.load(tmp_path / "scene.toml").shapes, strict=True):
        assert type(read.mesh) is type(shape.mesh)
        for name in ("vertices", "normals", "uvs", "colors"):
            ours, theirs = getattr(shape.mesh, name), getattr(read.mesh, name)
            assert (ours is None) == (theirs is None)
            assert ours is None or ours.tobytes() == theirs.tobytes()
    np.savez(tmp_path / "grains.npz", centers=rng.random((4, 3)), radii=[0.1, 0.2, 0.1, 0.3])
    (tmp_path / "own.toml").write_text(
        '[[shapes]]\ntype = "disk"\ncenter = [1, 2, 3]\nnormal = [0, 0, 2]\nradius = 0.5\n'
        '[[shapes]]\ntype = "cylinder"\nend = [0, 2, 0]\nradius = 0.5\nscale = [2, 1, 2]\n'
        '[[shapes]]\ntype = "cylinder"\nscale = [1, 2, 3]\n'
        '[[shapes]]\ntype = "spheres"\nfile = "grains.npz"\nscale = 2\n'
        '[[shapes]]\ntype = "sphere"\nexact = true\nscale = [1, 2, 1]\n'
    )
    disk, tube, elliptic, grains, ellipsoid = (shape.mesh for shape in wrt.load(tmp_path / "own.toml").shapes)
    kinds = [Quadrics, Quadrics, wrt.Mesh, Spheres, wrt.Mesh]
    assert [type(mesh) for mesh in (disk, tube, elliptic, grains, ellipsoid)] == kinds
    assert disk.fronts[0] == pytest.approx((0, 0, 1))
    assert [disk.areas[0], tube.areas[0]] == pytest.approx([np.pi * 0.25, 2 * np.pi * 1.0 * 2.0])
    assert np.allclose(grains.radii, [0.2, 0.4, 0.2, 0.6])
    assert np.allclose(elliptic.bounds, [[-1, 0, -3], [1, 2, 3]], atol=2e-3)
    assert np.allclose(ellipsoid.bounds, [[-1, -2, -1], [1, 2, 1]])


def with_normal(normal: Any) -> dict[str, Any]:
    """Return the arrays of two disks, the second one with another normal."""
    arrays = [arrays_of_exact(mesh) for mesh in (wrt.disk((1, 2, 3), (1, 2, 2), 0.5), wrt.disk((0, 0, 1), (0, 0, 1)))]
    joined = {key: np.concatenate([each[key] for each in arrays]) for key in ("boxes", "axes")}
    joined["axes"][1, 2] = normal
    return joined


TUBE = arrays_of_exact(wrt.cylinder((1, 2, 3), (2, 2, 5), 0.5))
BALL = arrays_of_exact(wrt.sphere(exact=True))


@pytest.mark.parametrize(
    ("kind", "arrays", "cause"),
    [
        ("quadrics", with_normal((0, 0, np.nan)), r"axes\[1\]: must be finite, not"),
        ("quadrics", with_normal((0, 0.6, 0.8)), r"axes\[1\]: a disk's normal, its third row, must be perpendicular"),
        ("quadrics", TUBE | {"axes": np.ones((1, 3, 3))}, r"axes\[0\]: a cylinder's rows must be perpendicular"),
        ("quadrics", TUBE | {"axes": 2.0 * TUBE["axes"]}, r"boxes\[0\]: must be opposite corners of the box around"),
        ("spheres", BALL | {"axes": 2.0 * np.eye(3)[None]}, r"axes\[0\]: rows must be perpendicular and of length 1"),
        ("spheres", BALL | {"boxes": [[(0, 0, 0), (1, 1, 2)]]}, r"boxes\[0\]: must be the lowest and the highest"),
    ],
)
def test_wrong_arrays_are_refused(kind: str, arrays: dict[str, Any], cause: str, tmp_path: Path) -> None:
    """The message names the file, the key in the scene, the array and the fault."""
    np.savez(tmp_path / "bad.npz", **arrays)
    (tmp_path / "bad.toml").write_text(f'[[shapes]]\ntype = "{kind}"\nfile = "bad.npz"\n')
    with pytest.raises(wrt.InputError, match=rf"bad\.toml: shapes\[0\]\.file: .*bad\.npz: {cause}"):
        wrt.load(tmp_path / "bad.toml")


BALL_ASIDE = wrt.sphere((5, 0, 1), 2.0, exact=True)


@pytest.mark.parametrize("shape", [BALL_ASIDE, QUADRICS["disk"], ellipse(), QUADRICS["cylinder"]])
def test_triangles_in_their_place_face_alike(shape: Any) -> None:
    """Corners lie on the shapes, and faces and normals turn to the front, also of mirrored and inverted ones."""
    mirrored = shape.transformed(np.diag([-1.0, 1.0, 1.0, 1.0]))
    for mesh, side in (
        (shape, 1.0),
        (mirrored, 1.0),
        (shape.turned_inside_out(), -1.0),
        (mirrored.turned_inside_out(), -1.0),
    ):
        cut = mesh.tessellated(64)
        a, b, c = (cut.vertices[cut.faces[:, k]].astype(np.float64) for k in range(3))
        normal, out = np.cross(b - a, c - a), a - mesh.centers[0]
        assert (np.einsum("ij,ij->i", cut.normals[cut.faces[:, 0]], normal) > 0.0).all()
        areas = mesh.areas if isinstance(mesh, Quadrics) else 4.0 * np.pi * mesh.radii**2
        assert 0.5 * np.linalg.norm(normal, axis=1).sum() == pytest.approx(areas.sum(), rel=5e-3)
        if isinstance(mesh, Spheres):
            assert np.allclose(np.linalg.norm(out, axis=1), mesh.radii[0], rtol=1e-6)
        elif mesh.are_disks[0]:
            assert np.abs(local(mesh, out)[:, 2]).max() < 1e-5
            out, side = mesh.fronts, 1.0
        else:
            assert np.abs(np.hypot(*local(mesh, out)[:, :2].T) - 1.0).max() < 1e-5
            out = out - np.outer(out @ mesh.fronts[0], mesh.fronts[0])
        assert ((normal * out).sum(axis=1) * side > 0.0).all()


def test_the_front_of_a_mapped_disk_is_that_of_its_triangles() -> None:
    rng = np.random.default_rng(11)
    disk = wrt.disk((0.1, 0.2, 0.3), (1, 2, -1), 0.8)
    for _ in range(20):
        matrix = np.vstack([rng.standard_normal((3, 4)), [0.0, 0.0, 0.0, 1.0]])
        mapped, cut = disk.transformed(matrix), disk.tessellated(64).transformed(matrix)
        a, b, c = (cut.vertices[cut.faces[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)
        assert (normal @ mapped.fronts[0] > (1.0 - 1e-4) * np.linalg.norm(normal, axis=1)).all()
        assert ((cut.vertices >= mapped.bounds[0]) & (cut.vertices <= mapped.bounds[1])).all()


@pytest.mark.parametrize("make", [wrt.disk, wrt.cylinder])
def test_what_float32_does_not_resolve_where_it_is_moved_is_triangles(make: Any) -> None:
    """In meshes and in scenes; an emitting one has a light for each triangle."""
    far = np.eye(4)
    far[0, 3] = 3e5
    mesh = make(radius=0.1)
    assert isinstance(mesh.transformed(np.eye(4)), Quadrics)
    assert not isinstance(mesh.transformed(far), Quadrics)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((3e5, 0.5, 3), target=(3e5, 0.5, 0)))
    scene.shapes += [wrt.Shape(mesh, emission=2.0, two_sided_emission=True, transform=far)]
    built = SceneUpload(scene, Device("cpu")).finish()
    assert built.features.exact == "none"
    assert len(built.data.lights) == len(mesh.tessellated().faces)


def test_a_motion_keeps_all_that_its_keys_keep() -> None:
    """A shear that is allowed in one key but not in a motion would shift the numbers of lights."""
    sheared = np.eye(4)
    sheared[0, 1] = 0.8e-5
    mesh = wrt.cylinder(radius=0.5)
    assert mesh.keeps(sheared[None])
    assert not mesh.keeps(np.stack([np.eye(4), sheared]))
    for matrix in (np.eye(4), sheared):
        assert isinstance(mesh.transformed(matrix), Quadrics)


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize(("mesh", "exact"), [(wrt.disk(), "quadrics"), (wrt.sphere(exact=True), "spheres")])
def test_what_takes_triangles_only_says_so(mesh: wrt.Mesh, exact: str) -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    shape = scene.add(mesh)
    assert SceneUpload(scene, Device("cpu")).features.exact == exact
    with pytest.raises(wrt.InputError, match="tessellated"):
        wrt.Intersector(scene)
    with pytest.raises(wrt.InputError, match="tessellated"):
        wrt.Intersector.of_instances([mesh], [0], np.eye(4)[None])
    renderer = wrt.Renderer(scene, width=8, height=8)
    with pytest.raises(wrt.InputError, match="make a new Renderer"):
        renderer.update_vertices(shape, mesh.vertices)
    with pytest.raises(wrt.InputError, match="cannot be deformed"):
        wrt.Shape(mesh, deformation=wrt.Deformation([0.0], mesh.vertices[None]))
