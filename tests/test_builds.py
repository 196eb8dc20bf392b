"""A new scene of features that were seen before loads no kernel, let alone compiles one."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from warp._src.context import user_modules

import wrt


def loaded() -> set[tuple[str, str]]:
    """Return name and hash of every module that is ready to run, with each of its builds."""
    return {(name, str(key)) for name, module in user_modules.items() for key in module.execs}


def room(triangles: int, metal: wrt.Material, lamps: int, seed: int) -> wrt.Scene:
    rng = np.random.default_rng(seed)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(rng.normal(0.0, 0.2, 3) + (0.0, 1.0, 3.0)), (0.0, 0.5, 0.0)))
    scene.environment = wrt.ConstantEnvironment(float(rng.uniform(0.1, 0.9)))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(float(rng.uniform(0.2, 0.8))))
    corners = rng.normal(0.0, 0.1, (triangles, 3, 3)) + rng.uniform(-1.0, 1.0, (triangles, 1, 3)) + (0.0, 1.2, 0.0)
    scene.add(wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3)), material=metal)
    for k in range(lamps):
        scene.add_light(wrt.PointLight((k - 1.0, 3.0, 1.0), intensity=4.0))
    return scene


def render(scene: wrt.Scene, device: str, **options: object) -> np.ndarray:
    renderer = wrt.Renderer(scene, device=device, **options)  # type: ignore[arg-type]
    for _ in renderer.passes(spp=2):
        pass
    return renderer.image()


@pytest.mark.slow
def test_a_new_scene_of_seen_features_builds_nothing(device: str) -> None:
    render(room(3_000, wrt.Conductor(), 1, 1), device, width=16, height=12)
    before = loaded()
    kernels = "wrt.render." if device == "cpu" else "wrt.regenerating."
    assert any(name.startswith(kernels) for name, _ in before)
    assert any(name == "wrt.kernels.accel.build.split" for name, _ in before)
    # Other meshes, sizes, values, numbers of lights, places, depths and seeds.
    image = render(room(5_000, wrt.Conductor(metal="gold"), 3, 2), device, width=23, height=9, seed=7, max_depth=5)
    assert image.max() > 0.0
    assert loaded() == before
    # What is new, whatever other tests have loaded in this process, is seen to be loaded.
    rare = {"sampler": "blue-noise", "clamp_indirect": 3.0, "regularization": 0.2}
    render(room(100, wrt.OrenNayar(), 1, 3), device, width=8, height=8, **rare)
    new = {name for name, _ in loaded() - before}
    assert len(new) == 1
    assert new.pop().startswith(kernels)


def test_a_kernel_that_is_new_is_counted() -> None:
    before = loaded()

    @wp.kernel(module="unique", enable_backward=False)
    def double(x: wp.array(dtype=float)):  # type: ignore[valid-type]
        i = wp.tid()
        x[i] = 2.0 * x[i]

    values = wp.ones(3, dtype=float, device="cpu")
    wp.launch(double, 3, [values], device="cpu")
    assert len(loaded() - before) == 1
