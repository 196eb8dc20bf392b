"""What is killed or interrupted at any moment leaves nothing broken, and the next render gives the same bytes."""

from __future__ import annotations

import random
import signal
import time
from collections import Counter
from pathlib import Path

import kill_and_resume
import numpy as np
import pytest
from kill_and_resume import ENDED_BEFORE, RoundError, play_round, references, require_intact, temporary_files
from support.caches import CORNELL_BOX, copy_of_warm_cache
from support.commands import ENVIRONMENT, run, start

import wrt


@pytest.mark.slow
def test_a_killed_render_is_resumed_to_the_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice, of a small scene; `scripts/kill_and_resume.py` plays more rounds with more scenes, and kills compiles."""
    scene = ("cornell-box", "--size", "64x48", "--spp", "256")
    monkeypatch.setattr(kill_and_resume, "SCENES", (scene,))
    monkeypatch.setattr(kill_and_resume, "AIMS", {"write": 0.7, "time": 0.3})
    expected, hits = references(tmp_path), Counter[str]()
    for number in range(2):
        folder = tmp_path / f"round-{number}"
        folder.mkdir()
        hits += play_round(expected, folder, random.Random(number))
    assert hits[ENDED_BEFORE] < hits.total()


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_the_script_notices_what_a_kill_would_damage(tmp_path: Path) -> None:
    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=8)
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    wrt.save_image(tmp_path / "out.npy", np.ones((8, 8, 3), np.float32))
    require_intact(tmp_path)
    whole = (tmp_path / "a.ckpt").read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", whole[:600] + bytes([whole[600] ^ 1]) + whole[601:]):
        (tmp_path / "a.ckpt").write_bytes(damaged)
        with pytest.raises(RoundError, match="a damaged file"):
            require_intact(tmp_path)
    (tmp_path / "a.ckpt").unlink()
    (tmp_path / ".wrt-01234567-89abcdef.part.npy").write_bytes(np.zeros(3).tobytes())
    assert temporary_files(tmp_path) == {".wrt-01234567-89abcdef.part.npy"}


@pytest.mark.machinery
@pytest.mark.parametrize(
    ("number", "seconds", "options"),
    [(signal.SIGTERM, 0.1, ["--threads", "1"]), (signal.SIGINT, 0.7, []), (signal.SIGKILL, 1.5, [])],
)
def test_a_signal_in_a_compile_is_obeyed_and_the_next_render_is_right(
    number: signal.Signals, seconds: float, options: list[str], tmp_path: Path
) -> None:
    """The two kernels that take longest are not compiled yet."""
    environment = {**ENVIRONMENT, "TMPDIR": str(tmp_path)}
    run(tmp_path, *CORNELL_BOX, "right.npy", env=environment)
    copy_of_warm_cache(tmp_path / "cache", but_for=("wrt.render.", "wrt.kernels.accel.build.split_"))
    environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    environment.pop("WARP_CACHE_PATH", None)
    process = start(tmp_path, *CORNELL_BOX, "film.npy", *options, env=environment)
    while not list(tmp_path.glob("wrt-work-*/kernels/*")) and process.poll() is None:
        time.sleep(0.01)
    time.sleep(seconds)
    process.send_signal(number)
    _, said = process.communicate(timeout=5.0)
    assert process.returncode != 0  # otherwise it ended before the signal
    assert said.count("\n") <= 1
    done = run(tmp_path, *CORNELL_BOX, "film.npy", env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "film.npy").read_bytes() == (tmp_path / "right.npy").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "film.npy", "right.npy"]
