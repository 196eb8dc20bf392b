"""Light that facets block bounces on: white surfaces stay white, and metals get their colour more than once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from support.bsdfs import ANGLES, albedo, hemisphere
from support.kernels import uniforms
from test_rough_conductor import WHITE, metal

import wrt
from wrt.backend.device import Device
from wrt.kernels.bsdf.lobes.albedo import VALUES
from wrt.scene.materials.presets import metal_f0
from wrt.upload.scene_data import build_scene
from wrt.upload.tables import material_tables as tables
from wrt.upload.tables.material_tables import pack_tables

pytestmark = pytest.mark.slow

ROUGHNESSES = (1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_white_furnace(distribution: str, device: str, report: Report) -> None:
    """A white surface reflects all light within 1 %, at every roughness and angle."""
    for alpha in (*ROUGHNESSES, (0.05, 0.5), (1.0, 0.01)):
        row = []
        for degrees in (*ANGLES, 89.9):
            mean, error = albedo(metal(alpha, distribution, **WHITE), degrees, device, samples=2**16)
            single, _ = albedo(metal(alpha, distribution, f0=1.0), degrees, device, samples=2**13)
            row.append(f"{single[0]:.3f}→{mean[0]:.4f}")
            assert abs(mean[0] - 1.0) < 0.01, (alpha, degrees)
            assert error[0] < 0.0025
        report(f"{distribution} {alpha}: albedo by one bounce → by all at 0, 45, 80, 89, 89.9°", "  ".join(row), 1)


@pytest.mark.parametrize(
    ("alpha", "distribution", "masking"),
    [((100.0, 1.2), "abc", "cook-torrance"), ((0.1, 0.6), "sgd", "kelemen"), (0.3, "blinn-phong", "walter")],
)
def test_other_distributions_are_white_too(
    alpha: object, distribution: str, masking: str, device: str, report: Report
) -> None:
    """But where one bounce alone reflects more than it gets, as masking that ignores the distribution may let it."""
    for degrees in (0.0, 45.0, 80.0):
        single, _ = albedo(metal(alpha, distribution, masking, f0=1.0), degrees, device, samples=2**18)
        mean, error = albedo(metal(alpha, distribution, masking, **WHITE), degrees, device, samples=2**18)
        report(f"{distribution} at {degrees:g}°: one bounce, all", float(single[0]), float(mean[0]))
        assert abs(mean[0] - max(single[0], 1.0)) < 0.01 + 3.0 * error[0]


def test_missing_energy_has_its_closed_form(device: str) -> None:
    """GGX of α = 1 straight on: D = 1/π, Λ = (1/μ − 1)/2, so that E = ∫ μ/(1 + μ) dμ = 1 − ln 2."""
    values, places = pack_tables([("reflection", "ggx", "smith", None)], Device(device))
    assert places == {("reflection", "ggx", "smith", None): 0}
    missing = values[VALUES : VALUES + 1024].reshape(32, 32)
    assert missing[-1, -1] == pytest.approx(math.log(2.0), abs=1e-4)
    assert (missing >= 0.0).all()
    # Rougher surfaces lose more straight on, and a mirror nothing.
    assert (np.diff(missing[-1]) > -1e-4).all()
    assert missing[-1, 0] < 1e-5


def test_bounces_colour_the_light_as_often_as_they_happen(device: str, report: Report) -> None:
    """Reflectance F at each bounce: of the share that got away after bounce k, E_avg (1 − E_avg)^(k−1), F^k is left.

    Averages over the hemisphere, by which the lobe is made: of one bounce F E_avg, of all others the lobe's own.
    """
    values, _ = pack_tables([("reflection", "ggx", "smith", None)], Device(device))
    escapes = 1.0 - float(values[VALUES - 1])
    # A reflectance that does not depend on the angle: white metal with a factor.
    for factor in (0.25, 0.5, 0.9, 1.0):
        # Directions of density cosθ/π see the average over the hemisphere.
        wo = hemisphere(2**17, seed=40)
        wo[:, 2] = np.sqrt(uniforms(len(wo), 1, seed=41)[:, 0])
        wo[:, :2] *= (np.sqrt(1.0 - wo[:, 2] ** 2) / np.hypot(wo[:, 0], wo[:, 1]))[:, None]
        found = metal(1.0, reflectance=factor, **WHITE).sample(wo, uniforms(len(wo), 3, seed=42), device)
        weight = found["weight"][:, 0].astype(np.float64)
        error = weight.std() / math.sqrt(len(weight))
        series = sum(escapes * (1.0 - escapes) ** (k - 1) * factor**k for k in range(1, 200))
        report(f"reflectance {factor:g} a bounce", float(weight.mean()), series)
        assert abs(weight.mean() - series) < 4.0 * error + 2e-3


def test_metals_get_brighter_and_more_saturated(device: str) -> None:
    one, _ = albedo(metal(1.0, metal="gold"), 30.0, device)
    every, error = albedo(metal(1.0, metal="gold", multiple_bounces=True), 30.0, device)
    assert (every > one * 1.05).all()
    assert every[2] / every[0] < one[2] / one[0] - 0.01
    assert (every <= np.array(metal_f0("gold")) + 0.05 + 3.0 * error).all()


def test_tables_are_made_once(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    key, other = ("reflection", "ggx", "smith", None), ("reflection", "ggx", "smith", (0.05, 0.5, 0.0))
    where = Device(device)
    first, _ = pack_tables([key, other], where)
    monkeypatch.setattr(tables, "MAKERS", {})
    second, places = pack_tables([None, key, other, key], where)
    np.testing.assert_array_equal(first, second)
    assert places == {key: 0, other: len(second) // 2}


def test_a_scene_of_two_tables_is_white(device: str) -> None:
    """Every picture of a white furnace is white, here by two surfaces whose tables lie one behind the other."""
    camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=30.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    for x, alpha in ((-2.0, (0.2, 0.9)), (0.0, 0.8)):
        scene.add(wrt.quad((x, -2, 0), (2, 0, 0), (0, 4, 0)), material=wrt.RoughConductor(alpha, **WHITE))
    built = build_scene(scene, Device(device))
    assert built.features.tangents
    assert len(built.data.tables) > 4000
    renderer = wrt.Renderer(scene, sampler="independent", width=8, height=8, device=device)
    for _ in renderer.passes(spp=1024):
        pass
    image, error = renderer.image(), np.sqrt(renderer.variance())
    np.testing.assert_array_less(np.abs(image - 1.0), 0.01 + 4.5 * error)
    assert abs(image.mean() - 1.0) < 0.01
