"""Faults of samples, cameras, films and files."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    # Samples
    Mutant(
        "triangle-map",
        "samples",
        "kernels/sampling/warps.py",
        "b0 = 0.5 * u[0]\n        return wp.vec2(b0, u[1] - b0)",
        "b0 = 0.5 * u[0]\n        return wp.vec2(b0, u[1])",
        "tests/transport/test_warps.py",
    ),
    Mutant(
        "sphere-map",
        "samples",
        "kernels/sampling/warps.py",
        "z = 1.0 - 2.0 * u[0]",
        "z = 1.0 - 1.96 * u[0]",
        "tests/transport/test_warps.py",
    ),
    Mutant(
        "sampler-bits",
        "samples",
        "kernels/sampling/sampler.py",
        "c: wp.uint32, d: wp.uint32) -> wp.vec4ui:",
        "c: wp.uint32, d_: wp.uint32) -> wp.vec4ui:\n    d = wp.uint32(0)",
        "tests/film/test_random_numbers.py",
    ),
    # Cameras
    Mutant(
        "closed-shutter",
        "cameras",
        "kernels/camera/camera.py",
        "return camera.shutter_open + x * (camera.shutter_close - camera.shutter_open)",
        "return camera.shutter_open",
        "tests/geometry/test_motion_blur.py",
    ),
    # Files and films
    Mutant(
        "srgb-power",
        "colours",
        "wrt/scene/srgb.py",
        "** (1.0 / 2.4)",
        "** (1.0 / 2.2)",
        "tests/output/test_image_files.py -k curve",
    ),
    Mutant(
        "film-variance",
        "film",
        "wrt/rendering/film.py",
        "spread / (n - 1.0)",
        "spread / n",
        "tests/film/test_film.py",
    ),
    Mutant(
        "digest-without-emission",
        "checkpoints",
        "wrt/rendering/fingerprint.py",
        "[(shape.emission, shape.two_sided_emission) for shape in scene.shapes]",
        "[shape.emission for shape in scene.shapes]",
        "tests/files/test_fingerprint.py",
    ),
    Mutant(
        "checkpoint-without-rays",
        "checkpoints",
        "wrt/rendering/checkpoint.py",
        '    "jittered_rays",\n',
        "",
        "tests/transport/test_integrators.py -k checkpoint",
    ),
    Mutant(
        "checkpoint-without-depth",
        "checkpoints",
        "wrt/rendering/checkpoint.py",
        '    "max_depth",\n',
        "",
        "tests/rendering/test_checkpoint.py",
    ),
)
