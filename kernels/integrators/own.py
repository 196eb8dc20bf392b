"""Integrators from outside the package: their registry, their numbers, and the function that calls them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.registry import Registry
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.core.spmd_marks import inline_stage, traces_alone
from wrt.kernels.integrators.path_state import PathResult, PathSettings
from wrt.kernels.integrators.toolbox import Tools, make_tools
from wrt.kernels.sampling.sampler import Sampler

_TYPES: dict[str, Any] = {"bool": bool, "int": int, "float": float, "color": wp.vec3}


class OwnIntegrator(NamedTuple):
    """An integrator from outside.

    Attributes:
        make: (Tools) -> the device function (scene, ray, footprint, sampler, settings, numbers) -> PathResult.
        Numbers: the struct of its numbers.
        example: what `make` returns for one set of features, by which versions of the code are told apart.
    """

    make: Callable[[Tools], wp.Function]
    Numbers: Any
    example: wp.Function


def own_integrator(name: str, make: Callable[[Tools], Any], kinds: dict[str, str]) -> OwnIntegrator:
    """Return the integrator with numbers of these kinds, "bool", "int", "float" or "color".

    Raises:
        ValueError: if what `make` returns is no device function with the arguments of an integrator.
    """
    Numbers: Any = wp.struct(type(f"Numbers_{name}", (), {"__annotations__": {k: _TYPES[v] for k, v in kinds.items()}}))
    try:
        example: Any = make(make_tools(Features(("diffuse",), False, "none"))._replace(Numbers=Numbers))
    except NameError as error:
        raise ValueError(f"{error}; its file must not have `from __future__ import annotations`") from None
    expected = [SceneData, Ray, wp.vec2, Sampler, PathSettings, Numbers]
    if not isinstance(example, wp.Function):
        raise ValueError(f"make_trace must return a function with @wp.func, not {type(example).__name__}")
    if list(example.input_types.values()) != expected or example.adj.arg_types.get("return") is not PathResult:
        words = "(scene: SceneData, ray: Ray, footprint: wp.vec2, sampler: Sampler, settings: PathSettings, numbers: "
        raise ValueError(f"the function must be {words}tools.Numbers) -> PathResult, not {_described(example)}")
    return OwnIntegrator(make, Numbers, example)


def _described(function: Any) -> str:
    """Return the arguments and the result of a function as it has them."""
    kinds = function.adj.arg_types
    names = [f"{name}: {_name_of(kinds[name])}" if name in kinds else name for name in function.input_types]
    return f"({', '.join(names)}) -> {_name_of(kinds.get('return'))}"


def _name_of(kind: Any) -> str:
    return str(getattr(kind, "key", None) or getattr(kind, "__name__", kind)).rpartition(".")[2]


OWN_INTEGRATORS: Registry[OwnIntegrator] = Registry({}, lambda name, model: None)


@specialised()
def make_trace_own(features: Features) -> wp.Function:
    """Return the device function that calls the integrator of `Features.integrator`."""
    make, Numbers, _ = OWN_INTEGRATORS.model_of(features.integrator)  # noqa: N806
    trace = make(make_tools(features)._replace(Numbers=Numbers))
    inline_stage(trace.func)  # if it returns once: see `wrt/spmd/translate.py`

    @wp.func_native(f"return wp::array_t<{Numbers.native_name}>(({Numbers.native_name}*)memory.data, 1);")
    def numbers_in(memory: wp.array(dtype=float)) -> wp.array(dtype=Numbers): ...

    @wp.func
    @traces_alone
    def trace_own(
        scene: SceneData, camera_ray: Ray, pixel_footprint: wp.vec2, sampler: Sampler, settings: PathSettings
    ) -> PathResult:
        return trace(scene, camera_ray, pixel_footprint, sampler, settings, numbers_in(settings.own)[0])

    return trace_own
