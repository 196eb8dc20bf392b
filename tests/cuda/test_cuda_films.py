"""What CUDA would render is what the CPU renders: kernels as NVRTC compiles them, on an emulator.

Films of the two differ by rounding alone: they have the same numbers of rays, and colours that agree.
"""

import json

import gpu_check
import numpy as np
import pytest
from conftest import Report
from support import films_of_devices
from support.digests import Case
from support.emulated_cuda.backend import GPU, EmulatedBackend, emulated_cuda
from support.films_of_devices import FILMS, OPTIONS, film_cases, films_of

import wrt
from wrt.rendering.render_kernel import REGENERATE
from wrt.scene.layers import LIGHT_GROUPS

pytestmark = pytest.mark.machinery

CASES = film_cases()


@pytest.fixture(scope="module")
def gpu():
    """A GPU whose modules are compiled without optimisation, as they hardly run."""
    with emulated_cuda(optimization=0) as backend:
        yield backend


def assert_agrees(name: str, case: Case, gpu: EmulatedBackend, report: Report, *, regenerates: bool) -> None:
    before = dict(gpu.launches)
    films = films_of(name, case, GPU)
    launched = {kernel for kernel, count in gpu.launches.items() if count > before.get(kernel, 0)}
    assert any(kernel.endswith("render_pass") for kernel in launched)
    assert any(kernel.startswith("make_regenerating_kernel") for kernel in launched) == regenerates
    assert {"build_listed", "write_nodes"} <= launched
    report(f"{name}: rays", films.rays[1], films.rays[0])
    for layer, share in films.agreeing.items():
        report(f"{name}, {layer}: pixels that agree", share)
    assert films.problems == []


@pytest.mark.parametrize("name", FILMS)
def test_films_agree(name, gpu, report):
    options = OPTIONS.get(name, CASES[name].options)
    regenerates = set(options.get("layers", ())) <= {LIGHT_GROUPS} and not options.get("caustics")
    assert_agrees(name, CASES[name], gpu, report, regenerates=regenerates)


@pytest.mark.parametrize("name", [FILMS[0], "models-fisheye"])
def test_films_of_a_loop_for_each_path_agree(name, gpu, report, monkeypatch):
    """The kernel that `WRT_REGENERATE=0` chooses."""
    monkeypatch.setenv(REGENERATE, "0")
    assert_agrees(name, CASES[name], gpu, report, regenerates=False)


def test_clamped_films_agree(gpu, report):
    """Without layers, in the kernel that regenerates paths; a tenth of the pixels is clamped."""
    options = {"width": 24, "height": 20}
    case = Case(lambda: wrt.load("cornell-box"), {**options, "clamp_indirect": 0.1})
    assert_agrees("clamped", case, gpu, report, regenerates=True)
    renderers = [wrt.Renderer(case.make(), **each) for each in (options, case.options)]
    for renderer in renderers:
        renderer._trace(4, 0.0)
    assert (renderers[0].image() - renderers[1].image() > 0.01).any(axis=2).mean() > 0.1


def test_bits_do_not_depend_on_which_lanes_meet(gpu):
    """Votes of whole warps or of parts of them; passes of one sample or several; threads of one warp or another."""

    def sums(*targets, divides=False, crop=(10, 12, 31, 22)):
        renderer = wrt.Renderer(wrt.load("cornell-box"), width=40, height=40, crop=crop, device="cuda")
        gpu.library(renderer._kernel.scalar).divide_warps(divides)
        for target in targets:
            renderer._trace(target, 0.0)
        assert (renderer.film.counts == targets[-1]).all()
        films = [renderer.film.fetch(name) for name in ("total", "total_of_squares")]
        return np.concatenate(films, axis=-1).reshape(crop[3] - crop[1], crop[2] - crop[0], 6)

    expected = sums(6)
    assert (expected[..., :3].max(axis=2) > 0.0).mean() > 0.5
    np.testing.assert_array_equal(sums(6, divides=True), expected)
    np.testing.assert_array_equal(sums(1, 2, 6), expected)
    np.testing.assert_array_equal(sums(6, crop=(13, 13, 30, 20)), expected[1:8, 3:20])


@pytest.mark.parametrize("agree", [films_of_devices.AGREE, 0.0])
def test_the_check_that_users_run_says_whether_films_agree(agree, tmp_path, monkeypatch):
    """`scripts/gpu_check.py` with one film and one small render."""
    monkeypatch.setattr(films_of_devices, "FILMS", ("built-in-cornell-box",))
    monkeypatch.setattr(films_of_devices, "AGREE", agree)
    monkeypatch.setattr(gpu_check, "SIZE", {"width": 16, "height": 12})
    line = ["--quick", "--no-tests", "--output", str(tmp_path), "--scenes", "cornell-box", "--seconds", "0.01"]
    with emulated_cuda(optimization=0):
        status = gpu_check.main(line)
    results = json.loads((tmp_path / "gpu-check.json").read_text(encoding="utf-8"))
    page = (tmp_path / "gpu-check.md").read_text(encoding="utf-8")
    assert (status, results["agrees"]) == ((0, True) if agree else (1, False))
    assert page.endswith("Everything agrees.\n" if agree else "Something does not agree, see above.\n")
    assert [(row["scene"], row["device"]) for row in results["speed"]] == [("cornell-box", GPU), ("cornell-box", "cpu")]
