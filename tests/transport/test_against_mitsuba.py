"""Pictures have the same expectation as those of Mitsuba 3, an independent renderer.

The two are compared by `image_z_test`: every pixel, blocks of pixels, and the whole. What the scenes show is small and
lit from large lights, so that the noise of a few seconds decides over a per cent or two. Each mistake must be noticed.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import Report

import wrt
from wrt.upload.accel import instancing

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.covering_kernels import covering, render_with
from support.mitsuba_scene import Reference, render_reference
from support.statistics import ImageTest, sidak

pytestmark = pytest.mark.slow

KERNELS = [
    covering("conductor", "diffuse", "mirror"),
    covering("dielectric", "diffuse"),
    covering("diffuse", "mirror", "rough_conductor", "thin_dielectric", opacity=True),
]


@pytest.fixture(autouse=True)
def few_kernels_and_shared_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with(KERNELS, monkeypatch)
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)


CAMERA = wrt.PerspectiveCamera(origin=(1.2, 1.6, 3.4), target=(0.0, 0.45, 0.0), fov_degrees=36.0)


def stage() -> wrt.Scene:
    """A floor and a wall."""
    scene = wrt.Scene(camera=CAMERA)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse((0.6, 0.5, 0.4)), name="floor")
    scene.add(wrt.quad((-3, 0, -1.5), (6, 0, 0), (0, 4, 0)), material=wrt.Diffuse((0.3, 0.5, 0.7)), name="wall")
    return scene


def box(low: tuple[float, float, float], high: tuple[float, float, float], degrees: float = 25.0) -> wrt.Mesh:
    return wrt.box(low, high).rotated((0, 1, 0), degrees)


def ball(center: tuple[float, float, float], radius: float, subdivisions: int = 2) -> wrt.Mesh:
    """A ball of facets."""
    mesh = wrt.sphere(center, radius, subdivisions=subdivisions)
    return wrt.Mesh(mesh.vertices, mesh.faces, uvs=mesh.uvs, name=mesh.name)


def blocks(scene: wrt.Scene) -> wrt.Scene:
    scene.add(box((-0.7, 0.0, -0.3), (-0.2, 0.9, 0.2)), material=wrt.Diffuse((0.7, 0.2, 0.1)))
    scene.add(box((0.2, 0.0, 0.0), (0.8, 0.5, 0.6), -15.0), material=wrt.Diffuse(0.8))
    return scene


def lamp(scene: wrt.Scene, sky: Any = 0.0) -> wrt.Scene:
    """A ceiling light 1.6 m wide, its front down, under a sky of one colour."""
    scene.add(wrt.quad((-0.8, 2.5, -0.8), (1.6, 0, 0), (0, 0, 1.6)), emission=(5.0, 4.5, 4.0), name="lamp")
    scene.environment = wrt.ConstantEnvironment(sky)
    return scene


def noise(seed: int, shape: tuple[int, int] = (3, 4), *, flipped: bool = False, **options: Any) -> wrt.ImageTexture:
    pixels = np.random.default_rng(seed).random((*shape, 3)).astype(np.float32)
    return wrt.ImageTexture(pixels[:, ::-1] if flipped else pixels, **options)


def sky(degrees: float = 37.0) -> wrt.Scene:
    """Blocks, a mirror and a copper ball with interpolated normals under a sky, turned about a slanted axis, of random
    colours with a bright patch 60 degrees wide."""
    pixels = np.random.default_rng(12).random((8, 16, 3)).astype(np.float32)
    pixels[1:3, 5:8] = (12.0, 9.0, 6.0)
    turned = wrt.ImageEnvironment(pixels, scale=0.5, rotation_degrees=degrees, rotation_axis=(0.3, 1.0, -0.2))
    scene = wrt.Scene(camera=CAMERA, environment=turned)
    scene.add(wrt.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=wrt.Diffuse((0.6, 0.5, 0.4)))
    scene.add(box((0.6, 0.0, -0.8), (1.0, 1.0, -0.4)), material=wrt.Mirror((0.9, 0.85, 0.8)))
    scene.add(wrt.sphere((-0.4, 1.1, 0.4), 0.4, subdivisions=3), material=wrt.Conductor())
    return blocks(scene)


def lamps_without_extent(outer: float = 35.0, flipped: bool = False) -> wrt.Scene:
    """Points, spots and projectors, and a directional light, over blocks."""
    scene = blocks(stage())
    scene.add_light(wrt.PointLight((0.6, 2.0, 1.2), intensity=(2.0, 1.5, 1.0)))
    scene.add_light(wrt.PointLight((-1.5, 1.0, 1.0), power=(4.0, 8.0, 16.0)))
    scene.add_light(wrt.DirectionalLight((-1.0, -2.0, -1.5), irradiance=(1.0, 0.8, 0.6)))
    cone = {"inner_degrees": 12.0, "falloff": "linear"}
    scene.add_light(wrt.SpotLight((1.0, 2.5, 2.0), (-0.8, -2.2, -1.8), (9, 6, 3), outer_degrees=outer, **cone))
    slide = {"texture": noise(32, (3, 5), flipped=flipped), "up": (0.2, 1.0, 0.1)}
    scene.add_light(wrt.ProjectorLight((0.6, 1.9, 2.2), (-0.5, -1.2, -2.4), irradiance=(30, 40, 20), **slide))
    scene.add_light(wrt.ProjectorLight((-1.5, 1.0, 1.0), (1.2, -0.4, -0.9), irradiance=2.0, fov_degrees=50.0))
    power = {"power": (3, 6, 12), "outer_degrees": 30.0}
    scene.add_light(wrt.SpotLight((-1.2, 1.8, 0.8), (0.6, -1.2, -0.9), **power, **slide, **cone))
    return scene


def lamps_with_extent(scale: float = 1.0, flipped: bool = False) -> wrt.Scene:
    """A ball, a leaning disk and a rectangle, and a coarse picture that shines on the wall; all are seen."""
    scene = blocks(stage())
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.5), 0.3 * scale, radiance=(6.0, 4.0, 2.0)))
    scene.add_light(wrt.DiskLight((0.3, 1.5, -0.8), (0.2, -0.6, 1.0), 0.4, radiance=(2.0, 5.0, 4.0)))
    scene.add_light(wrt.RectangleLight((1.1, 0.2, -0.6), (-0.3, 0.0, 0.8), (0.0, 0.9, 0.0), radiance=(3.0, 3.0, 6.0)))
    screen = {"material": wrt.Diffuse(0.0), "emission": noise(31, flipped=flipped, factor=(5.0, 4.0, 3.0))}
    scene.add(wrt.quad((-0.9, 0.9, -1.2), (0.9, 0, 0), (0, 0.7, 0.2)), **screen)
    return scene


def glass(ior: float = 1.5, inside: float = 1.8, outside: float = 1.2) -> wrt.Scene:
    """A ball of facets, and a block with a glowing one inside: light leaves a dense medium on its way to the camera."""
    scene = lamp(stage(), sky=(0.5, 0.6, 0.7))
    scene.add(ball((0.6, 0.45, 0.6), 0.45), material=wrt.Dielectric(ior))
    scene.add(box((-0.9, 0.1, -0.6), (0.1, 1.1, 0.4)), material=wrt.Dielectric(inside, outside))
    scene.add(box((-0.6, 0.4, -0.3), (-0.2, 0.8, 0.1), 60.0), material=wrt.Diffuse(0.5), emission=(1.0, 2.0, 3.0))
    return scene


def composites(opacity: float = 0.4, weight: float = 0.7, swapped: bool = False, tint: float = 0.2) -> wrt.Scene:
    """Panes with holes, mixtures, sheets with two sides, textures, vertex colours, and a coloured pane.

    Mitsuba counts a pane as a segment of the path, wrt does not: paths must be long in both. What is mixed is rough:
    what Mitsuba makes of a mixture with a mirror is not its mean.
    """
    scene = lamp(stage(), sky=(0.2, 0.3, 0.4))
    wall = wrt.quad((-1.6, 0.0, -1.2), (1.5, 0, 0), (0, 1.5, 0))
    tiles = wrt.Mesh(wall.vertices, wall.faces, uvs=wall.uvs * np.float32([1.7, 1.3]) - np.float32(0.4))
    scene.add(tiles, material=wrt.Diffuse(noise(3, (3, 5))))
    corners = np.float32([[-0.8, 0.0, 0.7], [-0.2, 0.0, 0.9], [-0.6, 0.6, 0.5]])
    colors = np.float32([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.1, 0.1, 0.9]])
    scene.add(wrt.Mesh(corners, np.array([[0, 1, 2]]), colors=colors), material=wrt.Diffuse(wrt.VertexColor()))
    # Of the textures of numbers the green channel counts; the others mislead.
    holes = wrt.Diffuse((0.8, 0.6, 0.2), opacity=noise(21, (4, 5), channel="g"))
    scene.add(wrt.quad((-0.1, 0.1, 0.9), (0.5, 0, 0.2), (0, 0.7, 0)), material=holes)
    scene.add(wrt.quad((-1.5, 1.6, -1.0), (2.0, 0, 0), (0, 0, 2.5)), material=wrt.Diffuse(0.5, opacity=opacity))
    scene.add(ball((1.0, 0.3, 1.2), 0.25, 1), material=wrt.Mirror((0.9, 0.7, 0.5), opacity=0.6))
    metal = wrt.RoughConductor(0.4, masking="smith-separable")
    speckled = wrt.Mix(wrt.Diffuse((0.7, 0.2, 0.1)), metal, weight=noise(22, (4, 5), channel="g"))
    scene.add(wrt.quad((-0.3, 0, -0.6), (0.6, 0, 0.3), (0, 1.1, 0)), material=speckled)
    inner = wrt.Mix(wrt.Diffuse((0.1, 0.3, 0.8)), wrt.Diffuse(0.7, opacity=0.5), weight=0.6)
    scene.add(ball((0.5, 0.45, 0.3), 0.45), material=wrt.Mix(metal, inner, weight=weight))
    sides = (wrt.Diffuse((0.2, 0.6, 0.2)), wrt.Mirror((0.9, 0.85, 0.8)))
    sheet = wrt.TwoSided(*(sides[::-1] if swapped else sides))
    scene.add(wrt.quad((1.3, 0.0, 0.1), (-0.4, 0, -0.8), (0, 1.0, 0)), material=sheet)
    scene.add(wrt.quad((-1.4, 0.0, 0.2), (0.5, 0, -0.3), (0, 0.8, 0.1)), material=sheet)
    pane = wrt.ThinDielectric(1.5, specular_transmittance=(tint, 0.8, 0.3))
    scene.add(wrt.quad((0.2, 0.9, 0.9), (0.8, 0, 0.2), (0, 0.5, 0)), material=pane)
    return scene


def panes(camera: Any) -> wrt.Scene:
    """Glowing panes before, in and behind the plane in focus: all noise is that of the film and of the lens."""
    scene = wrt.Scene(camera=camera)
    for i, z in enumerate((2.2, 1.6, 1.0, 0.0, -2.0, -5.0)):
        # Beside one another in the picture: two rows of three, each pane a third of its place.
        reach = (4.0 - z) * 0.3
        x, y = (i % 3 - 1) * 0.9 * reach, (0.5 - i // 3) * reach
        pane = wrt.quad((x - 0.2 * reach, y - 0.2 * reach, z), (0.4 * reach, 0, 0), (0, 0.4 * reach, 0))
        scene.add(pane, material=wrt.Diffuse(0.0), emission=(1.0 + i, 2.0, 6.0 - i))
    return scene


VIEW = {"origin": (0.0, 0.0, 4.0), "target": (0.0, 0.1, 0.0)}


def thin_lens(radius: float = 0.3, focus: float = 3.0) -> wrt.Scene:
    return panes(wrt.PerspectiveCamera(**VIEW, fov_degrees=36.0, aperture_radius=radius, focus_distance=focus))


def orthographic(height: float = 3.0) -> wrt.Scene:
    return panes(wrt.OrthographicCamera(**VIEW, view_height=height))


def lens_shift(shift: float = -0.2, fov: float = 36.0) -> wrt.Scene:
    return panes(wrt.PerspectiveCamera(**VIEW, fov_degrees=fov, shift_x=0.3, shift_y=shift))


def cornell_box() -> wrt.Scene:
    return wrt.load("cornell-box")


def instances() -> wrt.Scene:
    """Boxes of which each stands in several places, turned, stretched, mirrored, and lamps that are instances too."""
    scene = stage()
    rng = np.random.default_rng(3)
    red, clear, mirror = wrt.Diffuse((0.7, 0.2, 0.1)), wrt.Dielectric(), wrt.Mirror(0.9)
    block = wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    block = wrt.Mesh(block.vertices, block.faces, uvs=block.uvs, name=block.name)
    for i, material in enumerate((red, red, red, clear, clear, mirror, mirror)):
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


CHROMATIC = wrt.Medium(absorption=(0.3, 0.8, 2.0), scattering=(4.0, 2.0, 1.0))


def denser(medium: wrt.Medium, factor: float, **changes: Any) -> wrt.Medium:
    absorption, scattering = (tuple(factor * x for x in c) for c in (medium.absorption, medium.scattering))
    return dataclasses.replace(medium, absorption=absorption, scattering=scattering, **changes)


def media_in_glass(factor: float = 1.0) -> wrt.Scene:
    """A smooth block of coloured glass, one of milk, and a rough one of something forward."""
    scene = lamp(stage(), sky=(0.5, 0.6, 0.7))
    coloured = denser(wrt.Medium((0.5, 1.5, 4.0), 0.0), factor)
    scene.add(box((-0.8, 0.01, -0.3), (-0.3, 0.9, 0.3)), material=wrt.Dielectric(1.5, interior=coloured))
    scene.add(
        box((-0.2, 0.01, 0.3), (0.2, 0.5, 0.7)), material=wrt.Dielectric(1.33, interior=denser(CHROMATIC, factor))
    )
    forward = denser(CHROMATIC, factor, g=0.7)
    rough = wrt.RoughDielectric(1.4, alpha=0.3, masking="smith-separable", interior=forward)
    scene.add(box((0.3, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=rough)
    return scene


def clouds(factor: float = 1.0) -> wrt.Scene:
    """Bodies without a surface under a lamp, one even, two of varying density, of which one has an albedo that varies
    too and is turned."""
    rng = np.random.default_rng(8)
    scene = lamp(stage())
    density = rng.random((6, 5, 7)).astype(np.float32) ** 2
    tall = wrt.DensityGrid(density, (-0.8, 0.05, -0.3), (-0.2, 0.95, 0.4), factor=3.0)
    scene.add(tall.boundary, material=wrt.Null(interior=denser(CHROMATIC, factor, g=0.6, density=tall)))
    place = np.eye(4)
    place[:3] = [[0.7, 0.2, 0.1, 0.2], [-0.1, 0.7, 0.0, 0.15], [-0.2, 0.1, 0.6, 0.1]]
    low = wrt.DensityGrid(density[::-1], transform=place, factor=4.0, albedo=rng.random((3, 4, 2, 3)))
    scene.add(low.boundary, material=wrt.Null(interior=denser(CHROMATIC, factor, g=-0.3, density=low)))
    even = denser(CHROMATIC, factor, g=-0.3)
    scene.add(ball((-0.1, 0.3, 1.0), 0.25, 1), material=wrt.Null(interior=even))
    return scene


def fog(factor: float = 1.0) -> wrt.Scene:
    """Fog everywhere, but in a block of glass."""
    scene = lamp(stage())
    scene.medium = denser(wrt.Medium((0.02, 0.05, 0.1), (0.2, 0.15, 0.1), 0.3), factor)
    scene.add(box((-0.8, 0.01, -0.3), (-0.1, 0.9, 0.3)), material=wrt.Diffuse((0.7, 0.2, 0.1)))
    scene.add(box((0.2, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=wrt.Dielectric(1.5))
    return scene


class Case(NamedTuple):
    """What is rendered, how much of it, and mistakes that would be seen: arguments of `build`."""

    build: Callable[..., wrt.Scene]
    mistakes: tuple[dict[str, Any], ...] = ()
    max_depth: int = 4
    spp: int = 256
    reference_spp: int = 512
    size: tuple[int, int] = (64, 48)
    leak_is_seen: bool = False


SMALL = (32, 24)
CASES = {
    "sky": Case(sky, ({"degrees": 38.0},), 6, 1024, 1024, leak_is_seen=True),
    "lamps without extent": Case(lamps_without_extent, ({"outer": 36.0}, {"flipped": True}), spp=512),
    "lamps with extent": Case(lamps_with_extent, ({"scale": 1.03}, {"flipped": True}), 4, 512, 1024),
    "glass": Case(glass, ({"ior": 1.53}, {"inside": 1.2, "outside": 1.8}), 10, 512, 1024, leak_is_seen=True),
    "composites": Case(
        composites,
        ({"opacity": 0.42}, {"weight": 0.8}, {"swapped": True}, {"tint": 0.15}),
        *(64, 1024, 1024),
        leak_is_seen=True,
    ),
    "thin lens": Case(thin_lens, ({"radius": 0.309}, {"focus": 3.06}), 1, 4096, 4096, (48, 36)),
    "orthographic": Case(orthographic, ({"height": 3.03},), 1, 1024, 1024, (48, 36)),
    "lens shift": Case(lens_shift, ({"shift": -0.18}, {"fov": 36.36}), 1, 1024, 1024, (48, 36)),
    "cornell box, direct": Case(cornell_box, (), 2, size=(64, 64), leak_is_seen=True),
    "cornell box": Case(cornell_box, (), 64, 2048, 2048, (64, 64)),
    "instances": Case(instances, (), 10, leak_is_seen=True),
    "media in glass": Case(media_in_glass, ({"factor": 1.1},), 200, size=SMALL),
    "clouds": Case(clouds, ({"factor": 1.1},), 200, size=SMALL),
    "fog": Case(fog, ({"factor": 1.1},), 200, size=SMALL),
}
SIGNIFICANCE = sidak(0.01, len(CASES))


@functools.cache
def reference(name: str) -> Reference:
    case = CASES[name]
    options = {"max_depth": case.max_depth, "spp": case.reference_spp, "seed": 1}
    return render_reference(case.build(), width=case.size[0], height=case.size[1], **options)


def compare(scene: wrt.Scene, name: str, device: str) -> ImageTest:
    case = CASES[name]
    options = {"sampler": "independent", "device": device, "seed": 1, "max_depth": case.max_depth, "filter": "box"}
    renderer = wrt.Renderer(scene, width=case.size[0], height=case.size[1], **options)
    return reference(name).compared(renderer, case.spp)


@pytest.mark.parametrize("name", CASES)
def test_picture_agrees(name: str, device: str, report: Report) -> None:
    result = compare(CASES[name].build(), name, device)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("smallest p of 4x4 blocks; their spread", result.block_p, p=result.spread_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=SIGNIFICANCE), result.message


def with_a_leak(scene: wrt.Scene) -> wrt.Scene:
    """Return the scene as seen by a renderer whose diffuse reflection loses one per cent of the light."""
    shapes = []
    for shape in scene.shapes:
        material = shape.material
        if isinstance(material, wrt.Diffuse) and isinstance(material.reflectance, tuple):
            less = tuple(0.99 * x for x in material.reflectance)
            shape = dataclasses.replace(shape, material=dataclasses.replace(material, reflectance=less))
        shapes.append(shape)
    return dataclasses.replace(scene, shapes=shapes)


@pytest.mark.machinery
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.mistakes or case.leak_is_seen])
def test_mistakes_would_be_seen(name: str, report: Report) -> None:
    """Lights seen directly stay as they are: they have no noise, and would give any change away."""
    case = CASES[name]
    scenes = {str(change): case.build(**change) for change in case.mistakes}
    if case.leak_is_seen:
        scenes["a leak"] = with_a_leak(case.build())
    for mistake, scene in scenes.items():
        result = compare(scene, name, "cpu")
        smallest = min(result.mean_p, result.spread_p, result.block_p)
        report(f"{mistake}: p", smallest, f"< {sidak(SIGNIFICANCE, 3):.2g}")
        assert not result.agrees(significance=SIGNIFICANCE), mistake
