"""Checks that every reflection model must pass, for one material seen from one side."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.kernels import uniforms, upload
from support.mitsuba_scene import load_mitsuba
from support.statistics import ChiSquareResult, chi_square_test, integrate_pdf_over_bins, sphere_histogram
from wrt.backend.device import Device
from wrt.kernels.bsdf import current_name, filtered_name, make_bsdf, model_of
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, slot_values
from wrt.kernels.core.features import identifier
from wrt.kernels.core.registry import model_number
from wrt.upload.tables.material_tables import pack_tables

EPS = float(np.finfo(np.float32).eps)
ANGLES = (0.0, 45.0, 80.0, 89.0)
"""Degrees of incidence at which every model is tried."""


class Kernels(NamedTuple):
    """A model's functions over arrays."""

    evaluate: wp.Kernel
    sample: wp.Kernel


@functools.cache
def kernels_of(model: str) -> Kernels:
    """Return kernels that hold one model alone, in a module of its own."""
    bsdf_evaluate, bsdf_pdf, bsdf_sample = make_bsdf((model,))
    is_delta = int(model_of(model).delta)
    module = wp.get_module(f"test.bsdf.{identifier((model,))}")

    @wp.kernel(module=module, enable_backward=False)
    def evaluate_kernel(
        bsdf: Bsdf,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        value_out: wp.array(dtype=wp.vec3),
        pdf_out: wp.array(dtype=float),
        delta_out: wp.array(dtype=int),
    ):
        i = wp.tid()
        value_out[i] = bsdf_evaluate(bsdf, wo[i], wi[i])
        pdf_out[i] = bsdf_pdf(bsdf, wo[i], wi[i])
        delta_out[i] = wp.static(is_delta)

    @wp.kernel(module=module, enable_backward=False)
    def sample_kernel(
        bsdf: Bsdf, wo: wp.array(dtype=wp.vec3), u: wp.array(dtype=wp.vec3), sample_out: wp.array(dtype=BsdfSample)
    ):
        i = wp.tid()
        sample_out[i] = bsdf_sample(bsdf, wo[i], wp.vec2(u[i][0], u[i][1]), u[i][2])

    return Kernels(evaluate_kernel, sample_kernel)


@dataclasses.dataclass(frozen=True)
class Case:
    """A material of constant values, seen from the front or the back."""

    material: wrt.Material
    front: bool = True

    @property
    def model(self) -> Model:
        return model_of(self.name)

    @property
    def name(self) -> str:
        return current_name(self.material.model)

    @property
    def values(self) -> NDArray[np.float32]:
        values = np.zeros(slot_values._shape_, np.float32)
        for k, value in enumerate(self.material.slots):
            values[k] = value
        return values

    def record(self, device: str) -> Any:
        bsdf = Bsdf()
        bsdf.model, bsdf.front = model_number(self.name), self.front
        bsdf.slots = slot_values(*self.values.ravel().tolist())
        # Where a table begins is not 0, lest a model forget to ask.
        values, places = pack_tables([self.material.table_key], Device(device))
        bsdf.tables = wp.array(np.concatenate([np.full(3, np.nan, np.float32), values]), dtype=float, device=device)
        bsdf.table = 3 + places.get(self.material.table_key, 0)
        return bsdf

    def evaluate(self, wo: NDArray, wi: NDArray, device: str) -> tuple[NDArray, NDArray, NDArray]:
        """Return (N, 3) f |cosθi|, (N,) the density, and (N,) whether the model calls itself a delta."""
        wo, wi = np.broadcast_arrays(wo, wi)
        out = [wp.empty(len(wi), dtype=dtype, device=device) for dtype in (wp.vec3, wp.float32, wp.int32)]
        inputs = [self.record(device), upload(wo, wp.vec3, device), upload(wi, wp.vec3, device)]
        wp.launch(kernels_of(self.name).evaluate, len(wi), inputs, out, device=device)
        value, pdf, delta = (array.numpy() for array in out)
        return value.astype(np.float64), pdf.astype(np.float64), delta.astype(bool)

    def sample(self, wo: NDArray, u: NDArray, device: str) -> NDArray:
        """Return (N,) structured samples with the fields of BsdfSample, for (N, 3) random numbers."""
        out = wp.empty(len(u), dtype=BsdfSample, device=device)
        wo = np.broadcast_to(wo, (len(u), 3))
        inputs = [self.record(device), upload(wo, wp.vec3, device), upload(u, wp.vec3, device)]
        wp.launch(kernels_of(self.name).sample, len(u), inputs, [out], device=device)
        return out.numpy()


@dataclasses.dataclass(frozen=True)
class Bumpy(Case):
    """A material under a normal map that is filtered: the variance of its slopes along x and y is left."""

    variance: tuple[float, float] = (0.0, 0.0)

    @property
    def name(self) -> str:
        return filtered_name(current_name(self.material.model))

    def record(self, device: str) -> Any:
        bsdf = super().record(device)
        bsdf.normal_variance = wp.vec2(*self.variance)
        return bsdf


