"""Where caustics lie and how bright they are: lenses, mirrors, prisms and tinted glass by geometrical optics.

The sun is straight above optics and a dark screen, which a camera between them sees from straight above or below; what
paths find alone is subtracted. Paths of four segments leave out light with inner reflections. Photons blur a picture by
FIRST_RADIUS pixels at most. So the light within a circle lies between the expected light of two circles, one smaller
and one larger by that radius.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.fresnel import by_angles
from support.small_scenes import image_of

import wrt
from wrt.rendering.photons import FIRST_RADIUS
from wrt.scene.materials.dispersion import channel_indices

pytestmark = pytest.mark.slow

Array = NDArray[np.floating[Any]]

SIZE = 64
SEEDS = 4
ALBEDO = 1e-3
"""Of the screen: its light must not come back from the optics."""


class Screen(NamedTuple):
    """Irradiance on a screen in the sun's units.

    Attributes:
        irradiance: (SEEDS, SIZE, SIZE, 3), of renders with other random numbers.
        x: (SIZE, SIZE) places of the pixels along the world's x, metres.
        z: the same along its z.
        pixel: size of a pixel, metres.
    """

    irradiance: Array
    x: Array
    z: Array
    pixel: float

    def power(self, within: Array | bool = True) -> tuple[Array, Array]:
        """Return the power of the channels in a part of the screen, and its standard error."""
        inside = np.broadcast_to(within, self.x.shape)
        powers = self.irradiance[:, inside].sum(axis=1) * self.pixel**2
        return powers.mean(axis=0), powers.std(axis=0, ddof=1) / np.sqrt(SEEDS)


def screen_under(*optics: wrt.Shape, height: float, view: float, upwards: bool = False) -> Screen:
    """Render the caustic on a screen of `view` metres a side, at a height, under a sun of unit irradiance."""
    half, gap = 0.5 * view, -1e-2 if upwards else 1e-2
    shape = wrt.Shape(wrt.quad((-half, height, half), (view, 0.0, 0.0), (0.0, 0.0, -view)), wrt.Diffuse(ALBEDO))
    eye, target = (0.0, height + gap, 0.0), (0.0, height, 0.0)
    camera = wrt.OrthographicCamera(eye, target, up=(0.0, 0.0, -1.0), view_height=view)
    scene = wrt.Scene([shape, *optics], camera=camera)
    scene.add_light(wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0))
    options: dict[str, Any] = {"width": SIZE, "height": SIZE, "max_depth": 4, "filter": "box"}
    with_photons, alone = (
        np.array([image_of(wrt.Renderer(scene, seed=k, caustics=which, **options), 32) for k in range(SEEDS)])
        for which in (True, False)
    )
    pixel = view / SIZE
    along = (np.arange(SIZE) + 0.5 - 0.5 * SIZE) * pixel
    x, z = np.meshgrid(-along if upwards else along, along)
    return Screen((with_photons - alone).astype(np.float64) * (np.pi / ALBEDO), x, z, pixel)


def turned(profile: Array, normals: Array, around: int = 192) -> wrt.Mesh:
    """Return the mesh that a profile, (N, 2) points of radius and height with normals, draws around the axis y."""
    angles = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    points, directions = (
        np.stack([rows[:, :1] * np.cos(angles), np.repeat(rows[:, 1:], around, 1), rows[:, :1] * np.sin(angles)], -1)
        for rows in (profile, normals)
    )
    at = np.arange(len(profile) * around).reshape(len(profile), around)
    a, b, c, d = at[:-1], at[1:], np.roll(at[1:], -1, 1), np.roll(at[:-1], -1, 1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return wrt.Mesh(points.reshape(-1, 3), faces, normals=directions.reshape(-1, 3))


def check_circles(screen: Screen, arrivals: Array, powers: Array, radii: tuple[float, ...], report: Report) -> None:
    """Compare the power within circles with that of rays that arrive at distances from the centre."""
    blur = (FIRST_RADIUS + 1.0) * screen.pixel  # and the pixels on the circle
    for radius in radii:
        found, error = screen.power(np.hypot(screen.x, screen.z) < radius)
        least, most = (powers[np.abs(arrivals) < limit].sum() for limit in (radius - blur, radius + blur))
        report(f"power within {radius} m", float(found[1] / most), 1.0)
        assert (error < 0.01 * most).all()
        assert (found > 0.998 * least - 4.0 * error).all()
        assert (found < 1.002 * most + 4.0 * error).all()


def passing(cos_i: Any, n: Any) -> Array:
    """Return the share of light that a surface lets through, from either side, by the angle in air."""
    return 1.0 - by_angles(np.minimum(cos_i, 1.0 - 1e-9), n)


def test_a_ball_has_its_caustic(report: Report) -> None:
    """Rays cross before the paraxial focus, n R / (2 (n − 1)) from the centre, the more the farther out they enter."""
    n, radius, steps = 1.5, 0.5, 20000
    drop = n * radius / (2.0 * (n - 1.0))
    ball = wrt.Shape(wrt.sphere((0.0, drop, 0.0), radius, exact=True), wrt.Dielectric(n))
    screen = screen_under(ball, height=0.0, view=1.6)
    theta = (np.arange(steps) + 0.5) * (0.5 * np.pi / steps)
    inner = np.arcsin(np.sin(theta) / n)
    incident = np.sin(2.0 * theta) * np.pi * radius**2 * (0.5 * np.pi / steps)
    through = passing(np.cos(theta), n)
    # A ray that enters at θ leaves at 2 θ' − θ on the other side of the axis, turned by 2 (θ − θ') in all.
    x, y = radius * np.sin(2.0 * inner - theta), drop - radius * np.cos(2.0 * inner - theta)
    arrivals = x - np.tan(2.0 * (theta - inner)) * y
    reflected = radius * np.sin(theta) - np.tan(2.0 * theta) * (drop + radius * np.cos(theta))
    arrivals = np.concatenate([arrivals, np.where(theta > 0.25 * np.pi, reflected, np.inf)])
    powers = np.concatenate([through**2 * incident, (1.0 - through) * incident])
    check_circles(screen, arrivals, powers, (0.15, 0.3, 0.7), report)


def test_a_lens_without_aberration_focuses_all_its_light(report: Report) -> None:
    """A flat face, and a hyperboloid of eccentricity n below: all parallel light meets in its focus, below the screen.

    Ways are as long along all rays, n (h − f) + f = ρ at height h and distance ρ from the focus (Hecht, section 5.2).
    """
    n, focus, drop = 1.5, 1.0, 0.25
    phi = np.linspace(1e-4, 0.4, 128)
    rho = focus * (n - 1.0) / (n * np.cos(phi) - 1.0)
    radius, height = rho * np.sin(phi), rho * np.cos(phi)
    alpha = np.arctan2(np.sin(phi), n - np.cos(phi))  # of the normal and the axis: n sin α = sin(α + φ)
    curved = turned(np.stack([radius, height], -1), np.stack([np.sin(alpha), -np.cos(alpha)], -1))
    side = 2.0 * radius[-1]
    flat = wrt.quad((-radius[-1], height[-1], radius[-1]), (side, 0.0, 0.0), (0.0, 0.0, -side))
    glass = wrt.Dielectric(n)
    screen = screen_under(wrt.Shape(flat, glass), wrt.Shape(curved, glass), height=drop, view=0.5)
    leaving, turn = (0.5 * (angle[1:] + angle[:-1]) for angle in (alpha + phi, phi))
    powers = passing(1.0, n) * passing(np.cos(leaving), n) * np.pi * np.diff(radius**2)
    check_circles(screen, drop * np.tan(turn), powers, (0.05, 0.09, 0.2), report)


def test_a_parabolic_mirror_sends_all_light_to_its_focus(report: Report) -> None:
    """The screen is below the focus, where the light is a ring."""
    focus, drop = 1.0, 0.25
    radius = np.linspace(0.4, 0.8, 64)
    height = 0.25 * radius**2 / focus
    normals = np.stack([-0.5 * radius / focus, np.ones_like(radius)], -1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mesh = turned(np.stack([radius, height], -1), normals)
    screen = screen_under(wrt.Shape(mesh, wrt.Mirror((0.9, 0.6, 0.3))), height=focus - drop, view=0.6, upwards=True)
    arrivals = radius * drop / (focus - height)
    relative = Screen(screen.irradiance / (0.9, 0.6, 0.3), *screen[1:])
    check_circles(relative, 0.5 * (arrivals[1:] + arrivals[:-1]), np.pi * np.diff(radius**2), (0.17, 0.29), report)


def test_a_prism_parts_the_colours(report: Report) -> None:
    """Each goes where Snell's law sends its index, all of it."""
    alpha, drop, half = np.radians(30.0), 1.0, 0.1
    rise = half * np.tan(alpha)
    glass = wrt.Dielectric(1.5, dispersion=2.0)
    top = wrt.quad((-half, drop + rise, half), (2.0 * half, 0.0, 0.0), (0.0, 0.0, -2.0 * half))
    slope = wrt.quad((-half, drop - rise, -half), (2.0 * half, 2.0 * rise, 0.0), (0.0, 0.0, 2.0 * half))
    screen = screen_under(wrt.Shape(top, glass), wrt.Shape(slope, glass), height=0.0, view=1.2)
    n = np.array(channel_indices(1.5, 2.0))
    beta = np.arcsin(n * np.sin(alpha))
    expected = passing(1.0, n) * passing(np.cos(beta), n) * (2.0 * half) ** 2
    power, error = screen.power()
    places = (screen.irradiance.mean(axis=0) * screen.x[..., None]).sum(axis=(0, 1)) * screen.pixel**2 / power
    report("power of the channels", float(np.mean(power / expected)), 1.0)
    report("place of green", float(places[1]), float(-drop * np.tan(beta - alpha)[1]))
    assert (error < 0.005 * expected).all()
    assert (np.abs(power - expected) < 4.0 * error).all()
    # Colours lie 2 cm apart, pixels 19 mm.
    np.testing.assert_allclose(places, -drop * np.tan(beta - alpha), rtol=0.0, atol=1e-3)


