"""Caustics by photons: the light of a slab follows from Fresnel's equations, and pictures are those of long paths.

Photons of a set serve all pixels, so errors of pixels are not independent: tests compare means of renders with several
seeds.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.fresnel import by_angles
from support.small_scenes import finish, image_of
from support.statistics import sidak, two_sample_z
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.cli import main
from wrt.errors import Hint
from wrt.kernels.bsdf import caster_name, smooth_lobes
from wrt.kernels.integrators.path_surface import reflect_a_quarter
from wrt.rendering.part import Part
from wrt.upload.casters import share_of_photons
from wrt.upload.materials import MaterialTable

Array = NDArray[np.floating[Any]]

SIZE = 16
SEEDS = 8

SPP = 10
"""More samples than gather the same photons, where bits are compared."""

BIAS = 0.003
"""A bound on the bias of a picture's mean in the scenes below, relative to it: photons blur over its edges."""


def floor(material: wrt.Material | None = None, half: float = 4.0) -> wrt.Shape:
    mesh = wrt.quad((-half, 0.0, half), (2.0 * half, 0.0, 0.0), (0.0, 0.0, -2.0 * half))
    return wrt.Shape(mesh, material or wrt.Diffuse(0.5))


def lamp() -> wrt.Shape:
    return wrt.Shape(wrt.quad((0.2, 3.0, -0.8), (1.6, 0.0, 0.0), (0.0, 0.0, 1.6)), wrt.Diffuse(0.0), emission=2.5)


def scene_of(*parts: wrt.Shape | wrt.Light, environment: Any = None) -> wrt.Scene:
    camera = wrt.PerspectiveCamera((0.0, 3.0, 4.0), (0.0, 0.3, 0.0), fov_degrees=40.0)
    scene = wrt.Scene(environment=environment, camera=camera)
    for part in parts:
        if isinstance(part, wrt.Shape):
            scene.shapes.append(part)
        else:
            scene.lights.append(part)
    return scene


def block(material: wrt.Material, bottom: float = 0.4) -> wrt.Shape:
    return wrt.Shape(wrt.box((-0.5, bottom, -0.5), (0.5, bottom + 1.0, 0.5)), material)


def ball(material: wrt.Material | None = None, *, exact: bool = False) -> wrt.Shape:
    return wrt.Shape(wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=2, exact=exact), material or wrt.Dielectric())


def means(make: Callable[[], wrt.Scene], spp: int, seeds: int = SEEDS, **options: Any) -> Array:
    """Return the mean radiance of renders with as many seeds."""
    options = {"width": SIZE, "height": SIZE, "sampler": "independent", "max_depth": 10, **options}
    return np.array([image_of(wrt.Renderer(make(), seed=seed, **options), spp).mean() for seed in range(seeds)])


def deviation(a: Array, b: Array | float, bias: float = 0.0) -> float:
    """Return how far the means of renders are apart beyond a relative bias, in standard errors."""
    other = np.atleast_1d(b)
    spread = other.var(ddof=1) / len(other) if len(other) > 1 else 0.0
    difference = max(abs(a.mean() - other.mean()) - bias * other.mean(), 0.0)
    count = float(len(other)) if len(other) > 1 else np.inf
    return float(two_sample_z(difference, a.var(ddof=1) / len(a), 0.0, spread, n_a=len(a), n_b=count))


