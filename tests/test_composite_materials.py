"""Mixtures, two sides, opacity and emission of a material: what they are made of shows in the stated shares."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import hemisphere
from support.hits import Hit
from support.kernels import draw
from support.statistics import chi_square_test, image_z_test, t_test_mean
from test_furnace import flat_ball
from test_irradiance import check, floor_scene, irradiance, pixel_mean, rectangle_irradiance

import wrt
from wrt.fingerprint import scene_fingerprint
from wrt.kernels import materials as device_materials
from wrt.materials import composite

N = 2**16
EVEN = ((np.arange(N) + 0.5) / N).astype(np.float32)
"""Every random number as often as any other: shares come out to one in N for each border between two answers."""
EXTREMES = np.array([0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24], np.float32)

GHOST = wrt.Diffuse(opacity=0.0)
A, B, C = wrt.Diffuse((0.8, 0.1, 0.2)), wrt.Diffuse((0.1, 0.7, 0.3)), wrt.Mirror(0.6)
BLACK = wrt.Diffuse(0.0)


# --- Which material answers -------------------------------------------------------------------------


def expected_shares(material: wrt.Material, front: bool = True) -> dict[int, float]:
    """Return how often each part must answer, by identity, and nothing under 0, for constant weights."""
    if isinstance(material, wrt.Mix):
        inner = [
            (expected_shares(material.first, front), 1.0 - material.weight),
            (expected_shares(material.second, front), material.weight),
        ]
    elif isinstance(material, wrt.TwoSided):
        inner = [(expected_shares(material.front if front else material.back, front), 1.0)]
    else:
        inner = [({id(material): 1.0}, 1.0)]
    result = {0: 1.0 - material.opacity}
    for shares, weight in inner:
        for key, share in shares.items():
            result[key] = result.get(key, 0.0) + material.opacity * weight * share
    return result


def chain(depth: int, weight: float = 0.4) -> wrt.Material:
    """Return a mixture nested so deep, each part of another reflectance and somewhat transparent."""
    material: wrt.Material = wrt.Diffuse(0.9, opacity=0.7)
    for i in range(depth):
        part = wrt.Diffuse(0.1 * i, opacity=0.9 if i % 2 else 1.0)
        ends = (material, part) if i % 3 else (part, material)
        material = wrt.Mix(*ends, weight=weight if i % 2 else 1.0 - weight, opacity=0.95 if i == 3 else 1.0)
    return material


def full_tree(depth: int) -> wrt.Material:
    if depth == 0:
        return wrt.Diffuse(0.5, opacity=0.8)
    return wrt.Mix(full_tree(depth - 1), full_tree(depth - 1), weight=0.3)


NESTED = {
    "a mixture": wrt.Mix(A, B, weight=0.3),
    "the same material twice": wrt.Mix(A, A, weight=0.3),
    "weight 0": wrt.Mix(A, B, weight=0.0),
    "weight 1": wrt.Mix(A, B, weight=1.0),
    "opacity": wrt.Diffuse(0.5, opacity=0.3),
    "opacity of a mixture and of its parts": wrt.Mix(
        wrt.Diffuse(0.5, opacity=0.25), wrt.Mirror(opacity=0.5), weight=0.75, opacity=0.8
    ),
    "two sides": wrt.TwoSided(A, C),
    "two sides, one of them a mixture": wrt.TwoSided(A, wrt.Mix(B, C, weight=0.2), opacity=0.9),
    "a mixture of two-sided ones": wrt.Mix(wrt.TwoSided(A, B), wrt.TwoSided(C, wrt.Diffuse(opacity=0.1)), weight=0.6),
    "7 deep": chain(composite.MAX_NESTING),
    "7 deep and all full": full_tree(composite.MAX_NESTING),
}


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", NESTED)
def test_each_part_answers_in_its_share(name: str, front: bool, device: str) -> None:
    material = NESTED[name]
    found = Hit(material, device, front=front).choose(EVEN)
    expected = expected_shares(material, front)
    borders = 2 * len(found.materials) + 2
    for part in found.materials:
        assert found.share(part) == pytest.approx(expected.get(id(part), 0.0), abs=borders / N), part
    assert found.share(None) == pytest.approx(expected[0], abs=borders / N)
    # What shadow rays take is the same share, and not by chance.
    np.testing.assert_allclose(found.passed, expected[0], atol=1e-6)


def test_shares_of_0_and_1_are_exact(device: str) -> None:
    """For no random number at all does the other one answer."""
    for weight, chosen in ((0.0, A), (1.0, B)):
        assert Hit(wrt.Mix(A, B, weight=weight), device).choose(EXTREMES).share(chosen) == 1.0
        texture = wrt.ImageTexture(np.full((1, 1, 3), weight))
        inner = wrt.Mix(wrt.Mix(A, B, weight=texture), wrt.Mix(A, B, weight=texture), weight=0.7)
        assert Hit(inner, device).choose(np.concatenate([EXTREMES, EVEN])).share(chosen) == 1.0
    nothing = Hit(wrt.Diffuse(opacity=0.0), device).choose(EXTREMES)
    assert (nothing.share(None), set(nothing.passed)) == (1.0, {1.0})
    solid = Hit(wrt.Mix(A, B, opacity=wrt.ImageTexture(np.ones((1, 1, 3)))), device).choose(EXTREMES)
    assert (solid.share(None), set(solid.passed)) == (0.0, {0.0})


def test_numbers_left_over_stay_below_one(device: str) -> None:
    """A number is stretched to choose again further in; rounded up to 1 it would pass what is wholly there."""
    last = np.float32(1.0) - np.float32(2.0) ** np.float32(-24) * np.arange(1, 65, dtype=np.float32)
    solid = wrt.Diffuse(opacity=wrt.ImageTexture(np.ones((1, 1, 3))))
    for weight in np.random.default_rng(1).random(200):
        for material in (wrt.Mix(solid, A, weight=weight), wrt.Mix(A, solid, weight=weight)):
            below = (np.float32(weight) * last).astype(np.float32)
            assert Hit(material, device).choose(np.concatenate([last, below])).share(None) == 0.0


@pytest.mark.parametrize("channel", [None, "r", "g", "b"])
def test_weight_and_opacity_may_be_textures_of_one_channel(channel: str | None, device: str) -> None:
    """2 × 2 texels, asked at their centres and, for the interpolation, between them; without a name red is taken."""
    pixels = np.random.default_rng(2).random((2, 2, 3)).astype(np.float32)
    texture = wrt.ImageTexture(pixels, channel=channel)
    number = pixels[..., "rgb".index(channel or "r")]
    places = {(0.25, 0.75): number[0, 0], (0.75, 0.75): number[0, 1], (0.25, 0.25): number[1, 0]}
    places |= {(0.75, 0.25): number[1, 1], (0.5, 0.5): number.mean(), (0.5, 0.25): number[1].mean()}
    for uv, value in places.items():
        mixed = Hit(wrt.Mix(A, B, weight=texture), device, uv=uv).choose(EVEN)
        assert mixed.share(B) == pytest.approx(value, abs=2 / N)
        partly = Hit(wrt.Diffuse(opacity=texture), device, uv=uv).choose(EVEN)
        assert partly.share(None) == pytest.approx(1.0 - value, abs=2 / N)
        np.testing.assert_allclose(partly.passed, 1.0 - value, rtol=1e-5)


def test_weight_and_opacity_may_be_vertex_colours_and_are_kept_within_0_and_1(device: str) -> None:
    for red, share in ((0.3, 0.3), (7.0, 1.0), (-2.0, 0.0)):
        color = (red, 0.9, 0.9)
        mixed = Hit(wrt.Mix(A, B, weight=wrt.VertexColor()), device, color=color).choose(EVEN)
        assert mixed.share(B) == pytest.approx(share, abs=2 / N)
        partly = Hit(wrt.Diffuse(opacity=wrt.VertexColor()), device, color=color).choose(EVEN)
        assert partly.share(None) == pytest.approx(1.0 - share, abs=2 / N)
        np.testing.assert_allclose(partly.passed, 1.0 - share, atol=1e-6)


def test_one_channel_of_a_texture_is_a_grey(device: str) -> None:
    """A colour read from one channel has it three times; the texels themselves are uploaded once."""
    pixels = np.random.default_rng(3).random((3, 2, 3)).astype(np.float32)
    texture = wrt.ImageTexture(pixels)
    for channel in "rgb":
        one = dataclasses.replace(texture, channel=channel)
        hit = Hit(wrt.Mix(wrt.Diffuse(one), wrt.Diffuse(texture), weight=0.0), device, uv=(0.25, 1.0 / 6.0))
        assert len(hit.scene.images) == 1
        up = np.array([[0.0, 0.0, 1.0]])
        value, _ = hit.evaluate([0.5], up, up)
        np.testing.assert_allclose(value[0] * math.pi, np.repeat(pixels[2, 0, "rgb".index(channel)], 3), rtol=1e-5)


def test_choices_after_one_another_are_independent(device: str, report: Report) -> None:
    """The number that chooses at a surface says nothing about the one behind it, nor about the path's others."""
    from wrt.kernels.sampler import BLOCKS_PER_PATH

    n = 2**20
    pixel, index = np.arange(n) % 1021, np.arange(n) // 1021
    stride = int(BLOCKS_PER_PATH)
    first = draw(7, pixel, index, 9, device)[:, 0]
    bins = 31
    others = {f"{k} surfaces on": draw(7, pixel, index, 9 + k * stride, device)[:, 0] for k in (1, 2, 16, 4096)}
    others["the BSDF's"] = draw(7, pixel, index, 8 + stride, device)[:, 0]
    for name, second in others.items():
        cells = (first * bins).astype(int) * bins + (second * bins).astype(int)
        result = chi_square_test(np.bincount(cells, minlength=bins * bins), np.full(bins * bins, n / bins**2), tests=5)
        report(f"pairs with the number {name}", result.statistic, result.dof, p=result.p)
        assert result.passed, result.message


