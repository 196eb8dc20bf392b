"""User-defined integrators: their pictures are those of built-in ones, and whatever renders knows them."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from benchmarks.own_integrators import OwnOcclusion, PlainPaths
from conftest import ROOT
from support.commands import run
from support.small_scenes import block_scene, finish, rendered
from support.statistics import image_z_test

import wrt
from wrt.gradients.renderers import Differentiable
from wrt.kernels.integrators.own import OWN_INTEGRATORS
from wrt.kernels.integrators.toolbox import PathResult, PathSettings, Ray, Sampler, SceneData, Tools
from wrt.scene.integrators import INTEGRATORS


@pytest.fixture(scope="module", autouse=True)
def registers() -> Any:
    """Leave the register as it was found."""
    before = set(INTEGRATORS)
    yield
    for name in set(INTEGRATORS) - before:
        del INTEGRATORS[name]
        OWN_INTEGRATORS.forget(name.replace("-", "_"))


@dataclass(frozen=True)
class Shown(wrt.Integrator):
    """The number that `which` chooses; 4 and more are NaN."""

    which: int = 0
    count: int = -70000
    share: float = 0.25
    flag: bool = True
    tint: tuple[float, float, float] = (0.1, 0.2, 0.3)

    type_name = "shown"

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
            if numbers.which == 0:
                result.radiance = wp.vec3(float(numbers.count))
            elif numbers.which == 1:
                result.radiance = wp.vec3(numbers.share)
            elif numbers.which == 2:
                result.radiance = wp.vec3(1.0)
                if numbers.flag:
                    result.radiance = wp.vec3(2.0)
            elif numbers.which == 3:
                result.radiance = numbers.tint
            else:
                result.radiance = wp.vec3(wp.sqrt(numbers.share - 1.0))
            return result

        return trace


def bumpy_scene() -> wrt.Scene:
    """A scene with a normal map, holes and a mixture, in which rays meet all sorts of surfaces."""
    bumps = np.random.default_rng(3).random((8, 8, 3)).astype(np.float32) * (0.4, 0.4, 0.0) + (0.3, 0.3, 1.0)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.5, 4.0), (0.0, 0.3, 0.0)))
    material = wrt.Diffuse(0.5, normal_map=wrt.NormalMap(bumps.astype(np.float32)), opacity=0.6)
    scene.add(wrt.quad((-0.8, -0.2, 0.3), (1.6, 0, 0), (0, 1.2, -0.8)), material=material)
    scene.add(wrt.sphere((0.7, 0.3, 0.6), 0.4), material=wrt.Diffuse(0.5))
    scene.add(wrt.quad((-4, -0.3, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse((0.6, 0.4, 0.2)))
    return scene


SMALL: dict[str, Any] = {"width": 40, "height": 30, "seed": 3}


@pytest.mark.slow
@pytest.mark.parametrize("transparent", [False, True])
def test_a_copy_of_ao_has_its_bits(transparent: bool) -> None:
    wrt.register_integrator(OwnOcclusion)
    how = {**SMALL, "transparent": transparent}
    own = wrt.Renderer(bumpy_scene(), integrator=OwnOcclusion(0.7), **how)
    built_in = wrt.Renderer(bumpy_scene(), integrator="ao", ao_distance=0.7, **how)
    films = [finish(renderer, 17).film.state() for renderer in (own, built_in)]
    assert [name for name in films[0] if films[0][name].tobytes() != films[1][name].tobytes()] == []
    assert own.rays == built_in.rays


@pytest.mark.slow
def test_plain_paths_have_the_mean_of_path() -> None:
    """With light from a mesh, an image, a point, a sphere and a sun, on what is rough and what is a mirror."""
    wrt.register_integrator(PlainPaths)
    scene = block_scene()
    scene.add(wrt.quad((-2.0, -0.5, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0)), material=wrt.RoughConductor(0.3))
    scene.add(wrt.sphere((1.0, 0.0, 0.5), 0.4), material=wrt.Mirror())
    scene.add_light(wrt.SphereLight((-1.2, 0.5, 0.5), 0.3, radiance=6.0))
    scene.add_light(wrt.DirectionalLight((0.3, -1.0, 0.2), irradiance=1.0, angle_degrees=4.0))
    own, built_in = (rendered(scene, 1024, integrator=name, max_depth=4) for name in ("plain-paths", "path"))
    films = (own.film.mean(), own.variance(), built_in.film.mean(), built_in.variance())
    result = image_z_test(*films, n_a=1024, n_b=1024)
    assert result.agrees(), result
    assert own.rays > 0.5 * built_in.rays


@pytest.mark.slow
def test_numbers_arrive_and_films_know_them(tmp_path: Path, device: str) -> None:
    """By objects, scene files and the shell; a checkpoint refuses other numbers, and parts are merged without them."""
    wrt.register_integrator(Shown)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera())
    scene.add(wrt.box(), material=wrt.Diffuse(0.5))
    how = {**SMALL, "device": device}
    renderers = [wrt.Renderer(scene, integrator=Shown(which=which), **how) for which in range(5)]
    for renderer, expected in zip(renderers, (-70000.0, 0.25, 2.0, (0.1, 0.2, 0.3)), strict=False):
        finish(renderer, 1)
        np.testing.assert_array_equal(renderer.film.mean()[0, 0], np.float32(expected))
    finish(renderers[4], 1)
    assert renderers[4].film.rejected == SMALL["width"] * SMALL["height"]  # NaN is left out, as of built-in ones
    renderers[1].save_checkpoint(tmp_path / "a.ckpt")
    again = wrt.Renderer.resume(tmp_path / "a.ckpt", scene, device=device)
    assert (again.spp, again.settings.integrator) == (1, Shown(which=1))
    for other, what in ((Shown(share=0.5), '"share": 0.25.* there, .*"share": 0.5.* here'), ("ao", "integrator")):
        with pytest.raises(wrt.InputError, match=f"cannot resume, these differ: .*{what}"):
            wrt.Renderer(scene, integrator=other, **how).load_checkpoint(tmp_path / "a.ckpt")
    parts = [again.part(number, 2, spp=2) for number in (1, 2)]
    for part in parts:
        part.save(tmp_path / f"{part.number}.wrt")
    INTEGRATORS.pop("shown")
    merged = wrt.merge([tmp_path / "1.wrt", tmp_path / "2.wrt"])
    INTEGRATORS["shown"] = Shown
    assert merged.integrator == "shown"
    np.testing.assert_array_equal(merged.image(), finish(again, 2).image())
    scene.settings.integrator = Shown(which=3, tint=(1.0, 0.5, 0.25))
    wrt.save_scene(tmp_path / "shown.toml", scene)
    assert wrt.load(tmp_path / "shown.toml").settings.integrator == scene.settings.integrator
    crop = wrt.render(scene, crop=(3, 4, 9, 8), spp=2, **how)
    np.testing.assert_array_equal(crop, np.broadcast_to(np.float32((1.0, 0.5, 0.25)), crop.shape))


@pytest.mark.slow
def test_the_examples_of_the_documentation(tmp_path: Path) -> None:
    """Each by what it must show: a heat of 1 bounce, the sky's share in the open, an outline around a silhouette."""
    (tmp_path / "ball.toml").write_text('[[shapes]]\ntype = "sphere"\n[camera]\norigin = [0, 0, 9]\nfov_degrees = 20\n')
    small = ("--size", "24x24", "--spp", "16", "--with", str(ROOT / "scripts" / "sketches.py"))
    for name in ("heat-map", "depth-cue", "toon"):
        done = run(tmp_path, "render", "ball.toml", "--integrator", name, *small, "-o", f"{name}.npy")
        assert done.returncode == 0, done.stderr
    shown = {name: wrt.load_image(tmp_path / f"{name}.npy")[:, :, :3] for name in ("heat-map", "depth-cue", "toon")}
    middle, corner = (slice(10, 14), slice(10, 14)), (slice(0, 2), slice(0, 2))
    np.testing.assert_allclose(shown["heat-map"][middle], np.broadcast_to((0.25, 0.0, 0.0), (4, 4, 3)), atol=1e-6)
    assert not shown["heat-map"][corner].any()
    clear = np.exp(-8.0 / 10.0)
    expected = np.array((0.6, 0.7, 0.8)) * (1.0 - clear) + clear
    np.testing.assert_allclose(shown["depth-cue"][middle], np.broadcast_to(expected, (4, 4, 3)), atol=2e-3)
    np.testing.assert_allclose(shown["depth-cue"][corner], np.broadcast_to((0.6, 0.7, 0.8), (2, 2, 3)), atol=1e-6)
    assert (shown["toon"][corner] == 1.0).all()
    along = shown["toon"][12, :, 0]
    assert along.min() < 0.5 * along[12], "an outline"


