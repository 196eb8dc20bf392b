"""Every kernel compiles for CUDA. NVRTC comes with Warp, so no GPU is needed."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType

import pytest
import warp as wp
from support.feature_sets import MODELS, SHADING, other_models
from support.films_of_devices import FILMS, OPTIONS, film_cases

import wrt
import wrt.kernels
from wrt.backend.warp_backend import initialize_warp
from wrt.kernels import regeneration
from wrt.kernels.accel.bvh import Bvh, bvh_any_hit, bvh_closest_hit
from wrt.kernels.bsdf.lobes.albedo import make_missing_kernel
from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel
from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel
from wrt.kernels.features import Features
from wrt.kernels.integrators import path
from wrt.kernels.integrators.path import has_panes
from wrt.kernels.integrators.registry import INTEGRATORS
from wrt.kernels.lights.shapes import BUILT_IN as LIGHT_SHAPES
from wrt.kernels.media.bodies import make_count_crossings
from wrt.kernels.regeneration import can_regenerate, make_gpu_render_kernel, make_regenerating_kernel
from wrt.kernels.render import CUDA_BOUNDS, make_render_kernel
from wrt.scene.scene import SAMPLERS

ARCHITECTURE = 75
"""Turing, the oldest that Warp supports. test_emulated_cuda.py compiles for Hopper."""

TABLE_KERNELS = (make_coat_kernel, make_missing_kernel, make_missing_dielectric_kernel)
FACTORIES = {
    ("wrt.kernels.render", "make_render_kernel"),
    ("wrt.kernels.regeneration", "make_regenerating_kernel"),
    ("wrt.kernels.media.bodies", "make_count_crossings"),
    *((f.__module__, f.__name__) for f in TABLE_KERNELS),
}
"""Functions that make kernels; each is called below."""

COMPILED = [
    # A loop for each path, as with layers, and all that it asks of the features itself.
    Features(
        ("dielectric", "diffuse", "null"),
        True,
        "image",
        opacity=True,
        instances="still",
        clamped=True,
        aovs=True,
        media="scattering",
        grid_media=True,
        nested=True,
    ),
    Features(
        ("diffuse", "null", "thin_dielectric"),
        False,
        "constant",
        aovs=True,
        media="absorbing",
        light_shapes=(*LIGHT_SHAPES, "projector", "projector:spot"),
    ),
    Features(("diffuse",), False, "none", composite="mixed", aovs=True),
    Features(("diffuse",), False, "none", instances="moving", exact="spheres"),
    Features(("diffuse",), False, "none", exact="quadrics", clamped=True, composite="mixed"),
    *SHADING,
    *(
        Features(("conductor", "dielectric"), True, "image", True, True, integrator=name)
        for name in INTEGRATORS
        if name not in ("path", "aov")
    ),
    Features(("diffuse",), False, "none", integrator="aov", aovs=True, guides=True),
]
"""What no kernel has that test_emulated_cuda.py compiles for its films; see test_every_feature_is_compiled."""

COMPILED.append(other_models(COMPILED))


def kernel_modules() -> Iterator[ModuleType]:
    yield wrt.kernels
    for found in pkgutil.walk_packages(wrt.kernels.__path__, "wrt.kernels."):
        yield importlib.import_module(found.name)


def declared_kernels() -> dict[str, wp.Kernel]:
    """Return every kernel at the top level of a module of the package, by name."""
    return {
        f"{module.__name__}.{name}": value
        for module in kernel_modules()
        for name, value in vars(module).items()
        if isinstance(value, wp.Kernel) and value.func.__module__ == module.__name__
    }


MODULES = sorted({kernel.module.name for kernel in declared_kernels().values()})


def compile_for_cuda(module: wp.Module, folder: Path, mode: str = "release") -> str:
    """Compile a module, check that no function is missing, and return its PTX."""
    initialize_warp()
    usual = module.options["mode"]
    module.options["mode"] = mode
    try:
        paths = wp.compile_aot_module(module, arch=ARCHITECTURE, module_dir=folder, use_ptx=True)
    finally:
        module.options["mode"] = usual
    assert [path.suffix for path in paths] == [".ptx"]
    text = paths[0].read_text()
    assert f".target sm_{ARCHITECTURE}" in text
    assert set(re.findall(r"^\.extern \.func .*?(\w+)$", text, re.MULTILINE)) <= {"vprintf", "__assertfail"}
    return text


@pytest.mark.parametrize("name", MODULES)
def test_modules_compile(name: str, tmp_path: Path) -> None:
    text = compile_for_cuda(wp.get_module(name), tmp_path)
    for kernel in declared_kernels().values():
        if kernel.module.name == name:
            assert f".visible .entry {kernel.get_mangled_name()}" in text


@pytest.mark.slow
@pytest.mark.parametrize("features", COMPILED, ids=lambda features: features.name)
def test_render_kernels_compile(features: Features, tmp_path: Path) -> None:
    kernel = make_gpu_render_kernel(features)
    # NVRTC's optimizer takes up to a minute and refuses nothing that its front end accepts.
    text = compile_for_cuda(kernel.module, tmp_path, mode="debug")
    assert f".visible .entry {kernel.get_mangled_name()}" in text
    assert "div.approx.ftz.f32" in text
    assert "div.rn.f32" not in text


VALUES = {
    "environment": ("none", "constant", "image"),
    "sampler": SAMPLERS,
    "instances": ("none", "still", "moving", "deforming"),
    "integrator": tuple(INTEGRATORS),
    "media": ("none", "absorbing", "scattering"),
    "composite": ("none", "sides", "mixed"),
    "exact": ("none", "spheres", "quadrics"),
    "models": MODELS,
    "light_shapes": (*LIGHT_SHAPES, "projector", "projector:spot"),
}
"""What each feature can be that is not true or false; names that a kernel can have several of are listed one by one."""

ASKED = "media", "grid_media", "nested", "opacity", "mixed", "clamped", "light_shapes", "geometry", "models"
"""The features that the loops along a path ask for: the rest is in functions that both loops call."""


def values_of(features: Features) -> set[tuple[str, object]]:
    """Return the names and values of features; tuples value by value."""
    pairs = [(field.name, getattr(features, field.name)) for field in fields(features)]
    return {(name, each) for name, value in pairs for each in (value if isinstance(value, tuple) else (value,))}


@pytest.mark.slow
def test_every_feature_is_compiled(render_kernels_when_launched: None) -> None:
    """Here or for a film of test_emulated_cuda.py; and what the loops along a path ask for, in both loops."""
    known, made = film_cases(), list(COMPILED)
    for name in FILMS:
        options = OPTIONS.get(name, known[name].options)
        renderer = wrt.Renderer(known[name].make(), **{**options, "width": 8, "height": 8, "device": "cpu"})
        made.append(renderer._kernel._features)
    chosen = {"cameras", "slot_loop", "shadows_meet", "tiles"}  # from outside, and by `make_gpu_render_kernel`
    flags = {field.name for field in fields(Features)} - {*VALUES, *chosen}
    asked = {(name, value) for name, values in VALUES.items() for value in values}
    asked |= {(name, value) for name in flags for value in (False, True)}
    assert set().union(*map(values_of, made)) >= asked
    loops = [features for features in made if features.integrator == "path"]
    for loop in ([each for each in loops if can_regenerate(each) is regenerates] for regenerates in (False, True)):
        found = set().union(*map(values_of, loop))
        assert {pair for pair in asked if pair[0] in ("media", "grid_media", "nested", "opacity", "clamped")} <= found
        assert {True, False} == {features.mixed for features in loop} == {bool(each.light_shapes) for each in loop}
        assert {True, False} == {has_panes(features.models) for features in loop}


def test_the_loop_asks_for_nothing_else() -> None:
    asked: set[str] = set()
    for module in (path, regeneration):
        asked |= set(re.findall(r"\bfeatures\.(\w+)", Path(str(module.__file__)).read_text(encoding="utf-8")))
    # The source of random numbers is a function too, bodies are media or nested, and layers have no such kernel.
    assert asked - {"sampler", "bodies", "integrator", "aovs"} == set(ASKED)


def test_render_kernels_are_bound_to_the_blocks_that_are_launched() -> None:
    """A GPU refuses a launch of larger blocks than a kernel is bound to."""
    makes = (make_render_kernel, make_regenerating_kernel)
    for kernel in (make(features) for features in COMPILED for make in makes):
        assert kernel.options["launch_bounds"] == CUDA_BOUNDS
        assert CUDA_BOUNDS[0] == kernel.module.options["block_dim"]


def test_kernels_for_gpus_alone_divide_approximately_whoever_made_them() -> None:
    # No other test makes kernels of these features.
    features = Features(("diffuse",), False, "none", clamped=True, regularized=True)
    for kernel in (make_regenerating_kernel(features), make_render_kernel(replace(features, tiles=True))):
        assert kernel.module.options["fast_math"]
    assert not make_render_kernel(features).module.options["fast_math"]


def test_values_of_all_models_are_read_in_one_loop() -> None:
    plain = Features(("diffuse",), True, "none")
    assert make_gpu_render_kernel(plain) is make_regenerating_kernel(replace(plain, slot_loop=True))


def test_shadow_rays_have_no_way_out_before_they_are_traced_where_lights_may_have_holes() -> None:
    holes = Features(("diffuse",), True, "none", opacity=True)
    assert make_gpu_render_kernel(holes) is make_regenerating_kernel(replace(holes, slot_loop=True, shadows_meet=True))
    fog = replace(holes, media="absorbing")
    negative = "media would count a way of negative length"
    assert make_gpu_render_kernel(fog) is make_regenerating_kernel(replace(fog, slot_loop=True)), negative


def test_threads_of_a_gpu_take_pixels_tile_by_tile_with_every_kernel() -> None:
    plain = Features(("diffuse",), False, "none")
    for features in (replace(plain, aovs=True), *(replace(plain, integrator=name) for name in ("ao", "whitted"))):
        assert make_gpu_render_kernel(features) is make_render_kernel(replace(features, slot_loop=True, tiles=True))
    of_paths = make_gpu_render_kernel(plain, regenerates=False)
    assert of_paths is make_render_kernel(replace(plain, slot_loop=True, tiles=True))


def test_no_source_asks_for_the_architecture() -> None:
    for file in Path(wrt.kernels.__file__).parent.rglob("*.[hp]*"):
        if file.suffix in (".h", ".py"):
            assert not re.search(r"__CUDA_ARCH__\s*[<>=)]*\s*[<>=]", file.read_text(encoding="utf-8")), file


@pytest.mark.slow
@pytest.mark.parametrize("instances", ["none", "still", "deforming"])
def test_kernels_that_look_around_compile(instances: str, tmp_path: Path) -> None:
    compile_for_cuda(make_count_crossings(instances).module, tmp_path)


@pytest.mark.parametrize("make_kernel", TABLE_KERNELS, ids=lambda make_kernel: make_kernel.__name__)
def test_kernels_of_tables_compile(make_kernel: Callable[[str, str], wp.Kernel], tmp_path: Path) -> None:
    compile_for_cuda(make_kernel("ggx", "smith").module, tmp_path)


@wp.kernel(enable_backward=False, module="test_cuda_compile.rays")
def rays(bvh: Bvh, origins: wp.array(dtype=wp.vec3), directions: wp.array(dtype=wp.vec3), out: wp.array(dtype=float)):
    i = wp.tid()
    hit = bvh_closest_hit(bvh, origins[i], directions[i], 0.0, 1.0e30)
    if not bvh_any_hit(bvh, origins[i], directions[i], 0.0, hit.t):
        out[i] = hit.t


def test_rays_compile(tmp_path: Path) -> None:
    compile_for_cuda(rays.module, tmp_path)


@wp.func_native("return __builtin_elementwise_max(a, 1.0f);")
def clang_only(a: float) -> float: ...


@wp.kernel(enable_backward=False, module="test_cuda_compile.wrong")
def wrong(out: wp.array(dtype=float)):
    out[0] = clang_only(out[0])


def test_code_that_only_clang_knows_does_not_compile(tmp_path: Path) -> None:
    """The test above can fail."""
    with pytest.raises(Exception, match=r"CUDA|NVRTC|compile"):
        compile_for_cuda(wrong.module, tmp_path)


def test_no_kernel_is_left_out() -> None:
    """What is written with @wp.kernel is in a module compiled above, or a factory called above."""
    top_level, made = set(), set()
    for module in kernel_modules():
        tree = ast.parse(Path(str(module.__file__)).read_text())
        for node in tree.body:
            for inner in ast.walk(node):
                if not isinstance(inner, ast.FunctionDef) or not any(is_kernel(d) for d in inner.decorator_list):
                    continue
                if inner is node:
                    top_level.add(f"{module.__name__}.{inner.name}")
                else:
                    made.add((module.__name__, getattr(node, "name", "")))
    assert top_level == set(declared_kernels())
    assert made == FACTORIES


def is_kernel(decorator: ast.expr) -> bool:
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return ast.unparse(called) == "wp.kernel"
