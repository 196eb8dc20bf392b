"""`scripts/gpu_check.py` says what a GPU does, or in one line that there is none."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
import warp as wp
from conftest import ROOT
from support import films_of_devices
from support.emulated_cuda.backend import GPU, emulated_cuda


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("gpu_check")


def run(script: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[int, dict, str]:
    """Run it on an emulated GPU with one film and one small render, and return its status, JSON and page."""
    monkeypatch.setattr(films_of_devices, "FILMS", ("built-in-cornell-box",))
    monkeypatch.setattr(script, "SIZE", {"width": 16, "height": 12})
    line = ["--quick", "--no-tests", "--output", str(folder), "--scenes", "cornell-box", "--seconds", "0.01"]
    with emulated_cuda(optimization=0):
        status = script.main(line)
    page = (folder / "gpu-check.md").read_text(encoding="utf-8")
    return status, json.loads((folder / "gpu-check.json").read_text(encoding="utf-8")), page


def test_a_whole_check(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, results, page = run(script, tmp_path, monkeypatch)
    assert status == 0
    assert results["agrees"]
    assert results["films"][0]["rays"][0] == results["films"][0]["rays"][1] > 0
    assert [(row["scene"], row["device"]) for row in results["speed"]] == [("cornell-box", GPU), ("cornell-box", "cpu")]
    assert all(row["paths_per_second"] > 0.0 for row in results["speed"])
    assert "| built-in-cornell-box | " in page
    assert page.endswith("Everything agrees.\n")


def test_a_difference_is_said(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films_of_devices, "AGREE", 0.0)
    status, results, page = run(script, tmp_path, monkeypatch)
    assert status == 1
    assert not results["agrees"]
    assert "radiance: " in results["films"][0]["problems"][0]
    assert page.endswith("Something does not agree, see above.\n")


def test_what_tests_said_is_read(script: ModuleType) -> None:
    output = (
        "FAILED tests/test_a.py::test_b[cuda:0] - assert 1 == 2\nERROR tests/test_c.py\n2 failed, 31 passed in 3s\n"
    )
    failed = ["tests/test_a.py::test_b[cuda:0]", "tests/test_c.py"]
    assert script.read_tests(output, 1) == {"status": 1, "passed": 31, "failed": failed}


@pytest.mark.skipif(wp.get_cuda_device_count() > 0, reason="there is a GPU")
def test_without_a_gpu_it_says_so() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "gpu_check.py")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("gpu_check: device 'cuda:0': no ")
    assert done.stderr.endswith(" was found; use cpu\n")
