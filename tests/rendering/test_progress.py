"""What the progress bar says is what the renderer reports, in words a person reads."""

import io
import os
import sys
import time

import pytest

import wrt
from wrt.progress import bar, terminal
from wrt.rendering.passes import Progress


def progress(**changes):
    values = {"pass_index": 3, "spp": 16, "target_spp": 64, "seconds": 5.0, "seconds_left": 15.0, "noise": 0.0123}
    return Progress(**{**values, "paths_per_second": 2.31e6, "rays_per_second": 9e6, **changes})


def test_progress_counts_the_limit_that_is_nearer():
    for changes, limit, expected in (({}, None, 0.25), ({}, 10.0, 0.5), ({"target_spp": None}, 20.0, 0.25)):
        assert bar.fraction_done(progress(**changes), time_limit=limit) == expected
    by_time = progress(target_spp=None, noise=None, seconds_left=None)
    assert bar.status_text(by_time, time_limit=20.0) == "5/20 s  16 spp  pass 3  2.31 M paths/s"
    assert [bar.rate_text(rate) for rate in (12.4, 12_400.0, 3.2e9)] == ["12", "12.40 k", "3.20 G"]
    assert [bar.noise_text(noise) for noise in (None, 0.5)] == ["", "noise 50 %"]
    assert [bar.duration_text(seconds) for seconds in (59.6, 3725.0)] == ["1:00", "1:02:05"]


def test_what_matters_least_is_left_out_first():
    for columns, line in (
        (119, "room  25%|{bar}| 16/64 spp  pass 3  2.31 M paths/s  noise 1.2 %  0:15 left"),
        (59, "room  25%|{bar}| 16/64 spp  noise 1.2 %  0:15 left"),
        (39, "room   25%  16/64 spp  0:15 left"),
        (12, "room   25%"),
        (5, " 25%"),
    ):
        assert terminal.fitted_bar("room", " 25%", bar.status_pieces(progress(), time_limit=None), columns) == line


class Terminal(io.StringIO):
    """An ASCII-only terminal that keeps what is written to it."""

    encoding = "ascii"

    def isatty(self):
        return True

    def fileno(self):
        return 2


def screen_of(monkeypatch):
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((100, 24)))
    return screen


@pytest.mark.parametrize("label", ["絵.obj", "a-very-long-name-of-a-mesh-" * 4, "{scene} 100% {bar}"])
def test_the_bar_follows_a_terminal_that_changes_its_size(label, monkeypatch):
    screen = screen_of(monkeypatch)
    monkeypatch.setattr("wrt.progress.bar.REDRAW_SECONDS", 0.0)
    columns = 100
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((columns, 24)))
    with bar.ProgressBar(label) as shown:
        for columns in (100, 40, 80, 20, 3):
            screen.truncate(0)
            shown.update(progress())
            line = screen.getvalue().rpartition("\r")[2].rstrip()
            assert 0 < len(line) < columns
            assert columns < 40 or label != "絵.obj" or r"\u7d75" in line, "escapes take more than one column"


def test_render_shows_a_bar_to_whoever_watches(monkeypatch):
    screen = screen_of(monkeypatch)
    for choice, is_shown in ((None, True), (True, True), (False, False)):
        screen.truncate(0)
        wrt.render("cornell-box", width=8, height=8, spp=4, progress=choice)
        assert ("cornell-box" in screen.getvalue()) is is_shown
    monkeypatch.setattr(sys, "stderr", written := io.StringIO())  # a file
    wrt.render("cornell-box", width=8, height=8, spp=4)
    assert written.getvalue() == ""
    # A notebook shows it on standard output.
    stream = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})
    monkeypatch.setattr(sys, "stdout", notebook := stream())
    monkeypatch.setattr(sys, "stderr", errors := stream())
    wrt.render("cornell-box", width=8, height=8, spp=4)
    assert "cornell-box" in notebook.getvalue()
    assert errors.getvalue() == ""


@pytest.mark.parametrize("is_shown", [True, False])
def test_off_a_terminal_there_are_lines_ever_more_seldom(is_shown, monkeypatch):
    monkeypatch.setattr(sys, "stderr", written := io.StringIO())
    monkeypatch.setattr(bar, "FIRST_SECONDS", 0.05)
    monkeypatch.setattr(bar, "MOST_SECONDS", 0.1)
    with bar.ProgressBar("room", is_shown=is_shown) as shown:
        time.sleep(0.2)
        ready = written.getvalue()
        shown.update(progress())
        time.sleep(0.5)
    found = written.getvalue()
    if not is_shown:
        assert found == ""
        return
    waiting = "wrt: room: getting ready; kernels are compiled the first time\n"
    assert ready == waiting, "nothing new is said again"
    assert found == waiting + "wrt: room: 25 %  16/64 spp  pass 3  2.31 M paths/s  noise 1.2 %  0:15 left\n"
    with bar.ProgressBar("room") as shown:
        for spp in range(20):
            shown.update(progress(spp=spp))
            time.sleep(0.025)
    changing = written.getvalue().removeprefix(found).splitlines()
    assert len(set(changing)) == len(changing)
    assert 2 <= len(changing) <= 8, "lines came too often or too seldom"
    found = written.getvalue()
    time.sleep(0.15)
    assert written.getvalue() == found, "lines came after the end"
