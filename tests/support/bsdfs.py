"""Checks that every reflection model must pass, for one material seen from one side."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.mitsuba_scene import load_mitsuba
from wrt.checking.bsdf_cases import Case as Case
from wrt.checking.bsdf_cases import hemisphere, viewer
from wrt.checking.bsdf_cases import sphere as sphere
from wrt.checking.bsdfs import albedo as albedo
from wrt.checking.bsdfs import chi_square as chi_square
from wrt.checking.bsdfs import fault_below, fault_of_values, fault_of_weights
from wrt.checking.bsdfs import reciprocity_error as reciprocity_error
from wrt.kernels.bsdf import current_name, filtered_name

EPS = float(np.finfo(np.float32).eps)
ANGLES = (0.0, 45.0, 80.0, 89.0)
"""Degrees of incidence at which every model is tried."""


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


def assert_nothing_goes_through(case: Case, device: str) -> None:
    assert fault_below(case, device) == ""


def assert_weights(case: Case, degrees: float, device: str, *, rtol: float = 1e-4) -> None:
    assert fault_of_weights(case, degrees, device, rtol=rtol) == ""


def assert_finite(case: Case, device: str, *, n: int = 20_000) -> None:
    assert fault_of_values(case, device, n=n) == ""


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
