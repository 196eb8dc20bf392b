"""Coated bases have the values and densities of Mitsuba 3, but for what it approximates: each such thing is derived.

Mitsuba's `plastic` takes a fit for the light sent back from below. Its `roughplastic` takes the mean of 64 values for
that, of single reflections, so that it loses what facets block there; a table of 64 values of T, linear in the
cosine; and, for Beckmann's distribution, Walter's rational fit of Smith's function, in densities too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, hemisphere
from support.kernels import uniforms, upload
from test_plastic import egan_hilgeman, look_up
from test_rough_conductor import g1_fit, smith_lambda_beckmann, stretched_cotangent

import wrt
from wrt.backend.device import Device
from wrt.io.mitsuba.materials.coats import internal_reflectances
from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel
from wrt.scene.materials.plastics import internal_reflectance
from wrt.scene.textures import ColorSource
from wrt.upload.tables.material_tables import table

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import load_mitsuba

N = 1000
COLOR = (0.5, 0.2, 0.1)
NODES = 64
MASKING = {"ggx": "smith-separable", "beckmann": "walter"}


def mitsuba(material: wrt.Plastic | wrt.RoughPlastic) -> Any:
    """Return Mitsuba's plugin for a material."""
    plugin: dict[str, Any] = {
        "type": "plastic",
        "int_ior": material.ior,
        "ext_ior": material.exterior_ior,
        "nonlinear": material.nonlinear,
        "diffuse_reflectance": {"type": "rgb", "value": list(material.reflectance)},
        "specular_reflectance": {"type": "rgb", "value": list(material.specular_reflectance)},
    }
    if isinstance(material, wrt.RoughPlastic):
        plugin |= {"type": "roughplastic", "alpha": material.alpha, "distribution": material.distribution}
    return load_mitsuba().load_dict(plugin)


def ask(bsdf: Any, wo: NDArray, wi: NDArray) -> tuple[NDArray, NDArray]:
    """Return (N, 3) values and (N,) densities of Mitsuba."""
    mi = load_mitsuba()
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    value, pdf = np.empty((len(wo), 3)), np.empty(len(wo))
    for i in range(len(wo)):
        surface.wi = mi.Vector3f(*wo[i].tolist())
        direction = mi.Vector3f(*wi[i].tolist())
        value[i] = np.array(bsdf.eval(context, surface, direction))
        pdf[i] = bsdf.pdf(context, surface, direction)
    return value, pdf


def at_nodes(n: int, seed: int) -> NDArray[np.float32]:
    """Return directions whose cosines are those of Mitsuba's table, where it does not interpolate."""
    random = np.random.default_rng(seed)
    z = random.integers(1, NODES, n) / (NODES - 1)
    phi = 2.0 * np.pi * random.random(n)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1).astype(np.float32)


def node_of(w: NDArray) -> NDArray[np.int64]:
    return np.rint(w[:, 2] * (NODES - 1)).astype(np.int64)


class FittedPlastic(wrt.Plastic):
    """Plastic with Mitsuba's fit in place of the integral."""

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        values = super().slots
        return (*values[:3], egan_hilgeman(self.relative_ior), values[4])


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize(("ior", "exterior"), [(1.5, 1.0), (1.9, 1.33)])
def test_smooth_plastic(ior: float, exterior: float, nonlinear: bool, device: str, report: Report) -> None:
    wo, wi = hemisphere(N, seed=60).astype(np.float32), hemisphere(N, seed=61).astype(np.float32)
    fitted = FittedPlastic(COLOR, ior, exterior, nonlinear, (1.0, 0.6, 0.5))
    expected, expected_pdf = ask(mitsuba(fitted), wo, wi)
    value, pdf, _ = Case(fitted).evaluate(wo, wi, device)
    np.testing.assert_allclose(value, expected, rtol=1e-4)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-4)
    exact = wrt.Plastic(COLOR, ior, exterior, nonlinear, (1.0, 0.6, 0.5))
    ratio = Case(exact).evaluate(wo, wi, device)[0] / expected
    fit, integral = egan_hilgeman(ior / exterior), internal_reflectance(ior / exterior)
    rho = np.array(COLOR) if nonlinear else 1.0
    np.testing.assert_allclose(ratio, np.broadcast_to((1.0 - rho * fit) / (1.0 - rho * integral), (N, 3)), rtol=1e-4)
    report(f"η = {ior / exterior:.3g}: what the exact integral changes", float(ratio.max() - 1.0))


