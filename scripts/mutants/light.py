"""Faults of lights, and of the integrators that follow trees of rays."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    # Lights
    Mutant(
        "spot-smooth",
        "lights",
        "kernels/lights/spot.py",
        "x * x * (3.0 - 2.0 * x)",
        "x * x * (2.0 - x)",
        "tests/lights/test_irradiance.py -k spot",
    ),
    Mutant(
        "spot-square",
        "lights",
        "kernels/lights/spot.py",
        "light.value / distance2",
        "light.value / sample.distance",
        "tests/lights/test_irradiance.py -k spot",
    ),
    Mutant(
        "projector-cosine",
        "lights",
        "kernels/lights/spot.py",
        "sample.distance / (depth * depth * depth)",
        "1.0 / (depth * depth)",
        "tests/lights/test_irradiance.py -k projector",
    ),
    Mutant(
        "triangle-density",
        "lights",
        "kernels/lights/lights.py",
        "return 2.0 * distance2 / (double_area * cos_light)",
        "return 2.04 * distance2 / (double_area * cos_light)",
        "tests/lights/test_irradiance.py",
    ),
    Mutant(
        "alias-table",
        "lights",
        "kernels/sampling/warps.py",
        "choice.index = aliases[i]",
        "choice.index = i",
        "tests/lights/test_discrete_tables.py",
    ),
    Mutant(
        "environment-choice",
        "lights",
        "kernels/lights/lights.py",
        "image_pdf(scene.environment, receiver, point) * probability",
        "image_pdf(scene.environment, receiver, point)",
        "tests/lights/test_irradiance.py -k chosen",
    ),
    Mutant(
        "power-heuristic",
        "lights",
        "kernels/integrators/next_event.py",
        "return a / (a + pdf_other * pdf_other)",
        "return pdf_this / (pdf_this + pdf_other)",
        "tests/transport/test_estimators.py -k heuristic",
    ),
    # Ray trees
    Mutant(
        "tree-importance",
        "whitted",
        "kernels/integrators/tree_ray.py",
        "r.eta_scale = parent.eta_scale * (lobes.eta * lobes.eta)",
        "r.eta_scale = parent.eta_scale",
        "tests/transport/test_whitted.py -k attenuation",
    ),
    Mutant(
        "jitter-share",
        "whitted",
        "kernels/integrators/tree_ray.py",
        "wp.cw_mul(part, s.weight) / rays, vertex",
        "wp.cw_mul(part, s.weight), vertex",
        "tests/transport/test_whitted.py -k square",
    ),
    Mutant(
        "jitter-twice",
        "whitted",
        "kernels/integrators/whitted.py",
        "counts = light.delta or not jitters",
        "counts = True",
        "tests/transport/test_whitted.py -k paths",
    ),
    Mutant(
        "roulette-weight",
        "path",
        "kernels/integrators/path_surface.py",
        "path.throughput = path.throughput / survival",
        "path.throughput = path.throughput",
        "tests/transport/test_estimators.py -k furnace",
    ),
)
