"""What is inside of things, and around them, for docs/media.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import wrt

from .bodies import checkered, facing, sweep, turned
from .picture import Picture

AIM = (0.0, 0.06, 0.0)
"""What the lamps of the table face."""


def table(camera: wrt.PerspectiveCamera, color: tuple[float, float, float] = (0.62, 0.6, 0.57)) -> wrt.Scene:
    """Return a table under a soft box, with a strip light on the other side and a dim sky.

    The lamps are large: light that glass and wax gather is found by chance, and these are hit often.
    """
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment((0.4, 0.43, 0.48)))
    scene.add(sweep(2.5, 1.5, 0.4, 0.5, 2.0), material=wrt.Diffuse(color), name="table")
    for center, width, height, radiance in (
        ((-0.7, 0.75, 0.15), 1.0, 1.0, (2.3, 2.25, 2.15)),
        ((0.6, 0.35, -0.3), 0.3, 0.6, (2.6, 2.8, 3.1)),
    ):
        scene.add(facing(center, AIM, width, height), material=wrt.Diffuse(0.0), emission=radiance, name="lamp")
    return scene


def water_and_ice() -> wrt.Scene:
    """A glass of water with ice, the water reaching half a millimetre into the glass."""
    scene = table(wrt.PerspectiveCamera((0.0, 0.2, 0.62), (0.0, 0.066, 0.0), fov_degrees=16.0))
    squares = checkered(range(-14, 14), range(-14, 14), 0.025)
    for mesh, color in zip(squares, ((0.72, 0.7, 0.66), (0.06, 0.14, 0.34)), strict=True):
        scene.add(mesh, material=wrt.Diffuse(color), name="cloth")
    straw = turned([(0.0, 0.0), (0.003, 0.0), (0.003, 0.19), (0.0, 0.19)])
    straw = straw.rotated((0, 0, 1), -19.0).translated((-0.022, 0.016, -0.006))
    scene.add(straw, material=wrt.Diffuse((0.65, 0.05, 0.04)), name="straw")
    glass = wrt.Dielectric("glass", interior=wrt.Medium.from_color((0.8, 0.95, 0.9), 0.05), priority=3)
    inner, outer, bottom, top = 0.034, 0.037, 0.012, 0.13
    wall = [(0.0, 0.0005), (outer - 0.002, 0.0005), (outer, 0.0025), (outer, top - 0.001), (outer - 0.001, top)]
    hollow = [
        (inner + 0.001, top),
        (inner, top - 0.001),
        (inner, bottom + 0.004),
        (inner - 0.004, bottom),
        (0.0, bottom),
    ]
    scene.add(turned([*wall, *hollow]), material=glass, name="glass")
    water = wrt.Dielectric("water", interior=wrt.Medium.from_color((0.55, 0.85, 0.95), 0.2), priority=1)
    level, over = 0.1, 0.0005
    body = [
        (0.0, bottom - over),
        (inner - 0.004, bottom - over),
        (inner + over, bottom + 0.004),
        (inner + over, level),
        (0.0, level),
    ]
    scene.add(turned(body), material=water, name="water")
    ice = wrt.Dielectric(1.31, priority=2)
    for center, turn, degrees in (
        ((-0.012, 0.095, 0.011), (0.3, 1.0, 0.2), 35.0),
        ((0.015, 0.089, 0.012), (1.0, 0.6, 0.4), 50.0),
        ((-0.004, 0.066, 0.014), (0.2, 0.5, 1.0), 20.0),
    ):
        cube = wrt.box((-0.0105,) * 3, (0.0105,) * 3).rotated(turn, degrees).translated(center)
        scene.add(cube, material=ice, name="ice")
    return scene


def coloured_glass() -> wrt.Scene:
    """Blocks of one glass, two, four and eight centimetres thick."""
    scene = table(wrt.PerspectiveCamera((0.1, 0.28, 0.75), (0.02, 0.045, 0.0), fov_degrees=15.0), (0.75, 0.74, 0.72))
    amber = wrt.Dielectric("glass", interior=wrt.Medium.from_color((0.85, 0.45, 0.08), 0.05))
    x = -0.155
    for thickness in (0.02, 0.04, 0.08):
        block = wrt.box((x, 0.0005, -0.5 * thickness), (x + 0.08, 0.1, 0.5 * thickness))
        scene.add(block, material=amber)
        x += 0.11
    return scene


def fog() -> wrt.Scene:
    """A hall full of haze, lit by a low lamp through three windows."""
    camera = wrt.PerspectiveCamera((1.0, 1.35, 4.6), (-0.1, 1.25, -1.5), fov_degrees=44.0)
    scene = wrt.Scene(camera=camera)
    scene.settings.max_depth = 4
    scene.settings.exposure = 0.4
    west, east, front, back, top = -2.6, 2.6, 5.5, -4.0, 3.4
    # The lamp stands in clear air: near it, the radiance of haze has no bound, and few paths would find that.
    haze = wrt.Null(interior=wrt.Medium.from_albedo((0.93, 0.94, 0.95), 0.14, g=0.5))
    scene.add(wrt.box((west - 0.5, -0.5, back - 0.5), (east + 0.5, top + 0.5, front + 0.5)), material=haze, name="haze")
    stone = wrt.Diffuse((0.24, 0.225, 0.21))
    scene.add(wrt.quad((west, 0, front), (east - west, 0, 0), (0, 0, back - front)), material=stone, name="floor")
    scene.add(wrt.quad((west, top, back), (east - west, 0, 0), (0, 0, front - back)), material=stone, name="ceiling")
    scene.add(wrt.quad((west, 0, back), (east - west, 0, 0), (0, top, 0)), material=stone, name="wall")
    scene.add(wrt.quad((east, 0, back), (0, 0, front - back), (0, top, 0)), material=stone, name="wall")
    sill, lintel, width, thick = 0.7, 2.9, 0.95, 0.25
    windows = (-2.9, -1.4, 0.1)
    edges = [back, *(z + side for z in windows for side in (-0.5 * width, 0.5 * width)), front]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        scene.add(wrt.box((west - thick, 0, low), (west, top, high)), material=stone, name="pier")
    for z in windows:
        for low, high in ((0.0, sill), (lintel, top)):
            part = wrt.box((west - thick, low, z - 0.5 * width), (west, high, z + 0.5 * width))
            scene.add(part, material=stone, name="sill")
    scene.add(wrt.box((0.1, 0.0, -1.75), (0.45, 1.0, -1.4)), material=wrt.Diffuse((0.35, 0.2, 0.12)), name="plinth")
    ball = wrt.sphere((0.275, 1.22, -1.575), 0.22, subdivisions=5)
    scene.add(ball, material=wrt.Diffuse((0.6, 0.12, 0.06)), name="ball")
    # Far away, so that nothing in the hall is much nearer to it than the rest.
    place, aim = np.array([-10.5, 7.0, -3.4]), np.array([0.2, 0.6, -1.6])
    warm = (3300.0, 2700.0, 1900.0)
    scene.add_light(wrt.SpotLight(place, aim - place, intensity=warm, inner_degrees=13.0, outer_degrees=16.0))
    scene.environment = None
    return scene


KING = (
    *((0.0, 0.0005), (0.021, 0.0005), (0.022, 0.002), (0.022, 0.007), (0.019, 0.010), (0.0175, 0.013), (0.012, 0.021)),
    *((0.0095, 0.032), (0.0085, 0.045), (0.009, 0.054), (0.0145, 0.0565), (0.0145, 0.0585), (0.0105, 0.061)),
    *((0.0095, 0.064), (0.012, 0.078), (0.0135, 0.0835), (0.0125, 0.086), (0.006, 0.0895), (0.0035, 0.0915)),
    *((0.0055, 0.0955), (0.0055, 0.0985), (0.003, 0.1015), (0.0, 0.1022)),
)
"""Radius and height along a chessman, metres."""


def subsurface() -> wrt.Scene:
    """A candle and three chessmen, of wax, marble and jade, with a lamp behind them."""
    scene = table(wrt.PerspectiveCamera((0.0, 0.17, 0.62), (0.0, 0.052, 0.0), fov_degrees=19.0), (0.33, 0.3, 0.28))
    wax = wrt.Null(interior=wrt.Medium.from_subsurface((0.93, 0.72, 0.42), (0.012, 0.006, 0.003)))
    candle = [(0.0, 0.0005), (0.028, 0.0005), (0.03, 0.003), (0.03, 0.077), (0.028, 0.081), (0.02, 0.077), (0.0, 0.075)]
    scene.add(turned(candle, 60.0).translated((-0.125, 0, 0)), material=wax, name="candle")
    scene.add_light(wrt.SphereLight((-0.125, 0.089, 0.0), 0.008, radiance=(60.0, 36.0, 14.0)))
    marble = wrt.Medium.from_subsurface((0.9, 0.88, 0.84), (0.004, 0.0035, 0.003))
    jade = wrt.Medium.from_subsurface((0.3, 0.75, 0.42), (0.003, 0.006, 0.004))
    for x, material in (
        (-0.045, wrt.Null(interior=wrt.Medium.from_subsurface((0.9, 0.45, 0.32), (0.009, 0.004, 0.0025)))),
        (0.03, wrt.RoughDielectric(1.45, alpha=0.25, interior=marble)),
        (0.105, wrt.RoughDielectric(1.5, alpha=0.25, interior=jade)),
    ):
        scene.add(turned(KING, 60.0).translated((x, 0, 0)), material=material, name="king")
    return scene


# --- A cumulus cloud on a grid ---------------------------------------------------------------------

CELLS = (96, 72, 128)
"""Numbers of cells along z, y and x."""


def noise(shape: tuple[int, int, int], frequency: float, seed: int) -> NDArray[np.float32]:
    """Return random values on a coarse lattice, 0 to 1, interpolated smoothly at the centres of cells.

    Args:
        shape: numbers of cells.
        frequency: lattice steps along the last axis; along the others as many for each cell.
        seed: of the random values.
    """
    step = frequency / shape[2]
    places = [(np.arange(n) + 0.5) * step for n in shape]
    values = np.random.default_rng(seed).random([int(p[-1]) + 2 for p in places], dtype=np.float32)
    for axis, place in enumerate(places):
        first = place.astype(int)
        t = (place - first).astype(np.float32)
        weight = (t * t * (3.0 - 2.0 * t)).reshape([-1 if k == axis else 1 for k in range(3)])
        values = values.take(first, axis) * (1.0 - weight) + values.take(first + 1, axis) * weight
    return values


def cumulus() -> NDArray[np.float32]:
    """Return the densities, 0 to 1, of a cloud: balls that grow out of one another, frayed by noise, on a flat base."""
    places = [((np.arange(n) + 0.5) / CELLS[2]).astype(np.float32) for n in CELLS]
    z, y, x = np.meshgrid(*places, indexing="ij")
    rng = np.random.default_rng(11)
    depth = np.full(CELLS, -1.0, np.float32)
    for _ in range(60):
        across, height = rng.normal(0.0, 1.0, 2), rng.random() ** 1.6
        center = (0.5 + 0.15 * across[0] * (1.0 - 0.7 * height), 0.13 + 0.3 * height, 0.375 + 0.1 * across[1])
        radius = (0.12 - 0.05 * height) * (0.6 + 0.5 * rng.random())
        distance = np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2)
        depth = np.maximum(depth, 1.0 - distance / radius)
    frayed = sum(2.0**-k * (noise(CELLS, 9.0 * 2.0**k, k) - 0.5) for k in range(4))
    above_base = np.clip((y - 0.085 + 0.03 * noise(CELLS, 7.0, 9)) / 0.03, 0.0, 1.0)
    return np.asarray(np.clip(4.0 * (depth + 1.1 * frayed - 0.05), 0.0, 1.0) * above_base, np.float32)


def cloud() -> wrt.Scene:
    """A cumulus half a kilometre wide in the light of a low sun."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 20.0, 900.0), (-15.0, 232.0, 0.0), fov_degrees=25.0))
    sky = wrt.SunSkyEnvironment(elevation_degrees=28.0, azimuth_degrees=-115.0, turbidity=2.5, ground_albedo=0.25)
    scene.environment = sky
    nz, ny, nx = CELLS
    size = 640.0
    lower = np.array([-0.5 * size, 80.0, -0.5 * size * nz / nx])
    grid = wrt.DensityGrid(cumulus(), lower, lower + size * np.array([nx, ny, nz]) / nx, name="cumulus")
    droplets = wrt.Medium.from_albedo(1.0, 0.09, g=0.5, density=grid)
    scene.add(grid.boundary, material=wrt.Null(interior=droplets), name="cloud")
    scene.settings.exposure = -5.0
    scene.settings.max_depth = 8
    return scene


PICTURES = {
    "media-water-and-ice": Picture(water_and_ice, 400, 400, 768),
    "media-coloured-glass": Picture(coloured_glass, spp=512),
    "media-fog": Picture(fog, 400, 225, 4096),
    "media-cloud": Picture(cloud, 440, 275, 512),
    "media-subsurface": Picture(subsurface, spp=2048),
}
