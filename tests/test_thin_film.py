"""Thin films reflect the colours that a sum over the spectrum finds, and make no energy."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, albedo, assert_finite, assert_weights, chi_square, reciprocity_error, viewer
from support.kernels import upload
from support.thin_films import SEEN, film_rgb

import wrt
from wrt.errors import InputError
from wrt.io.measured.observer import WAVELENGTHS
from wrt.kernels.bsdf.lobes.thin_film import film_change, film_reflectance, sensitivity

METALS = ((0.2, 3.5), (1.5, 6.5), (2.9, 3.0))
DIELECTRICS = ((1.0, 0.0), (1.33, 0.0), (1.5, 0.0), (2.4, 0.0))


@wp.kernel(module="test.thin_film", enable_backward=False)
def reflect(rows: wp.array2d(dtype=float), seen_out: wp.array(dtype=wp.vec3), change_out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    eta = rows[i, 3]
    seen_out[i] = film_reflectance(rows[i, 0], rows[i, 1], rows[i, 2], wp.vec3(eta), wp.vec3(rows[i, 4]))
    root = (eta - 1.0) / (eta + 1.0)
    change_out[i] = film_change(wp.vec3(1.0, rows[i, 1], rows[i, 2]), rows[i, 0], wp.vec3(root * root))


@wp.kernel(module="test.thin_film", enable_backward=False)
def see(differences: wp.array(dtype=float), re_out: wp.array(dtype=wp.vec3), im_out: wp.array(dtype=wp.vec3)):
    s = sensitivity(differences[wp.tid()])
    re_out[wp.tid()] = s.re
    im_out[wp.tid()] = s.im


def reflected(rows: NDArray[np.float64], device: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, 3) reflectances of rows of cosine, index, thickness in nm, η and k, and the changes by the film."""
    out = [wp.zeros(len(rows), dtype=wp.vec3, device=device) for _ in range(2)]
    scaled = wp.array((rows * (1.0, 1.0, 1e-3, 1.0, 1.0)).astype(np.float32), dtype=float, device=device)
    wp.launch(reflect, len(rows), [scaled], out, device=device)
    seen, change = (array.numpy().astype(np.float64) for array in out)
    return seen, change


def grid(angles: Any, indices: Any, thicknesses: Any, below: Any) -> NDArray[np.float64]:
    found = itertools.product(np.cos(np.radians(angles)), indices, thicknesses, below)
    return np.array([(mu, index, thickness, *base) for mu, index, thickness, base in found])


def test_what_channels_see_of_a_difference_of_paths(device: str, report: Report) -> None:
    """The sum of Gaussians is the Fourier transform of the channels' weights to 0.02, and 1 without a difference."""
    d = np.linspace(0.0, 12.0, 1201)
    out = [wp.zeros(len(d), dtype=wp.vec3, device=device) for _ in range(2)]
    wp.launch(see, len(d), [upload(d, wp.float32, device)], out, device=device)
    found = out[0].numpy() + 1j * out[1].numpy()
    exact = np.exp(2j * np.pi * d[:, None] / (WAVELENGTHS / 1000.0)) @ SEEN
    error = float(np.abs(found - exact).max())
    report("largest error of a channel's transform", error, 0.0)
    np.testing.assert_allclose(found[0], 1.0, atol=1e-4)
    assert error < 0.02


@pytest.mark.parametrize(("name", "below"), [("dielectrics", DIELECTRICS), ("metals", METALS)])
def test_colours_are_those_of_the_whole_spectrum(name: str, below: Any, device: str, report: Report) -> None:
    """Transfer matrices at 401 wavelengths, the CIE observer and D65, for both polarisations, clipped to 0 and 1."""
    rows = grid(
        (0.0, 30.0, 60.0, 75.0, 85.0), (1.1, 1.33, 1.6, 2.0, 2.4), (50.0, 100.0, 200.0, 400.0, 800.0, 2500.0), below
    )
    expected = [film_rgb(mu, index, thickness, complex(eta, k)) for mu, index, thickness, eta, k in rows]
    error = np.abs(reflected(rows, device)[0] - np.clip(expected, 0.0, 1.0))
    report(f"films on {name}: largest error, and root of the mean square", error.max(), np.sqrt((error**2).mean()))
    assert error.max() < 6e-3
    assert np.sqrt((error**2).mean()) < 1e-3
    # The colours differ by far more than that.
    assert np.ptp(expected, axis=1).max() > 0.2


