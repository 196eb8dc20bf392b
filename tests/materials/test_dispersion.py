"""Dispersion: each channel is refracted by an index of its own, as if it were rendered alone."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, hemisphere, sphere
from support.covering_kernels import covering, render_with
from support.statistics import sidak, t_test_mean

import wrt
from wrt.io.measured.observer import OBSERVER, WAVELENGTHS
from wrt.scene.materials.dispersion import LINE_C, LINE_D, LINE_F, PRIMARIES, channel_indices
from wrt.upload.integrators import choose_integrator

Array = NDArray[np.float64]

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
    # None falls below that of vacuum.
    red, green, blue = channel_indices(1.1, 400.0)
    assert red == 1.0 < green < blue


def test_names_and_mistakes() -> None:
    assert wrt.Principled(transmission=1.0, dispersion="Water").dispersion == pytest.approx(20.0 / 55.0)
    for make, message in (
        (lambda: wrt.Dielectric(dispersion="diamnd"), r"dispersion: 'diamnd' is not a known.*diamond"),
        (lambda: wrt.RoughDielectric(0.9, dispersion=0.5), "dispersion needs an ior of 1 or more"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            make()
    scene = wrt.Scene()
    scene.add(wrt.sphere(), material=wrt.TwoSided(wrt.Dielectric(dispersion=0.4), wrt.Dielectric(dispersion=0.4)))
    with pytest.warns(UserWarning, match="whitted.*ignores dispersion"):
        choose_integrator(scene, wrt.RenderSettings(integrator="whitted"))


def test_only_bodies_that_disperse_have_another_kernel() -> None:
    """Opaque materials and thin sheets refract nothing."""
    for plain in (wrt.Dielectric(), wrt.RoughDielectric(), wrt.Principled(transmission=1.0)):
        dispersive = dataclasses.replace(plain, dispersion=0.4)
        assert plain.model != dispersive.model
        assert dataclasses.replace(dispersive, dispersion=0.0).slots == plain.slots
    for plain in (wrt.Principled(), wrt.Principled(transmission=1.0, thin_walled=True)):
        assert dataclasses.replace(plain, dispersion=0.4).model == plain.model


# --- Values -----------------------------------------------------------------------------------------


def of_channel(material: Any, channel: int) -> Any:
    """Return the material without dispersion that has the index of a channel."""
    return dataclasses.replace(
        material, ior=channel_indices(material.ior, material.dispersion)[channel], dispersion=0.0
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "material",
    [
        wrt.Principled(transmission=0.7, roughness=0.5, coat=0.5, dispersion=3.0),
        wrt.RoughDielectric(1.5, alpha=0.6, dispersion=3.0, multiple_bounces=True),
    ],
    ids=["principled", "multiple bounces"],
)
def test_each_channel_is_the_model_of_its_index(material: Any, device: str) -> None:
    wo, wi = hemisphere(5000, seed=3), sphere(5000, seed=4)
    value = Case(material).evaluate(wo, wi, device)[0]
    for k in range(3):
        alone = Case(of_channel(material, k)).evaluate(wo, wi, device)[0]
        np.testing.assert_allclose(value[:, k], alone[:, k], rtol=2e-4, atol=1e-6)


# --- Pictures ---------------------------------------------------------------------------------------


def rendered(scene: wrt.Scene, device: str, spp: int, **options: Any) -> tuple[Array, Array]:
    """Return a picture and the variances of its values."""
    renderer = wrt.Renderer(scene, sampler="independent", device=device, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image().astype(np.float64), renderer.variance().astype(np.float64)


def refracted(direction: Array, normal: Array, eta: float) -> tuple[Array, float]:
    """Return the direction behind a boundary, eta = n_t / n_i, and the share of light that goes there (Fresnel)."""
    cos_i = -float(direction @ normal)
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / eta**2)
    r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return direction / eta + normal * (cos_i / eta - cos_t), 1.0 - 0.5 * (r_s**2 + r_p**2)


@pytest.fixture
def smooth_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([covering("diffuse", "dielectric:dispersive", composite="none")], monkeypatch)


@pytest.mark.slow
@pytest.mark.usefixtures("smooth_kernel")
def test_a_prism_makes_three_spots(device: str, report: Report) -> None:
    """Each channel comes from the strip that Snell's law sends it to, with the energy of Fresnel's equations.

    A ray goes through a prism of 60°. Strips glow where it should end, the first 1, the others 2 and 4, so narrow
    that no channel can see another's.
    """
    glass = wrt.Dielectric(1.5, dispersion=1.0)
    half = np.tan(np.pi / 6.0)
    # Apex up; the ray goes to +x through the left face and out of the right one.
    corners = np.array([[-half, 0.0], [half, 0.0], [0.0, 1.0]])
    points = np.array([[x, y, z] for z in (-1.0, 1.0) for x, y in corners])
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    start, way = np.array([-2.0, 0.25, 0.0]), np.array([np.cos(0.3), np.sin(0.3), 0.0])
    left, right = (np.array([s * np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0]) for s in (-1.0, 1.0))
    apex = np.array([0.0, 1.0, 0.0])
    heights, shares = [], []
    for index in channel_indices(glass.ior, glass.dispersion):
        inside = start + way * float((apex - start) @ left / (way @ left))
        toward, into = refracted(way, left, index)
        outside = inside + toward * float((apex - inside) @ right / (toward @ right))
        last, out = refracted(toward, -right, 1.0 / index)
        heights.append((outside + last * ((6.0 - outside[0]) / last[0]))[1])
        shares.append(into * out)
    gap = float(np.abs(np.diff(heights)).min())
    assert gap > 0.03
    scene = wrt.Scene(camera=wrt.OrthographicCamera(start, start + way, view_height=1e-4))
    scene.add(wrt.Mesh(points, np.array(faces)), material=glass)
    for height, emission in zip(heights, (1.0, 2.0, 4.0), strict=True):
        strip = wrt.quad((6.0, height - 0.2 * gap, -1.0), (0.0, 0.0, 2.0), (0.0, 0.4 * gap, 0.0))
        scene.add(strip, emission=emission, two_sided_emission=True)
    image, variance = rendered(scene, device, width=1, height=1, max_depth=3, spp=65536)
    expected = np.array([1.0, 2.0, 4.0]) * shares
    p = t_test_mean(image[0, 0], variance[0, 0], 65536, expected)
    report("red, green and blue behind a prism", str(image[0, 0]), str(expected), p=float(p.min()))
    assert (p > sidak(0.01, 3)).all()


@pytest.mark.slow
@pytest.mark.usefixtures("smooth_kernel")
def test_no_light_is_lost(device: str, report: Report) -> None:
    """A block that disperses cannot be seen in a white furnace, in no channel."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(1.8, 1.3, 3.0), fov_degrees=30)
    scene.add(wrt.box((-0.7, -0.5, -0.6), (0.7, 0.5, 0.6)), material=wrt.Dielectric(1.5, dispersion=4.0))
    image, variance = rendered(scene, device, width=32, height=32, max_depth=1000, spp=256)
    mean, error = image.mean(axis=(0, 1)), np.sqrt(variance.sum(axis=(0, 1))) / 1024
    p = t_test_mean(mean, error**2, 1024 * 256, 1.0)
    report("red, green and blue through a block that disperses", str(mean), 1.0, p=float(p.min()))
    assert (p > sidak(0.01, 3)).all()
    assert (error < 0.01).all()
