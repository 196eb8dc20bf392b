"""Passes switch to the wide kernel when that pays, with the same bits."""

import dataclasses
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.caches import without_artefacts
from support.wide_scenes import needs_lanes, with_uvs

import wrt
from wrt.backend import processor
from wrt.backend.artefacts import Artefacts
from wrt.backend.device import Device
from wrt.backend.processor import NEEDED, SWITCH, lanes_here
from wrt.compiling import kernel as compiler
from wrt.compiling import later
from wrt.rendering import wide_kernel as wide
from wrt.rendering.wide_kernel import COMPILING_SECONDS, LOADING_SECONDS, WideKernel, largest_array

pytestmark = pytest.mark.usefixtures("render_kernels_when_launched")


class Compiler:
    """A stand-in for the process that compiles."""

    returncode: int | None = None

    def __init__(self, command: list[str], **_: Any) -> None:
        self.command = command
        started.append(self)

    def poll(self) -> int | None:
        return self.returncode

    def wait(self) -> None:
        """End without anything compiled."""
        self.returncode = 1

    def kill(self) -> None:
        """End."""


started: list[Compiler] = []


@pytest.fixture(autouse=True)
def switched_on(monkeypatch):
    """Allow wide kernels, which other tests switch off."""
    monkeypatch.delenv(SWITCH)


@pytest.fixture
def renderer():
    return wrt.Renderer(wrt.load("cornell-box"), width=20, height=19)


@pytest.fixture
def cache(renderer, monkeypatch):
    """Return whether the cache has the kernel, on a processor with all features, where nothing is really compiled."""
    state = SimpleNamespace(is_compiled=False)
    started.clear()
    monkeypatch.setattr(compiler, "is_compiled", lambda *_: state.is_compiled)
    monkeypatch.setattr(processor, "processor_flags", lambda: NEEDED[16])
    monkeypatch.setattr(subprocess, "Popen", Compiler)
    monkeypatch.setattr(WideKernel, "_load", lambda kernel: setattr(kernel, "kernel", "loaded"))
    return state


@pytest.fixture
def requested(monkeypatch):
    """Return the features of kernels that are requested for a later render."""
    features = []
    monkeypatch.setattr(later, "request", lambda each, *_: features.append(each))
    return features


def kernel_of(renderer: wrt.Renderer) -> WideKernel:
    """Return the wide kernel of a scene, before anything is known of it."""
    return WideKernel(renderer.device, renderer._kernel.features, renderer._kernel.records)


def test_it_is_compiled_once_and_only_for_long_renders(cache, renderer, requested, monkeypatch):
    """After a short render on many cores it is compiled for the next one, if that saves three times its cost."""
    monkeypatch.setattr(renderer.device, "threads", 16)
    kernel = kernel_of(renderer)
    worth = later.WORTH * COMPILING_SECONDS / 16 * 2.0  # half of it is saved
    kernel.prepare(0.99 * worth)
    assert not requested
    for _ in range(2):
        kernel.prepare(1.01 * worth)
    assert requested == [kernel._features]
    assert not started
    for _ in range(2):
        kernel.prepare(COMPILING_SECONDS * 10)
    (process,) = started
    assert json.loads(process.command[3]) == json.loads(json.dumps(dataclasses.asdict(kernel._features)))
    assert process.command[4] == "16"
    process.returncode, cache.is_compiled = 0, True
    kernel.prepare(LOADING_SECONDS / 2)
    assert kernel.kernel is None
    kernel.prepare(LOADING_SECONDS * 2)
    assert kernel.kernel == "loaded"
    assert len(started) == 1


def test_what_does_not_compile_is_not_tried_again_and_no_python_is_no_error(cache, renderer, monkeypatch):
    kernel = kernel_of(renderer)
    kernel.wait()
    kernel.prepare(math.inf)
    assert (kernel.kernel, len(started)) == (None, 1)

    def fail(*_, **__):
        raise FileNotFoundError(2, "no such file")

    monkeypatch.setattr(subprocess, "Popen", fail)
    kernel = kernel_of(renderer)
    kernel.wait()
    assert kernel.kernel is None


def test_a_render_that_ends_before_its_compiler_asks_for_the_next(renderer, requested, monkeypatch):
    monkeypatch.setattr(WideKernel, "_folders", lambda _: [])
    monkeypatch.setattr(WideKernel, "_is_usable", lambda _: True)
    real, sleep = subprocess.Popen, [sys.executable, "-c", "import time; time.sleep(60)"]
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: real(sleep))
    kernel = kernel_of(renderer)
    kernel.prepare(10.0 * COMPILING_SECONDS)
    process, features = kernel._compiler, kernel._features
    assert process is not None
    del kernel
    assert process.poll() == -signal.SIGKILL
    assert requested == [features]


def test_what_loads_quickly_is_loaded_before_the_first_pass(cache, renderer, monkeypatch):
    """But nothing is compiled on a guess."""
    kernel = kernel_of(renderer)
    kernel.expect(math.inf)
    cache.is_compiled = True
    kernel.expect(LOADING_SECONDS / 2)
    assert (kernel.kernel, started) == (None, [])
    kernel.expect(LOADING_SECONDS * 2)
    assert (kernel.kernel, started) == ("loaded", [])


