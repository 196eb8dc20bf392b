"""The picture is renewed during a render, whole or not at all and at little cost; failures do not end the render."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
from support.outputs import run

import wrt
from wrt.cli import renewal
from wrt.cli.renewal import FIRST_SECONDS, MOST_TIME, UNWATCHED_PASS, Renewal
from wrt.rendering.passes import LONGEST_PASS

LONG = ("--size", "16x16", "--spp", "8")


def progress(left: float | None = None) -> SimpleNamespace:
    return SimpleNamespace(seconds_left=left)


class Clock:
    """A clock that tests move on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def times(cost: float, seconds: float, step: float, save_every: float | None = None) -> tuple[list[float], float]:
    """When a render of passes of `step` seconds renews its picture, and the share of time that this takes."""
    clock = Clock()
    plan = Renewal(save_every, clock=clock)
    written, spent = [], 0.0

    def write() -> None:
        clock.now += cost

    while clock.now < 100.0 + seconds:
        clock.now += step
        picture, checkpoint = plan.due(progress(1000.0))
        if picture:
            plan.run(write, picture=True, checkpoint=checkpoint)
            written.append(clock.now - 100.0)
            spent += cost
    return written, spent / (clock.now - 100.0)


def test_the_first_renewal_is_soon_and_intervals_grow():
    written, share = times(0.01, 3600.0, 0.5)
    assert written[0] == pytest.approx(FIRST_SECONDS, abs=0.6)
    gaps = np.diff(written)
    assert gaps.min() >= FIRST_SECONDS
    assert gaps.max() <= 61.0
    assert gaps[-1] > 4.0 * gaps[0]
    assert share < 0.01


@pytest.mark.parametrize("cost", [0.1, 1.0, 5.0, 30.0])
def test_renewals_take_a_fiftieth_of_the_time_at_most(cost):
    written, share = times(cost, 4000.0, 1.0)
    assert len(written) >= 2
    # The cost of the first one is not known before.
    assert share <= MOST_TIME + 1.1 * cost / 4000.0


def test_intervals_can_be_given_and_turned_off():
    assert np.diff(times(0.01, 100.0, 0.5, 5.0)[0]) == pytest.approx(5.0, abs=0.6)
    assert times(0.01, 1e6, 1e3, float("inf"))[0] == []
    assert Renewal(5.0).pass_seconds == 5.0
    assert Renewal(None).pass_seconds is None
    assert Renewal(float("inf")).pass_seconds is None
    assert Renewal(5.0, watched=False).pass_seconds == 5.0
    assert Renewal(None, watched=False).pass_seconds == UNWATCHED_PASS
    assert Renewal(float("inf"), watched=False).pass_seconds == LONGEST_PASS
    cluster = {"watched": False, "longest": 3.0 * LONGEST_PASS}
    assert Renewal(20.0, **cluster).pass_seconds == 20.0
    assert Renewal(None, **cluster).pass_seconds == 3.0 * UNWATCHED_PASS
    assert Renewal(float("inf"), **cluster).pass_seconds == 3.0 * LONGEST_PASS


def test_short_renders_and_the_last_second_are_left_alone():
    clock = Clock()
    plan = Renewal(None, clock=clock)
    assert plan.due(progress(100.0)) == (False, False)
    clock.now += 1.9
    assert plan.due(progress(100.0)) == (False, False)
    clock.now += 0.2
    assert plan.due(progress(0.5)) == (False, False)
    assert plan.due(progress(5.0)) == (True, False)
    assert plan.due(progress(None)) == (True, False)
    clock.now += 60.0
    assert plan.due(progress(0.5)) == (False, True)


@pytest.fixture
def often(monkeypatch):
    """Renew after every pass."""
    monkeypatch.setattr(renewal, "FIRST_SECONDS", 0.0)
    monkeypatch.setattr(renewal, "SHARE_OF_RENDER", 0.0)
    monkeypatch.setattr(renewal, "MOST_TIME", float("inf"))
    monkeypatch.setattr(renewal, "NEARLY_DONE", -1.0)
    monkeypatch.setattr(Renewal, "pass_seconds", None)


