"""Bumps too small to see become roughness, and a highlight keeps its energy from near to far (LEAN mapping)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from scipy.ndimage import map_coordinates
from support.bumps import (
    SQUARE,
    WITH_PROBES,
    Probe,
    encoded,
    lit,
    rendered,
    unit,
    with_uvs,
)
from support.bumps import registered_probes as registered_probes
from support.covering_kernels import covering, rendering_with

import wrt
from wrt.backend.device import Device
from wrt.kernels.bsdf import filtered_name
from wrt.kernels.core.scene_data import NORMALS_AT_POINT, NORMALS_FILTERED, NORMALS_FILTERED_ALONG_TEXTURE
from wrt.upload.scene_data import SceneUpload
from wrt.upload.textures.pyramid import normals_of

SIZE = 128
"""Texels along a side of the map."""

REPEATS = 16
"""How often the map is repeated over a metre."""


@functools.cache
def gaussian_slopes() -> NDArray[np.float64]:
    """Return (SIZE, SIZE, 2) slopes that are smooth between texels and follow the normal distribution closely.

    Blurred noise, whose distribution in a small map is off by chance, is moved onto the normal distribution by its
    projections, one direction after the other.
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
    """Return a camera whose pixels cover this number of texels at the origin, seen at an angle to the normal."""
    extent, distance = texels * resolution / (SIZE * REPEATS), 100.0
    place = distance * np.array([np.sin(slant), 0.0, np.cos(slant)])
    fov = 2.0 * np.degrees(np.arctan(0.5 * extent / distance))
    return wrt.PerspectiveCamera(tuple(place), (0.0, 0.0, 0.0), fov_degrees=fov)


def plane(material: wrt.Material, light: NDArray, camera: wrt.PerspectiveCamera) -> wrt.Scene:
    repeats = 4.0 * REPEATS  # the square is 4 m wide
    return lit(with_uvs(wrt.quad(*SQUARE), [[repeats, 0.0], [0.0, repeats]]), material, light, camera)


def picture(scene: wrt.Scene, device: str, spp: int, resolution: int, seed: int = 0) -> NDArray[np.float64]:
    """Return (H, W) the first channel of the light reflected once."""
    return rendered(scene, device, spp, resolution, seed=seed)[..., 0]


def metal(alpha: Any, normal_map: wrt.NormalMap | None, distribution: str = "beckmann") -> wrt.Material:
    return wrt.RoughConductor(alpha, f0=1.0, normal_map=normal_map, distribution=distribution)


MAKERS: dict[str, Callable[[Any, wrt.NormalMap | None], wrt.Material]] = {
    **{name: functools.partial(metal, distribution=name) for name in ("beckmann", "ggx", "blinn-phong", "abc")},
    "plastic": lambda alpha, normal_map: wrt.RoughPlastic(0.0, alpha=alpha, normal_map=normal_map),
    "glass": lambda alpha, normal_map: wrt.RoughDielectric(
        1.5, alpha=alpha, normal_map=normal_map, distribution="beckmann", masking="walter"
    ),
}


def models() -> set[str]:
    names = {make((2.0, 2.0) if name == "abc" else 0.1, None).model for name, make in MAKERS.items()}
    return names | {filtered_name(name) for name in names}


two_kernels = rendering_with(WITH_PROBES, covering(*models()))
"""One of Beckmann's distribution, one of all models."""


# --- The variance that is left -----------------------------------------------------------------------

UP = unit(0.1, 0.2, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("covariance", [(0.04, 0.01, 0.0), (0.02, 0.03, 0.015)], ids=["along u", "slanted"])
def test_far_away_all_variance_is_left(covariance: tuple[float, float, float], device: str) -> None:
    """Along the axes of the covariance; of materials with axes of their own, along those."""
    normal_map = wrt.NormalMap(bumps(covariance), filter=True)
    # What is seen is bilinear between texels, and varies less than they do.
    place = (np.mgrid[0 : 8 * SIZE, 0 : 8 * SIZE] + 0.5) / 8.0 - 0.5
    normals = normals_of(normal_map).astype(np.float64)
    x, y, z = (map_coordinates(normals[..., k], place, order=1, mode="grid-wrap") for k in range(3))
    matrix = np.cov((x / z).ravel(), (y / z).ravel())
    for tangents, expected in ((False, np.linalg.eigvalsh(matrix)[::-1]), (True, np.diag(matrix))):
        found = rendered(plane(Probe("probe_variance", tangents, normal_map=normal_map), UP, far(300.0, 4)), device)
        np.testing.assert_allclose(found[..., :2], np.broadcast_to(expected, (4, 4, 2)), rtol=2e-3)


# --- Highlights --------------------------------------------------------------------------------------


def direction(degrees: float, azimuth: float = 0.0, side: float = 1.0) -> NDArray[np.float64]:
    t, a = np.radians(degrees), np.radians(azimuth)
    return np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), side * np.cos(t)])


def case(name: str, covariance: tuple[float, float, float], alpha: Any, tolerance: float, quick: bool = False) -> Any:
    return pytest.param(name, covariance, alpha, tolerance, marks=[] if quick else pytest.mark.slow)


HIGHLIGHTS = [
    case("beckmann", even(0.1), 0.1, 0.02, quick=True),
    case("beckmann", (0.008, 0.008, 0.006), 0.1, 0.02),
    case("beckmann", (0.01, 0.001, 0.0), (0.05, 0.15), 0.03),
    case("abc", even(0.1), (40.0, 5.0), 0.1),
    *(case(name, even(0.1), 0.1, 0.03) for name in MAKERS if name not in ("beckmann", "abc")),
]
"""Material, covariance, roughness, and what second order in slopes amounts to: about twice the variance of them all;
for GGX the error of its mixture too, and for ABC what its tail, which stays as it is, takes from the middle."""


