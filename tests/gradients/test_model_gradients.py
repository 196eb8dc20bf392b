"""The derivative of every reflection model by each of its values, and by directions, is its difference quotient."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import FLAT, Bumpy, Case, Tilted, sphere, viewer

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.core.bsdf import MAX_SLOTS, Bsdf, slot_values
from wrt.kernels.core.features import identifier
from wrt.kernels.gradients.bsdf import make_weighted

P = wrt.Principled
RGB, GOLD = (0.8, 0.4, 0.2), (0.9, 0.7, 0.3)
SPECULAR = {"specular": 0.8, "specular_color": (0.7, 0.8, 0.9)}
BODY = P((0.9, 0.6, 0.3), 0.3, 0.5, **SPECULAR, anisotropy=0.6, anisotropy_rotation=0.5, transmission=0.5)
COATED = P(GOLD, 0.4, 0.5, **SPECULAR, coat=0.5, coat_roughness=0.35)
METAL = {
    "ggx": ((0.2, 0.4), "smith"),
    "beckmann": ((0.3, 0.5), "walter"),
    "blinn-phong": (0.3, "walter"),
    "abc": ((100.0, 1.2), "cook-torrance"),
    "sgd": ((0.3, 0.6), "kelemen"),
}
BURLEY = {"coat": 0.8, "coat_gloss": 0.3, "roughness": 0.4, "metallic": 0.3, "sheen": 0.4, "sheen_tint": 0.3}
BURLEY |= {"anisotropy": 0.3, "specular_tint": 0.3, "flatness": 0.4}
SHEET = {"thin_walled": True, "transmission": 0.6, "diffuse_transmission": 0.25, "anisotropy": 0.4}
SHEET |= {"sheen": 0.3, "roughness": 0.5, "flatness": 0.2, "specular_tint": 0.3}

CASES: dict[str, Case] = {
    "diffuse": Case(wrt.Diffuse(RGB)),
    "oren-nayar": Case(wrt.OrenNayar(RGB, 0.35)),
    "glossy": Case(wrt.Glossy(RGB, exponent=20.0)),
    "mirror": Case(wrt.Mirror(RGB)),
    "copper": Case(wrt.Conductor()),
    "gold": Case(wrt.Conductor(f0=GOLD)),
    "dielectric": Case(wrt.Dielectric(1.5, specular_transmittance=0.7)),
    "inside": Case(wrt.Dielectric(1.4, specular_reflectance=0.7), front=False),
    "schlick": Case(wrt.Dielectric(1.5, fresnel="schlick")),
    "pane": Case(wrt.ThinDielectric(1.5, specular_transmittance=0.7)),
    **{
        f"rough {name}": Case(wrt.RoughConductor(alpha, distribution=name, masking=masking))
        for name, (alpha, masking) in METAL.items()
    },
    "implicit": Case(wrt.RoughConductor(0.3, masking="implicit", f0=0.5)),
    "separable": Case(wrt.RoughConductor(0.4, masking="smith-separable", f0=GOLD)),
    "all bounces": Case(wrt.RoughConductor(0.5, f0=GOLD, multiple_bounces=True)),
    "bumpy metal": Bumpy(wrt.RoughConductor((0.1, 0.3), masking="smith"), variance=(0.03, 0.01)),
    "rough glass": Case(wrt.RoughDielectric(1.5, alpha=(0.2, 0.4))),
    "rough glass, inside": Case(wrt.RoughDielectric(1.5, alpha=0.3, specular_transmittance=0.8), front=False),
    "rough glass, all bounces": Case(wrt.RoughDielectric(1.5, alpha=0.6, multiple_bounces=True)),
    "plastic": Case(wrt.Plastic(RGB)),
    "deep plastic": Case(wrt.Plastic(RGB, nonlinear=True)),
    "rough plastic": Case(wrt.RoughPlastic(RGB, alpha=0.3, specular_reflectance=0.5)),
    "principled": Case(P(RGB, metallic=0.5, roughness=0.4, **SPECULAR)),
    "brushed": Case(P(GOLD, metallic=0.7, roughness=0.4, **SPECULAR, anisotropy=0.8, anisotropy_rotation=0.5)),
    "coated": Case(COATED),
    "velvet": Case(P((0.2, 0.05, 0.1), 0.1, 0.5, **SPECULAR, sheen_color=(0.9, 0.5, 0.7), sheen_roughness=0.5)),
    "half metal, all bounces": Case(P(GOLD, metallic=0.5, roughness=0.7, **SPECULAR, multiple_bounces=True)),
    "body": Case(BODY),
    "body, inside": Case(BODY, front=False),
    "sheet": Case(P(GOLD, 0.2, 0.5, **SPECULAR, transmission=0.8, thin_walled=True)),
    "coat tilted": Tilted(
        P((0.9, 0.4, 0.2), 0.2, 0.4, **SPECULAR, coat=0.9, coat_roughness=0.5, coat_normal_map=FLAT),
        coat=(0.3, -0.2, 1.0),
        base=(-0.25, 0.3, 1.0),
    ),
    "bumpy body": Bumpy(BODY, variance=(0.03, 0.01)),
    "burley": Case(wrt.Burley(RGB, **BURLEY)),
    "burley's glass": Case(wrt.Burley(RGB, **BURLEY, transmission=0.7, ior=1.4)),
    "burley's pane": Case(wrt.Burley(RGB, **SHEET)),
    "prism": Case(wrt.RoughDielectric(1.7, alpha=0.3, dispersion=4.0)),
    "film on copper": Case(wrt.Conductor(film_thickness=350.0, film_ior=1.6)),
    "film by its reflectance": Case(wrt.RoughConductor(0.4, f0=(0.6, 0.4, 0.2), film_thickness=250.0)),
    "film on rough titanium": Case(wrt.RoughConductor(0.3, metal="Ti", film_thickness=90.0, film_ior=2.3)),
    "dispersive body": Case(P(GOLD, 0.1, 0.4, **SPECULAR, transmission=0.8, dispersion=3.0)),
}
QUICK = ("diffuse", "oren-nayar", "glossy", "dielectric", "rough ggx", "rough abc", "principled")

WEIGHT = np.array([0.7, -0.4, 1.3])
STEP, NEAR_EDGES = 1e-2, 3e-3
"""Relative steps: rounding disturbs short ones; critical angles, which an index moves, and waves disturb long ones."""
COUNT = 4000

AXIS = np.array([0.5, -0.6, 0.6])
"""What directions are turned about."""

ACROSS_KINKS = {"half metal, all bounces": 2}
"""A slot whose quotients mean nothing here: a table that is interpolated linearly has slopes that jump by percents."""


class Kernels(NamedTuple):
    """Kernels of a model: weighted values in a direction and of both delta lobes, and their derivatives.

    `turns` are derivatives by turns of each direction.
    """

    values: wp.Kernel
    gradients: wp.Kernel
    turns: wp.Kernel


@functools.cache
def kernels_of(model: str) -> Kernels:
    weighted = make_weighted((model,))
    weighted_value, weighted_lobes = weighted.value, weighted.lobes
    evaluate = make_bsdf((model,)).evaluate
    module = wp.get_module(f"test.gradient.{identifier((model,))}")

    @wp.kernel(module=module, enable_backward=False)
    def values(
        first: int, bsdf: Bsdf, wo: wp.vec3, wi: wp.array(dtype=wp.vec3), weight: wp.vec3, out: wp.array(dtype=wp.vec3)
    ):
        i = first + wp.tid()
        out[i] = wp.cw_mul(evaluate(bsdf, wo, wi[i]), weight) + weighted_lobes(bsdf, wo, weight, weight * 0.5)

    @wp.kernel(module=module, enable_backward=False)
    def gradients(
        first: int,
        bsdf: Bsdf,
        wo: wp.vec3,
        wi: wp.array(dtype=wp.vec3),
        weight: wp.vec3,
        out: wp.array(dtype=float),
    ):
        i = first + wp.tid()
        # As in a path: the value itself comes before its derivative.
        value = evaluate(bsdf, wo, wi[i])
        by_value, _0, _1, _2 = wp.grad(weighted_value)(bsdf, wo, wi[i], weight)
        by_lobes, _3, _4, _5 = wp.grad(weighted_lobes)(bsdf, wo, weight, weight * 0.5)
        found = by_value.slots + by_lobes.slots + slot_values() * value[0]
        for k in range(MAX_SLOTS):
            for c in range(3):
                out[3 * (MAX_SLOTS * i + k) + c] = found[k, c]

    @wp.kernel(module=wp.get_module(f"test.turn.{identifier((model,))}"), enable_backward=False)
    def turns(
        first: int,
        bsdf: Bsdf,
        wo: wp.vec3,
        wi: wp.array(dtype=wp.vec3),
        weight: wp.vec3,
        axis: wp.vec3,
        out: wp.array(dtype=float),
    ):
        i = first + wp.tid()
        value = evaluate(bsdf, wo, wi[i])
        _0, by_wo, by_wi, _1 = wp.grad(weighted_value)(bsdf, wo, wi[i], weight)
        _2, of_lobes, _3, _4 = wp.grad(weighted_lobes)(bsdf, wo, weight, weight * 0.5)
        out[2 * i] = wp.dot(by_wo + of_lobes, wp.cross(axis, wo)) + 0.0 * value[0]
        out[2 * i + 1] = wp.dot(by_wi, wp.cross(axis, wi[i]))

    return Kernels(values, gradients, turns)


VIEWER = viewer(40.0)


def launch(
    case: Case, values: NDArray, wi: NDArray, device: Device, *, gradients: bool, wo: NDArray = VIEWER
) -> NDArray[np.float64]:
    """Return the weighted value in each direction, summed over channels, or its derivative by each slot, (16, 3)."""
    backend = device.backend
    bsdf = case.record(device.name)
    bsdf.slots = slot_values(*values.astype(np.float32).ravel().tolist())
    kernel = kernels_of(case.name)
    numbers = 3 * MAX_SLOTS * len(wi)
    out = backend.zeros(numbers, float, device.name) if gradients else backend.zeros(len(wi), "vec3", device.name)
    inputs = [bsdf, wp.vec3(*wo.tolist()), backend.array(wi, "vec3", device.name), wp.vec3(*WEIGHT.tolist()), out]
    device.launch(kernel.gradients if gradients else kernel.values, len(wi), inputs)
    found = np.asarray(backend.fetch(out), np.float64)
    return found.reshape(-1, MAX_SLOTS, 3) if gradients else found.sum(axis=-1)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]
)
def test_derivatives_are_difference_quotients(name: str, device: str, report: Report) -> None:
    """By each number of each slot, at three points, summed over directions all around."""
    initialize_warp()
    case, on = CASES[name], Device(device, threads=1)
    model = case.model
    wi = sphere(COUNT, seed=3)
    if not model.transmits:
        wi[:, 2] = np.abs(wi[:, 2])
    rng, worst = np.random.default_rng(1), 0.0
    for point in range(3):
        values = case.values.astype(np.float64)
        if point:
            values[: model.slots] *= rng.uniform(0.9, 1.0, (model.slots, 1))
        found = launch(case, values, wi, on, gradients=True)
        assert np.isfinite(found).all()
        for k in set(range(model.slots)) - {ACROSS_KINKS.get(name)}:
            for c in range(3):
                worst = max(worst, _difference(case, values, wi, on, k, c, found[:, k, c]))
    report(f"{name}: derivative and difference quotient", worst, "< 1e-3")
    assert worst < 1e-3


def _difference(
    case: Case, values: NDArray, wi: NDArray, device: Device, slot: int, channel: int, found: NDArray
) -> float:
    """Return the difference of the sums over directions, relative to the mean size of the derivatives."""
    model = case.model
    disperses = model.channels_slot >= 0 and slot in (model.channels_slot, model.index_slot)
    if disperses or (model.coat_slot in (slot, slot - 1) and channel > 0):
        return 0.0  # not the material's own; `make_own_slots` leaves it out
    size = max(abs(values[slot, channel]), 0.1)

    def quotient(step: float) -> NDArray[np.float64]:
        ends = []
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[slot, channel] += sign * step
            ends.append(launch(case, moved, wi, device, gradients=False))
        return np.asarray((ends[0] - ends[1]) / (2.0 * step))

    of_film = "film" in case.name.split(":") and slot >= model.slots - 2
    is_short = of_film or slot == model.index_slot
    step = size * (NEAR_EDGES if is_short else STEP)
    value = np.abs(launch(case, values, wi, device, gradients=False)).mean()
    return _mean_difference(found, quotient, step, float(value))


def _mean_difference(
    found: NDArray[np.float64], quotient: Callable[[float], NDArray[np.float64]], step: float, value: float
) -> float:
    """Return the difference of the means of derivatives and quotients, relative to the mean size of the derivatives."""
    coarse, fine = quotient(2.0 * step), quotient(step)
    expected = (4.0 * fine - coarse) / 3.0  # Richardson's extrapolation
    scale = max(np.abs(expected).mean(), np.abs(found).mean(), 1e-2 * value)
    # A quotient across a critical angle, or the edge of a lobe, converges to nothing; rounding disturbs the others.
    kept = np.abs(fine - coarse) < 0.01 * np.maximum(np.abs(fine), scale) + 1e-6 * value / step
    assert kept.mean() > 0.9
    return float(abs((found - expected)[kept].mean()) / scale)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.model.delta])
def test_derivatives_by_directions_are_difference_quotients(name: str, device: str, report: Report) -> None:
    """By turns of the direction to the viewer, and of that to the light."""
    initialize_warp()
    case, on = CASES[name], Device(device, threads=1)
    values = case.values.astype(np.float64)
    wi = sphere(COUNT, seed=3)
    wi = wi[np.abs(wi[:, 2]) > 0.1]
    if not case.model.transmits:
        wi[:, 2] = np.abs(wi[:, 2])
    backend = on.backend
    out = backend.zeros(2 * len(wi), float, on.name)
    vectors = [wp.vec3(*each.tolist()) for each in (VIEWER, WEIGHT, AXIS)]
    inputs = [case.record(on.name), vectors[0], backend.array(wi, "vec3", on.name), *vectors[1:], out]
    on.launch(kernels_of(case.name).turns, len(wi), inputs)
    found = np.asarray(backend.fetch(out), np.float64).reshape(-1, 2)
    value = float(np.abs(launch(case, values, wi, on, gradients=False)).mean())

    def quotient(which: int, step: float) -> NDArray[np.float64]:
        ends = []
        for sign in (1.0, -1.0):
            turned = [v + sign * step * np.cross(AXIS, v) for v in (VIEWER.astype(np.float64), wi.astype(np.float64))]
            turned = [v / np.linalg.norm(v, axis=-1, keepdims=True) for v in turned]
            wo, to_light = (turned[0], wi) if which == 0 else (VIEWER, turned[1])
            ends.append(launch(case, values, to_light.astype(np.float32), on, gradients=False, wo=wo))
        return np.asarray((ends[0] - ends[1]) / (2.0 * step))

    for which, direction in enumerate(("viewer", "light")):
        worst = _mean_difference(found[:, which], functools.partial(quotient, which), NEAR_EDGES, value)
        report(f"{name}: derivative by the direction to the {direction}", worst, "< 1e-3")
        assert worst < 1e-3, direction
