"""The scenes that renderers are compared by, each written once.

They keep to what all can do: flat triangles (an interpolated normal is not the same to any two renderers), reflection
models of one meaning, a box filter. Depth is that of `wrt.RenderSettings.max_depth`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pictures.bodies import ball
from pictures.city import rectangles

import wrt
from benchmarks.rays import bumpy_ball
from wrt.meshes.many_triangles import terrain
from wrt.scene.mesh import merge

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT.parent / "shared" / "assets"
"""Scanned meshes and photographed surroundings, which lie beside the repository on some machines."""

GGX: dict[str, Any] = {"distribution": "ggx", "masking": "smith-separable", "multiple_bounces": False}
"""Microfacets as Mitsuba has them."""


@dataclass(frozen=True)
class Budget:
    """How large scenes are.

    Attributes:
        share: of the triangles and lights that a scene has otherwise.
        assets: folder of meshes and textures; what is not there is generated.
    """

    share: float = 1.0
    assets: Path = ASSETS

    def of(self, count: int, least: int = 1_000) -> int:
        """Return that share of a number."""
        return max(least, round(self.share * count))


@dataclass(frozen=True)
class Case:
    """A scene to compare renderers by.

    Attributes:
        name: on the command line and in tables.
        about: what is in it, in a few words.
        make: returns it.
        depth: most segments in a path.
    """

    name: str
    about: str
    make: Callable[[Budget], wrt.Scene]
    depth: int = 8

    def scene(self, size: int, budget: Budget) -> wrt.Scene:
        """Return the scene for square pictures of `size` pixels a side."""
        scene = self.make(budget)
        settings = {"width": size, "height": size, "max_depth": self.depth, "filter": "box", "crop": None}
        scene.settings = dataclasses.replace(scene.settings, **settings)
        return scene


def cornell(budget: Budget) -> wrt.Scene:
    """The Cornell box as it is."""
    del budget
    return wrt.load("cornell-box")


def cornell_with(**materials: wrt.Material) -> wrt.Scene:
    """Return the Cornell box with other materials, by the names of shapes."""
    scene = wrt.load("cornell-box")
    chosen = {name.replace("_", " "): material for name, material in materials.items()}
    assert set(chosen) <= {shape.name for shape in scene.shapes}
    scene.shapes = [
        dataclasses.replace(shape, material=chosen.get(shape.name, shape.material)) for shape in scene.shapes
    ]
    return scene


def cornell_glossy(budget: Budget) -> wrt.Scene:
    """The Cornell box of rough metal and plastic."""
    del budget
    return cornell_with(
        tall_block=wrt.RoughConductor(alpha=0.1, metal="aluminium", **GGX),
        short_block=wrt.RoughConductor(alpha=0.3, metal="gold", **GGX),
        floor=wrt.Plastic((0.3, 0.32, 0.4)),
    )


def cornell_glass(budget: Budget) -> wrt.Scene:
    """The Cornell box with a ball of glass and one of metal in place of the blocks."""
    del budget
    scene = wrt.load("cornell-box")
    scene.shapes = [shape for shape in scene.shapes if "block" not in shape.name]
    scene.add(flat(wrt.sphere((0.18, 0.1, 0.17), 0.1)), material=wrt.Dielectric(ior=1.5), name="glass")
    scene.add(flat(wrt.sphere((0.38, 0.13, 0.35), 0.13)), material=wrt.Conductor(), name="copper")
    return scene


def flat(mesh: wrt.Mesh) -> wrt.Mesh:
    """Return a mesh without its shading normals."""
    return dataclasses.replace(mesh, normals=None)


def bunny_mesh(budget: Budget) -> wrt.Mesh:
    """Return the Stanford bunny, or a bumpy ball of as many triangles, one unit tall on y = 0."""
    file = budget.assets / "meshes" / "stanford-bunny.obj"
    mesh = flat(wrt.load_mesh(file)) if file.exists() and budget.share == 1.0 else bumpy_ball(budget.of(70_000))
    low, high = mesh.bounds
    scale = 1.0 / (high[1] - low[1])
    middle = np.array([0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2])])
    return dataclasses.replace(mesh, vertices=(mesh.vertices - middle) * scale)


def bunny_on_floor(budget: Budget) -> wrt.Scene:
    """Return a matt bunny on a floor, without light."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.6, 1.3, 3.4), (0.0, 0.45, 0.0), fov_degrees=28.0))
    scene.add(wrt.quad((-6, 0, 6), (12, 0, 0), (0, 0, -12)), material=wrt.Diffuse(0.5), name="floor")
    scene.add(bunny_mesh(budget), material=wrt.Diffuse((0.6, 0.45, 0.3)), name="bunny")
    return scene


