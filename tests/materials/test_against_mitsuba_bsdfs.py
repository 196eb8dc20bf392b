"""Coated bases and transparent boundaries have the values and densities of Mitsuba 3, another renderer.

But for what it approximates, each of which is derived here. Its `plastic` takes a fit for the light sent back from
below. Its `roughplastic` takes the mean of 64 values for that, of single reflections, so that it loses what facets
block there; and a table of 64 values of T, linear in the cosine. For Beckmann's distribution both rough models take
Walter's rational fit of Smith's function, in densities too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import special
from support.bsdfs import Case, hemisphere, sphere
from support.kernels import uniforms, upload

import wrt
from wrt.backend.device import Device
from wrt.io.mitsuba.materials.coats import internal_reflectances
from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel
from wrt.scene.materials.plastics import internal_reflectance
from wrt.scene.textures import ColorSource
from wrt.upload.tables.material_tables import table

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import load_mitsuba

Array = NDArray[Any]

N = 1000
COLOR = (0.5, 0.2, 0.1)
NODES = 64
MASKING = {"ggx": "smith-separable", "beckmann": "walter"}


def plugin(kind: str, **values: Any) -> Any:
    """Return a plugin of Mitsuba; tuples are colours."""
    made = {k: {"type": "rgb", "value": list(v)} if isinstance(v, tuple) else v for k, v in values.items()}
    return load_mitsuba().load_dict({"type": kind, **made})


def plastic_of_mitsuba(material: wrt.Plastic | wrt.RoughPlastic) -> Any:
    values = {"int_ior": material.ior, "ext_ior": material.exterior_ior, "nonlinear": material.nonlinear}
    values |= {"diffuse_reflectance": material.reflectance, "specular_reflectance": material.specular_reflectance}
    if isinstance(material, wrt.RoughPlastic):
        return plugin("roughplastic", alpha=material.alpha, distribution=material.distribution, **values)
    return plugin("plastic", **values)


def ask(bsdf: Any, wo: Array, wi: Array) -> tuple[Array, Array]:
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


def float32(directions: Array) -> Array:
    return directions.astype(np.float32)


def masking_of_beckmann(w: Array, alpha: tuple[float, float]) -> tuple[Array, Array]:
    """Return Smith's G1, and Walter's fit of it (Walter et al. 2007, eq. 27), which exceeds 1 a little."""
    a = w[:, 2] / np.hypot(alpha[0] * w[:, 0], alpha[1] * w[:, 1]).clip(1e-6)
    exact = 2.0 / (1.0 + special.erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi)))
    fit = (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    return exact, np.where(a < 1.6, fit, 1.0)


# --- Plastic -----------------------------------------------------------------------------------------


def egan_hilgeman(eta: float) -> float:
    """Return the fit of Egan and Hilgeman (1973) to the internal diffuse reflectance, which Mitsuba uses."""
    x = 1.0 / eta
    return -1.4399 * x**2 + 0.7099 * x + 0.6681 + 0.0636 / x


class FittedPlastic(wrt.Plastic):
    """Plastic with Mitsuba's fit in place of the integral."""

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        values = super().slots
        return (*values[:3], egan_hilgeman(self.relative_ior), values[4])


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize(("ior", "exterior"), [(1.5, 1.0), (1.9, 1.33)])
def test_smooth_plastic(ior: float, exterior: float, nonlinear: bool, device: str) -> None:
    wo, wi = float32(hemisphere(N, seed=60)), float32(hemisphere(N, seed=61))
    parts = (COLOR, ior, exterior, nonlinear, (1.0, 0.6, 0.5))
    expected, expected_pdf = ask(plastic_of_mitsuba(FittedPlastic(*parts)), wo, wi)
    value, pdf, _ = Case(FittedPlastic(*parts)).evaluate(wo, wi, device)
    np.testing.assert_allclose(value, expected, rtol=1e-4)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-4)
    ratio = Case(wrt.Plastic(*parts)).evaluate(wo, wi, device)[0] / expected
    fit, integral = egan_hilgeman(ior / exterior), internal_reflectance(ior / exterior)
    rho = np.array(COLOR) if nonlinear else 1.0
    np.testing.assert_allclose(ratio, np.broadcast_to((1.0 - rho * fit) / (1.0 - rho * integral), (N, 3)), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.1, 1.0])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_coat(distribution: str, alpha: float, device: str) -> None:
    """A black base leaves the coat alone."""
    parts = {"alpha": alpha, "distribution": distribution, "masking": MASKING[distribution]}
    material = wrt.RoughPlastic((0.0, 0.0, 0.0), specular_reflectance=(1.0, 0.5, 0.2), **parts)
    wo, wi = float32(hemisphere(N, seed=62)), float32(hemisphere(N, seed=63))
    # Half of them anywhere, half where the lobe is.
    drawn = Case(material).sample(wo[N // 2 :], uniforms(N // 2, 3, seed=64), device)
    up = drawn["wi"][:, 2] > 0.0
    wi[N // 2 :][up] = drawn["wi"][up]
    expected, expected_pdf = ask(plastic_of_mitsuba(material), wo, wi)
    value, pdf, _ = Case(material).evaluate(wo, wi, device)
    if distribution == "beckmann":
        (exact, fit), (_, fit_i) = (masking_of_beckmann(w.astype(np.float64), (alpha, alpha)) for w in (wo, wi))
        pdf = pdf * fit / exact
        value = value * (np.maximum(fit, 1.0) * np.maximum(fit_i, 1.0))[:, None]
    # Mitsuba leaves out values of D cosθ below 1e-20.
    there = expected_pdf > 0.0
    assert there.sum() > N // 2
    assert (value[~there] < 1e-18).all()
    np.testing.assert_allclose(value[there], expected[there], rtol=1e-4)
    np.testing.assert_allclose(pdf[there], expected_pdf[there], rtol=1e-4)


def at_nodes(n: int, seed: int) -> tuple[Array, Array]:
    """Return directions whose cosines are those of Mitsuba's table, where it does not interpolate, and which."""
    random = np.random.default_rng(seed)
    node = random.integers(1, NODES, n)
    z, phi = node / (NODES - 1), 2.0 * np.pi * random.random(n)
    r = np.sqrt(1.0 - z * z)
    return float32(np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)), node


def transmittance_of_mitsuba(distribution: str, alpha: float) -> Array:
    """Return Mitsuba's T at its nodes, read from its densities: both lobes mix by 1 − T and T where both are white."""
    nodes = np.arange(NODES) / (NODES - 1)
    nodes[0] = nodes[1]  # not asked for
    wo = np.stack([np.sqrt(1.0 - nodes**2), 0.0 * nodes, nodes], axis=1)
    result, best = np.zeros(NODES), np.zeros(NODES)
    for x, z in ((0.6, 0.8), (np.sqrt(0.99), 0.1), (-np.sqrt(0.75), 0.5)):
        wi = np.broadcast_to([x, 0.0, z], wo.shape)
        materials = [wrt.RoughPlastic((base,) * 3, alpha=alpha, distribution=distribution) for base in (1.0, 0.0)]
        white, black = (ask(plastic_of_mitsuba(material), wo, wi)[1] for material in materials)
        apart = z / np.pi - black
        # By the direction where the two lobes differ most.
        result = np.where(np.abs(apart) > best, (white - black) / apart, result)
        best = np.maximum(best, np.abs(apart))
    return result


def transmittance(material: wrt.RoughPlastic, device: str) -> Array:
    """Return our T at Mitsuba's nodes."""
    found = table(material.table_key, Device(device))
    return np.interp(np.sqrt(np.arange(NODES) / (NODES - 1)), np.linspace(0.0, 1.0, int(found[0])), found[3:])


def internal_of(distribution: str, alpha: float, eta: float, device: str) -> float:
    """Return the mean that Mitsuba takes for the light sent back from below: of 64 cosines, single reflections."""
    nodes = np.maximum(np.linspace(0.0, 1.0, NODES), 1e-6)
    wo = np.stack([np.sqrt(1.0 - nodes**2), 0.0 * nodes, nodes], axis=1)
    out = [wp.empty(NODES, dtype=float, device=device) for _ in range(2)]
    inputs = [upload(wo, wp.vec3, device), upload(np.full(NODES, alpha), wp.float32, device), *out]
    kernel = make_coat_kernel(distribution, MASKING[distribution])
    Device(device).launch(kernel, NODES, [2**15, 1.0 / eta, *inputs])
    return 2.0 * float(np.mean(out[0].numpy().astype(np.float64) * nodes))


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "nonlinear"), [(0.1, True), (1.0, False)])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_base(distribution: str, alpha: float, nonlinear: bool, device: str, report: Report) -> None:
    """Without its reflection, the coat leaves the base alone; with it, lobes are chosen alike."""
    parts = {"alpha": alpha, "distribution": distribution, "masking": MASKING[distribution], "nonlinear": nonlinear}
    parts["multiple_bounces"] = False  # Mitsuba has no more than one
    bare = wrt.RoughPlastic(COLOR, specular_reflectance=(0.0,) * 3, **parts)
    (wo, o), (wi, i) = at_nodes(N, seed=65), at_nodes(N, seed=66)
    theirs, ours = transmittance_of_mitsuba(distribution, alpha), transmittance(bare, device)
    # What gets in: the quadratures agree; of Beckmann's, to what the fit leaves.
    worst = float(np.abs(ours / theirs - 1.0)[1:].max())
    report(f"{distribution} {alpha}: largest relative difference of T", worst)
    assert worst < {"ggx": 1e-3, "beckmann": 6e-3}[distribution]
    # What the base sends back, once both have the same T and R.
    expected, expected_pdf = ask(plastic_of_mitsuba(bare), wo, wi)
    value, pdf, _ = Case(bare).evaluate(wo, wi, device)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-4)
    ratio = value * (theirs[o] * theirs[i] / (ours[o] * ours[i]))[:, None] / expected
    factor = np.median(ratio, axis=0)
    np.testing.assert_allclose(ratio, np.broadcast_to(factor, ratio.shape), rtol=1e-4)
    mean, internal = internal_of(distribution, alpha, 1.5, device), float(table(bare.table_key, Device(device))[2])
    # What scene files of Mitsuba go by.
    np.testing.assert_allclose(internal_reflectances(distribution, alpha, 1.5), (internal, mean), rtol=1e-3)
    rho = np.array(COLOR) if nonlinear else 1.0
    np.testing.assert_allclose(factor, (1.0 - rho * mean) / (1.0 - rho * internal) * np.ones(3), rtol=2e-3)
    if distribution == "ggx":
        assert_lobes_are_chosen_alike({**parts, "specular_reflectance": (1.0, 0.9, 0.5)}, theirs, device)


