"""Dispersion: each channel is refracted by an index of its own, as if it were rendered alone."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, hemisphere, sphere, viewer
from support.fresnel import cook_torrance
from support.kernels import uniforms

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


def test_a_name_stands_for_an_abbe_number_and_ray_trees_ignore_dispersion() -> None:
    assert wrt.Principled(transmission=1.0, dispersion="Water").dispersion == pytest.approx(20.0 / 55.0)
    scene = wrt.Scene()
    scene.add(wrt.sphere(), material=wrt.TwoSided(wrt.Dielectric(dispersion=0.4), wrt.Dielectric(dispersion=0.4)))
    with pytest.warns(UserWarning, match="whitted.*ignores dispersion"):
        choose_integrator(scene, wrt.RenderSettings(integrator="whitted"))


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
        single = Case(of_channel(material, k)).evaluate(wo, wi, device)[0]
        np.testing.assert_allclose(value[:, k], single[:, k], rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("front", [True, False])
def test_each_channel_goes_where_snells_law_sends_it(front: bool, device: str, report: Report) -> None:
    """With the energy of Fresnel's equations, and no other channel with it."""
    material, wo, n = wrt.Dielectric(1.5, dispersion=4.0), viewer(30.0), 2**16
    found = Case(material, front).sample(wo, uniforms(n, 3, seed=5), device)
    unassigned = found["wi"][:, 2] < 0.0
    for channel, index in enumerate(channel_indices(1.5, 4.0)):
        eta = index if front else 1.0 / index
        in_channel = unassigned & (np.abs(found["wi"][:, :2] + wo[:2] / eta) < 1e-5).all(axis=1)
        energy = np.where(in_channel[:, None], found["weight"].astype(np.float64) * eta**2, 0.0)
        mean, error = energy.mean(axis=0), energy.std(axis=0) / np.sqrt(n)
        expected = np.where(np.arange(3) == channel, 1.0 - cook_torrance(wo[2], eta), 0.0)
        report(f"channel {channel}, front {front}: energy", str(mean), str(expected))
        assert (np.abs(mean - expected) < 4.0 * error + 1e-5).all()
        unassigned &= ~in_channel
    assert not unassigned.any()
