"""The wide kernel leaves the same bits as the one of a single thread, whatever a scene uses."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.feature_sets import FEATURES
from support.wide_scenes import CAMERAS, SCENES, wide_kernel

import wrt
from wrt.backend.lanes import WIDTHS, lanes_of
from wrt.backend.processor import processor_flags
from wrt.kernels.bsdf import model_of
from wrt.kernels.bsdf.record import MAX_SLOTS
from wrt.kernels.features import Features
from wrt.kernels.integrators.registry import INTEGRATORS
from wrt.kernels.native.constants import LARGE_TREE
from wrt.kernels.render import make_render_kernel
from wrt.spmd import library
from wrt.spmd.ir import Unsupported
from wrt.spmd.kernel import make_wide_render_kernel, with_few_slots
from wrt.spmd.library import can_be_called, library_functions
from wrt.spmd.translate import wide_code
from wrt.upload.accel import bvh, instancing

Bits = dict[str, NDArray[Any]]


def bits(renderer: wrt.Renderer, kernel: wp.Kernel, threads: int, start: Bits, spp: Sequence[int]) -> Bits:
    """Return what a kernel makes of a film by passes up to so many samples a pixel, going on from what is there."""
    renderer.film.restore(start)
    renderer.film.data.rays.zero_()
    for target in spp:
        wp.launch(kernel, dim=threads, inputs=[0, target, *renderer._inputs], device="cpu")
    return {**renderer.film.state(), "rays": renderer.film.data.rays.numpy().copy()}


def differences(scene: wrt.Scene, spp: Sequence[int] = (3, 22), lanes: int = 0, **options: Any) -> list[str]:
    """Render a scene by both kernels, and return which arrays of the film differ in any bit.

    With passes of fewer samples than lanes and of more, of which as many of a pixel are followed together.
    """
    renderer = wrt.Renderer(scene, **{"width": 45, "height": 31, "threads": 1, **options})
    start = renderer.film.state()
    one = bits(renderer, renderer._kernel.scalar, renderer.film.pixels, start, spp)
    many = bits(renderer, *wide_kernel(renderer, lanes or LANES), start, spp)
    assert one["total"].any()
    assert one["count"].min() >= spp[-1]
    return [name for name in one if one[name].tobytes() != many[name].tobytes()]


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of few triangles too have trees of their own."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)


# --- Pictures ----------------------------------------------------------------------------------------

LANES = lanes_of(processor_flags())
needs_lanes = pytest.mark.skipif(not LANES, reason="the processor has neither AVX-512 nor AVX2")
SEEN_BY_OTHERS = {
    ("models", "fisheye"),
    ("panes", "panorama"),
    ("textures", "moving"),
    ("bodies", "moving"),
}
"""Scenes and cameras that are each in another pair here; their films are in tests/data/digests.json."""

QUICK = ("plain", "disk")
"""The scene and the camera of all tests that are not slow, which share kernels: each takes 10 to 20 s to compile."""


def quick_scene() -> wrt.Scene:
    scene = SCENES[QUICK[0]][0]()
    scene.camera = CAMERAS[QUICK[1]]
    return scene


@needs_lanes
@pytest.mark.parametrize(
    ("name", "camera"),
    [
        pytest.param(name, camera, marks=() if (name, camera) == QUICK else pytest.mark.slow)
        for name, (_, _, cameras) in SCENES.items()
        for camera in cameras
        if (name, camera) not in SEEN_BY_OTHERS
    ],
)
def test_the_same_bits(name: str, camera: str, shared: None) -> None:
    make, options, _ = SCENES[name]
    scene = make()
    scene.camera = CAMERAS[camera]
    assert differences(scene, **options) == []


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [lanes for lanes in WIDTHS if lanes != LANES])
def test_the_same_bits_with_other_numbers_of_lanes(lanes: int) -> None:
    """Clang makes several registers of a vector, or uses part of one."""
    assert differences(quick_scene(), lanes=lanes) == []


def scattered(count: int, size: float) -> wrt.Mesh:
    """Return triangles of all directions about the origin."""
    corners = np.random.default_rng(4).uniform(-1.0, 1.0, (count, 1, 3)) * [3.0, 2.0, 3.0]
    corners = corners + np.random.default_rng(5).normal(size=(count, 3, 3)) * size
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


@pytest.mark.slow
@needs_lanes
def test_triangles_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of which a leaf may hold two, before other triangles."""
    monkeypatch.setattr(bvh, "MORE_PIECES", 5.0)
    monkeypatch.setattr(bvh, "WORTH_CUTTING", np.inf)
    scene = quick_scene()
    scene.add(scattered(2_000, 0.3), material=wrt.Diffuse(0.5))
    assert differences(scene) == []


