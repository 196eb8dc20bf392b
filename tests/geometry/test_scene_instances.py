"""Instances make the same picture as copies of a mesh, with the memory of one."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from support.ray_trees import affine, rotation
from support.small_scenes import rendered
from support.statistics import image_z_test

import wrt
from wrt.backend.device import Device
from wrt.meshes.many_triangles import terrain
from wrt.rendering.checkpoint import scene_fingerprint
from wrt.upload.accel import instancing
from wrt.upload.scene_data import SceneUpload


def materials() -> list[wrt.Material]:
    """Return matt, brushed, normal-mapped and partly transparent materials, and glass."""
    pattern = wrt.ImageTexture(np.random.default_rng(1).random((4, 4, 3)).astype(np.float32))
    bumps = np.full((8, 8, 3), (0.5, 0.5, 1.0), np.float32)
    bumps[::2, ::3, :2] = 0.7, 0.4
    return [
        wrt.Diffuse(pattern),
        wrt.RoughConductor((0.1, 0.4)),
        wrt.Plastic(pattern, normal_map=wrt.NormalMap(bumps, filter=True)),
        wrt.Diffuse(0.6, opacity=0.5),
        wrt.Dielectric(),
    ]


def many(instanced: bool, mirrored: bool = True) -> wrt.Scene:
    """Return smooth balls with textures and emitting boxes, turned, stretched and mirrored, as instances or copies."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.6, 5.0), (0.0, 0.7, 0.0), fov_degrees=42.0))
    scene.environment = wrt.ConstantEnvironment(0.3)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.6))
    rng = np.random.default_rng(2)
    ball = wrt.sphere(subdivisions=2)
    uvs = ball.vertices[:, :2] * np.float32(0.7) + ball.vertices[:, 2:] * np.float32([0.3, 0.1])
    ball = wrt.Mesh(ball.vertices, ball.faces, ball.normals, uvs)
    box = wrt.box((-0.5, -0.2, -0.3), (0.5, 0.2, 0.3))
    looks = [{"material": material} for material in materials() * 2]
    looks += [{"emission": tuple(rng.uniform(1, 6, 3))} for _ in range(3)]
    for i, look in enumerate(looks):
        mesh, least, lift = (ball, 0.2, 0.0) if "material" in look else (box, 0.4, 1.1)
        mirror = np.diag([1.0, 1.0, -1.0 if mirrored and i % 2 else 1.0])
        linear = rotation(rng) @ np.diag(rng.uniform(least, 0.7, 3)) @ rotation(rng) @ mirror
        transform = affine(linear, rng.uniform((-2, 0.3 + lift, -2), (2, 1.4 + lift, 1)))
        if instanced:
            scene.add(mesh, transform=transform, **look)
        else:
            scene.add(mesh.transformed(transform), **look)
    return scene