def test_tinted_glass_dims_light_by_its_way(report: Report) -> None:
    """By the law of Beer and Lambert, in a slab turned by 30 degrees."""
    n, thickness, degrees, absorption = 1.5, 0.3, 30.0, np.array((0.5, 1.0, 3.0))
    slab = wrt.box((-1.0, 0.8, -1.0), (1.0, 0.8 + thickness, 1.0)).rotated((0.0, 0.0, 1.0), degrees)
    glass = wrt.Dielectric(n, interior=wrt.Medium(absorption=tuple(absorption)))
    screen = screen_under(wrt.Shape(slab, glass), height=0.0, view=0.4)
    cosine = np.sqrt(1.0 - (np.sin(np.radians(degrees)) / n) ** 2)
    expected = passing(np.cos(np.radians(degrees)), n) ** 2 * np.exp(-absorption * thickness / cosine)
    found, error = screen.power((np.abs(screen.x) < 0.15) & (np.abs(screen.z) < 0.15))
    area = np.count_nonzero((np.abs(screen.x) < 0.15) & (np.abs(screen.z) < 0.15)) * screen.pixel**2
    report("irradiance behind tinted glass", float(found[2] / area / expected[2]), 1.0)
    assert (error < 0.02 * expected * area).all()
    assert (np.abs(found / area - expected) < 4.0 * error / area).all()