# --- The light is right ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("what", "degrees"),
    [*(pytest.param("slab", angle, marks=pytest.mark.slow) for angle in (0.0, 60.0)), ("water", 60.0)],
)
def test_light_comes_through_as_fresnel_says(what: str, degrees: float, report: Report) -> None:
    """Below a slab, with inner reflections, (1 − R) / (1 + R) of the light arrive, below a single surface 1 − R.

    The path tracer finds none of it.
    """
    angle = np.radians(degrees)
    sun = wrt.DirectionalLight((np.sin(angle), -np.cos(angle), 0.0), 1.0)

    def make() -> wrt.Scene:
        # A dark floor: of its light the slab would reflect some back.
        mesh = wrt.box((-2.0, 0.6, -2.0), (2.0, 0.8, 2.0))
        if what == "water":
            mesh = wrt.quad((-2.0, 0.6, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0))
        scene = scene_of(floor(wrt.Diffuse(1e-3), 0.8), wrt.Shape(mesh, wrt.Dielectric(ior=1.5)), sun)
        scene.camera = wrt.PerspectiveCamera((0.0, 0.5, 0.01), (0.0, 0.0, 0.0), fov_degrees=60.0)
        return scene

    reflectance = float(by_angles(max(np.cos(angle), 1e-6) if degrees else 1.0 - 1e-9, 1.5))
    inner = reflectance if what == "slab" else 0.0
    expected = 1e-3 / np.pi * np.cos(angle) * (1.0 - reflectance) / (1.0 + inner)
    found = means(make, 128, caustics=True, max_depth=20)
    report(f"irradiance below {what}", found.mean() / expected, 1.0)
    assert found.std() < 0.03 * expected
    assert deviation(found, expected) < 3.5
    assert means(make, 8, 1)[0] < 1e-4 * expected


def smooth_normals() -> wrt.Scene:
    return scene_of(floor(), lamp(), ball())


def flat_ball() -> wrt.Shape:
    mesh = wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=1)
    return wrt.Shape(wrt.Mesh(mesh.vertices, mesh.faces), wrt.Dielectric())


def closed_box() -> wrt.Scene:
    """A glass block and a lamp in a box, seen from its middle all around: the light in it is conserved."""
    room = wrt.box((-2.0, -0.01, -2.0), (2.0, 3.5, 2.0))
    scene = scene_of(wrt.Shape(room, wrt.Diffuse(0.6)), lamp(), block(wrt.Dielectric()))
    scene.camera = wrt.PanoramaCamera((0.0, 1.8, 1.0), (0.0, 1.8, 0.0))
    return scene


def instances() -> wrt.Scene:
    mesh = wrt.sphere((0.0, 0.0, 0.0), 0.4, subdivisions=4)
    places = [np.array([[1.0, 0, 0, x], [0, 1.0, 0, 0.6], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]) for x in (-0.5, 0.5)]
    return scene_of(floor(), lamp(), *(wrt.Shape(mesh, wrt.Dielectric(), transform=place) for place in places))


def sky() -> wrt.ImageEnvironment:
    return wrt.ImageEnvironment(np.random.default_rng(1).random((8, 16, 3)).astype(np.float32))


def moving(turn: wrt.Motion | None = None) -> wrt.Scene:
    """A ball, a block, a plate, the lamp and the camera, which move while the shutter is open; all alike by `turn`."""
    right, up = wrt.Motion.translation((0.8, 0.0, 0.2)), wrt.Motion.translation((0.0, 0.6, 0.0))
    spin = wrt.Motion.rotation((0.0, 1.0, 0.0), 60.0, center=(-0.7, 0.8, 0.3))
    glass = wrt.box((-1.0, 0.5, 0.0), (-0.4, 1.1, 0.6))
    plate = wrt.quad((-0.4, 0.1, 0.9), (0.8, 0.0, 0.0), (0.0, 0.0, -0.8))
    motions = (wrt.Motion(np.zeros(1), np.eye(4)[None]), right, right, spin, up)
    shapes = (floor(), lamp(), ball(exact=True), wrt.Shape(glass, wrt.Dielectric()), wrt.Shape(plate, wrt.Diffuse(0.8)))
    scene = scene_of(
        *(dataclasses.replace(shape, transform=turn or motion) for shape, motion in zip(shapes, motions, strict=True))
    )
    sway = turn or wrt.Motion.translation((0.0, 0.0, 0.5))
    scene.camera = dataclasses.replace(scene.camera, shutter_close=1.0, shutter_ramp=0.5, motion=sway)
    return scene