def beckmann_fit(w: NDArray, alpha: float) -> tuple[NDArray, NDArray]:
    """Return G1 by Walter's fit over the exact one, and what of the fit is above 1 (only in Mitsuba)."""
    a = stretched_cotangent(w.astype(np.float64), (alpha, alpha))
    return g1_fit(a) * (1.0 + smith_lambda_beckmann(a)), np.maximum(g1_fit(a), 1.0)


@pytest.mark.parametrize("alpha", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_coat(distribution: str, alpha: float, device: str, report: Report) -> None:
    """A black base leaves the coat alone."""
    material = wrt.RoughPlastic(
        (0.0, 0.0, 0.0), alpha=alpha, distribution=distribution, masking=MASKING[distribution],
        specular_reflectance=(1.0, 0.5, 0.2),
    )  # fmt: skip
    case = Case(material)
    wo, wi = hemisphere(N, seed=62).astype(np.float32), hemisphere(N, seed=63).astype(np.float32)
    # Half of them anywhere, half where the lobe is.
    drawn = case.sample(wo[N // 2 :], uniforms(N // 2, 3, seed=64), device)
    up = drawn["wi"][:, 2] > 0.0
    wi[N // 2 :][up] = drawn["wi"][up]
    expected, expected_pdf = ask(mitsuba(material), wo, wi)
    value, pdf, _ = case.evaluate(wo, wi, device)
    if distribution == "beckmann":
        ratio, above_o = beckmann_fit(wo, alpha)
        _, above_i = beckmann_fit(wi, alpha)
        pdf = pdf * ratio
        value = value * (above_o * above_i)[:, None]
    # Mitsuba leaves out values of D cosθ below 1e-20.
    there = expected_pdf > 0.0
    assert there.sum() > N // 2
    assert (value[~there] < 1e-18).all()
    np.testing.assert_allclose(value[there], expected[there], rtol=1e-4)
    np.testing.assert_allclose(pdf[there], expected_pdf[there], rtol=1e-4)
    worst = float(np.abs(value[there] / expected[there] - 1.0).max())
    report(f"{distribution} {alpha}: largest relative difference", worst)


def transmittance_of(distribution: str, alpha: float) -> NDArray[np.float64]:
    """Return Mitsuba's T at its nodes, read from its densities: both lobes mix by 1 − T and T where both are white."""
    nodes = np.arange(NODES) / (NODES - 1)
    nodes[0] = nodes[1]  # not asked for
    wo = np.stack([np.sqrt(1.0 - nodes**2), 0.0 * nodes, nodes], axis=1)
    result = np.zeros(NODES)
    best = np.zeros(NODES)
    for x, z in ((0.6, 0.8), (np.sqrt(0.99), 0.1), (-np.sqrt(0.75), 0.5)):
        wi = np.broadcast_to([x, 0.0, z], wo.shape)
        pdfs = []
        for base in (1.0, 0.0):
            material = wrt.RoughPlastic((base,) * 3, alpha=alpha, distribution=distribution)
            pdfs.append(ask(mitsuba(material), wo, wi)[1])
        apart = z / np.pi - pdfs[1]
        share = (pdfs[0] - pdfs[1]) / apart
        # By the direction where the two lobes differ most.
        result = np.where(np.abs(apart) > best, share, result)
        best = np.maximum(best, np.abs(apart))
    return result


def internal_of(distribution: str, alpha: float, eta: float, device: str) -> float:
    """Return the mean that Mitsuba takes for the light sent back from below: of 64 cosines, single reflections."""
    nodes = np.maximum(np.linspace(0.0, 1.0, NODES), 1e-6)
    wo = np.stack([np.sqrt(1.0 - nodes**2), 0.0 * nodes, nodes], axis=1)
    out = [wp.empty(NODES, dtype=float, device=device) for _ in range(2)]
    inputs = [upload(wo, wp.vec3, device), upload(np.full(NODES, alpha), wp.float32, device), *out]
    kernel = make_coat_kernel(distribution, MASKING[distribution])
    Device(device).launch(kernel, NODES, [2**15, 1.0 / eta, *inputs])
    return 2.0 * float(np.mean(out[0].numpy().astype(np.float64) * nodes))


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("alpha", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_base(distribution: str, alpha: float, nonlinear: bool, device: str, report: Report) -> None:
    """Without its reflection, the coat leaves the base alone; with it, lobes are chosen alike."""
    parts = {"alpha": alpha, "distribution": distribution, "masking": MASKING[distribution], "nonlinear": nonlinear}
    parts["multiple_bounces"] = False  # Mitsuba has no more than one
    bare = wrt.RoughPlastic(COLOR, specular_reflectance=(0.0,) * 3, **parts)
    wo, wi = at_nodes(N, seed=65), at_nodes(N, seed=66)
    theirs = transmittance_of(distribution, alpha)
    ours = look_up(table(bare.table_key, Device(device)), np.arange(NODES) / (NODES - 1))
    # What gets in: the quadratures agree; of Beckmann's, to what the fit leaves.
    worst = float(np.abs(ours / theirs - 1.0)[1:].max())
    report(f"{distribution} {alpha}: largest relative difference of T", worst)
    assert worst < {"ggx": 1e-3, "beckmann": 6e-3}[distribution]
    # What the base sends back, once both have the same T and R.
    expected, expected_pdf = ask(mitsuba(bare), wo, wi)
    value, pdf, _ = Case(bare).evaluate(wo, wi, device)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-4)
    o, i = node_of(wo), node_of(wi)
    value *= (theirs[o] * theirs[i] / (ours[o] * ours[i]))[:, None]
    ratio = value / expected
    factor = np.median(ratio, axis=0)
    np.testing.assert_allclose(ratio, np.broadcast_to(factor, ratio.shape), rtol=1e-4)
    mean = internal_of(distribution, alpha, 1.5, device)
    internal = float(table(bare.table_key, Device(device))[2])
    # What scene files of Mitsuba go by.
    np.testing.assert_allclose(internal_reflectances(distribution, alpha, 1.5), (internal, mean), rtol=1e-3)
    rho = np.array(COLOR) if nonlinear else 1.0
    report(f"{distribution} {alpha}: light sent back from below, and Mitsuba's mean", internal, mean)
    np.testing.assert_allclose(factor, (1.0 - rho * mean) / (1.0 - rho * internal) * np.ones(3), rtol=2e-3)


@pytest.mark.parametrize("alpha", [0.1, 0.4, 1.0])
def test_rough_plastic_chooses_its_lobe_alike(alpha: float, device: str) -> None:
    """The whole density: the coat's by (1 − T) times its factor, the base's by T times its reflectance, both means."""
    parts = {"alpha": alpha, "masking": MASKING["ggx"], "specular_reflectance": (1.0, 0.9, 0.5)}
    parts["multiple_bounces"] = False
    wo, wi = at_nodes(N, seed=67), hemisphere(N, seed=68).astype(np.float32)
    material = wrt.RoughPlastic(COLOR, **parts)
    _, expected = ask(mitsuba(material), wo, wi)
    _, pdf, _ = Case(material).evaluate(wo, wi, device)
    _, coat, _ = Case(wrt.RoughPlastic((0.0,) * 3, **parts)).evaluate(wo, wi, device)
    # Mixed by Mitsuba's T, the lobes have its density, and by ours our own. Their T differ as above.
    ours = look_up(table(material.table_key, Device(device)), wo[:, 2])
    for t, density in ((transmittance_of("ggx", alpha)[node_of(wo)], expected), (ours, pdf)):
        share = t * np.mean(COLOR) / (t * np.mean(COLOR) + (1.0 - t) * 0.8)
        np.testing.assert_allclose(share * wi[:, 2] / np.pi + (1.0 - share) * coat, density, rtol=1e-4)
