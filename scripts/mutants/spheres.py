"""Faults of spheres: where rays meet them, what is found there, and their light."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    Mutant(
        "sphere-cancels",
        "spheres",
        "kernels/native/exact/spheres.h",
        "middle + ((middle < 0.0f) ? (V)-half_chord : half_chord)",
        "middle + ((middle < 0.0f) ? half_chord : (V)-half_chord)",
        "tests/geometry/test_exact_shapes.py -k 'spheres and closed_form'",
    ),
    Mutant(
        "sphere-near-root",
        "spheres",
        "kernels/native/exact/spheres.h",
        "(counts(roots.near)) ? roots.near : later",
        "(counts(roots.far)) ? roots.far : later",
        "tests/geometry/test_exact_shapes.py -k 'spheres or many_shapes'",
    ),
    Mutant(
        "sphere-turn",
        "spheres",
        "kernels/geometry/spheres.py",
        "wp.where(turn < 0.0, turn + 1.0, turn)",
        "wp.where(turn < 0.0, -turn, turn)",
        "tests/geometry/test_exact_shapes.py -k 'spheres and closed_form'",
    ),
    Mutant(
        "sphere-meridian",
        "spheres",
        "kernels/geometry/spheres.py",
        "to_world(axes, down) * (_PI * radius)",
        "to_world(axes, down) * (TWO_PI * radius)",
        "tests/geometry/test_exact_shapes.py -k 'spheres and closed_form'",
    ),
    Mutant(
        "sphere-side",
        "spheres",
        "kernels/geometry/spheres.py",
        "wp.where(point.from_outside, -step, step)",
        "wp.where(begins_outside, -step, step)",
        "tests/geometry/test_exact_shapes.py -k 'spheres and closed_form'",
    ),
    Mutant(
        "sphere-clearance",
        "spheres",
        "kernels/geometry/spheres.py",
        "* _CLEARANCE + sphere.slack",
        "* (0.01 * _CLEARANCE) + sphere.slack",
        "tests/geometry/test_exact_pictures.py -k leaks",
    ),
    Mutant(
        "sphere-cone",
        "spheres",
        "kernels/lights/lights.py",
        "return cone_pdf(sphere_one_minus_cos(sphere.center, sphere.radius, receiver.position))",
        "return 1.1 * cone_pdf(sphere_one_minus_cos(sphere.center, sphere.radius, receiver.position))",
        "tests/geometry/test_exact_pictures.py -k 'irradiance and sphere'",
    ),
)
