"""Bumps too small to see become roughness, and a highlight keeps its energy from near to far (LEAN mapping)."""

import dataclasses
import functools
import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.kernels import map_function, upload
from test_normal_maps import SQUARE, Probe, constant_map, encoded, lit, probes, unit, with_uvs

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import NO_HIT, closest_hit
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.geometry.surface import surface_at
from wrt.kernels.microfacet.widening import WIDENED
from wrt.kernels.scene.scene_data import (
    NORMALS_AT_POINT,
    NORMALS_FILTERED,
    NORMALS_FILTERED_ALONG_TEXTURE,
    SceneData,
)
from wrt.kernels.textures.footprint import texels_across, texture_footprint
from wrt.upload.scene_data import build_scene
from wrt.upload.textures.normal_maps import normals_of, slope_pyramid

pytestmark = pytest.mark.slow

__all__ = ["probes"]  # a fixture of this module too

SIZE = 128
"""Texels along a side of the map."""

REPEATS = 16
"""How often the map is repeated over a metre."""


@functools.cache
def gaussian_slopes() -> NDArray[np.float64]:
    """Return (SIZE, SIZE, 2) slopes that are smooth between texels and follow the normal distribution closely.

    Blurred noise, of which a small map would have its own distribution by chance, moved onto the normal distribution
    by that of its projections, one direction after the other.
    """
    rng = np.random.default_rng(3)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE)))
    noise = np.fft.fft2(rng.normal(size=(SIZE, SIZE, 2)), axes=(0, 1)) * np.exp(-((10.0 * frequency) ** 2))[..., None]
    slopes = np.fft.ifft2(noise, axes=(0, 1)).real.reshape(-1, 2)
    slopes /= slopes.std(axis=0)
    quantiles = stats.norm.ppf((np.arange(len(slopes)) + 0.5) / len(slopes))
    for angle in rng.uniform(0.0, np.pi, 60):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        slopes = slopes @ turn
        for k in range(2):
            slopes[np.argsort(slopes[:, k]), k] = quantiles
        slopes = slopes @ turn.T
    return slopes.reshape(SIZE, SIZE, 2)


@functools.cache
def bumps(covariance: tuple[float, float, float], tilt: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.float32]:
    """Return a map of Gaussian slopes of a covariance (xx, yy, xy)."""
    xx, yy, xy = covariance
    slopes = gaussian_slopes() @ np.linalg.cholesky([[xx, xy], [xy, yy]]).T + tilt
    return encoded(np.dstack([slopes, np.ones((SIZE, SIZE))]))


def even(slope: float) -> tuple[float, float, float]:
    return slope**2, slope**2, 0.0


def far(texels: float, resolution: int, slant: float = 0.0) -> wrt.PerspectiveCamera:
    """Return a camera whose pixels see so many texels at the origin, from an angle to the normal."""
    extent = texels * resolution / (SIZE * REPEATS)
    distance = 100.0
    fov = 2.0 * np.degrees(np.arctan(0.5 * extent / distance))
    place = distance * np.array([np.sin(slant), 0.0, np.cos(slant)])
    return wrt.PerspectiveCamera(tuple(place), (0.0, 0.0, 0.0), fov_degrees=fov)


def plane(material: wrt.Material, light: NDArray, camera: wrt.PerspectiveCamera) -> wrt.Scene:
    repeats = 4.0 * REPEATS  # the square is 4 m wide
    return lit(with_uvs(wrt.quad(*SQUARE), [[repeats, 0.0], [0.0, repeats]]), material, light, camera)