def bunny(budget: Budget) -> wrt.Scene:
    """A bunny under a square lamp."""
    scene = bunny_on_floor(budget)
    scene.add(wrt.quad((-0.8, 3.0, -0.3), (1.6, 0, 0), (0, 0, 1.6)), emission=9.0, name="lamp")
    return scene


def bunny_sky(budget: Budget) -> wrt.Scene:
    """A bunny in the light of an image."""
    scene = bunny_on_floor(budget)
    file = budget.assets / "textures" / "envmap.hdr"
    pixels = wrt.load_image(file) if file.exists() else generated_sky()
    scene.environment = wrt.ImageEnvironment(pixels)
    return scene


def generated_sky(height: int = 256) -> NDArray[np.float32]:
    """Return (H, 2 H, 3) radiance: a clear sky, a sun of five degrees, and ground."""
    v = (np.arange(height) + 0.5) / height * np.pi
    u = (np.arange(2 * height) + 0.5) / height * np.pi
    up = np.cos(v)[:, None]
    direction = np.stack([np.sin(v)[:, None] * np.sin(u), up + 0.0 * u, -np.sin(v)[:, None] * np.cos(u)], axis=2)
    toward = np.array([0.5, 0.6, 0.62])
    sun = direction @ (toward / np.linalg.norm(toward)) > np.cos(np.radians(2.5))
    sky = np.where(up[..., None] > 0.0, (0.25, 0.4, 0.75) + 0.5 * (1.0 - up[..., None]) ** 4, (0.16, 0.14, 0.12))
    return (sky + 900.0 * sun[..., None] * np.array([1.0, 0.9, 0.75])).astype(np.float32)


