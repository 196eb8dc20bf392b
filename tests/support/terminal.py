"""What a run prints: its progress in per cent, and the table of `--report`."""

from __future__ import annotations

import sys
import time

import pytest

MEASURED = "measured"
"""Name of the property of a test that holds a row of the table."""


class Progress:
    """Prints the share of tests that are done, instead of a dot for each."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._total = self._done = self._failed = self._shown = 0
        self._start = time.monotonic()
        self._redraws = sys.stdout.isatty()

    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, str] | None:
        """Print nothing for a test that passed or was skipped."""
        if report.passed and report.when != "call":
            return "", "", ""
        if report.passed or report.skipped:
            return report.outcome, "", ""
        return None

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Count the tests of a run in one process."""
        self._total = self._total or len(session.items)

    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        """Count the tests of a run in several processes."""
        self._total = len(ids)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Print the share: on one line in a terminal, else on a line each 5 per cent."""
        self._failed += report.failed
        if report.when != "teardown" or not self._total:
            return
        self._done += 1
        percent = 100 * self._done // self._total
        if percent >= self._shown + (1 if self._redraws else 5) or self._done == self._total:
            self._shown = percent
            minutes, seconds = divmod(int(time.monotonic() - self._start), 60)
            failed = f", {self._failed} failed" if self._failed else ""
            line = f"{percent:3d} % of {self._total} tests, {minutes}:{seconds:02d}{failed}"
            print(f"\r{line}" if self._redraws else line, end="" if self._redraws else "\n", flush=True)


class Table:
    """Prints the rows that tests reported."""

    def __init__(self) -> None:
        self._rows: list[list[str]] = [["claim", "measured", "expected", "p"]]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the rows of a test."""
        if report.when == "call":
            self._rows += [row for name, row in report.user_properties if name == MEASURED]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print all rows."""
        widths = [max(len(row[i]) for row in self._rows) for i in range(4)]
        terminalreporter.section("measured")
        for row in self._rows:
            cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
            terminalreporter.write_line("  ".join(cells))
