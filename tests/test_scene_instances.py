"""Meshes that stand in many places make the same picture as copies of them, for the memory of one."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import image_z_test, t_test_mean

import wrt
from wrt.backend.device import Device
from wrt.upload.accel import instancing
from wrt.upload.scene_data import build_scene

FloatArray = NDArray[np.float64]


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of few triangles too have trees of their own."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)


def turn(rng: np.random.Generator) -> FloatArray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.sign(np.linalg.det(q)))


def affine(linear: FloatArray, offset: FloatArray | tuple[float, ...]) -> FloatArray:
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def rendered(scene: wrt.Scene, device: str, spp: int, **options: object) -> wrt.Renderer:
    settings = {"width": 48, "height": 36, "max_depth": 5, "sampler": "independent", **options}
    renderer = wrt.Renderer(scene, device=device, **settings)  # type: ignore[arg-type]
    for _ in renderer.passes(spp=spp):
        pass
    assert renderer.film.rejected == 0
    return renderer


def materials() -> list[wrt.Material]:
    """Matt, brushed along the texture, with a normal map, transparent in part, and glass."""
    rng = np.random.default_rng(1)
    pattern = wrt.ImageTexture(rng.random((4, 4, 3)).astype(np.float32))
    bumps = np.full((8, 8, 3), (0.5, 0.5, 1.0), np.float32)
    bumps[::2, ::3, :2] = 0.7, 0.4
    brushed = wrt.RoughConductor.preset("gold") if hasattr(wrt.RoughConductor, "preset") else wrt.RoughConductor()
    return [
        wrt.Diffuse(pattern),
        brushed,
        wrt.Plastic(pattern, normal_map=wrt.NormalMap(bumps, filter=True)),
        wrt.Diffuse(0.6, opacity=0.5),
        wrt.Dielectric(),
    ]


def many(instanced: bool, mirrored: bool = True) -> wrt.Scene:
    """Smooth balls with textures and shining boxes, turned, stretched, mirrored, by transform or as copies."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.6, 5.0), (0.0, 0.7, 0.0), fov_degrees=42.0))
    scene.environment = wrt.ConstantEnvironment(0.3)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.6))
    rng = np.random.default_rng(2)
    ball = wrt.sphere(subdivisions=2)
    uvs = ball.vertices[:, :2] * np.float32(0.7) + ball.vertices[:, 2:] * np.float32([0.3, 0.1])
    ball = wrt.Mesh(ball.vertices, ball.faces, ball.normals, uvs)
    box = wrt.box((-0.5, -0.2, -0.3), (0.5, 0.2, 0.3))
    places = []
    for i, material in enumerate(materials() * 2):
        linear = turn(rng) @ np.diag(rng.uniform(0.2, 0.6, 3)) @ turn(rng)
        if mirrored and i % 2:
            linear = linear @ np.diag([1.0, 1.0, -1.0])
        places.append((ball, {"material": material}, affine(linear, rng.uniform((-2, 0.3, -2), (2, 1.4, 1)))))
    for i in range(3):
        linear = turn(rng) @ np.diag(rng.uniform(0.4, 0.8, 3) * [1, 1, -1 if mirrored and i % 2 else 1])
        glow = {"emission": tuple(rng.uniform(1, 6, 3))}
        places.append((box, glow, affine(linear, rng.uniform((-2, 1.5, -2), (2, 2.5, 1)))))
    for mesh, look, transform in places:
        if instanced:
            scene.add(mesh, transform=transform, **look)  # type: ignore[arg-type]
        else:
            scene.add(mesh.transformed(transform), **look)  # type: ignore[arg-type]
    return scene


