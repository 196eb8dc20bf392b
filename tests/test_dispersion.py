"""Dispersion: each channel is refracted by an index of its own, as if it were rendered alone.

A picture with dispersion must have the red of a picture by the index of red alone, the green of another by that of
green, and the blue of a third; a prism must send three colours where Snell's law does; and no light may be lost.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, assert_finite, assert_weights, chi_square
from support.statistics import image_z_test, sidak, t_test_mean

import wrt
from wrt.errors import InputError
from wrt.io.measured.observer import OBSERVER, WAVELENGTHS
from wrt.scene.materials.dispersion import LINE_C, LINE_D, LINE_F, PRIMARIES, channel_indices
from wrt.upload.integrators import choose_integrator

CHANNELS = ("red", "green", "blue")

# --- Indices ----------------------------------------------------------------------------------------


def test_wavelengths_are_those_of_the_primaries() -> None:
    """The line from white through a primary of Rec. 709 meets the spectral locus at the primary's wavelength."""
    locus = OBSERVER[:, :2] / OBSERVER.sum(axis=1, keepdims=True)
    white = np.array([0.3127, 0.3290])
    for primary, wavelength in zip(((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)), PRIMARIES, strict=True):
        at = np.array([np.interp(wavelength, WAVELENGTHS, column) for column in locus.T]) - white
        toward = np.array(primary) - white
        turn = np.arctan2(toward[0] * at[1] - toward[1] * at[0], toward @ at)
        assert abs(turn) < 2e-3


@pytest.mark.parametrize(("ior", "abbe"), [(1.5, 59.0), (2.42, 55.0), (2.6, 9.8)])
def test_indices_solve_cauchys_equation(ior: float, abbe: float) -> None:
    """A + B / λ² through n_d, with n_F − n_C as the Abbe number says: two equations for two unknowns."""
    a, b = np.linalg.solve([[1.0, LINE_D**-2], [0.0, LINE_F**-2 - LINE_C**-2]], [ior, (ior - 1.0) / abbe])
    expected = [a + b / wavelength**2 for wavelength in PRIMARIES]
    np.testing.assert_allclose(channel_indices(ior, 20.0 / abbe), expected, rtol=1e-12)
    # As printed in KHR_materials_dispersion, with rounded constants.
    printed = [ior + (ior - 1.0) / abbe * (523655.0 / wavelength**2 - 1.5168) for wavelength in PRIMARIES]
    np.testing.assert_allclose(channel_indices(ior, 20.0 / abbe), printed, atol=2e-4 * ior / abbe)


def test_no_index_falls_below_that_of_vacuum() -> None:
    red, green, blue = channel_indices(1.1, 400.0)
    assert red == 1.0 < green < blue


def test_names_and_mistakes() -> None:
    assert wrt.Dielectric("diamond", dispersion="diamond").dispersion == pytest.approx(20.0 / 55.0)
    assert wrt.Principled(transmission=1.0, dispersion="Water").dispersion == pytest.approx(20.0 / 55.0)
    with pytest.raises(InputError, match=r"dispersion: 'diamnd' is not a known.*diamond"):
        wrt.Dielectric(dispersion="diamnd")
    with pytest.raises(InputError, match="dispersion needs an ior of 1 or more"):
        wrt.RoughDielectric(0.9, dispersion=0.5)
    with pytest.raises(InputError, match="dispersion"):
        wrt.Dielectric(dispersion=-1.0)


@pytest.mark.parametrize(
    ("plain", "dispersive"),
    [
        (wrt.Dielectric(), wrt.Dielectric(dispersion=0.4)),
        (wrt.RoughDielectric(), wrt.RoughDielectric(dispersion=0.4)),
        (wrt.Principled(transmission=1.0), wrt.Principled(transmission=1.0, dispersion=0.4)),
    ],
)
def test_only_dispersion_has_another_kernel(plain: Any, dispersive: Any) -> None:
    assert dataclasses.replace(dispersive, dispersion=0.0).model == plain.model != dispersive.model
    assert dataclasses.replace(dispersive, dispersion=0.0).slots == plain.slots


def test_dispersion_without_a_body_is_of_no_effect() -> None:
    """Opaque materials and thin sheets refract nothing."""
    for values in ({}, {"transmission": 1.0, "thin_walled": True}):
        assert wrt.Principled(dispersion=0.4, **values).model == wrt.Principled(**values).model


