"""Diffuse bases under transparent coats: what the coat leaves, no more and, in white, no less."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import (
    ANGLES,
    EPS,
    Case,
    albedo,
    assert_finite,
    assert_nothing_goes_through,
    assert_weights,
    chi_square,
    hemisphere,
    reciprocity_error,
    total_pdf,
    viewer,
)
from support.kernels import uniforms

import wrt
from wrt.backend.device import Device
from wrt.scene.materials.plastics import internal_reflectance
from wrt.upload.tables.coat import coat_table

pytestmark = pytest.mark.slow

COLOR = (0.8, 0.4, 0.0)
SMOOTH = {
    "smooth": Case(wrt.Plastic(COLOR)),
    "smooth, deep colours, back": Case(wrt.Plastic(COLOR, nonlinear=True), front=False),
}
ROUGH = {
    "ggx 0.03": Case(wrt.RoughPlastic(COLOR, alpha=0.03)),
    "ggx 0.3, back": Case(wrt.RoughPlastic(COLOR, alpha=0.3, specular_reflectance=0.5), front=False),
    "ggx 1": Case(wrt.RoughPlastic(COLOR, alpha=1.0, nonlinear=True, multiple_bounces=True)),
    "ggx 0.3 under water": Case(wrt.RoughPlastic(COLOR, ior=1.1, exterior_ior="water", alpha=0.3)),
    "beckmann 0.3": Case(wrt.RoughPlastic(COLOR, alpha=0.3, distribution="beckmann", masking="walter")),
}
CASES = SMOOTH | ROUGH


def fresnel(cos_i: NDArray, eta: float) -> NDArray:
    """Return F of a dielectric by Snell's angles: Fresnel's sine and tangent laws, as kernels do not compute it."""
    theta = np.arccos(np.clip(cos_i, 0.0, 1.0 - 1e-12))
    sine = np.sin(theta) / eta
    inner = np.arcsin(np.minimum(sine, 1.0))
    r_s = np.sin(theta - inner) / np.sin(theta + inner)
    r_p = np.tan(theta - inner) / np.tan(theta + inner)
    return np.where(sine >= 1.0, 1.0, 0.5 * (r_s**2 + r_p**2))


def diffuse_reflectance(n: float) -> float:
    """Return 2 ∫ F cosθ d cosθ from the side of the lower index, in closed form (Walsh 1926; Duntley 1942)."""
    a, b = n * n - 1.0, n * n + 1.0
    terms = 0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) ** 2)
    terms += n**2 * a**2 / b**3 * np.log((n - 1.0) / (n + 1.0))
    terms -= 2.0 * n**3 * (n * n + 2.0 * n - 1.0) / (b * (n**4 - 1.0))
    return float(terms + 8.0 * n**4 * (n**4 + 1.0) / (b * (n**4 - 1.0) ** 2) * np.log(n))


def egan_hilgeman(eta: float) -> float:
    """Return the fit of Egan and Hilgeman (1973) to the internal diffuse reflectance, which Mitsuba uses."""
    x = 1.0 / eta
    return -1.4399 * x**2 + 0.7099 * x + 0.6681 + 0.0636 / x


# --- What every model must do -----------------------------------------------------------------------


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    result = chi_square(CASES[name], degrees, device, tests=len(CASES) * len(ANGLES), samples=2**18)
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    assert_weights(CASES[name], degrees, device)


def test_density_is_at_most_whole(device: str, report: Report) -> None:
    """Microfacets send some samples below the horizon; those are lost. A smooth coat's are in the mirror direction."""
    for name in ("smooth", "ggx 0.3, back"):
        case = CASES[name]
        for degrees in (45.0, 80.0):
            total = total_pdf(case, degrees, device)
            found = case.sample(viewer(degrees), uniforms(2**18, 3, seed=50), device)
            drawn = float((found["pdf"] > 0.0).mean())
            report(f"{name} at {degrees:g}°: integral", total, drawn)
            assert abs(total - drawn) < 4.0 * np.sqrt(drawn * (1.0 - drawn) / 2**18) + 1e-4
            assert total <= 1.0 + 1e-4


@pytest.mark.parametrize("name", CASES)
def test_reciprocity(name: str, device: str) -> None:
    assert reciprocity_error(CASES[name], device) < 1e-5


@pytest.mark.parametrize("name", CASES)
def test_nothing_goes_through(name: str, device: str) -> None:
    assert_nothing_goes_through(CASES[name], device)


@pytest.mark.parametrize(
    ("alpha", "multiple"), [(0.0, False), *((a, b) for a in (1e-3, 0.1, 0.5, 1.0) for b in (False, True))]
)
def test_no_energy_is_made_and_white_stays_white(alpha: float, multiple: bool, device: str, report: Report) -> None:
    """A white base keeps nothing. Under a rough coat that holds with multiple bounces, within 1 %."""
    white = wrt.RoughPlastic(1.0, alpha=alpha, multiple_bounces=multiple) if alpha else wrt.Plastic(1.0)
    for degrees in (*ANGLES, 89.9):
        mean, error = albedo(Case(white), degrees, device)
        report(f"albedo at α = {alpha:g}, {degrees:g}°", float(mean[0]), 1.0 if multiple or not alpha else "<= 1")
        assert (mean <= 1.0 + 3.0 * error + (3e-3 if multiple else 4.0 * EPS)).all()
        if multiple or not alpha:
            assert (mean >= 1.0 - 3.0 * error - (0.01 if alpha else 0.0)).all()


