"""Every kernel compiles for CUDA. NVRTC comes with Warp, so no GPU is needed."""

import ast
import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
import warp as wp
from benchmarks.own import OwnBall, ball
from conftest import ROOT
from support.feature_sets import FEATURES, MODELS, SHADING, declared_kernels, kernel_modules
from support.films_of_devices import FILMS, OPTIONS, film_cases

import wrt
import wrt.kernels
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.bsdf import caster_name, models_with
from wrt.kernels.bsdf.arrays import kernels_of
from wrt.kernels.bsdf.lobes.albedo import make_missing_kernel
from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel
from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel
from wrt.kernels.core.features import Features, identifier
from wrt.kernels.geometry.distances import DISTANCES, current_name
from wrt.kernels.gradients.gradient_pass import make_gradient_kernel
from wrt.kernels.integrators.own import OWN_INTEGRATORS
from wrt.kernels.integrators.photons import make_photon_kernel
from wrt.kernels.integrators.registry import INTEGRATORS
from wrt.kernels.lights.shapes import BUILT_IN as LIGHT_SHAPES
from wrt.kernels.media.bodies import make_count_crossings
from wrt.kernels.regeneration import can_regenerate, make_gpu_render_kernel, make_regenerating_kernel
from wrt.kernels.render import CUDA_BOUNDS, make_render_kernel
from wrt.scene.exact.distances import SHAPES
from wrt.scene.integrators import INTEGRATORS as INTEGRATORS_OF_SCENES
from wrt.scene.scene import SAMPLERS

ARCHITECTURE = 75
"""Turing, the oldest that Warp supports. test_cuda_films.py compiles for Hopper."""

TABLE_KERNELS = (make_coat_kernel, make_missing_kernel, make_missing_dielectric_kernel)
FACTORIES = {
    ("wrt.kernels.render", "make_render_kernel"),
    ("wrt.kernels.regeneration", "make_regenerating_kernel"),
    ("wrt.kernels.media.bodies", "make_count_crossings"),
    ("wrt.kernels.integrators.photons", "make_photon_kernel"),
    ("wrt.kernels.gradients.gradient_pass", "make_gradient_kernel"),
    ("wrt.kernels.bsdf.arrays", "kernels_of"),
    *((f.__module__, f.__name__) for f in TABLE_KERNELS),
}
"""Functions that make kernels; each is called below."""

ALL_LIGHTS = (*LIGHT_SHAPES, "projector", "projector:spot")
ALL_TEXTURES = ("bricks", "checkerboard", "perlin", "worley")

THREE = [
    # A loop for each path, as with layers, and all that it asks of the features itself.
    Features(
        ("dielectric", "diffuse", "null"),
        True,
        "image",
        composite="holes",
        instances="still",
        clamped=True,
        aovs=True,
        media="scattering",
        grid_media=True,
        nested=True,
        light_groups=True,
        single_sided=True,
        edges="surfaces",
    ),
    # One loop that begins paths together.
    Features(
        ("diffuse", "thin_dielectric"),
        True,
        "constant",
        light_tree=True,
        tangents=True,
        composite="mixed",
        uv2_alpha=True,
        mipmapped=True,
        procedures=ALL_TEXTURES,
        clamped=True,
        regularized=True,
        instances="deforming",
        exact="quadrics",
        light_shapes=ALL_LIGHTS,
    ),
    Features(("diffuse", "mirror"), False, "none", integrator="whitted"),
]
"""Together all features that are on or off, and the loops of all kinds of integrators."""

CAUSTICS = Features(
    ("dielectric", "diffuse", "plastic", caster_name("rough_conductor:ggx:smith:conductor"), "thin_dielectric"),
    False,
    "constant",
    media="absorbing",
    light_shapes=ALL_LIGHTS,
    exact="quadrics",
    caustics=True,
    instances="moving",
    light_groups=True,
)
"""A kernel that gathers photons, and the one that follows them."""

COMPILED = [
    *THREE,
    CAUSTICS,
    Features(
        ("diffuse", "null", "thin_dielectric"), False, "constant", aovs=True, media="absorbing", light_shapes=ALL_LIGHTS
    ),
    Features(("diffuse",), False, "none", integrator="aov", aovs=True, guides=True),
    Features(("diffuse",), False, "none", integrator="aov", aovs=True, edges="wires"),
    *(f for f in FEATURES if f.integrator not in ("path", "aov") or f.exact == "spheres" or f.composite == "mixed"),
    *SHADING,
    FEATURES[-1],
]
"""What no kernel has that test_cuda_films.py compiles for its films; see test_every_feature_is_compiled."""