@pytest.mark.slow
def test_a_picture_of_instances_is_that_of_copies(shared: None, device: str, report: Report) -> None:
    copies, instances = many(False), many(True)
    assert instancing.lay_out(copies).kind == "none"
    assert instancing.lay_out(instances).kind == "still"
    assert len(instancing.lay_out(instances).shared) == 2
    # With the same random numbers all but a few paths find the same, but for rounding. (In copies of mirror images
    # corners have another order, and so the points on lights.)
    one, other = (rendered(many(instanced, False), device, 16, seed=1) for instanced in (False, True))
    near = np.abs(one.image() - other.image()) <= 1e-3 * one.image()
    report("channels that differ by less than 0.1 %, same random numbers", near.mean())
    assert near.mean() > 0.9
    # With others: the same expectation.
    two = rendered(instances, device, 512, seed=2)
    one = rendered(copies, device, 512, seed=3)
    test = image_z_test(two.image(), two.variance(), one.image(), one.variance(), n_a=512, n_b=512)
    report("other random numbers", test.message)
    assert test.pass_fraction >= 0.995
    assert min(test.block_p, test.mean_p) > 1e-3
    # A wrong partner: mirrored ones without the mirror.
    wrong = many(False)
    for i in (2, 4, 6, 8, 10):
        shape = instances.shapes[i]
        straight = np.asarray(shape.transform) @ np.diag([1.0, 1.0, -1.0, 1.0])
        wrong.shapes[i] = wrt.Shape(shape.mesh.transformed(straight), shape.material)
    wrong_one = rendered(wrong, device, 256, seed=4)
    test = image_z_test(two.image(), two.variance(), wrong_one.image(), wrong_one.variance(), n_a=512, n_b=256)
    report("copies that are not mirrored: p of blocks", test.block_p)
    assert test.block_p < 1e-6


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("away", [0.0, 30.0])
def test_convex_bodies_do_not_shade_themselves(
    shared: None, scale: float, away: float, device: str, report: Report
) -> None:
    """Under a sky of radiance 1 a convex body shows its albedo, exactly but for what it wrongly blocks.

    The bodies are of flat facets, stretched and turned, and `away` of their own sizes from the origin.
    """
    rng = np.random.default_rng(6)
    ball = wrt.sphere(subdivisions=3)
    # Modelled away from its own origin, by which rounding is worse.
    body = wrt.Mesh(ball.vertices + np.float32([3.0, -2.0, 1.0]), ball.faces)
    center = scale * away * np.array([1.0, 0.6, -0.8])
    linear = scale * turn(rng) @ np.diag([1.0, 0.4, 1.0]) @ turn(rng)
    place = affine(linear, center - linear @ np.array([3.0, -2.0, 1.0]))
    eye = center + scale * np.array([0.0, 0.0, 8.0])
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(eye), tuple(center), fov_degrees=10.0))
    scene.environment = wrt.ConstantEnvironment(1.0)
    other = place.copy()
    other[:3, 3] += scale * np.array([0.0, 0.0, 4000.0])  # nearly out of sight
    scene.add_instances(body, [place, other], material=wrt.Diffuse(0.5))
    renderer = rendered(scene, device, 64, width=32, height=32, max_depth=8, filter="box")
    assert renderer._built.features.instances == "still"
    inside = renderer.image()[10:22, 10:22, 0].astype(np.float64)
    report(f"scale {scale:g}, {away:g} away: radiance", inside.mean(), 0.5)
    assert np.abs(inside - 0.5).max() < 2e-3
    assert abs(inside.mean() - 0.5) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_furnace_of_an_instance(shared: None, scale: float, moving: bool, device: str, report: Report) -> None:
    """Inside a closed shining body of albedo a the radiance is 1 / (1 − a): nothing gets in or out."""
    rng = np.random.default_rng(7)
    ball = wrt.sphere(subdivisions=2)
    inward = wrt.Mesh(ball.vertices, ball.faces[:, ::-1])
    linear = scale * turn(rng) @ np.diag([1.0, 0.6, -1.0]) @ turn(rng)
    center = scale * np.array([4.0, -7.0, 2.0])
    place = affine(linear, center)
    camera = wrt.PerspectiveCamera(
        tuple(center + scale * np.array([0.1, -0.05, 0.2])), tuple(center), fov_degrees=90.0, shutter_close=1.0
    )
    scene = wrt.Scene(camera=camera)
    glow = {"material": wrt.Diffuse(0.5), "emission": 1.0}
    if moving:
        spin = wrt.Motion.rotation((1, 2, 0), 150.0, center=center).after(place)
        scene.add(inward, transform=spin, **glow)  # type: ignore[arg-type]
    else:
        far = place.copy()
        far[:3, 3] += scale * np.array([50.0, 0.0, 0.0])
        scene.add_instances(inward, [place, far], **glow)  # type: ignore[arg-type]
    for strategy in ("mis", "bsdf"):
        renderer = rendered(scene, device, 256, width=16, height=16, max_depth=1000, strategy=strategy)
        assert renderer._built.features.instances == ("moving" if moving else "still")
        mean = float(renderer.image()[..., 0].astype(np.float64).mean())
        error = float(np.sqrt(renderer.variance()[..., 0].sum())) / 256
        report(f"scale {scale:g}, {strategy}", mean, 2.0, p=t_test_mean(mean, error**2, 256 * 256, 2.0))
        assert abs(mean - 2.0) < 4.0 * max(error, 1e-6)