def deforming() -> wrt.Scene:
    scene = moving()
    mesh = wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=2)
    squeezed = np.stack([mesh.vertices, mesh.vertices * np.float32([1.2, 0.6, 1.0])])
    scene.shapes[2] = wrt.Shape(mesh, wrt.Dielectric(), deformation=wrt.Deformation((0.0, 1.0), squeezed))
    return scene


def nearly_smooth() -> wrt.Scene:
    """Casters that are a little rough, before a matt floor, a wall of metal, and paint that is no caster."""
    metal = wrt.Principled(0.9, metallic=1.0, roughness=0.2)
    wall = wrt.Shape(wrt.quad((-1.5, 0.0, -0.7), (3.0, 0.0, 0.0), (0.0, 1.5, 0.0)), metal)
    copper = wrt.Shape(wrt.cylinder((-0.9, 0.0, 0.3), (-0.9, 0.8, 0.3), 0.3), wrt.RoughConductor(0.05))
    paint = wrt.Shape(wrt.box((0.8, 0.0, 0.2), (1.2, 0.4, 0.6)), wrt.Principled(0.6, roughness=0.2))
    return scene_of(floor(), lamp(), wall, copper, ball(wrt.RoughDielectric(alpha=0.03)), paint)


TINTED = wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 1.0, 2.0)))

SCENES: dict[str, Callable[[], wrt.Scene]] = {
    "block": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric())),
    "closed box": closed_box,
    "smooth normals": smooth_normals,
    "exact ball": lambda: scene_of(floor(), lamp(), ball(exact=True)),
    "mirror cylinder": lambda: scene_of(
        floor(), lamp(), wrt.Shape(wrt.cylinder((0.0, 0.3, 0.0), (0.0, 1.2, 0.0), 0.4), wrt.Mirror())
    ),
    "instances": instances,
    "plastic floor": lambda: scene_of(floor(wrt.Plastic()), lamp(), flat_ball()),
    "pane": lambda: scene_of(
        floor(),
        lamp(),
        wrt.Shape(wrt.box((-1.0, 1.6, -1.0), (1.0, 1.62, 1.0)), wrt.ThinDielectric()),
        block(wrt.Dielectric(), 0.1),
    ),
    "holes": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric(opacity=0.5))),
    "tinted": lambda: scene_of(floor(), lamp(), block(TINTED)),
    "dispersive": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric(dispersion=0.05))),
    "constant": lambda: scene_of(floor(), flat_ball(), lamp(), environment=wrt.ConstantEnvironment(0.3)),
    "image": lambda: scene_of(floor(), flat_ball(), environment=sky()),
    "shapes": lambda: scene_of(
        floor(),
        flat_ball(),
        wrt.SphereLight((1.0, 3.0, 0.0), 0.7, 5.0),
        wrt.RectangleLight((-1.0, 3.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.5), 5.0),
    ),
    "sun": lambda: scene_of(floor(), flat_ball(), wrt.DirectionalLight((0.3, -1.0, 0.1), 3.0, angle_degrees=20.0)),
    "fog": lambda: fog(),
    "translucent": lambda: translucent(),
    "nearly smooth": nearly_smooth,
    "moving": moving,
    "deforming": deforming,
    "textured": lambda: scene_of(floor(wrt.Diffuse(wrt.ImageTexture(pixels(3)))), lamp(), block(wrt.Dielectric())),
    "bumpy": lambda: bumpy(),
    "nested": lambda: scene_of(
        floor(), lamp(), block(wrt.Dielectric(1.5, priority=1)), ball(wrt.Dielectric(1.2, priority=2))
    ),
    "frosted": lambda: scene_of(
        floor(),
        lamp(),
        block(wrt.Dielectric(), 0.7),
        wrt.Shape(wrt.box((-1.5, 0.3, -1.5), (1.5, 0.5, 1.5)), wrt.RoughDielectric(alpha=0.3)),
    ),
}