@pytest.mark.slow
def test_a_picture_of_instances_is_that_of_copies(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    copies, instances = many(False), many(True)
    assert instancing.lay_out(copies).kind == "none"
    assert instancing.lay_out(instances).kind == "still"
    assert len(instancing.lay_out(instances).shared) == 2
    # With the same random numbers nearly all paths agree to rounding. (In copies of mirror images corners have another
    # order, and so have the points on lights.)
    one, two = (rendered(many(instanced, False), 16, seed=1, device=device) for instanced in (False, True))
    near = np.abs(one.image() - two.image()) <= 1e-3 * one.image()
    report("channels that differ by less than 0.1 %, same random numbers", near.mean())
    assert near.mean() > 0.9
    # With others: the same expectation.
    two, one = rendered(instances, 256, seed=2, device=device), rendered(copies, 256, seed=3, device=device)
    test = image_z_test(two.image(), two.variance(), one.image(), one.variance(), n_a=256, n_b=256)
    report("other random numbers", test.message)
    assert test.pass_fraction >= 0.995
    assert min(test.block_p, test.mean_p) > 1e-3
    # A wrong partner: mirrored ones without the mirror.
    wrong = rendered(many(False, False), 256, seed=4, device=device)
    test = image_z_test(two.image(), two.variance(), wrong.image(), wrong.variance(), n_a=256, n_b=256)
    report("copies that are not mirrored: p of blocks", test.block_p)
    assert test.block_p < 1e-6


def test_a_mesh_takes_memory_once(device: str, report: Report) -> None:
    """Ten thousand instances of 20 thousand triangles."""
    mesh, places = terrain(20_000), np.tile(np.eye(4), (10_000, 1, 1))
    places[:, :3, 3] = np.random.default_rng(8).uniform(-1000, 1000, (10_000, 3))
    sizes = []
    for count in (2, 10_000):
        scene = wrt.Scene(camera=wrt.PerspectiveCamera())
        scene.add_instances(mesh, places[:count], material=wrt.Diffuse(0.5))
        data = SceneUpload(scene, Device(device)).finish().data
        placed = data.placed
        arrays = [data.points, data.indices, data.normals, data.triangle_shape, data.shapes]
        arrays += [placed.nodes, placed.instances, placed.meshes]
        arrays += [a for tree in placed.meshes._ref for a in (tree.bvh.nodes, tree.bvh.leaves)]
        sizes.append(sum(a.capacity or a.size * 4 for a in arrays))
        assert (len(data.points), len(data.indices)) == (len(mesh.vertices), 3 * len(mesh.faces))
    each = (sizes[1] - sizes[0]) / 9998
    report("bytes of two instances, of each further one", f"{sizes[0]}, {each:.0f}")
    assert each < 400
    assert sizes[0] < 200 * len(mesh.faces)


def test_what_stands_in_one_place_lies_in_the_world() -> None:
    ball, aside = wrt.sphere(subdivisions=4), affine(np.eye(3), (1.0, 2.0, 3.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(shutter_close=1.0))
    scene.add(ball)
    for transform, kind in ((aside, "none"), (np.eye(4), "still"), (wrt.Motion.translation((1, 0, 0)), "moving")):
        scene.add(ball, transform=transform)
        assert instancing.lay_out(scene).kind == kind
    scene = wrt.Scene()
    scene.add_instances(wrt.box(), [np.eye(4), aside])  # too few triangles to share
    assert instancing.lay_out(scene).kind == "none"


def test_normals_follow_a_deformation(report: Report) -> None:
    """A smooth ball that becomes an ellipsoid has its normals; a box keeps its edges."""
    ball, stretch = wrt.sphere(subdivisions=4), np.array([2.0, 1.0, 0.5])
    deformation = wrt.Deformation((0.0, 1.0), np.stack([ball.vertices, ball.vertices * stretch]))
    end = deformation.at(1.0, ball)
    exact = ball.vertices / stretch
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    assert end.normals is not None
    error = np.degrees(np.arccos(np.clip((end.normals * exact).sum(axis=1), -1, 1)))
    report("largest error of a normal, degrees", error.max())
    assert error.max() < 2.0
    half = deformation.at(0.5, ball)
    np.testing.assert_allclose(half.vertices, ball.vertices * (1.0 + stretch) / 2.0, rtol=1e-6)


def test_fingerprints_see_transforms_and_deformations() -> None:
    box, aside, motion = wrt.box(), affine(np.eye(3), (1.0, 0.0, 0.0)), wrt.Motion.translation((1.0, 0.0, 0.0))
    corners = np.stack([box.vertices] * 2)
    different = [None, np.eye(4), aside, motion, wrt.Motion(motion.times, motion.transforms, (1.0, 0.0, 0.0))]
    different += [wrt.Deformation(keys, corners) for keys in ((0.0, 1.0), (0.1, 1.1))]
    found = set()
    for change in [*different, aside.copy(), wrt.Motion.translation((1.0, 0.0, 0.0))]:
        scene = wrt.Scene()
        kind = "deformation" if isinstance(change, wrt.Deformation) else "transform"
        scene.add(box, **{kind: change})
        found.add(scene_fingerprint(scene)["geometry"])
    assert len(found) == len(different)