def test_no_film_is_no_change(device: str) -> None:
    """A film without thickness, or of the index outside, reflects as the surface below it, by Fresnel's equations."""
    below = (*DIELECTRICS[1:], *METALS)
    thin = grid((0.0, 45.0, 75.0), (1.33, 2.0), (0.0,), below)
    like_air = grid((0.0, 45.0, 75.0, 88.0), (1.0,), (100.0, 900.0), below)
    for rows, tolerance in ((thin, 2e-3), (like_air, 2e-6)):
        mu, index = rows[:, 0], rows[:, 3] + 1j * rows[:, 4]
        cos_t = np.sqrt(1.0 - (1.0 - mu**2) / index**2)
        r_s, r_p = (mu - index * cos_t) / (mu + index * cos_t), (index * mu - cos_t) / (index * mu + cos_t)
        fresnel = 0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2)
        found, change = reflected(rows, device)
        np.testing.assert_allclose(found, np.repeat(fresnel[:, None], 3, axis=1), atol=tolerance)
        dielectric = rows[:, 4] == 0.0
        np.testing.assert_allclose(change[dielectric], 0.0, atol=tolerance)


@pytest.mark.parametrize("index", [1.2, 1.5, 2.2])
def test_a_film_between_the_same_media_is_a_soap_bubble(index: float, device: str) -> None:
    """Black where it is much thinner than a wave, as both faces cancel (Newton's black film)."""
    rows = grid((0.0, 40.0), (index,), (1.0, 5.0), ((1.0, 0.0),))
    found = reflected(rows, device)[0]
    assert found.max() < 0.03
    assert reflected(grid((0.0,), (index,), (110.0,), ((1.0, 0.0),)), device)[0].max() > 0.02


# --- Materials --------------------------------------------------------------------------------------

FILM = {"film_thickness": 350.0, "film_ior": 1.7}
GOLD = wrt.Conductor(metal="gold")
MATERIALS: dict[str, Any] = {
    "principled": wrt.Principled(0.8, roughness=0.9, film=0.8, **FILM),
    "principled metal": wrt.Principled((0.9, 0.6, 0.3), metallic=1.0, roughness=0.3, **FILM),
    "rough metal": wrt.RoughConductor(0.3, metal="gold", **FILM),
    "rough metal by its reflectance": wrt.RoughConductor(0.3, f0=(0.9, 0.6, 0.3), **FILM),
}


def test_a_smooth_metal_has_the_colours_of_the_spectrum(device: str, report: Report) -> None:
    material = wrt.Conductor(metal="gold", **FILM)
    for degrees in (0.0, 50.0, 80.0):
        found = Case(material).sample(viewer(degrees), np.full((1, 3), 0.5), device)["weight"][0]
        mu = float(np.cos(np.radians(degrees)))
        indices = [complex(eta, k) for eta, k in zip(material.eta, material.k, strict=True)]
        expected = [film_rgb(mu, 1.7, 350.0, index)[channel] for channel, index in enumerate(indices)]
        report(f"gold under a film at {degrees:g}°: green", float(found[1]), expected[1])
        np.testing.assert_allclose(found, np.clip(expected, 0.0, 1.0), atol=6e-3)


def test_a_principled_surface_changes_as_the_spectrum_does(device: str) -> None:
    """Schlick's reflectance, and what the film adds to Fresnel's by the spectrum."""
    f0, wo = 0.3, viewer(40.0)[None]
    mirrored = wo * (-1.0, -1.0, 1.0)
    plain, filmed = (
        Case(wrt.Principled(f0, metallic=1.0, roughness=0.3, **film)).evaluate(wo, mirrored, device)[0][0]
        for film in ({}, FILM)
    )
    mu = float(wo[0, 2])
    schlick = f0 + (1.0 - f0) * (1.0 - mu) ** 5
    index = (1.0 + np.sqrt(f0)) / (1.0 - np.sqrt(f0))
    change = film_rgb(mu, 1.7, 350.0, complex(index)) - film_rgb(mu, 1.0, 350.0, complex(index))
    np.testing.assert_allclose(filmed / plain * schlick, np.clip(schlick + change, 0.0, 1.0), atol=6e-3)


