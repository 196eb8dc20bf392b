"""A closed box of albedo a whose walls emit 1 has the radiance 1 / (1 − a) everywhere inside.

Every bounce finds the same walls, so the radiance is the geometric series 1 + a + a² + …
"""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from support.statistics import t_test_mean

import wrt


def furnace(albedo: float) -> wrt.Scene:
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    inside = wrt.Mesh(outside.vertices, outside.faces[:, ::-1])
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0.3, -0.2, 0.5), target=(-0.4, 0.3, -1.0), fov_degrees=90))
    scene.add(inside, material=wrt.Diffuse(albedo), emission=1.0)
    return scene


def flat_ball() -> wrt.Mesh:
    """A ball without interpolated normals, below whose horizon a little light is always lost."""
    ball = wrt.sphere(subdivisions=3)
    return wrt.Mesh(ball.vertices, ball.faces)


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
@pytest.mark.parametrize("albedo", [0.5, 0.8])
def test_radiance_of_a_furnace(albedo: float, strategy: str, device: str, report: Report) -> None:
    renderer = wrt.Renderer(
        furnace(albedo),
        sampler="independent",
        width=32,
        height=32,
        seed=1,
        max_depth=1000,
        strategy=strategy,
        device=device,
    )
    for _ in renderer.passes(spp=512):
        pass
    mean = float(renderer.image().astype(np.float64).mean())
    # The three channels of a grey scene are equal, so one channel is the sample.
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    expected = 1.0 / (1.0 - albedo)
    report(
        f"a = {albedo}, {strategy}: radiance", mean, expected, p=t_test_mean(mean, error**2, 32 * 32 * 512, expected)
    )
    assert abs(mean - expected) < 3.0 * max(error, 1e-6 * expected)


def test_bsdf_sampling_alone_is_exact_but_for_roulette(device: str) -> None:
    """Below the roulette depth a furnace has no variance at all: each path sees 1 + a + … + a^(d−1)."""
    renderer = wrt.Renderer(furnace(0.5), width=8, height=8, max_depth=4, strategy="bsdf", device=device)
    for _ in renderer.passes(spp=16):
        pass
    np.testing.assert_allclose(renderer.image(), 1.875, rtol=1e-6)


def test_a_glass_block_in_a_furnace_cannot_be_seen(device: str, report: Report) -> None:
    """Reflection and refraction together lose nothing, and η² cancels between entry and exit.

    A block, not a ball of facets: reflections in a block keep the size of each component of a direction,
    so light that came in can always leave. In a ball of facets some is caught for hundreds of
    reflections, and what roulette makes of that is too rare to be seen in a mean.
    """
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(1.8, 1.3, 3.0), fov_degrees=30)
    scene.add(wrt.box((-0.7, -0.5, -0.6), (0.7, 0.5, 0.6)), material=wrt.Dielectric(ior=1.5))
    renderer = wrt.Renderer(scene, sampler="independent", width=32, height=32, max_depth=1000, device=device)
    for _ in renderer.passes(spp=256):
        pass
    image, variance = renderer.image()[..., 0], renderer.variance()[..., 0]
    error = float(np.sqrt(variance.sum())) / image.size
    mean = float(image.astype(np.float64).mean())
    report("mean radiance through glass", mean, 1.0, p=t_test_mean(mean, error**2, image.size * 256, 1.0))
    assert abs(mean - 1.0) < 3.0 * max(error, 1e-6)


@pytest.mark.parametrize(
    ("material", "expected"),
    [(wrt.Diffuse(0.5), 0.5), (wrt.Mirror(0.7), 0.7), (wrt.Diffuse((0.1, 0.2, 0.3)), (0.1, 0.2, 0.3))],
)
def test_a_convex_body_under_a_constant_sky(
    material: wrt.Material, expected: float | tuple[float, ...], device: str
) -> None:
    """Nothing blocks the sky, so the body shows its reflectance times the sky's radiance."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=10)
    scene.add(flat_ball(), material=material)
    image = wrt.render(scene, width=8, height=8, spp=4, device=device)
    np.testing.assert_allclose(image, np.broadcast_to(2.0 * np.array(expected), image.shape), rtol=1e-5)
