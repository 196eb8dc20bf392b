"""The SPMD translator: the example of docs/spmd.md, and its requirements. Films are in test_wide_films.py."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from support import spmd_example
from support.spmd_example import Mirrors, Ray, albedo_at, blocked, make_kernel, next_mirror
from support.wide_scenes import LANES, needs_lanes

from wrt.kernels.core.spmd_marks import path_function
from wrt.kernels.native import at_file_level
from wrt.spmd.ir import Unsupported
from wrt.spmd.library import library
from wrt.spmd.translate import wide_code


def test_the_example_is_translated() -> None:
    code = wide_code(make_kernel(spmd_example.trace, "whole"), 16)[len(library(16)) :]
    assert "struct steps_trace_0 {" in code
    assert "run<&Steps::part_2>(groups);" in code
    assert "$" not in code


# --- Demands: each function below breaks one of them ---------------------------------------------------


@wp.func
@path_function
def query_in_a_block(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        albedo = albedo_at(mirrors, t)
        if albedo > 0.5:
            shadow = blocked(mirrors, camera_ray, 1.0)
            if not shadow:
                light += 1.0
    return light


@wp.func
@path_function
def returns_in_the_middle(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        if t < 0.0:
            return light
        light += albedo_at(mirrors, t)
    return light


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (query_in_a_block, r"query_in_a_block: asks a ray query within .*blocked_0.*top level of the loop"),
        (returns_in_the_middle, r"returns_in_the_middle: must return once, .*`break` instead"),
    ],
    ids=lambda value: getattr(value, "key", ""),
)
def test_a_path_function_that_breaks_a_demand_is_refused(path: Any, message: str) -> None:
    with pytest.raises(Unsupported, match=message):
        wide_code(make_kernel(path, path.key), 16)


@needs_lanes
@pytest.mark.machinery
def test_the_wide_kernel_gives_the_same_film() -> None:
    kernel = make_kernel(spmd_example.trace, "film")
    width, height = 40, 9

    wide_code_h = at_file_level(wide_code(kernel, LANES), "wide_code")

    @wp.func_native(f"render_tile(tile, {width}, {height}, 0, last, max_depth, mirrors, film, counts);")
    def render_tile(
        tile: int, last: int, max_depth: int, mirrors: Mirrors, film: wp.array(dtype=float), counts: wp.array(dtype=int)
    ):
        wide_code_h()

    @wp.kernel(module=wp.get_module("wrt.test.spmd.wide"), enable_backward=False)
    def render_tiles(
        last: int, max_depth: int, mirrors: Mirrors, film: wp.array(dtype=float), counts: wp.array(dtype=int)
    ):
        render_tile(wp.tid(), last, max_depth, mirrors, film, counts)

    mirrors = Mirrors()
    mirrors.distance, mirrors.sky = 0.4, 0.7
    start = np.random.default_rng(3).random(width * height).astype(np.float32)
    films = [wp.array(start, dtype=float, device="cpu") for _ in range(2)]
    counts = [wp.zeros(width * height, dtype=int, device="cpu") for _ in range(2)]
    wp.launch(kernel, dim=width * height, inputs=[0, 21, 9, mirrors, films[0], counts[0]], device="cpu")
    wp.launch(render_tiles, dim=3, inputs=[21, 9, mirrors, films[1], counts[1]], device="cpu")
    scalar, wide = (film.numpy() for film in films)
    assert len(np.unique(scalar - start)) > 10
    assert scalar.tobytes() == wide.tobytes()
