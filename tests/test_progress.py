"""What the progress bar says is what the renderer reports, in words a person reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from wrt.progress import duration_text, fraction_done, noise_text, rate_text, status_text
from wrt.renderer import Progress


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
