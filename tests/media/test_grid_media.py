"""Media whose density varies on a grid: tracking against closed forms, and furnaces."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from support.covering_kernels import rendering_with
from support.media import KERNELS, mean_and_error, render, stage
from support.statistics import chi_square_test

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.media.grids import make_fly_in_grid
from wrt.kernels.sampling.sampler import hash_4d, stream_4d
from wrt.upload import grids
from wrt.upload.scene_data import SceneUpload

LOWER, UPPER = (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)
RNG = np.random.default_rng(5)
CLOUD = RNG.random((9, 20, 13)).astype(np.float32) ** 3 * (RNG.random((9, 20, 13)) > 0.4)
"""Cells of very different densities, some of them empty."""


few_kernels = rendering_with(*KERNELS)


def boxed(medium: wrt.Medium, **view: Any) -> wrt.Scene:
    """Return a scene with a medium in a box half a metre around the origin."""
    scene = stage(**view)
    scene.add(wrt.box(LOWER, UPPER), material=wrt.Null(interior=medium))
    return scene


def on(values: Any, medium: wrt.Medium, **options: Any) -> wrt.Medium:
    """Return a medium with these densities in the box."""
    return dataclasses.replace(medium, density=wrt.DensityGrid(values, **{"lower": LOWER, "upper": UPPER} | options))


@pytest.mark.slow
def test_white_in_a_furnace(device: str, report: Report) -> None:
    """A cloud that absorbs nothing cannot be seen under an even sky, in channels of different density."""
    white = wrt.Medium.from_albedo(1.0, (10.0, 20.0, 40.0), g=0.8)
    scene = boxed(on(CLOUD, white), sky=1.0, origin=(1.8, 1.3, 3.0), fov_degrees=20.0)
    mean, error = mean_and_error(render(scene, device, size=(24, 24), spp=64, max_depth=1000))
    report("worst", f"{((mean - 1) / np.maximum(error, 1e-6)).round(2)} sigma", 0)
    assert (np.abs(mean - 1.0) < 3.5 * np.maximum(error, 1e-6)).all()
    assert error.max() < 0.01


RAMP = np.linspace(0.0, 4.0, 33, dtype=np.float32)
"""Densities of cells along an axis."""

DEPTH = float(RAMP.astype(np.float64).mean())
"""Their integral over one metre: every cell counts by its width, also where interpolation shares it with others."""

ABSORPTION = np.array([0.2, 0.7, 2.0])


def seen_through(
    medium: wrt.Medium, device: str, sky: float = 1.0, **options: Any
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and error of the light of a sky that comes straight through the box along z."""
    return mean_and_error(render(boxed(medium, sky=sky), device, size=(32, 32), spp=64, **options))


@pytest.mark.slow
def test_light_through_a_ramp(device: str, report: Report) -> None:
    """exp(−b ∫ρ) of an absorbing medium, and of one with an albedo of 0.

    There is no noise where the density is even, whose least value is its mean.
    """
    expected = np.exp(-ABSORPTION * DEPTH)
    black = on(RAMP[:, None, None], wrt.Medium(0.1, (0.1, 0.6, 1.9)), albedo=np.zeros((2, 2, 2, 3)))
    for medium in (on(RAMP[:, None, None], wrt.Medium(tuple(ABSORPTION))), black):
        mean, error = seen_through(medium, device)
        report("exp(−∫)", str(mean.round(5)), str(expected.round(5)))
        assert (np.abs(mean - expected) < 3.5 * error).all()
        assert (np.abs(1.02 * expected - mean) > 3.5 * error).any()
    mean, error = seen_through(on(np.full((5, 20, 9), 2.0), wrt.Medium(tuple(ABSORPTION))), device)
    np.testing.assert_allclose(mean, np.exp(-2.0 * ABSORPTION), rtol=1e-5)
    assert (error < 1e-6).all()


