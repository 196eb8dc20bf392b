"""Where the system allows no more threads, the threads that there are do the work, or one line says what lacks."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import ROOM, SMALL
from support.small_scenes import block_scene, image_of

import wrt
from wrt.backend.slices import Threads
from wrt.cli import main

Allow = Callable[[int], None]


@pytest.fixture
def allow(monkeypatch: pytest.MonkeyPatch) -> Allow:
    """Return a function that allows so many threads more."""
    start, left = threading.Thread.start, [0]

    def start_or_fail(self: threading.Thread) -> None:
        if left[0] <= 0:
            raise RuntimeError("can't start new thread")
        left[0] -= 1
        start(self)

    def set_left(count: int) -> None:
        left[0] = count

    monkeypatch.setattr(threading.Thread, "start", start_or_fail)
    return set_left


@pytest.mark.parametrize("allowed", [0, 1, 2])
def test_each_work_is_done_once(allowed: int, allow: Allow) -> None:
    done: list[int] = []
    allow(allowed)
    pool = Threads(2, "few")
    futures: list[Future[Any]] = [pool.submit(done.append, number) for number in range(10)]
    assert [future.result(timeout=60) for future in futures] == [None] * 10
    allow(2)  # these find what the caller's thread has done
    pool.submit(done.append, 10).result(timeout=60)
    pool.end()
    assert sorted(done) == list(range(11))


def test_errors_reach_who_asks_for_the_result(allow: Allow) -> None:
    with pytest.raises(ZeroDivisionError):
        Threads(1, "none").submit(lambda: 1 // 0).result(timeout=60)


@pytest.mark.parametrize("allowed", [0, 1])
def test_pictures_are_the_same(allowed: int, allow: Allow) -> None:
    expected = image_of(wrt.Renderer(block_scene(), width=12, height=10, threads=1), 5)
    allow(allowed)
    found = image_of(wrt.Renderer(block_scene(), width=12, height=10, threads=3), 5)
    np.testing.assert_array_equal(found, expected)


def test_the_command_line(
    allow: Allow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.toml").write_text(ROOM)
    assert main(["render", "room.toml", *SMALL, "--threads", "2"]) == 0
    assert wrt.load_image("room.png").shape == (8, 8, 3)
    cameras = [wrt.load("room.toml").camera] * 3
    assert len(list(wrt.render_views("room.toml", cameras, width=8, height=8, spp=1))) == 3
    capsys.readouterr()
    assert main(["view", "room.toml", "--no-browser"]) == 1
    said = (
        "wrt: error: the system allows no more threads or processes (ulimit -u, or the pids.max of a control group)\n"
    )
    assert capsys.readouterr().err == said