# --- What it comes to -------------------------------------------------------------------------------


def test_mixture_has_the_mixed_value_and_density(device: str) -> None:
    """E f = (1 − w) f_a + w f_b, and likewise of densities, over the choice; and opacity takes its share of both."""
    wo, wi = hemisphere(500, seed=1), hemisphere(500, seed=2)
    up = np.linspace(0.0, 1.0, 1001)[:-1] + 0.0005
    rough = wrt.OrenNayar((0.2, 0.5, 0.9), sigma=0.6)
    parts = [Hit(material, device).evaluate([0.5], wo, wi) for material in (A, rough)]
    for weight, opacity in ((0.3, 1.0), (0.9, 0.5), (0.0, 1.0), (1.0, 0.2)):
        found = Hit(wrt.Mix(A, rough, weight=weight, opacity=opacity), device).evaluate(up, wo, wi)
        for k in range(2):
            expected = opacity * ((1.0 - weight) * parts[0][k] + weight * parts[1][k])
            np.testing.assert_allclose(found[k], expected, rtol=1e-4, atol=1e-7)


def render(scene: wrt.Scene, device: str, spp: int = 64, size: int = 16, **options: object) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, width=size, height=size, device=device, seed=5, **options)  # type: ignore[arg-type]
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def ball_scene(material: wrt.Material, mesh: wrt.Mesh | None = None) -> wrt.Scene:
    """A convex body that fills the picture, under a sky of radiance 2."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=10)
    scene.add(mesh or flat_ball(), material=material)
    return scene


def assert_mean(renderer: wrt.Renderer, expected: tuple[float, ...], report: Report, claim: str) -> None:
    """The mean over the picture of each channel is as expected, all pixels expecting the same."""
    pixels = renderer.width * renderer.height
    mean = renderer.image().astype(np.float64).mean(axis=(0, 1))
    variance = renderer.variance().sum(axis=(0, 1)) / pixels**2
    p = t_test_mean(mean, np.maximum(variance, (1e-6 * np.array(expected)) ** 2), renderer.spp * pixels, expected)
    report(claim, ", ".join(f"{x:.5f}" for x in mean), ", ".join(f"{x:.5f}" for x in expected), p=float(p.min()))
    assert p.min() > 0.01 / 3.0


def test_a_mixture_under_a_constant_sky_shows_the_mean_of_both(device: str, report: Report) -> None:
    weight = 0.3
    renderer = render(ball_scene(wrt.Mix(A, C, weight=weight)), device, spp=256)
    mixed = (1.0 - weight) * np.array(A.reflectance) + weight * np.array(C.reflectance)
    assert_mean(renderer, tuple(2.0 * mixed), report, "radiance of a mixture")


def test_a_mixture_of_one_material_is_that_material(device: str) -> None:
    """Bit for bit: the choice takes random numbers of its own."""
    mixed = render(ball_scene(wrt.Mix(A, A, weight=0.3)), device, spp=16).image()
    np.testing.assert_array_equal(mixed, render(ball_scene(A), device, spp=16).image())


@pytest.mark.parametrize("name", ["front", "back"])
def test_each_side_has_its_own_material(name: str, device: str) -> None:
    ball = flat_ball()
    mesh = ball if name == "front" else wrt.Mesh(ball.vertices, ball.faces[:, ::-1])
    image = render(ball_scene(wrt.TwoSided(A, B), mesh), device, spp=4).image()
    expected = {"front": A, "back": B}[name].reflectance
    np.testing.assert_allclose(image, np.broadcast_to(2.0 * np.array(expected), image.shape), rtol=1e-5)


def test_the_back_is_black_unless_given(device: str) -> None:
    ball = flat_ball()
    inside_out = wrt.Mesh(ball.vertices, ball.faces[:, ::-1])
    assert render(ball_scene(wrt.TwoSided(A), inside_out), device, spp=4).image().max() == 0.0


# --- Opacity ----------------------------------------------------------------------------------------


def room(lamp: bool = True) -> wrt.Scene:
    """A floor, a mirror and a box under a lamp, a point light and an image of a sky."""
    rng = np.random.default_rng(4)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(rng.random((4, 8, 3)).astype(np.float32)))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse((0.6, 0.5, 0.4)))
    scene.add(wrt.box((-1.0, 0.0, -0.5), (-0.3, 0.8, 0.2)), material=wrt.Diffuse(wrt.VertexColor()))
    scene.add(wrt.sphere((0.7, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Mirror(0.9))
    if lamp:
        scene.add(wrt.quad((-0.5, 2.5, -0.5), (1, 0, 0), (0, 0, 1)), emission=4.0)
    scene.add_light(wrt.PointLight((1.0, 2.0, 1.0), power=20.0))
    return scene


@pytest.mark.parametrize("max_depth", [1, 2, 5])
@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_what_has_no_opacity_is_not_there(strategy: str, max_depth: int, device: str) -> None:
    """Nor does it cost any of the path's segments; in front of the camera, between surfaces, around lights."""
    empty = render(room(), device, spp=8, strategy=strategy, max_depth=max_depth).image()
    scene = room()
    ghosts = (
        wrt.Diffuse(0.5, opacity=0.0),
        wrt.Dielectric(1.5, opacity=0.0),
        wrt.Mix(wrt.Mirror(opacity=0.0), A, weight=0.0),
        wrt.Diffuse(0.5, opacity=wrt.ImageTexture(np.zeros((2, 2, 3)))),
    )
    scene.add(wrt.box((-2.0, 0.1, -2.0), (2.0, 1.0, 2.0)), material=ghosts[0])
    scene.add(wrt.sphere((0.0, 1.2, 4.0), 0.5, subdivisions=2), material=ghosts[1])
    scene.add(wrt.sphere((0.0, 2.5, 0.0), 0.9, subdivisions=2), material=ghosts[2])
    scene.add(wrt.quad((-3, 0.05, 3), (6, 0, 0), (0, 0, -6)), material=ghosts[3], emission=100.0)
    seen = render(scene, device, spp=8, strategy=strategy, max_depth=max_depth)
    if max_depth == 1:
        np.testing.assert_allclose(seen.image(), empty, rtol=1e-4, atol=1e-6)
        return
    # The glowing ghost above the floor takes part in the choice of lights: other numbers, the same mean.
    plain = dataclasses.replace(scene, shapes=[dataclasses.replace(s, emission=0.0) for s in scene.shapes])
    plain.shapes[3] = scene.shapes[3]
    pixels = render(plain, device, spp=8, strategy=strategy, max_depth=max_depth).image()
    # A ray that leaves a ghost is off by its rounding, so a few hit another thing; all others see the same.
    assert np.isclose(pixels, empty, rtol=1e-3, atol=1e-4).mean() > 0.995
    assert pixels.mean() == pytest.approx(empty.mean(), rel=1e-2)