FLAT = wrt.NormalMap(np.array([[[0.5, 0.5, 1.0]]], np.float32))


@dataclasses.dataclass(frozen=True)
class Tilted(Case):
    """A material with a `coat_normal_map`; `coat` and `base` are the normals of the coat and of what lies below."""

    coat: tuple[float, float, float] = (0.0, 0.0, 1.0)
    base: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @property
    def values(self) -> NDArray[np.float32]:
        values, slot = super().values, self.model.coat_slot
        for row, normal in ((slot, self.coat), (slot + 1, self.base)):
            values[row, 1:] = np.array(normal[:2]) / np.linalg.norm(normal)
        return values


def viewer(degrees: float, azimuth: float = 0.7) -> NDArray[np.float64]:
    """Return the unit vector at an angle from the normal."""
    theta = np.radians(degrees)
    return np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])


def hemisphere(n: int, seed: int) -> NDArray[np.float64]:
    """Return (n, 3) uniform directions above the surface."""
    d = np.random.default_rng(seed).normal(size=(n, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    d[:, 2] = np.abs(d[:, 2])
    return d


def sphere(n: int, seed: int) -> NDArray[np.float64]:
    """Return (n, 3) uniform directions."""
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def chi_square(
    case: Case, degrees: float, device: str, *, tests: int, samples: int = 2**18, **integration: Any
) -> ChiSquareResult:
    """Compare the histogram of samples that are not deltas with the integral of the density over its bins.

    One more cell holds what was not drawn: samples below the horizon and deltas, which the density lacks to 1.
    `integration` is what `integrate_pdf_over_bins` takes; fewer and coarser cells than its own are the default.
    """
    integration = {"resolution": (33, 65), "order": 3, "min_levels": 1, "tolerance": 3e-6} | integration
    wo = viewer(degrees)
    found = case.sample(wo, uniforms(samples, 3, seed=int(degrees)), device)
    smooth = ~found["delta"].astype(bool) & (found["pdf"] > 0.0)

    def density(wi: NDArray) -> NDArray:
        rows = np.flatnonzero(wi[:, 2] > 0.0) if not case.model.transmits else np.arange(len(wi))
        result = np.zeros(len(wi))
        if len(rows):
            result[rows] = case.evaluate(wo, wi[rows], device)[1]
        return result

    # Of some cells a mere corner is seen, which quadrature may miss. `assert_weights` tells samples of no density.
    expected = np.maximum(samples * integrate_pdf_over_bins(density, **integration), 1e-6)
    observed = sphere_histogram(found["wi"][smooth], integration["resolution"])
    return chi_square_test(observed, expected, tests=tests, samples=samples)


def assert_nothing_goes_through(case: Case, device: str) -> None:
    """Value and density are zero below the surface."""
    below = hemisphere(10_000, seed=4) * np.array([1.0, 1.0, -1.0])
    value, pdf, delta = case.evaluate(viewer(30.0), below, device)
    assert (value == 0.0).all()
    assert (pdf == 0.0).all()
    assert not delta.any()


def assert_weights(case: Case, degrees: float, device: str, *, rtol: float = 1e-4) -> None:
    """Every smooth sample's weight is value over density, its pdf is `pdf`, its direction a unit vector."""
    wo = viewer(degrees)
    found = case.sample(wo, uniforms(40_000, 3, seed=1), device)
    wi = found["wi"].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1.0, atol=2e-6)
    assert np.isfinite(found["weight"]).all()
    assert (found["weight"] >= 0.0).all()
    assert (found["eta"] > 0.0).all()
    smooth = ~found["delta"].astype(bool) & (found["weight"].max(axis=1) > 0.0)
    value, pdf, _ = case.evaluate(wo, wi, device)
    assert (pdf[smooth] > 0.0).all()
    np.testing.assert_allclose(found["pdf"][smooth], pdf[smooth], rtol=rtol)
    np.testing.assert_allclose(found["weight"][smooth], value[smooth] / pdf[smooth, None], rtol=rtol, atol=1e-7)
    assert (found["pdf"][found["delta"].astype(bool)] == 0.0).all()


def reciprocity_error(case: Case, device: str, *, n: int = 100_000) -> float:
    """Return the largest relative difference of f(wo, wi) and f(wi, wo) by reflection above the surface."""
    wo, wi = hemisphere(n, seed=2), hemisphere(n, seed=3)
    forward = case.evaluate(wo, wi, device)[0] / wi[:, 2:]
    backward = case.evaluate(wi, wo, device)[0] / wo[:, 2:]
    # Relative to the value, but at least to a thousandth of the typical one.
    larger = np.maximum(forward, backward)
    return float((np.abs(forward - backward) / np.maximum(larger, 1e-3 * np.median(larger) + 1e-12)).max())


def transmission_error(case: Case, ior: float, device: str, *, n: int = 50_000) -> tuple[float, float]:
    """Return the relative difference of f(wo, wi) η² from outside and f(wi, wo) from inside: 99.9 % of it, and all.

    f over the square of the index where light goes is the same along a path and back (Walter 2007, section 2). From
    inside z points inwards, and y is turned with it.
    """
    flip = np.array([1.0, 1.0, -1.0])
    outside, inside = hemisphere(n, seed=2), hemisphere(n, seed=3) * flip
    forward = case.evaluate(outside, inside, device)[0] / -inside[:, 2:] * ior**2
    reverse = dataclasses.replace(case, front=not case.front)
    backward = reverse.evaluate(inside * flip, outside * flip, device)[0] / outside[:, 2:]
    assert forward.max() > 0.0
    # The cosine to a facet that is seen edge-on has few digits, and f is proportional to it.
    largest = np.maximum(forward, backward)
    error = np.abs(forward - backward) / np.maximum(largest, 1e-3 * largest.max())
    return float(np.quantile(error, 0.999)), float(error.max())


def albedo(case: Case, degrees: float, device: str, *, samples: int = 2**19) -> tuple[NDArray, NDArray]:
    """Return mean energy reflected and transmitted per channel, and its standard error.

    Refraction squeezes light into another solid angle: that is not energy, so it is taken out by eta².
    """
    found = case.sample(viewer(degrees), uniforms(samples, 3, seed=5), device)
    energy = found["weight"].astype(np.float64) * (found["eta"].astype(np.float64) ** 2)[:, None]
    assert np.isfinite(energy).all()
    assert energy.min() >= 0.0
    return energy.mean(axis=0), energy.std(axis=0, ddof=1) / np.sqrt(samples)


def mean_albedo(case: Case, device: str, n: int = 48) -> NDArray:
    """Return the share of diffuse light that is reflected: by quadrature, so of wide lobes."""
    x, w = np.polynomial.legendre.leggauss(n)
    mu, weight = 0.5 * (x + 1.0), 0.5 * w
    phi = (np.arange(2 * n) + 0.5) * np.pi / n
    z, turn = (a.ravel() for a in np.meshgrid(mu, phi, indexing="ij"))
    r = np.sqrt(1.0 - z * z)
    wi = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    measure = np.repeat(weight, 2 * n) * np.pi / n
    views = [measure @ case.evaluate(viewer(np.degrees(np.arccos(m)), 0.0), wi, device)[0] for m in mu.tolist()]
    return np.asarray((2.0 * mu * weight) @ np.array(views))


def walked(escapes: float, color: ArrayLike, *, first: int = 1) -> tuple[NDArray, NDArray]:
    """Return the mean of light that bounces until it escapes, of those walks that have `first` bounces, and its error.

    Each bounce multiplies it by a colour, and after each a share `escapes`.
    """
    bounces = np.random.default_rng(36).geometric(escapes, 2_000_000)
    light = np.power(np.asarray(color, np.float64), bounces[bounces >= first, None])
    return light.mean(axis=0), light.std(axis=0) / np.sqrt(len(light))


def assert_finite(case: Case, device: str, *, n: int = 20_000) -> None:
    """Values, densities and samples are finite and not negative, at the horizon and for the last random numbers too."""
    grazing = np.array([viewer(a, b) for a in (0.0, 89.9, 89.99, 89.9999) for b in (0.0, 0.3, 3.0)])
    wo = np.concatenate([hemisphere(n, seed=20), np.repeat(grazing, 200, axis=0)])
    wi = np.concatenate([sphere(len(wo) - len(grazing) * 20, seed=21), np.tile(grazing, (20, 1))])
    mirrored = wo * np.array([-1.0, -1.0, 1.0])
    for directions in (wi, mirrored, -wo):
        value, pdf, _ = case.evaluate(wo, directions, device)
        assert np.isfinite(value).all()
        assert (value >= 0.0).all()
        assert np.isfinite(pdf).all()
        assert (pdf >= 0.0).all()
    u = uniforms(len(wo), 3, seed=22)
    edges = np.float32([0.0, 2.0**-24, 0.25, 0.5, 0.75, 1.0 - 2.0**-24])
    u[-(6**3) :] = np.stack(np.meshgrid(edges, edges, edges), axis=-1).reshape(-1, 3)
    u[: 6**3] = u[-(6**3) :]
    found = case.sample(wo, u, device)
    for name in ("wi", "weight", "pdf", "eta"):
        assert np.isfinite(found[name]).all(), name
    assert (found["weight"] >= 0.0).all()


def ask_mitsuba(material: dict[str, Any], wo: NDArray, wi: NDArray, *, front: bool = True) -> tuple[NDArray, NDArray]:
    """Return what Mitsuba says of a material: (N, 3) f |cosθi| and (N,) the density."""
    mi = load_mitsuba()
    bsdf = mi.load_dict(material)
    side = np.array([1.0, 1.0, 1.0 if front else -1.0])
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    values, densities = np.empty((len(wo), 3)), np.empty(len(wo))
    for i, (view, light) in enumerate(zip((wo * side).tolist(), (wi * side).tolist(), strict=True)):
        surface.wi = mi.Vector3f(*view)
        direction = mi.Vector3f(*light)
        values[i] = np.array(bsdf.eval(context, surface, direction)).ravel()
        densities[i] = bsdf.pdf(context, surface, direction)
    return values, densities