@pytest.mark.parametrize(
    "material",
    [
        wrt.Plastic(0.0),
        wrt.Plastic(1.0, ior=1.0),
        wrt.Plastic(0.0, ior=1.0, nonlinear=True),
        wrt.Plastic(0.0, specular_reflectance=0.0),
        wrt.Plastic(1.0, ior=1.0, exterior_ior=2.0),
        wrt.RoughPlastic(0.0, alpha=1e-4),
        wrt.RoughPlastic(1.0, alpha=1e-4, nonlinear=True, multiple_bounces=True),
        wrt.RoughPlastic(1.0, alpha=1.0, ior=1.0),
        wrt.RoughPlastic(1.0, alpha=1e-4, ior=1.0, exterior_ior=2.5, specular_reflectance=0.0),
        wrt.RoughPlastic(1.0, alpha=1e-4, distribution="beckmann", masking="walter"),
    ],
    ids=repr,
)
def test_everything_is_finite(material: wrt.Material, device: str) -> None:
    assert_finite(Case(material), device)


# --- The smooth coat --------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.0001, 1.1, 1.33, 1.5, 1.9, 2.42, 5.0])
def test_internal_reflectance_is_exact(eta: float, report: Report) -> None:
    """Against the closed form for light from outside, by 1 − R = (1 − R_outside) / η²."""
    found = internal_reflectance(eta)
    assert found == pytest.approx(1.0 - (1.0 - diffuse_reflectance(eta)) / eta**2, abs=1e-8)
    assert internal_reflectance(1.0 / eta) == pytest.approx(diffuse_reflectance(eta), abs=1e-8)
    report(f"η = {eta}: R, and the fit of 1973", found, egan_hilgeman(eta))


def test_without_a_step_of_index_there_is_no_coat(device: str) -> None:
    assert internal_reflectance(1.0) == pytest.approx(0.0, abs=1e-12)
    wo, wi = hemisphere(10_000, seed=52), hemisphere(10_000, seed=53)
    value, pdf, _ = Case(wrt.Plastic(COLOR, ior=1.33, exterior_ior=1.33)).evaluate(wo, wi, device)
    lambert, cosine, _ = Case(wrt.Diffuse(COLOR)).evaluate(wo, wi, device)
    np.testing.assert_allclose(value, lambert, rtol=1e-5)
    np.testing.assert_allclose(pdf, cosine, rtol=1e-5)


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
        expected = rho * shift * (1.0 - fresnel(viewer(degrees)[2], eta))
        np.testing.assert_allclose(base, expected, atol=2e-6)


def test_the_mirror_has_fresnels_share(device: str) -> None:
    """Samples: the mean weight of mirrored directions is F times the stated factor."""
    case = Case(wrt.Plastic(COLOR, specular_reflectance=(1.0, 0.5, 0.0)))
    for degrees in ANGLES:
        found = case.sample(viewer(degrees), uniforms(2**18, 3, seed=54), device)
        mirrored = found["delta"].astype(bool)
        np.testing.assert_array_equal(
            found["wi"][mirrored],
            np.broadcast_to((viewer(degrees) * [-1, -1, 1]).astype(np.float32), found["wi"][mirrored].shape),
        )
        weight = np.where(mirrored[:, None], found["weight"].astype(np.float64), 0.0)
        error = weight.std(axis=0) / np.sqrt(len(weight))
        expected = fresnel(viewer(degrees)[2], 1.5) * np.array([1.0, 0.5, 0.0])
        assert (np.abs(weight.mean(axis=0) - expected) <= 3.5 * error + 1e-6).all()


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
    seen = d * np.maximum(cos_m, 0.0) / wo[2] * smith_g1(wo, alpha) * solid
    f = fresnel(np.clip(cos_m, 1e-9, 1.0), eta)
    cos_t = np.sqrt(np.maximum(1.0 - (1.0 - cos_m**2) / eta**2, 0.0))
    down = m * (cos_m / eta - cos_t)[:, None] - wo / eta
    up = 2.0 * cos_m[:, None] * m - wo
    refracted = np.where(down[:, 2] < 0.0, seen * (1.0 - f) * smith_g1(down, alpha), 0.0)
    reflected = np.where(up[:, 2] > 0.0, seen * f * smith_g1(up, alpha), 0.0)
    return float(refracted.sum()), float(reflected.sum())


def look_up(table: NDArray[np.float32], cosine: NDArray | float) -> NDArray:
    """Return T of a table for one roughness."""
    rows = int(table[0])
    return np.asarray(np.interp(np.sqrt(cosine), np.linspace(0.0, 1.0, rows), table[3:]))


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


