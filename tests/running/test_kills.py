"""What is killed or interrupted at any moment leaves nothing broken, and the next render gives the same bytes."""

import random
import signal
import time
from pathlib import Path

import pytest
from support.caches import CORNELL_BOX, copy_of_warm_cache
from support.commands import ENVIRONMENT, run, start

from wrt.rendering.checkpoint import read_checkpoint


def temporary_files(folder: Path) -> set[str]:
    """Return the names of the files that are being written, or that a killed render has abandoned."""
    return {path.name for path in folder.glob(".wrt-*.part*")}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_killed_render_is_resumed_to_the_byte(seed, tmp_path):
    """It is killed twice while it writes a checkpoint, and once at any time; files are whole after each kill."""
    scene = ("render", "cornell-box", "--size", "64x48", "--spp", "256", "--quiet", "-o")
    run(tmp_path, *scene, "expected.npy")
    chance, kills = random.Random(seed), 0
    resume = (*scene, "out.npy", "--checkpoint", "a.ckpt", "--resume", "--save-every", "0.05")
    for writes in (chance.randrange(1, 8), chance.randrange(1, 8), None):
        process = start(tmp_path, *resume)
        before, end = temporary_files(tmp_path), time.monotonic() + (120.0 if writes else chance.uniform(0.3, 2.0))
        while process.poll() is None and time.monotonic() < end and writes != 0:
            if writes and (begun := temporary_files(tmp_path) - before):
                before |= begun
                writes -= 1
            time.sleep(1e-4)
        process.kill()
        process.communicate()
        kills += process.returncode == -signal.SIGKILL
        if (tmp_path / "a.ckpt").exists():
            read_checkpoint(tmp_path / "a.ckpt")
    assert kills
    done = run(tmp_path, *resume)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "out.npy").read_bytes() == (tmp_path / "expected.npy").read_bytes()
    assert not temporary_files(tmp_path)


@pytest.mark.machinery
@pytest.mark.parametrize(
    ("number", "seconds", "options"),
    [(signal.SIGTERM, 0.1, ["--threads", "1"]), (signal.SIGINT, 0.7, []), (signal.SIGKILL, 1.5, [])],
)
def test_a_signal_in_a_compile_is_obeyed_and_the_next_render_is_right(number, seconds, options, tmp_path):
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
    _, messages = process.communicate(timeout=5.0)
    assert process.returncode != 0  # otherwise it ended before the signal
    assert messages.count("\n") <= 1
    done = run(tmp_path, *CORNELL_BOX, "film.npy", env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "film.npy").read_bytes() == (tmp_path / "right.npy").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "film.npy", "right.npy"]