def picture(scene: wrt.Scene, device: str, spp: int, resolution: int, seed: int = 0) -> NDArray[np.float64]:
    """Return (H, W) the first channel of the light reflected once."""
    options = {"max_depth": 2, "filter": "box", "sampler": "independent"}  # noise is measured
    renderer = wrt.Renderer(scene, width=resolution, height=resolution, device=device, seed=seed, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image()[..., 0].astype(np.float64)


# --- The pyramid -------------------------------------------------------------------------------------


def interpolated(normals: NDArray, n: int) -> NDArray[np.float64]:
    """Return the slopes of the bilinear surface at n x n points in each texel, in texels of the finest level."""
    height, width, _ = normals.shape
    y = (np.arange(height * n) + 0.5) / n - 0.5
    x = (np.arange(width * n) + 0.5) / n - 0.5
    rows, columns = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = (y - rows)[:, None, None], (x - columns)[None, :, None]

    def at(dy: int, dx: int) -> NDArray:
        return normals[(rows + dy)[:, None] % height, (columns + dx)[None] % width].astype(np.float64)

    whole = (at(0, 0) * (1 - fx) + at(0, 1) * fx) * (1 - fy) + (at(1, 0) * (1 - fx) + at(1, 1) * fx) * fy
    return whole[..., :2] / whole[..., 2:]


@pytest.mark.parametrize("size", [(8, 8), (5, 7), (1, 6), (12, 1), (1, 1)])
def test_levels_hold_the_moments_of_the_interpolated_map(size: tuple[int, int]) -> None:
    """Of what is seen, bilinear between texels, and not of the texels: those vary more."""
    slopes = np.random.default_rng(2).normal(scale=0.2, size=(*size, 2))
    normals = normals_of(wrt.NormalMap(encoded(np.dstack([slopes, np.ones(size)]))))
    seen = interpolated(normals, 16)
    levels = list(slope_pyramid(normals))
    products = np.stack([seen[..., 0] ** 2, seen[..., 1] ** 2, seen[..., 0] * seen[..., 1]], axis=-1)
    blocks = products.reshape(size[0], 16, size[1], 16, 3).mean(axis=(1, 3))
    means = seen.reshape(size[0], 16, size[1], 16, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(levels[0][0][..., :2], means, atol=2e-4)
    np.testing.assert_allclose(levels[0][1], blocks, atol=2e-4)
    heights = [len(mean) for mean, _ in levels]
    assert heights[-1] == 1
    for finer, coarser in itertools.pairwise(heights):
        assert coarser == (finer + 1) // 2
    for mean, product in levels:
        # Whatever the size, nothing is lost or counted twice.
        np.testing.assert_allclose(mean.mean(axis=(0, 1)), levels[0][0].mean(axis=(0, 1)), atol=1e-6)
        np.testing.assert_allclose(product.mean(axis=(0, 1)), levels[0][1].mean(axis=(0, 1)), atol=1e-6)
    if min(size) > 4:
        texels = (normals[..., :2] / normals[..., 2:]).var(axis=(0, 1))
        assert (levels[-1][1][0, 0, :2] < 0.7 * texels).all()


def test_levels_of_odd_sizes_are_cut_evenly() -> None:
    """A row of five becomes three of 5/3 each, by share."""
    row = np.float32([1, 2, 3, 4, 5])
    from wrt.upload.textures.pyramid import halved

    found = halved(np.broadcast_to(row[None, :, None], (1, 5, 3)).copy())
    expected = [(1 + 2 * 2 / 3) * 0.6, (2 / 3 + 3 + 4 * 2 / 3 - 4 / 3) * 0.6, (4 * 2 / 3 + 5) * 0.6]
    np.testing.assert_allclose(found[0, :, 0], expected, rtol=1e-6)


# --- What a pixel covers -----------------------------------------------------------------------------


@wp.kernel(enable_backward=False)
def footprint_kernel(
    scene: SceneData, origins: wp.array(dtype=wp.vec3), directions: wp.array(dtype=wp.vec3), width: float,
    texels_out: wp.array(dtype=wp.vec4),
):  # fmt: skip
    i = wp.tid()
    ray = Ray()
    ray.origin = origins[i]
    ray.direction = directions[i]
    hit = closest_hit(scene, ray)
    if hit.triangle == NO_HIT:
        texels_out[i] = wp.vec4(-1.0)
    else:
        surface = surface_at(scene, ray, hit)
        texels = texels_across(texture_footprint(scene, hit, surface, ray.direction, width), scene.images[0])
        texels_out[i] = wp.vec4(texels, surface.normal[0], surface.normal[1], surface.normal[2])


def test_footprint_is_the_ellipse_in_the_texture(device: str, report: Report) -> None:
    """Its narrower axis is that of circles of rays, carried to the triangle's plane and into the texture."""
    rng = np.random.default_rng(6)
    corners, uvs = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)) * [0.3, 2.0]
    mesh = wrt.Mesh(corners.astype(np.float32), np.array([[0, 1, 2]]), uvs=uvs.astype(np.float32))
    scene = wrt.Scene()
    scene.add(mesh, material=wrt.Diffuse(normal_map=wrt.NormalMap(np.full((24, 40, 3), 0.5, np.float32))))
    scene.environment = wrt.ConstantEnvironment(1.0)
    n = 2000
    shares = rng.dirichlet((1.0, 1.0, 1.0), n)
    origins = rng.normal(size=(n, 3)) * 3.0
    directions = shares @ corners - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    width = 0.01
    out = wp.empty(n, dtype=wp.vec4, device=device)
    data = build_scene(scene, Device(device)).data
    arrays = [upload(v.astype(np.float32), wp.vec3, device) for v in (origins, directions)]
    wp.launch(footprint_kernel, n, [data, *arrays, width], [out], device=device)
    found = out.numpy()
    assert (found[:, 0] > 0.0).mean() > 0.99
    e1, e2 = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(e1, e2)
    expected = []
    for d in directions:
        across = np.cross(d, [0.3, 0.5, 0.8])
        across /= np.linalg.norm(across)
        other = np.cross(d, across)
        # Parallel rays of a circle of diameter `width` hit the plane here, and the texture there.
        on_plane = [v - d * (v @ normal) / (d @ normal) for v in (width * across, width * other)]
        shares = [np.linalg.lstsq(np.stack([e1, e2], axis=1), v, rcond=None)[0] for v in on_plane]
        in_texture = np.stack([((uvs[1:] - uvs[0]).T @ s) * [40, 24] for s in shares])
        expected.append(np.linalg.svd(in_texture, compute_uv=False)[1])
    slanted = np.abs(directions @ normal) / np.linalg.norm(normal) > 2e-3
    ratio = (found[:, 0] / expected)[(found[:, 0] > 0.0) & slanted]
    report("texels across, over the expected: largest", float(ratio.max()), 1.0)
    np.testing.assert_allclose(ratio, 1.0, rtol=2e-3)


