"""Composite materials without holes cost no more than they must, and have the bits of kernels that allow for holes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest
from support.wide_scenes import wide_kernel

import wrt
from wrt.backend.lanes import lanes_of
from wrt.backend.processor import processor_flags
from wrt.kernels.integrators.shadow_rays import can_attenuate_shadows
from wrt.upload.materials import describe_materials

BLACK = wrt.Diffuse(0.0)


def room(*materials: wrt.Material, lamp: wrt.Material) -> wrt.Scene:
    """Return a room with open boxes that show both of their sides, and a lamp that shows its back."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.3, 1.1, 4.2), (0.0, 0.8, 0.0), fov_degrees=50.0))
    scene.environment = wrt.ConstantEnvironment((0.2, 0.25, 0.3))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=materials[0])
    scene.add(wrt.quad((-0.4, 1.9, -0.3), (0.8, 0, 0), (0, 0, 0.8)), material=lamp, emission=(9.0, 8.0, 6.0))
    for k, material in enumerate(materials):
        x = 1.3 * k - 1.3
        scene.add(wrt.quad((x, 0.0, -0.5), (0.9, 0.0, 0.4), (0.0, 1.0, 0.1)), material=material)
        scene.add(wrt.quad((x, 0.0, 0.6), (0.5, 0.0, -0.6), (0.0, 0.6, 0.0)), material=material)
    return scene


def sides() -> wrt.Scene:
    """Return a scene of one-sided materials, a nested one among them, as files of Mitsuba give them."""
    green = wrt.TwoSided(wrt.Diffuse((0.2, 0.7, 0.3)), BLACK)
    gold = wrt.TwoSided(wrt.RoughConductor(0.3, metal="gold"), BLACK)
    both = wrt.TwoSided(wrt.Diffuse(0.6), wrt.TwoSided(BLACK, wrt.Diffuse((0.7, 0.1, 0.1))))
    return room(wrt.Diffuse(0.5), green, gold, both, lamp=wrt.TwoSided(wrt.Diffuse(0.4), BLACK))


def mixed() -> wrt.Scene:
    gold = wrt.RoughConductor(0.3, metal="gold")
    mix = wrt.Mix(wrt.Diffuse(0.6), gold, weight=0.4)
    return room(mix, wrt.TwoSided(mix, wrt.Diffuse(0.3)), wrt.Mix(mix, BLACK, weight=0.3), lamp=mix)


class WithHoles(wrt.Renderer):
    """A renderer whose kernel allows for holes."""

    def _choose_kernel(self, features: Any, compile: Callable[[Any], None], read: Any = None) -> Any:
        assert not features.opacity
        return super()._choose_kernel(dataclasses.replace(features, opacity=True, composite="none"), compile, read)


def film(renderer: wrt.Renderer) -> dict[str, bytes]:
    for _ in renderer.passes(spp=20):
        pass
    assert renderer.image().max() > 0.0
    state = {name: array.tobytes() for name, array in renderer.film.state().items()}
    return {**state, "rays": renderer.film.data.rays.numpy().tobytes()}


@pytest.mark.parametrize(
    ("materials", "expected"),
    [
        ([wrt.Diffuse()], (False, "none")),
        ([wrt.Diffuse(), wrt.TwoSided(wrt.Diffuse(), BLACK)], (False, "sides")),
        ([wrt.TwoSided(wrt.Mix(wrt.Diffuse(), wrt.Mirror()), BLACK)], (False, "mixed")),
        ([wrt.TwoSided(wrt.Diffuse(opacity=0.5), BLACK)], (True, "none")),
        ([wrt.Diffuse(opacity=0.5)], (True, "none")),
    ],
)
def test_kernels_have_what_materials_need(materials: list[wrt.Material], expected: tuple[bool, str]) -> None:
    table = describe_materials(materials)
    assert (table.opacity, table.composite) == expected


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "whitted"])
@pytest.mark.parametrize("make", [sides, mixed])
def test_the_bits_are_those_with_holes(make: Callable[[], wrt.Scene], integrator: str) -> None:
    options: dict[str, Any] = {"width": 40, "height": 30, "integrator": integrator}
    renderer = wrt.Renderer(make(), **options)
    assert not can_attenuate_shadows(renderer._kernel._features)
    assert film(renderer) == film(WithHoles(make(), **options))


@pytest.mark.slow
@pytest.mark.parametrize("make", [sides, mixed])
def test_layers_too(make: Callable[[], wrt.Scene]) -> None:
    """They are chosen by the same numbers as the parts that paths meet."""
    options: dict[str, Any] = {"width": 40, "height": 30, "layers": ("albedo", "normal", "material")}
    assert film(wrt.Renderer(make(), **options)) == film(WithHoles(make(), **options))


@pytest.mark.slow
@pytest.mark.skipif(not lanes_of(processor_flags()), reason="the processor has no such registers")
@pytest.mark.parametrize("make", [sides, mixed])
def test_the_wide_kernel_has_the_same_bits(make: Callable[[], wrt.Scene]) -> None:
    renderer = wrt.Renderer(make(), width=45, height=31, threads=1)
    start = renderer.film.state()
    scalar = film(renderer)
    renderer.film.restore(start)
    renderer.film.data.rays.zero_()
    kernel, threads = wide_kernel(renderer, lanes_of(processor_flags()))
    renderer.device.launch(kernel, threads, [20, *renderer._inputs])
    wide = {name: array.tobytes() for name, array in renderer.film.state().items()}
    assert {**wide, "rays": renderer.film.data.rays.numpy().tobytes()} == scalar
