"""Scripts that measure and model kernels on GPUs and CPUs: that they run, and what no other test says of kernels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gpu_check
import gpu_model
import pytest
from conftest import Report
from support import films_of_devices
from support.emulated_cuda.backend import GPU, emulated_cuda

from wrt.rendering.render_kernel import REGENERATE

pytestmark = pytest.mark.machinery


def test_lanes_begin_paths_together_once_half_of_them_wait(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(REGENERATE, "0")  # the script sets it
    monkeypatch.setattr(gpu_model, "CROP", (200, 260, 216, 268))  # four warps
    loop, counts = (gpu_model.count("cornell-box", regenerates=each) for each in (False, True))
    report("lanes that follow paths", counts.paths, loop.paths)
    report("lanes that work", counts.efficiency, loop.efficiency)
    assert loop.paths < 0.6, "lanes wait for the longest path"
    assert 0.7 < counts.paths < 0.8, "lanes begin paths once half of them wait: 0.87 if at once"
    assert counts.issued < 0.9 * loop.issued
    assert counts.local < 1.0, "the stack of such a tree is in registers"
    assert "| cornell-box | " in gpu_model.table([counts])


@pytest.mark.parametrize("agree", [films_of_devices.AGREE, 0.0])
def test_the_check_of_a_gpu_says_whether_films_agree(agree: float, tmp_path: Path, monkeypatch) -> None:
    """On an emulated GPU with one film and one small render."""
    monkeypatch.setattr(films_of_devices, "FILMS", ("built-in-cornell-box",))
    monkeypatch.setattr(films_of_devices, "AGREE", agree)
    monkeypatch.setattr(gpu_check, "SIZE", {"width": 16, "height": 12})
    line = ["--quick", "--no-tests", "--output", str(tmp_path), "--scenes", "cornell-box", "--seconds", "0.01"]
    with emulated_cuda(optimization=0):
        status = gpu_check.main(line)
    results: dict[str, Any] = json.loads((tmp_path / "gpu-check.json").read_text(encoding="utf-8"))
    page = (tmp_path / "gpu-check.md").read_text(encoding="utf-8")
    assert (status, results["agrees"]) == ((0, True) if agree else (1, False))
    assert page.endswith("Everything agrees.\n" if agree else "Something does not agree, see above.\n")
    assert [(row["scene"], row["device"]) for row in results["speed"]] == [("cornell-box", GPU), ("cornell-box", "cpu")]
