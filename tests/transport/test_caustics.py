"""Caustics by photons: the light of a slab follows from Fresnel's equations, and pictures are those of long paths.

Photons of a set serve all pixels, so errors of pixels are not independent: tests compare means of renders with several
seeds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.caustic_scenes import SCENES, block, floor, from_below, lamp, moving, scene_of
from support.fresnel import by_angles
from support.small_scenes import finish, image_of
from support.statistics import sidak, two_sample_z
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.kernels.bsdf import caster_name, smooth_lobes
from wrt.kernels.integrators.path_surface import reflect_a_quarter
from wrt.upload.casters import share_of_photons
from wrt.upload.materials import MaterialTable

Array = NDArray[np.floating[Any]]

SIZE = 16
SEEDS = 8

BIAS = 0.003
"""A bound on the bias of a picture's mean in the scenes below, relative to it: photons blur over its edges."""


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