def mountains(budget: Budget, triangles: int) -> wrt.Scene:
    """Mountains of about `triangles` triangles in evening sun."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((300.0, 1250.0, 2600.0), (-45.0, 380.0, 0.0), fov_degrees=31.0))
    scene.environment = wrt.ConstantEnvironment((0.30, 0.42, 0.62))
    scene.add_light(wrt.DirectionalLight((0.80, -0.42, -0.35), irradiance=(5.2, 4.1, 2.9)))
    mesh = dataclasses.replace(terrain(budget.of(triangles)), normals=None, colors=None)
    scene.add(mesh, material=wrt.Diffuse((0.42, 0.38, 0.33)), name="mountains")
    return scene


def lanterns(lights: int) -> wrt.Scene:
    """Blocks and a floor lit by as many triangles close above (2 at least), seen from behind them.

    They give the same power in all, whatever their number.
    """
    rng = np.random.default_rng(5)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 9.0, 12.0), (0.0, 0.0, 0.5), fov_degrees=38.0))
    scene.add(wrt.quad((-12, 0, 12), (24, 0, 0), (0, 0, -24)), material=wrt.Diffuse(0.6), name="floor")
    corners = rng.uniform(-9.0, 9.0, (300, 2))
    heights = rng.uniform(0.1, 0.7, len(corners))
    blocks = [
        wrt.box((x, 0.0, z), (x + 0.35, height, z + 0.35)) for (x, z), height in zip(corners, heights, strict=True)
    ]
    scene.add(merge(blocks, "blocks"), material=wrt.Diffuse((0.5, 0.55, 0.6)), name="blocks")
    colors = [(1.0, 0.6, 0.25), (1.0, 0.8, 0.6), (0.5, 0.75, 1.0), (1.0, 0.2, 0.15), (0.3, 1.0, 0.4)]
    for k, (tint, count) in enumerate(zip(colors, shares(lights // 2, len(colors)), strict=True)):
        if count == 0:
            continue
        middle = rng.uniform((-9.0, 0.8, -9.0), (9.0, 1.3, 9.0), (count, 3))
        u, v = (np.tile(side, (count, 1)) for side in ((0.03, 0.0, 0.0), (0.0, 0.0, 0.03)))
        corner = rectangles(middle, u, v).reshape(-1, 3)  # u x v points down
        faces = (4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        radiance = tuple(3e6 / lights * channel for channel in tint)
        scene.add(wrt.Mesh(corner, faces), material=wrt.Diffuse(0.0), emission=radiance, name=f"lanterns {k}")
    return scene


def shares(number: int, parts: int) -> list[int]:
    """Split a number into parts that differ by one at most, the largest first."""
    return [(number + parts - 1 - k) // parts for k in range(parts)]


def textured(budget: Budget) -> wrt.Scene:
    """Metal and plastic whose colours and roughness are textures."""
    del budget
    y, x = np.mgrid[0:256, 0:256] / 256.0
    rng = np.random.default_rng(3)
    grain = rng.random((256, 256)).astype(np.float32)
    tiles = (np.floor(8.0 * x) + np.floor(8.0 * y)) % 2.0
    color = np.stack([0.25 + 0.5 * tiles, 0.4 + 0.2 * tiles, 0.6 - 0.35 * tiles], axis=2) + 0.1 * grain[..., None]
    rough = np.repeat((0.15 + 0.5 * (np.sin(40.0 * x) * np.sin(40.0 * y) > 0.0))[..., None], 3, axis=2)
    image = {name: wrt.ImageTexture(np.asarray(a, np.float32)) for name, a in (("color", color), ("rough", rough))}
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.9, 4.4), (0.0, 0.5, 0.0), fov_degrees=36.0))
    floor = wrt.quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))
    scene.add(with_plane_uvs(floor), material=wrt.Diffuse(image["color"]), name="floor")
    globe = flat(ball(160)).translated((0.0, -1.0, 0.0)).scaled(0.6)
    globe = dataclasses.replace(globe, uvs=globe.uvs * np.float32((4.0, 2.0)))
    metal = wrt.Principled(base_color=image["color"], metallic=1.0, roughness=image["rough"])
    scene.add(globe.translated((-0.75, 0.6, 0.0)), material=metal, name="metal")
    plastic = wrt.Plastic(image["color"])
    scene.add(globe.translated((0.75, 0.6, 0.0)), material=plastic, name="plastic")
    scene.add(wrt.quad((-1.5, 3.5, -1.0), (3.0, 0, 0), (0, 0, 2.0)), emission=6.0, name="lamp")
    scene.environment = wrt.ConstantEnvironment((0.35, 0.4, 0.5))
    return scene


def with_plane_uvs(mesh: wrt.Mesh) -> wrt.Mesh:
    """Return a horizontal mesh with texture coordinates that repeat every two metres."""
    return dataclasses.replace(mesh, uvs=0.5 * mesh.vertices[:, [0, 2]] * np.array([1.0, -1.0]))


def fog(budget: Budget) -> wrt.Scene:
    """The Cornell box full of fog."""
    del budget
    scene = wrt.load("cornell-box")
    scene.medium = wrt.Medium(scattering=1.2, absorption=0.1, g=0.3)
    return scene


def posts() -> wrt.Scene:
    """Return coloured posts on a floor, near and far, lit by the sun."""
    scene = wrt.Scene()
    scene.add_light(wrt.DirectionalLight((-0.4, -1.0, -0.6), irradiance=3.0))
    scene.add(wrt.quad((-6, 0, 4), (12, 0, 0), (0, 0, -16)), material=wrt.Diffuse(0.5))
    for k in range(12):
        x, z = 0.5 * (k % 4 - 1.5) + 0.12 * (k // 4), 1.2 - 1.3 * (k // 4)
        color = [(0.8, 0.2, 0.1), (0.1, 0.5, 0.8), (0.85, 0.8, 0.7)][k % 3]
        scene.add(wrt.box((x - 0.06, 0.0, z - 0.06), (x + 0.06, 0.8, z + 0.06)), material=wrt.Diffuse(color))
    return scene


def lens(budget: Budget) -> wrt.Scene:
    """The posts through a wide lens, the second row in focus."""
    del budget
    scene = posts()
    scene.camera = wrt.PerspectiveCamera((0.0, 0.7, 3.0), (0.0, 0.35, 0.0), aperture_radius=0.12, focus_distance=3.1)
    return scene


def motion(budget: Budget) -> wrt.Scene:
    """The posts from a camera that moves sideways while its shutter is open."""
    del budget
    scene = posts()
    moves = wrt.Motion.translation((0.35, 0.05, 0.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.7, 3.0), (0.0, 0.35, 0.0), shutter_close=1.0, motion=moves)
    return scene


CASES = {
    case.name: case
    for case in (
        Case("cornell", "Cornell box", cornell),
        Case("cornell-glossy", "rough metal and plastic", cornell_glossy),
        Case("cornell-glass", "glass and metal", cornell_glass),
        Case("bunny", "69 k triangles, square lamp", bunny),
        Case("bunny-sky", "69 k triangles, image all around", bunny_sky),
        Case("mountains", "330 k triangles, sun and sky", lambda budget: mountains(budget, 330_000)),
        Case("mountains-5m", "5 M triangles, sun and sky", lambda budget: mountains(budget, 5_000_000)),
        Case("lanterns", "10 k emissive triangles", lambda budget: lanterns(budget.of(10_000))),
        Case("textured", "textured metal and plastic", textured),
        Case("fog", "homogeneous medium", fog, 64),
        Case("lens", "depth of field", lens),
        Case("motion", "moving camera", motion),
    )
}
