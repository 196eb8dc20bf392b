"""The check that users run on their GPU (`scripts/gpu_check.py`), on an emulated one."""

import json

import gpu_check
import pytest
from support import films_of_devices
from support.emulated_cuda.backend import GPU, emulated_cuda

pytestmark = pytest.mark.machinery


@pytest.mark.parametrize("agree", [films_of_devices.AGREE, 0.0])
def test_the_check_of_a_gpu_says_whether_films_agree(agree, tmp_path, monkeypatch):
    """On an emulated GPU with one film and one small render."""
    monkeypatch.setattr(films_of_devices, "FILMS", ("built-in-cornell-box",))
    monkeypatch.setattr(films_of_devices, "AGREE", agree)
    monkeypatch.setattr(gpu_check, "SIZE", {"width": 16, "height": 12})
    line = ["--quick", "--no-tests", "--output", str(tmp_path), "--scenes", "cornell-box", "--seconds", "0.01"]
    with emulated_cuda(optimization=0):
        status = gpu_check.main(line)
    results = json.loads((tmp_path / "gpu-check.json").read_text(encoding="utf-8"))
    page = (tmp_path / "gpu-check.md").read_text(encoding="utf-8")
    assert (status, results["agrees"]) == ((0, True) if agree else (1, False))
    assert page.endswith("Everything agrees.\n" if agree else "Something does not agree, see above.\n")
    assert [(row["scene"], row["device"]) for row in results["speed"]] == [("cornell-box", GPU), ("cornell-box", "cpu")]