def assert_lobes_are_chosen_alike(parts: dict[str, Any], theirs: Array, device: str) -> None:
    """The whole density: the coat's by (1 − T) times its factor, the base's by T times its reflectance, both means."""
    (wo, o), wi = at_nodes(N, seed=67), float32(hemisphere(N, seed=68))
    material = wrt.RoughPlastic(COLOR, **parts)
    coat = Case(wrt.RoughPlastic((0.0,) * 3, **parts)).evaluate(wo, wi, device)[1]
    # Mixed by Mitsuba's T, the lobes have its density, and by ours our own. Their T differ as above.
    for t, density in (
        (theirs[o], ask(plastic_of_mitsuba(material), wo, wi)[1]),
        (transmittance(material, device)[o], Case(material).evaluate(wo, wi, device)[1]),
    ):
        share = t * np.mean(COLOR) / (t * np.mean(COLOR) + (1.0 - t) * 0.8)
        np.testing.assert_allclose(share * wi[:, 2] / np.pi + (1.0 - share) * coat, density, rtol=1e-4)


# --- Boundaries --------------------------------------------------------------------------------------

SIDES = {"outside": True, "inside": False}


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("alpha", [0.05, (0.2, 0.6), 1.0])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_boundaries(distribution: str, alpha: Any, side: str, device: str, report: Report) -> None:
    """The same values and densities to 1e-4, Smith's functions not correlated, as Mitsuba has them.

    Facets to which a direction has a cosine below 0.03 are left out: rounding leaves few digits of that, and 1 − F is
    proportional to it.
    """
    pair = alpha if isinstance(alpha, tuple) else (alpha, alpha)
    bsdf = plugin(
        "roughdielectric", int_ior=1.5, ext_ior=1.0, distribution=distribution, alpha_u=pair[0], alpha_v=pair[1]
    )
    material = wrt.RoughDielectric(1.5, alpha=alpha, distribution=distribution, masking=MASKING[distribution])
    case, up = Case(material, SIDES[side]), 1.0 if SIDES[side] else -1.0
    wo = float32(hemisphere(N, seed=31)).astype(np.float64)
    # Half of the lights anywhere, half where this surface sends light.
    drawn = case.sample(wo[N // 2 :], uniforms(N // 2, 3, seed=33), device)["wi"]
    wi = float32(np.concatenate([sphere(N // 2, seed=32), drawn])).astype(np.float64)
    expected_value, expected_pdf = ask(bsdf, up * wo, up * wi)
    value, pdf, _ = case.evaluate(wo, wi, device)
    if distribution == "beckmann":
        exact, fit = masking_of_beckmann(wo, pair)
        pdf = pdf * fit / exact
    found, expected = np.stack([value[:, 0], pdf]), np.stack([expected_value[:, 0], expected_pdf])
    m = wo + wi * np.where(wi[:, 2:] > 0.0, 1.0, 1.5**up)
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    cosine = np.minimum(np.abs((wo * m).sum(axis=1)), np.abs((wi * m).sum(axis=1)))
    lit = (np.maximum(found, expected).min(axis=0) > 1e-15) & (cosine > 0.03)
    assert lit.sum() > 400
    error = (np.abs(found - expected) / np.maximum(found, expected).clip(1e-30))[:, lit]
    report(f"{distribution} {alpha} {side}: largest difference", float(error.max()), 0.0)
    assert error.max() < 1e-4


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("kind", ["dielectric", "thindielectric"])
def test_smooth_boundaries(kind: str, side: str, device: str) -> None:
    """The same directions, weights and probabilities: at a hair below or above it the choice is the other one."""
    mi = load_mitsuba()
    tints = {"specular_reflectance": (0.9, 0.5, 0.1), "specular_transmittance": (0.2, 0.6, 1.0)}
    bsdf = plugin(kind, int_ior=1.5, ext_ior=1.2, **tints)
    make = wrt.Dielectric if kind == "dielectric" else wrt.ThinDielectric
    case, up = Case(make(1.5, 1.2, **tints), SIDES[side]), 1.0 if SIDES[side] else -1.0
    wo = float32(hemisphere(N, seed=41)).astype(np.float64)
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    for through in (False, True):
        rows = []
        for o in wo:
            surface.wi = mi.Vector3f(*(up * o).tolist())
            sample, weight = bsdf.sample(context, surface, 1.0 - 1e-7 if through else 0.0, [0.5, 0.5])
            rows.append([*(up * np.array(sample.wo)), *weight, sample.pdf, sample.eta])
        expected = np.array(rows)
        probability, goes = expected[:, 6], (expected[:, 2] < 0.0) == through
        assert goes.sum() > 300
        nudge = 3e-6 + 1e-4 * np.minimum(probability, 1.0 - probability)
        u = np.zeros((N, 3), np.float32)
        u[:, 2] = np.where(through, 1.0 - probability + nudge, probability - nudge)
        assert u[goes, 2].min() >= 0.0
        found = case.sample(wo, u, device)[goes]
        np.testing.assert_allclose(found["wi"], expected[goes, :3], atol=3e-6)
        np.testing.assert_allclose(found["weight"], expected[goes, 3:6], rtol=1e-5)
        # Mitsuba tells the index of a pane; but light that has gone through it is where it was.
        if kind == "dielectric":
            np.testing.assert_allclose(found["eta"], expected[goes, 7], rtol=1e-6)
        u[:, 2] = np.where(through, 1.0 - probability - nudge, probability + nudge)
        sure = (u[:, 2] >= 0.0) & (u[:, 2] < 1.0)
        other = case.sample(wo, u, device)["wi"][:, 2] < 0.0
        assert (other[goes & sure] != through).all()