ON_CPUS = {"wrt.kernels.files.obj_text"}
"""Modules that no GPU runs, with integers of 128 bits."""

MODULES = sorted({kernel.module.name for kernel in declared_kernels().values()} - ON_CPUS)


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


@pytest.mark.parametrize(
    "features",
    [pytest.param(f, marks=pytest.mark.slow if f in THREE else pytest.mark.machinery, id=f.name) for f in COMPILED],
)
def test_render_kernels_compile(features, tmp_path):
    kernel = make_gpu_render_kernel(features)
    # NVRTC's optimizer takes up to a minute and refuses nothing that its front end accepts.
    text = compile_for_cuda(kernel.module, tmp_path, mode="debug")
    assert f".visible .entry {kernel.get_mangled_name()}" in text
    assert "div.approx.ftz.f32" in text
    assert "div.rn.f32" not in text


@pytest.mark.slow
def test_integrators_from_outside_compile(tmp_path):
    """With all that their tools have, and numbers of all kinds."""
    names = wrt.load_models(ROOT / "scripts" / "sketches.py")
    try:
        for name in names:
            integrator = OWN_INTEGRATORS.current_name(name.replace("-", "_"))
            features = replace(THREE[1], clamped=False, regularized=False, aovs=False, integrator=integrator)
            compile_for_cuda(make_gpu_render_kernel(features).module, tmp_path, mode="debug")
    finally:
        for name in names:
            del INTEGRATORS_OF_SCENES[name]
            OWN_INTEGRATORS.forget(name.replace("-", "_"))


@pytest.mark.machinery
def test_render_kernels_with_a_distance_function_compile(tmp_path):
    wrt.register_shape(OwnBall, ball)
    try:
        exact = f"quadrics-{current_name('own_ball')}"
        test_render_kernels_compile(replace(FEATURES[0], instances="moving", exact=exact, aovs=True), tmp_path)
    finally:
        del SHAPES[OwnBall.type_name]
        DISTANCES.forget("own_ball")


GLASS = Features(("dielectric", "diffuse", "plastic"), True, "image", media="absorbing")


@pytest.mark.machinery
@pytest.mark.parametrize(
    ("features", "part"), [(THREE[0], "both"), (THREE[1], "both"), (GLASS, "index")], ids=("loop", "one-loop", "index")
)
def test_gradient_kernels_compile(features, part, tmp_path):
    """The sums are of 64-bit integers, added atomically."""
    kernel = make_gradient_kernel(replace(features, clamped=False, aovs=False), part)
    text = compile_for_cuda(kernel.module, tmp_path, mode="debug")
    assert f".visible .entry {kernel.get_mangled_name()}" in text
    assert re.search(r"(atom|red)\.(global\.)?add\.u64", text)


@pytest.mark.machinery
@pytest.mark.parametrize("name", MODULES)
def test_modules_compile(name, tmp_path):
    text = compile_for_cuda(wp.get_module(name), tmp_path)
    for kernel in declared_kernels().values():
        if kernel.module.name == name:
            assert f".visible .entry {kernel.get_mangled_name()}" in text


def kernel_over_arrays(model: str) -> wp.Kernel:
    """Return one of the kernels of a model for checks; the other is in its module."""
    return kernels_of(model).evaluate


OTHERS = [(make_count_crossings, instances) for instances in ("none", "still", "deforming")]
OTHERS += [(make_kernel, "ggx", "smith") for make_kernel in TABLE_KERNELS]
OTHERS += [(make_photon_kernel, CAUSTICS), (kernel_over_arrays, "diffuse")]


@pytest.mark.machinery
@pytest.mark.parametrize("made", OTHERS, ids=lambda made: identifier((made[0].__name__, *made[1:])))
def test_kernels_of_other_passes_compile(made, tmp_path):
    make_kernel, *arguments = made
    compile_for_cuda(make_kernel(*arguments).module, tmp_path)


