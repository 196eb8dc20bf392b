"""Mixtures, two sides and materials that shine: what they are made of shows in the stated shares."""

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

import wrt
from wrt.kernels.scene import materials as device_materials
from wrt.rendering.fingerprint import scene_fingerprint
from wrt.scene.materials import composite

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
    from wrt.kernels.sampling.sampler import BLOCKS_PER_PATH

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


def to_mitsuba(material: wrt.Material) -> object:
    from peers.mitsuba_scene import _bsdf, load_mitsuba

    return load_mitsuba().load_dict(_bsdf(material))


METAL = wrt.RoughConductor(0.4, masking="smith-separable")
BOTH_HAVE = {
    "blendbsdf": wrt.Mix(A, METAL, weight=0.3),
    "mask": wrt.Diffuse((0.8, 0.1, 0.2), opacity=0.35),
    "mask of blendbsdf of masks": wrt.Mix(
        wrt.Diffuse(0.5, opacity=0.25), wrt.RoughConductor(0.2, masking="smith-separable", opacity=0.5), opacity=0.8
    ),
    "twosided": wrt.TwoSided(A, METAL),
    "blendbsdf of twosided": wrt.Mix(wrt.TwoSided(A, METAL), wrt.TwoSided(B, A), weight=0.8),
}


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", BOTH_HAVE)
def test_values_and_densities_are_those_of_mitsuba(name: str, front: bool, device: str) -> None:
    """At a thousand pairs of directions; Mitsuba's frame is that of the front, wrt's that of the viewer."""
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    bsdf = to_mitsuba(BOTH_HAVE[name])
    import mitsuba as mi

    wo, wi = hemisphere(1000, seed=3), hemisphere(1000, seed=4)
    even = (np.arange(2000) + 0.5) / 2000  # weights are whole parts of it
    value, pdf = Hit(BOTH_HAVE[name], device, front=front).evaluate(even, wo, wi)
    flip = np.array([1.0, 1.0, 1.0 if front else -1.0])
    there = mi.SurfaceInteraction3f()
    context = mi.BSDFContext()
    expected = np.empty((1000, 4))
    for i, (o, w) in enumerate(zip(wo * flip, wi * flip, strict=True)):
        there.wi = mi.Vector3f(*o)
        direction = mi.Vector3f(*w)
        expected[i] = (*bsdf.eval(context, there, direction), bsdf.pdf(context, there, direction))  # type: ignore[attr-defined]
    np.testing.assert_allclose(value, expected[:, :3], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(pdf, expected[:, 3], rtol=1e-4, atol=1e-6)


def render(scene: wrt.Scene, device: str, spp: int = 64, size: int = 16, **options: object) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, sampler="independent", width=size, height=size, device=device, seed=5, **options)  # type: ignore[arg-type]
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


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


@pytest.mark.slow
def test_direct_light_on_a_mixture_is_the_mean_of_that_on_its_parts(device: str, report: Report) -> None:
    """Pixel by pixel, also of parts that reflect into single directions, where shadow rays find nothing."""

    def ball_in_room(material: wrt.Material, max_depth: int) -> tuple[NDArray, NDArray]:
        scene = room()
        scene.shapes[2] = dataclasses.replace(scene.shapes[2], material=material)
        renderer = render(scene, device, spp=512, size=24, max_depth=max_depth)
        return renderer.image().astype(np.float64), renderer.variance()

    # As long as a path can meet the ball but once: a ray inside glass would meet it again.
    for a, b, depth in ((wrt.Mirror(0.9), A, 3), (wrt.Dielectric(1.5), B, 2), (wrt.Mirror(0.9), METAL, 3)):
        (image_a, variance_a), (image_b, variance_b) = ball_in_room(a, depth), ball_in_room(b, depth)
        image, variance = ball_in_room(wrt.Mix(a, b, weight=0.3), depth)
        expected, expected_variance = 0.7 * image_a + 0.3 * image_b, 0.49 * variance_a + 0.09 * variance_b
        result = image_z_test(image, variance, expected, expected_variance, n_a=512, n_b=512)
        report(f"{a.type_name} and {b.type_name}: mean, per cent", f"{100 * result.relative_difference[1]:+.3f}", 0)
        assert result.agrees(), result.message


@pytest.mark.slow
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
        "texture wood: channel must be one of r, g, b, not 'red'",
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


def test_roughness_of_one_channel_is_the_same_along_both_axes() -> None:
    pixels = np.random.default_rng(9).random((2, 2, 3)).astype(np.float32)
    assert wrt.RoughConductor(wrt.ImageTexture(pixels)).needs_tangents
    for channel in "rgb":
        assert not wrt.RoughConductor(wrt.ImageTexture(pixels, channel=channel)).needs_tangents