def test_a_glowing_thing_that_is_not_there_gives_no_light(device: str) -> None:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 3.0)))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)))
    scene.add(wrt.sphere((0.0, 1.0, 0.0), 0.5, subdivisions=2), material=wrt.Diffuse(opacity=0.0), emission=5.0)
    for strategy in ("mis", "light", "bsdf"):
        assert render(scene, device, spp=16, strategy=strategy).image().max() == 0.0


def pane(height: float, material: wrt.Material, half: float = 9.0) -> wrt.Shape:
    """A horizontal pane over the floor whose front faces up; u grows along x and v along −z."""
    return wrt.Shape(wrt.quad((-half, height, half), (2 * half, 0.0, 0.0), (0.0, 0.0, -2 * half)), material)


@pytest.mark.parametrize("panes", [1, 2, 3])
def test_panes_before_a_constant_sky(panes: int, device: str, report: Report) -> None:
    """Each lets 0.7 of what is behind through, and shows its reflectance times the sky's radiance in the rest."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=20)
    for i in range(panes):
        scene.shapes.append(pane(-0.1 * i, wrt.Diffuse(0.0, opacity=0.3), half=50.0))
    assert_mean(render(scene, device, spp=256), (2.0 * 0.7**panes,) * 3, report, f"sky through {panes} black panes")
    scene.shapes = [pane(0.0, wrt.Diffuse((0.1, 0.5, 0.9), opacity=0.3))]
    expected = tuple(2.0 * (0.7 + 0.3 * r) for r in (0.1, 0.5, 0.9))
    assert_mean(render(scene, device, spp=256), expected, report, "sky through a coloured pane")


PANES: dict[str, tuple[list[wrt.Material], float]] = {
    "0.4 opaque": ([wrt.Diffuse(opacity=0.4)], 0.6),
    "two panes": ([wrt.Diffuse(opacity=0.4), wrt.Mirror(opacity=0.7)], 0.6 * 0.3),
    "five panes": ([wrt.Diffuse(opacity=0.1)] * 5, 0.9**5),
    "glass, which shadow rays do not pass": ([wrt.Dielectric(1.5, opacity=0.25)], 0.75),
    "an opaque one behind": ([wrt.Diffuse(opacity=0.4), wrt.Diffuse()], 0.0),
    "a mixture with a part not opaque": ([wrt.Mix(wrt.Diffuse(opacity=0.5), wrt.Diffuse(), weight=0.2)], 0.8 * 0.5),
    "a mixture not opaque": (
        [wrt.Mix(wrt.Diffuse(opacity=0.5), wrt.Diffuse(), weight=0.2, opacity=0.3)],
        0.7 + 0.3 * 0.4,
    ),
    # Light from above is seen from below: shadow rays start at the floor and meet the back.
    "two sides": ([wrt.TwoSided(wrt.Diffuse(opacity=0.9), wrt.Diffuse(opacity=0.2))], 0.8),
    "all nested": ([chain(composite.MAX_NESTING)], expected_shares(chain(composite.MAX_NESTING))[0]),
}


@pytest.mark.parametrize("light", ["point", "directional"])
@pytest.mark.parametrize("name", PANES)
def test_shadows_of_panes_are_their_share(name: str, light: str, device: str) -> None:
    """Irradiance through panes is that without them times what they let through, sample by sample."""
    materials, share = PANES[name]
    images = []
    for panes in ([], materials):
        scene = floor_scene(eye=0.5)
        scene.add_light(
            wrt.PointLight((0.4, 1.8, -0.3), intensity=3.0)
            if light == "point"
            else wrt.DirectionalLight((0.3, -1.0, 0.2))
        )
        scene.shapes += [pane(1.0 + 0.1 * i, material, 4.0) for i, material in enumerate(panes)]
        images.append(irradiance(scene, device, 4)[1])
    assert images[0].min() > 0.0
    np.testing.assert_allclose(images[1], share * images[0], rtol=2e-5, atol=1e-9)


def test_shadow_of_a_textured_pane(device: str) -> None:
    """A light from straight above draws the texture's transparency on the floor, bilinearly filtered."""
    rng = np.random.default_rng(6)
    pixels = rng.random((5, 4, 3)).astype(np.float32)
    half = 1.7
    scene = floor_scene(eye=0.5)
    scene.add_light(wrt.DirectionalLight((0.0, -1.0, 0.0), irradiance=2.0))
    scene.shapes.append(pane(1.0, wrt.Diffuse(opacity=wrt.ImageTexture(pixels, channel="b")), half))
    opacity = np.pad(pixels[..., 2].astype(np.float64), 1, mode="wrap")

    def expected(x: NDArray, z: NDArray) -> NDArray:
        column, row = (x / (2 * half) + 0.5) * 4 + 0.5, (z / (2 * half) + 0.5) * 5 + 0.5
        j, i = np.floor(column).astype(int), np.floor(row).astype(int)
        fx, fy = column - j, row - i
        top = opacity[i, j] * (1 - fx) + opacity[i, j + 1] * fx
        bottom = opacity[i + 1, j] * (1 - fx) + opacity[i + 1, j + 1] * fx
        return 2.0 * (1.0 - top * (1 - fy) - bottom * fy)

    where, measured, variance = irradiance(scene, device, 2048)
    x, z = where
    nodes = np.linspace(-0.475, 0.475, 20) * (x[0, 1] - x[0, 0])
    mean = np.mean([expected(x + a, z + b) for a in nodes for b in nodes], axis=0)
    p = t_test_mean(measured, variance + (1e-4 * mean) ** 2, 2048, mean)
    assert p.min() > 0.01 / p.size
    assert np.ptp(mean) > 0.5


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_lamp_through_a_pane(strategy: str, device: str, report: Report) -> None:
    """All ways to find the lamp agree: shadow rays take shares, rays that are followed choose."""
    scene = floor_scene(eye=0.7)
    scene.add(wrt.quad((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8)), material=BLACK, emission=1.0)
    scene.shapes.append(pane(0.8, wrt.Diffuse(0.0, opacity=0.25), 20.0))
    spp = 2048
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    expected = 0.75 * pixel_mean(lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4)), where)
    check(f"rectangle through a pane, {strategy}", measured, variance, expected, spp, report)


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_lamp_partly_there(strategy: str, device: str, report: Report) -> None:
    """What shines is what is there: all of its left half, a quarter of its right one."""
    columns = np.repeat(np.float32([1.0] * 32 + [0.25] * 32)[None, :, None], 3, axis=2)
    scene = floor_scene(eye=0.7)
    scene.add(
        wrt.quad((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8)),
        material=wrt.Emissive(1.0, opacity=wrt.ImageTexture(columns)),
    )
    spp = 2048
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        # Between the halves, and at the seam of the repeated texture, opacity runs over 2 cm: less than noise.
        left = rectangle_irradiance(x + 0.3, z, 1.0, (0.3, 0.4))
        right = rectangle_irradiance(x - 0.3, z, 1.0, (0.3, 0.4))
        return left + 0.25 * right

    check(f"lamp partly there, {strategy}", measured, variance, pixel_mean(expected, where), spp, report)


