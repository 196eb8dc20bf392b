"""What the progress bar says is what the renderer reports, in words a person reads."""

from __future__ import annotations

import io
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

import wrt
from wrt.progress import lines as progress_lines
from wrt.progress.bar import (
    ProgressBar,
    duration_text,
    fraction_done,
    noise_text,
    rate_text,
    status_pieces,
    status_text,
)
from wrt.progress.terminal import columns_of, fitted, fitted_bar, shortened, terminal_columns
from wrt.rendering.passes import Progress


def progress(**changes: Any) -> Progress:
    values: dict[str, Any] = {
        "pass_index": 3,
        "spp": 16,
        "target_spp": 64,
        "seconds": 5.0,
        "seconds_left": 15.0,
        "paths_per_second": 2.31e6,
        "rays_per_second": 9e6,
        "noise": 0.0123,
    }
    return Progress(**{**values, **changes})


def test_progress_counts_the_limit_that_is_nearer() -> None:
    assert fraction_done(progress(), time_limit=None) == 0.25
    assert fraction_done(progress(), time_limit=10.0) == 0.5
    assert fraction_done(progress(target_spp=None), time_limit=20.0) == 0.25
    assert fraction_done(progress(seconds=11.0), time_limit=10.0) == 1.0


def test_progress_text_counts_samples_or_else_seconds() -> None:
    assert status_text(progress(), time_limit=None) == "16/64 spp  pass 3  2.31 M paths/s  noise 1.2 %  0:15 left"
    by_time = progress(target_spp=None, noise=None, seconds_left=None)
    assert status_text(by_time, time_limit=20.0) == "5/20 s  16 spp  pass 3  2.31 M paths/s"


@pytest.mark.parametrize(
    ("function", "value", "text"),
    [
        (rate_text, 12.4, "12"),
        (rate_text, 12_400.0, "12.40 k"),
        (rate_text, 3.2e9, "3.20 G"),
        (noise_text, None, ""),
        (noise_text, 0.5, "noise 50 %"),
        (duration_text, 59.6, "1:00"),
        (duration_text, 3725.0, "1:02:05"),
    ],
)
def test_numbers_are_readable(function: Callable[[Any], str], value: object, text: str) -> None:
    assert function(value) == text


LABELS = ["cornell-box", "a-very-long-name-of-a-mesh-" * 4, "絵" * 40, "{scene} 100% {bar}", "e\u0301" * 90, ""]


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("columns", [1, 2, 5, 9, 12, 20, 39, 60, 79, 119, 300])
def test_the_line_fits_the_terminal_whatever_is_rendered(label: str, columns: int) -> None:
    from tqdm import tqdm

    pieces = status_pieces(progress(spp=123456, target_spp=1000000, seconds_left=360000.0), time_limit=None)
    text = fitted_bar(label, " 42%", pieces, columns)
    # As tqdm draws it.
    line = tqdm.format_meter(n=0.42, total=1.0, elapsed=1.0, ncols=columns, bar_format=text)
    assert columns_of(line) <= columns
    assert columns_of(fitted(label, [(1, progress_lines.GETTING_READY)], columns)) <= columns
    assert columns_of(shortened(label, columns)) <= columns


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        (119, "room  25%|{bar}| 16/64 spp  pass 3  2.31 M paths/s  noise 1.2 %  0:15 left"),
        (79, "room  25%|{bar}| 16/64 spp  2.31 M paths/s  noise 1.2 %  0:15 left"),
        (59, "room  25%|{bar}| 16/64 spp  noise 1.2 %  0:15 left"),
        (47, "room  25%|{bar}| 16/64 spp  0:15 left"),
        (39, "room   25%  16/64 spp  0:15 left"),
        (24, "room   25%  16/64 spp"),
        (12, "room   25%"),
        (5, " 25%"),
    ],
)
def test_what_matters_least_is_left_out_first(columns: int, line: str) -> None:
    assert fitted_bar("room", " 25%", status_pieces(progress(), time_limit=None), columns) == line