VALUES = {
    "environment": ("none", "constant", "image"),
    "sampler": SAMPLERS,
    "instances": ("none", "still", "moving", "deforming"),
    "integrator": tuple(INTEGRATORS),
    "media": ("none", "absorbing", "scattering"),
    "composite": ("none", "sides", "mixed", "holes"),
    "exact": ("none", "spheres", "quadrics"),
    "edges": ("none", "surfaces", "wires"),
    "models": MODELS,
    "light_shapes": ALL_LIGHTS,
    "procedures": ALL_TEXTURES,
}
"""What each feature can be that is not true or false; names that a kernel can have several of are listed one by one."""


CHOSEN = {"cameras", "gpu"}
"""A feature from outside, and the one that `make_gpu_render_kernel` sets."""

FLAGS = {field.name for field in fields(Features)} - {*VALUES, *CHOSEN}


def values_of(features: Features) -> set[tuple[str, object]]:
    """Return the names and values of features; tuples value by value."""
    pairs = [(field.name, getattr(features, field.name)) for field in fields(features)]
    return {(name, each) for name, value in pairs for each in (value if isinstance(value, tuple) else (value,))}


@pytest.mark.machinery
def test_every_feature_is_compiled(render_kernels_when_launched):
    """Here or for a film of test_cuda_films.py; and what the loops along a path ask for, in both loops."""
    films, made = film_cases(), list(COMPILED)
    for name in FILMS:
        options = OPTIONS.get(name, films[name].options)
        renderer = wrt.Renderer(films[name].make(), **{**options, "width": 8, "height": 8, "device": "cpu"})
        made.append(renderer._kernel.features)
    pairs = {(name, value) for name, values in VALUES.items() for value in values}
    pairs |= {(name, value) for name in FLAGS for value in (False, True)}
    assert set().union(*map(values_of, made)) >= pairs
    loops = [features for features in made if features.integrator == "path"]
    for loop in ([each for each in loops if can_regenerate(each) is regenerates] for regenerates in (False, True)):
        found = set().union(*map(values_of, loop))
        assert {pair for pair in pairs if pair[0] in ("media", "grid_media", "nested", "clamped")} <= found
        assert {True, False} == {features.has_holes for features in loop}
        assert {True, False} == {features.mixed for features in loop} == {bool(each.light_shapes) for each in loop}
        assert {True, False} == {bool(models_with(features.models, "straight")) for features in loop}


def test_no_kernel_is_left_out():
    """What is written with @wp.kernel is in a module compiled above, or a factory called above."""

    def is_kernel(decorator):
        called = decorator.func if isinstance(decorator, ast.Call) else decorator
        return ast.unparse(called) == "wp.kernel"

    top_level, made = set(), set()
    for module in kernel_modules():
        for node in ast.parse(Path(str(module.__file__)).read_text()).body:
            for inner in ast.walk(node):
                if isinstance(inner, ast.FunctionDef) and any(is_kernel(d) for d in inner.decorator_list):
                    if inner is node:
                        top_level.add(f"{module.__name__}.{inner.name}")
                    else:
                        made.add((module.__name__, getattr(node, "name", "")))
    assert top_level == set(declared_kernels())
    assert made == FACTORIES


PLAIN = Features(("diffuse",), False, "none")


def test_kernels_for_gpus_are_bound_to_their_blocks_and_divide_approximately():
    """A GPU refuses a launch of larger blocks than a kernel is bound to."""
    for make in (make_render_kernel, make_regenerating_kernel):
        kernel = make(PLAIN)
        assert kernel.options["launch_bounds"] == CUDA_BOUNDS
        assert CUDA_BOUNDS[0] == kernel.module.options["block_dim"]
    # No other test makes kernels of these features.
    features = replace(PLAIN, clamped=True, regularized=True)
    for kernel in (make_regenerating_kernel(features), make_render_kernel(replace(features, gpu=True))):
        assert kernel.module.options["fast_math"]
    assert not make_render_kernel(features).module.options["fast_math"]
    assert make_gpu_render_kernel(PLAIN) is make_regenerating_kernel(replace(PLAIN, gpu=True))


def test_no_source_asks_for_the_architecture():
    for file in Path(wrt.kernels.__file__).parent.rglob("*.[hp]*"):
        if file.suffix in (".h", ".py"):
            assert not re.search(r"__CUDA_ARCH__\s*[<>=)]*\s*[<>=]", file.read_text(encoding="utf-8")), file