def watched(monkeypatch, look) -> None:
    """Call `look` with the number of each pass after the one before it was written."""
    passes = wrt.Renderer.passes

    def watch(self, **options):
        for number, each in enumerate(passes(self, **options)):
            look(number)
            yield each

    monkeypatch.setattr(wrt.Renderer, "passes", watch)


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_the_picture_can_be_read_while_it_renders(tmp_path, monkeypatch, often, name):
    monkeypatch.chdir(tmp_path)
    seen = []
    layers = ("--layers", "albedo") if name == "a.exr" else ()
    watched(monkeypatch, lambda number: seen.append(wrt.load_image(name).mean()) if number else None)
    assert run("render", "cornell-box", "-o", name, *LONG, *layers, "--quiet") == 0
    assert len(seen) >= 2
    assert len(set(seen)) == len(seen)
    assert os.listdir() == [name]


def test_never_writes_it_only_at_the_end(tmp_path, monkeypatch, often):
    monkeypatch.chdir(tmp_path)
    seen = []
    watched(monkeypatch, lambda number: seen.append(os.listdir()))
    assert run("render", "cornell-box", "-o", "a.png", *LONG, "--save-every", "never") == 0
    assert seen
    assert not any(seen)
    assert os.listdir() == ["a.png"]


def test_the_last_picture_does_not_depend_on_renewals(tmp_path, monkeypatch, often):
    monkeypatch.chdir(tmp_path)
    assert run("render", "cornell-box", "-o", "a.exr", *LONG) == 0
    assert run("render", "cornell-box", "-o", "b.exr", *LONG, "--save-every", "never") == 0
    np.testing.assert_array_equal(wrt.load_image("a.exr"), wrt.load_image("b.exr"))


def test_a_disk_that_is_full_is_one_warning_and_the_picture_comes_at_the_end(tmp_path, monkeypatch, often, capsys):
    monkeypatch.chdir(tmp_path)
    save, calls = wrt.Renderer.save, []

    def full(self, path, **options):
        calls.append(path)
        if len(calls) <= 2:
            raise OSError(28, "No space left on device")
        return save(self, path, **options)

    monkeypatch.setattr(wrt.Renderer, "save", full)
    assert run("render", "cornell-box", "-o", "a.png", *LONG) == 0
    said = capsys.readouterr().err
    assert said.count("No space left on device; rendering continues") == 1
    assert wrt.load_image("a.png").shape == (16, 16, 3)


def test_memory_that_runs_out_in_a_renewal_does_not_end_the_render(tmp_path, monkeypatch, often, capsys):
    monkeypatch.chdir(tmp_path)
    image, calls = wrt.Renderer.image, []

    def once(self):
        calls.append(1)
        if len(calls) == 1:
            raise MemoryError
        return image(self)

    monkeypatch.setattr(wrt.Renderer, "image", once)
    assert run("render", "cornell-box", "-o", "a.png", *LONG) == 0
    assert "not enough memory for the picture; rendering continues" in capsys.readouterr().err
    assert os.listdir() == ["a.png"]


def test_a_file_that_appears_is_never_replaced(tmp_path, monkeypatch, often, capsys):
    monkeypatch.chdir(tmp_path)

    def appear(number: int) -> None:
        if number == 0:
            (tmp_path / "a.png").write_bytes(b"notes")

    watched(monkeypatch, appear)
    assert run("render", "cornell-box", "-o", "a.png", *LONG) == 0
    assert (tmp_path / "a.png").read_bytes() == b"notes"
    assert sorted(os.listdir()) == ["a-render.png", "a.png"]
    assert capsys.readouterr().err.count("a.png: already exists") == 1


def test_checkpoints_keep_their_own_interval(tmp_path, monkeypatch, often):
    monkeypatch.chdir(tmp_path)
    seen = []
    watched(monkeypatch, lambda number: seen.append(sorted(os.listdir())))
    assert run("render", "cornell-box", "-o", "a.png", *LONG, "--checkpoint", "a.ckpt") == 0
    assert seen[-1] == ["a.png"]  # a minute has not passed
    assert sorted(os.listdir()) == ["a.ckpt", "a.png"]
