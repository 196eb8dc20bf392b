"""General kernels render scenes of other features with the bits of the scenes' own kernels."""

import dataclasses

import pytest
from PIL import Image
from support.caches import python, render_small, without_artefacts
from support.commands import CAMERA, QUAD
from support.covering_kernels import render_by
from support.digests import cases, film_digest, rendered
from support.wide_scenes import LANES, needs_lanes

import wrt
from wrt.compiling import general
from wrt.compiling.kernel import SCALAR, name_of_kernel
from wrt.kernels.bsdf import model_of
from wrt.kernels.core.features import PASSED_BY_LIGHT, Features
from wrt.rendering.guides import guide_features
from wrt.upload.materials import model_name

PLAIN = Features(("diffuse",), False, "none", sampler="sobol")
SMALL, LARGE, ALL = general.general_features(PLAIN)
GUIDES = general.general_features(guide_features(PLAIN, wrt.RenderSettings()))


def test_what_they_cover():
    for changes, expected in (
        ({}, [True, True, True]),
        ({"textured": True, "mipmapped": True, "uv2_alpha": True, "tangents": True}, [True, True, True]),
        ({"environment": "image", "light_tree": True, "composite": "sides"}, [True, True, True]),
        ({"models": ("diffuse", "plastic")}, [False, True, True]),
        ({"models": ("null",)}, [False, True, True]),
        ({"composite": "mixed"}, [False, True, True]),
        ({"composite": "holes"}, [False, True, True]),
        ({"models": ("somebodys",)}, [False, False, False]),
        ({"light_shapes": ("spot", "somebodys")}, [False, False, False]),
        ({"sampler": "independent"}, [True, True, True]),
        ({"sampler": "stratified"}, [False, False, False]),
        ({"instances": "still"}, [False, False, False]),
        ({"exact": "spheres"}, [False, False, True]),
        ({"clamped": True}, [False, False, True]),
        ({"media": "absorbing", "exact": "quadrics"}, [False, False, True]),
        ({"media": "scattering", "grid_media": True}, [False, False, True]),
        ({"media": "absorbing", "grid_media": True}, [False, False, False]),
        ({"media": "unscattered"}, [False, False, False]),
        ({"media": "absorbing", "nested": True}, [False, False, False]),
        ({"integrator": "whitted"}, [False, False, False]),
    ):
        scene = dataclasses.replace(PLAIN, **changes)
        assert [kernel.covers(scene) for kernel in (SMALL, LARGE, ALL)] == expected
        assert not PLAIN.covers(LARGE)
        for integrator in ("whitted", "ao"):  # which do not decide at run time
            plain, large = (dataclasses.replace(features, integrator=integrator) for features in (PLAIN, LARGE))
            assert [large.covers(plain), large.covers(large)] == [False, True]
    names = {model_name(material) for material in general.materials() if not material.parts}
    assert names == set(LARGE.models)
    assert {name for name in names if model_of(name).straight} == PASSED_BY_LIGHT
    assert {light.model for light in general.lights()} >= set(LARGE.light_shapes)


def test_the_best_that_is_compiled_is_chosen(monkeypatch):
    compiled = set()
    monkeypatch.setattr(general, "is_compiled", lambda features, lanes: name_of_kernel(features, lanes) in compiled)
    scalar, wide = name_of_kernel(PLAIN, 1), name_of_kernel(PLAIN, 16)
    generals = [name_of_kernel(kernel, 16) for kernel in (SMALL, LARGE, ALL)]
    for lanes, names, best in (
        (16, (scalar, wide, *generals), None),
        (16, (wide, *generals), PLAIN),
        (16, (scalar, *generals), SMALL),
        (16, (scalar,), None),
        (16, generals[1:], LARGE),
        (8, generals, None),
    ):
        compiled.clear()
        compiled.update(names)
        assert general.compiled_for(PLAIN, lanes) == best
    compiled.add(name_of_kernel(GUIDES[1], SCALAR))
    assert general.compiled_for(guide_features(PLAIN, wrt.RenderSettings()), 16) == GUIDES[1]


CASES = cases()
NOT_COVERED = "regularization"
"""The option of cases for which there are no general kernels."""
NAMES = (
    *("plain-perspective", "models-perspective", "textures-perspective", "picture-light-shapes"),
    *("picture-light-sky-evening", "picture-city", "picture-tutorial-light", "built-in-teapot"),
    *("panes-perspective", "picture-media-fog", "picture-media-cloud", "picture-particles", "built-in-still-life"),
)
INDEPENDENT = ("plain-perspective", "picture-media-fog")
"""Cases rendered with independent random numbers, the others with Sobol'."""


@pytest.mark.machinery
@pytest.mark.parametrize("name", NAMES)
def test_films_have_the_bits_of_the_scenes_kernel(name, monkeypatch):
    options = {key: value for key, value in CASES[name].options.items() if key != NOT_COVERED}
    sampler = "independent" if name in INDEPENDENT else "sobol"
    case = dataclasses.replace(CASES[name], options={**options, "sampler": sampler})
    expected = rendered(case)
    render_by(lambda features: general.general_features(features)[-1], monkeypatch)
    general_film = rendered(case)
    assert general_film._kernel.features != expected._kernel.features
    assert film_digest(general_film) == film_digest(expected)


COMPILE = """
import sys
import warp as wp
from wrt.compiling.general import exercise, general_features
from wrt.compiling.kernel import SCALAR, compile_kernel
from wrt.kernels.core.features import Features
from wrt.rendering.guides import guide_features
from wrt.scene.scene import RenderSettings
plain = Features(("diffuse",), False, "none", sampler="sobol")
compile_kernel(general_features(plain)[0], int(sys.argv[1]), exercise)
compile_kernel(general_features(guide_features(plain, RenderSettings()))[0], SCALAR, exercise)
"""

NEW = f"""{CAMERA}{QUAD}material = "painted"
[environment]
type = "constant"
[[lights]]
type = "spot"
position = [1, 1, 2]
direction = [-1, -1, -2]
intensity = 9.0
[materials.painted]
type = "principled"
base_color = {{ texture = "squares.png" }}
metallic = 0.5
"""


@needs_lanes
@pytest.mark.machinery
def test_a_new_kind_of_scene_needs_no_warp(tmp_path):
    variables = {**without_artefacts(tmp_path), "WRT_WIDE": ""}
    Image.new("RGB", (8, 8), (200, 60, 30)).save(tmp_path / "squares.png")
    (tmp_path / "new.toml").write_text(NEW)
    assert render_small(tmp_path, variables, "known.npy", "cornell-box") == (True, "")
    python(tmp_path, variables, "-c", COMPILE, str(LANES))
    without_general = {**variables, "XDG_CACHE_HOME": str(tmp_path / "other")}
    for name, options in (("film", []), ("smooth", ["--denoise"])):
        assert render_small(tmp_path, variables, f"{name}.npy", "new.toml", *options) == (False, "")
        assert render_small(tmp_path, without_general, f"own-{name}.npy", "new.toml", *options) == (True, "")
        assert (tmp_path / f"{name}.npy").read_bytes() == (tmp_path / f"own-{name}.npy").read_bytes()