# --- The variance that is left -----------------------------------------------------------------------

COVARIANCES = {"even": even(0.1), "along u": (0.04, 0.01, 0.0), "slanted": (0.02, 0.03, 0.015)}


@pytest.mark.parametrize("name", COVARIANCES)
def test_far_away_all_variance_is_left(name: str, device: str) -> None:
    """Along the axes of the covariance; of materials with axes of their own, along those."""
    covariance = COVARIANCES[name]
    normal_map = wrt.NormalMap(bumps(covariance), filter=True)
    seen = interpolated(normals_of(normal_map), 8).reshape(-1, 2)
    matrix = np.cov(seen.T)
    light = unit(0.1, 0.2, 1.0)
    for tangents, expected in ((False, np.linalg.eigvalsh(matrix)[::-1]), (True, np.diag(matrix))):
        material = Probe("probe_variance", tangents, normal_map=normal_map)
        renderer = wrt.Renderer(plane(material, light, far(300.0, 4)), width=4, height=4, device=device, max_depth=2)
        for _ in renderer.passes(spp=1):
            pass
        np.testing.assert_allclose(renderer.image()[..., :2], np.broadcast_to(expected, (4, 4, 2)), rtol=2e-3)


def test_near_by_none_is_left(device: str) -> None:
    """Where texels are wider than two pixels, and where nothing is filtered."""
    light = unit(0.1, 0.2, 1.0)
    for texels, filtered in ((0.45, True), (100.0, False)):
        material = Probe("probe_variance", normal_map=wrt.NormalMap(bumps(even(0.1)), filter=filtered))
        image = picture(plane(material, light, far(texels, 8)), device, 1, 8)
        np.testing.assert_array_equal(image, 0.0)


