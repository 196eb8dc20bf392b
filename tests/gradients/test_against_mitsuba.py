"""Gradients are those of Mitsuba's `prb` and `prbvolpath`, where these have the same parameters."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import pytest
from benchmarks import gradients
from benchmarks.gradient_scenes import CASES, SCENES
from conftest import Report

Z, ERROR = 4.5, 0.005
"""The greatest z, which a right program exceeds once in 3,000 runs, and the largest relative standard error: a fault of
2 % has a z of 4 at least, and of 5 or more by most parameters."""

OPTIONS = argparse.Namespace(size=32, depth=5, repeats=0, spp=256, seeds=24, llvm=None)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_gradients_are_those_of_prb(name: str, tmp_path: Path, report: Report) -> None:
    """Mitsuba's derivatives need LLVM: DRJIT_LIBLLVM_PATH and LD_LIBRARY_PATH."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        pytest.skip("needs DRJIT_LIBLLVM_PATH, the library of LLVM")

    row = gradients.measured(name, tmp_path, tmp_path / "cache", OPTIONS)
    for parameter, found in row["agreement"].items():
        report(f"{name}: {parameter}, z", found["z"], f"error {found['error']:.2%}")
    for parameter, found in row["agreement"].items():
        assert abs(found["z"]) < Z, parameter
        assert found["largest_z"] < Z, parameter
        assert found["error"] < ERROR or name in CASES, parameter
