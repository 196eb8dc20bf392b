"""The environment image: where its texels are, and how directions are drawn by its brightness."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc
from support.bsdfs import sphere
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

import wrt
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.core.rays import RECEIVES_ANYWHERE, RECEIVES_FRONT, Receiver
from wrt.kernels.core.scene_data import EnvironmentData
from wrt.kernels.lights.environment import image_pdf, point_direction, point_towards, radiance_at, sample_image
from wrt.scene.environment import image_directions
from wrt.scene.motion import rotation_matrix
from wrt.upload.lights.environment import upload_environment
from wrt.upload.lights.environment_sampling import COLUMNS, ROWS


@wp.kernel(enable_backward=False)
def look(environment: EnvironmentData, receiver: Receiver, d: wp.array(dtype=wp.vec3), out: wp.array2d(dtype=wp.vec3)):
    i = wp.tid()
    point = point_towards(environment, d[i])
    out[0, i] = radiance_at(environment, point.uv)
    out[1, i] = wp.vec3(point.uv[0], point.uv[1], image_pdf(environment, receiver, point))
    out[2, i] = point_direction(environment, point)


@wp.kernel(enable_backward=False)
def draw(environment: EnvironmentData, receiver: Receiver, u: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec4)):
    i = wp.tid()
    s = sample_image(environment, receiver, u[i])
    out[i] = wp.vec4(s.wi[0], s.wi[1], s.wi[2], s.pdf)


class Sky:
    """An environment on a device, and what the kernels say of it to a receiver with this normal, or with none."""

    def __init__(self, pixels: NDArray, device: str, degrees: float = 0.0, normal: ArrayLike | None = None) -> None:
        initialize_warp()
        self.device = device
        self.data, _ = upload_environment(wrt.ImageEnvironment(pixels, rotation_degrees=degrees), device)
        self.receiver = Receiver()
        self.receiver.receives = RECEIVES_ANYWHERE if normal is None else RECEIVES_FRONT
        self.normal = None if normal is None else np.divide(normal, np.linalg.norm(normal))
        if normal is not None:
            self.receiver.normal = wp.vec3(*self.normal)

    def look(self, directions: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return radiance, density, (u, v) and the direction of that (u, v)."""
        out = wp.empty((3, len(directions)), dtype=wp.vec3, device=self.device)
        inputs = [self.data, self.receiver, upload(directions, wp.vec3, self.device)]
        wp.launch(look, len(directions), inputs, [out], device=self.device)
        radiance, point, back = out.numpy().astype(np.float64)
        return radiance, point[:, 2], point[:, :2], back

    def sample(self, u: NDArray) -> tuple[NDArray, NDArray]:
        out = wp.empty(len(u), dtype=wp.vec4, device=self.device)
        wp.launch(draw, len(u), [self.data, self.receiver, upload(u, wp.vec2, self.device)], [out], device=self.device)
        values = out.numpy().astype(np.float64)
        return values[:, :3], values[:, 3]

    def green(self, d: NDArray) -> NDArray:
        """Return the irradiance per solid angle from directions, or the radiance where there is no normal."""
        cosine = 1.0 if self.normal is None else np.maximum(d @ self.normal, 0.0)
        return self.look(d)[0][:, 1] * cosine


def image_grid(height: int, width: int, degrees: float) -> tuple[NDArray, NDArray]:
    """Return the directions of the middles of cells of equal (polar angle, azimuth), and their solid angles."""
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    d = image_directions(height, width).reshape(-1, 3) @ rotation_matrix((0, 1, 0), degrees).T
    return d, np.repeat(edges[:-1] - edges[1:], width) * (2.0 * np.pi / width)


def image_cells(d: NDArray, height: int, width: int, degrees: float) -> NDArray[np.int64]:
    """Return in which cell of `image_grid` each direction lies."""
    # Arcus tangent, not cosine: float32 directions hold it near the poles as well.
    v = np.arctan2(np.hypot(d[:, 0], d[:, 2]), d[:, 1]) / np.pi
    u = ((np.arctan2(d[:, 0], -d[:, 2]) + np.radians(degrees)) / (2.0 * np.pi) + 0.5) % 1.0
    row, column = (np.minimum((x * n).astype(np.int64), n - 1) for x, n in ((v, height), (u, width)))
    return row * width + column


def noise(height: int, width: int) -> NDArray[np.float32]:
    return np.random.default_rng(3).random((height, width, 3), dtype=np.float32) ** 4


def hot(height: int, width: int, y: int, x: int) -> NDArray[np.float32]:
    pixels = np.zeros((height, width, 3), np.float32)
    pixels[y, x] = (5.0, 3.0, 1.0)
    return pixels


SKIES = {
    "noise, turned": (noise(5, 7), 77.0, (0.3, -0.8, 0.5)),
    "fine noise": (noise(60, 100), 0.0, (-0.2, 0.1, 0.9)),
    "a hot pixel, from behind": (hot(8, 16, 2, 5), 0.0, (0, -1, 0)),
    "a hot pixel at the zenith's seam": (hot(6, 8, 0, 0), -30.0, (1, 0, 0)),
    "a sun over dim sky": (0.02 + hot(9, 12, 4, 11), 10.0, (0, 1, 0)),
    "one pixel, in the air": (np.ones((1, 1, 3), np.float32), 0.0, None),
    "clear sky": (wrt.SunSkyEnvironment(20.0, 70.0).image_and_sun()[0].pixels, 0.0, (0, 1, 0)),
}
"""Pixels, rotation, normal of the receiver."""


