"""Checks that every reflection model must pass, and `check_bsdf`, which applies them to a user's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.checking.bsdf_cases import Case, hemisphere, sphere, uniforms, viewer
from wrt.checking.distributions import ChiSquareResult, chi_square_test, integrate_pdf_over_bins, sphere_histogram
from wrt.errors import InputError
from wrt.scene.materials import Material
from wrt.values import Vec3

ANGLES = (0.0, 45.0, 80.0)
"""Degrees of incidence that `check_bsdf` tries."""

RECIPROCAL = 1e-3
"""Most relative difference of f(wo, wi) and f(wi, wo) in single precision."""


def check_bsdf(
    material: Material | type[Material],
    *,
    position: Vec3 = (0.3, 0.4, 0.5),
    uv: tuple[float, float] = (0.3, 0.4),
    device: str = "cpu",
) -> bool:
    """Check the model of a material, print what was found, and return whether all holds.

    Samples must follow the density (χ² at 1 %) and weights be f |cosθi| / pdf. No more light may leave than comes,
    f(wo, wi) must be f(wi, wo), and nothing infinite, NaN, negative, or below the surface of an opaque model.

    Args:
        material: a material of constant values, or a class whose defaults are checked.
        position: the point at which a model is checked that depends on it; its normals are +z.
        uv: the texture coordinates there.
        device: where the functions run.

    Raises:
        InputError: if the material has parts, or a value that varies over the surface.
    """
    if isinstance(material, type):
        material = material.example()
    if material.parts or not all(isinstance(value, (int, float, tuple)) for value in material.slots):
        raise InputError(f"{type(material).__name__}: give a material without parts, of numbers and colours alone")
    case = Case(material)
    holds = True
    for front in (True, False) if case.model.transmits else (True,):
        print(f"{material}{'' if front else ', from inside'}")
        for name, found, fault in _checks(Case(material, front, position=position, uv=uv), device):
            print(f"  {'FAULT' if fault else 'ok':<5}  {name:<34}  {fault or found}".rstrip())
            holds &= not fault
    return holds


def _checks(case: Case, device: str) -> list[tuple[str, str, str]]:
    """Return for each check its name, what was found, and the fault, empty if it holds."""
    rows = [("values are finite, and not below 0", "", fault_of_values(case, device))]
    if not case.model.transmits:
        rows.append(("nothing is below the surface", "", fault_below(case, device)))
    weights = next((fault for angle in ANGLES if (fault := fault_of_weights(case, angle, device))), "")
    rows.append(("weights are f |cos| / pdf", "", weights))
    if rows[0][2] or weights.startswith("directions"):
        return rows  # nothing else can be measured
    if not case.model.delta:
        tests = {angle: chi_square(case, angle, device, tests=len(ANGLES)) for angle in ANGLES}
        faults = [f"at {angle:g}°: {test.message}" for angle, test in tests.items() if not test.passed]
        found = ", ".join(f"p {test.p:.2g} at {angle:g}°" for angle, test in tests.items())
        rows.append(("samples follow the density", found, "; ".join(faults)))
        error = reciprocity_error(case, device)
        found = f"f(wo, wi) and f(wi, wo) differ by up to {error:.1e}"
        rows.append(("it is reciprocal", found, "" if error < RECIPROCAL else found))
    energies = [albedo(case, angle, device, samples=2**17) for angle in (*ANGLES, 89.0)]
    most = max(float(mean.max()) for mean, _ in energies)
    slack = 3e-3 if case.material.table_key else 1e-5
    is_made = any((mean > 1.0 + slack + 3.5 * error).any() for mean, error in energies)
    found = f"up to {100.0 * most:.4g} % of the light leaves"
    rows.append(("no energy is made", found, found if is_made else ""))
    return rows


def chi_square(
    case: Case, degrees: float, device: str, *, tests: int, samples: int = 2**18, **integration: Any
) -> ChiSquareResult:
    """Compare the histogram of samples that are not deltas with the integral of the density over its bins.

    One more cell holds what was not drawn: samples below the horizon and deltas, which the density lacks to 1.
    `integration` is what `integrate_pdf_over_bins` takes; fewer and coarser cells than its own are the default.
    """
    integration = {"resolution": (33, 65), "order": 3, "min_levels": 1, "tolerance": 3e-6, **integration}
    wo = viewer(degrees)
    found = case.sample(wo, uniforms(samples, 3, seed=int(degrees)), device)
    smooth = ~found["delta"].astype(bool) & (found["pdf"] > 0.0)

    def density(wi: NDArray[Any]) -> NDArray[Any]:
        rows = np.flatnonzero(wi[:, 2] > 0.0) if not case.model.transmits else np.arange(len(wi))
        result = np.zeros(len(wi))
        if len(rows):
            result[rows] = case.evaluate(wo, wi[rows], device)[1]
        return result

    # Of some cells a mere corner is seen, which quadrature may miss. `fault_of_weights` tells samples of no density.
    expected = np.maximum(samples * integrate_pdf_over_bins(density, **integration), 1e-6)
    observed = sphere_histogram(found["wi"][smooth], integration["resolution"])
    return chi_square_test(observed, expected, tests=tests, samples=samples)


def fault_below(case: Case, device: str) -> str:
    """Return what is wrong below the surface, where value and density must be zero."""
    below = hemisphere(10_000, seed=4) * np.array([1.0, 1.0, -1.0])
    value, pdf, delta = case.evaluate(viewer(30.0), below, device)
    if (value != 0.0).any() or delta.any():
        return "`evaluate` is not 0 there; set `transmits` if light comes through"
    return "`pdf` is not 0 there" if (pdf != 0.0).any() else ""


def fault_of_weights(case: Case, degrees: float, device: str, *, rtol: float = 1e-4) -> str:
    """Return what is wrong with samples: weights are value over density, densities `pdf`, directions unit vectors."""
    wo = viewer(degrees)
    found = case.sample(wo, uniforms(40_000, 3, seed=1), device)
    wi = found["wi"].astype(np.float64)
    place = f"at {degrees:g}°"
    if not (np.abs(np.linalg.norm(wi, axis=1) - 1.0) < 2e-6).all():
        return f"directions of `sample` are no unit vectors {place}"
    if not (np.isfinite(found["weight"]).all() and (found["weight"] >= 0.0).all()):
        return f"weights of `sample` are negative or not finite {place}"
    if not (found["eta"] > 0.0).all():
        return f"`eta` of `sample` is not above 0 {place}; it is 1 for reflection"
    smooth = ~found["delta"].astype(bool) & (found["weight"].max(axis=1) > 0.0)
    value, pdf, _ = case.evaluate(wo, wi, device)
    if not (pdf[smooth] > 0.0).all():
        return f"`sample` draws directions for which `pdf` is 0 {place}"
    if not np.allclose(found["pdf"][smooth], pdf[smooth], rtol=rtol, atol=0.0):
        return f"the `pdf` of a sample is not what `pdf` returns {place}"
    if not np.allclose(found["weight"][smooth], value[smooth] / pdf[smooth, None], rtol=rtol, atol=1e-7):
        return f"the weight of a sample is not `evaluate` over `pdf` {place}"
    return "" if not found["pdf"][found["delta"].astype(bool)].any() else f"a delta has a density {place}"


def fault_of_values(case: Case, device: str, *, n: int = 20_000) -> str:
    """Return what is negative or not finite, at the horizon and for the last random numbers too."""
    grazing = np.array([viewer(a, b) for a in (0.0, 89.9, 89.99, 89.9999) for b in (0.0, 0.3, 3.0)])
    wo = np.concatenate([hemisphere(n, seed=20), np.repeat(grazing, 200, axis=0)])
    wi = np.concatenate([sphere(len(wo) - len(grazing) * 20, seed=21), np.tile(grazing, (20, 1))])
    for directions in (wi, wo * np.array([-1.0, -1.0, 1.0]), -wo):
        for name, values in zip(("evaluate", "pdf"), case.evaluate(wo, directions, device), strict=False):
            wrong = ~(np.isfinite(values) & (values >= 0.0)).reshape(len(wo), -1).all(axis=1)
            if wrong.any():
                k = int(np.flatnonzero(wrong)[0])
                return f"`{name}` is {values[k]} for wo {_text(wo[k])}, wi {_text(directions[k])}"
    u = uniforms(len(wo), 3, seed=22)
    edges = np.array([0.0, 2.0**-24, 0.25, 0.5, 0.75, 1.0 - 2.0**-24], np.float32)
    u[-(6**3) :] = np.stack(np.meshgrid(edges, edges, edges), axis=-1).reshape(-1, 3)
    u[: 6**3] = u[-(6**3) :]
    found = case.sample(wo, u, device)
    for name in ("wi", "weight", "pdf", "eta"):
        wrong = ~np.isfinite(found[name]).reshape(len(wo), -1).all(axis=1)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            return f"`{name}` of `sample` is {found[name][k]} for wo {_text(wo[k])}, u {_text(u[k])}"
    return "" if (found["weight"] >= 0.0).all() else "`weight` of `sample` is negative"


def _text(vector: NDArray[Any]) -> str:
    return "(" + ", ".join(f"{each:.4g}" for each in vector.tolist()) + ")"


def reciprocity_error(case: Case, device: str, *, n: int = 100_000) -> float:
    """Return the largest relative difference of f(wo, wi) and f(wi, wo) by reflection above the surface."""
    wo, wi = hemisphere(n, seed=2), hemisphere(n, seed=3)
    forward = case.evaluate(wo, wi, device)[0] / wi[:, 2:]
    backward = case.evaluate(wi, wo, device)[0] / wo[:, 2:]
    # Relative to the value, but at least to a thousandth of the typical one.
    larger = np.maximum(forward, backward)
    return float((np.abs(forward - backward) / np.maximum(larger, 1e-3 * np.median(larger) + 1e-12)).max())


def albedo(case: Case, degrees: float, device: str, *, samples: int = 2**19) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return mean energy reflected and transmitted per channel, and its standard error.

    Refraction squeezes light into another solid angle: that is not energy, so it is taken out by eta².
    """
    found = case.sample(viewer(degrees), uniforms(samples, 3, seed=5), device)
    energy = found["weight"].astype(np.float64) * (found["eta"].astype(np.float64) ** 2)[:, None]
    return energy.mean(axis=0), energy.std(axis=0, ddof=1) / np.sqrt(samples)
