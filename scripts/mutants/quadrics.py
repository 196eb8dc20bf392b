"""Faults of disks and cylinders: where rays meet them, what is found there, and their light."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    Mutant(
        "quadric-cancels",
        "quadrics",
        "kernels/native/exact/quadrics.h",
        "middle + ((middle < 0.0f) ? (V)-half_chord : half_chord)",
        "middle + ((middle < 0.0f) ? half_chord : (V)-half_chord)",
        "tests/test_quadrics.py -k closed_form",
    ),
    Mutant(
        "quadric-ends",
        "quadrics",
        "kernels/native/exact/quadrics.h",
        "(size(o.z + product(nearer, d.z)) <= 0.5f)",
        "(size(o.z + product(nearer, d.z)) <= 0.52f)",
        "tests/test_quadrics.py -k closed_form",
    ),
    Mutant(
        "quadric-rim",
        "quadrics",
        "kernels/native/exact/quadrics.h",
        "<= 1.0f) ? product(s, unit) : none",
        "<= 1.01f) ? product(s, unit) : none",
        "tests/test_quadrics.py -k closed_form",
    ),
    Mutant(
        "quadric-side",
        "quadrics",
        "kernels/geometry/quadrics.py",
        "step = wp.where(from_outside, -step, step)",
        "step = wp.where(begins_outside, -step, step)",
        "tests/test_quadrics.py -k closed_form",
    ),
    Mutant(
        "quadric-turn",
        "quadrics",
        "kernels/geometry/quadrics.py",
        "wp.where(turn < 0.0, turn + 1.0, turn)",
        "wp.where(turn < 0.0, -turn, turn)",
        "tests/test_quadrics.py -k texture_coordinates",
    ),
    Mutant(
        "quadric-front",
        "quadrics",
        "wrt/scene/exact/quadrics.py",
        "self.axes[disks, 2] @ np.linalg.inv(linear)",
        "self.axes[disks, 2] @ linear.T",
        "tests/test_quadrics.py -k 'front or alike'",
    ),
    Mutant(
        "quadric-clearance",
        "quadrics",
        "kernels/geometry/quadrics.py",
        "sizes_of(quadric)) * _CLEARANCE",
        "sizes_of(quadric)) * (0.01 * _CLEARANCE)",
        "tests/test_quadrics.py -k closed_form",
    ),
    Mutant(
        "quadric-area",
        "quadrics",
        "kernels/geometry/quadrics.py",
        "return TWO_PI * wp.length(quadric.x) * wp.length(quadric.z)",
        "return 1.1 * TWO_PI * wp.length(quadric.x) * wp.length(quadric.z)",
        "tests/test_quadric_pictures.py -k of_a_cylinder",
    ),
    Mutant(
        "quadric-density",
        "quadrics",
        "kernels/lights/lights.py",
        "r = wp.sqrt(u[0])",
        "r = u[0]",
        "tests/test_quadric_pictures.py -k of_a_disk",
    ),
)
