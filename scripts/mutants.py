"""Faults that `mutate.py` plants: a file, a text in it, the text in its place, and the tests that should notice."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """One fault.

    Attributes:
        name: for the command line and the reports.
        subject: the row of docs/proofs.md that it belongs to, see `proofs.py`.
        file: where the fault is, from the root of the repository.
        old: a text that occurs in the file.
        new: the text in its place.
        tests: arguments of pytest for the tests that should notice.
    """

    name: str
    subject: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS: tuple[Mutant, ...] = (
    # Reflection models
    Mutant(
        "fresnel-half",
        "fresnel",
        "kernels/bsdf/lobes/fresnel.py",
        "0.5 * (r_s * r_s + r_p * r_p)",
        "0.51 * (r_s * r_s + r_p * r_p)",
        "tests/test_fresnel.py -k forms",
    ),
    Mutant(
        "conductor-sine",
        "fresnel",
        "kernels/bsdf/lobes/fresnel.py",
        "t4 = t2 * sin2",
        "t4 = t2 * cos2",
        "tests/test_fresnel.py -k conductor",
    ),
    Mutant(
        "schlick-power",
        "fresnel",
        "kernels/bsdf/lobes/fresnel.py",
        "(x2 * x2 * x)",
        "(x2 * x2)",
        "tests/test_fresnel.py -k schlick",
    ),
    Mutant(
        "schlick-angle",
        "dielectric",
        "kernels/bsdf/dielectric.py",
        "if eta < 1.0:",
        "if eta > 1.0:",
        "tests/test_fresnel.py -k lecture",
    ),
    Mutant(
        "radiance-in-glass",
        "dielectric",
        "kernels/bsdf/dielectric.py",
        "s.weight = bsdf.slots[TRANSMITTANCE] * (scale * scale)",
        "s.weight = bsdf.slots[TRANSMITTANCE]",
        "tests/test_fresnel.py -k lecture",
    ),
    Mutant(
        "square-cosine",
        "glossy",
        "kernels/bsdf/glossy.py",
        "(side * side * cos_a * cos_a * cos_a)",
        "(side * side * cos_a * cos_a)",
        "tests/test_glossy.py -k density",
    ),
    Mutant(
        "phong-exponent",
        "glossy",
        "kernels/bsdf/glossy.py",
        "(bsdf.slots[EXPONENT][0] + 1.0)",
        "(bsdf.slots[EXPONENT][0] + 2.0)",
        "tests/test_glossy.py -k phong",
    ),
    Mutant(
        "phong-norm",
        "glossy",
        "kernels/bsdf/glossy.py",
        "(0.5 * INV_PI)",
        "(0.51 * INV_PI)",
        "tests/test_glossy.py -k phong",
    ),
    Mutant(
        "ggx-norm",
        "microfacets",
        "kernels/microfacet/ggx.py",
        "1.0 / (PI * shape[0] * shape[1] * s * s)",
        "1.0 / (shape[0] * shape[1] * s * s)",
        "tests/test_microfacet.py -k ggx",
    ),
    Mutant(
        "ggx-masking",
        "microfacets",
        "kernels/microfacet/ggx.py",
        "return 0.5 * t /",
        "return 0.49 * t /",
        "tests/test_masking.py",
    ),
    Mutant(
        "ggx-sampler",
        "microfacets",
        "kernels/microfacet/ggx.py",
        "(1.0 - u[1]) * (1.0 + w[2])))",
        "(1.0 - u[1]) * (1.02 + w[2])))",
        "tests/test_microfacet.py -k ggx",
    ),
    Mutant(
        "beckmann-exponent",
        "microfacets",
        "kernels/microfacet/beckmann.py",
        "exponential(-e)",
        "exponential(-1.02 * e)",
        "tests/test_microfacet.py -k beckmann",
    ),
    Mutant(
        "blinn-exponent",
        "microfacets",
        "kernels/microfacet/blinn_phong.py",
        "(1.0 - inv_alpha2) * log1p",
        "(1.02 - inv_alpha2) * log1p",
        "tests/test_microfacet.py -k blinn",
    ),
    Mutant(
        "widening-half",
        "normal-maps",
        "kernels/microfacet/widening.py",
        "alpha * alpha + 2.0 * variance",
        "alpha * alpha + variance",
        "tests/test_normal_filtering.py",
    ),
    Mutant(
        "bumpy-weight",
        "normal-maps",
        "kernels/microfacet/bumpy_ggx.py",
        "beckmann_weight(bumps, 1.964, -0.811, 0.441)",
        "beckmann_weight(bumps, 1.864, -0.811, 0.441)",
        "tests/test_bumpy_ggx.py -k slopes",
    ),
    Mutant(
        "bumpy-choice",
        "normal-maps",
        "kernels/microfacet/bumpy_ggx.py",
        "chosen < found[0]",
        "chosen < 1.04 * found[0]",
        "tests/test_bumpy_ggx.py -k follow",
    ),
    Mutant(
        "oren-nayar-term",
        "oren-nayar",
        "kernels/bsdf/oren_nayar.py",
        "0.45 * s2 / (s2 + 0.09)",
        "0.45 * s2 / (s2 + 0.13)",
        "tests/test_oren_nayar.py",
    ),
    Mutant(
        "oren-nayar-energy",
        "oren-nayar",
        "kernels/bsdf/oren_nayar.py",
        "return wp.max(0.0, _C1 - INV_PI * g)",
        "return wp.max(0.0, _C1 + INV_PI * g)",
        "tests/test_oren_nayar.py",
    ),
    Mutant(
        "plastic-square",
        "plastic",
        "kernels/bsdf/plastic.py",
        "transmitted(wi[2], eta) / (eta * eta)",
        "transmitted(wi[2], eta) / (1.02 * eta * eta)",
        "tests/test_plastic.py -k albedo",
    ),
    Mutant(
        "plastic-coat",
        "plastic",
        "kernels/bsdf/rough_plastic.py",
        "share * INV_PI * wi[2] + (1.0 - share) * coat",
        "share * INV_PI * wi[2] + (1.02 - share) * coat",
        "tests/test_plastic.py -k follow",
    ),
    Mutant(
        "coupled-layers",
        "principled",
        "kernels/bsdf/principled.py",
        "wp.max(left_o, 0.0) * wp.max(left_i, 0.0)",
        "wp.max(left_o, 0.0) * wp.max(left_o, 0.0)",
        "tests/test_principled_agreement.py -k integrals",
    ),
    # Constants
    Mutant(
        "silver-digit",
        "constants",
        "wrt/scene/materials/presets.py",
        "(0.972, 0.960, 0.915)",
        "(0.972, 0.690, 0.915)",
        "tests/test_presets.py -k printed",
    ),
    Mutant(
        "index-digit",
        "constants",
        "wrt/scene/materials/presets.py",
        '"diamond": (2.42, 2.42)',
        '"diamond": (2.24, 2.24)',
        "tests/test_presets.py",
    ),
    Mutant(
        "range-end",
        "constants",
        "wrt/scene/materials/presets.py",
        "sum(DIELECTRIC_F0[key]) / 2.0,) * 3",
        "DIELECTRIC_F0[key][0],) * 3",
        "tests/test_presets.py -k scene",
    ),
    Mutant(
        "flat-transmittance",
        "constants",
        "wrt/scene/materials/dielectrics.py",
        "4.0 * t**7",
        "4.0 * t**6",
        "tests/test_rough_dielectric.py -k mean_transmittance",
    ),
    # Media
    Mutant(
        "phase-norm",
        "media",
        "kernels/media/phase.py",
        "0.25 * INV_PI * (1.0 - g * g)",
        "0.25 * (1.0 - g * g)",
        "tests/test_phase.py",
    ),
    Mutant(
        "phase-direction",
        "media",
        "kernels/media/phase.py",
        "d = 1.0 + g * s",
        "d = 1.0 - g * s",
        "tests/test_phase.py",
    ),
    Mutant(
        "beer-sign",
        "media",
        "kernels/media/medium.py",
        "exponential(-extinction[1] * distance)",
        "exponential(-extinction[0] * distance)",
        "tests/test_whitted.py -k amber",
    ),
    Mutant(
        "grid-centres",
        "media",
        "kernels/media/grids.py",
        "place[0] * float(lattice.nx) - 0.5",
        "place[0] * float(lattice.nx)",
        "tests/test_grid_media.py -k rays_through",
    ),
    Mutant(
        "grid-majorant",
        "media",
        "wrt/upload/grids.py",
        ".max(axis, keepdims=True)",
        ".mean(axis, keepdims=True)",
        "tests/test_grid_media.py -k free_paths",
    ),
    Mutant(
        "grid-null-weight",
        "media",
        "kernels/media/grids.py",
        "wp.cw_mul(carried, wp.vec3(1.0) - real) / (1.0 - chance)",
        "carried",
        "tests/test_grid_media.py -k furnace",
    ),
    Mutant(
        "grid-residual",
        "media",
        "kernels/media/grids.py",
        "share = (density - walk.control) / walk.rate",
        "share = density / walk.rate",
        "tests/test_grid_media.py -k light_through",
    ),
    # Lights
    Mutant(
        "spot-smooth",
        "lights",
        "kernels/lights/spot.py",
        "x * x * (3.0 - 2.0 * x)",
        "x * x * (2.0 - x)",
        "tests/test_irradiance.py -k spot",
    ),
    Mutant(
        "spot-square",
        "lights",
        "kernels/lights/spot.py",
        "light.value / distance2",
        "light.value / sample.distance",
        "tests/test_irradiance.py -k spot",
    ),
    Mutant(
        "triangle-density",
        "lights",
        "kernels/lights/lights.py",
        "return 2.0 * distance2 / (cross_length * cos_light)",
        "return 2.04 * distance2 / (cross_length * cos_light)",
        "tests/test_irradiance.py",
    ),
    Mutant(
        "alias-table",
        "lights",
        "kernels/sampling/warps.py",
        "choice.index = aliases[i]",
        "choice.index = i",
        "tests/test_alias.py",
    ),
    Mutant(
        "environment-choice",
        "lights",
        "kernels/lights/lights.py",
        "image_pdf(scene.environment, receiver, point) * probability",
        "image_pdf(scene.environment, receiver, point)",
        "tests/test_environment_sampling.py -k chosen",
    ),
    Mutant(
        "power-heuristic",
        "lights",
        "kernels/integrators/next_event.py",
        "return a / (a + pdf_other * pdf_other)",
        "return pdf_this / (pdf_this + pdf_other)",
        "tests/test_multiple_importance.py",
    ),
    # Ray trees
    Mutant(
        "tree-importance",
        "whitted",
        "kernels/integrators/tree_ray.py",
        "r.eta_scale = parent.eta_scale * (lobes.eta * lobes.eta)",
        "r.eta_scale = parent.eta_scale",
        "tests/test_whitted.py -k attenuation",
    ),
    Mutant(
        "jitter-share",
        "whitted",
        "kernels/integrators/tree_ray.py",
        "wp.cw_mul(part, s.weight) / rays, vertex",
        "wp.cw_mul(part, s.weight), vertex",
        "tests/test_whitted.py -k square",
    ),
    Mutant(
        "jitter-twice",
        "whitted",
        "kernels/integrators/whitted.py",
        "counts = light.delta or not jitters",
        "counts = True",
        "tests/test_whitted.py -k paths",
    ),
    Mutant(
        "roulette-weight",
        "path",
        "kernels/integrators/russian_roulette.py",
        "path.throughput = path.throughput / survival",
        "path.throughput = path.throughput",
        "tests/test_furnace.py",
    ),
    # Samples
    Mutant(
        "triangle-map",
        "samples",
        "kernels/sampling/warps.py",
        "b0 = 0.5 * u[0]\n        return wp.vec2(b0, u[1] - b0)",
        "b0 = 0.5 * u[0]\n        return wp.vec2(b0, u[1])",
        "tests/test_warps.py",
    ),
    Mutant(
        "sphere-map",
        "samples",
        "kernels/sampling/warps.py",
        "z = 1.0 - 2.0 * u[0]",
        "z = 1.0 - 1.96 * u[0]",
        "tests/test_warps.py",
    ),
    Mutant(
        "sampler-bits",
        "samples",
        "kernels/sampling/sampler.py",
        "c: wp.uint32, d: wp.uint32) -> wp.vec4ui:",
        "c: wp.uint32, d_: wp.uint32) -> wp.vec4ui:\n    d = wp.uint32(0)",
        "tests/test_sampler.py",
    ),
    # Cameras
    Mutant(
        "closed-shutter",
        "cameras",
        "kernels/camera/camera.py",
        "return camera.shutter_open + x * (camera.shutter_close - camera.shutter_open)",
        "return camera.shutter_open",
        "tests/test_shutter.py",
    ),
    # Files and films
    Mutant(
        "srgb-power",
        "colours",
        "wrt/scene/srgb.py",
        "** (1.0 / 2.4)",
        "** (1.0 / 2.2)",
        "tests/test_image_files.py -k curve",
    ),
    Mutant(
        "film-variance",
        "film",
        "wrt/rendering/film.py",
        "spread / (n - 1.0)",
        "spread / n",
        "tests/test_film_statistics.py",
    ),
    Mutant(
        "digest-without-emission",
        "checkpoints",
        "wrt/rendering/fingerprint.py",
        "[(shape.emission, shape.two_sided_emission) for shape in scene.shapes]",
        "[shape.emission for shape in scene.shapes]",
        "tests/test_fingerprint.py",
    ),
    Mutant(
        "checkpoint-without-rays",
        "checkpoints",
        "wrt/rendering/checkpoint.py",
        '    "jittered_rays",\n',
        "",
        "tests/test_integrators.py -k checkpoint",
    ),
    Mutant(
        "checkpoint-without-depth",
        "checkpoints",
        "wrt/rendering/checkpoint.py",
        '    "max_depth",\n',
        "",
        "tests/test_checkpoint.py",
    ),
)
"""All faults, by subject."""