def test_variance_grows_with_distance(device: str, report: Report) -> None:
    light = unit(0.1, 0.2, 1.0)
    material = Probe("probe_variance", normal_map=wrt.NormalMap(bumps(even(0.1)), filter=True))
    steps = [0.6, 1.0, 2.0, 4.0, 8.0, 16.0, 100.0]
    means = []
    for texels in steps:
        image = wrt.render(plane(material, light, far(texels, 16)), width=16, height=16, spp=1, device=device)
        means.append(float(image[..., :2].astype(np.float64).sum(axis=2).mean()))
    for texels, mean in zip(steps, means, strict=True):
        report(f"{texels:g} texels across: variance", mean)
    assert (np.diff(means) > 0.0).all()
    assert means[0] < 0.05 * means[-1]


# --- Highlights --------------------------------------------------------------------------------------


def metal(alpha: object, normal_map: wrt.NormalMap | None, **options: Any) -> wrt.Material:
    return wrt.RoughConductor(alpha, f0=1.0, normal_map=normal_map, **{"distribution": "beckmann", **options})


def direction(degrees: float, azimuth: float = 0.0) -> NDArray[np.float64]:
    t, a = np.radians(degrees), np.radians(azimuth)
    return np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])


HIGHLIGHTS = {
    "even": ("beckmann", even(0.1), 0.1, 0.02),
    "even, finer": ("beckmann", even(0.05), 0.05, 0.01),
    "along u": ("beckmann", (0.01, 0.001, 0.0), 0.1, 0.02),
    "slanted": ("beckmann", (0.008, 0.008, 0.006), 0.1, 0.02),
    "brushed": ("beckmann", (0.01, 0.001, 0.0), (0.05, 0.15), 0.03),
    "even, ggx": ("ggx", even(0.1), 0.1, 0.03),
    "even, finer, ggx": ("ggx", even(0.05), 0.05, 0.03),
    "slanted, ggx": ("ggx", (0.008, 0.008, 0.006), 0.1, 0.03),
}
"""Distribution, covariance, roughness, and what second order in slopes amounts to: about twice the variance of them
all; for GGX the error of its mixture too (`test_bumpy_ggx.py`)."""


@pytest.mark.parametrize("name", HIGHLIGHTS)
def test_one_filtered_sample_is_the_mean_of_many(name: str, device: str, report: Report) -> None:
    """In and beside the middle of the highlight, on bumps 64 times finer than a pixel.

    Without the variance the highlight of the mean normal is far from it.
    """
    distribution, covariance, alpha, tolerance = HIGHLIGHTS[name]
    width = np.degrees(np.sqrt(max(covariance[:2])) + np.max(alpha) / 2.0)
    for degrees, azimuth in ((0.0, 0.0), (width, 0.0), (width, 45.0), (width, 90.0), (width, 135.0)):
        light = direction(degrees, azimuth)

        def mean(normal_map: wrt.NormalMap | None, spp: int, light: NDArray = light) -> NDArray:
            return picture(
                plane(metal(alpha, normal_map, distribution=distribution), light, far(64.0, 8)), device, spp, 8
            )

        many = mean(wrt.NormalMap(bumps(covariance)), 4096).mean()
        one = mean(wrt.NormalMap(bumps(covariance), filter=True), 1)
        smooth = mean(None, 1).mean()
        report(f"{degrees:.1f}° at {azimuth:g}°, filtered (smooth {smooth / many:.2f})", float(one.mean() / many), 1.0)
        assert abs(one.mean() / many - 1.0) < tolerance
        assert one.std() < 0.05 * one.mean()
        if degrees == 0.0:
            assert smooth > 1.5 * many


