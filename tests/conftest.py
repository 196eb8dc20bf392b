"""Options, marks and fixtures shared by all tests, and the table of `--report`."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import warp as wp

ROOT = Path(__file__).resolve().parent.parent

Report = Callable[..., None]
"""report(claim, measured, expected=..., p=...): one row of the table that `--report` prints."""

EMULATED = "emulated-cuda"

# Long renders are stopped early, so no wide kernels are compiled for them. Some tests request one.
os.environ["WRT_WIDE"] = "0"
os.environ["WRT_BACKGROUND"] = "0"
# A checkout may have kernels compiled beforehand, or may not.
os.environ["WRT_PREBUILT"] = "0"

# Without bytecode each of the hundreds of processes that tests start compiles wrt anew (0.5 s), and pytest each test.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@atexit.register
def _end_quietly() -> None:
    """Close standard error: nanobind fills a screen with what OpenImageIO and Mitsuba keep when a process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


WARPS_FLAGS = wp.config.cpu_compiler_flags
# With less inlining than Warp asks for, kernels compile in two thirds of the time and are a fifth slower, with the same
# bits. Programs that tests start use Warp's flags.
wp.config.cpu_compiler_flags = "-march=native -mllvm=-slp-recursion-max-depth=4"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="run the tests marked slow, too")
    parser.addoption("--rest", action="store_true", help="run only what --all adds")
    parser.addoption("--machinery", action="store_true", help="run only the tests marked machinery")
    parser.addoption(
        "--device",
        choices=["cpu", "cuda", "auto", EMULATED],
        default="auto",
        help="where kernels run: cpu, cuda (cpu as well), auto: cuda too where there is one (default), "
        "or emulated-cuda: kernel tests alone, as compiled for CUDA, on the CPU",
    )
    parser.addoption("--report", action="store_true", help="print what the tests measured")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--report") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Table())
    if config.getoption("--device") == EMULATED:
        from support.emulated_cuda.plugin import EmulatedCuda

        config.pluginmanager.register(EmulatedCuda())


LONGEST = (
    *("test_against_mitsuba.py", "test_mitsuba_files.py", "test_reflection_models.py", "test_exact_pictures.py"),
    *("test_artefacts.py", "test_cuda_compile.py", "test_growth.py"),
)
"""Files that begin first, longest first: else one process is left with them at the end."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect tests without garbage collection, which takes a third of the time; nor are they searched later."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Iterator[None]:
    """Keep the tests that the options ask for, sorted by file."""
    chosen = [item for item in items if _is_chosen(config, item)]
    config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
    items[:] = chosen
    yield
    # After pytest has put those with the `device` fixture first, because that is made once for all of them.
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


def _is_chosen(config: pytest.Config, item: pytest.Item) -> bool:
    is_machinery = item.get_closest_marker("machinery") is not None
    if is_machinery or config.getoption("--machinery"):
        return is_machinery and config.getoption("--machinery")
    is_slow = item.get_closest_marker("slow") is not None
    if config.getoption("--rest"):
        return is_slow
    return not is_slow or config.getoption("--all")


def _devices(config: pytest.Config) -> list[str]:
    choice = config.getoption("--device")
    if choice == "cpu":
        return ["cpu"]
    if choice == EMULATED:
        return ["cuda:0"]
    wp.config.log_level = wp.LOG_ERROR
    if choice == "auto" and wp.get_cuda_device_count() == 0:
        return ["cpu"]
    return ["cpu", "cuda:0"]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", _devices(metafunc.config), scope="session")


MEASURED = "measured"
"""Name of the property of a test that holds a row of the table."""


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


@pytest.fixture
def report(request: pytest.FixtureRequest) -> Report:
    """Return a function that adds a row to the table of `--report`."""

    def add(claim: str, measured: object, expected: object = "", *, p: float | None = None) -> None:
        shown = [f"{x:.6g}" if isinstance(x, float) else str(x) for x in (measured, expected)]
        row = [f"{request.node.name}: {claim}", *shown, "" if p is None else f"{p:.3g}"]
        # A property of the test: these travel with its outcome when tests run in several processes.
        request.node.user_properties.append((MEASURED, row))

    return add


@pytest.fixture
def render_kernels_when_launched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have renderers compile no kernel before they launch it: many tests make renderers and trace nothing."""
    from wrt.rendering.render_kernel import RenderKernel

    monkeypatch.setattr(RenderKernel, "to_compile", lambda _: [])


@pytest.fixture(scope="session")
def assets() -> Path:
    """Return the folder of large test assets, which lies beside the repository on some machines."""
    folder = ROOT.parent / "shared" / "assets"
    if not folder.is_dir():
        pytest.skip(f"no test assets at {folder}")
    return folder
