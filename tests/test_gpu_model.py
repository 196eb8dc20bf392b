"""`scripts/gpu_model.py` counts what threads of the emulated GPU execute."""

from __future__ import annotations

import importlib

import pytest
from conftest import ROOT


@pytest.mark.slow
def test_counts_of_a_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    script = importlib.import_module("gpu_model")
    monkeypatch.setattr(script, "CROP", (240, 240, 256, 248))
    monkeypatch.setattr(script, "SAMPLES", 1)
    counts = script.count("cornell-box")
    # A ray through a tree of a few nodes, and shading: thousands of instructions, a twentieth of them loads.
    assert 500.0 < counts.instructions < 10_000.0
    assert 0.02 < counts.loads / counts.instructions < 0.3
    assert counts.local < 1.0, "the stack of such a tree is in registers"
    assert 1.0 / script.WARP < counts.efficiency < 1.0
    assert f"| cornell-box | {counts.instructions:.0f} | " in script.table([counts])
