"""Times and sizes as people write them, and errors that say how."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Any

import pytest

from wrt.cli.arguments.types import choice, duration, size, whole


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90.0),
        ("0.5", 0.5),
        (".5", 0.5),
        ("1e3", 1000.0),
        ("90s", 90.0),
        ("90 s", 90.0),
        ("2.5sec", 2.5),
        ("1m", 60.0),
        ("1M", 60.0),
        ("1.5min", 90.0),
        ("1m30s", 90.0),
        ("1m 30s", 90.0),
        ("1h", 3600.0),
        ("1h30m", 5400.0),
        ("1h30m5s", 5405.0),
        ("1h5s", 3605.0),
        ("2 hours", 7200.0),
        ("1:30", 90.0),
        ("0:05.5", 5.5),
        ("90:00", 5400.0),
        ("1:02:03", 3723.0),
    ],
)
def test_times(text: str, seconds: float) -> None:
    assert duration(text) == seconds


@pytest.mark.parametrize(
    "text",
    *[
        [
            "",
            " ",
            "s",
            "1x",
            "1d",
            "1h30",
            "1m1h",
            "1s1s",
            "1:2",
            "1:60",
            ":30",
            "1:",
            "1:2:03",
            "1:30s",
            "-1m",
            "--1",
            "1m-5s",
        ]
    ],
)
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(
        argparse.ArgumentTypeError, match=re.escape(f"must be a time such as 90, 90s, 1m30s or 1:30, not {text!r}")
    ):
        duration(text)


@pytest.mark.parametrize("text", ["0", "-1", "0s", "0m0s", "0:00", "nan", "inf", "1e999", "-0.0"])
def test_no_time_at_all_and_times_without_end(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"greater than 0|finite"):
        duration(text)


@pytest.mark.parametrize(
    ("text", "pixels"),
    [
        ("640x480", (640, 480)),
        ("640X480", (640, 480)),
        ("640×480", (640, 480)),
        ("640*480", (640, 480)),
        ("640,480", (640, 480)),
        ("640 x 480", (640, 480)),
        ("720p", (1280, 720)),
        ("1080P", (1920, 1080)),
        ("4K", (3840, 2160)),
    ],
)
def test_sizes(text: str, pixels: tuple[int, int]) -> None:
    assert size(text) == pixels


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("640", "must have a width and a height, such as 640x640, not '640'"),
        ("big", "must be WIDTHxHEIGHT, such as 640x480, or one of 720p, 1080p,"),
        ("2k", "must be WIDTHxHEIGHT"),
        ("640x480x3", "must be WIDTHxHEIGHT"),
        ("640x", "must be a whole number in digits, not ''"),
        ("6.5x4", "must be a whole number in digits, not '6.5'"),
        ("0x4", "must be at least 1, not 0"),
        ("-4x4", "must be at least 1, not -4"),
    ],
)
def test_what_is_no_size(text: str, said: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=re.escape(said)):
        size(text)


@pytest.mark.parametrize(
    ("convert", "text", "said"),
    [
        (whole(1), "1k", "must be a whole number in digits, not '1k'"),  # 1000, or 1024?
        (choice(("bash", "zsh")), "bsh", "must be one of bash, zsh, not 'bsh' (did you mean 'bash'?)"),
    ],
)
def test_other_mistakes(convert: Callable[[str], Any], text: str, said: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as caught:
        convert(text)
    assert str(caught.value) == said