# --- Mistakes -----------------------------------------------------------------------------------------


def own(make: Any, annotations: dict[str, Any] | None = None, **values: Any) -> Any:
    """Return a class of an integrator with a name of its own, or what is no such class."""
    body = {"type_name": "faulty", "make_trace": staticmethod(make), "__annotations__": annotations or {}, **values}
    return dataclass(frozen=True)(type("Faulty", (wrt.Integrator,), body))


@wp.func
def with_few_arguments(scene: SceneData, ray: Ray) -> wp.vec3:
    return ray.direction


MISTAKES = {
    "no function": (lambda: dataclass(frozen=True)(type("Faulty", (wrt.Integrator,), {"type_name": "x"})), "lacks the"),
    "no class": (lambda: 3, "must be a class based on wrt.Integrator, not 3"),
    "no dataclass": (lambda: type("Faulty", (Shown,), {"type_name": "x"}), r"Faulty must be a @dataclass\(frozen=True"),
    "name taken": (lambda: own(Shown.make_trace, type_name="path"), "type_name 'path' is empty or taken"),
    "no Warp": (lambda: own(lambda tools: print), "must return a function with @wp.func, not builtin"),
    "annotations": (
        lambda: own(lambda tools: eval("tools", {})),
        "name 'tools' is not defined.* must not have `from __future__ import annotations`",
    ),
    "arguments": (
        lambda: own(lambda tools: with_few_arguments),
        r"must be \(scene: SceneData, .* -> PathResult, not \(scene: SceneData, ray: Ray\) -> vec3",
    ),
    "text": (lambda: own(Shown.make_trace, {"a": str}, a="b"), "field 'a' must be a bool, an int, a float or a colour"),
    "no default": (lambda: own(Shown.make_trace, {"a": float}), "field 'a' must be a bool, .* with a default"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_what_cannot_be_registered_is_refused(name: str) -> None:
    make, message = MISTAKES[name]
    with pytest.raises(wrt.InputError, match=message):
        wrt.register_integrator(make())


def test_settings_refuse_what_is_unknown_or_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(wrt.InputError, match=r"one of path, .* not 'pth'.*--with FILE or wrt\.load_models"):
        wrt.RenderSettings(integrator="pth")
    INTEGRATORS.pop("plain-paths", None)
    with pytest.raises(wrt.InputError, match=r"PlainPaths must be registered by wrt\.register_integrator first"):
        wrt.RenderSettings(integrator=PlainPaths())
    with pytest.raises(wrt.InputError, match="share must be finite"):
        Shown(share=np.inf)
    file = tmp_path / "a.toml"
    file.write_text('[settings]\nintegrator = {type = "sown"}\n')
    with pytest.raises(wrt.InputError, match=r"settings\.integrator.*not 'sown'.*--with FILE"):
        wrt.load(file)
    wrt.register_integrator(Shown)
    assert wrt.RenderSettings(integrator="shown").integrator == Shown()
    file.write_text('[settings]\nintegrator = {type = "shown", shar = 1.0}\n')
    with pytest.raises(wrt.InputError, match=r"settings\.integrator\.shar: unknown key.*share"):
        wrt.load(file)


def test_what_it_cannot_do_is_refused_or_said(render_kernels_when_launched: Any) -> None:
    wrt.register_integrator(Shown)
    foggy = block_scene()
    foggy.add(wrt.sphere(), material=wrt.Null(interior=wrt.Medium(absorption=(0.1, 0.1, 0.1))))
    with pytest.warns(UserWarning, match="integrator 'shown' ignores media; use 'volpath'"):
        wrt.Renderer(foggy, integrator="shown", **SMALL)
    for options, message in (
        ({"layers": ("light_groups",)}, "integrator 'shown' has no layers of light groups"),
        ({"caustics": True}, "integrator 'shown' cannot render caustics by photons"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            wrt.Renderer(block_scene(), integrator="shown", **options, **SMALL)


def test_gradients_refuse_it_at_the_first_call(render_kernels_when_launched: Any) -> None:
    """Also `wrt.torch` and `wrt.jax`, whose pictures are `Differentiable`."""
    wrt.register_integrator(Shown)
    for integrator in ("shown", "ao"):
        renderer = wrt.Renderer(block_scene(), integrator=integrator, **SMALL)
        message = f"integrator '{integrator}' has no gradients; use 'path' or 'volpath'"
        with pytest.raises(wrt.InputError, match=message):
            renderer.gradients(np.ones((30, 40, 3)))
        with pytest.raises(wrt.InputError, match=message):
            Differentiable(renderer, {}, 1, None, None)


def test_versions_of_the_code_have_names_of_their_own() -> None:
    """So kernels with another function, or other numbers, are compiled anew; those of the same are found."""

    def name_of(cls: Any) -> str:
        wrt.register_integrator(cls)
        return OWN_INTEGRATORS.current_name(cls.type_name.replace("-", "_"))

    assert name_of(Shown) == name_of(Shown)
    first = name_of(own(Shown.make_trace, {"a": float}, a=1.0))
    assert re.fullmatch(r"faulty:[0-9a-f]{16}", first)
    assert first == name_of(own(Shown.make_trace, {"a": float}, a=2.0))
    assert first != name_of(own(Shown.make_trace, {"b": float}, b=1.0))
    assert first != name_of(own(OwnOcclusion.make_trace, {"a": float}, a=1.0))