@pytest.mark.slow
@needs_lanes
def test_large_tree() -> None:
    """More rays take turns there."""
    scene = quick_scene()
    scene.add(scattered(LARGE_TREE // 10, 0.005), material=wrt.Diffuse(0.5))
    assert wrt.Renderer(scene)._built.data.bvh.leaves.size > LARGE_TREE
    assert differences(scene) == []


@needs_lanes
@pytest.mark.parametrize(
    "options",
    [
        {"width": 1, "height": 1},
        {"width": 16, "height": 16},
        {"width": 17, "height": 5, "spp": (5, 40)},
        {"width": 3, "height": 33, "max_depth": 3},
        {"crop": (3, 2, 40, 23)},
        {"crop": (16, 20, 45, 21), "strategy": "light"},
        {"filter": "box", "max_depth": 2, "strategy": "bsdf"},
        {"seed": 2**32 - 1, "spp": (1,)},
        {"width": 21, "height": 18, "spp": (1, 3, 6, 10, 17, 25, 40, 52, 76, 107)},  # 1, 2, 3, 4, 7, 8, 15, 12, 24, 31
    ],
    ids=str,
)
def test_sizes_and_settings(options: dict[str, Any]) -> None:
    scene = quick_scene()
    assert differences(scene, **options) == []


@needs_lanes
@pytest.mark.parametrize("target", [5, 29])
def test_pixels_that_have_samples_already(target: int) -> None:
    """Some have none, some a few, and some all or more than are asked for."""
    scene = quick_scene()
    counts = np.random.default_rng(1).integers(0, target + 2, 45 * 31).astype(np.int32)
    counts[:16] = target + 4
    renderer = wrt.Renderer(scene, width=45, height=31, threads=1)
    start = renderer.film.state()
    rng = np.random.default_rng(2)
    for name in ("total", "total_of_squares"):
        start[name][:] = rng.random(start[name].shape)
    start["count"][:], start["rejected"][:] = counts, counts // 3
    one = bits(renderer, renderer._kernel.scalar, 45 * 31, start, [target])
    many = bits(renderer, *wide_kernel(renderer, LANES), start, [target])
    assert all(one[name].tobytes() == many[name].tobytes() for name in one)
    assert (one["count"] == np.maximum(counts, target)).all()
    assert (many["total"][counts >= target] == start["total"][counts >= target]).all()


@needs_lanes
def test_samples_that_are_not_finite() -> None:
    scene = quick_scene()
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, emission=3e38)
    renderer = wrt.Renderer(scene, width=45, height=31, threads=1, strategy="bsdf")
    start = renderer.film.state()
    one = bits(renderer, renderer._kernel.scalar, 45 * 31, start, [20])
    many = bits(renderer, *wide_kernel(renderer, LANES), start, [20])
    assert one["rejected"].any()
    assert all(one[name].tobytes() == many[name].tobytes() for name in one)


@pytest.mark.slow
@needs_lanes
def test_a_small_stack() -> None:
    """A thousand paths need more of it than some shells allow."""
    code = """
import wrt
renderer = wrt.Renderer(wrt.load("cornell-box"), width=32, height=32, threads=2)
renderer.compile()
for progress in renderer.passes(spp=32): pass
print(renderer._kernel.in_use.module.name, progress.spp)
"""
    environment = {name: value for name, value in os.environ.items() if name != "WRT_WIDE"}
    command = ["sh", "-c", 'ulimit -s 512; exec "$0" "$@"', sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    name, samples = done.stdout.split()
    assert name.startswith(f"wrt.render.wide{LANES}.")
    assert samples == "32"


# --- Translation -------------------------------------------------------------------------------------

PATHS = [features for features in FEATURES if features.integrator == "path"]


@pytest.mark.parametrize(
    "features",
    [
        pytest.param(f, marks=() if f.nested or f.instances == "deforming" else pytest.mark.slow, id=f.name)
        for f in PATHS
    ],
)
def test_every_kernel_that_follows_paths_is_translated(features: Features) -> None:
    code = wide_code(make_render_kernel(features), 16)
    assert "static void render_tile(" in code
    assert code.count("{") == code.count("}")


def test_materials_have_as_many_values_as_are_read() -> None:
    features = Features(("diffuse", "conductor"), False, "none")
    code = wide_code(make_render_kernel(features), 16)
    few = with_few_slots(code, features)
    for name in ("Matrix", "mat_t", "make_mat"):
        whole = re.compile(rf"{name}<{MAX_SLOTS}, ?3,")
        assert whole.search(code)
        assert not whole.search(few)
    assert f"Matrix<{max(model_of(name).slots for name in features.models)}, 3," in few


@pytest.mark.parametrize("integrator", [name for name in INTEGRATORS if name != "path"])
def test_kernels_that_follow_no_paths_are_not(integrator: str) -> None:
    with pytest.raises(Unsupported, match="follows no path"):
        make_wide_render_kernel(Features(("diffuse",), False, "none", integrator=integrator), 16)


def test_a_function_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = make_render_kernel(FEATURES[0])
    known = library_functions()
    for name, told in (("normalize", r"wp::normalize\("), ("cast_int32", r"wp::cast<wp::int32>\("), ("floor", "floor")):
        assert name in known
        without = {k: v for k, v in known.items() if k != name}
        monkeypatch.setattr(library, "library_functions", lambda without=without: without)
        with pytest.raises(Unsupported, match=told):
            wide_code(kernel, 16)


def test_what_functions_take() -> None:
    for call in ("mul(matrix, vector)", "add(Doubles, Doubles)", "sin(Floats)", "cross(vector, vector)", "abs(vector)"):
        assert can_be_called(*parsed(call)), call
    for call in ("mul(vector, matrix)", "sin(Doubles)", "bit_and(Floats, Floats)", "cross(vector)", "noise(Floats)"):
        assert not can_be_called(*parsed(call)), call


def parsed(call: str) -> tuple[str, list[str]]:
    name, _, arguments = call[:-1].partition("(")
    return name, arguments.split(", ")
