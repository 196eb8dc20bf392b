"""Faults of media, and of the colours of waves."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    # Media
    Mutant(
        "phase-norm",
        "media",
        "kernels/media/phase.py",
        "0.25 * INV_PI * (1.0 - g * g)",
        "0.25 * (1.0 - g * g)",
        "tests/media/test_scattering.py -k directions",
    ),
    Mutant(
        "phase-direction",
        "media",
        "kernels/media/phase.py",
        "d = 1.0 + g * s",
        "d = 1.0 - g * s",
        "tests/media/test_scattering.py -k directions",
    ),
    Mutant(
        "beer-sign",
        "media",
        "kernels/media/medium.py",
        "exponential(-extinction[1] * distance)",
        "exponential(-extinction[0] * distance)",
        "tests/transport/test_whitted.py -k amber",
    ),
    Mutant(
        "grid-centres",
        "media",
        "kernels/media/grids.py",
        "place[0] * float(lattice.nx) - 0.5",
        "place[0] * float(lattice.nx)",
        "tests/media/test_grid_media.py -k rays_through",
    ),
    Mutant(
        "grid-majorant",
        "media",
        "wrt/upload/grids.py",
        ".max(axis, keepdims=True)",
        ".mean(axis, keepdims=True)",
        "tests/media/test_grid_media.py -k free_paths",
    ),
    Mutant(
        "grid-null-weight",
        "media",
        "kernels/media/grids.py",
        "wp.cw_mul(carried, wp.vec3(1.0) - real) / (1.0 - chance)",
        "carried",
        "tests/media/test_grid_media.py -k furnace",
    ),
    Mutant(
        "grid-residual",
        "media",
        "kernels/media/grids.py",
        "share = (density - walk.control) / walk.rate",
        "share = density / walk.rate",
        "tests/media/test_grid_media.py -k light_through",
    ),
    # Colours of waves
    Mutant(
        "dispersion-weight",
        "dispersion",
        "kernels/bsdf/dielectric.py",
        "(component(shares, channel) * eta * eta)",
        "(eta * eta)",
        "tests/materials/test_dispersion.py -k snells",
    ),
    Mutant(
        "dispersion-density",
        "dispersion",
        "kernels/bsdf/lobes/dispersion.py",
        "density += share * pdf_one(",
        "density += pdf_one(",
        "tests/materials/test_reflection_models.py -k 'follow and prism'",
    ),
    Mutant(
        "cauchy-line",
        "dispersion",
        "wrt/scene/materials/dispersion.py",
        "(wavelength**-2 - LINE_D**-2)",
        "(wavelength**-2 - LINE_C**-2)",
        "tests/materials/test_dispersion.py -k cauchy",
    ),
    Mutant(
        "film-path",
        "thin-films",
        "kernels/bsdf/lobes/thin_film.py",
        "d = 2.0 * index * thickness * cos_film",
        "d = 2.0 * index * thickness / cos_film",
        "tests/materials/test_thin_films.py -k spectrum",
    ),
    Mutant(
        "film-polarisation",
        "thin-films",
        "kernels/bsdf/lobes/thin_film.py",
        "(index * cos_i - cos_film) / (index * cos_i + cos_film)",
        "(cos_i - index * cos_film) / (cos_i + index * cos_film)",
        "tests/materials/test_thin_films.py -k 'spectrum or change'",
    ),
    Mutant(
        "film-on-clear",
        "thin-films",
        "kernels/bsdf/lobes/principled_base.py",
        "wp.cw_mul(b.color, wp.vec3(1.0) - boundary)",
        "b.color * (1.0 - wp.min(boundary))",
        "tests/materials/test_thin_films.py -k clear",
    ),
)
