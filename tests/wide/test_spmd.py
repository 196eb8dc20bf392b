"""The SPMD translator: the example of docs/spmd.md, and its requirements. Films are in test_wide_films.py."""

from typing import Any

import pytest
import warp as wp
from support import spmd_example
from support.spmd_example import Mirrors, Ray, albedo_at, blocked, make_kernel, next_mirror

from wrt.kernels.core.spmd_marks import path_function
from wrt.spmd.ir import Unsupported
from wrt.spmd.library import library
from wrt.spmd.translate import wide_code


def test_the_example_is_translated() -> None:
    code = wide_code(make_kernel(spmd_example.trace, "whole"), 16)[len(library(16)) :]
    assert "struct steps_trace_0 {" in code
    assert "run<&Steps::part_2>(groups);" in code
    assert "$" not in code


# --- Requirements: each function below violates one ---------------------------------------------------


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
def test_a_path_function_that_violates_a_requirement_is_refused(path: Any, message: str) -> None:
    with pytest.raises(Unsupported, match=message):
        wide_code(make_kernel(path, path.key), 16)
