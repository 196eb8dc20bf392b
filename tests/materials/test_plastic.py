"""Diffuse bases under transparent coats: what the coat lets in, by closed forms and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import ANGLES, Case, viewer
from support.fresnel import by_angles

import wrt
from wrt.backend.device import Device
from wrt.scene.materials.plastics import internal_reflectance
from wrt.upload.tables.coat import coat_table

COLOR = (0.8, 0.4, 0.0)


# --- The smooth coat --------------------------------------------------------------------------------


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize(("ior", "exterior"), [(1.5, 1.0), (2.42, 1.0), (1.0, 1.5)])
def test_albedo_of_the_base_is_the_stated_one(ior: float, exterior: float, nonlinear: bool, device: str) -> None:
    """ρ (1 − F), or ρ (1 − F)(1 − R) / (1 − ρR): white exactly 1 with the mirrored light, by quadrature."""
    eta = ior / exterior
    node, weight = np.polynomial.legendre.leggauss(400)
    x = 0.5 * (node + 1.0)
    # Dense near the horizon and at the critical angle, where F is steep.
    critical = np.sqrt(max(0.0, 1.0 - eta * eta))
    z = np.concatenate([critical * (1.0 - x**2), critical + (1.0 - critical) * x**2])
    measure = np.concatenate([critical * x * weight, (1.0 - critical) * x * weight]) * 2.0 * np.pi
    wi = np.stack([np.sqrt(1.0 - z * z), np.zeros_like(z), z], axis=1)
    rho = np.array([1.0, 0.5, 0.1])
    inner = internal_reflectance(eta)
    case = Case(wrt.Plastic(tuple(rho), ior, exterior, nonlinear=nonlinear))
    for degrees in ANGLES:
        base = measure @ case.evaluate(viewer(degrees), wi, device)[0]
        shift = (1.0 - inner) / (1.0 - rho * inner) if nonlinear else 1.0
        expected = rho * shift * (1.0 - by_angles(viewer(degrees)[2], eta))
        np.testing.assert_allclose(base, expected, atol=2e-6)


# --- The rough coat ---------------------------------------------------------------------------------


def smith_g1(w: NDArray, alpha: float) -> NDArray:
    """Return G1 of ggx as Walter 2007, eq. 34, has it."""
    tan2 = (1.0 - w[..., 2] ** 2) / w[..., 2] ** 2
    return 2.0 / (1.0 + np.sqrt(1.0 + alpha**2 * tan2))


def expected_transmittance(degrees: float, alpha: float, eta: float) -> tuple[float, float]:
    """Return what is refracted and what is reflected, by quadrature over all normals: ggx, separable masking."""
    node, weight = np.polynomial.legendre.leggauss(300)
    theta, phi = 0.25 * np.pi * (node + 1.0), np.pi * (node + 1.0)
    t, p = (a.ravel() for a in np.meshgrid(theta, phi, indexing="ij"))
    solid = np.outer(weight * 0.25 * np.pi * np.sin(theta), weight * np.pi).ravel()
    m = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    wo = viewer(degrees, 0.0)
    d = alpha**2 / (np.pi * (m[:, 2] ** 2 * (alpha**2 - 1.0) + 1.0) ** 2)
    cos_m = m @ wo
    visible = d * np.maximum(cos_m, 0.0) / wo[2] * smith_g1(wo, alpha) * solid
    f = by_angles(np.clip(cos_m, 1e-9, 1.0), eta)
    cos_t = np.sqrt(np.maximum(1.0 - (1.0 - cos_m**2) / eta**2, 0.0))
    down = m * (cos_m / eta - cos_t)[:, None] - wo / eta
    up = 2.0 * cos_m[:, None] * m - wo
    refracted = np.where(down[:, 2] < 0.0, visible * (1.0 - f) * smith_g1(down, alpha), 0.0)
    reflected = np.where(up[:, 2] > 0.0, visible * f * smith_g1(up, alpha), 0.0)
    return float(refracted.sum()), float(reflected.sum())


def look_up(table: NDArray[np.float32], cosine: NDArray | float) -> NDArray:
    """Return T of a table for one roughness."""
    rows = int(table[0])
    return np.asarray(np.interp(np.sqrt(cosine), np.linspace(0.0, 1.0, rows), table[3:]))


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "eta"), [(0.2, 1.5), (1.0, 1.5), (0.5, 1.0 / 1.5)])
def test_tables_hold_what_gets_in(alpha: float, eta: float, device: str, report: Report) -> None:
    single = coat_table("ggx", "smith-separable", eta, alpha, False, Device(device))
    multiple = coat_table("ggx", "smith-separable", eta, alpha, True, Device(device))
    for degrees in (0.0, 30.0, 60.0, 80.0, 88.0):
        refracted, reflected = expected_transmittance(degrees, alpha, eta)
        cosine = np.cos(np.radians(degrees))
        report(f"α = {alpha}, η = {eta:.3g}, {degrees:g}°: T", float(look_up(single, cosine)), refracted)
        assert look_up(single, cosine) == pytest.approx(refracted, abs=5e-4)
        assert look_up(multiple, cosine) == pytest.approx(1.0 - reflected, abs=5e-4)
    for table in (single, multiple):
        # What is not sent back from below is what comes in from above: 1 − R = 2 ∫ T cosθ d cosθ / η².
        z = (np.arange(100_000) + 0.5) / 100_000
        assert table[2] == pytest.approx(1.0 - float(np.mean(2.0 * z * look_up(table, z))) / eta**2, abs=1e-6)
