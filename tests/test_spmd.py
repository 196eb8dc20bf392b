"""The SPMD translator: what it demands of kernels is checked, and docs/spmd.md shows what it does."""

import re
from typing import Any

import pytest
import warp as wp
from conftest import ROOT
from support import spmd_example
from support.spmd_example import Mirrors, Ray, albedo_at, blocked, make_kernel, next_mirror

from wrt.kernels.spmd_marks import path_function, pixel_kernel, traces_alone
from wrt.spmd.ir import Unsupported
from wrt.spmd.library import library
from wrt.spmd.templates import fill
from wrt.spmd.translate import wide_code

PAGE = (ROOT / "docs" / "spmd.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("stage", ["python", "warp", "parse", "rounds", "storage", "emit"])
def test_the_page_shows_what_each_stage_makes(stage: str) -> None:
    shown = re.search(rf"<!-- {stage} -->\n```\w*\n(.*?)\n```", PAGE, re.DOTALL)
    assert shown is not None
    assert shown[1] == spmd_example.stages()[stage]


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
def query_in_an_inner_loop(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        light += albedo_at(mirrors, t)
        for i in range(depth):
            if blocked(mirrors, camera_ray, float(i)):
                light += 1.0
    return light


@wp.func
@path_function
def query_before_the_loop(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = next_mirror(mirrors, camera_ray)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        light += albedo_at(mirrors, t)
    return light


@wp.func
def sees(mirrors: Mirrors, ray: Ray) -> float:
    if blocked(mirrors, ray, 2.0):
        return 0.0
    return 1.0


@wp.func
@path_function
def query_in_a_called_function(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        light += albedo_at(mirrors, t) * sees(mirrors, camera_ray)
    return light


@wp.func
@path_function
def two_loops(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        t = next_mirror(mirrors, camera_ray)
        light += albedo_at(mirrors, t)
    while depth > 0:
        depth -= 1
        light *= 0.5
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


@wp.func
@path_function
def light_before_the_surface(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        if_blocked = blocked(mirrors, camera_ray, 1.0)
        t = next_mirror(mirrors, camera_ray)
        if not if_blocked:
            light += albedo_at(mirrors, t)
    return light


@wp.func
@path_function
def no_shading_point(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        light += next_mirror(mirrors, camera_ray)
    return light


@wp.func
@path_function
def another_scene(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    moved = mirrors
    while depth < max_depth:
        depth += 1
        t = next_mirror(moved, camera_ray)
        light += albedo_at(mirrors, t)
    return light


@wp.func
def unmarked(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
    light = float(0.0)
    depth = int(0)
    while depth < max_depth:
        depth += 1
        light += albedo_at(mirrors, next_mirror(mirrors, camera_ray))
    return light


@pytest.mark.parametrize(
    ("path", "told"),
    [
        (query_in_a_block, r"query_in_a_block: asks a ray query within .*blocked_0.*top level of the loop"),
        (query_in_an_inner_loop, r"query_in_an_inner_loop: asks a ray query within"),
        (query_before_the_loop, r"query_before_the_loop: asks a ray query .*outside the loop"),
        (
            query_in_a_called_function,
            r"sees: asks a ray query, and query_in_a_called.* or mark sees with @traces_alone",
        ),
        (two_loops, r"two_loops: must have one loop, .*functions of their own"),
        (returns_in_the_middle, r"returns_in_the_middle: must return once, .*`break` instead"),
        (light_before_the_surface, r"light_before_the_surface: must ask first for the next surface .*query 1"),
        (no_shading_point, r"no_shading_point: must call a @ray_query and then a @shading_point"),
        (another_scene, r"another_scene: traces rays in a scene that may differ"),
        (unmarked, r"follows no path"),
    ],
    ids=lambda value: getattr(value, "key", ""),
)
def test_a_path_function_that_breaks_a_demand_is_refused(path: Any, told: str) -> None:
    with pytest.raises(Unsupported, match=told):
        wide_code(make_kernel(path, path.key), 16)


def test_the_page_quotes_an_error_as_it_is() -> None:
    with pytest.raises(Unsupported) as refused:
        wide_code(make_kernel(query_in_a_block, "quoted"), 16)
    assert str(refused.value) in " ".join(PAGE.replace("\n> ", " ").split())


def test_functions_may_trace_rays_alone_if_they_say_so() -> None:
    sees.func.spmd_marks = ()
    traces_alone(sees.func)
    try:
        wide_code(make_kernel(query_in_a_called_function, "alone"), 16)
    finally:
        sees.func.spmd_marks = ()


def kernel_of(name: str) -> Any:
    module = wp.get_module(f"wrt.test.spmd.kernel_{name}")
    return lambda function: wp.kernel(function, module=module, enable_backward=False)


@kernel_of("twice")
@pixel_kernel
def calls_it_twice(first_pixel: int, last: int, mirrors: Mirrors, film: wp.array(dtype=float)):
    total = float(0.0)
    for sample in range(0, last):
        ray = Ray()
        total += spmd_example.trace(mirrors, ray, sample, 4)
        total += spmd_example.trace(mirrors, ray, sample + 1, 4)
    film[first_pixel + wp.tid()] = total


@kernel_of("else")
@pixel_kernel
def does_more_behind_it(first_pixel: int, last: int, mirrors: Mirrors, film: wp.array(dtype=float)):
    total = float(0.0)
    for sample in range(0, last):
        ray = Ray()
        if sample > 1:
            if sample > 2:
                total += spmd_example.trace(mirrors, ray, sample, 4)
            total += 1.0
    film[first_pixel + wp.tid()] = total


@kernel_of("range")
@pixel_kernel
def counts_to_another_number(first_pixel: int, last: int, mirrors: Mirrors, film: wp.array(dtype=float)):
    total = float(0.0)
    for sample in range(0, last + 1):
        ray = Ray()
        total += spmd_example.trace(mirrors, ray, sample, 4)
    film[first_pixel + wp.tid()] = total


@kernel_of("unmarked")
def has_no_mark(first_pixel: int, last: int, mirrors: Mirrors, film: wp.array(dtype=float)):
    total = float(0.0)
    for sample in range(0, last):
        ray = Ray()
        total += spmd_example.trace(mirrors, ray, sample, 4)
    film[first_pixel + wp.tid()] = total


@pytest.mark.parametrize(
    ("kernel", "told"),
    [
        (calls_it_twice, r"calls_it_twice: must call trace once"),
        (does_more_behind_it, r"does_more_behind_it: must call trace once in its loop over samples, .*last of nested"),
        (counts_to_another_number, r"counts_to_another_number: must loop over samples"),
        (has_no_mark, r"has_no_mark: is not marked with @pixel_kernel"),
    ],
    ids=lambda value: getattr(value, "key", ""),
)
def test_a_kernel_that_breaks_a_demand_is_refused(kernel: Any, told: str) -> None:
    with pytest.raises(Unsupported, match=told):
        wide_code(kernel, 16)


def test_place_holders_without_a_value_are_noticed() -> None:
    with pytest.raises(ValueError, match=r"part\.h: \['ANSWER', 'CODE'"):
        fill("part.h", LOOP="while_0")