def test_a_lamp_partly_there_is_seen_so(device: str, report: Report) -> None:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 4.0), fov_degrees=10))
    scene.add(wrt.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0)), material=wrt.Emissive((1.0, 2.0, 3.0), opacity=0.3))
    assert_mean(render(scene, device, spp=256), (0.3, 0.6, 0.9), report, "a lamp of opacity 0.3")


def test_sky_found_through_a_pane_by_sampling_it_or_not(device: str, report: Report) -> None:
    rng = np.random.default_rng(7)
    pixels = rng.uniform(0.0, 0.5, (8, 16, 3)).astype(np.float32)
    pixels[1:3, 4:6] = 10.0
    results = {}
    for strategy, spp in (("mis", 512), ("light", 512), ("bsdf", 2048)):
        scene = floor_scene(eye=0.7)
        scene.environment = wrt.ImageEnvironment(pixels)
        scene.shapes.append(pane(1.0, wrt.Diffuse(0.4, opacity=0.5), 2.0))
        renderer = render(scene, device, spp=spp, strategy=strategy, max_depth=4)
        results[strategy] = renderer.image(), renderer.variance()
    for other in ("light", "bsdf"):
        test = image_z_test(*results["mis"], *results[other])
        report(f"mis against {other}: pixels that agree", test.pass_fraction, ">= 0.995", p=test.p_min)
        assert test.pass_fraction >= 0.995, test.message
        assert test.mean_p > 0.005, test.message


