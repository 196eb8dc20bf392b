"""The progress bar of a render, warnings, and readable numbers."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any

from wrt.errors import Hint, one_line
from wrt.progress.terminal import bar_stream, fitted, fitted_bar, literal, terminal_columns

if TYPE_CHECKING:
    from wrt.rendering.passes import Progress

REDRAW_SECONDS = 0.1
"""Interval between updates of the bar: smooth to the eye, at negligible cost."""

GETTING_READY = "getting ready; kernels are compiled the first time"

FIRST_SECONDS = 2.0
"""Time before the first line; shorter renders print no line."""

MOST_SECONDS = 15.0
"""Longest interval between lines, which come after 2, 4, 8, 16, 31, 46 ... seconds if the status has changed."""


def once(show: Callable[[str], None]) -> Callable[[str], None]:
    """Return a function that shows each line once."""
    shown: set[str] = set()

    def show_new(line: str) -> None:
        if line not in shown:
            shown.add(line)
            show(line)

    return show_new


@contextlib.contextmanager
def short_warnings(show_line: Callable[[str], None], *, quiet: bool = False) -> Iterator[None]:
    """Within the context, show warnings meant for users, in one line each, and no others; if `quiet`, no hints."""

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if issubclass(category, UserWarning) and not (quiet and issubclass(category, Hint)):
            kind = "hint" if issubclass(category, Hint) else "warning"
            show_line(f"wrt: {kind}: {one_line(str(message))}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def rate_text(per_second: float) -> str:
    """Return a rate with about three digits and a metric prefix, such as "2.31 M"."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if per_second >= factor:
            return f"{per_second / factor:.2f} {prefix}"
    return f"{per_second:.0f}"


def noise_text(noise: float | None, target: float | None = None) -> str:
    """Return relative noise in percent, such as "noise 1.2 %" or "noise 2.3/1 %", or "" if it is not known yet."""
    if noise is None:
        return ""
    return f"noise {100.0 * noise:.2g} %" if target is None else f"noise {100.0 * noise:.2g}/{100.0 * target:.2g} %"


def duration_text(seconds: float) -> str:
    """Return a duration as m:ss or h:mm:ss."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


def fraction_done(progress: Progress, *, time_limit: float | None) -> float:
    """Return the finished fraction of a render, 0 to 1, by its nearer limit."""
    by_samples = progress.spp / progress.target_spp if progress.target_spp else 0.0
    by_time = progress.seconds / time_limit if time_limit else 0.0
    return min(max(by_samples, by_time), 1.0)


def status_pieces(progress: Progress, *, time_limit: float | None) -> list[tuple[int, str]]:
    """Return the parts of the status of a running render, each with its rank; rank 1 is the most important.

    Without a sample limit, the first part counts seconds.
    """
    if progress.target_spp is None and time_limit is not None:
        head = [(1, f"{progress.seconds:.0f}/{time_limit:.0f} s"), (4, f"{progress.spp} spp")]
    elif progress.target_spp is None:
        head = [(1, f"{progress.spp} spp")]
    else:
        head = [(1, f"{progress.spp}/{progress.target_spp} spp")]
    pieces = [
        *head,
        (7, f"pass {progress.pass_index}"),
        (6, f"{rate_text(progress.paths_per_second)} paths/s"),
        (5, noise_text(progress.noise, progress.target_noise)),
        (2, "" if progress.seconds_left is None else f"{duration_text(progress.seconds_left)} left"),
    ]
    return [piece for piece in pieces if piece[1]]


def status_text(progress: Progress, *, time_limit: float | None) -> str:
    """Return the status of a running render in one line."""
    return "  ".join(text for _, text in status_pieces(progress, time_limit=time_limit))


class ProgressBar:
    """Progress: a bar on a terminal or in a notebook, otherwise a line on standard error from time to time.

    Use it as a context manager: the bar is removed at the end.
    """

    def __init__(self, label: str, *, time_limit: float | None = None, is_shown: bool = True) -> None:
        """Show that work has begun.

        Args:
            label: name of the picture.
            time_limit: time limit of the render in seconds, if any.
            is_shown: whether to show anything.
        """
        self._label = one_line(label)
        self._time_limit = time_limit
        self._bar: Any = None
        self._lines: _ProgressLines | None = None
        self._drawn = 0.0
        self._messages: set[str] = set()
        if is_shown and (stream := bar_stream()) is not None:
            from tqdm import tqdm

            # The numbers are part of the format, since tqdm's own fields count items.
            waiting = literal(fitted(self._label, [(1, GETTING_READY)], columns := terminal_columns()))
            self._bar = tqdm(total=1.0, file=stream, leave=False, ncols=columns, bar_format=waiting)
        elif is_shown:
            self._lines = _ProgressLines(self._label)

    def __enter__(self) -> ProgressBar:
        if self._lines is not None:
            self._lines.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lines is not None:
            self._lines.stop()
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def relabel(self, label: str) -> None:
        """Show another name, such as the name of the next frame."""
        self._label = one_line(label)

    def update(self, progress: Progress) -> None:
        """Show the progress of the render."""
        done = fraction_done(progress, time_limit=self._time_limit)
        if self._lines is not None:
            self._lines.text = f"{100.0 * done:.0f} %  {status_text(progress, time_limit=self._time_limit)}"
        now = time.monotonic()
        if self._bar is None or now - self._drawn < REDRAW_SECONDS:
            return
        self._drawn = now
        columns = terminal_columns()
        pieces = status_pieces(progress, time_limit=self._time_limit)
        self._bar.bar_format = fitted_bar(self._label, f"{100.0 * done:3.0f}%", pieces, columns)
        self._bar.ncols = columns
        self._bar.n = done
        self._bar.refresh()

    def message(self, text: str) -> None:
        """Write a line to standard error, above the bar if there is one, unless it was written before."""
        if text in self._messages:
            return
        self._messages.add(text)
        if self._bar is None:
            print(text, file=sys.stderr, flush=True)
        else:
            self._bar.write(text, file=sys.stderr)


class _ProgressLines:
    """A thread that prints the status of a render from time to time, if it has changed.

    Attributes:
        text: the status to print next.
    """

    def __init__(self, label: str) -> None:
        """Prepare lines that begin with `label`, the name of the picture."""
        self.text = GETTING_READY
        self._label = label
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wrt-progress", daemon=True)

    def start(self) -> None:
        """Start the thread and its clock."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread; nothing is printed after this."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)  # it may be blocked on a pipe without a reader

    def _run(self) -> None:
        started, due, printed = time.monotonic(), FIRST_SECONDS, ""
        while not self._ended.wait(max(0.0, started + due - time.monotonic())):
            if self.text != printed:
                printed = self.text
                print(f"wrt: {self._label}: {printed}", file=sys.stderr, flush=True)
            due += min(due, MOST_SECONDS)
