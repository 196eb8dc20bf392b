"""Thin films reflect the colours that a sum over the spectrum finds, and make no energy."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, albedo, viewer
from support.kernels import map_function

import wrt
from wrt.io.measured.observer import D65, OBSERVER, WAVELENGTHS
from wrt.kernels.bsdf.lobes.thin_film import film_reflectance

Array = NDArray[np.float64]

FILM: dict[str, Any] = {"film_thickness": 350.0, "film_ior": 1.7}
XYZ_TO_RGB = np.linalg.inv(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)
SEEN = (OBSERVER @ XYZ_TO_RGB.T) * D65[:, None]
SEEN /= SEEN.sum(axis=0)
"""(N, 3) weight of each wavelength in a channel of linear Rec. 709 under D65."""


def film_rgb(cos_i: float, index: float, thickness: float, below: complex) -> Array:
    """Return (3,) what linear Rec. 709 sees, unpolarised; thickness in nm, indices over that outside.

    A layer turns the tangential fields by its characteristic matrix (Born and Wolf, section 1.6.2).
    """
    sine = np.sqrt(1.0 - cos_i**2)
    cos_film = np.sqrt(1.0 - (sine / index) ** 2 + 0j)
    # Time as e^{+iωt}, with indices n − ik: waves decay into what absorbs.
    cos_below = np.conj(np.sqrt(1.0 - (sine / below) ** 2 + 0j))
    below = np.conj(below)
    delta = 2.0 * np.pi * index * thickness * cos_film / WAVELENGTHS
    spectrum = np.zeros(len(WAVELENGTHS))
    for admittance in (lambda n, c: n * c, lambda n, c: n / c):  # s, p
        outside, film, base = admittance(1.0, cos_i), admittance(index, cos_film), admittance(below, cos_below)
        electric = np.cos(delta) + 1j * np.sin(delta) / film * base
        magnetic = 1j * film * np.sin(delta) + np.cos(delta) * base
        spectrum += 0.5 * np.abs((outside * electric - magnetic) / (outside * electric + magnetic)) ** 2
    return np.asarray(spectrum @ SEEN)


@pytest.mark.parametrize(
    "below",
    [((1.0, 0.0), (1.33, 0.0), (1.5, 0.0), (2.4, 0.0)), ((0.2, 3.5), (1.5, 6.5), (2.9, 3.0))],
    ids=["dielectrics", "metals"],
)
def test_colours_are_those_of_the_whole_spectrum(below: Any, device: str, report: Report) -> None:
    """Transfer matrices at 401 wavelengths, the CIE observer and D65, for both polarisations, clipped to 0 and 1."""
    cosines = np.cos(np.radians([0.0, 30.0, 60.0, 85.0]))
    parts = itertools.product(cosines, (1.0, 1.1, 1.33, 1.6, 2.4), (1.0, 50.0, 100.0, 200.0, 400.0, 2500.0), below)
    rows = np.array([(mu, index, thickness, *base) for mu, index, thickness, base in parts])
    expected = [film_rgb(mu, index, thickness, complex(eta, k)) for mu, index, thickness, eta, k in rows]
    mu, index, thickness, eta, k = rows.T
    three = (np.repeat(values[:, None], 3, axis=1) for values in (eta, k))
    found = map_function(film_reflectance, mu, index, 1e-3 * thickness, *three, device=device)
    error = np.abs(found - np.clip(expected, 0.0, 1.0))
    report("largest error, and root of the mean square", error.max(), np.sqrt((error**2).mean()))
    assert error.max() < 6e-3
    assert np.sqrt((error**2).mean()) < 1e-3
    # The colours differ by far more than that.
    assert np.ptp(expected, axis=1).max() > 0.2


# --- Materials --------------------------------------------------------------------------------------


def mirrored(material: wrt.Material, degrees: float, device: str) -> Array:
    """Return the value in the mirror direction."""
    wo = viewer(degrees)[None]
    return Case(material).evaluate(wo, wo * (-1.0, -1.0, 1.0), device)[0][0]


def test_a_smooth_metal_has_the_colours_of_the_spectrum(device: str) -> None:
    material = wrt.Conductor(metal="gold", **FILM)
    indices = [complex(eta, k) for eta, k in zip(material.eta, material.k, strict=True)]
    for degrees in (0.0, 50.0, 80.0):
        found = Case(material).sample(viewer(degrees), np.full((1, 3), 0.5), device)["weight"][0]
        mu = float(np.cos(np.radians(degrees)))
        expected = [film_rgb(mu, 1.7, 350.0, index)[channel] for channel, index in enumerate(indices)]
        np.testing.assert_allclose(found, np.clip(expected, 0.0, 1.0), atol=6e-3)


@pytest.mark.slow
def test_a_principled_surface_changes_as_the_spectrum_does(device: str) -> None:
    """Schlick's reflectance, and what the film adds to Fresnel's by the spectrum; without contrast nothing."""
    f0, options = 0.3, {"metallic": 1.0, "roughness": 0.3}
    plain, filmed, *none = (
        mirrored(wrt.Principled(f0, **options, **film), 40.0, device)
        for film in ({}, FILM, {"film_thickness": 300.0, "film_ior": 1.0}, {"film_thickness": 1e-4})
    )
    mu = float(viewer(40.0)[2])
    schlick = f0 + (1.0 - f0) * (1.0 - mu) ** 5
    index = complex((1.0 + np.sqrt(f0)) / (1.0 - np.sqrt(f0)))
    change = film_rgb(mu, 1.7, 350.0, index) - film_rgb(mu, 1.0, 350.0, index)
    np.testing.assert_allclose(filmed / plain * schlick, np.clip(schlick + change, 0.0, 1.0), atol=6e-3)
    for found in none:
        np.testing.assert_allclose(found, plain, rtol=3e-3)


@pytest.mark.slow
def test_a_clear_body_below_a_film_loses_nothing(device: str, report: Report) -> None:
    """Each channel is refracted as far as the film does not reflect it, from both sides."""
    material = wrt.Principled(1.0, roughness=0.05, transmission=1.0, **FILM)
    for front, degrees in ((True, 0.0), (True, 60.0), (False, 0.0), (False, 30.0), (False, 60.0)):
        mean, error = albedo(Case(material, front), degrees, device, samples=2**14)
        report(f"{'outside' if front else 'inside'} at {degrees:g}°", f"{mean.min():.4f}", f"{mean.max():.4f}")
        assert (np.abs(mean - 1.0) < 2e-3 + 4.0 * error).all()
