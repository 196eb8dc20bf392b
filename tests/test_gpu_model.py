"""`scripts/gpu_model.py` counts what threads and warps of the emulated GPU execute."""

from __future__ import annotations

import importlib
from typing import Any

import pytest
from conftest import ROOT, Report

from wrt.rendering.render_kernel import REGENERATE


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script, for four warps."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    script = importlib.import_module("gpu_model")
    monkeypatch.setenv(REGENERATE, "0")  # the script sets it
    monkeypatch.setattr(script, "CROP", (200, 260, 216, 268))
    return script


@pytest.mark.slow
def test_counts_of_a_scene(script: Any, report: Report) -> None:
    loop, counts = (script.count("cornell-box", regenerates=each) for each in (False, True))
    # A ray through a tree of a few nodes, and shading: thousands of instructions, a twentieth of them loads.
    assert 500.0 < counts.instructions < 10_000.0
    assert 0.02 < counts.loads / counts.instructions < 0.3
    assert counts.local < 1.0, "the stack of such a tree is in registers"
    report("lanes that follow paths", counts.paths, loop.paths)
    report("lanes that work", counts.efficiency, loop.efficiency)
    assert loop.paths < 0.6, "lanes wait for the longest path"
    assert 0.7 < counts.paths < 0.8, "lanes begin paths once half of them wait: 0.87 if at once"
    assert counts.issued < 0.9 * loop.issued
    assert 1.0 / script.WARP < counts.efficiency < counts.paths
    assert f"| cornell-box | {counts.instructions:.0f} | {counts.issued:.0f} | " in script.table([counts])
