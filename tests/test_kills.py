"""A render that is killed at any moment and resumed gives the picture of an uninterrupted one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import wrt

sys.path.insert(0, str(ROOT / "scripts"))

from kill_and_resume import RoundError, leftovers, require_whole


@pytest.mark.slow
def test_a_few_rounds_of_the_script(report) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "kill_and_resume.py"), "--rounds", "2", "--seed", "2"]
    result = subprocess.run(command, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 of 2 resumed to the byte" in result.stdout
    report("resumed to the byte", "2 of 2", "2 of 2")


def test_the_script_notices_what_a_kill_would_damage(tmp_path: Path) -> None:
    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=8)
    list(renderer.passes(spp=1))
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    wrt.save_image(tmp_path / "out.npy", renderer.image())
    require_whole(tmp_path)
    whole = (tmp_path / "a.ckpt").read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:100], b"", whole[:600] + b"\0" + whole[601:]):
        (tmp_path / "a.ckpt").write_bytes(damaged)
        with pytest.raises(RoundError, match="a damaged file"):
            require_whole(tmp_path)
    (tmp_path / "a.ckpt").unlink()
    (tmp_path / ".wrt-01234567-89abcdef.part.npy").write_bytes(np.zeros(3).tobytes())
    assert leftovers(tmp_path) == [".wrt-01234567-89abcdef.part.npy"]
