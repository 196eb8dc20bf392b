"""Rough boundaries: Walter's refraction, what facets block and give back, and the limits of smooth and of none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from conftest import Report
from support import rough_glass
from support.bsdfs import Case, hemisphere, sphere, viewer
from support.kernels import uniforms, upload

import wrt
from wrt.backend.device import Device
from wrt.kernels.bsdf.lobes.albedo import missing_energy
from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel, side_table
from wrt.upload.tables.material_tables import table

MULTIPLE = [False, pytest.param(True, marks=pytest.mark.slow)]


@pytest.mark.parametrize("multiple", MULTIPLE)
def test_refraction_is_walters(multiple: bool, device: str, report: Report) -> None:
    """f cosθ in double precision; with multiple bounces plus their lobe, by quadrature in place of tables."""
    alpha, eta = 0.4, 1.3
    wo, wi = viewer(20.0, 0.3)[None], hemisphere(300, seed=4) * [1.0, 1.0, -1.0]
    value = rough_glass.refracted_value(wo, wi, alpha, eta)
    lobe = rough_glass.refracted_lobe(wo, wi, alpha, eta) if multiple else np.zeros(len(wi))
    own = Case(wrt.RoughDielectric(eta, alpha=alpha, multiple_bounces=multiple)).evaluate(wo, wi, device)[0][:, 0]
    report("f, largest error", float(np.abs(own - value - lobe).max()))
    # What facets lose is tabulated to 3e-3, which is some per cent of this lobe.
    assert (np.abs(own - value - lobe) <= 1.5e-4 * value + 0.05 * lobe + 1e-9).all()


@pytest.mark.slow
def test_what_is_tabulated_is_what_is_lost(device: str, report: Report) -> None:
    """Between the table's own points, to 5e-3 up to 89.9 degrees: as white is the furnace. Nowhere is more made."""

    @wp.kernel(module="unique", enable_backward=False)
    def look_up(
        front: bool,
        tables: wp.array(dtype=float),
        directions: wp.array(dtype=wp.vec3),
        shapes: wp.array(dtype=wp.vec3),
        missing_out: wp.array(dtype=float),
    ):
        i = wp.tid()
        missing_out[i] = missing_energy(tables, side_table(0, front), directions[i], shapes[i][0])

    rng = np.random.default_rng(7)
    n = 400
    mu = np.concatenate([rng.random(n // 2), 0.1 * rng.random(n // 2) ** 3])
    directions = np.stack([np.sqrt(1.0 - mu**2), np.zeros(n), mu], axis=1)
    shapes = np.repeat(np.maximum(rng.random(n) ** 2, 1e-3)[:, None], 3, axis=1)
    where = Device(device)
    for ior in (1.05, 1.5, 2.42):
        key = wrt.RoughDielectric(ior, alpha=0.3, multiple_bounces=True).table_key
        tables = upload(table(key, where), wp.float32, device)
        for front in (True, False):
            arrays = [upload(directions, wp.vec3, device), upload(shapes, wp.vec3, device)]
            looked_up, computed = (wp.empty(n, dtype=float, device=device) for _ in range(2))
            wp.launch(look_up, n, [front, tables, *arrays], [looked_up], device=device)
            eta = ior if front else 1.0 / ior
            where.launch(make_missing_dielectric_kernel("ggx", "smith"), n, [8192, eta, *arrays, computed])
            error = looked_up.numpy() - computed.numpy()
            off = float(np.abs(error[mu > 0.0017]).max())
            report(f"index {ior}, {'outside' if front else 'inside'}: 1 − E off by at most", off, 0.0)
            assert off < 5e-3
            assert error.max() < 8e-3  # beyond 89.9 degrees, where the table has its last points, the most is 6.1e-3


@pytest.mark.parametrize("multiple", MULTIPLE)
@pytest.mark.parametrize("front", [True, False])
def test_a_boundary_between_equal_media_is_none(front: bool, multiple: bool, device: str) -> None:
    wo = np.concatenate([hemisphere(1000, seed=1), [viewer(a) for a in (0.0, 89.0, 89.99)]])
    material = wrt.RoughDielectric(1.3304, 1.33, alpha=0.5, multiple_bounces=multiple)
    found = Case(material, front).sample(wo, uniforms(len(wo), 3, seed=2), device)
    np.testing.assert_array_equal(found["wi"], -wo.astype(np.float32))
    assert (found["weight"] == 1.0).all()
    assert (found["eta"] == 1.0).all()
    assert found["delta"].all()
    value, pdf, _ = Case(material, front).evaluate(wo, -wo, device)
    assert not value.any()
    assert not pdf.any()


@pytest.mark.parametrize("front", [True, False])
def test_the_smoothest_is_nearly_smooth(front: bool, device: str) -> None:
    """At a roughness of 1e-4 the same random numbers bring directions and weights of a smooth boundary."""
    wo = hemisphere(20_000, seed=5)
    wo = wo[wo[:, 2] > 0.02]
    u = uniforms(len(wo), 3, seed=6)
    rough = Case(wrt.RoughDielectric(1.5, alpha=1e-4), front).sample(wo, u, device)
    smooth = Case(wrt.Dielectric(1.5), front).sample(wo, u, device)
    same = np.abs(rough["wi"] - smooth["wi"]).max(axis=1) < 0.01
    # Others chose the other way, just at its probability, or are within a facet's slope of the critical angle.
    assert same.mean() > 0.997
    np.testing.assert_allclose(rough["weight"][same], smooth["weight"][same], rtol=2e-3)
    np.testing.assert_array_equal(rough["eta"][same], smooth["eta"][same])


@pytest.mark.parametrize("multiple", MULTIPLE)
def test_tints_multiply_reflection_and_transmission(multiple: bool, device: str) -> None:
    red, blue = (0.9, 0.1, 0.0), (0.0, 0.2, 0.8)
    wo, wi = hemisphere(10_000, seed=7), sphere(10_000, seed=9)
    plain, tinted = (
        Case(wrt.RoughDielectric(alpha=0.3, multiple_bounces=multiple, **tints)).evaluate(wo, wi, device)[0]
        for tints in ({}, {"specular_reflectance": red, "specular_transmittance": blue})
    )
    np.testing.assert_allclose(tinted, plain * np.where(wi[:, 2:] > 0.0, red, blue), rtol=1e-6)


def test_media_have_names(tmp_path: Path) -> None:
    assert wrt.Dielectric("diamond").ior == 2.42
    assert wrt.RoughDielectric("Water", "air").relative_ior == pytest.approx(1.335)
    for make, values, message in (
        (wrt.ThinDielectric, ("watr",), r"^ior: 'watr' is not a known dielectric \(did you mean 'water'\?\)"),
        (wrt.Dielectric, (1.5, 0.0), r"^exterior_ior must be greater than 0, not 0$"),
        (wrt.RoughDielectric, (1.5, 1.0, 0.0), r"^alpha must be at least 0.0001, not 0$"),
        (wrt.RoughDielectric, (1.5, 1.0, 0.3, "ggx", "smith", 1), r"^multiple_bounces must be true or false, not 1$"),
        (lambda fresnel: wrt.Dielectric(fresnel=fresnel), ("Schlick",), "fresnel must be one of exact, schlick"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            make(*values)
    scene = """
    [materials.a]
    type = "rough-dielectric"
    ior = "window glass"
    alpha = [0.1, 0.2]
    distribution = "beckmann"
    multiple_bounces = true
    specular_transmittance = [0.5, 0.6, 0.7]
    [materials.b]
    type = "thin-dielectric"
    specular_reflectance = 0.5
    [[shapes]]
    type = "sphere"
    material = "a"
    [[shapes]]
    type = "sphere"
    material = "b"
    """
    (tmp_path / "scene.toml").write_text(scene)
    first, second = (shape.material for shape in wrt.load(tmp_path / "scene.toml").shapes)
    assert first == wrt.RoughDielectric(
        1.51, 1.0, (0.1, 0.2), "beckmann", "smith", True, specular_transmittance=(0.5, 0.6, 0.7)
    )
    assert second == wrt.ThinDielectric(specular_reflectance=0.5)