@pytest.mark.parametrize("lacking", ["processor", "warp", "array", "film", "integrator", "switch", "cpu"])
def test_nothing_is_tried_where_it_cannot_run(lacking, cache, renderer, monkeypatch):
    kernel = kernel_of(renderer)
    if lacking == "processor":
        monkeypatch.setattr(processor, "processor_flags", lambda: NEEDED[8] - {"avx2"})
    elif lacking == "warp":
        monkeypatch.setattr(renderer.device.backend.artefacts, "can_launch", False)
    elif lacking == "array":
        monkeypatch.setattr(wide, "MOST_BYTES", largest_array(kernel._records[0]) - 1)
    elif lacking == "film":
        kernel = kernel_of(wrt.Renderer(wrt.load("cornell-box"), width=500, height=400))
        monkeypatch.setattr(wide, "MOST_BYTES", 24 * 500 * 400 - 1)
    elif lacking == "integrator":
        kernel._features = dataclasses.replace(kernel._features, integrator="aov")
    elif lacking == "switch":
        monkeypatch.setenv(SWITCH, "0")
    elif lacking == "cpu":
        device = Device("cpu")
        device.name = "cuda:0"
        kernel = WideKernel(device, kernel._features, kernel._records)
    cache.is_compiled = True
    kernel.wait()
    kernel.prepare(math.inf)
    assert (kernel.kernel, started) == (None, [])


def test_lanes_are_those_of_the_processor(monkeypatch):
    for flags, setting, expected in (
        (NEEDED[16] | NEEDED[8], "", 16),
        (NEEDED[8] | {"avx512f"}, "", 8),
        (NEEDED[8] - {"fma"}, "", 0),
        (NEEDED[8], "0", 0),
        (NEEDED[8], "4", 4),
    ):
        monkeypatch.setattr(processor, "processor_flags", lambda flags=flags: flags)
        monkeypatch.setenv(SWITCH, setting)
        assert lanes_here() == expected
    monkeypatch.setenv(SWITCH, "5")
    with pytest.warns(UserWarning, match="WRT_WIDE=5 is ignored: it may be 0, 4, 8, 16 or empty"):
        assert lanes_here() == 8


def test_the_largest_array_is_found_wherever_it_is():
    scene = wrt.load("cornell-box")
    pixels = np.random.default_rng(1).random((300, 200, 3), np.float32)
    shape, material = scene.shapes[0], wrt.Diffuse(wrt.ImageTexture(pixels))
    scene.shapes[0] = dataclasses.replace(shape, mesh=with_uvs(shape.mesh), material=material)
    found = largest_array(wrt.Renderer(scene, width=8, height=8)._kernel.records[0])
    assert pixels.nbytes <= found <= 2 * pixels.nbytes


@needs_lanes
@pytest.mark.machinery
def test_a_picture_is_the_same_if_passes_change_over(tmp_path, monkeypatch):
    """Some passes by one kernel, others by the other, a checkpoint in between; or all by the first."""
    scene, size = wrt.load("cornell-box"), {"width": 37, "height": 21}
    scalar = wrt.Renderer(scene, **size)
    list(scalar.passes(spp=9))
    assert scalar.lanes == 1
    first = wrt.Renderer(scene, **size)
    list(first.passes(spp=4))
    first.save_checkpoint(tmp_path / "half.wrt")
    monkeypatch.undo()
    monkeypatch.delenv(SWITCH)
    second = wrt.Renderer.resume(tmp_path / "half.wrt", scene)
    assert second.compile() > 0.0
    assert second.lanes > 1
    list(second.passes(spp=9))
    np.testing.assert_array_equal(second.image(), scalar.image())
    np.testing.assert_array_equal(second.variance(), scalar.variance())
    assert first.rays + second.rays == scalar.rays


LONG = """
import wrt
for progress in wrt.Renderer(wrt.load("cornell-box"), width=64, height=64).passes(time=1e6):
    print(progress.spp, flush=True)
"""


@needs_lanes
@pytest.mark.slow
def test_the_process_that_compiles_ends_with_the_render(tmp_path):
    """Killed while another compiles, so that its own waits; nothing is left of it."""
    environment, artefacts = without_artefacts(tmp_path), Artefacts()
    assert artefacts.path is not None
    artefacts.path = tmp_path / "cache" / "wrt" / artefacts.path.name
    with artefacts.lock():
        process = subprocess.Popen([sys.executable, "-c", LONG], env=environment, stdout=subprocess.PIPE, text=True)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        assert process.stdout is not None
        child = next(found[0] for _ in process.stdout if (found := children.read_text().split()))
        process.kill()
        process.communicate()
        status, limit = Path(f"/proc/{child}/status"), time.monotonic() + 60.0
        while status.exists() and "zombie" not in status.read_text() and time.monotonic() < limit:
            time.sleep(0.05)
        assert not status.exists() or "zombie" in status.read_text()
