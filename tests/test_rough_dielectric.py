"""Transparent boundaries: rough ones are Walter's model and lose no light that they need not, thin ones are panes."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support import rough_glass
from support.bsdfs import (
    ANGLES,
    Case,
    albedo,
    assert_finite,
    assert_weights,
    hemisphere,
    reciprocity_error,
    sphere,
    viewer,
)
from support.kernels import uniforms, upload
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram, t_test_mean
from test_fresnel import cook_torrance

import wrt
from wrt.backend.device import Device
from wrt.scene.materials.dielectrics import mean_transmittance

pytestmark = pytest.mark.slow

UPSIDE_DOWN = np.array([1.0, 1.0, -1.0])
SIDES = {"outside": True, "inside": False}
ALPHAS = (0.05, 0.3, 1.0)


def glass(alpha: Any = 0.3, ior: float | str = 1.5, **kwargs: Any) -> wrt.RoughDielectric:
    return wrt.RoughDielectric(ior, alpha=alpha, **kwargs)


MATERIALS = {f"alpha {alpha}": glass(alpha) for alpha in ALPHAS}
MATERIALS |= {
    "Beckmann": glass(distribution="beckmann", masking="walter"),
    "anisotropic": glass((0.1, 0.5), 1.33),
    "multiple bounces": glass(0.6, multiple_bounces=True),
    "anisotropic, multiple bounces": glass((0.1, 0.5), 1.33, multiple_bounces=True),
}
CASES = {
    f"{name}, {side}": Case(material, front) for name, material in MATERIALS.items() for side, front in SIDES.items()
}
# All angles where only the roughness differs; the rest at one that is beyond the critical angle inside.
SEEN = [(name, degrees) for name in CASES for degrees in (ANGLES if name.startswith("alpha") else (60.0,))]


@functools.cache
def cells(name: str, degrees: float) -> NDArray[np.float64]:
    """Return the integral of the density over the cells of a histogram."""
    wo = viewer(degrees)
    tolerance = 1e-6 if CASES[name].material.multiple_bounces else 1e-7  # a table has many kinks
    return integrate_pdf_over_bins(lambda wi: CASES[name].evaluate(wo, wi, "cpu")[1], tolerance=tolerance)


@pytest.mark.parametrize(("name", "degrees"), SEEN)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    """Samples that the surface hides from one side or the other are lost; the density is short of 1 by their share."""
    n = 2**18
    found = CASES[name].sample(viewer(degrees), uniforms(n, 3, seed=int(degrees)), device)
    there = found["pdf"] > 0.0
    assert not found["delta"].any()
    expected = cells(name, degrees)
    assert expected.sum() < 1.0 + 1e-4
    result = chi_square_test(sphere_histogram(found["wi"][there]), n * expected, tests=len(SEEN), samples=n)
    report(f"{name} at {degrees:g}°: density in total {expected.sum():.4f}", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    assert_weights(CASES[name], degrees, device)


@pytest.mark.parametrize("name", CASES)
def test_reflection_is_reciprocal(name: str, device: str, report: Report) -> None:
    error = reciprocity_error(CASES[name], device)
    report(f"{name}: largest difference of f(wo, wi) and f(wi, wo)", error, 0.0)
    assert error < 1e-4


@pytest.mark.parametrize("name", MATERIALS)
def test_refraction_is_reciprocal(name: str, device: str, report: Report) -> None:
    """Over the square of the index where light goes, f is the same along a path and back (Walter 2007, section 2)."""
    material = MATERIALS[name]
    out, into = hemisphere(100_000, seed=2), hemisphere(100_000, seed=3) * UPSIDE_DOWN
    seen_outside = Case(material).evaluate(out, into, device)[0][:, 0] / -into[:, 2]
    seen_inside = (
        Case(material, front=False).evaluate(into * UPSIDE_DOWN, out * UPSIDE_DOWN, device)[0][:, 0] / out[:, 2]
    )
    there, back = seen_outside * material.relative_ior**2, seen_inside
    assert (there > 0.0).mean() > 0.1
    # The cosine to a facet that is seen edge-on has few digits, and f is proportional to it.
    scale = np.maximum(np.maximum(there, back), 1e-2 * np.median(back[back > 0.0]))
    error = np.abs(there - back) / scale
    report(f"{name}: difference of f n², median and largest", f"{np.median(error):.2g}", f"{error.max():.2g}")
    assert np.quantile(error, 0.999) < 1e-4
    assert error.max() < 1e-2


@pytest.mark.parametrize("name", CASES)
def test_no_energy_is_made(name: str, device: str) -> None:
    for degrees in ANGLES:
        mean, error = albedo(CASES[name], degrees, device, samples=2**18)
        # What is given back is right to 3 in 1000, either way.
        slack = 3e-3 if CASES[name].material.multiple_bounces else 1e-6
        assert (mean <= 1.0 + slack + 3.5 * error).all(), f"{degrees}°: {mean}"


WHITE = [
    (ior, alpha, front) for ior in (1.05, 1.5, 2.42) for alpha in (0.001, 0.1, 0.3, 1.0) for front in (True, False)
]


def test_white_furnace(device: str, report: Report) -> None:
    """Glass keeps all light: within 1 % with multiple bounces, at every roughness, from both sides."""
    scores = []
    for ior, alpha, front in WHITE:
        single, multiple = [], []
        for degrees in (0.0, 30.0, 45.0, 60.0, 80.0, 87.0, 89.0):
            single.append(float(albedo(Case(glass(alpha, ior), front), degrees, device, samples=2**12)[0][0]))
            mean, error = albedo(Case(glass(alpha, ior, multiple_bounces=True), front), degrees, device, samples=2**14)
            multiple.append(float(mean[0]))
            scores.append(max(abs(mean[0] - 1.0) - 5e-3, 0.0) / (error[0] + 1e-6))
        side = "outside" if front else "inside"
        report(f"index {ior}, alpha {alpha}, {side}: least energy kept by one bounce", min(single))
        report(f"index {ior}, alpha {alpha}, {side}: and by multiple ones", min(multiple), 1.0)
    assert max(scores) < 3.5


def test_what_is_tabulated_is_what_is_lost(device: str, report: Report) -> None:
    """Between the table's own points, to 5e-3 up to 89.9 degrees: as white is the furnace. Nowhere is more made."""
    import warp as wp

    from wrt.kernels.bsdf.lobes.albedo import missing_energy
    from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel, side_table
    from wrt.upload.tables.material_tables import table

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
    n = 600
    mu = np.concatenate([rng.random(n // 2), 0.1 * rng.random(n // 2) ** 3])
    directions = np.stack([np.sqrt(1.0 - mu**2), np.zeros(n), mu], axis=1)
    shapes = np.repeat(np.maximum(rng.random(n) ** 2, 1e-3)[:, None], 3, axis=1)
    where = Device(device)
    for ior in (1.05, 1.5, 2.42):
        tables = upload(table(glass(0.3, ior, multiple_bounces=True).table_key, where), wp.float32, device)
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


def test_mean_transmittance() -> None:
    """By the sum over angles, where its integrand is not smooth too; and n² τ is the same on both sides (Stokes)."""
    mu = (np.arange(400_000) + 0.5) / 400_000
    for ior in (1.0001, 1.05, 1.5, 1.0 / 1.5, 3.0):
        for eta in (ior, 1.0 / ior):
            expected = np.mean(2.0 * mu * (1.0 - cook_torrance(mu, np.array([eta]))))
            np.testing.assert_allclose(mean_transmittance(eta), expected, atol=2e-5)


FINITE = [glass(a, multiple_bounces=m) for a in (1e-4, 1.0) for m in (False, True)]
FINITE += [glass(a, ior, multiple_bounces=True) for a in (1e-4, 1.0) for ior in (1.0, 1.0012, 2.42)]
FINITE += [glass(0.3, specular_reflectance=0.0, specular_transmittance=0.0)]


@pytest.mark.parametrize("side", SIDES)
def test_corners_are_finite(side: str, device: str) -> None:
    for material in FINITE:
        assert_finite(Case(material, SIDES[side]), device)


@pytest.mark.parametrize("side", SIDES)
def test_a_boundary_between_equal_media_is_none(side: str, device: str) -> None:
    for multiple in (False, True):
        case = Case(glass(0.5, 1.3304, exterior_ior=1.33, multiple_bounces=multiple), SIDES[side])
        wo = np.concatenate([hemisphere(1000, seed=1), [viewer(a) for a in (0.0, 89.0, 89.99)]])
        found = case.sample(wo, uniforms(len(wo), 3, seed=2), device)
        np.testing.assert_array_equal(found["wi"], -wo.astype(np.float32))
        assert (found["weight"] == 1.0).all()
        assert (found["eta"] == 1.0).all()
        assert found["delta"].all()
        value, pdf, _ = case.evaluate(wo, -wo, device)
        assert (value == 0.0).all()
        assert (pdf == 0.0).all()


@pytest.mark.parametrize("side", SIDES)
def test_the_smoothest_is_nearly_smooth(side: str, device: str) -> None:
    """At a roughness of 1e-4 the same random numbers bring directions and weights of a smooth boundary."""
    wo, u = hemisphere(20_000, seed=5), uniforms(20_000, 3, seed=6)
    wo = wo[wo[:, 2] > 0.02]
    u = u[: len(wo)]
    rough = Case(glass(1e-4), SIDES[side]).sample(wo, u, device)
    smooth = Case(wrt.Dielectric(1.5), SIDES[side]).sample(wo, u, device)
    same = np.abs(rough["wi"] - smooth["wi"]).max(axis=1) < 0.01
    # Others chose the other way, just at its probability, or are within a facet's slope of the critical angle.
    assert same.mean() > 0.997
    np.testing.assert_allclose(rough["weight"][same], smooth["weight"][same], rtol=2e-3)
    np.testing.assert_array_equal(rough["eta"][same], smooth["eta"][same])


def test_tints_multiply_each_way(device: str) -> None:
    wo, u = hemisphere(10_000, seed=7), uniforms(10_000, 3, seed=8)
    red, blue = (0.9, 0.1, 0.0), (0.0, 0.2, 0.8)
    for make in (wrt.Dielectric, wrt.ThinDielectric, glass):
        plain = Case(make()).sample(wo, u, device)
        tinted = Case(make(specular_reflectance=red, specular_transmittance=blue)).sample(wo, u, device)
        np.testing.assert_array_equal(tinted["wi"], plain["wi"])
        tint = np.where(tinted["wi"][:, 2:] > 0.0, red, blue)
        np.testing.assert_allclose(tinted["weight"], plain["weight"] * tint, rtol=1e-6)
    wi = sphere(10_000, seed=9)
    for multiple in (False, True):
        plain, tinted = (
            Case(glass(multiple_bounces=multiple, **tints)).evaluate(wo, wi, device)[0]
            for tints in ({}, {"specular_reflectance": red, "specular_transmittance": blue})
        )
        np.testing.assert_allclose(tinted, plain * np.where(wi[:, 2:] > 0.0, red, blue), rtol=1e-6)


def test_a_pane_sums_reflections_between_its_faces(device: str) -> None:
    """By adding up 200 of them; also a pane of air in water, which light cannot enter at grazing angles."""
    n = 2**18
    for ior, exterior in ((1.5, 1.0), (2.42, 1.0), (1.0, 1.33)):
        for degrees in (0.0, 45.0, 80.0):
            r = float(cook_torrance(np.array([np.cos(np.radians(degrees))]), np.array([ior / exterior]))[0])
            expected = r + (1.0 - r) ** 2 * sum(r ** (2 * k + 1) for k in range(200))
            for front in (True, False):
                case = Case(wrt.ThinDielectric(ior, exterior), front)
                found = case.sample(viewer(degrees), uniforms(n, 3, seed=3), device)
                reflected = (found["wi"][:, 2] > 0.0).mean()
                assert abs(reflected - expected) < 4.0 * np.sqrt(0.25 / n)
                straight = found["wi"][found["wi"][:, 2] < 0.0]
                np.testing.assert_array_equal(straight, np.broadcast_to(-viewer(degrees), straight.shape).astype("f4"))
                assert (found["weight"] == 1.0).all()
                assert (found["eta"] == 1.0).all()


# --- In pictures -----------------------------------------------------------------------------------


@pytest.mark.parametrize("multiple", [True, False])
def test_a_rough_glass_ball_in_a_furnace(multiple: bool, device: str, report: Report) -> None:
    """With multiple bounces it cannot be told from the background; without, light is lost."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=26)
    ball = wrt.sphere(subdivisions=3)
    # Without interpolated normals, below whose horizon a little light is always lost.
    scene.add(wrt.Mesh(ball.vertices, ball.faces), material=glass(0.5, multiple_bounces=multiple))
    renderer = wrt.Renderer(scene, sampler="independent", width=24, height=24, seed=2, max_depth=1000, device=device)
    for _ in renderer.passes(spp=256):
        pass
    image, variance = renderer.image()[..., 0].astype(np.float64), renderer.variance()[..., 0]
    error = float(np.sqrt(variance.sum())) / image.size
    report(f"multiple bounces: {multiple}; mean radiance", float(image.mean()), 1.0 if multiple else "< 1")
    report("standard error", error)
    if multiple:
        assert abs(image.mean() - 1.0) < 0.005 + 3.0 * error
    else:
        assert image.mean() < 0.9


@pytest.mark.parametrize("multiple", [False, True])
def test_a_lamp_seen_through_ground_glass(multiple: bool, device: str, report: Report) -> None:
    """However it is sampled, its radiance is the integral of Walter's f cosθ over the lamp behind the surface."""
    alpha, eta = 0.4, 1.3
    material = glass(alpha, eta, multiple_bounces=multiple)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0.0, 0.0, 3.0), fov_degrees=0.001))
    scene.add(wrt.quad((-50, -50, 0), (100, 0, 0), (0, 100, 0)), material=material)
    low, high, distance = np.array([-0.2, 0.1]), np.array([0.9, 0.8]), 1.0
    lamp = wrt.quad((low[0], low[1], -distance), (high[0] - low[0], 0, 0), (0, high[1] - low[1], 0))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=1.0)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    x, y = (low[i] + (high[i] - low[i]) * 0.5 * (nodes + 1.0) for i in range(2))
    places = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((16, 16), -distance)], axis=-1).reshape(-1, 3)
    length = np.linalg.norm(places, axis=1)
    solid_angle = np.outer(weights, weights).ravel() * 0.25 * np.prod(high - low) * distance / length**3
    wo, wi = np.array([[0.0, 0.0, 1.0]]), places / length[:, None]
    value = rough_glass.refracted_value(wo, wi, alpha, eta)
    if multiple:
        value = value + rough_glass.refracted_lobe(wo, wi, alpha, eta)
    expected = float((value * solid_angle).sum())
    own = Case(material).evaluate(wo, wi, device)[0][:, 0]
    # The lobes of further bounces are tabulated. At 20° they are 0.2 % of f, beyond the facets' refraction all of it.
    rtol, bias = (6e-3, 5e-5) if multiple else (5e-5, 0.0)
    report("f, largest error", float((np.abs(own - value) / value.clip(min=1e-6)).max()), f"< {rtol}")
    np.testing.assert_allclose(own, value, rtol=rtol, atol=1e-9)
    for strategy in ("mis", "light", "bsdf"):
        renderer = wrt.Renderer(
            scene, sampler="independent", width=8, height=8, seed=3, strategy=strategy, max_depth=2, device=device
        )
        for _ in renderer.passes(spp=1024):
            pass
        mean = float(renderer.image()[..., 0].astype(np.float64).mean())
        variance = float(renderer.variance()[..., 0].sum()) / 64**2
        nearest = float(np.clip(mean, expected * (1.0 - bias), expected * (1.0 + bias)))
        p = float(t_test_mean(mean, variance, 64 * 1024, nearest))
        report(f"{strategy}: radiance", mean, expected, p=p)
        assert p > 1e-3


# --- What people type ------------------------------------------------------------------------------


def test_media_have_names(tmp_path: Path) -> None:
    assert wrt.Dielectric("diamond").ior == 2.42
    assert wrt.RoughDielectric("Water", "air").relative_ior == pytest.approx(1.335)
    with pytest.raises(wrt.InputError, match=r"^ior: 'watr' is not a known dielectric \(did you mean 'water'\?\)"):
        wrt.ThinDielectric("watr")
    with pytest.raises(wrt.InputError, match=r"^exterior_ior must be greater than 0, not 0$"):
        wrt.Dielectric(1.5, 0.0)
    with pytest.raises(wrt.InputError, match=r"^alpha must be at least 0.0001, not 0$"):
        glass(0.0)
    with pytest.raises(wrt.InputError, match=r"^multiple_bounces must be true or false, not 1$"):
        glass(multiple_bounces=1)
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
