"""Options, fixtures and the report shared by all tests."""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import warp as wp

ROOT = Path(__file__).resolve().parent.parent

Report = Callable[..., None]
"""report(claim, measured, expected=..., p=...): one row of the table at the end of the run."""

EMULATED = "emulated-cuda"

_MEASURED = "measured"

# Long renders are stopped early, so no wide kernels are compiled for them. Some tests request one.
os.environ["WRT_WIDE"] = "0"
os.environ["WRT_BACKGROUND"] = "0"

# Without bytecode each of the hundreds of processes that tests start compiles wrt anew (0.5 s), and pytest each test.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

WARPS_FLAGS = wp.config.cpu_compiler_flags
# With less inlining than Warp asks for, kernels compile in two thirds of the time and are a fifth slower, with the same
# bits. Programs that tests start use Warp's flags.
wp.config.cpu_compiler_flags = "-march=native -mllvm=-slp-recursion-max-depth=4"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--device",
        choices=["cpu", "cuda", "auto", EMULATED],
        default="auto",
        help="where kernels run: cpu, cuda (cpu as well), auto: cuda too where there is one (default), "
        "or emulated-cuda: kernel tests alone, as compiled for CUDA, on the CPU",
    )

    parser.addoption("--record", type=Path, help="write outcomes and measured rows to this file, for scripts/proofs.py")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Table(config.getoption("--record")))
    if config.getoption("--device") == EMULATED:
        from support.emulated_cuda.plugin import EmulatedCuda

        config.pluginmanager.register(EmulatedCuda())


LONGEST = (
    "test_emulated_cuda.py",
    # It compiles nothing for the CPU, while another process compiles what all the others need.
    "test_cuda_compile.py",
    "test_wide.py",
    "test_mitsuba_files.py",
    "test_kernel_cache.py",
    "test_against_mitsuba.py",
    "test_digests.py",
    "test_extreme_materials.py",
)
"""Files that take minutes, which begin first: else one process is left with them at the end."""


ONE_OF_A_FILE = {
    "test_absorption.py": None,
    "test_biased_settings.py": None,
    "test_composite_materials.py": "test_each_part_answers_in_its_share",
    "test_dispersion.py": "test_a_prism_makes_three_spots",
    "test_emission.py": "test_mean_emission_of_triangles",
    "test_furnace.py": "test_radiance_of_a_furnace",
    "test_grid_media.py": "test_light_through_a_ramp",
    "test_integrators.py": "test_nothing_hides_the_sky_from_a_plane",
    "test_irradiance.py": "test_point_light",
    "test_layers.py": "test_layers_of_panes_are_what_geometry_says",
    "test_lenses.py": "test_openings_are_uniform_over_their_area",
    "test_mipmaps.py": "test_two_levels_are_mixed_by_the_narrower_axis",
    "test_motion_blur.py": "test_a_streak",
    "test_nested_bodies.py": "test_nested_bodies_in_a_furnace_cannot_be_seen",
    "test_normal_maps.py": "test_a_flat_map_changes_nothing",
    "test_opacity.py": "test_panes_before_a_constant_sky",
    "test_own_bsdf.py": "test_a_copy_of_lambert_is_lambert",
    "test_own_camera.py": "test_it_sees_by_its_formula_and_projects_back",
    "test_own_light.py": "test_estimators_agree_with_the_closed_form",
    "test_quadric_pictures.py": None,
    "test_scattering.py": "test_white_in_a_furnace",
    "test_simulation.py": "test_normals_follow_with_the_creases_that_there_were",
    "test_skies.py": None,
    "test_unit_of_length.py": None,
    "test_whitted.py": "test_two_mirrors_are_a_geometric_series_cut_by_depth",
}
"""Files whose tests compile render kernels that no other file needs, and the test of each that a quick run takes."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect tests without looking for garbage, a third of the time; nor is it later looked for among them."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Iterator[None]:
    """Mark some tests as slow before tests are chosen by their marks; then sort tests."""
    _mark_slow(items)
    yield
    # After pytest has put those with the `device` fixture first, because that is made once for all of them.
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


def _mark_slow(items: list[pytest.Item]) -> None:
    """Mark as slow the tests that launch kernels, except for the first parameter set of each."""
    seen: set[tuple[str, str, object]] = set()
    for item in items:
        if not isinstance(item, pytest.Function) or "device" not in item.fixturenames:
            continue
        name = item.originalname
        test = item.path.name, name, item.callspec.params["device"]
        if test in seen or ONE_OF_A_FILE.get(item.path.name, name) != name:
            item.add_marker(pytest.mark.slow)
        elif item.get_closest_marker("slow") is None:
            seen.add(test)


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


@pytest.fixture
def report(request: pytest.FixtureRequest) -> Report:
    """Return a function that adds a row to the table at the end of the run."""

    def add(claim: str, measured: object, expected: object = "", *, p: float | None = None) -> None:
        shown = [f"{x:.6g}" if isinstance(x, float) else str(x) for x in (measured, expected)]
        row = [f"{request.node.name}: {claim}", *shown, "" if p is None else f"{p:.3g}"]
        # A property of the test: these travel with its outcome when tests run in several processes.
        request.node.user_properties.append((_MEASURED, row))

    return add


class Table:
    """The rows that tests reported, printed at the end of the run and written to `record`, if that is a file."""

    def __init__(self, record: Path | None) -> None:
        self.rows: list[list[str]] = []
        self._record = record
        self._tests: dict[str, dict[str, object]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            rows = [row for name, row in report.user_properties if name == _MEASURED]
            self.rows += rows
            if not report.skipped:
                self._tests[report.nodeid] = {"passed": report.passed, "rows": rows}

    def pytest_sessionfinish(self) -> None:
        if self._record is not None:
            self._record.write_text(json.dumps(self._tests), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if not self.rows:
            return
        table = [["claim", "measured", "expected", "p"], *self.rows]
        widths = [max(len(row[i]) for row in table) for i in range(4)]
        terminalreporter.section("measured")
        for row in table:
            terminalreporter.write_line("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)))


@pytest.fixture
def render_kernels_when_launched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have renderers compile no kernel before they launch it: many tests make renderers and trace nothing."""
    from wrt.rendering.render_kernel import RenderKernel

    monkeypatch.setattr(RenderKernel, "compile", lambda *_: None)


@pytest.fixture(scope="session")
def assets() -> Path:
    """Return the folder of large test assets, which lies beside the repository on some machines."""
    folder = ROOT.parent / "shared" / "assets"
    if not folder.is_dir():
        pytest.skip(f"no test assets at {folder}")
    return folder
