"""Bodies within one another, overlapping and touching: by priority, refracted by what really is on both sides."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from conftest import Report
from support.covering_kernels import rendering_with
from support.media import FAR, KERNELS, mean_and_error, render, stage

import wrt

AIR, GLASS, WATER, ICE = 1.0, 1.5, 1.33, 1.31
TINTS = {"glass": (0.3, 0.5, 0.9), "water": (1.0, 0.4, 0.2), "ice": (0.1, 0.2, 2.0)}
ICE_BODY = wrt.Dielectric(ICE, interior=wrt.Medium(TINTS["ice"]), priority=2)
WATER_BODY = wrt.Dielectric(WATER, interior=wrt.Medium(TINTS["water"]), priority=1)


few_kernels = rendering_with(*KERNELS)


def layer(top: float, bottom: float, size: float = 60.0) -> wrt.Mesh:
    return wrt.box((-size, -size, bottom), (size, size, top))


def tinted_stage(**options: object) -> wrt.Scene:
    """A stage with a speck of a tinted body, so that all tests share a kernel."""
    scene = stage(**options)  # type: ignore[arg-type]
    scene.add(wrt.box((FAR, 9.0, 0.0), (FAR + 0.5, 9.5, 0.5)), material=WATER_BODY)
    return scene


# How far the water reaches into the glass above it and into the ice: not at all, so that faces coincide, by as much as
# rays keep from surfaces, and by more.
OVERLAPS = [0.0, 1e-5, 1e-3]


@pytest.mark.slow
@pytest.mark.parametrize("overlap", OVERLAPS)
def test_refraction_through_layers(overlap: float, device: str, report: Report) -> None:
    """Air, glass, water, ice, and a glowing floor: by Snell's law, the formula of layers, and Beer's law in each.

    Boundaries reflect nothing (specular_reflectance 0), so all light came straight up: the floor's radiance times n²
    of air over n² of ice, times the transmittance of each boundary and each layer.
    """
    a = math.radians(70.0)
    scene = tinted_stage(origin=(3.0 * math.sin(a), 0.0, 3.0 * math.cos(a)), fov_degrees=1e-4)
    layers = [("glass", GLASS, 0.0, 0.2), ("water", WATER, 0.2, 0.5), ("ice", ICE, 0.5, 0.9)]
    for (name, ior, top, bottom), priority in zip(layers, (3, 1, 2), strict=True):
        grow = overlap if name == "water" else 0.0
        body = wrt.Dielectric(ior, interior=wrt.Medium(TINTS[name]), priority=priority, specular_reflectance=0.0)
        scene.add(layer(-top + grow, -bottom - grow), material=body, name=name)
    # The ground, a little above the lower face of the ice.
    glow = wrt.quad((-60, -60, -0.899), (120, 0, 0), (0, 120, 0))
    scene.add(glow, material=wrt.Diffuse(0.0), emission=(1.0, 2.0, 3.0))
    mean, error = mean_and_error(render(scene, device, size=(32, 32), spp=256))

    def seen(indices: tuple[float, ...]) -> np.ndarray:
        result = np.array([1.0, 2.0, 3.0]) / indices[-1] ** 2
        sin_air = math.sin(a)
        for n1, n2 in itertools.pairwise(indices):
            c1, c2 = (math.sqrt(1.0 - (sin_air / n) ** 2) for n in (n1, n2))
            r_s, r_p = (n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2), (n2 * c1 - n1 * c2) / (n2 * c1 + n1 * c2)
            result = result * (1.0 - 0.5 * (r_s**2 + r_p**2))
        for (name, _, top, bottom), n in zip(layers, indices[1:], strict=True):
            thickness = min(bottom, 0.899) - top
            result = result * np.exp(-np.array(TINTS[name]) * thickness / math.sqrt(1.0 - (sin_air / n) ** 2))
        return result

    expected = seen((AIR, GLASS, WATER, ICE))
    report(f"overlap {overlap:g}", str(mean.round(5)), str(expected.round(5)))
    tolerance = 3.5 * error + expected * (3e-5 + 2.0 * overlap)
    assert (np.abs(mean - expected) < tolerance).all()
    assert (np.abs(mean - seen((AIR, GLASS, AIR, ICE))) > tolerance).all()


@pytest.mark.slow
@pytest.mark.parametrize("overlap", [0.0, 1e-5, -1e-2])
def test_no_seam_between_water_and_glass(overlap: float, device: str, report: Report) -> None:
    """Along a row of pixels across a ball of water in a hollow of glass no line is darker or brighter.

    All have one index and one medium here, so the picture equals a plain block unless boundaries are missed or doubled.
    """
    medium = wrt.Medium((0.5, 1.0, 2.0))
    outer = wrt.Dielectric(1.5, interior=medium, priority=2)
    hollow = wrt.sphere((0.0, 0.0, 0.0), 0.4, subdivisions=3)
    ball = wrt.Mesh((hollow.vertices * (1.0 + overlap / 0.4)).astype(np.float32), hollow.faces)
    renderers = []
    for is_plain in (False, True):
        scene = tinted_stage(sky=1.0, fov_degrees=30.0)
        scene.add(layer(0.5, -0.5, 4.0), material=outer, name="glass")
        if not is_plain:
            scene.add(wrt.Mesh(hollow.vertices, hollow.faces[:, ::-1]), material=outer, name="hollow")
            scene.add(ball, material=wrt.Dielectric(1.5, interior=medium, priority=1), name="water")
        renderers.append(render(scene, device, size=(192, 3), spp=256, seed=3))
    a, b = renderers
    difference = np.abs(a.image() - b.image()) / np.maximum(np.sqrt(a.variance() + b.variance()), 1e-5)
    report(f"overlap {overlap:g}: worst pixel, standard errors", float(difference.max()))
    # A gap of a centimetre is seen.
    assert (difference.max() < 5.0) == (overlap >= 0.0)


@pytest.mark.slow
def test_nested_bodies_in_a_furnace_cannot_be_seen(device: str, report: Report) -> None:
    """Glass with water in its hollow and ice in the water, all without absorption, under an even sky."""
    scene = tinted_stage(sky=1.0, origin=(1.8, 1.3, 3.0), fov_degrees=30.0)

    def block(half: float) -> wrt.Mesh:
        return wrt.box((-half, -0.8 * half, -0.9 * half), (half, 0.8 * half, 0.9 * half))

    glass = wrt.Dielectric(GLASS, priority=3)
    hollow = block(0.5)
    scene.add(block(0.7), material=glass)
    scene.add(wrt.Mesh(hollow.vertices, hollow.faces[:, ::-1]), material=glass)
    scene.add(block(0.501), material=wrt.Dielectric(WATER, priority=1))
    scene.add(block(0.3), material=wrt.Dielectric(ICE, priority=2))
    mean, error = mean_and_error(render(scene, device, size=(32, 32), spp=256, max_depth=1000))
    report("mean radiance", float(mean[0]), 1.0)
    assert abs(mean[0] - 1.0) < 3.0 * max(error[0], 1e-6)


@pytest.mark.slow
def test_the_camera_under_water(device: str) -> None:
    """A camera in water, in which ice floats, sees the ice's boundary by the ratio of both indices, and the water's
    medium before it."""
    scene = stage(sky=0.0, origin=(0.0, 0.0, 3.0), fov_degrees=1e-4)
    scene.add(layer(5.0, -5.0), material=WATER_BODY)
    scene.add(layer(1.0, -1.0), material=ICE_BODY)
    glow = wrt.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0))
    scene.add(glow, material=wrt.Diffuse(0.0), emission=1.0)
    mean, error = mean_and_error(render(scene, device, size=(32, 32), spp=64, max_depth=2))
    r = ((WATER - ICE) / (WATER + ICE)) ** 2
    expected = (1.0 - r) * (WATER / ICE) ** 2 * np.exp(-2.0 * np.array(TINTS["water"]) - np.array(TINTS["ice"]))
    assert (np.abs(mean - expected) < 3.5 * error + 3e-5 * expected).all()


def test_tables_of_one_index_are_refused() -> None:
    scene = stage(sky=1.0)
    rough = wrt.RoughDielectric(multiple_bounces=True, priority=1)
    scene.add(layer(1.0, -1.0), material=rough, name="ground glass")
    with pytest.raises(wrt.InputError, match="ground glass: multiple_bounces needs a fixed index outside"):
        wrt.Renderer(scene, width=2, height=2)