@pytest.mark.parametrize(("name", "covariance", "alpha", "tolerance"), HIGHLIGHTS)
def test_one_filtered_sample_is_the_mean_of_many(
    name: str, covariance: tuple[float, float, float], alpha: Any, tolerance: float, device: str, report: Report
) -> None:
    """In and beside the middle of the highlight, on bumps 64 times finer than a pixel; of glass on both sides.

    Without the variance the highlight of the mean normal is far from it.
    """
    maps = [wrt.NormalMap(bumps(covariance)), wrt.NormalMap(bumps(covariance), filter=True), None]
    width = np.degrees(np.sqrt(max(covariance[:2])) + (0.05 if name == "abc" else np.max(alpha) / 2.0))
    turns = (30.0,) if covariance[0] == covariance[1] and not covariance[2] else (0.0, 45.0, 90.0, 135.0)
    places = [(0.0, 0.0, 1.0), *((width, turn, 1.0) for turn in turns)]
    if name.startswith("glass"):
        places += [(0.0, 0.0, -1.0), (width / 3.0, 30.0, -1.0)]
    for place in places:
        light = direction(*place)
        converged, filtered, smooth = (
            picture(plane(MAKERS[name](alpha, m), light, far(64.0, 8)), device, spp, 8)
            for m, spp in zip(maps, (4096, 1, 1), strict=True)
        )
        ratio = float(filtered.mean() / converged.mean())
        report(f"{name} {place}: filtered over converged (smooth {smooth.mean() / converged.mean():.2f})", ratio, 1.0)
        assert abs(ratio - 1.0) < tolerance
        assert filtered.std() < 0.05 * filtered.mean()
        if place[0] == 0.0:
            assert smooth.mean() > 1.5 * converged.mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "texels", "slant"),
    [
        *(("beckmann", *view) for view in ((1.0, 0.0), (4.0, 40.0), (16.0, 0.0), (64.0, 40.0))),
        *((name, 16.0, 40.0) for name in ("ggx", "glass")),
    ],
)
def test_a_highlight_keeps_its_energy_as_it_shrinks(
    name: str, texels: float, slant: float, device: str, report: Report
) -> None:
    """Mean over a whole number of repeats of the map, whatever part of it a pixel sees.

    Bumps are about 16 texels long. What a pixel sees of a few of them is not Gaussian, though its moments are right.
    """
    tolerance = 0.03 if texels in (1.0, 64.0) else 0.06
    resolution = max(2, int(SIZE / texels))

    def mean(filtered: bool, spp: int) -> float:
        material = MAKERS[name](0.07, wrt.NormalMap(bumps(even(0.07)), filter=filtered))
        scene = plane(material, direction(6.0 - slant), far(texels, resolution, np.radians(slant)))
        return float(picture(scene, device, spp, resolution).mean())

    ratio = mean(True, max(4, 2**12 // resolution**2)) / mean(False, 2**18 // resolution**2)
    report(f"{name}, {texels:g} texels, {slant:g}°: filtered over unfiltered", ratio, 1.0)
    assert abs(ratio - 1.0) < tolerance


@pytest.mark.slow
def test_bumps_on_a_tilted_mean_normal(device: str, report: Report) -> None:
    """Slopes about a tilted normal are smaller than those of the map: by cos² along the tilt, by cos across.

    Without that the variances would be 1/cos⁶ times as large together, and the highlight half as bright.
    """
    tilt = (0.5, 0.0)
    normal = unit(*tilt, 1.0)
    light = 2.0 * normal[2] * normal - [0.0, 0.0, 1.0]
    values = []
    for filtered, spp in ((False, 4096), (True, 1)):
        normal_map = wrt.NormalMap(bumps(even(0.1), tilt), filter=filtered)
        values.append(picture(plane(metal(0.05, normal_map), light, far(64.0, 8)), device, spp, 8).mean())
    report("tilted by 27 degrees: filtered over unfiltered", values[1] / values[0], 1.0)
    assert abs(values[1] / values[0] - 1.0) < 0.04


def test_what_has_no_roughness_is_not_filtered() -> None:
    """A mirror would be flat from afar: its normals stay those of the points."""
    shapes = wrt.RoughConductor((0.1, 0.5), distribution="sgd", masking="kelemen")
    materials = [wrt.Diffuse(), wrt.Mirror(), wrt.Dielectric(), shapes, metal(0.1, None), metal((0.1, 0.2), None)]
    kinds = [NORMALS_AT_POINT] * 4 + [NORMALS_FILTERED, NORMALS_FILTERED_ALONG_TEXTURE]
    for filtered in (False, True):
        normal_map = wrt.NormalMap(bumps(even(0.1)), filter=filtered)
        scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
        for material in materials:
            scene.add(wrt.quad(*SQUARE), material=dataclasses.replace(material, normal_map=normal_map))
        data = SceneUpload(scene, Device("cpu")).finish().data
        found = data.materials.numpy()["normal_filter"]
        np.testing.assert_array_equal(found, kinds if filtered else [NORMALS_AT_POINT] * 6)
        # All share one image of normals; filtered maps add another one and its pyramid of eight levels.
        assert len(data.images) == (1 if not filtered else 1 + 1 + 2 * 8)
