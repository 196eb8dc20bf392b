"""One kernel for each set of features: never two for one set, never one for two; and what factories read of them."""

import ast
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from support.feature_sets import FEATURES
from support.small_scenes import LAMP, block_scene, finish, image_of
from warp._src.context import user_modules

import wrt
from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.kernels import native
from wrt.kernels.core.features import Features, identifier
from wrt.kernels.core.specialise import specialised
from wrt.kernels.render import make_render_kernel
from wrt.upload.scene_data import SceneUpload

PLAIN = Features(("diffuse",), False, "none")


def test_names_are_of_modules_and_tell_variants_apart():
    names = [make_render_kernel.module_name(features) for features in FEATURES]
    assert names[0] == "wrt.render.diffuse_plain_none"
    assert names == [make_render_kernel(features).module.name for features in FEATURES]
    assert all(name.replace(".", "_").isidentifier() and len(name) < 150 for name in names)
    assert len(set(names)) == len(names)
    models = [m for n in (1, 2) for m in itertools.combinations(("conductor", "dielectric", "diffuse", "mirror"), n)]
    variants = itertools.product(models, (False, True), ("none", "constant", "image"))
    assert len({Features(*each).name for each in variants}) == 6 * len(models)
    assert identifier(["a:b-c", ("d", "e"), 1, True]) == "a_b_c_d_e_1_True"


def scene(*materials: wrt.Material, environment: object = None) -> wrt.Scene:
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    result.environment = environment or wrt.ConstantEnvironment(1.0)
    for i, material in enumerate(materials):
        result.add(wrt.quad((-9, -9, -i), (18, 0, 0), (0, 18, 0)), material=material)
    return result


def test_scenes_state_what_they_use():
    image = wrt.ImageEnvironment(np.ones((2, 4, 3), np.float32))
    texture = wrt.ImageTexture(np.ones((2, 2, 3), np.float32))
    expected = [
        (Features(("diffuse",), False, "constant"), scene(wrt.Diffuse())),
        # Values, sizes and numbers of shapes make no variant.
        (Features(("diffuse",), False, "constant"), scene(wrt.Diffuse(0.1), wrt.Diffuse(0.9))),
        (Features(("diffuse", "mirror"), False, "constant"), scene(wrt.Mirror(), wrt.Diffuse(), wrt.Mirror(0.5))),
        (Features(("conductor", "dielectric"), False, "constant"), scene(wrt.Dielectric(), wrt.Conductor())),
        (Features(("diffuse",), True, "constant"), scene(wrt.Diffuse(texture))),
        (Features(("mirror",), True, "constant"), scene(wrt.Mirror(wrt.VertexColor()))),
        (Features(("diffuse",), False, "image"), scene(wrt.Diffuse(), environment=image)),
        (PLAIN, scene(wrt.Diffuse(), environment=wrt.ConstantEnvironment(0.0))),
    ]
    for features, target in expected:
        assert SceneUpload(target, Device("cpu")).features == features


def loaded() -> set[str]:
    """Return the compiled files for the CPU, and the builds of modules for GPUs, that are ready to run."""
    on_gpus = {f"{name} {key}" for name, module in user_modules.items() for key in module.execs}
    return on_gpus | current_backend().artefacts.loaded


@pytest.mark.slow
def test_a_new_scene_of_seen_features_loads_nothing(device):
    """Other meshes, sizes, values, numbers of lights, depths and seeds."""

    def scene_with(subdivisions, lamps):
        lights = [wrt.PointLight((k - 1.0, 3.0, 1.0), intensity=4.0) for k in range(lamps)]
        return block_scene(shapes=[wrt.Shape(wrt.sphere(subdivisions=subdivisions)), LAMP], lights=lights)

    options = {"device": device, "light_choice": "power"}
    finish(wrt.Renderer(scene_with(4, 1), **options, width=16, height=12), 2)
    before = loaded()
    for kernels in ("wrt.render." if device == "cpu" else "wrt.regenerating.", "wrt.kernels.accel.build.split"):
        assert any(kernels in name for name in before)
    options |= {"width": 23, "height": 9, "seed": 7, "max_depth": 5}
    assert image_of(wrt.Renderer(scene_with(5, 3), **options), 2).max() > 0.0
    assert loaded() == before


def test_what_a_factory_does_not_declare_it_cannot_read():
    @specialised("models", "nested")
    def make_one(features):
        return features.models, features.nested

    @specialised("models")
    def make_through(features):
        return make_one(features)

    @specialised("nested")
    def make_derived(features):
        return features.bodies

    assert make_one(PLAIN) == (("diffuse",), False)
    for make, field in ((make_through, "nested"), (make_derived, "media")):
        with pytest.raises(AttributeError, match=f"{make.__name__} does not declare .* {field!r}"):
            make(PLAIN)
    with pytest.raises(ValueError, match="no features texturd"):
        specialised("texturd")(lambda features: None)


def test_what_declares_device_functions_at_each_call_is_specialised():
    """Else one process would have several functions for the same features, and their modules other hashes."""
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("make_"):
                inner = [f for f in ast.walk(node) if isinstance(f, ast.FunctionDef) and f is not node]
                decorators = {ast.unparse(each).partition("(")[0] for f in inner for each in f.decorator_list}
                if decorators & {"wp.func", "wp.kernel", "wp.func_native"}:
                    assert any(ast.unparse(each).startswith("specialised") for each in node.decorator_list), node.name


def test_headers_are_whole_and_have_the_constants_of_python():
    """Warp hashes the text that a module gets; `tests/cuda/test_cuda_compile.py` compiles it."""
    folder = Path(native.__file__).parent
    for name in sorted(str(path.relative_to(folder)) for path in folder.rglob("*.h")):
        text = native.text_of(name)
        assert "#include" not in text
        assert str(ROOT) not in text
        assert len(re.findall(r"^#ifndef WRT_\w+_H$", text, re.MULTILINE)) == len(set(native.headers_of(name)))
    text = native.constants_header()
    assert f"constexpr int NODE_FLOATS = {native.constants.NODE_FLOATS};" in text
    assert f"constexpr double BOX_PAD = {native.constants.BOX_PAD};" in text