def test_a_ray_among_crowded_panes_comes_to_an_end(device: str) -> None:
    """A thousand crossing panes with no opacity, all through one line: what is behind is seen, grazing or not."""
    rng = np.random.default_rng(8)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), fov_degrees=3)
    scene.add_light(wrt.DirectionalLight((0.0, 0.0, -1.0)))
    for angle in rng.uniform(0.0, 180.0, 1000):
        leaf = wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)).rotated((1.0, 0.0, 0.0), angle)
        scene.add(leaf, material=GHOST)
    image = render(scene, device, spp=16, size=8).image()
    np.testing.assert_array_equal(image, 1.0)


# --- Emission ---------------------------------------------------------------------------------------


def test_emissive_is_a_shape_that_emits(device: str) -> None:
    """Bit for bit."""
    lamp = wrt.quad((-0.5, 2.5, -0.5), (1, 0, 0), (0, 0, 1))
    by_shape, by_material = room(lamp=False), room(lamp=False)
    by_shape.add(lamp, material=BLACK, emission=(4.0, 3.0, 2.0))
    by_material.add(lamp, material=wrt.Emissive((4.0, 3.0, 2.0)))
    assert by_material.shapes[-1].emission == (4.0, 3.0, 2.0)
    images = [render(scene, device, spp=8).image() for scene in (by_shape, by_material)]
    np.testing.assert_array_equal(*images)
    assert images[0].max() > 0.0


