"""The SPMD translator: what it demands is checked, and stages are inlined."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from support import spmd_example
from support.spmd_example import Mirrors, Ray, albedo_at, blocked, make_kernel, next_mirror, random_number
from support.wide_scenes import LANES, needs_lanes

from wrt.kernels.native import at_file_level
from wrt.kernels.spmd_marks import inline_stage, path_function
from wrt.spmd.ir import Unsupported
from wrt.spmd.library import library
from wrt.spmd.templates import fill
from wrt.spmd.translate import wide_code


def test_the_example_is_translated() -> None:
    code = wide_code(make_kernel(spmd_example.trace, "whole"), 16)[len(library(16)) :]
    assert "struct steps_trace_0 {" in code
    assert "run<&Steps::part_2>(groups);" in code
    assert "$" not in code
    with pytest.raises(ValueError, match=r"part\.h: \['ANSWER', 'CODE'"):
        fill("part.h", LOOP="while_0")


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
    ("path", "told"),
    [
        (query_in_a_block, r"query_in_a_block: asks a ray query within .*blocked_0.*top level of the loop"),
        (returns_in_the_middle, r"returns_in_the_middle: must return once, .*`break` instead"),
    ],
    ids=lambda value: getattr(value, "key", ""),
)
def test_a_path_function_that_breaks_a_demand_is_refused(path: Any, told: str) -> None:
    with pytest.raises(Unsupported, match=told):
        wide_code(make_kernel(path, path.key), 16)


# --- Stages are inlined -------------------------------------------------------------------------------


@wp.struct
class State:
    ray: Ray
    light: float
    throughput: float
    depth: int
    numbers: wp.vec3
    done: bool
    unused: wp.vec4
    handed_on: float


@wp.struct
class Scattered:
    weight: float
    turns: bool


@wp.func
@inline_stage
def begin(camera_ray: Ray) -> State:
    state = State()
    state.ray = camera_ray
    state.throughput = 1.0
    state.handed_on = 3.0
    return state


@wp.func
@inline_stage
def leave_scene(mirrors: Mirrors, state: State, t: float) -> State:
    if t < 0.0:
        for i in range(3):
            state.light += state.throughput * mirrors.sky * state.numbers[i]
        state.done = True
    state.handed_on = state.handed_on + 1.0
    return state


@wp.func
@inline_stage
def scattered(state: State, albedo: float) -> Scattered:
    found = Scattered()
    found.weight = albedo * state.throughput
    found.turns = state.depth % 3 != 0
    return found


@wp.func
@inline_stage
def scatter(mirrors: Mirrors, state: State, t: float, u: float) -> State:
    found = scattered(state, albedo_at(mirrors, t))
    # Each takes the other's old value.
    light = state.light
    state.light = state.light + found.weight
    state.numbers[state.depth % 3] = light
    state.throughput = found.weight
    if found.turns:
        state.ray.direction = -state.ray.direction
    if u >= state.throughput:
        state.done = True
    return state


@wp.func
@path_function
def staged(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    state = begin(camera_ray)
    while state.depth < max_depth:
        state.depth += 1
        u = random_number(seed, state.depth)
        t = next_mirror(mirrors, state.ray)
        state = leave_scene(mirrors, state, t)
        if state.done:
            break
        before = state.throughput
        if state.depth == 2:
            state.light += before
            continue
        state = scatter(mirrors, state, t, u)
        shadow = blocked(mirrors, state.ray, t * before)
        if not shadow:
            state.light += 0.25 * before
        if state.done:
            state.light *= 2.0
            break
    return state.light


def test_a_path_keeps_of_its_state_what_it_uses() -> None:
    code = wide_code(make_kernel(staged, "staged"), 16)[len(library(16)) :]
    kept = code[code.index("struct steps_") : code.index("lanes::Mask waiting")]
    used = {"ray", "light", "throughput", "depth", "numbers", "done"}
    assert set(re.findall(r"\bvar_0_(\w+);", kept)) == used


@needs_lanes
@pytest.mark.machinery
@pytest.mark.parametrize("path", [spmd_example.trace, staged], ids=["plain", "staged"])
def test_the_wide_kernel_gives_the_same_film(path: Any) -> None:
    kernel = make_kernel(path, f"film_{path.key}")
    width, height = 40, 9

    wide_code_h = at_file_level(wide_code(kernel, LANES), f"wide_code_{path.key}")

    @wp.func_native(f"render_tile(tile, {width}, {height}, 0, last, max_depth, mirrors, film, counts);")
    def render_tile(
        tile: int,
        last: int,
        max_depth: int,
        mirrors: Mirrors,
        film: wp.array(dtype=float),
        counts: wp.array(dtype=int),
    ):
        wide_code_h()

    @wp.kernel(module=wp.get_module(f"wrt.test.spmd.wide_{path.key}"), enable_backward=False)
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
    one, many = (film.numpy() for film in films)
    assert len(np.unique(one - start)) > 10
    assert one.tobytes() == many.tobytes()
