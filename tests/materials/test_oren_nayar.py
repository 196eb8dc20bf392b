"""The rough diffuse model: Lambert's at σ = 0, Oren and Nayar's in shape, and further bounces in their colours."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, albedo, hemisphere, mean_albedo, viewer, walked

import wrt

COLOR = (0.9, 0.5, 0.1)
MID, ROUGH = 0.35, 0.5 * np.pi


def published(sigma: float) -> tuple[float, float]:
    """Return A and B of the qualitative model (Oren and Nayar 1994)."""
    s2 = sigma * sigma
    return 1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)


def qualitative(wo: NDArray, wi: NDArray, sigma: float) -> NDArray:
    """Return f of the qualitative model as printed, for ρ = 1: by angles, not by the cosines that the kernel uses."""
    a, b = published(sigma)
    theta_o, theta_i = np.arccos(wo[..., 2]), np.arccos(wi[..., 2])
    turn = np.cos(np.arctan2(wo[..., 1], wo[..., 0]) - np.arctan2(wi[..., 1], wi[..., 0]))
    alpha, beta = np.maximum(theta_o, theta_i), np.minimum(theta_o, theta_i)
    return np.asarray((a + b * np.maximum(turn, 0.0) * np.sin(alpha) * np.tan(beta)) / np.pi)


@pytest.mark.parametrize("sigma", [0.0, 1e-6])
def test_without_roughness_it_is_lambertian(sigma: float, device: str) -> None:
    wo, wi = hemisphere(10_000, seed=30), hemisphere(10_000, seed=31)
    value, pdf, _ = Case(wrt.OrenNayar(COLOR, sigma)).evaluate(wo, wi, device)
    lambert, cosine, _ = Case(wrt.Diffuse(COLOR)).evaluate(wo, wi, device)
    np.testing.assert_allclose(value, lambert, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(lambert, wi[:, 2:] * COLOR / np.pi, rtol=1e-5)
    if sigma == 0.0:
        np.testing.assert_allclose(pdf, cosine, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("sigma", [0.1, 1.0, ROUGH])
def test_a_dark_surface_has_the_shape_of_the_published_model(sigma: float, device: str) -> None:
    """Of a dark surface only the first bounce is left: on the viewer's side the published model, scaled."""
    wo, wi = hemisphere(20_000, seed=32), hemisphere(20_000, seed=33)
    same_side = wo[:, 0] * wi[:, 0] + wo[:, 1] * wi[:, 1] > 0.0
    wo, wi = wo[same_side], wi[same_side]
    rho = 1e-6
    value, _, _ = Case(wrt.OrenNayar(rho, sigma)).evaluate(wo, wi, device)
    a, b = published(sigma)
    scale = 1.0 / (1.0 + (0.5 - 2.0 / (3.0 * np.pi)) * b / a) / a
    np.testing.assert_allclose(value[:, 0] / (rho * wi[:, 2]), scale * qualitative(wo, wi, sigma), rtol=1e-4)


@pytest.mark.parametrize("sigma", [MID, ROUGH])
def test_further_bounces_have_their_colours(sigma: float, device: str, report: Report) -> None:
    """Of what a facet reflects a share escapes, and the rest is reflected again: Σ ρᵏ e (1 − e)ᵏ⁻¹ in each channel.

    In the mean over the hemisphere, for which the model makes its term of further bounces (Kulla and Conty 2017). The
    sum is a random walk's; e is the mean albedo of one bounce, from the value of a dark surface.
    """
    dark = 1e-4
    escapes = float(mean_albedo(Case(wrt.OrenNayar(dark, sigma)), device)[0]) / dark
    found, (expected, error) = mean_albedo(Case(wrt.OrenNayar(COLOR, sigma)), device), walked(escapes, COLOR)
    report(f"σ {sigma:.2f}: mean albedo, and by a random walk", str(found), str(expected))
    assert (np.abs(found - expected) < 4.0 * error + 3e-4 * np.array(COLOR)).all()
    # So that a colour which is left out, or another channel's, is seen.
    assert (found < 0.999 * np.array(COLOR)).all()


def test_sampling_is_better_than_a_cosine(device: str, report: Report) -> None:
    """The relative deviation of weights is what sampling adds to the noise of a picture."""
    n = 2**17
    for degrees in (45.0, 89.0):
        case = Case(wrt.OrenNayar(1.0, 1.0))
        deviation = float(albedo(case, degrees, device, samples=n)[1][0]) * np.sqrt(n)
        wi = hemisphere(n, seed=34)
        value, _, _ = case.evaluate(viewer(degrees), wi, device)
        # E[(f cosθ / (cosθ/π))²] under the cosine density, by uniform directions.
        second = float(np.mean(value[:, 0] ** 2 * np.pi / wi[:, 2]) * 2.0 * np.pi)
        report(f"deviation at {degrees:g}°, a cosine's beside it", deviation, np.sqrt(second - 1.0))
        assert deviation < 0.5 * np.sqrt(second - 1.0)
