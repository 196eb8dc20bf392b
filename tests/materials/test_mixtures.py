"""Mixtures, two-sided and emissive materials: their parts show in the stated shares."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.composites import BLACK, ROOM, WITH_OPACITY, A, B, C, chain, expected_shares, render, room
from support.covering_kernels import render_with
from support.hits import Hit

import wrt
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows
from wrt.kernels.materials import choice as device_materials
from wrt.rendering.checkpoint import scene_fingerprint
from wrt.scene.materials import composite

N = 2**16
EVEN = ((np.arange(N) + 0.5) / N).astype(np.float32)
"""Every random number as often as any other: shares come out to one in N for each border between two answers."""
EXTREMES = np.array([0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24], np.float32)

METAL = wrt.RoughConductor(0.4, masking="smith-separable")
WHITE = wrt.ImageTexture(np.ones((1, 1, 3)))

# --- Which material answers -------------------------------------------------------------------------

NESTED = {
    "a mixture": wrt.Mix(A, B, weight=0.3),
    "opacity of a mixture and of its parts": wrt.Mix(
        wrt.Diffuse(0.5, opacity=0.25), wrt.Mirror(opacity=0.5), weight=0.75, opacity=0.8
    ),
    "two sides, one of them a mixture": wrt.TwoSided(A, wrt.Mix(B, C, weight=0.2), opacity=0.9),
    "a mixture of two-sided ones": wrt.Mix(wrt.TwoSided(A, B), wrt.TwoSided(C, wrt.Diffuse(opacity=0.1)), weight=0.6),
    "7 deep": chain(composite.MAX_NESTING),
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
    hole = Hit(wrt.Diffuse(opacity=0.0), device).choose(EXTREMES)
    assert (hole.share(None), set(hole.passed)) == (1.0, {1.0})
    solid = Hit(wrt.Mix(A, B, opacity=WHITE), device).choose(EXTREMES)
    assert (solid.share(None), set(solid.passed)) == (0.0, {0.0})


def test_numbers_left_over_stay_below_one(device: str) -> None:
    """A number is stretched to choose again further in; rounded up to 1 it would pass what is wholly there."""
    last = np.float32(1.0) - np.float32(2.0) ** np.float32(-24) * np.arange(1, 65, dtype=np.float32)
    solid = wrt.Diffuse(opacity=WHITE)
    for weight in np.random.default_rng(1).random(200):
        for material in (wrt.Mix(solid, A, weight=weight), wrt.Mix(A, solid, weight=weight)):
            below = (np.float32(weight) * last).astype(np.float32)
            assert Hit(material, device).choose(np.concatenate([last, below])).share(None) == 0.0


@pytest.mark.parametrize("channel", [None, "g", "b"])
def test_weight_and_opacity_may_be_textures_of_one_channel(channel: str | None, device: str) -> None:
    """2 × 2 texels, asked at their centres and, for the interpolation, between them; without a name red is taken."""
    pixels = np.random.default_rng(2).random((2, 2, 3)).astype(np.float32)
    texture = wrt.ImageTexture(pixels, channel=channel)
    number = pixels[..., "rgb".index(channel or "r")]
    for uv, value in (((0.25, 0.75), number[0, 0]), ((0.75, 0.25), number[1, 1]), ((0.5, 0.25), number[1].mean())):
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


# --- Pictures ---------------------------------------------------------------------------------------


@pytest.fixture
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([WITH_OPACITY], monkeypatch)


def ball_scene(material: wrt.Material, *, inside_out: bool = False) -> wrt.Scene:
    """A convex body that fills the picture, under a sky of radiance 2."""
    ball = wrt.sphere(subdivisions=3)
    mesh = wrt.Mesh(ball.vertices, ball.faces[:, ::-1] if inside_out else ball.faces)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=10)
    scene.add(mesh, material=material)
    return scene


@pytest.mark.usefixtures("one_kernel")
def test_a_mixture_of_one_material_is_that_material(device: str) -> None:
    """Bit for bit: the choice takes random numbers of its own."""
    images = [render(ball_scene(material), device, spp=16).image() for material in (wrt.Mix(A, A, weight=0.3), A)]
    np.testing.assert_array_equal(*images)


@pytest.mark.usefixtures("one_kernel")
def test_each_side_has_its_own_material_and_the_back_is_black_unless_given(device: str) -> None:
    for material, inside_out, expected in (
        (wrt.TwoSided(A, B), False, A.reflectance),
        (wrt.TwoSided(A, B), True, B.reflectance),
        (wrt.TwoSided(A), True, (0.0, 0.0, 0.0)),
    ):
        image = render(ball_scene(material, inside_out=inside_out), device, spp=4).image()
        np.testing.assert_allclose(image, np.broadcast_to(2.0 * np.array(expected), image.shape), rtol=1e-5)


@pytest.mark.usefixtures("one_kernel")
def test_emissive_is_a_shape_that_emits(device: str) -> None:
    """Bit for bit; an emission of the shape goes before that of its material."""
    lamp = wrt.quad((-0.5, 2.5, -0.5), (1, 0, 0), (0, 0, 1))
    by_shape, by_material = room(ROOM[:3]), room(ROOM[:3])
    by_shape.add(lamp, material=BLACK, emission=(4.0, 3.0, 2.0))
    by_material.add(lamp, material=wrt.Emissive((4.0, 3.0, 2.0)))
    assert by_material.shapes[-1].emission == (4.0, 3.0, 2.0)
    images = [render(scene, device, spp=8).image() for scene in (by_shape, by_material)]
    np.testing.assert_array_equal(*images)
    assert images[0].max() > 0.0
    assert wrt.Shape(lamp, wrt.Emissive(2.0), emission=5.0).emission == (5.0, 5.0, 5.0)
    assert not wrt.Shape(lamp, wrt.Emissive(0.0)).emits


# --- What is refused, and what counts ---------------------------------------------------------------


def test_nothing_else_can_be_made_of_materials(device: str) -> None:
    @dataclasses.dataclass(frozen=True)
    class Stack(wrt.Material):
        type_name = "stack"

        @property
        def parts(self) -> tuple[wrt.Material, ...]:
            return (A, B)

    with pytest.raises(wrt.InputError, match="Stack: only a Mix or a TwoSided can be made of other materials"):
        Hit(Stack(), device)
    assert composite.MAX_NESTING == device_materials.MAX_NESTING


def test_a_checkpoint_knows_what_a_material_is_made_of() -> None:
    different = [
        wrt.Mix(A, B, weight=0.4),
        wrt.Mix(A, B, weight=0.5),
        wrt.Mix(B, A, weight=0.4),
        wrt.Mix(A, dataclasses.replace(B, opacity=0.9), weight=0.4),
        wrt.TwoSided(A, B),
        *(wrt.Diffuse(opacity=dataclasses.replace(WHITE, channel=channel)) for channel in (None, "g")),
    ]
    found = [scene_fingerprint(ball_scene(material)) for material in different]
    assert len({each["materials"] for each in found}) == len(different)


# --- Kernels without holes have the bits of kernels with them --------------------------------------


def sides() -> wrt.Scene:
    """Return a scene of one-sided materials, a nested one among them, as files of Mitsuba give them."""
    return room((wrt.TwoSided(A, BLACK), wrt.TwoSided(METAL, BLACK), wrt.TwoSided(B, wrt.TwoSided(BLACK, A)), A))


def mixed() -> wrt.Scene:
    mix = wrt.Mix(A, METAL, weight=0.4)
    return room((mix, wrt.TwoSided(mix, B), wrt.Mix(mix, BLACK, weight=0.3), mix))


class WithHoles(wrt.Renderer):
    """A renderer whose kernel allows for holes."""

    def _choose_kernel(self, features: Any, compile: Callable[[Any], None], read: Any = None) -> Any:
        assert not features.has_holes
        return super()._choose_kernel(dataclasses.replace(features, composite="holes"), compile, read)


@pytest.mark.machinery
@pytest.mark.parametrize("make", [sides, mixed])
def test_the_bits_are_those_with_holes(make: Callable[[], wrt.Scene]) -> None:
    """Of layers, too: these are chosen by the same numbers as the parts that paths meet."""
    films = []
    for kind in (wrt.Renderer, WithHoles):
        renderer = kind(make(), width=40, height=30, layers=("albedo", "normal", "material"))
        assert can_attenuate_shadows(renderer._kernel._features) == (kind is WithHoles)
        for _ in renderer.passes(spp=20):
            pass
        assert renderer.image().max() > 0.0
        films.append({**renderer.film.state(), "rays": renderer.film.data.rays.numpy()})
    assert {name: array.tobytes() for name, array in films[0].items()} == {k: a.tobytes() for k, a in films[1].items()}