def test_long_names_lose_their_middle() -> None:
    assert shortened("living-room-at-night", 12) == "livin...ight"
    assert shortened("絵絵絵絵絵絵絵絵", 10) == "絵絵...絵"
    assert shortened("room", 4) == "room"


class Terminal(io.StringIO):
    """An ASCII-only terminal that keeps what is written to it."""

    encoding = "ascii"  # type: ignore[assignment]

    def isatty(self) -> bool:
        """Return True, as a terminal does."""
        return True

    def fileno(self) -> int:
        """Return a file descriptor; `os.get_terminal_size` is patched and ignores it."""
        return 2


@pytest.mark.parametrize("unknown", [0, None])
def test_a_terminal_of_unknown_size(unknown: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def size(_: int) -> os.terminal_size:
        if unknown is None:
            raise OSError
        return os.terminal_size((unknown, unknown))

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(os, "get_terminal_size", size)
    monkeypatch.delenv("COLUMNS", raising=False)
    assert terminal_columns() == 79
    monkeypatch.setenv("COLUMNS", "40")
    assert terminal_columns() == 39
    monkeypatch.setenv("COLUMNS", "many")
    assert terminal_columns() == 79


def test_the_bar_follows_a_terminal_that_changes_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = 100
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((columns, 24)))
    monkeypatch.setattr("wrt.progress.bar.REDRAW_SECONDS", 0.0)
    with ProgressBar("絵.obj") as bar:
        for columns in (100, 40, 80, 20, 3):
            terminal.truncate(0)
            bar.update(progress())
            line = terminal.getvalue().rpartition("\r")[2].rstrip()
            assert 0 < len(line) < columns
            assert columns < 40 or r"\u7d75" in line, "escapes take more than one column"


@pytest.mark.parametrize(("asked", "shown"), [(None, True), (True, True), (False, False)])
def test_render_shows_a_bar_to_whoever_watches(
    asked: bool | None, shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((100, 24)))
    wrt.render("cornell-box", width=8, height=8, spp=4, progress=asked)
    assert ("cornell-box" in terminal.getvalue()) is shown


def test_render_says_nothing_in_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", written := File())
    wrt.render("cornell-box", width=8, height=8, spp=4)
    assert written.getvalue() == ""


class File(io.StringIO):
    """A file, which is no terminal."""


@pytest.mark.parametrize("wanted", [True, False])
def test_off_a_terminal_there_are_lines_ever_more_seldom(wanted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", written := File())
    monkeypatch.setattr(progress_lines, "FIRST_SECONDS", 0.05)
    monkeypatch.setattr(progress_lines, "MOST_SECONDS", 0.1)
    with ProgressBar("room", wanted=wanted) as bar:
        time.sleep(0.2)
        ready = written.getvalue()
        bar.update(progress())
        time.sleep(0.5)
    after = written.getvalue()
    if not wanted:
        assert after == ""
        return
    waiting = "wrt: room: getting ready; kernels are compiled the first time\n"
    rendering = "wrt: room: 25 %  16/64 spp  pass 3  2.31 M paths/s  noise 1.2 %  0:15 left\n"
    assert ready == waiting, "nothing new is said again"
    assert after == ready + rendering
    bar = ProgressBar("room")
    with bar:
        for spp in range(20):
            bar.update(progress(spp=spp))
            time.sleep(0.025)
    changing = written.getvalue().removeprefix(after).splitlines()
    assert len(set(changing)) == len(changing)
    assert 2 <= len(changing) <= 8, "lines came too often or too seldom"
    after = written.getvalue()
    time.sleep(0.15)
    assert written.getvalue() == after, "lines came after the end"


def test_a_notebook_shows_the_bar_on_standard_output(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})
    monkeypatch.setattr(sys, "stdout", shown := stream())
    monkeypatch.setattr(sys, "stderr", errors := stream())
    wrt.render("cornell-box", width=8, height=8, spp=4)
    assert "cornell-box" in shown.getvalue()
    assert errors.getvalue() == ""