def test_ray_trees_say_that_they_ignore_it() -> None:
    scene = wrt.Scene()
    scene.add(wrt.sphere(), material=wrt.TwoSided(wrt.Dielectric(dispersion=0.4), wrt.Dielectric(dispersion=0.4)))
    with pytest.warns(UserWarning, match="whitted.*ignores dispersion"):
        choose_integrator(scene, wrt.RenderSettings(integrator="whitted"))


# --- Models -----------------------------------------------------------------------------------------

MODELS: dict[str, Any] = {
    "rough": wrt.RoughDielectric(1.5, alpha=0.3, dispersion=3.0),
    "principled": wrt.Principled(transmission=0.7, roughness=0.5, coat=0.5, dispersion=3.0),
    "multiple bounces": wrt.RoughDielectric(1.5, alpha=0.6, dispersion=3.0, multiple_bounces=True),
}
SEEN = [("rough", False, 45.0), ("principled", True, 80.0)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "front", "degrees"), SEEN)
def test_samples_follow_the_density(name: str, front: bool, degrees: float, device: str, report: Report) -> None:
    case = Case(MODELS[name], front)
    result = chi_square(case, degrees, device, tests=len(SEEN), samples=2**18, tolerance=1e-6)
    report(f"{name}, {'front' if front else 'back'}, {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    assert_weights(case, degrees, device)
    assert_finite(case, device)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_each_channel_is_the_model_of_its_index(name: str, device: str) -> None:
    """Values are those of three materials without dispersion, the one's red, another's green, the third's blue."""
    material = MODELS[name]
    rng = np.random.default_rng(3)
    wo, wi = rng.normal(size=(2, 5000, 3))
    wo[:, 2] = np.abs(wo[:, 2])
    wo, wi = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wo, wi))
    value = Case(material).evaluate(wo, wi, device)[0]
    for k, index in enumerate(channel_indices(material.ior, material.dispersion)):
        alone = Case(dataclasses.replace(material, ior=index, dispersion=0.0)).evaluate(wo, wi, device)[0]
        np.testing.assert_allclose(value[:, k], alone[:, k], rtol=2e-4, atol=1e-6)


# --- Pictures ---------------------------------------------------------------------------------------


def rendered(scene: wrt.Scene, device: str, **options: Any) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return a picture, the variances of its values, and the number of samples of a pixel."""
    spp = options.pop("spp")
    renderer = wrt.Renderer(scene, sampler="independent", device=device, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image().astype(np.float64), renderer.variance().astype(np.float64), spp


def still_life(materials: list[Any]) -> wrt.Scene:
    """Balls of these materials in a row before a wall of stripes, lit by a lamp and a sky."""
    sky = np.random.default_rng(5).random((8, 16, 3)) ** 3
    scene = wrt.Scene(environment=wrt.ImageEnvironment(np.asarray(2.0 * sky, np.float32)))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.4, 6.0), (0.0, 0.0, 0.0), fov_degrees=35)
    for x in np.linspace(-2.0, 2.0, 9):
        scene.add(wrt.quad((x, -2.0, -2.0), (0.2, 0.0, 0.0), (0.0, 4.0, 0.0)), material=wrt.Diffuse(0.8))
    scene.add(wrt.quad((-1.0, 2.5, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=6.0)
    for k, material in enumerate(materials):
        ball = wrt.sphere(radius=0.7, center=(1.6 * (k - 0.5 * (len(materials) - 1)), 0.0, 0.0), subdivisions=3)
        scene.add(ball, material=material)
    return scene


GLASSES: dict[str, list[Any]] = {
    "smooth, rough and principled": [
        wrt.Dielectric(1.5, dispersion=4.0, specular_transmittance=(0.9, 0.7, 0.8)),
        wrt.RoughDielectric(1.6, alpha=0.15, dispersion=4.0),
        wrt.Principled(transmission=0.9, roughness=0.3, coat=0.6, base_color=(0.9, 0.8, 0.6), dispersion=4.0),
    ],
    "bodies within bodies": [
        wrt.Dielectric(1.33, dispersion=4.0, priority=1),
        wrt.RoughDielectric(1.6, alpha=0.15, dispersion=4.0, priority=2),
        wrt.Dielectric(1.5, dispersion=4.0, priority=3),
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", GLASSES)
def test_a_picture_is_that_of_three_indices(name: str, device: str, report: Report) -> None:
    """Red by the index of red, green by that of green and blue by that of blue, pixel by pixel, by Welch's t."""
    materials = GLASSES[name]
    options = {"width": 40, "height": 16, "max_depth": 8, "spp": 1024}
    spread, spread_variance, n = rendered(still_life(materials), device, seed=1, **options)
    alone, alone_variance = np.empty_like(spread), np.empty_like(spread)
    for k in range(3):
        of_channel = [
            dataclasses.replace(m, ior=channel_indices(m.ior, m.dispersion)[k], dispersion=0.0) for m in materials
        ]
        image, variance, _ = rendered(still_life(of_channel), device, seed=2 + k, **options)
        alone[..., k], alone_variance[..., k] = image[..., k], variance[..., k]
    result = image_z_test(spread, spread_variance, alone, alone_variance, n_a=n, n_b=n)
    report(f"{name}: pixels alike", result.pass_fraction, 1.0, p=min(result.block_p, result.mean_p))
    assert result.agrees(), result.message