def test_a_mesh_takes_memory_once(device: str, report: Report) -> None:
    """Ten thousand instances of 70 thousand triangles."""
    from wrt.meshes.many_triangles import terrain

    mesh = terrain(70_000)
    rng = np.random.default_rng(8)
    places = np.tile(np.eye(4), (10_000, 1, 1))
    places[:, :3, 3] = rng.uniform(-1000, 1000, (10_000, 3))
    sizes = []
    for count in (2, 10_000):
        scene = wrt.Scene(camera=wrt.PerspectiveCamera())
        scene.add_instances(mesh, places[:count], material=wrt.Diffuse(0.5))
        data = build_scene(scene, Device(device)).data
        placed = data.placed
        arrays = [data.points, data.indices, data.normals, data.triangle_shape, data.shapes]
        arrays += [placed.nodes, placed.instances, placed.meshes]
        arrays += [a for tree in placed.meshes._ref for a in (tree.bvh.nodes, tree.bvh.leaves)]
        sizes.append(sum(a.capacity or a.size * 4 for a in arrays))
        assert len(data.points) == len(mesh.vertices)
        assert len(data.indices) == 3 * len(mesh.faces)
        assert len(placed.meshes) == 1
    each = (sizes[1] - sizes[0]) / 9998
    report("bytes of two instances, of each further one", f"{sizes[0]}, {each:.0f}")
    assert each < 400
    assert sizes[0] < 200 * len(mesh.faces)


def test_what_lies_in_the_world_and_what_does_not() -> None:
    ball, small = wrt.sphere(subdivisions=4), wrt.box()
    there = affine(np.eye(3), (1.0, 2.0, 3.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(shutter_close=1.0))
    scene.add(ball)
    scene.add(ball, transform=there)
    found = instancing.lay_out(scene)
    assert found.kind == "none"
    np.testing.assert_array_equal(found.world_meshes[1].vertices, ball.transformed(there).vertices)
    scene.add_instances(small, [np.eye(4), there])
    assert instancing.lay_out(scene).kind == "none"
    scene.add(ball, transform=np.eye(4))
    found = instancing.lay_out(scene)
    assert (found.kind, found.world_shapes, [i.shape for i in found.instances]) == ("still", [0, 2, 3], [1, 4])
    scene.add(small, transform=wrt.Motion.translation((1.0, 0.0, 0.0)))
    assert instancing.lay_out(scene).kind == "moving"


@pytest.mark.parametrize(
    ("transform", "message"),
    [
        (np.eye(3), r"transform must be a \(4, 4\) matrix or a wrt.Motion, not an array of \(3, 3\)"),
        (np.diag([1.0, 0.0, 1.0, 1.0]), "not invertible"),
        ("turn", "not str"),
        (np.full((4, 4), np.nan), "finite"),
    ],
)
def test_what_is_no_transform(transform: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Shape(wrt.box(), transform=transform)  # type: ignore[arg-type]


def test_what_is_no_deformation() -> None:
    with pytest.raises(wrt.InputError, match="9 vertices, but the mesh"):
        wrt.Shape(wrt.box(), deformation=wrt.Deformation((0.0, 1.0), np.zeros((2, 9, 3))))
    with pytest.raises(wrt.InputError, match="a set per key"):
        wrt.Deformation((0.0, 1.0), np.zeros((3, 9, 3)))


def test_normals_follow_a_deformation(report: Report) -> None:
    """A smooth ball that becomes an ellipsoid has its normals; a box keeps its edges."""
    ball = wrt.sphere(subdivisions=4)
    stretch = np.array([2.0, 1.0, 0.5])
    there = wrt.Deformation((0.0, 1.0), np.stack([ball.vertices, ball.vertices * stretch])).at(1.0, ball)
    exact = ball.vertices / stretch
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    assert there.normals is not None
    error = np.degrees(np.arccos(np.clip((there.normals * exact).sum(axis=1), -1, 1)))
    report("largest error of a normal, degrees", error.max())
    assert error.max() < 2.0
    half = wrt.Deformation((0.0, 1.0), np.stack([ball.vertices, ball.vertices * stretch])).at(0.5, ball)
    np.testing.assert_allclose(half.vertices, ball.vertices * (1.0 + stretch) / 2.0, rtol=1e-6)


def test_fingerprints_see_transforms() -> None:
    from wrt.rendering.fingerprint import scene_fingerprint

    def of(transform: object) -> str:
        scene = wrt.Scene()
        scene.add(wrt.box(), transform=transform)  # type: ignore[arg-type]
        return scene_fingerprint(scene)["geometry"]

    there, motion = affine(np.eye(3), (1.0, 0.0, 0.0)), wrt.Motion.translation((1.0, 0.0, 0.0))
    different = [None, np.eye(4), there, motion, wrt.Motion(motion.times, motion.transforms, (1.0, 0.0, 0.0))]
    assert len({of(transform) for transform in different}) == len(different)
    assert of(there) == of(there.copy())
    assert of(motion) == of(wrt.Motion.translation((1.0, 0.0, 0.0)))
