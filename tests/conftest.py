"""Options, fixtures and the report shared by all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

Report = Callable[..., None]
"""report(claim, measured, expected=..., p=...): one row of the table at the end of the run."""

_MEASURED = "measured"

# Renders that would take long are stopped soon: no kernels are compiled for them meanwhile. Some tests ask for one.
os.environ["WRT_WIDE"] = "0"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--device",
        choices=["cpu", "cuda", "auto"],
        default="auto",
        help="where kernels run: cpu, cuda (cpu as well), or auto: cuda too where there is one (default)",
    )


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Table())


LONGEST = (
    "test_wide.py",
    "test_cuda_compile.py",
    "test_gallery.py",
    "test_render_kernel.py",
    "test_against_mitsuba.py",
)
"""Files that take minutes, which begin first: else one process is left with them at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONGEST)


def _devices(config: pytest.Config) -> list[str]:
    choice = config.getoption("--device")
    if choice == "cpu":
        return ["cpu"]
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    if choice == "auto" and wp.get_cuda_device_count() == 0:
        return ["cpu"]
    return ["cpu", "cuda:0"]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", _devices(metafunc.config), scope="session")


@pytest.fixture
def report(request: pytest.FixtureRequest) -> Report:
    """Return a function that adds a row to the table at the end of the run."""

    def add(claim: str, measured: object, expected: object = "", *, p: float | None = None) -> None:
        shown = [f"{x:.6g}" if isinstance(x, float) else str(x) for x in (measured, expected)]
        row = [f"{request.node.name}: {claim}", *shown, "" if p is None else f"{p:.3g}"]
        # A property of the test, since these travel with its outcome when tests run in several processes.
        request.node.user_properties.append((_MEASURED, row))

    return add


class Table:
    """The rows that tests reported, printed at the end of the run."""

    def __init__(self) -> None:
        self.rows: list[list[str]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            self.rows += [row for name, row in report.user_properties if name == _MEASURED]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if not self.rows:
            return
        table = [["claim", "measured", "expected", "p"], *self.rows]
        widths = [max(len(row[i]) for row in table) for i in range(4)]
        terminalreporter.section("measured")
        for row in table:
            terminalreporter.write_line("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)))


@pytest.fixture(scope="session")
def assets() -> Path:
    """Return the folder of large test assets, which lies beside the repository on some machines."""
    folder = ROOT.parent / "shared" / "assets"
    if not folder.is_dir():
        pytest.skip(f"no test assets at {folder}")
    return folder