@pytest.mark.parametrize("name", SKIES)
def test_directions_are_drawn_with_the_stated_density(name: str, device: str, report: Report) -> None:
    """Cells are parts of bins, where density times sine is constant: its integral is exact.

    Cells of cosθ would not do, as density has a singularity at the poles.
    """
    n = 2**19
    pixels, degrees, normal = SKIES[name]
    sky = Sky(pixels, device, degrees, normal)
    side = sky.data.side
    parts = max(1, 8 // side)
    height, width = parts * ROWS * side, parts * COLUMNS * side
    d, _ = image_grid(height, width, degrees)
    sine = np.hypot(d[:, 0], d[:, 2])
    probability = sky.look(d)[1] * sine * 2.0 * np.pi**2 / (height * width)
    assert probability.sum() == pytest.approx(1.0, abs=1e-5)
    wi, pdf = sky.sample(uniforms(n, 2, seed=1))
    counts = np.bincount(image_cells(wi, height, width, degrees), minlength=height * width)
    dark = probability == 0.0
    # A sample on the very edge of a bin may round to the other side.
    assert counts[dark].sum() <= 10
    result = chi_square_test(counts[~dark], n * probability[~dark], tests=len(SKIES))
    report(name, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message

    # Each sample states the density of its direction. Near a pole that is of a polar angle which a direction does not
    # hold exactly; on the edge of a bin, rounding finds the neighbour's.
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1.0, atol=1e-6)
    assert (pdf > 0.0).all()
    _, found, uv, _ = sky.look(wi)
    place = uv * [COLUMNS * side, ROWS * side]
    inside = (np.abs(place - np.rint(place)) > 1e-3).all(axis=1) & (np.abs(wi[:, 1]) < 0.9999)
    assert inside.mean() > 0.9
    np.testing.assert_allclose(found[inside], pdf[inside], rtol=2e-4)

    # The mean of radiance over density is the integral, by a quadrature good to 1e-4.
    parts = max(2, 256 // len(pixels))
    d, solid_angle = image_grid(parts * pixels.shape[0], parts * pixels.shape[1], degrees)
    exact = (sky.green(d) * solid_angle).sum()
    values = sky.green(wi) / pdf
    error = values.std(ddof=1) / np.sqrt(n)
    report(f"{name}: integral of green", float(values.mean()), float(exact))
    assert abs(values.mean() - exact) <= 3.5 * error + 1e-4 * exact


def test_surfaces_hardly_look_behind_them(device: str, report: Report) -> None:
    """By the table for its normal, a surface sees light that is not dim with less than a quarter of the variance."""
    pixels = 1.0 + 20.0 * noise(32, 64)
    u = uniforms(2**15, 2, seed=7)
    for normal in sphere(4, seed=6):
        variances = []
        for sky in (Sky(pixels, device, normal=normal), Sky(pixels, device)):
            wi, pdf = sky.sample(u)
            values = sky.look(wi)[0][:, 1] * np.maximum(wi @ normal, 0.0) / pdf
            variances.append(float(values.var() / values.mean() ** 2))
            assert sky.normal is None or (wi @ normal < 0.0).mean() < 0.03
        report("relative variance with and without a normal", variances)
        assert variances[0] < 0.25 * variances[1]


def test_even_points_stay_even(device: str, report: Report) -> None:
    """Means over Sobol's points, scrambled anew each time, err by less than a third of what independent numbers do."""
    sky = Sky(0.3 + noise(16, 32), device, normal=(0.0, 1.0, 0.0))
    count, runs = 4096, 64

    def spread(u: NDArray) -> float:
        wi, pdf = sky.sample(u.reshape(-1, 2))
        return float((sky.green(wi) / pdf).reshape(runs, count).mean(axis=1).std())

    even = np.stack([qmc.Sobol(2, rng=k).random(count) for k in range(runs)])
    ratio = spread(even.astype(np.float32)) / spread(uniforms(runs * count, 2, seed=8))
    report("error of even points over that of independent ones", ratio, "< 1/3")
    assert ratio < 1.0 / 3.0


def test_texels_lie_where_the_description_says(device: str) -> None:
    """Row 0 is up; the middle is −z, columns to the right turn to +x; rotation goes counter-clockwise from above."""
    height, width, degrees = 12, 24, -35.0
    pixels = np.arange(height * width * 3, dtype=np.float32).reshape(height, width, 3)
    row, column = (a.ravel() for a in np.meshgrid(np.arange(height), np.arange(width), indexing="ij"))
    # Looking along −z, to the right is +x.
    polar, azimuth = np.pi * (row + 0.5) / height, 2.0 * np.pi * ((column + 0.5) / width - 0.5)
    d = np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=1)
    # Seen from above (x to the right, z down the page) a turn counter-clockwise takes +z to +x.
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    radiance, _, uv, _ = Sky(pixels, device, degrees).look(d @ turn.T)
    np.testing.assert_allclose(radiance, pixels.reshape(-1, 3), rtol=1e-4, atol=5e-3)
    np.testing.assert_allclose(uv, np.stack([(column + 0.5) / width, (row + 0.5) / height], axis=1), atol=1e-5)
    # Directions and (u, v) are each other's inverse. The polar angle comes from its cosine: it is good to eps / sin.
    d = sphere(100_000, seed=5)
    _, _, uv, back = Sky(pixels, device, degrees).look(d)
    assert 0.0 <= uv.min() <= uv.max() <= 1.0
    sine = np.maximum(np.sqrt(1.0 - d[:, 1] ** 2), 1e-3)
    assert (np.linalg.norm(back - d, axis=1) < 1e-6 + 4.0 * np.finfo(np.float32).eps / sine).all()