def test_a_film_of_no_contrast_is_none(device: str) -> None:
    wo, wi = viewer(30.0)[None], viewer(50.0, 3.0)[None]
    plain = Case(wrt.Principled(0.6, roughness=0.4)).evaluate(wo, wi, device)[0]
    for film in ({"film_thickness": 300.0, "film_ior": 1.0}, {"film_thickness": 1e-4}):
        found = Case(wrt.Principled(0.6, roughness=0.4, **film)).evaluate(wo, wi, device)[0]
        np.testing.assert_allclose(found, plain, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", MATERIALS)
def test_samples_and_reciprocity(name: str, device: str, report: Report) -> None:
    case = Case(MATERIALS[name])
    if name in ("principled metal", "rough metal"):
        result = chi_square(case, 50.0, device, tests=2, samples=2**16, tolerance=3e-6)
        report(f"{name}: samples against the density", result.statistic, result.dof, p=result.p)
        assert result.passed, result.message
    assert_weights(case, 50.0, device)
    assert_finite(case, device)
    assert reciprocity_error(case, device, n=5000) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.05, 0.4, 0.8])
def test_a_white_surface_below_a_film(roughness: float, device: str, report: Report) -> None:
    """What the film does not reflect goes below: the surface stays white to some per cent, and makes no energy."""
    least, most = 1.0, 0.0
    for index, degrees in itertools.product((1.33, 2.4), (0.0, 45.0, 75.0, 85.0)):
        case = Case(wrt.Principled(1.0, roughness=roughness, film_thickness=300.0, film_ior=index))
        mean, error = albedo(case, degrees, device, samples=2**14)
        least, most = min(least, float(mean.min())), max(most, float((mean - 4.0 * error).max()))
    report(f"albedo of white below films, roughness {roughness}: least, most", least, most)
    assert most < 1.0 + 2e-3
    assert least > 0.93


@pytest.mark.slow
def test_a_clear_body_below_a_film_loses_nothing(device: str, report: Report) -> None:
    """Each channel is refracted as far as the film does not reflect it, from both sides."""
    material = wrt.Principled(1.0, roughness=0.05, transmission=1.0, **FILM)
    for front, degrees in ((True, 0.0), (True, 60.0), (False, 0.0), (False, 30.0), (False, 60.0)):
        mean, error = albedo(Case(material, front), degrees, device, samples=2**14)
        report(f"{'outside' if front else 'inside'} at {degrees:g}°", f"{mean.min():.4f}", f"{mean.max():.4f}")
        assert (np.abs(mean - 1.0) < 2e-3 + 4.0 * error).all()


def test_mistakes() -> None:
    for values, message in (
        ({"film_thickness": -1.0}, "film_thickness"),
        ({"film_thickness": 300.0, "film_ior": 0.9}, "film_ior"),
        ({"film_thickness": 300.0, "multiple_bounces": True}, "multiple_bounces cannot have a film"),
    ):
        for make in (wrt.Principled, wrt.RoughConductor):
            with pytest.raises(InputError, match=message):
                make(**values)
    assert wrt.Principled(film=0.0, film_thickness=300.0).model == wrt.Principled().model
    assert wrt.Conductor().model == "conductor"


@pytest.mark.slow
def test_all_features_together_have_place(device: str) -> None:
    """A material with every layer has a row for each value, and its film still counts."""
    layers = {"transmission": 0.5, "dispersion": 0.5, "anisotropy": 0.5, "coat": 0.5}
    layers |= {"coat_roughness": 0.5, "sheen_color": 0.5}
    material = wrt.Principled(**layers, roughness=0.3, film_thickness=200.0, film_ior=2.4)
    assert len(material.slots) == 16 == Case(material).model.slots
    wo = viewer(30.0)[None]
    mirrored = wo * (-1.0, -1.0, 1.0)
    value = Case(material).evaluate(wo, mirrored, device)[0]
    without = Case(wrt.Principled(**layers, roughness=0.3)).evaluate(wo, mirrored, device)[0]
    # The film's index lies in a row that says where the brush strokes go.
    assert (value > 1.3 * without).all()
