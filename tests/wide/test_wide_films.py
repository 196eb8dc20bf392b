"""Films of the wide kernel have the bits of the scalar kernel, for all features of scenes."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from support.feature_sets import FEATURES
from support.wide_scenes import CAMERAS, LANES, SCENES, bits, differences, needs_lanes, wide_kernel

import wrt
from wrt.backend.processor import WIDTHS
from wrt.kernels.core.features import Features
from wrt.kernels.native.constants import LARGE_TREE
from wrt.kernels.render import make_render_kernel
from wrt.spmd.ir import Unsupported
from wrt.spmd.kernel import make_wide_render_kernel
from wrt.spmd.translate import wide_code
from wrt.upload.accel import bvh, instancing

SEEN_BY_OTHERS = {("models", "fisheye"), ("panes", "panorama"), ("textures", "moving"), ("bodies", "moving")}
"""Scenes and cameras that are each in another pair here; their films are in tests/data/digests.json."""

SHARED = ("plain", "disk")
"""The scene and the camera of most tests, which share kernels: each takes 10 to 20 s to compile."""


def shared_scene() -> wrt.Scene:
    scene = SCENES[SHARED[0]][0]()
    scene.camera = CAMERAS[SHARED[1]]
    return scene


@needs_lanes
@pytest.mark.parametrize(
    ("name", "camera"),
    [
        pytest.param(name, camera, marks=pytest.mark.slow if (name, camera) == SHARED else pytest.mark.machinery)
        for name, (_, _, cameras) in SCENES.items()
        for camera in cameras
        if (name, camera) not in SEEN_BY_OTHERS
    ],
)
def test_the_same_bits(name: str, camera: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)  # meshes of few triangles too have trees of their own
    make, options, _ = SCENES[name]
    scene = make()
    scene.camera = CAMERAS[camera]
    assert differences(scene, **options) == []


@pytest.mark.machinery
@pytest.mark.parametrize("lanes", [lanes for lanes in WIDTHS if lanes != LANES])
def test_the_same_bits_with_other_numbers_of_lanes(lanes: int) -> None:
    """Clang makes several registers of a vector, or uses part of one."""
    assert differences(shared_scene(), lanes=lanes) == []


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"width": 1, "height": 1},
        {"width": 17, "height": 5, "spp": (5, 40)},
        {"width": 3, "height": 33, "max_depth": 3},
        {"crop": (16, 20, 45, 21), "strategy": "light"},
        {"filter": "box", "max_depth": 2, "strategy": "bsdf"},
        {"layers": ("edges", "depth"), "edge_width": 3.0, "integrator": "direct"},
        {"seed": 2**32 - 1, "spp": (1,)},
        {"width": 21, "height": 18, "spp": (1, 3, 6, 10, 17, 25, 40, 52, 76, 107)},  # 1, 2, 3, 4, 7, 8, 15, 12, 24, 31
    ],
    ids=str,
)
def test_sizes_and_settings(options: dict[str, Any]) -> None:
    assert differences(shared_scene(), **options) == []


@needs_lanes
@pytest.mark.slow
def test_many_lights_and_instances(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays go side by side through the boxes of lights, and through the trees of meshes that stand in many places."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    rng = np.random.default_rng(8)
    scene = shared_scene()
    for k, (x, y, z) in enumerate(rng.uniform((-3, 0.2, -2), (3, 2.5, 1.5), (24, 3)).tolist()):
        lights = wrt.SphereLight((x, y, z), 0.1, 2.0), wrt.DiskLight((x, y, z), (z, x, y), 0.1, 5.0)
        scene.add_light(lights[k % 2])
    assert differences(scene) == []
    meshes = wrt.sphere(subdivisions=3), scattered(40, 0.5)
    for k, (x, y, z) in enumerate(rng.uniform((-3, 0.1, -3), (3, 1.5, 1.5), (60, 3)).tolist()):
        transform = np.diag([0.3, 0.2 if k % 3 else -0.3, 0.25, 1.0])
        transform[:3, 3] = x, y, z
        for _ in range(1 + (k == 7)):  # two in one place
            scene.add(meshes[k % 2], material=wrt.Diffuse(0.5), transform=transform)
    assert differences(scene, max_depth=6) == []


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [
        wrt.PerspectiveCamera(
            (0.1, 1.6, 3.0), (0.0, 0.5, 0.0), distortion=(-0.3, 0.1, 0.01, 0.02), aperture_radius=0.1
        ),
        wrt.FisheyeCamera((0.1, 1.0, 2.0), (0.0, 0.5, 0.0), distortion=(-0.1, 0.02), circular=False),
    ],
    ids=lambda camera: camera.model,
)
def test_lenses_that_distort(camera: wrt.Camera) -> None:
    scene = SCENES["plain"][0]()
    scene.camera = camera
    assert differences(scene) == []


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("target", [5, 29])
def test_pixels_that_have_samples_already(target: int) -> None:
    """Some pixels have no samples, some a few, and some all of them or more."""
    counts = np.random.default_rng(1).integers(0, target + 2, 45 * 31).astype(np.int32)
    counts[:16] = target + 4
    renderer = wrt.Renderer(shared_scene(), width=45, height=31, threads=1)
    start = renderer.film.state()
    rng = np.random.default_rng(2)
    for name in ("total", "total_of_squares"):
        start[name][:] = rng.random(start[name].shape)
    start["count"][:], start["rejected"][:] = counts, counts // 3
    scalar = bits(renderer, renderer._kernel.scalar, 45 * 31, start, [target])
    wide = bits(renderer, *wide_kernel(renderer, LANES), start, [target])
    assert all(scalar[name].tobytes() == wide[name].tobytes() for name in scalar)
    assert (scalar["count"] == np.maximum(counts, target)).all()
    assert (wide["total"][counts >= target] == start["total"][counts >= target]).all()


@needs_lanes
@pytest.mark.slow
def test_samples_that_are_not_finite() -> None:
    scene = shared_scene()
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, emission=3e38)
    renderer = wrt.Renderer(scene, width=45, height=31, threads=1, strategy="bsdf")
    start = renderer.film.state()
    scalar = bits(renderer, renderer._kernel.scalar, 45 * 31, start, [20])
    wide = bits(renderer, *wide_kernel(renderer, LANES), start, [20])
    assert scalar["rejected"].any()
    assert all(scalar[name].tobytes() == wide[name].tobytes() for name in scalar)


def scattered(count: int, size: float) -> wrt.Mesh:
    """Return triangles of all directions about the origin."""
    corners = np.random.default_rng(4).uniform(-1.0, 1.0, (count, 1, 3)) * [3.0, 2.0, 3.0]
    corners = corners + np.random.default_rng(5).normal(size=(count, 3, 3)) * size
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


@needs_lanes
@pytest.mark.machinery
def test_triangles_in_pieces_and_a_large_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    """A leaf may hold two pieces of a triangle before others; in a large tree more rays take turns."""
    scene = shared_scene()
    scene.add(scattered(LARGE_TREE // 10, 0.005), material=wrt.Diffuse(0.5))
    assert wrt.Renderer(scene)._built.data.bvh.leaves.size > LARGE_TREE
    assert differences(scene) == []
    monkeypatch.setattr(bvh, "MORE_PIECES", 5.0)
    monkeypatch.setattr(bvh, "WORTH_CUTTING", np.inf)
    scene = shared_scene()
    scene.add(scattered(2_000, 0.3), material=wrt.Diffuse(0.5))
    assert differences(scene) == []


STACK = """
import wrt
renderer = wrt.Renderer(wrt.load("cornell-box"), width=32, height=32, threads=2)
renderer.compile()
for progress in renderer.passes(spp=32): pass
print(renderer.lanes, progress.spp)
"""


@needs_lanes
@pytest.mark.machinery
def test_a_small_stack_is_enough() -> None:
    """A thousand paths need more of it than some shells allow."""
    environment = {name: value for name, value in os.environ.items() if name != "WRT_WIDE"}
    command = ["sh", "-c", 'ulimit -s 512; exec "$0" "$@"', sys.executable, "-c", STACK]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{LANES} 32\n"


# --- Translation of render kernels --------------------------------------------------------------------


@pytest.mark.parametrize(
    "features",
    [
        pytest.param(f, marks=() if f.nested and f.instances != "none" else pytest.mark.machinery, id=f.name)
        for f in FEATURES
        if f.integrator == "path"
    ],
)
def test_every_kernel_that_follows_paths_is_translated(features: Features) -> None:
    code = wide_code(make_render_kernel(features), 16)
    assert "static void render_tile(" in code
    assert code.count("{") == code.count("}")


def test_kernels_that_trace_no_rays_are_not_translated() -> None:
    with pytest.raises(Unsupported, match="follows no path"):
        make_wide_render_kernel(Features(("diffuse",), False, "none", integrator="aov"), 16)