def test_one_table_serves_all_roughnesses(device: str, report: Report) -> None:
    """Where roughness varies over a surface, its table has columns; they agree with that of each roughness alone."""
    many = wrt.RoughPlastic(1.0, alpha=wrt.VertexColor()).table_key
    assert many[4] is None
    for alpha in (1e-3, 0.05, 0.37, 1.0):
        constant = wrt.RoughPlastic((0.0, 0.5, 1.0), alpha=alpha, nonlinear=True)
        varying = VaryingRoughness((0.0, 0.5, 1.0), alpha=alpha, nonlinear=True)
        assert varying.table_key == many
        # Away from the mirror direction, so that it is the base that is compared.
        wo, wi = viewer(70.0, 0.0), hemisphere(5000, seed=55)
        wi[:, 0] = np.abs(wi[:, 0])
        a = Case(constant).evaluate(wo, wi, device)[0][:, 2]
        b = Case(varying).evaluate(wo, wi, device)[0][:, 2]
        report(f"α = {alpha}: largest relative difference", float(np.abs(a / b - 1.0).max()))
        far = wi[:, 2] > 0.05
        np.testing.assert_allclose(a[far], b[far], rtol=5e-3)


class VaryingRoughness(wrt.RoughPlastic):
    """A constant roughness that reads the table of all roughnesses."""

    @property
    def table_key(self) -> tuple:
        key = super().table_key
        return (*key[:4], None, key[5])


def test_a_smooth_coat_is_the_limit_of_rough_ones(device: str) -> None:
    wo, wi = viewer(40.0, 0.0), hemisphere(5000, seed=56)
    wi[:, 0] = np.abs(wi[:, 0])
    smooth = Case(wrt.Plastic(COLOR, nonlinear=True)).evaluate(wo, wi, device)[0]
    rough = Case(wrt.RoughPlastic(COLOR, alpha=1e-4, nonlinear=True)).evaluate(wo, wi, device)[0]
    far = wi[:, 2] > 0.01
    np.testing.assert_allclose(rough[far], smooth[far], rtol=2e-3, atol=1e-6)


def test_textured_roughness_in_a_furnace(device: str) -> None:
    """The whole path: a white coat of any roughness and deep colours under a constant sky cannot be seen."""
    ball = wrt.sphere(subdivisions=3)
    levels = np.linspace(0.05, 1.0, 64, dtype=np.float32).reshape(8, 8, 1) * np.ones(3, np.float32)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=20)
    uvs = np.asarray(ball.vertices, np.float32)[:, :2] * 0.5 + 0.5
    material = wrt.RoughPlastic(1.0, alpha=wrt.ImageTexture(levels), nonlinear=True, multiple_bounces=True)
    scene.add(wrt.Mesh(ball.vertices, ball.faces, uvs=uvs), material=material)
    image = wrt.render(scene, width=16, height=16, spp=256, device=device)
    assert float(image.mean()) == pytest.approx(1.0, abs=5e-3)


def test_all_estimators_find_the_same_light(device: str) -> None:
    """A mirror and a base in one material: by light sampling, by the BSDF and by both."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0.0, 1.0, 2.0), target=(0.0, 0.0, 0.0), fov_degrees=40))
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Plastic((0.6, 0.3, 0.1)))
    scene.add(wrt.quad((-0.5, 0.3, -2.0), (1.0, 0, 0), (0, 1.0, 0)), emission=1.0)
    means, errors = [], []
    for strategy in ("mis", "light", "bsdf"):
        renderer = wrt.Renderer(
            scene, sampler="independent", width=24, height=24, seed=3, strategy=strategy, device=device
        )
        for _ in renderer.passes(spp=256):
            pass
        means.append(float(renderer.image()[..., 0].astype(np.float64).mean()))
        errors.append(float(np.sqrt(renderer.variance()[..., 0].sum())) / 24**2)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert abs(means[i] - means[j]) < 4.0 * np.hypot(errors[i], errors[j])


@pytest.mark.parametrize(
    "bad",
    [{"ior": 0.0}, {"ior": "jelly"}, {"reflectance": 1.5}, {"nonlinear": "yes"}, {"specular_reflectance": -1.0}],
    ids=repr,
)
def test_impossible_values_are_refused(bad: dict) -> None:
    for material in (wrt.Plastic, wrt.RoughPlastic):
        with pytest.raises(wrt.InputError, match=next(iter(bad))):
            material(**bad)


@pytest.mark.parametrize(
    "bad",
    [
        {"alpha": 0.0},
        {"alpha": 1.1},
        {"distribution": "abc"},
        {"distribution": "blinn-phong"},
        {"masking": "walter"},
        {"multiple_bounces": 1},
    ],
    ids=repr,
)
def test_impossible_coats_are_refused(bad: dict) -> None:
    with pytest.raises(wrt.InputError, match=next(iter(bad))):
        wrt.RoughPlastic(**bad)