@pytest.mark.parametrize("slant", [0.0, 40.0])
@pytest.mark.parametrize("texels", [1.0, 4.0, 16.0, 64.0])
def test_a_highlight_keeps_its_energy_as_it_shrinks(texels: float, slant: float, device: str, report: Report) -> None:
    """Mean over a whole number of repeats of the map, whatever part of it a pixel sees.

    Bumps are about 16 texels long. What a pixel sees of a few of them is not Gaussian, though its moments are right.
    """
    tolerance = 0.03 if texels in (1.0, 64.0) else 0.06
    light = direction(6.0 - slant, 0.0)
    resolution = max(2, int(SIZE / texels))
    camera = far(texels, resolution, np.radians(slant))

    def mean(filtered: bool, spp: int) -> float:
        normal_map = wrt.NormalMap(bumps(even(0.07)), filter=filtered)
        return float(picture(plane(metal(0.07, normal_map), light, camera), device, spp, resolution).mean())

    samples = 2**18
    expected = mean(False, samples // resolution**2)
    measured = mean(True, max(4, 2**12 // resolution**2))
    report(f"{texels:g} texels, {slant:g}°: filtered over unfiltered", measured / expected, 1.0)
    assert abs(measured / expected - 1.0) < tolerance


def test_bumps_on_a_tilted_mean_normal(device: str, report: Report) -> None:
    """Slopes about a tilted normal are smaller than those of the map: by cos² along the tilt, by cos across."""
    tilt = (0.5, 0.0)
    normal = unit(*tilt, 1.0)
    light = 2.0 * normal[2] * normal - [0.0, 0.0, 1.0]
    values = []
    for filtered, spp in ((False, 4096), (True, 1)):
        normal_map = wrt.NormalMap(bumps(even(0.1), tilt), filter=filtered)
        values.append(picture(plane(metal(0.05, normal_map), light, far(64.0, 8)), device, spp, 8).mean())
    report("tilted by 27 degrees: filtered over unfiltered", values[1] / values[0], 1.0)
    assert abs(values[1] / values[0] - 1.0) < 0.04
    # Without that the variances would be 1/cos⁶ times as large together, and the highlight half as bright.


@pytest.mark.parametrize("multiple", [False, True])
def test_reflected_energy_is_kept(multiple: bool, device: str, report: Report) -> None:
    """Under an even sky a white metal is white, but for what one bounce loses.

    With multiple bounces it is GGX of the roughness that it now has.
    """
    values = {}
    for name, alpha, normal_map in (
        ("bumpy", 0.15, wrt.NormalMap(bumps(even(0.1)))),
        ("filtered", 0.15, wrt.NormalMap(bumps(even(0.1)), filter=True)),
        ("as rough", float(np.sqrt(0.15**2 + 2.0 * 0.1**2)), constant_map(0.0, 0.0, 1.0)),
    ):
        scene = plane(
            metal(alpha, normal_map, distribution="ggx", multiple_bounces=multiple), direction(0.0), far(64.0, 8)
        )
        scene.lights = []
        scene.environment = wrt.ConstantEnvironment(1.0)
        values[name] = float(picture(scene, device, 1024, 8).mean())
        report(f"albedo, {name}", values[name])
    if multiple:
        assert abs(values["filtered"] / values["as rough"] - 1.0) < 0.003
    assert abs(values["filtered"] / values["bumpy"] - 1.0) < (0.005 if multiple else 0.03)


def test_one_sample_has_less_noise(device: str, report: Report) -> None:
    """What filtering is for: between pictures of one sample a pixel, in the highlight."""
    variances = []
    for filtered in (False, True):
        material = metal(0.05, wrt.NormalMap(bumps(even(0.1)), filter=filtered))
        scene = plane(material, direction(5.0), far(64.0, 16))
        pictures = np.stack([picture(scene, device, 1, 16, seed) for seed in range(4)])
        variances.append(pictures.var(axis=0).mean())
    report("variance of one sample, filtered over unfiltered", variances[1] / variances[0])
    assert variances[1] < 1e-3 * variances[0]


def test_what_has_no_roughness_is_not_filtered() -> None:
    """A mirror would be flat from afar: its normals stay those of the points."""
    rough = metal(0.1, None)
    shapes = wrt.RoughConductor((0.1, 0.5), distribution="sgd", masking="kelemen")
    materials = [wrt.Diffuse(), wrt.Mirror(), wrt.Dielectric(), shapes, rough, metal((0.1, 0.2), None)]
    kinds = [NORMALS_AT_POINT] * 4 + [NORMALS_FILTERED, NORMALS_FILTERED_ALONG_TEXTURE]
    for filtered in (False, True):
        normal_map = wrt.NormalMap(bumps(even(0.1)), filter=filtered)
        scene = wrt.Scene()
        for material in materials:
            scene.add(wrt.quad(*SQUARE), material=dataclasses.replace(material, normal_map=normal_map))
        scene.environment = wrt.ConstantEnvironment(1.0)
        data = build_scene(scene, Device("cpu")).data
        found = data.materials.numpy()["normal_filter"]
        np.testing.assert_array_equal(found, kinds if filtered else [NORMALS_AT_POINT] * 6)
        # One image of normals for all; with another one for those that filter comes the pyramid, of eight levels.
        assert len(data.images) == (1 if not filtered else 1 + 1 + 2 * 8)


def test_a_constant_map_is_filtered_to_itself(device: str) -> None:
    light = direction(30.0, 20.0)
    images = []
    for filtered in (False, True):
        normal_map = constant_map(0.2, 0.1, 1.0, filter=filtered)
        images.append(picture(plane(metal(0.3, normal_map), light, far(64.0, 4)), device, 1, 4))
    np.testing.assert_allclose(*images, rtol=1e-3)


def test_variance_widens_a_gaussian_by_addition() -> None:
    """The variances of slopes, α²/2 of Beckmann's, add; the rest stays within its limits."""
    rng = np.random.default_rng(8)
    alpha, variance = rng.uniform(1e-4, 0.5, (1000, 2)), rng.uniform(0.0, 0.2, (1000, 2))
    shapes = np.column_stack([alpha, np.zeros(1000)]).astype(np.float32)
    total = alpha**2 / 2.0 + variance

    def widened(distribution: str, shapes: NDArray, variance: NDArray = variance) -> NDArray[np.float64]:
        return map_function(WIDENED[distribution], shapes, variance, device="cpu").astype(np.float64)

    np.testing.assert_allclose(widened("beckmann", shapes)[:, :2] ** 2 / 2.0, total, rtol=1e-5)
    np.testing.assert_array_equal(widened("beckmann", shapes, np.zeros((1000, 2))), shapes)
    np.testing.assert_array_equal(widened("beckmann", shapes, np.full((1000, 2), 10.0))[:, :2], 1.0)
    same = np.column_stack([alpha[:, 0], alpha[:, 0], np.zeros(1000)])
    mean = alpha[:, 0] ** 2 / 2.0 + variance.mean(axis=1)
    np.testing.assert_allclose(widened("blinn-phong", same)[:, 0] ** 2 / 2.0, mean, rtol=1e-5)
    # Near its peak the ABC distribution is exp(−B C θ²/2).
    b, c = rng.uniform(1.0, 1e4, 1000), rng.uniform(0.5, 5.0, 1000)
    wide = widened("abc", np.column_stack([b, c, np.zeros(1000)]))
    np.testing.assert_allclose(1.0 / (wide[:, 0] * wide[:, 1]), 1.0 / (b * c) + variance.mean(axis=1), rtol=1e-5)
