"""Factories of device functions: one function for all features that agree in what the factory reads, and no other."""

from __future__ import annotations

import ast
import dataclasses
from typing import Any

import pytest
from support.feature_sets import FEATURES
from test_kernel_style import KERNEL_FILES, decorators, name_of, tree_of

from wrt.kernels.features import Features, identifier
from wrt.kernels.lights.lights import make_lights
from wrt.kernels.render import make_render_kernel
from wrt.kernels.scene.materials import make_bsdf_at
from wrt.kernels.specialise import specialised

PLAIN = Features(("diffuse",), False, "none")


def test_equal_fields_share_one_result() -> None:
    assert make_bsdf_at(PLAIN) is make_bsdf_at(dataclasses.replace(PLAIN, sampler="sobol", media="absorbing"))
    assert make_bsdf_at(PLAIN) is not make_bsdf_at(dataclasses.replace(PLAIN, textured=True))
    assert make_lights(PLAIN) is make_lights(dataclasses.replace(PLAIN, models=("mirror",)))
    made = []

    @specialised()
    def make(first: str, second: int = 1) -> list[str]:
        made.append((first, second))
        return [first]

    assert make("a") is make("a")
    assert make("a") is not make("a", 2)
    assert made == [("a", 1), ("a", 2)]


def test_what_a_factory_does_not_declare_it_cannot_read() -> None:
    @specialised("models", "nested")
    def make_one(features: Features) -> Any:
        return features.models, features.nested

    @specialised("models")
    def make_other(features: Features) -> Any:
        return features.textured

    @specialised("models")
    def make_through(features: Features) -> Any:
        return make_one(features)

    @specialised("nested")
    def make_derived(features: Features) -> Any:
        return features.bodies

    assert make_one(PLAIN) == (("diffuse",), False)
    for make, field in ((make_other, "textured"), (make_through, "nested"), (make_derived, "media")):
        with pytest.raises(AttributeError, match=f"{make.__name__} does not declare .* {field!r}"):
            make(PLAIN)
    with pytest.raises(ValueError, match="no features texturd"):
        specialised("texturd")(lambda features: None)


@pytest.mark.parametrize("features", FEATURES, ids=lambda features: features.name)
def test_all_factories_declare_what_they_read(features: Features) -> None:
    """Each calls those below it, so a kernel of every tested set of features calls them all."""
    make_render_kernel(features)


def test_names_are_of_modules_and_tell_variants_apart() -> None:
    names = [make_render_kernel.module_name(features) for features in FEATURES]
    assert names[0] == "wrt.render.diffuse_plain_none"
    assert names == [make_render_kernel(features).module.name for features in FEATURES]
    assert len(set(names)) == len(names)
    assert all(name.replace(".", "_").isidentifier() and len(name) < 150 for name in names)
    assert identifier(["a:b-c", ("d", "e"), 1, True]) == "a_b_c_d_e_1_True"


@pytest.mark.parametrize("path", KERNEL_FILES, ids=name_of)
def test_factories_are_specialised(path: Any) -> None:
    """No factory keeps a cache of its own, and what declares device functions at each call is one of them."""
    tree = tree_of(path)
    if path.parent.name != "native":  # which keeps the texts of headers
        assert not {"functools.cache", "functools.lru_cache"} & {ast.unparse(node) for node in ast.walk(tree)}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("make_"):
            inner = [f for f in ast.walk(node) if isinstance(f, ast.FunctionDef) and f is not node]
            if any({"wp.func", "wp.kernel", "wp.func_native"} & set(decorators(f)) for f in inner):
                assert "specialised" in decorators(node), node.name
