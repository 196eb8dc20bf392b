"""Derivatives of pictures: against difference quotients with the same random numbers, closed forms, and bit for bit."""

from __future__ import annotations

import dataclasses
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from warp._src.context import ModuleBuilder

import wrt
from wrt.backend.warp_start import initialize_warp
from wrt.errors import InputError
from wrt.gradients.backward import KEYS, Backward
from wrt.kernels.bsdf import model_of
from wrt.kernels.core.features import Features
from wrt.kernels.core.scene_data import LIGHT_TRIANGLE
from wrt.kernels.gradients.gradient_pass import make_gradient_kernel
from wrt.kernels.render import make_render_kernel

SIZE, SPP = 24, 16


def box(*shapes: Any, lights: bool = True, **options: Any) -> wrt.Scene:
    """Return a scene of three walls and a lamp, with whatever else."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0, 1, 3.4), target=(0, 1, 0), fov_degrees=40), **options)
    grey = wrt.Diffuse((0.7, 0.65, 0.6))
    scene.add(wrt.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=grey)
    scene.add(wrt.quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), material=wrt.Diffuse((0.3, 0.5, 0.4)))
    scene.add(wrt.quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.3, 0.2)))
    if lights:
        scene.add(wrt.quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8)), material=grey, emission=(9.0, 8.0, 7.0))
    for mesh, material in shapes:
        scene.add(mesh, material=material)
    return scene


def renderer_of(scene: wrt.Scene, device: str = "cpu", **settings: Any) -> wrt.Renderer:
    options = {"width": SIZE, "height": SIZE, "max_depth": 4, "threads": 2, "seed": 1, **settings}
    return wrt.Renderer(scene, device=device, **options)


def upstream() -> NDArray[np.float32]:
    """Return a derivative of the loss that differs from pixel to pixel."""
    return np.random.default_rng(3).uniform(-1.0, 1.0, (SIZE, SIZE, 3)).astype(np.float32)


def loss(renderer: wrt.Renderer, spp: int = SPP) -> float:
    """Return the sum over pixels of radiance times `upstream`, in double precision."""
    renderer._clear()
    renderer.render(spp=spp)
    total = np.asarray(renderer.device.backend.fetch(renderer.film.data.total), np.float64)
    return float((total.reshape(SIZE, SIZE, 3) / spp * upstream()).sum())


def quotients(renderer: wrt.Renderer, values: NDArray[Any], row: int, step: float) -> NDArray[np.float64]:
    """Return the difference quotients by the three numbers of a row of an array of the scene, on the CPU."""
    found = np.empty(3)
    for channel in range(3):
        value, ends = values[row, channel].copy(), []
        for sign in (1.0, -1.0):
            values[row, channel] = value + sign * step
            copy_emission(renderer)
            ends.append(loss(renderer))
        values[row, channel] = value
        found[channel] = (ends[0] - ends[1]) / (2.0 * step)
    copy_emission(renderer)
    return found


def copy_emission(renderer: wrt.Renderer) -> None:
    """Give the lights that are triangles the emission of their shapes, as the upload does."""
    shapes, lights = (getattr(renderer._built.data, name).rows for name in ("shapes", "lights"))
    for light in lights:
        if light["kind"] == LIGHT_TRIANGLE and shapes[light["shape"]]["emission_slot"] < 0:
            light["value"] = shapes[light["shape"]]["emission"]


def gradients(renderer: wrt.Renderer, spp: int = SPP) -> dict[str, NDArray[np.float64]]:
    return Backward(renderer).run(upstream(), spp, renderer.seed)


def error(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the largest difference, relative to the largest number."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def test_reflectances_and_emission(report: Report) -> None:
    """All light is the lamp's, so the derivative by its emission is the loss over that, channel by channel."""
    renderer = renderer_of(box())
    found = gradients(renderer)
    slots = renderer._built.data.slots.rows["value"]
    worst = max(error(found["slots"][row], quotients(renderer, slots, row, 2e-3)) for row in range(3))
    report("derivatives by reflectances", worst, "< 1e-3")
    assert worst < 1e-3
    renderer._clear()
    by_channel = (renderer.render(spp=SPP).astype(np.float64) * upstream()).sum((0, 1))
    assert error(found["emission"][3], by_channel / (9.0, 8.0, 7.0)) < 1e-6
    assert not found["emission"][:3].any()


def pixels(seed: int, *shape: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.2, 0.8, (*shape, 3)).astype(np.float32)


