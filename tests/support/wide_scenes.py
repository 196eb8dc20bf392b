"""Small scenes that together use every feature of a render kernel, to compare kernels bit for bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

import wrt
from wrt.backend.processor import lanes_of, processor_flags
from wrt.rendering.wide_kernel import threads_of
from wrt.scene.layers import LAYERS

LANES = lanes_of(processor_flags())
needs_lanes = pytest.mark.skipif(not LANES, reason="the processor has neither AVX-512 nor AVX2")

VIEW: dict[str, Any] = {"origin": (0.2, 1.5, 5.0), "target": (0.0, 0.6, 0.0)}
WIDE_OPEN: dict[str, Any] = {**VIEW, "aperture_radius": 0.1, "focus_distance": 5.0}
CAMERAS: dict[str, wrt.Camera] = {
    "perspective": wrt.PerspectiveCamera(**VIEW),
    "disk": wrt.PerspectiveCamera(**WIDE_OPEN),
    "square": wrt.PerspectiveCamera(**WIDE_OPEN, aperture="square"),
    "orthographic": wrt.OrthographicCamera(**WIDE_OPEN, view_height=3.0, aperture="polygon"),
    "panorama": wrt.PanoramaCamera((0.1, 1.6, 2.0), (1.0, 0.5, 0.0)),
    "fisheye": wrt.FisheyeCamera((0.1, 1.0, 2.0), (0.0, 0.5, 0.0)),
    "moving": wrt.PerspectiveCamera(
        **VIEW, shutter_open=-0.2, shutter_close=0.8, shutter_ramp=0.4, motion=wrt.Motion.translation((0.3, 0.0, 0.1))
    ),
}


def noise(seed: int, size: int = 8, channels: int = 3) -> Any:
    return np.random.default_rng(seed).random((size, size, channels)).astype(np.float32)


def room(*materials: wrt.Material) -> wrt.Scene:
    """Return a floor and an emitting square, and a smooth ball or a box of each material."""
    scene = wrt.Scene()
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=materials[0])
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=(7.0, 6.0, 4.0), two_sided_emission=True)
    ball = wrt.sphere(subdivisions=2)
    uvs = ball.vertices[:, :2] * np.float32(0.7) + ball.vertices[:, 2:] * np.float32([0.3, 0.1])
    uvs = np.concatenate([uvs, ball.vertices[:, 1:] * np.float32(1.3)], axis=1)
    rng = np.random.default_rng(3)
    colors = rng.random((len(ball.vertices), 4)).astype(np.float32)
    ball = wrt.Mesh(ball.vertices, ball.faces, ball.normals, uvs, colors=colors)
    box = wrt.box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3))
    for i, material in enumerate(materials):
        across = 2.8 * ((i + 0.5) / len(materials) - 0.5)
        place = np.diag([0.35, 0.3 + 0.1 * (i % 2), 0.35, 1.0]) if i % 3 else np.eye(4)
        place[:3, 3] = across, 0.5 + 0.5 * (i % 2), 0.4 * np.sin(5.0 * i)
        scene.add((ball if i % 3 else box).transformed(place), material=material)
    return scene


def with_uvs(mesh: wrt.Mesh) -> wrt.Mesh:
    """Return a mesh that shows one texel of an image if it has no texture coordinates."""
    blank = np.zeros((len(mesh.vertices), 2), np.float32)
    return mesh if mesh.uvs is not None else dataclasses.replace(mesh, uvs=blank)


def add_balls(scene: wrt.Scene, *materials: wrt.Material) -> None:
    """Add a ball of each material, each within a part of the one before."""
    ball = wrt.sphere(subdivisions=2)
    for i, material in enumerate(materials):
        place = np.diag([0.6, 0.5, 0.6, 1.0])
        place[:3, 3] = 0.7 * i - 1.0, 0.8, 0.2 * i
        scene.add(ball, material=material, transform=place)


def plain() -> wrt.Scene:
    return room(wrt.Diffuse(0.6), wrt.Mirror(0.9), wrt.Diffuse((0.8, 0.3, 0.2)))


def models() -> wrt.Scene:
    """Most models as they come, and every kind of light, in a tree."""
    scene = room(
        wrt.OrenNayar(0.6),
        wrt.Glossy(0.8),
        wrt.Plastic((0.2, 0.5, 0.3)),
        wrt.RoughPlastic((0.5, 0.1, 0.3)),
        wrt.RoughConductor(metal="gold"),
        wrt.Conductor(metal="silver"),
        wrt.RoughDielectric(),
    )
    scene.environment = wrt.ConstantEnvironment(0.2)
    scene.lights += [
        wrt.PointLight((1.0, 2.0, 1.0), intensity=2.0),
        wrt.SpotLight((-1.0, 3.0, 1.0), (0.3, -1.0, -0.2), intensity=9.0),
        wrt.RectangleLight((-3, 1, 0), (0, 1, 0), (0, 0, 1), radiance=3.0, two_sided=True),
        wrt.DiskLight((3, 1, 0), (-1, 0, 0.2), radiance=2.0),
        wrt.SphereLight((0.0, 2.5, 0.5), 0.2, radiance=9.0),
        wrt.DirectionalLight((-0.4, -1.0, 0.3), irradiance=0.5),
        wrt.DirectionalLight((0.4, -1.0, 0.3), irradiance=1.5, angle_degrees=3.0),
    ]
    return scene


def distributions() -> wrt.Scene:
    """Metals with every distribution of normals, and one that varies."""
    kinds = [
        wrt.RoughConductor(0.2, metal="copper", distribution=d, multiple_bounces=d in ("ggx", "beckmann"))
        for d in ("ggx", "beckmann", "blinn-phong")
    ]
    return room(
        *kinds,
        wrt.RoughConductor((0.5, 20.0), f0=0.7, distribution="abc"),
        wrt.RoughConductor((0.1, 0.7), f0=(0.9, 0.5, 0.2), distribution="sgd"),
        wrt.RoughDielectric(0.3, multiple_bounces=True),
    )


def principled() -> wrt.Scene:
    """The principled material with all it can have, opaque and thin."""
    all_of_it = wrt.Principled(
        (0.8, 0.5, 0.3),
        metallic=0.3,
        roughness=0.4,
        anisotropy=0.7,
        transmission=0.5,
        coat=0.6,
        coat_roughness=0.1,
        sheen_color=0.4,
        sheen_roughness=0.5,
        multiple_bounces=True,
    )
    thin = wrt.Principled(0.7, transmission=0.8, thin_walled=True)
    return room(wrt.Principled(0.5), all_of_it, thin, wrt.Principled(0.9, metallic=1.0, roughness=0.2))


def spectral() -> wrt.Scene:
    """What treats each channel in its own way: bodies that disperse light, and surfaces under thin films."""
    film = {"film_thickness": 400.0, "film_ior": 1.6}
    clear = wrt.Principled(0.9, roughness=0.3, transmission=0.8, dispersion=2.0, coat=0.5, **film)
    scene = room(wrt.Principled(0.5, roughness=0.3, **film), wrt.RoughDielectric(1.6, alpha=0.2, dispersion=2.0), clear)
    add_balls(
        scene,
        wrt.Dielectric(1.5, dispersion=2.0, priority=1),
        wrt.RoughDielectric(1.3, dispersion=2.0, priority=2),
        wrt.RoughConductor(0.3, metal="gold", **film),
        wrt.Conductor(metal="silver", **film),
    )
    return scene


def textures() -> wrt.Scene:
    """Images with levels, masks, normal maps, vertex colours, mixtures, and a sky that is an image."""
    image = wrt.ImageTexture(noise(1, 32), scale=3.0, filter="trilinear")
    small = wrt.ImageTexture(noise(2), wrap="mirror", filter="nearest", rotation_degrees=20.0)
    second = wrt.ImageTexture(noise(4), uv_set=1, vertex_alpha=True, channel="g")
    bumps = np.full((8, 8, 3), (0.5, 0.5, 1.0), np.float32)
    bumps[::2, ::3, :2] = 0.7, 0.4
    mask = wrt.ImageTexture(noise(3), channel="r", cutoff=0.4, wrap="clamp")
    scene = room(
        wrt.Diffuse(image),
        wrt.Diffuse(small, normal_map=wrt.NormalMap(bumps, filter=True)),
        wrt.RoughConductor(small, metal="gold", normal_map=wrt.NormalMap(bumps)),
        wrt.Diffuse(wrt.VertexColor(), opacity=mask),
        wrt.Mix(wrt.Diffuse(0.3), wrt.RoughConductor((0.1, 0.4), metal="copper"), weight=small),
        wrt.TwoSided(wrt.Diffuse(second), wrt.Diffuse(0.2)),
        wrt.Dielectric(),
        wrt.Diffuse(0.5, opacity=0.4),
    )
    scene.environment = wrt.ImageEnvironment(noise(5, 16) ** 4 * 8, rotation_degrees=30.0)
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, emission=wrt.ImageTexture(noise(6), factor=9.0))
    scene.shapes = [dataclasses.replace(shape, mesh=with_uvs(shape.mesh)) for shape in scene.shapes]
    return scene


def sides() -> wrt.Scene:
    """Single-sided and unlit surfaces: an outlined ball and a sheet, also seen in glass and a mirror, by two lamps."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.add(wrt.sphere((0, 0.6, 0), 0.8), material=wrt.Diffuse((0.8, 0.4, 0.1)))
    shell = wrt.sphere((0, 0.6, 0), 1.0)
    shell = wrt.Mesh(shell.vertices, shell.faces[:, ::-1])
    scene.add(shell, material=wrt.Unlit((0.0, 0.1, 0.2)), double_sided=False)
    scene.add(wrt.quad((1.5, 0.2, 2), (-3, 0, 0), (0, 1.2, 0)), material=wrt.Diffuse(0.3), double_sided=False)
    scene.add(wrt.box((-0.4, 0.2, 1.6), (0.4, 0.6, 2.4)), material=wrt.Dielectric())
    scene.add(wrt.quad((-4, -0.6, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Mirror(), double_sided=False)
    scene.add_light(wrt.RectangleLight((-2, 3, -2), (4, 0, 0), (0, 0, 4), 4.0))
    scene.add_light(wrt.DiskLight((1.0, 1.4, 1.6), (0, 0, 1), 0.2, 4.0, two_sided=True))
    return scene


def panes() -> wrt.Scene:
    """Media that absorb and emit, and surfaces that rays pass straight."""
    body = wrt.Medium(absorption=(0.5, 0.2, 1.5), emission=(0.1, 0.4, 0.1))
    scene = room(
        wrt.ThinDielectric(),
        wrt.Dielectric(1.5, interior=body),
        wrt.Null(interior=body),
        wrt.ThinDielectric(1.4),
        wrt.Diffuse(0.5),
    )
    scene.environment = wrt.ConstantEnvironment((0.4, 0.5, 0.7))
    return scene


def bodies() -> wrt.Scene:
    """Bodies that lie within and across each other, of media that scatter, in fog."""
    milk = wrt.Medium(absorption=(0.1, 0.3, 0.5), scattering=(2.0, 3.0, 4.0), g=0.5)
    scene = room(wrt.Diffuse(0.5), wrt.Diffuse(0.2))
    scene.medium = wrt.Medium(0.02, 0.1, g=-0.3)
    add_balls(
        scene,
        wrt.Dielectric(1.5, interior=wrt.Medium(absorption=0.3), priority=3),
        wrt.Principled(0.9, transmission=1.0, ior=1.33, roughness=0.2, interior=milk, priority=1),
        wrt.RoughDielectric(1.3, interior=milk, priority=2),
        wrt.Null(interior=milk),
    )
    return scene


def clouds() -> wrt.Scene:
    """Media whose density varies: one that scatters in colours, one that emits, one that absorbs, in thin smoke."""
    density = wrt.DensityGrid(
        noise(7, 12)[..., None, 0] * noise(8, 12)[:, None, :, 1], (-1.5, 0.1, -0.6), (0.0, 1.5, 0.6)
    )
    turned = np.array([[0.7, 0.2, 0.0, 0.2], [-0.2, 0.9, 0.0, 0.4], [0.0, 0.1, 0.8, -0.3], [0.0, 0.0, 0.0, 1.0]])
    varied = wrt.DensityGrid(noise(9, 10).transpose(2, 0, 1), transform=turned, factor=3.0, albedo=noise(10)[None])
    scene = room(wrt.Diffuse(0.5), wrt.Diffuse(0.2))
    scene.environment = wrt.ConstantEnvironment((0.4, 0.5, 0.7), group="sky")
    scene.medium = wrt.Medium(0.05, 0.1, density=wrt.DensityGrid(noise(11), (-3, 0, -3), (3, 4, 3)))
    for grid, medium in (
        (density, wrt.Medium(0.3, (9.0, 6.0, 3.0), g=0.6)),
        (varied, wrt.Medium((0.5, 1.0, 2.0), 2.0, g=-0.2, emission=0.3)),
        (wrt.DensityGrid(noise(12), (0.6, 1.0, 0.5), (1.2, 1.6, 1.0)), wrt.Medium((3.0, 2.0, 6.0))),
    ):
        interior = wrt.Medium(medium.absorption, medium.scattering, medium.g, medium.emission, grid)
        scene.add(grid.boundary, material=wrt.Null(interior=interior))
    return scene


def moving() -> wrt.Scene:
    """What moves, as a whole or not, over the time that a shutter is open."""
    scene = room(wrt.Diffuse(0.6))
    keys = [np.eye(4), np.eye(4)]
    keys[0][:3, 3] = -1.0, 0.5, 0.0
    keys[1][:3, :3] = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ np.diag([1.2, 0.7, 1.0])
    keys[1][:3, 3] = -0.5, 1.0, 0.0
    box = wrt.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4))
    scene.add(box, material=wrt.Diffuse(0.7), transform=wrt.Motion((0.0, 1.0), keys, center=(0.2, 0.0, 0.0)))
    mirrored = np.diag([-0.5, 0.5, 0.5, 1.0])
    mirrored[:3, 3] = 0.2, 0.3, 1.0
    scene.add(box, emission=2.0, transform=mirrored)
    lamp = wrt.quad((-0.5, 2.5, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene.add(lamp, emission=(8.0, 7.0, 5.0), transform=wrt.Motion.translation((1.5, 0.0, 0.3)))
    return scene


def deforming() -> wrt.Scene:
    scene = moving()
    ball = wrt.sphere(subdivisions=2)
    shapes = np.stack([ball.vertices * [0.4, 0.4, 0.4], ball.vertices * [0.7, 0.2, 0.4]]) + [1.0, 0.5, 0.0]
    scene.add(ball, material=wrt.Diffuse(0.7), deformation=wrt.Deformation((-0.5, 1.0), shapes))
    return scene


SCENES: dict[str, tuple[Callable[[], wrt.Scene], dict[str, Any], tuple[str, ...]]] = {
    "plain": (plain, {"crop": (3, 2, 40, 23)}, ("perspective", "disk", "square", "orthographic")),
    "models": (models, {"sampler": "stratified"}, ("perspective", "fisheye")),
    "distributions": (distributions, {"sampler": "independent"}, ("panorama",)),
    "principled": (principled, {"sampler": "blue-noise"}, ("perspective",)),
    "spectral": (spectral, {"sampler": "independent"}, ("perspective",)),
    "textures": (
        textures,
        {
            "layers": tuple(name for name in LAYERS if name not in ("z", "edges")),
            "clamp_indirect": 2.0,
            "regularization": 0.2,
        },
        ("perspective", "fisheye", "moving"),
    ),
    "sides": (sides, {}, ("perspective",)),
    "panes": (panes, {}, ("perspective", "panorama")),
    "bodies": (bodies, {"sampler": "independent"}, ("perspective", "moving")),
    "clouds": (clouds, {"sampler": "stratified"}, ("perspective",)),
    "moving": (moving, {"layers": ("motion", "depth")}, ("moving",)),
    "deforming": (deforming, {"light_choice": "tree"}, ("moving",)),
    "caustics": (plain, {"caustics": True}, ("orthographic",)),
}
"""A scene, options of its renderer, and cameras, by name; each is one kernel."""


def wide_kernel(renderer: wrt.Renderer, lanes: int) -> tuple[Any, int]:
    """Return the wide kernel for a renderer's scene, and how many of its threads render the picture."""
    from wrt.kernels.native.constants import TILE
    from wrt.spmd.kernel import make_wide_render_kernel

    threads = threads_of(renderer.film.width, renderer.film.height, TILE)
    return make_wide_render_kernel(renderer._kernel.features, lanes), threads


Bits = dict[str, NDArray[Any]]


def bits(renderer: wrt.Renderer, kernel: wp.Kernel, threads: int, start: Bits, spp: Sequence[int]) -> Bits:
    """Return the film after passes of a kernel to each of `spp` samples a pixel, from the state `start` on."""
    renderer.film.restore(start)
    renderer.film.data.rays.zero_()
    for target in spp:
        renderer.device.launch(kernel, threads, [target, *renderer._inputs])
    return {**renderer.film.state(), "rays": renderer.film.data.rays.numpy().copy()}


def differences(scene: wrt.Scene, spp: Sequence[int] = (3, 22), lanes: int = 0, **options: Any) -> list[str]:
    """Render a scene by both kernels, and return which arrays of the film differ in any bit.

    The passes have fewer samples than lanes, and more: as many samples of a pixel as there are lanes go together.
    """
    renderer = wrt.Renderer(scene, **{"width": 45, "height": 31, "threads": 1, **options})
    if renderer._photons is not None:
        camera, _, scene, path = renderer._shared_inputs
        renderer._photons.provide(0, camera, scene, path)
    start = renderer.film.state()
    scalar = bits(renderer, renderer._kernel.scalar, renderer.film.pixels, start, spp)
    wide = bits(renderer, *wide_kernel(renderer, lanes or LANES), start, spp)
    assert scalar["total"].any()
    assert scalar["count"].min() >= spp[-1]
    return [name for name in scalar if scalar[name].tobytes() != wide[name].tobytes()]