def refracted(direction: NDArray[np.float64], normal: NDArray[np.float64], eta: float) -> tuple[NDArray, float]:
    """Return the direction behind a boundary, eta = n_t / n_i, and the share of light that goes there (Fresnel)."""
    cos_i = -float(direction @ normal)
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / eta**2)
    r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return direction / eta + normal * (cos_i / eta - cos_t), 1.0 - 0.5 * (r_s**2 + r_p**2)


def test_a_prism_makes_three_spots(device: str, report: Report) -> None:
    """Each channel comes from the strip that Snell's law sends it to, with the energy of Fresnel's equations.

    A ray goes through a prism of 60°. Strips glow where it should end, the first 1, the others 2 and 4, so narrow
    that no channel can see another's.
    """
    glass = wrt.Dielectric(1.5, dispersion=1.0)
    half, depth = np.tan(np.pi / 6.0), 1.0
    # Apex up; the ray goes to +x through the left face and out of the right one.
    corners = np.array([[-half, 0.0], [half, 0.0], [0.0, 1.0]])
    points = np.array([[x, y, z] for z in (-depth, depth) for x, y in corners])
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    prism = wrt.Mesh(points, np.array(faces))
    start, way = np.array([-2.0, 0.25, 0.0]), np.array([np.cos(0.3), np.sin(0.3), 0.0])
    left, right = (np.array([s * np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0]) for s in (-1.0, 1.0))
    apex = np.array([0.0, 1.0, 0.0])
    ends, shares = [], []
    for index in channel_indices(glass.ior, glass.dispersion):
        inside = start + way * float((apex - start) @ left / (way @ left))
        toward, into = refracted(way, left, index)
        outside = inside + toward * float((apex - inside) @ right / (toward @ right))
        last, out = refracted(toward, -right, 1.0 / index)
        ends.append(outside + last * ((6.0 - outside[0]) / last[0]))
        shares.append(into * out)
    heights = np.array([end[1] for end in ends])
    gap = float(np.abs(np.diff(heights)).min())
    assert gap > 0.03
    scene = wrt.Scene(camera=wrt.OrthographicCamera(start, start + way, view_height=1e-4))
    scene.add(prism, material=glass)
    for height, emission in zip(heights, (1.0, 2.0, 4.0), strict=True):
        strip = wrt.quad((6.0, height - 0.2 * gap, -1.0), (0.0, 0.0, 2.0), (0.0, 0.4 * gap, 0.0))
        scene.add(strip, emission=emission, two_sided_emission=True)
    image, variance, n = rendered(scene, device, width=1, height=1, max_depth=3, spp=65536)
    expected = np.array([1.0, 2.0, 4.0]) * shares
    p = t_test_mean(image[0, 0], variance[0, 0], n, expected)
    for channel, value, goal, chance in zip(CHANNELS, image[0, 0], expected, p, strict=True):
        report(f"{channel} behind a prism", float(value), float(goal), p=float(chance))
    assert (p > sidak(0.01, 3)).all()


@pytest.mark.parametrize("material", [wrt.Dielectric(1.5, dispersion=4.0)])
def test_no_light_is_lost(material: Any, device: str, report: Report) -> None:
    """A block that disperses cannot be seen in a white furnace, in no channel."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(1.8, 1.3, 3.0), fov_degrees=30)
    scene.add(wrt.box((-0.7, -0.5, -0.6), (0.7, 0.5, 0.6)), material=material)
    image, variance, n = rendered(scene, device, width=32, height=32, max_depth=1000, spp=256)
    mean, error = image.mean(axis=(0, 1)), np.sqrt(variance.sum(axis=(0, 1))) / 1024
    p = t_test_mean(mean, error**2, 1024 * n, 1.0)
    for channel, value, chance in zip(CHANNELS, mean, p, strict=True):
        report(f"{channel} through a block that disperses", float(value), 1.0, p=float(chance))
    assert (p > sidak(0.01, 3)).all()
    assert (error < 0.01).all()