def translucent() -> wrt.Scene:
    """A sheet, seen from below, that lets more of the light from above through than it reflects."""
    sheet = wrt.Burley(0.8, thin_walled=True, diffuse_transmission=0.8, roughness=1.0)
    return from_below(scene_of(floor(sheet), lamp(), block(wrt.Dielectric())))


def from_below(scene: wrt.Scene) -> wrt.Scene:
    scene.camera = wrt.PerspectiveCamera((0.0, -3.0, 4.0), (0.0, -0.3, 0.0), fov_degrees=40.0)
    return scene


def pixels(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((4, 4, 3)).astype(np.float32)


def bumpy() -> wrt.Scene:
    """Bumps where light is turned, and where it arrives."""
    bumps = wrt.NormalMap(0.5 + (pixels(5) - 0.5) * (0.3, 0.3, 0.0) + (0.0, 0.0, 0.5))
    mesh = ball().mesh
    glass = wrt.Shape(dataclasses.replace(mesh, uvs=mesh.vertices[:, :2]), wrt.Dielectric(normal_map=bumps))
    return scene_of(floor(wrt.Diffuse(0.5, normal_map=bumps)), lamp(), glass)


def fog() -> wrt.Scene:
    """Light that the glass throws into fog stays with the path; photons have what reaches the floor."""
    mist = wrt.Null(interior=wrt.Medium(scattering=0.2, absorption=0.1))
    box = wrt.Shape(wrt.box((-2.0, 0.02, -2.0), (2.0, 2.5, 2.0)), mist)
    return scene_of(floor(), lamp(), box, block(wrt.Dielectric()))


@pytest.mark.parametrize(
    "name", [name if name == "block" else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_photons_bring_the_light_that_long_paths_find(name: str, report: Report) -> None:
    spp = 32 if name == "block" else 128
    ours, theirs = means(SCENES[name], spp, caustics=True), means(SCENES[name], 16 * spp)
    report(f"mean radiance, {name}", ours.mean() / theirs.mean(), 1.0)
    assert max(ours.std(), theirs.std()) < 0.03 * theirs.mean()
    assert deviation(ours, theirs, BIAS) < 3.5
    short = means(SCENES[name], spp, 2, max_depth=2)
    assert short.mean() < 0.995 * theirs.mean()  # so there is light to find


def blocks(renders: list[Array]) -> Array:
    """Return (renders, 16) mean radiance of parts of pictures."""
    size = SIZE // 4
    return np.array([image.reshape(4, size, 4, size, 3).mean(axis=(1, 3, 4)).ravel() for image in renders])


@pytest.mark.slow
@pytest.mark.parametrize("what", ["own ways", "one way"])
def test_light_in_motion_is_the_mean_of_still_light(what: str, monkeypatch: pytest.MonkeyPatch, report: Report) -> None:
    """Of pictures at times of the shutter; at any one where everything moves as the camera does."""
    monkeypatch.setattr("wrt.rendering.photons.FIRST_RADIUS", 0.5)
    options = {"width": SIZE, "height": SIZE, "max_depth": 10, "filter": "box", "caustics": True}
    turn = wrt.Motion.rotation((0.2, 1.0, 0.0), 100.0, offset=(1.0, 2.0, 0.0))
    scene, times = moving(None if what == "own ways" else turn), 16
    scene.camera = dataclasses.replace(scene.camera, shutter_ramp=0.0)
    still, rng = moving(), np.random.default_rng(5)

    def at(time: float) -> wrt.Scene:
        of = scene if what == "own ways" else still
        camera = dataclasses.replace(of.camera, shutter_open=time, shutter_close=time)
        return dataclasses.replace(of, camera=camera)

    exposed = blocks([image_of(wrt.Renderer(scene, seed=k, **options), 4 * times) for k in range(SEEDS)])
    instants = []
    for seed in range(SEEDS):
        drawn = (np.arange(times) + rng.random()) / times if what == "own ways" else np.zeros(times)
        renderers = (wrt.Renderer(at(t), seed=100 + 16 * seed + k, **options) for k, t in enumerate(drawn))
        instants.append(np.mean([image_of(each, 4) for each in renderers], axis=0))
    expected = blocks(instants)
    report("mean radiance", exposed.mean() / expected.mean(), 1.0)
    variances = exposed.var(axis=0, ddof=1) / SEEDS, expected.var(axis=0, ddof=1) / SEEDS
    z = two_sample_z(exposed.mean(axis=0), variances[0], expected.mean(axis=0), variances[1], n_a=SEEDS, n_b=SEEDS)
    assert np.median(exposed.std(axis=0)) < 0.03 * exposed.mean()
    assert 2.0 * stats.norm.sf(np.abs(z)).min() > sidak(1e-3, z.size)


@pytest.mark.slow
def test_pictures_in_motion_keep_their_bits(tmp_path: Path) -> None:
    def render(**changes: Any) -> wrt.Renderer:
        return wrt.Renderer(moving(), **{"width": 24, "height": 16, "seed": 3, "caustics": True, **changes})

    expected = image_of(render(), 6)
    np.testing.assert_array_equal(image_of(render(threads=3), 1, 2, 5, 6), expected)
    np.testing.assert_array_equal(image_of(render(crop=(5, 3, 17, 12)), 6), expected[3:12, 5:17])
    finish(render(), 4).save_checkpoint(tmp_path / "a.ckpt")
    np.testing.assert_array_equal(image_of(wrt.Renderer.resume(tmp_path / "a.ckpt", moving()), 6), expected)
    np.testing.assert_array_equal(wrt.merge([render().part(k, 2, spp=6) for k in (1, 2)]).image(), expected)


@needs_lanes
@pytest.mark.machinery
@pytest.mark.parametrize("name", ["moving", "nearly smooth"])
def test_wide_kernels_leave_the_same_bits(name: str) -> None:
    assert differences(SCENES[name](), caustics=True) == []


def test_light_stays_on_the_side_where_it_arrives() -> None:
    """Of an opaque sheet the other side is black."""
    options = {"width": 24, "height": 16, "caustics": True, "max_depth": 10}
    scene = SCENES["block"]()
    assert image_of(wrt.Renderer(scene, **options), 4).any()
    assert not image_of(wrt.Renderer(from_below(scene), **options), 4).any()


@pytest.mark.slow
def test_a_path_is_as_long_with_photons_as_without(report: Report) -> None:
    """Of the light through two sides of a block, which takes four segments, a depth of three shows nothing."""
    for depth in (3, 4):
        ours, theirs = (
            means(SCENES["block"], spp, max_depth=depth, caustics=c) for c, spp in ((True, 32), (False, 512))
        )
        report(f"mean radiance at depth {depth}", ours.mean() / theirs.mean(), 1.0)
        assert deviation(ours, theirs, BIAS) < 3.5


@pytest.mark.slow
def test_an_integrating_sphere_has_the_radiance_of_its_closed_form(report: Report) -> None:
    """A point of power P in the middle of a glass ball and of a matt sphere: radiance ρ P / (4 π² R² (1 − ρ)).

    All light passes the ball, which neither absorbs it nor changes the uniform light of the walls, and half of it
    comes from walls to walls.
    """
    reflectance = 0.5

    def make() -> wrt.Scene:
        room = wrt.Shape(wrt.sphere((0.0, 0.0, 0.0), 2.0, exact=True), wrt.Diffuse(reflectance))
        glass = wrt.Shape(wrt.sphere((0.0, 0.0, 0.0), 0.4, exact=True), wrt.Dielectric())
        scene = scene_of(room, glass, wrt.PointLight((0.0, 0.0, 0.0), power=1.0))
        scene.camera = wrt.PerspectiveCamera((0.0, 0.9, 0.9), (0.0, 1.8, 1.0), fov_degrees=60.0)
        return scene

    expected = reflectance / (4.0 * np.pi**2 * 2.0**2 * (1.0 - reflectance))
    found = means(make, 160, max_depth=64, caustics=True)
    report("radiance", found.mean() / expected, 1.0)
    assert found.std() < 0.02 * expected
    assert deviation(found, expected, BIAS) < 3.5


@pytest.mark.slow
@pytest.mark.parametrize("clamp", [None, 0.5])
def test_photons_are_in_the_group_of_their_light(clamp: float | None) -> None:
    """Of lights in red, green and blue each group has one colour, and their sum is the picture to rounding."""
    names = ("red", "green", "blue")

    def make(*, grouped: bool = True) -> wrt.Scene:
        groups = names if grouped else (None, None, None)
        lit = dataclasses.replace(lamp(), emission=(2.5, 0.0, 0.0), group=groups[0])
        point = wrt.PointLight((1.0, 3.0, 0.0), (0.0, 5.0, 0.0), group=groups[1])
        sky = wrt.ConstantEnvironment((0.0, 0.0, 0.3), group=groups[2])
        return scene_of(floor(), block(wrt.Dielectric()), lit, point, environment=sky)

    def render(scene: wrt.Scene, *layers: str) -> wrt.Renderer:
        options = {"width": 24, "height": 16, "caustics": True, "clamp_indirect": clamp, "layers": layers}
        return finish(wrt.Renderer(scene, max_depth=10, **options), 5, 8)

    grouped = render(make(), "light_groups")
    image, layers = grouped.image(), grouped.layers()
    np.testing.assert_array_equal(image, render(make(grouped=False)).image())
    for channel, name in enumerate(names):
        layer = layers[f"light_{name}"]
        np.testing.assert_allclose(layer[..., channel], image[..., channel], rtol=3e-6)
        assert not np.delete(layer, channel, axis=2).any()


def test_materials_say_what_is_nearly_smooth() -> None:
    grey = np.full((2, 2, 3), 0.2, np.float32)
    casters = (
        wrt.RoughConductor(0.05),
        wrt.RoughDielectric(alpha=wrt.ImageTexture(grey, factor=0.2)),
        wrt.Principled(metallic=1.0, roughness=wrt.ImageTexture(grey)),
        wrt.Principled(transmission=1.0, roughness=0.0, coat=1.0, coat_roughness=0.2),
    )
    others = (
        wrt.RoughConductor((0.01, 0.06)),
        wrt.RoughDielectric(alpha=wrt.VertexColor()),
        wrt.RoughConductor(wrt.ImageTexture(grey)),
        wrt.RoughConductor((10.0, 0.01), distribution="abc"),
        wrt.RoughPlastic(alpha=0.01),
        wrt.Principled(metallic=0.9, roughness=0.1),
        wrt.Principled(metallic=1.0, roughness=0.25),
        wrt.Principled(metallic=1.0, roughness=0.1, coat=1.0, coat_roughness=0.3),
        wrt.Principled(metallic=1.0, roughness=0.1, sheen_color=0.1),
    )
    assert all(each.is_nearly_smooth for each in casters)
    assert not any(each.is_nearly_smooth for each in (*others, wrt.Mirror(), wrt.Diffuse()))
    assert share_of_photons(wrt.Mix(casters[0], wrt.Diffuse(), 0.5)) == 1.0
    assert share_of_photons(others[1]) == 0.0
    name = casters[0].model
    tables = [MaterialTable([casters[0], others[0]], caustics=caustics).models for caustics in (True, False)]
    assert tables == [(name, caster_name(name)), (name,)]


def test_models_say_what_turns_light() -> None:
    found = {
        name: smooth_lobes(name) for name in ("diffuse", "null", "mirror", "dielectric", "thin_dielectric", "plastic")
    }
    assert list(found.values()) == ["none", "none", "all", "all", "all", "some"]
    assert smooth_lobes("rough_dielectric:ggx:smith") == "none"


def test_a_quarter_of_the_paths_is_reflected_and_the_light_is_as_before() -> None:
    u = (np.arange(1000) + 0.5) / 1000.0
    for reflectance in (0.02, 0.24, 0.3, 1.0):
        lobe, weight = np.array([tuple(reflect_a_quarter(float(each), reflectance)) for each in u]).T
        is_reflected = lobe < reflectance
        assert is_reflected.mean() == pytest.approx(max(reflectance, 0.25), abs=1e-3)
        assert weight[is_reflected].sum() / 1000.0 == pytest.approx(reflectance, abs=1e-5)
        assert weight[~is_reflected].sum() / 1000.0 == pytest.approx(1.0 - reflectance, abs=1e-5)


# --- Bits ------------------------------------------------------------------------------------------


def renderer(**options: Any) -> wrt.Renderer:
    options = {"width": 24, "height": 16, "seed": 3, "caustics": True, "max_depth": 10, **options}
    return wrt.Renderer(SCENES["block"](), **options)


@pytest.fixture(scope="module")
def expected() -> Array:
    image: Array = image_of(renderer(), SPP)
    return image


def test_threads_slices_passes_and_seeds(expected: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    np.testing.assert_array_equal(image_of(renderer(threads=3), SPP), expected)
    np.testing.assert_array_equal(image_of(renderer(), 1, 2, 5, SPP), expected)
    assert (image_of(renderer(seed=4), SPP) != expected).any()
    monkeypatch.setattr("wrt.slices.SLICES_PER_THREAD", 97)
    np.testing.assert_array_equal(image_of(renderer(), SPP), expected)


def test_crops_parts_and_resumed_pictures(expected: Array, tmp_path: Path) -> None:
    cropped = image_of(renderer(crop=(5, 3, 17, 12)), SPP)
    np.testing.assert_array_equal(cropped, expected[3:12, 5:17])
    finish(renderer(), 4).save_checkpoint(tmp_path / "a.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "a.ckpt", SCENES["block"]())
    assert resumed.settings.caustics
    np.testing.assert_array_equal(image_of(resumed, SPP), expected)
    parts: list[Part] = [renderer().part(number, 2, spp=SPP) for number in (1, 2)]
    np.testing.assert_array_equal(wrt.merge(parts).image(), expected)
    with pytest.raises(wrt.InputError, match="caustics"):
        renderer(caustics=False).load_checkpoint(tmp_path / "a.ckpt")


def test_an_interrupted_pass_goes_on_where_it_was(expected: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    half = renderer(threads=2)
    backend = half.device.backend
    launch, launches = backend.launch, itertools.count()

    def interrupted(*args: Any, **kwargs: Any) -> None:
        if next(launches) == 40:
            raise KeyboardInterrupt
        launch(*args, **kwargs)

    monkeypatch.setattr(backend, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        finish(half, SPP)
    monkeypatch.setattr(backend, "launch", launch)
    assert half.film.counts.min() < SPP
    np.testing.assert_array_equal(image_of(half, SPP), expected)


def test_pixels_that_stop_before_others(expected: Array) -> None:
    """Those of an adaptive render have the samples of their counts."""
    adaptive = renderer(width=64, height=32)
    finish(adaptive, noise=0.25, adaptive=True)
    counts = adaptive.film.counts
    for count in np.unique(counts):
        whole = image_of(renderer(width=64, height=32), int(count))
        np.testing.assert_array_equal(adaptive.image()[counts == count], whole[counts == count])


def test_another_camera_and_a_shared_scene(expected: Array) -> None:
    moved = finish(renderer(), 2)
    moved.set_camera(wrt.PerspectiveCamera((0.0, 5.0, 4.0), (0.0, 0.3, 0.0)))
    moved.set_camera(SCENES["block"]().camera)
    np.testing.assert_array_equal(image_of(moved, SPP), expected)
    np.testing.assert_array_equal(image_of(moved.sharing(), SPP), expected)
    plain = moved.sharing(caustics=False)
    np.testing.assert_array_equal(image_of(plain, SPP), image_of(renderer(caustics=False), SPP))
    with pytest.raises(wrt.InputError, match="make a new Renderer"):
        plain.sharing(caustics=True).sharing(caustics=True)
    assert image_of(moved.sharing(integrator="aov", layers=("object",)), 1).shape == expected.shape  # as views do


def test_vertices_that_move_take_the_photons_along() -> None:
    """Also beyond the box of the scene that was built, and what throws a shadow there."""

    def make(lift: float) -> wrt.Renderer:
        scene = scene_of(floor(), block(wrt.Dielectric(), 0.4 + lift), wrt.DirectionalLight((0.2, -1.0, 0.1), 3.0))
        scene.add(wrt.box((-0.5, 2.0 + 3.0 * lift, -0.5), (0.0, 2.1 + 3.0 * lift, 0.5)), material=wrt.Diffuse(0.5))
        return wrt.Renderer(scene, width=24, height=16, caustics=True, max_depth=10)

    updated, fresh = make(0.0), make(0.7)
    for shape in (1, 2):
        updated.update_vertices(shape, fresh.scene.shapes[shape].mesh.vertices)
    image = image_of(fresh, 8)
    np.testing.assert_allclose(image_of(updated, 8).mean(), image.mean(), rtol=1e-3)
    assert abs(image_of(make(0.0), 8).mean() / image.mean() - 1.0) > 0.01


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_caustics_that_no_path_finds_are_told(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    def hints(*parts: wrt.Shape | wrt.Light, **options: Any) -> int:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            wrt.Renderer(scene_of(floor(), lamp(), *parts), **{"width": 8, "height": 6, **options})
        return sum(issubclass(each.category, Hint) for each in caught)

    point, glass = wrt.PointLight((0.0, 3.0, 0.0), power=1.0), ball()
    assert hints(glass, point) == hints(ball(wrt.Mirror()), wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0)) == 1
    for silent in ((glass,), (point,), (ball(wrt.ThinDielectric()), point), (ball(wrt.RoughDielectric()), point)):
        assert hints(*silent) == 0
    assert hints(glass, wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0, angle_degrees=5.0)) == 0
    for option in ({"caustics": True}, {"integrator": "direct"}):
        assert hints(glass, point, **option) == 0
    wrt.save_scene(tmp_path / "a.toml", scene_of(floor(), glass, point))
    command = f"render {tmp_path}/a.toml --size 8x6 --spp 1 -o {tmp_path}"
    for more, count in (("a.png", 1), ("b.png --quiet", 0), ("c.gif --turntable 2", 1)):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            assert main(f"{command}/{more}".split()) == 0
        assert capfd.readouterr().err.count("wrt: hint: lights without a size") == count


# --- What it refuses -------------------------------------------------------------------------------


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_what_cannot_be_rendered_is_said_before() -> None:
    for name in ("direct", "whitted", "ao", "aov"):
        with pytest.raises(wrt.InputError, match=f"integrator '{name}' cannot render caustics by photons"):
            renderer(integrator=name)
    with pytest.raises(wrt.InputError, match="have no derivatives"):
        renderer().gradients(np.ones((16, 24, 3)))
    caught = moving()
    caught.shapes[0] = dataclasses.replace(caught.shapes[0], shadow_catcher=True)
    with pytest.raises(wrt.InputError, match="on shadow catchers have no motion blur"):
        wrt.Renderer(caught, caustics=True)
    sunk = block(wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 0.2, 0.1))))
    for height in (0.9, 2.5):
        bulb = wrt.Shape(wrt.sphere((0.0, height, 0.0), 0.1), wrt.Diffuse(0.0), emission=1.0)
        for light in (wrt.PointLight((0.0, height, 0.0), power=1.0), bulb):
            refused = pytest.raises(wrt.InputError, match="lies inside another body")
            with refused if height < 2.0 else contextlib.nullcontext():
                wrt.Renderer(scene_of(floor(), sunk, light), width=4, height=4, caustics=True)
    with pytest.warns(UserWarning, match="no surface is a mirror"):
        without = wrt.Renderer(scene_of(floor(), lamp()), width=4, height=4, caustics=True)
    assert without._photons is None
