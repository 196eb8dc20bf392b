"""The picture is renewed during a render, whole or not at all and at little cost; failures do not end the render."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.outputs import run

import wrt
from wrt.cli import renewal
from wrt.cli.renewal import FIRST_SECONDS, MOST_TIME, UNWATCHED_PASS, Renewal
from wrt.rendering.passes import LONGEST_PASS

LONG = ("render", "cornell-box", "--size", "16x16", "--spp", "8")


def due(plan: Renewal, seconds_left: float | None) -> tuple[bool, bool]:
    return plan.due(SimpleNamespace(seconds_left=seconds_left))


class Clock:
    """A clock that tests move on."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def times(cost: float, seconds: float, step: float, save_every: float | None = None) -> tuple[list[float], float]:
    """When a render of passes of `step` seconds renews its picture, and the share of time that this takes."""
    clock = Clock()
    plan = Renewal(save_every, clock=clock)
    written = []

    def write() -> None:
        clock.now += cost

    while clock.now < 100.0 + seconds:
        clock.now += step
        picture, checkpoint = due(plan, 1000.0)
        if picture:
            plan.run(write, picture=True, checkpoint=checkpoint)
            written.append(clock.now - 100.0)
    return written, cost * len(written) / (clock.now - 100.0)


def test_the_first_renewal_is_soon_intervals_grow_and_a_fiftieth_of_the_time_is_spent():
    written, share = times(0.01, 3600.0, 0.5)
    assert written[0] == pytest.approx(FIRST_SECONDS, abs=0.6)
    gaps = np.diff(written)
    assert FIRST_SECONDS <= gaps.min() < gaps.max() <= 61.0
    assert gaps[-1] > 4.0 * gaps[0]
    assert share < 0.01
    for cost in (0.1, 5.0, 30.0):
        written, share = times(cost, 4000.0, 1.0)
        assert len(written) >= 2
        # The cost of the first one is not known before.
        assert share <= MOST_TIME + 1.1 * cost / 4000.0


def test_intervals_can_be_given_and_turned_off():
    assert np.diff(times(0.01, 100.0, 0.5, 5.0)[0]) == pytest.approx(5.0, abs=0.6)
    assert times(0.01, 1e6, 1e3, float("inf"))[0] == []
    unwatched = {"is_watched": False}
    for every, options, expected in (
        (5.0, {}, 5.0),
        (None, {}, None),
        (None, unwatched, UNWATCHED_PASS),
        (float("inf"), unwatched, LONGEST_PASS),
        (None, {**unwatched, "longest": 3.0 * LONGEST_PASS}, 3.0 * UNWATCHED_PASS),
    ):
        assert Renewal(every, **options).pass_seconds == expected


@pytest.fixture
def often(monkeypatch, tmp_path):
    """Renew after every pass, in a folder of its own."""
    for name, value in {"FIRST_SECONDS": 0.0, "SHARE_OF_RENDER": 0.0, "MOST_TIME": np.inf, "NEARLY_DONE": -1.0}.items():
        monkeypatch.setattr(renewal, name, value)
    monkeypatch.setattr(Renewal, "pass_seconds", None)
    monkeypatch.chdir(tmp_path)


def watched(monkeypatch: pytest.MonkeyPatch, look: Callable[[int], object]) -> None:
    """Call `look` with the number of each pass after the one before it was written."""
    passes = wrt.Renderer.passes

    def watch(self, **options):
        for number, each in enumerate(passes(self, **options)):
            look(number)
            yield each

    monkeypatch.setattr(wrt.Renderer, "passes", watch)


@pytest.mark.parametrize("name", ["a.png", pytest.param("a.exr", marks=pytest.mark.slow)])
def test_the_picture_can_be_read_while_it_renders_and_checkpoints_keep_their_own_interval(monkeypatch, often, name):
    means, listings = [], []
    layers = ("--layers", "albedo") if name == "a.exr" else ()

    def look(number):
        listings.append(os.listdir())
        if number:
            means.append(wrt.load_image(name).mean())

    watched(monkeypatch, look)
    assert run(*LONG, "-o", name, *layers, "--checkpoint", "a.ckpt", "--quiet") == 0
    assert len(set(means)) == len(means) >= 2
    assert listings[-1] == [name]  # a minute has not passed
    assert sorted(os.listdir()) == ["a.ckpt", name]


def test_never_writes_it_only_at_the_end_and_the_same(monkeypatch, often):
    assert run(*LONG, "-o", "a.exr") == 0
    listings = []
    watched(monkeypatch, lambda number: listings.append(os.listdir()))
    assert run(*LONG, "-o", "b.exr", "--save-every", "never") == 0
    assert listings
    assert all(names == ["a.exr"] for names in listings)
    np.testing.assert_array_equal(wrt.load_image("a.exr"), wrt.load_image("b.exr"))


@pytest.mark.parametrize(
    ("method", "error", "message"),
    [
        ("save", OSError(28, "No space left on device"), "No space left on device; rendering continues"),
        ("image", MemoryError(), "not enough memory for the picture; rendering continues"),
        ("image", RuntimeError("CUDA error"), "RuntimeError: CUDA error (test_renewal.py, line "),
    ],
)
def test_what_fails_in_a_renewal_is_one_warning(monkeypatch, often, capsys, method, error, message):
    original, calls = getattr(wrt.Renderer, method), []

    def failing(self, *arguments, **options):
        calls.append(1)
        if len(calls) <= 2:
            raise error
        return original(self, *arguments, **options)

    monkeypatch.setattr(wrt.Renderer, method, failing)
    assert run(*LONG, "-o", "a.png") == 0
    assert capsys.readouterr().err.count(message) == 1
    assert wrt.load_image("a.png").shape == (16, 16, 3)
    assert os.listdir() == ["a.png"]


def test_a_file_that_appears_is_never_replaced(monkeypatch, often, capsys):
    watched(monkeypatch, lambda number: number or Path("a.png").write_bytes(b"notes"))
    assert run(*LONG, "-o", "a.png") == 0
    assert Path("a.png").read_bytes() == b"notes"
    assert sorted(os.listdir()) == ["a-render.png", "a.png"]
    assert capsys.readouterr().err.count("a.png: already exists") == 1
