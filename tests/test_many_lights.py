"""Pictures are the same whichever way lights are chosen, by any estimator, with lights of all kinds."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import ImageTest, image_z_test

import wrt
import wrt.upload.lights.choice
from wrt.backend.device import Device
from wrt.upload.scene_data import build_scene

SIZE = 32


def lamps(n: int, seed: int, size: float = 0.12) -> wrt.Mesh:
    """Return small triangles in a room, each a mesh's own corners."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 1, 3)) * [3.6, 1.8, 3.6] + [-1.8, 0.1, -1.8] + size * rng.normal(size=(n, 3, 3))
    return wrt.Mesh(
        points.reshape(-1, 3).clip([-1.95, 0.02, -1.95], [1.95, 1.98, 1.95]), np.arange(3 * n).reshape(n, 3)
    )


def room(*, glass: bool = True) -> wrt.Scene:
    """Return a room open to the sky, with all kinds of lights, glass and a wall that lets some light through."""
    image = np.full((8, 16, 3), 0.02, np.float32)
    image[1, 3] = (6.0, 5.0, 4.0)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(image))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.2, 5.5), (0.0, 0.8, 0.0), fov_degrees=40.0)
    scene.settings.max_depth = 4
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse(0.6))
    scene.add(wrt.quad((-2, 0, -2), (4, 0, 0), (0, 2, 0)), material=wrt.RoughConductor(0.3, metal="copper"))
    half = wrt.Diffuse((0.3, 0.5, 0.7), opacity=0.6)
    scene.add(wrt.quad((-2, 0, 2), (0, 0, -4), (0, 2, 0)), material=half)
    scene.add(lamps(120, 1), material=wrt.Diffuse(0.2), emission=(0.9, 0.6, 0.3))
    scene.add(lamps(60, 2), material=wrt.Diffuse(0.2), emission=(0.3, 0.6, 0.9), two_sided_emission=True)
    if glass:
        ball = wrt.sphere((0.6, 0.5, 0.8), 0.45)
        scene.add(ball, material=wrt.RoughDielectric(alpha=0.3))
    for k in range(4):
        scene.add_light(wrt.PointLight((k - 1.5, 1.5, 0.3), intensity=(0.05, 0.02 * k, 0.03)))
    scene.add_light(wrt.SpotLight((1.0, 1.9, 1.0), (-0.4, -1.0, -0.5), intensity=0.6, outer_degrees=25.0))
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.8), 0.2, radiance=(0.5, 0.1, 0.1)))
    scene.add_light(wrt.RectangleLight((0.0, 1.2, -1.5), (0.6, 0, 0), (0, 0.4, 0), radiance=(0.2, 0.8, 0.2)))
    scene.add_light(wrt.DirectionalLight((0.5, -1.0, -0.3), irradiance=0.4))
    return scene


@functools.cache
def rendered(choice: str, strategy: str, device: str, spp: int, seed: int) -> tuple[NDArray, NDArray]:
    renderer = wrt.Renderer(
        room(),
        width=SIZE,
        height=SIZE,
        sampler="independent",
        light_choice=choice,
        strategy=strategy,
        device=device,
        seed=seed,
    )
    for _ in renderer.passes(spp=spp):
        pass
    assert not renderer.film.rejected
    return renderer.image(), renderer.variance()


def compared(a: tuple[NDArray, NDArray], b: tuple[NDArray, NDArray], spp: tuple[int, int]) -> ImageTest:
    return image_z_test(*a, *b, n_a=spp[0], n_b=spp[1])


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_the_tree_shows_what_power_shows(strategy: str, device: str, report: Report) -> None:
    """Against the choice by power, with each estimator: their densities must be those of their samples."""
    spp = (1024, 1024)
    tree = rendered("tree", strategy, device, spp[0], 1)
    power = rendered("power", "mis", device, spp[1], 2)
    test = compared(tree, power, spp)
    report(f"{strategy}: mean variance, of power's", float(tree[1].mean() / power[1].mean()))
    report(f"{strategy}: worst block", test.message, p=test.block_p)
    assert test.agrees(), test.message


@pytest.mark.slow
def test_a_share_that_is_five_percent_wrong_is_noticed(device: str) -> None:
    tree = rendered("tree", "mis", device, 1024, 1)
    power = rendered("power", "mis", device, 1024, 2)
    wrong = (tree[0] * np.float32(1.05), tree[1] * 1.05**2)
    assert not compared(wrong, power, (1024, 1024)).agrees()


def features(scene: wrt.Scene, choice: str = "auto") -> bool:
    return build_scene(scene, Device("cpu"), light_choice=choice).features.light_tree


def test_the_tree_is_for_many_lights() -> None:
    assert not features(wrt.load("cornell-box"))
    assert features(room())
    assert not features(room(), "power")
    few = wrt.Scene()
    few.add(lamps(wrt.upload.lights.choice.FEW_LIGHTS, 1), emission=1.0)
    assert not features(few)
    assert features(few, "tree")
    few.add(lamps(1, 2), emission=1.0)
    assert features(few)
    # Lights that are infinitely far away, or black, are not in it.
    far = wrt.Scene(lights=[wrt.DirectionalLight((0, -1, 0), 1.0)] * 100)
    far.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    assert not features(far, "tree")


@pytest.mark.slow
def test_another_choice_is_another_render(tmp_path: object) -> None:
    file = tmp_path / "a.wrt"  # type: ignore[operator]
    scene = room()
    renderer = wrt.Renderer(scene, width=4, height=4, light_choice="tree")
    next(renderer.passes(spp=1))
    renderer.save_checkpoint(file)
    assert wrt.Renderer.resume(file, scene).light_choice == "tree"
    with pytest.raises(wrt.InputError, match="light_choice"):
        wrt.Renderer(scene, width=4, height=4, light_choice="power").load_checkpoint(file)
    with pytest.raises(wrt.InputError, match="light_choice must be one of"):
        wrt.Renderer(scene, width=4, height=4, light_choice="best")