def test_emission_of_the_shape_goes_before_that_of_the_material() -> None:
    shape = wrt.Shape(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), wrt.Emissive(2.0), emission=5.0)
    assert shape.emission == (5.0, 5.0, 5.0)
    assert wrt.Shape(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), wrt.Emissive(0.0)).emits is False


# --- What is refused, and what counts ---------------------------------------------------------------

REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "weight above 1": (lambda: wrt.Mix(A, B, weight=1.5), "weight must be at most 1, not 1.5"),
    "weight below 0": (lambda: wrt.Mix(A, B, weight=-0.5), "weight must be at least 0, not -0.5"),
    "weight of a colour": (lambda: wrt.Mix(A, B, weight=(1, 0, 0)), "weight must be a number"),
    "opacity above 1": (lambda: wrt.Mirror(opacity=2.0), "opacity must be at most 1, not 2"),
    "opacity of a text": (lambda: wrt.Mirror(opacity="all"), "opacity must be a number, not 'all'"),
    "a part that is none": (lambda: wrt.Mix(0.5, B), "first must be a wrt.Material, not float"),
    "a class for a part": (lambda: wrt.TwoSided(A, wrt.Mirror), "back must be a wrt.Material, not type"),
    "a part that shines": (
        lambda: wrt.Mix(A, wrt.Emissive(3.0)),
        "second must not emit light; give the shape an emission instead",
    ),
    "a side that shines": (lambda: wrt.TwoSided(wrt.Emissive(3.0)), "front must not emit light"),
    "8 deep": (lambda: full_tree(8), "materials are nested more than 7 deep"),
    "8 deep by sides": (lambda: wrt.TwoSided(chain(7)), "materials are nested more than 7 deep"),
    "emission below 0": (lambda: wrt.Emissive(-1.0), "radiance must be at least 0"),
    "channel": (
        lambda: wrt.ImageTexture(np.ones((1, 1, 3)), "wood", "red"),
        "texture wood: channel must be 'r', 'g' or 'b', not 'red'",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused(name: str) -> None:
    make, message = REFUSED[name]
    with pytest.raises(wrt.InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nothing_else_can_be_made_of_materials(device: str) -> None:
    @dataclasses.dataclass(frozen=True)
    class Stack(wrt.Material):
        type_name = "stack"

        @property
        def parts(self) -> tuple[wrt.Material, ...]:
            return (A, B)

    with pytest.raises(wrt.InputError, match="Stack: only a Mix or a TwoSided can be made of other materials"):
        Hit(Stack(), device)


def test_host_and_device_agree_how_deep_nesting_goes() -> None:
    assert composite.MAX_NESTING == device_materials.MAX_NESTING


CHANGED = {
    "weight": wrt.Mix(A, B, weight=0.5),
    "order": wrt.Mix(B, A, weight=0.4),
    "a part": wrt.Mix(A, wrt.Diffuse((0.1, 0.7, 0.4)), weight=0.4),
    "opacity": wrt.Mix(A, B, weight=0.4, opacity=0.9),
    "opacity of a part": wrt.Mix(A, dataclasses.replace(B, opacity=0.9), weight=0.4),
    "kind": wrt.TwoSided(A, B),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_checkpoint_knows_what_a_material_is_made_of(name: str) -> None:
    before, after = (scene_fingerprint(ball_scene(m)) for m in (wrt.Mix(A, B, weight=0.4), CHANGED[name]))
    assert {key for key in before if before[key] != after[key]} == {"materials"}


def test_a_checkpoint_knows_the_channel() -> None:
    texture = wrt.ImageTexture(np.ones((1, 1, 3)))
    before, after = (
        scene_fingerprint(ball_scene(wrt.Diffuse(opacity=t)))
        for t in (texture, dataclasses.replace(texture, channel="g"))
    )
    assert before["materials"] != after["materials"]
