"""Passes: how many samples each takes, and the progress reported after it.

The first passes take few samples, so that there is soon something to see; later ones take more, which is faster. On a
CPU the samples of one pixel visit the same memory, and the wide kernel traces sixteen of them side by side: passes of
16 samples and more are 1.1 times as fast as those of a few, and with ten million triangles passes of 50 are 1.3 times
as fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, NamedTuple

from wrt.errors import InputError
from wrt.rendering.noise import MOST as MOST_FOR_NOISE
from wrt.rendering.noise import NoiseEstimate
from wrt.scene.description import Description, Flag, optional
from wrt.scene.scene import MAX_SPP
from wrt.values import integer, number

if TYPE_CHECKING:
    from wrt.rendering.film import Film
    from wrt.rendering.renderer import Renderer

SHORT_PASS = 0.4
"""Least seconds of a pass: long enough for its overhead not to matter, short enough to watch."""

BRIEF_PASS = 0.05
"""Seconds of a pass that is too short to notice. A GPU takes hundreds of samples in that time, which by doubling alone
would be ten passes, each with a launch, a wait and a count of its own."""

SHARE = 0.25
"""Seconds of the next pass as a share of those rendered so far; it removes about a tenth of the noise."""

LONGEST_PASS = 10.0
"""Most seconds of a pass on one machine; an interrupt takes effect after a sixteenth of it."""

FASTEST = 3.0e6
"""Camera paths a second of a thread, which few scenes reach."""

SAMPLES_TOGETHER = 16
"""Longer passes take a multiple of this many samples: the wide kernel traces as many of one pixel at once."""


@dataclass(frozen=True)
class Progress:
    """The state of a render after a pass.

    Attributes:
        pass_index: passes since `Renderer.passes` was called, from 1.
        spp: samples per pixel so far.
        target_spp: samples per pixel of the finished picture, or None while unknown.
        seconds: rendering time since `Renderer.passes` was called.
        seconds_left: estimate of the time still needed.
        paths_per_second: camera paths a second since `Renderer.passes` was called.
        rays_per_second: rays of every kind a second, likewise.
        noise: see `Renderer.noise`; None while it is not known.
        target_noise: the noise at which rendering ends, if given; `target_spp` is an estimate then.
    """

    pass_index: int
    spp: int
    target_spp: int | None
    seconds: float
    seconds_left: float | None
    paths_per_second: float
    rays_per_second: float
    noise: float | None
    target_noise: float | None = None


class _Goal(NamedTuple):
    """The samples per pixel at which rendering ends, or the most there can be; and those at which a pass must end."""

    spp: int
    next_stop: int
    is_known: bool


@dataclass(frozen=True)
class Limits(Description):
    """What ends a render, and how long its passes are; see `Renderer.passes`."""

    spp: Annotated[int | None, optional(partial(integer, minimum=1, maximum=MAX_SPP))]
    time: Annotated[float | None, optional(partial(number, above=0.0))]
    noise: Annotated[float | None, optional(partial(number, above=0.0, maximum=1.0))]
    adaptive: Flag
    pass_seconds: Annotated[float | None, optional(partial(number, above=0.0))]

    @classmethod
    def of(
        cls,
        renderer: Renderer,
        spp: int | None,
        time: float | None,
        noise: float | None,
        adaptive: bool | None,
        pass_seconds: float | None,
    ) -> Limits:
        """Return the limits that these arguments of `Renderer.passes` and the scene's settings give.

        Raises:
            InputError: on impossible values.
        """
        settings = renderer.settings
        if spp is None and time is None and noise is None:
            noise = None if settings.wireframe else settings.noise
            spp = settings.spp if noise is None else None
        limits = cls(spp, time, noise, settings.adaptive if adaptive is None else adaptive, pass_seconds)
        if noise is not None and not renderer.renders_light:
            what = "a wireframe has" if settings.wireframe else "integrator aov renders only layers, which have"
            raise InputError(f"{what} no target of noise")
        if noise is None and limits.adaptive:
            raise InputError("adaptive sampling needs a target of noise, such as 0.01")
        return limits

    def least_seconds(self, film: Film) -> float:
        """Return seconds that rendering will take at least, before anything is known about the scene."""
        if self.noise is not None:
            return 0.0
        samples = math.inf if self.spp is None else self.spp - film.tally().least
        seconds = samples * film.pixels / (FASTEST * film.device.threads)
        return seconds if self.time is None else min(seconds, self.time)

    def goal(self, estimate: NoiseEstimate, done: int, is_even: bool) -> _Goal:
        """Return the goal after `done` samples per pixel, which all pixels that go on have if `is_even`."""
        most = MAX_SPP if self.spp is None else self.spp
        if self.noise is None:
            return _Goal(most, most, self.spp is not None)
        most = min(most, MOST_FOR_NOISE)
        if is_even:
            estimate.observe(done)
        estimated = estimate.samples_for(self.noise)
        spp = most if estimated is None else min(most, estimated)
        stop = min(spp, estimate.next_stop(done, self.noise))
        return _Goal(spp, stop, self.spp is not None or estimated is not None)


def samples_of_next_pass(
    done: int,
    target: int,
    seconds: float,
    seconds_left: float,
    seconds_of_sample: float,
    *,
    pass_seconds: float | None = None,
    longest: float = LONGEST_PASS,
    short: bool = False,
) -> int:
    """Return how many samples per pixel the next pass should take.

    Args:
        done: samples per pixel so far.
        target: samples per pixel of the finished picture.
        seconds: rendering time so far.
        seconds_left: time until rendering must end; infinite without a limit.
        seconds_of_sample: estimated time of one sample of every pixel.
        pass_seconds: seconds that a pass should take; None if a person watches the picture.
        longest: most seconds of a pass.
        short: whether the pass should be as short as SHORT_PASS.
    """
    is_watched = pass_seconds is None
    duration = max(SHORT_PASS, SHARE * seconds) if pass_seconds is None else pass_seconds
    duration = min(duration, SHORT_PASS if short else longest)
    # At most half of the remaining time, since the time of a sample is only estimated.
    duration = min(duration, max(SHORT_PASS, 0.5 * seconds_left), seconds_left)
    in_time = math.floor(duration / max(seconds_of_sample, 1e-9))
    most = target - done
    if is_watched:  # at most double the samples, so that the first pictures follow each other quickly
        brief = math.floor(BRIEF_PASS / max(seconds_of_sample, 1e-9)) if short else 0
        most = min(most, max(done, brief))
    count = max(1, min(most, in_time))
    return count - count % SAMPLES_TOGETHER if count > SAMPLES_TOGETHER else count


class Schedule:
    """How many samples each pass takes, until the first of the limits is reached.

    Attributes:
        seconds_left: estimate of the seconds still needed; 0 before the first pass.
    """

    def __init__(self, limits: Limits, film: Film, estimate: NoiseEstimate, *, first: int, longest: float) -> None:
        """Take the film that passes fill, the samples per pixel of the first pass, and the most seconds of a pass."""
        self.seconds_left = 0.0
        self._limits, self._film, self._estimate = limits, film, estimate
        self._first, self._longest = first, longest
        estimate.begin(limits.noise if limits.adaptive and limits.noise is not None else 0.0)
        self._done, is_even = estimate.samples_of_tiles_that_go_on()
        self._goal = limits.goal(estimate, self._done, is_even)
        self._rays_before = film.rays
        self._seconds = self._per_sample = 0.0
        self._paths = self._passes = 0

    @property
    def _time_left(self) -> float:
        return math.inf if self._limits.time is None else self._limits.time - self._seconds

    def next_target(self, *, short: bool) -> int | None:
        """Return the samples per pixel after the next pass, or None; a `short` one takes SHORT_PASS at most."""
        done, goal = self._done, self._goal
        if done >= goal.spp or self._time_left <= 0.0:
            return None
        count = min(self._first, goal.next_stop - done)
        if self._passes > 0:
            self.seconds_left = min((goal.spp - done) * self._per_sample, self._time_left)
            count = samples_of_next_pass(
                done,
                goal.next_stop,
                self._seconds,
                self._time_left,
                self._per_sample,
                pass_seconds=self._limits.pass_seconds,
                longest=self._longest,
                short=short,
            )
        self._done += count
        return self._done

    def progress(self, seconds: float, paths: int) -> Progress:
        """Return the state after a pass that took these seconds and camera paths, and set the next goal."""
        limits, film, estimate, done = self._limits, self._film, self._estimate, self._done
        self._passes += 1
        self._seconds += seconds
        self._paths += paths
        self._goal = goal = limits.goal(estimate, done, estimate.samples_of_tiles_that_go_on()[1])
        self._per_sample = seconds * film.pixels * estimate.share_going_on / max(paths, 1)
        to_goal = math.inf
        if goal.is_known:
            to_goal = max(goal.spp - done, 0) * self._seconds * film.pixels / max(self._paths, 1)
        expected = min(to_goal, max(self._time_left, 0.0))
        return Progress(
            pass_index=self._passes,
            spp=done,
            target_spp=goal.spp if goal.is_known else None,
            seconds=self._seconds,
            seconds_left=None if math.isinf(expected) else expected,
            paths_per_second=self._paths / max(self._seconds, 1e-9),
            rays_per_second=(film.rays - self._rays_before) / max(self._seconds, 1e-9),
            noise=film.noise() if limits.noise is None else estimate.noise(done),
            target_noise=limits.noise,
        )