@pytest.mark.slow
def test_light_that_a_ramp_sends_out(device: str, report: Report) -> None:
    """∫ e ρ exp(−b ∫ρ) = e / b (1 − exp(−b ∫ρ)), also where nothing is absorbed; and an emission that varies."""
    absorption, emission = np.array([0.0, 0.7, 2.0]), np.array([0.5, 1.0, 3.0])
    medium = on(RAMP[:, None, None], wrt.Medium(tuple(absorption), emission=tuple(emission)))
    mean, error = seen_through(medium, device, sky=0.0)
    b = np.maximum(absorption, 1e-9)
    expected = emission / b * -np.expm1(-b * DEPTH)
    report("emission", str(mean.round(4)), str(expected.round(4)))
    assert (np.abs(mean - expected) < 3.5 * error).all()
    assert (error < 0.01 * expected).all()
    bright = on(np.ones((2, 3, 1)), wrt.Medium(emission=tuple(emission)), emission=RAMP[::-1, None, None])
    mean, error = seen_through(bright, device, sky=0.0)
    assert (np.abs(mean - emission * DEPTH) < 3.5 * error).all()


@functools.cache
def make_flights() -> wp.Kernel:
    """Return the kernel of flights with random numbers of their own along given rays."""
    fly_in_grid = make_fly_in_grid("scattering")

    @wp.kernel(enable_backward=False, module="test_grid_flights")
    def flights(
        scene: SceneData,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array(dtype=wp.vec3),
        reach: float,
        is_shadow_ray: bool,
        distances_out: wp.array(dtype=float),
        throughputs_out: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        ray = Ray()
        ray.origin = origins[i]
        ray.direction = directions[i]
        key = hash_4d(wp.uint32(i), wp.uint32(1), wp.uint32(2), wp.uint32(3))
        u = stream_4d(key, -1)
        flight = fly_in_grid(scene, scene.media[0], ray, reach, wp.vec3(1.0), wp.vec2(u[0], u[1]), key, is_shadow_ray)
        distances_out[i] = wp.where(flight.scattered, flight.distance, -1.0)
        throughputs_out[i] = flight.throughput

    return flights


def fly(
    medium: wrt.Medium, origins: Any, directions: Any, device: str, *, reach: float = 100.0, is_shadow_ray: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the distances of flights, −1 where they meet nothing, and the transmittance."""
    initialize_warp()
    scene = wrt.Scene()
    scene.add(wrt.box(LOWER, UPPER), material=wrt.Null(interior=medium))
    data = SceneUpload(scene, Device(device)).finish().data
    count = len(origins)
    inputs = [wp.array(np.asarray(a, np.float32), dtype=wp.vec3, device=device) for a in (origins, directions)]
    distances = wp.zeros(count, dtype=float, device=device)
    throughputs = wp.zeros(count, dtype=wp.vec3, device=device)
    outputs = [distances, throughputs]
    wp.launch(make_flights(), count, [data, *inputs, reach, is_shadow_ray], outputs, device=device)
    return distances.numpy().astype(np.float64), throughputs.numpy().astype(np.float64)


def test_free_paths_in_a_ramp(device: str, report: Report) -> None:
    """Where free flights that begin before the box end in it, or leave it, against the closed form."""
    count, bins = 2**18, 101
    medium = on(RAMP[:, None, None], wrt.Medium.from_albedo(1.0, 1.5, 0.0))
    begin, along = np.tile((0.1, 0.2, -0.8), (count, 1)), np.tile((0.0, 0.0, 1.0), (count, 1))
    distances, _ = fly(medium, begin, along, device)
    ends = np.where(distances < 0.0, 1.5, distances - 0.3)
    edges = np.linspace(0.0, 1.0, bins + 1)
    centers = (np.arange(33) + 0.5) / 33
    # ∫ρ is piecewise quadratic: exact at the centres and where the bins end.
    fine = np.union1d(edges, centers)
    density = np.interp(fine, centers, RAMP.astype(np.float64))
    depth = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(fine))])
    transmittance = np.exp(-1.5 * depth[np.searchsorted(fine, edges)])
    expected = count * np.append(-np.diff(transmittance), transmittance[-1])
    result = chi_square_test(np.histogram(ends, np.append(edges, 2.0))[0], expected)
    report("free paths", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


TURNED = np.array([[0.6, -0.8, 0.0, 0.1], [0.8, 0.6, 0.2, 0.0], [0.0, 0.0, 0.9, -0.1], [0, 0, 0, 1.0]])


def depth_along(grid: wrt.DensityGrid, origin: Any, direction: Any, reach: float) -> float:
    """Return ∫ρ along a ray, summed over many steps by interpolation of NumPy's own."""
    t = (np.arange(40_000) + 0.5) * (reach / 40_000)
    points = origin + t[:, None] * direction
    unit = (points @ np.linalg.inv(grid.to_world)[:3, :3].T) + np.linalg.inv(grid.to_world)[:3, 3]
    cells = unit[:, ::-1] * grid.values.shape - 0.5
    density = map_coordinates(grid.values.astype(np.float64), cells.T, order=1, mode="nearest")
    return float(np.sum(np.where(((unit >= 0) & (unit <= 1)).all(axis=1), density, 0.0)) * (reach / 40_000))


def test_rays_through_a_cloud(device: str, report: Report) -> None:
    """Ratio tracking along rays in all directions, against sums along them."""
    medium = on(CLOUD, wrt.Medium((1.0, 4.0, 9.0)), transform=TURNED)
    rays, each = 24, 2**13
    ends = np.random.default_rng(7).normal(size=(2, rays, 3))
    ends *= np.array([1.2, 0.3])[:, None, None] / np.linalg.norm(ends, axis=2, keepdims=True)
    origins, directions = ends[0], ends[1] - ends[0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[0], directions[1] = (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)
    origins[0], origins[1] = (0.1, 0.05, -2.0), (0.03, 0.01, 0.0)
    _, transmittance = fly(
        medium, origins.repeat(each, 0), directions.repeat(each, 0), device, reach=2.5, is_shadow_ray=True
    )
    transmittance = transmittance.reshape(rays, each, 3)
    assert medium.density is not None
    depth = np.array([depth_along(medium.density, o, d, 2.5) for o, d in zip(origins, directions, strict=True)])
    assert (depth > 0.0).mean() > 0.8
    expected = np.exp(-depth[:, None] * np.array([1.0, 4.0, 9.0]))
    z = (transmittance.mean(axis=1) - expected) / np.maximum(transmittance.std(axis=1) / math.sqrt(each), 1e-5)
    report("worst of 72", f"{np.abs(z).max():.2f} sigma", 0)
    assert np.abs(z).max() < 4.0


def test_majorants_bound_the_density() -> None:
    for shape in ((1, 1, 1), (9, 20, 13)):
        values = np.random.default_rng(1).random(shape).astype(np.float32)
        bounds = grids.majorants(values)
        points = np.random.default_rng(2).random((20_000, 3))
        cells = points * shape - 0.5
        density = map_coordinates(values, cells.T, order=1, mode="nearest")
        block = (points * bounds.shape).astype(int)
        assert (density <= bounds[tuple(block.T)] + 1e-6).all()


ONE = np.ones((1, 1, 1))


def test_media_that_cannot_be_rendered_are_refused() -> None:
    with pytest.raises(wrt.InputError, match="optical depth"):
        wrt.Renderer(boxed(on(ONE, wrt.Medium(1e9)), sky=1.0), width=2, height=2)
    with pytest.raises(wrt.InputError, match="'whitted' cannot render media"):
        wrt.Renderer(boxed(on(ONE, wrt.Medium(1.0)), sky=1.0), width=2, height=2, integrator="whitted")