def textures() -> wrt.Scene:
    """Every way in which a value varies: wraps, filters, mip levels, a channel, vertex colours, under a normal map."""
    scene = box(lights=False)
    quad = wrt.quad((-0.9, 0.2, -0.8), (0.5, 0, 0.2), (0, 0.7, 0))
    colored = dataclasses.replace(quad, colors=np.random.default_rng(4).uniform(0.3, 1.0, (4, 4)))
    second = dataclasses.replace(quad, uvs=np.hstack([quad.uvs, 1.3 * quad.uvs]))
    bumps = np.array([0.5, 0.5, 1.0]) + (0.2, 0.2, 0.0) * (pixels(9, 4, 4) - 0.5)
    wide: dict[str, Any] = {"scale": 1.7, "offset": (-0.3, 0.4), "rotation_degrees": 20.0}
    for i, (mesh, texture) in enumerate(
        (
            (quad, wrt.ImageTexture(pixels(0, 5, 7), **wide)),
            (quad, wrt.ImageTexture(pixels(1, 5, 4), wrap=("mirror", "clamp"), filter="nearest", factor=0.8, **wide)),
            (quad, wrt.ImageTexture(pixels(2, 16, 16), filter="trilinear", scale=3.0)),
            (colored, wrt.ImageTexture(pixels(3, 4, 4), channel="g", factor=(0.9, 0.8, 0.7), vertex_colors=True)),
            (colored, wrt.VertexColor(factor=0.7)),
            (second, wrt.ImageTexture(pixels(5, 4, 4), uv_set=1)),
        )
    ):
        normals = wrt.NormalMap(bumps.astype(np.float32), filter=False) if i == 0 else None
        mesh = mesh.translated((0.65 * (i % 3), 0.8 * (i // 3), 0.0))
        scene.add(mesh, material=wrt.Diffuse(texture, normal_map=normals))
    lamp = wrt.ImageTexture(pixels(6, 3, 3), factor=(9.0, 8.0, 7.0))
    scene.add(wrt.quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8)), emission=lamp)
    return scene


def mixtures() -> wrt.Scene:
    """Mixtures, two sides and opacity, where a hit chooses one material of several."""
    mix = wrt.Mix(wrt.Diffuse((0.8, 0.3, 0.2)), wrt.Diffuse((0.2, 0.5, 0.6)), weight=0.3)
    holes = wrt.Diffuse((0.5, 0.6, 0.3), opacity=0.6)
    sides = wrt.TwoSided(wrt.Diffuse((0.4, 0.5, 0.6)), wrt.Diffuse((0.7, 0.3, 0.3)))
    panel = wrt.quad((-0.6, 0.3, 0.2), (0.5, 0, 0.1), (0, 0.9, 0))
    shifts = ((0.0, 0.0, 0.0), (0.4, 0.2, 0.2), (0.8, 0.0, 0.1))
    return box(*((panel.translated(shift), part) for shift, part in zip(shifts, (mix, holes, sides), strict=True)))


def lamps() -> wrt.Scene:
    """A light of each kind, and an image around; some lights and parts of the image are black in a channel."""
    around = pixels(7, 6, 12)
    around[2:4, 3:6] = 0.0
    scene = box(lights=False, environment=wrt.ImageEnvironment(around))
    high, down = (0.3, 1.8, 0.2), (-0.2, -1.0, -0.1)
    projected = wrt.ImageTexture(pixels(8, 3, 4))
    for light in (
        wrt.PointLight(high, (1.0, 0.5, 0.0)),
        wrt.SpotLight(high, down, 2.0),
        wrt.SpotLight(high, down, 2.0, texture=projected),
        wrt.ProjectorLight(high, down, (1.0, 0.0, 0.0), texture=projected, irradiance=1.0),
        wrt.DirectionalLight(down, 0.7),
        wrt.DirectionalLight((0.2, -1.0, -0.3), 0.7, angle_degrees=5.0),
        wrt.RectangleLight((-0.2, 1.9, 0.0), (0.3, 0.0, 0.0), (0.0, 0.0, 0.3), (2.0, 0.0, 3.0)),
        wrt.DiskLight((0.5, 1.9, 0.0), down, 0.2, (1.0, 2.0, 3.0)),
        wrt.SphereLight((-0.5, 0.5, 0.0), 0.1, (3.0, 2.0, 1.0)),
    ):
        scene.add_light(light)
    return scene


def glasses() -> wrt.Scene:
    """Smooth models, in constant light and with a lamp: what follows a random choice has no difference quotient."""
    ball, panel = wrt.sphere((-0.4, 0.5, 0.1), 0.3), wrt.quad((0.2, 0.1, 0.0), (0.5, 0, -0.2), (0, 0.9, 0))
    return box(
        (ball, wrt.Conductor()),
        (ball.translated((0.5, 0.9, 0.0)), wrt.Mirror((0.9, 0.7, 0.5))),
        (panel, wrt.Plastic((0.6, 0.4, 0.2))),
        (panel.translated((-0.8, 0.9, 0.3)), wrt.ThinDielectric(1.5, specular_transmittance=(0.9, 0.8, 0.7))),
        (ball.translated((0.1, 0.2, 0.5)), wrt.Dielectric(1.5, specular_transmittance=0.8, specular_reflectance=0.7)),
        environment=wrt.ConstantEnvironment((0.3, 0.4, 0.5)),
    )


def fog() -> wrt.Scene:
    """Media that absorb and emit, around everything and in a body."""
    inside = wrt.Medium((0.6, 1.2, 0.3), emission=(0.1, 0.2, 0.05))
    body = wrt.box((-0.7, 0.1, -0.4), (-0.1, 0.9, 0.3))
    return box((body, wrt.Null(interior=inside)), medium=wrt.Medium((0.1, 0.05, 0.2), emission=(0.02, 0.01, 0.03)))


SCENES = {each.__name__: each for each in (textures, mixtures, lamps, glasses, fog)}

WITHOUT_QUOTIENTS = {
    "mixtures": (3, 7),  # the weight and the opacity, which have no derivative
    "glasses": (6, 7, 8, 11, 14),  # they decide what is sampled: see `test_values_that_decide_what_is_sampled`
}
"""Rows of slots whose difference quotients with the same random numbers are not the derivatives."""


def arrays_of(renderer: wrt.Renderer) -> dict[str, NDArray[Any]]:
    """Return the arrays of a scene on the CPU that KEYS name, to change them; texels of normal maps are left out."""
    data = renderer._built.data
    found = {
        "slots": data.slots.rows["value"],
        "emission": data.shapes.rows["emission"],
        "lights": data.lights.rows["value"],
        "environment": data.environment._memory["radiance"][None],
    }
    for key, array in (("texels", data.texels), ("environment_texels", data.environment.texels)):
        found |= {} if array is None else {key: array.rows}
    if data.media is not None:
        found |= {f"media_{name}": data.media.rows[name] for name in ("absorption", "scattering", "emission")}
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_values_of_scenes(name: str, report: Report) -> None:
    """Those of each array whose derivatives are largest, and some others."""
    renderer = renderer_of(SCENES[name]())
    found = gradients(renderer)
    for key, values in arrays_of(renderer).items():
        derivatives = found[key]
        order = np.argsort(-np.abs(derivatives).max(axis=1)) if len(derivatives) else []
        chosen = sorted({*order[:6], *order[6::7]}) if key != "slots" else range(len(derivatives))
        chosen = [row for row in chosen if key != "slots" or row not in WITHOUT_QUOTIENTS.get(name, ())]
        if key == "texels" and renderer._built.data.normal_maps is not None:
            first = renderer._built.data.images.rows[renderer._built.data.normal_maps.rows["image"][0]]["first"]
            chosen = [row for row in chosen if not first <= row < first + 16]
        expected = np.array([quotients(renderer, values, row, 2e-3) for row in chosen]).reshape(-1, 3)
        if np.abs(expected).max(initial=0.0) > 0.0:
            worst = error(derivatives[chosen], expected)
            report(f"{name}: {key}", worst, "< 1e-3")
            assert worst < 1e-3, key
        else:
            assert not derivatives[chosen].any(), key


def test_devices_agree(device: str) -> None:
    """A GPU rounds otherwise; from run to run its sums have the same bits."""
    found, again = (gradients(renderer_of(box(), device), 4) for _ in range(2))
    expected = gradients(renderer_of(box()), 4)
    for key in KEYS:
        np.testing.assert_array_equal(found[key], again[key])
        limit = 1e-3 * np.abs(expected[key]).max(initial=1e-9)
        np.testing.assert_allclose(found[key], expected[key], rtol=0.0, atol=limit)


def test_bits_do_not_depend_on_threads_or_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = box()
    found = gradients(renderer_of(scene))
    monkeypatch.setattr("wrt.gradients.kernels.PER_LAUNCH", 5 * SIZE * SIZE)
    again = gradients(renderer_of(scene, threads=1))
    assert set(found) == set(KEYS)
    for key in KEYS:
        np.testing.assert_array_equal(found[key], again[key])


def code_of(module: wp.Module) -> str:
    """Return the C++ that Warp generates for a module."""
    return str(ModuleBuilder(module, module.resolve_options(wp.config), target=None).codegen("cpu"))


def test_adjoint_code_is_in_the_modules_of_gradients_alone() -> None:
    """Warp leaves adjoints empty that no `wp.grad` is the first to need, and would keep marks in all modules.

    They are there without being asked for, also in what Warp compiles by itself.
    """
    initialize_warp()
    features = Features(("oren_nayar",), False, "none")
    render, of_gradients = make_render_kernel(features).module, make_gradient_kernel(features).module
    before = code_of(render)
    adjoint = rf"void adj_{re.escape(model_of('oren_nayar').evaluate.native_func)}\(.*?\n}}"
    for _ in range(2):
        empty, whole = (re.findall(adjoint, code_of(f), re.DOTALL)[0] for f in (render, of_gradients))
        assert "reverse mode disabled" in empty
        assert "reverse mode disabled" not in whole
    assert code_of(render) == before


def test_what_has_no_gradients_is_refused() -> None:
    """Before anything is compiled, so stand-ins for renderers do."""
    with pytest.raises(InputError, match="integrator 'whitted' has no gradients"):
        Backward(SimpleNamespace(integrator="whitted"))
    with pytest.raises(InputError, match="clamp"):
        Backward(SimpleNamespace(integrator="path", settings=wrt.RenderSettings(clamp_indirect=1.0)))
