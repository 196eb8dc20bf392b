"""Integrators that are no paths of `path`, and those of users, run in wide kernels with the bits of scalar ones."""

from dataclasses import dataclass
from typing import Any

import pytest
import warp as wp
from benchmarks.own_integrators import OwnOcclusion, PlainPaths
from support.wide_scenes import CAMERAS, LANES, SCENES, differences, needs_lanes

import wrt
from wrt.kernels.core.features import Features
from wrt.kernels.integrators.own import OWN_INTEGRATORS
from wrt.kernels.integrators.toolbox import (
    BLOCK_BSDF,
    PathResult,
    PathSettings,
    Ray,
    Sampler,
    SceneData,
    Tools,
    to_world,
    vertex_block,
)
from wrt.kernels.render import make_render_kernel
from wrt.scene.integrators import INTEGRATORS
from wrt.spmd.ir import Unsupported
from wrt.spmd.translate import wide_code


@pytest.fixture(autouse=True)
def registers() -> Any:
    """Leave the register as it was found, with the integrators of `sketches`."""
    before = set(INTEGRATORS)
    import sketches  # which registers them

    for cls in (OwnOcclusion, PlainPaths, Counting, sketches.HeatMap, sketches.DepthCue, sketches.Toon):
        wrt.register_integrator(cls)
    yield
    for name in set(INTEGRATORS) - before:
        del INTEGRATORS[name]
        OWN_INTEGRATORS.forget(name.replace("-", "_"))


@wp.func
def weight_of(k: int, t: float) -> float:
    if k % 2 == 0:
        return wp.erf(t)
    for j in range(3 + k):
        if float(j) > t:
            break
    return 1.0 / (1.0 + float(j))


@dataclass(frozen=True)
class Counting(wrt.Integrator):
    """Distances along a path, by a `for` loop whose counter is used after it, and a function without a wide version."""

    most: int = 5
    tint: tuple[float, float, float] = (0.5, 1.0, 0.25)

    type_name = "counting"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        @wp.func
        def trace(
            scene: SceneData,
            ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            result = PathResult()
            along = ray
            for k in range(numbers.most):
                hit = tools.closest_hit(scene, along)
                result.rays += 1
                if hit.triangle < 0:
                    break
                surface = tools.surface_at(scene, along, hit)
                along.origin = surface.position
                if k == 2:
                    continue
                u = tools.random(sampler, vertex_block(k + 1, BLOCK_BSDF))
                along.direction = wp.normalize(to_world(surface.frame, wp.vec3(u[0] - 0.5, u[1] - 0.5, u[2] + 0.1)))
                result.radiance += numbers.tint * weight_of(k, hit.t)
            result.radiance += wp.vec3(float(k))
            return result

        return trace


EVERY_KIND = ("own-ao", "plain-paths", "counting")
"""Called as a whole; in rounds of a `while`, and of a `for`."""


@needs_lanes
@pytest.mark.parametrize(
    ("integrator", "name", "lanes"),
    [
        *(pytest.param(name, "plain", LANES, marks=pytest.mark.slow) for name in ("ao", *EVERY_KIND)),
        *(
            pytest.param(name, "textures", lanes, marks=pytest.mark.machinery)
            for name in ("ao", "whitted", *EVERY_KIND, "heat-map", "depth-cue", "toon")
            for lanes in (8, 16)
        ),
    ],
)
def test_the_same_bits(integrator: str, name: str, lanes: int) -> None:
    make, options, cameras = SCENES[name]
    scene = make()
    scene.camera = CAMERAS[cameras[0]]
    kept = {key: value for key, value in options.items() if key == "crop"}
    assert differences(scene, lanes=lanes, integrator=integrator, max_depth=5, **kept) == []


def translated(integrator: str) -> str:
    name = OWN_INTEGRATORS.current_name(integrator.replace("-", "_"))
    features = Features(("diffuse",), False, "constant", integrator=name)
    return wide_code(make_render_kernel(features), 16)


@pytest.mark.parametrize("integrator", ["plain-paths", "heat-map", "own-ao"])
def test_a_loop_along_a_path_is_cut_into_rounds_and_unused_surfaces_cost_nothing(integrator: str) -> None:
    code = translated(integrator)
    assert ("run<&Steps::part_0>(groups);" in code) == (integrator != "own-ao")
    if integrator == "own-ao":  # it reads no BSDF
        assert "make_load__locals__load_0(var_scene," not in code


@dataclass(frozen=True)
class Printing(wrt.Integrator):
    """Black, and a line for each sample."""

    type_name = "printing"

    @staticmethod
    def make_trace(tools: Tools) -> Any:
        @wp.func
        def trace(
            scene: SceneData,
            ray: Ray,
            footprint: wp.vec2,
            sampler: Sampler,
            settings: PathSettings,
            numbers: tools.Numbers,
        ) -> PathResult:
            print(ray.time)
            return PathResult()

        return trace


def test_what_cannot_be_translated_is_named_with_what_to_write_instead() -> None:
    wrt.register_integrator(Printing)
    expected = r"test_wide_integrators\.py:\d+: .*trace: `print\(ray\.time\)`: a function prints; leave that out"
    with pytest.raises(Unsupported, match=expected):
        translated("printing")
