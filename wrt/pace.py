"""How many samples a pass takes: few at first, for there is little to look at yet; then more, which are faster.

On a CPU many samples of a pixel at a time look for the same things in memory, and lie side by side in the kernel for
sixteen paths at once: passes of 16 samples and more are 1.1 times as fast as those of a few, and those of 50 among ten
million triangles 1.3 times.
"""

from __future__ import annotations

import math

SHORT_PASS = 0.4
"""Seconds that a pass should take at least: long enough to cost nothing, short enough to watch."""

SHARE = 0.25
"""Of the seconds that a render has taken, what the next pass may take: a tenth of the noise goes away in it."""

LONGEST_PASS = 10.0
"""Seconds that a pass should take at most: an interrupt is seen after a sixteenth of it."""

SAMPLES_TOGETHER = 16
"""Passes are of multiples of so many samples, where they are of more: some kernels take as many of a pixel at once."""


def samples_of_next_pass(
    done: int,
    target: int,
    seconds: float,
    seconds_left: float,
    seconds_of_sample: float,
    *,
    asked: float | None = None,
    short: bool = False,
) -> int:
    """Return how many samples of each pixel a pass should take that is not the first one.

    Args:
        done: samples so far.
        target: samples at last.
        seconds: of rendering so far.
        seconds_left: until rendering has to end, infinite where it has not.
        seconds_of_sample: that one sample of each pixel seems to take.
        asked: seconds that passes should take; None for somebody who watches.
        short: whether it should take no longer than short ones do.
    """
    wanted = max(SHORT_PASS, SHARE * seconds) if asked is None else asked
    wanted = min(wanted, SHORT_PASS if short else LONGEST_PASS)
    # Not more than half of what is left: how long a sample takes is not known so well.
    wanted = min(wanted, max(SHORT_PASS, 0.5 * seconds_left), seconds_left)
    # Who watches sees as many as there are at most: the first pictures come quickly one after the other.
    most = target - done if asked is not None else min(target - done, done)
    count = max(1, min(most, math.floor(wanted / max(seconds_of_sample, 1e-9))))
    return count - count % SAMPLES_TOGETHER if count > SAMPLES_TOGETHER else count
