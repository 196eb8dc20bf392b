"""Pictures have the same expectation as those of Mitsuba 3, an independent renderer.

The two are compared by `image_z_test`: every pixel, blocks of pixels, and the whole. What the scenes
show is small and lit from large lights, so that the noise of a few seconds decides over a per cent or two.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from conftest import Report

import wrt
from wrt.upload.accel import instancing

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import Reference, render_reference
from support.statistics import ImageTest, sidak

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def small_meshes_are_shared_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)


CAMERA = wrt.PerspectiveCamera(origin=(1.2, 1.6, 3.4), target=(0.0, 0.45, 0.0), fov_degrees=36.0)


def stage(camera: wrt.PerspectiveCamera = CAMERA) -> wrt.Scene:
    """A floor and a wall."""
    scene = wrt.Scene(camera=camera)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse((0.6, 0.5, 0.4)), name="floor")
    scene.add(wrt.quad((-3, 0, -1.5), (6, 0, 0), (0, 4, 0)), material=wrt.Diffuse((0.3, 0.5, 0.7)), name="wall")
    return scene


def box(low: tuple[float, float, float], high: tuple[float, float, float], degrees: float = 25.0) -> wrt.Mesh:
    return wrt.box(low, high).rotated((0, 1, 0), degrees)


def flat(mesh: wrt.Mesh) -> wrt.Mesh:
    return wrt.Mesh(mesh.vertices, mesh.faces, uvs=mesh.uvs, name=mesh.name)


def blocks(scene: wrt.Scene) -> wrt.Scene:
    scene.add(box((-0.7, 0.0, -0.3), (-0.2, 0.9, 0.2)), material=wrt.Diffuse((0.7, 0.2, 0.1)))
    scene.add(box((0.2, 0.0, 0.0), (0.8, 0.5, 0.6), -15.0), material=wrt.Diffuse(0.8))
    return scene


def sky(rotation_degrees: float = 37.0) -> wrt.ImageEnvironment:
    """A small sky of random colours with a bright patch 60 degrees wide."""
    pixels = np.random.default_rng(12).random((8, 16, 3)).astype(np.float32)
    pixels[1:3, 5:8] = (12.0, 9.0, 6.0)
    return wrt.ImageEnvironment(pixels, scale=0.5, rotation_degrees=rotation_degrees)


def lamp(scene: wrt.Scene) -> wrt.Scene:
    """A ceiling light 1.6 m wide, its front down."""
    scene.add(wrt.quad((-0.8, 2.5, -0.8), (1.6, 0, 0), (0, 0, 1.6)), emission=(5.0, 4.5, 4.0), name="lamp")
    return scene


def point_light() -> wrt.Scene:
    scene = blocks(stage())
    scene.add_light(wrt.PointLight((0.6, 2.0, 1.2), intensity=(5.0, 4.0, 3.0)))
    scene.add_light(wrt.PointLight((-1.5, 1.0, 1.0), power=(4.0, 8.0, 16.0)))
    return scene


def directional_light() -> wrt.Scene:
    scene = blocks(stage())
    scene.add_light(wrt.DirectionalLight((-1.0, -2.0, -1.5), irradiance=(3.0, 2.5, 2.0)))
    return scene


def constant_environment() -> wrt.Scene:
    scene = blocks(stage())
    scene.environment = wrt.ConstantEnvironment((0.5, 0.7, 1.0))
    return scene


def image_environment() -> wrt.Scene:
    scene = wrt.Scene(camera=CAMERA, environment=sky())
    scene.add(wrt.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=wrt.Diffuse((0.6, 0.5, 0.4)))
    return blocks(scene)


def reflectors() -> wrt.Scene:
    """A mirror block and a faceted copper ball under a lamp and a sky."""
    scene = lamp(stage())
    scene.environment = sky(-80.0)
    scene.add(box((-0.8, 0.0, -0.4), (-0.2, 1.0, 0.2)), material=wrt.Mirror((0.9, 0.85, 0.8)))
    scene.add(flat(wrt.sphere((0.4, 0.4, 0.4), 0.4, subdivisions=2)), material=wrt.Conductor())
    return scene


def smooth_reflector() -> wrt.Scene:
    """A copper ball with interpolated normals, seen before a sky."""
    scene = wrt.Scene(camera=CAMERA, environment=sky())
    scene.add(wrt.sphere((0.0, 0.45, 0.0), 0.7, subdivisions=3), material=wrt.Conductor())
    return scene


def faceted_glass() -> wrt.Scene:
    scene = lamp(stage())
    scene.environment = wrt.ConstantEnvironment((0.5, 0.6, 0.7))
    scene.add(flat(wrt.sphere((0.0, 0.6, 0.3), 0.55, subdivisions=2)), material=wrt.Dielectric(1.5))
    return scene


def glass_block() -> wrt.Scene:
    """A glowing block inside a glass block: light leaves a dense medium on its way to the camera."""
    scene = stage()
    scene.environment = wrt.ConstantEnvironment(0.3)
    scene.add(box((-0.6, 0.1, -0.6), (0.6, 1.1, 0.6)), material=wrt.Dielectric(1.8, 1.2))
    scene.add(box((-0.2, 0.4, -0.2), (0.2, 0.8, 0.2), 60.0), material=wrt.Diffuse(0.5), emission=(1.0, 2.0, 3.0))
    return scene


def thin_lens() -> wrt.Scene:
    """Glowing panes before, in and behind the plane in focus: all noise is that of the lens."""
    camera = wrt.PerspectiveCamera(
        origin=(0.0, 0.0, 4.0), target=(0.0, 0.1, 0.0), fov_degrees=36.0, aperture_radius=0.3, focus_distance=3.0
    )
    scene = wrt.Scene(camera=camera)
    for i, z in enumerate((2.2, 1.6, 1.0, 0.0, -2.0, -5.0)):
        # Beside one another in the picture: two rows of three, each pane a third of its place.
        reach = (4.0 - z) * 0.3
        x, y = (i % 3 - 1) * 0.9 * reach, (0.5 - i // 3) * reach
        pane = wrt.quad((x - 0.2 * reach, y - 0.2 * reach, z), (0.4 * reach, 0, 0), (0, 0.4 * reach, 0))
        scene.add(pane, material=wrt.Diffuse(0.0), emission=(1.0 + i, 2.0, 6.0 - i))
    return scene


def orthographic() -> wrt.Scene:
    scene = lamp(blocks(stage()))
    scene.camera = wrt.OrthographicCamera((1.2, 1.6, 3.4), (0.0, 0.45, 0.0), view_height=2.2)
    return scene


def lens_shift() -> wrt.Scene:
    scene = lamp(blocks(stage()))
    scene.camera = wrt.PerspectiveCamera((0.4, 0.5, 3.4), (0.2, 0.5, 0.0), fov_degrees=30.0, shift_x=0.3, shift_y=-0.2)
    return scene


def textures() -> wrt.Scene:
    """A picture repeated over a wall, and a triangle with coloured corners."""
    scene = wrt.Scene(camera=CAMERA, environment=wrt.ConstantEnvironment(1.0))
    image = wrt.ImageTexture(np.random.default_rng(3).random((3, 5, 3)).astype(np.float32))
    wall = wrt.quad((-2, -0.5, -1), (4, 0, 0), (0, 2, 0))
    scene.add(
        wrt.Mesh(wall.vertices, wall.faces, uvs=wall.uvs * np.float32([1.7, 1.3]) - np.float32(0.4)),
        material=wrt.Diffuse(image),
    )
    corners = np.float32([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.3], [0.1, 1.1, 0.0]])
    scene.add(
        wrt.Mesh(
            corners, np.array([[0, 1, 2]]), colors=np.float32([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.1, 0.1, 0.9]])
        ),
        material=wrt.Diffuse(wrt.VertexColor()),
    )
    return scene


def spots(seed: int, low: float = 0.0) -> wrt.ImageTexture:
    """Numbers from `low` to 1 in the green channel of a small image; the others mislead."""
    pixels = np.random.default_rng(seed).uniform(low, 1.0, (4, 5, 3)).astype(np.float32)
    return wrt.ImageTexture(pixels, channel="g")


def see_through() -> wrt.Scene:
    """Panes before the camera, between the blocks and under the lamp, one with holes by a texture.

    Mitsuba counts a pane as a segment of the path, wrt does not: paths must be long in both.
    """
    scene = lamp(blocks(stage()))
    scene.environment = wrt.ConstantEnvironment((0.2, 0.3, 0.4))
    holes = wrt.Diffuse((0.8, 0.6, 0.2), opacity=spots(21))
    scene.add(wrt.quad((-1.0, 0.1, 0.9), (1.2, 0, 0.2), (0, 0.9, 0)), material=holes)
    scene.add(wrt.quad((-1.5, 1.6, -1.0), (2.0, 0, 0), (0, 0, 2.5)), material=wrt.Diffuse(0.5, opacity=0.4))
    ball = flat(wrt.sphere((0.9, 0.5, 1.1), 0.35, subdivisions=1))
    scene.add(ball, material=wrt.Mirror((0.9, 0.7, 0.5), opacity=0.6))
    return scene


def mixtures() -> wrt.Scene:
    """A sheet part paint, part metal by a texture, and a faceted ball of three materials, one of them not all there.

    All of them are rough: what Mitsuba makes of a mixture with a mirror is not its mean.
    """
    scene = lamp(stage())
    scene.environment = wrt.ConstantEnvironment((0.2, 0.3, 0.4))
    metal = wrt.RoughConductor(0.4, masking="smith-separable")
    speckled = wrt.Mix(wrt.Diffuse((0.7, 0.2, 0.1)), metal, weight=spots(22))
    scene.add(wrt.quad((-0.9, 0, 0.3), (0.8, 0, 0.3), (0, 1.1, 0)), material=speckled)
    inner = wrt.Mix(wrt.Diffuse((0.1, 0.3, 0.8)), wrt.Diffuse(0.7, opacity=0.5), weight=0.6)
    ball = flat(wrt.sphere((0.5, 0.45, 0.4), 0.45, subdivisions=2))
    scene.add(ball, material=wrt.Mix(metal, inner, weight=0.7))
    return scene


def two_sided() -> wrt.Scene:
    """Standing and leaning sheets, seen from both sides, directly and in a mirror that is matt behind."""
    scene = lamp(stage())
    scene.environment = wrt.ConstantEnvironment((0.5, 0.6, 0.7))
    matt = wrt.TwoSided(wrt.Diffuse((0.8, 0.2, 0.1)), wrt.Diffuse((0.1, 0.3, 0.8)))
    mirror = wrt.TwoSided(wrt.Diffuse((0.2, 0.6, 0.2)), wrt.Mirror((0.9, 0.85, 0.8)))
    for x, turned in ((-0.9, False), (0.1, True)):
        low, along = ((x, 0.0, 0.2), (0.6, 0, 0.3))
        if turned:
            low, along = (x + 0.6, 0.0, 0.5), (-0.6, 0, -0.3)
        scene.add(wrt.quad(low, along, (0, 0.8, 0.1)), material=matt)
    scene.add(wrt.quad((1.0, 0.0, -0.3), (-0.4, 0, -0.8), (0, 1.0, 0)), material=mirror)
    scene.add(wrt.quad((0.2, 0.0, 1.2), (0.5, 0, 0.1), (0, 0.3, -0.1)), material=mirror)
    return scene


class Case(NamedTuple):
    """What is rendered, and how much of it."""

    build: Callable[[], wrt.Scene]
    max_depth: int
    spp: int = 256
    reference_spp: int = 512
    size: tuple[int, int] = (64, 48)


def cornell_box() -> wrt.Scene:
    return wrt.load("cornell-box")


def instances() -> wrt.Scene:
    """Boxes of which each stands in several places, turned, stretched, mirrored, and lamps that are instances too."""
    scene = stage()
    rng = np.random.default_rng(3)
    red, glass = wrt.Diffuse((0.7, 0.2, 0.1)), wrt.Dielectric()
    block, mirror = flat(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))), wrt.Mirror(0.9)
    for i, material in enumerate((red, red, red, glass, glass, mirror, mirror)):
        place = np.eye(4)
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        place[:3, :3] = q @ np.diag(rng.uniform(0.25, 0.6, 3))
        place[:3, 3] = -1.2 + 0.4 * i, rng.uniform(0.3, 1.0), rng.uniform(-0.8, 1.0)
        scene.add(block, material=material, transform=place)
    for x in (-1.0, 1.0):
        place = np.diag([0.8, 1.0, 0.8 * x, 1.0])
        place[:3, 3] = x, 2.5, 0.5
        # The mesh shines down; mirrored, its front is the same side.
        scene.add(wrt.quad((-0.5, 0, -0.5), (1, 0, 0), (0, 0, 1)), emission=(6.0, 5.0, 4.0), transform=place)
    return scene


CASES = {
    "instances": Case(instances, 10),
    "cornell-box-emission": Case(cornell_box, 1, 64, 256, (64, 64)),
    "cornell-box-direct": Case(cornell_box, 2, size=(64, 64)),
    "cornell-box-global": Case(cornell_box, 8, size=(64, 64)),
    "point-light": Case(point_light, 4),
    "directional-light": Case(directional_light, 4),
    "constant-environment": Case(constant_environment, 4),
    "image-environment": Case(image_environment, 4, 1024, 1024),
    "reflectors": Case(reflectors, 6),
    "smooth-reflector": Case(smooth_reflector, 6),
    "faceted-glass": Case(faceted_glass, 10),
    "glass-block": Case(glass_block, 10),
    "thin-lens": Case(thin_lens, 1, 4096, 4096, (48, 36)),
    "orthographic": Case(orthographic, 3),
    "lens-shift": Case(lens_shift, 3),
    "textures": Case(textures, 3),
    "see-through": Case(see_through, 64, 512, 1024),
    "mixtures": Case(mixtures, 64, 512, 1024),
    "two-sided": Case(two_sided, 8),
}
SIGNIFICANCE = sidak(0.01, len(CASES))
LEAK = 0.01
WITHOUT_DIFFUSE_REFLECTION = {"cornell-box-emission", "smooth-reflector", "thin-lens"}


@functools.cache
def reference(name: str) -> Reference:
    case = CASES[name]
    width, height = case.size
    return render_reference(
        case.build(), width=width, height=height, max_depth=case.max_depth, spp=case.reference_spp, seed=1
    )


def compare(scene: wrt.Scene, case: Case, expected: Reference, device: str, spp: int) -> ImageTest:
    width, height = case.size
    renderer = wrt.Renderer(
        scene,
        sampler="independent",
        width=width,
        height=height,
        device=device,
        seed=1,
        max_depth=case.max_depth,
        filter="box",
    )
    return expected.compared(renderer, spp)


@pytest.mark.parametrize("name", CASES)
def test_picture_agrees(name: str, device: str, report: Report) -> None:
    case = CASES[name]
    result = compare(case.build(), case, reference(name), device, case.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("smallest p of 4x4 blocks; their spread", result.block_p, p=result.spread_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=SIGNIFICANCE), result.message


def with_a_leak(scene: wrt.Scene, share: float) -> wrt.Scene:
    """Return the scene as seen by a renderer whose diffuse reflection loses a share of the light."""
    shapes = []
    for shape in scene.shapes:
        material = shape.material
        if isinstance(material, wrt.Diffuse) and not isinstance(material.reflectance, wrt.VertexColor):
            reflectance = material.reflectance
            if isinstance(reflectance, wrt.ImageTexture):
                less = dataclasses.replace(reflectance, pixels=np.float32(1.0 - share) * reflectance.pixels)
            else:
                less = tuple((1.0 - share) * x for x in np.broadcast_to(reflectance, 3))
            material = dataclasses.replace(material, reflectance=less)
        shapes.append(dataclasses.replace(shape, material=material))
    return dataclasses.replace(scene, shapes=shapes)


@pytest.mark.parametrize("name", [name for name in CASES if name not in WITHOUT_DIFFUSE_REFLECTION])
def test_a_reflection_that_loses_light_would_be_seen(name: str, report: Report) -> None:
    """Lights seen directly stay as they are: they have no noise, and would give any change away."""
    case = CASES[name]
    result = compare(with_a_leak(case.build(), LEAK), case, reference(name), "cpu", case.spp)
    smallest = min(result.mean_p, result.spread_p, result.block_p)
    report(
        f"{100.0 * LEAK:g} % lost: mean against Mitsuba, per cent",
        f"{100.0 * result.relative_difference[1]:+.3f}",
        p=smallest,
    )
    assert not result.agrees(significance=SIGNIFICANCE), result.message


def with_camera(scene: wrt.Scene, **changes: float) -> wrt.Scene:
    assert scene.camera is not None
    return dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, **changes))


def with_material(scene: wrt.Scene, old: type[wrt.Material], new: wrt.Material) -> wrt.Scene:
    shapes = [dataclasses.replace(s, material=new) if isinstance(s.material, old) else s for s in scene.shapes]
    return dataclasses.replace(scene, shapes=shapes)


def with_opacity(scene: wrt.Scene, old: float, new: float) -> wrt.Scene:
    shapes = [
        dataclasses.replace(s, material=dataclasses.replace(s.material, opacity=new))
        if s.material.opacity == old
        else s
        for s in scene.shapes
    ]
    return dataclasses.replace(scene, shapes=shapes)


def with_weight(scene: wrt.Scene, old: float, new: float) -> wrt.Scene:
    shapes = [
        dataclasses.replace(s, material=dataclasses.replace(s.material, weight=new))
        if isinstance(s.material, wrt.Mix) and s.material.weight == old
        else s
        for s in scene.shapes
    ]
    return dataclasses.replace(scene, shapes=shapes)


def swapped(scene: wrt.Scene) -> wrt.Scene:
    shapes = [
        dataclasses.replace(s, material=wrt.TwoSided(s.material.back, s.material.front))
        if isinstance(s.material, wrt.TwoSided)
        else s
        for s in scene.shapes
    ]
    return dataclasses.replace(scene, shapes=shapes)


MISTAKES: dict[str, tuple[str, Callable[[wrt.Scene], wrt.Scene]]] = {
    "field of view 1 % wide": ("point-light", lambda s: with_camera(s, fov_degrees=1.01 * s.camera.fov_degrees)),
    "aperture 3 % wide": ("thin-lens", lambda s: with_camera(s, aperture_radius=1.03 * s.camera.aperture_radius)),
    "focus 2 % far": ("thin-lens", lambda s: with_camera(s, focus_distance=1.02 * s.camera.focus_distance)),
    "orthographic view 1 % high": ("orthographic", lambda s: with_camera(s, view_height=2.222)),
    "lens shifted 0.02 less": ("lens-shift", lambda s: with_camera(s, shift_y=-0.18)),
    "sky turned by 1 degree": (
        "image-environment",
        lambda s: dataclasses.replace(s, environment=dataclasses.replace(s.environment, rotation_degrees=38.0)),
    ),
    "ior 1.53 for 1.5": ("faceted-glass", lambda s: with_material(s, wrt.Dielectric, wrt.Dielectric(1.53))),
    "ratio of indices inverted": ("glass-block", lambda s: with_material(s, wrt.Dielectric, wrt.Dielectric(1.2, 1.8))),
    "extinction 2 % high": (
        "smooth-reflector",
        lambda s: with_material(s, wrt.Conductor, wrt.Conductor(k=(3.990, 2.501, 2.185))),
    ),
    "opacity 0.02 high": ("see-through", lambda s: with_opacity(s, 0.4, 0.42)),
    "weight 0.05 high": ("mixtures", lambda s: with_weight(s, 0.7, 0.75)),
    "sides swapped": ("two-sided", swapped),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_would_be_seen(mistake: str, report: Report) -> None:
    name, change = MISTAKES[mistake]
    case = CASES[name]
    result = compare(change(case.build()), case, reference(name), "cpu", case.spp)
    report("p", min(result.mean_p, result.spread_p, result.block_p), f"< {sidak(SIGNIFICANCE, 3):.2g}")
    assert not result.agrees(significance=SIGNIFICANCE), result.message


@pytest.mark.slow
@pytest.mark.parametrize("max_depth", [2, 64])
def test_cornell_box_agrees_with_eight_times_the_samples(max_depth: int, device: str, report: Report) -> None:
    case = Case(cornell_box, max_depth, 2048, 2048, (64, 64))
    expected = render_reference(cornell_box(), width=64, height=64, max_depth=max_depth, spp=2048, runs=64, seed=2)
    result = compare(cornell_box(), case, expected, device, case.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    assert result.agrees(), result.message
