"""When the picture and the checkpoint are written during a render."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wrt.rendering.passes import Progress

CHECKPOINT_SECONDS = 60.0
"""Default interval between checkpoints."""

FIRST_SECONDS = 2.0
"""Shortest interval between renewals of the picture, and before the first: shorter renders write it once."""

UNWATCHED_PASS = 5.0
"""Seconds of a pass on one machine without a progress bar. The wide kernel is slower in short passes: on a busy machine
a one-sided Cornell box took 0.083 s of CPU for a sample in passes of one, 0.068 in passes of four, 0.063 in passes of
ten, and 0.054 in one of 64."""

SHARE_OF_RENDER = 0.1
"""Shortest interval as a share of the time since the start: a picture changes ever more slowly."""

MOST_SECONDS = 60.0
"""Longest interval, unless writing is slow."""

MOST_TIME = 0.02
"""Largest share of the time that renewals take. They are timed, so large pictures and slow disks are renewed less
often."""

NEARLY_DONE = 1.0
"""A picture that will be finished in fewer seconds is not renewed before."""


@dataclass
class Renewal:
    """Decides after each pass what to write.

    By default the picture is renewed at growing intervals, and the checkpoint every minute. An interval given by
    `--save-every` applies to both, as it is.

    Attributes:
        save_every: seconds between saves, infinite for none before the end, or None for the default.
        is_watched: whether there is a progress bar.
        longest: most seconds of a pass, `wrt.Renderer.longest_pass`; by default for one machine.
        clock: returns seconds.
    """

    save_every: float | None
    is_watched: bool = True
    longest: float | None = None
    clock: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        """Start the clock."""
        self._started = self._picture_at = self._checkpoint_at = self.clock()
        self._cost = 0.0

    @property
    def pass_seconds(self) -> float | None:
        """Seconds of a pass, or None for short passes at first, which a progress bar needs."""
        from wrt.rendering.passes import LONGEST_PASS

        save_every, longest = self.save_every, self.longest or LONGEST_PASS
        if save_every is not None and save_every < longest:
            return save_every
        if self.is_watched:
            return None
        return UNWATCHED_PASS * longest / LONGEST_PASS if save_every is None else longest

    def due(self, progress: Progress) -> tuple[bool, bool]:
        """Return whether to write the picture and whether to write the checkpoint."""
        now = self.clock()
        if self.save_every is not None:
            return (now - self._picture_at >= self.save_every,) * 2
        checkpoint = now - self._checkpoint_at >= CHECKPOINT_SECONDS
        seconds_left = math.inf if progress.seconds_left is None else progress.seconds_left
        interval = min(max(FIRST_SECONDS, SHARE_OF_RENDER * (now - self._started)), MOST_SECONDS)
        interval = max(interval, self._cost / MOST_TIME)
        return now - self._picture_at >= interval and seconds_left >= NEARLY_DONE, checkpoint

    def run(self, write: Callable[[], object], *, picture: bool, checkpoint: bool) -> None:
        """Call `write`, which writes picture or checkpoint or both, and measure its duration."""
        begun = self.clock()
        try:
            write()
        finally:
            now = self.clock()
            if picture:
                self._picture_at = now
                # A fast renewal after a slow one lowers the estimate by half at most.
                self._cost = max(now - begun, 0.5 * self._cost)
            if checkpoint:
                self._checkpoint_at = now
