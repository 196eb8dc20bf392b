"""Scenes in which glass, mirrors and what is nearly as smooth throw caustics."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt


def floor(material: wrt.Material | None = None, half: float = 4.0) -> wrt.Shape:
    mesh = wrt.quad((-half, 0.0, half), (2.0 * half, 0.0, 0.0), (0.0, 0.0, -2.0 * half))
    return wrt.Shape(mesh, material or wrt.Diffuse(0.5))


def lamp() -> wrt.Shape:
    return wrt.Shape(wrt.quad((0.2, 3.0, -0.8), (1.6, 0.0, 0.0), (0.0, 0.0, 1.6)), wrt.Diffuse(0.0), emission=2.5)


def scene_of(*parts: wrt.Shape | wrt.Light, environment: Any = None) -> wrt.Scene:
    camera = wrt.PerspectiveCamera((0.0, 3.0, 4.0), (0.0, 0.3, 0.0), fov_degrees=40.0)
    scene = wrt.Scene(environment=environment, camera=camera)
    for part in parts:
        if isinstance(part, wrt.Shape):
            scene.shapes.append(part)
        else:
            scene.lights.append(part)
    return scene


def block(material: wrt.Material, bottom: float = 0.4) -> wrt.Shape:
    return wrt.Shape(wrt.box((-0.5, bottom, -0.5), (0.5, bottom + 1.0, 0.5)), material)


def ball(material: wrt.Material | None = None, *, exact: bool = False) -> wrt.Shape:
    return wrt.Shape(wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=2, exact=exact), material or wrt.Dielectric())


def smooth_normals() -> wrt.Scene:
    return scene_of(floor(), lamp(), ball())


def flat_ball() -> wrt.Shape:
    mesh = wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=1)
    return wrt.Shape(wrt.Mesh(mesh.vertices, mesh.faces), wrt.Dielectric())


def closed_box() -> wrt.Scene:
    """A glass block and a lamp in a box, seen from its middle all around: the light in it is conserved."""
    room = wrt.box((-2.0, -0.01, -2.0), (2.0, 3.5, 2.0))
    scene = scene_of(wrt.Shape(room, wrt.Diffuse(0.6)), lamp(), block(wrt.Dielectric()))
    scene.camera = wrt.PanoramaCamera((0.0, 1.8, 1.0), (0.0, 1.8, 0.0))
    return scene


def instances() -> wrt.Scene:
    mesh = wrt.sphere((0.0, 0.0, 0.0), 0.4, subdivisions=4)
    places = [np.array([[1.0, 0, 0, x], [0, 1.0, 0, 0.6], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]) for x in (-0.5, 0.5)]
    return scene_of(floor(), lamp(), *(wrt.Shape(mesh, wrt.Dielectric(), transform=place) for place in places))


def sky() -> wrt.ImageEnvironment:
    return wrt.ImageEnvironment(np.random.default_rng(1).random((8, 16, 3)).astype(np.float32))


def moving(turn: wrt.Motion | None = None) -> wrt.Scene:
    """A ball, a block, a plate, the lamp and the camera, which move while the shutter is open; all alike by `turn`."""
    right, up = wrt.Motion.translation((0.8, 0.0, 0.2)), wrt.Motion.translation((0.0, 0.6, 0.0))
    spin = wrt.Motion.rotation((0.0, 1.0, 0.0), 60.0, center=(-0.7, 0.8, 0.3))
    glass = wrt.box((-1.0, 0.5, 0.0), (-0.4, 1.1, 0.6))
    plate = wrt.quad((-0.4, 0.1, 0.9), (0.8, 0.0, 0.0), (0.0, 0.0, -0.8))
    motions = (wrt.Motion(np.zeros(1), np.eye(4)[None]), right, right, spin, up)
    shapes = (floor(), lamp(), ball(exact=True), wrt.Shape(glass, wrt.Dielectric()), wrt.Shape(plate, wrt.Diffuse(0.8)))
    scene = scene_of(
        *(dataclasses.replace(shape, transform=turn or motion) for shape, motion in zip(shapes, motions, strict=True))
    )
    sway = turn or wrt.Motion.translation((0.0, 0.0, 0.5))
    scene.camera = dataclasses.replace(scene.camera, shutter_close=1.0, shutter_ramp=0.5, motion=sway)
    return scene


def deforming() -> wrt.Scene:
    scene = moving()
    mesh = wrt.sphere((0.0, 0.9, 0.0), 0.6, subdivisions=2)
    squeezed = np.stack([mesh.vertices, mesh.vertices * np.float32([1.2, 0.6, 1.0])])
    scene.shapes[2] = wrt.Shape(mesh, wrt.Dielectric(), deformation=wrt.Deformation((0.0, 1.0), squeezed))
    return scene


def nearly_smooth() -> wrt.Scene:
    """Casters that are a little rough, before a matt floor, a wall of metal, and paint that is no caster."""
    metal = wrt.Principled(0.9, metallic=1.0, roughness=0.2)
    wall = wrt.Shape(wrt.quad((-1.5, 0.0, -0.7), (3.0, 0.0, 0.0), (0.0, 1.5, 0.0)), metal)
    copper = wrt.Shape(wrt.cylinder((-0.9, 0.0, 0.3), (-0.9, 0.8, 0.3), 0.3), wrt.RoughConductor(0.05))
    paint = wrt.Shape(wrt.box((0.8, 0.0, 0.2), (1.2, 0.4, 0.6)), wrt.Principled(0.6, roughness=0.2))
    return scene_of(floor(), lamp(), wall, copper, ball(wrt.RoughDielectric(alpha=0.03)), paint)


TINTED = wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 1.0, 2.0)))

SCENES: dict[str, Callable[[], wrt.Scene]] = {
    "block": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric())),
    "closed box": closed_box,
    "smooth normals": smooth_normals,
    "exact ball": lambda: scene_of(floor(), lamp(), ball(exact=True)),
    "mirror cylinder": lambda: scene_of(
        floor(), lamp(), wrt.Shape(wrt.cylinder((0.0, 0.3, 0.0), (0.0, 1.2, 0.0), 0.4), wrt.Mirror())
    ),
    "instances": instances,
    "plastic floor": lambda: scene_of(floor(wrt.Plastic()), lamp(), flat_ball()),
    "pane": lambda: scene_of(
        floor(),
        lamp(),
        wrt.Shape(wrt.box((-1.0, 1.6, -1.0), (1.0, 1.62, 1.0)), wrt.ThinDielectric()),
        block(wrt.Dielectric(), 0.1),
    ),
    "holes": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric(opacity=0.5))),
    "tinted": lambda: scene_of(floor(), lamp(), block(TINTED)),
    "dispersive": lambda: scene_of(floor(), lamp(), block(wrt.Dielectric(dispersion=0.05))),
    "constant": lambda: scene_of(floor(), flat_ball(), lamp(), environment=wrt.ConstantEnvironment(0.3)),
    "image": lambda: scene_of(floor(), flat_ball(), environment=sky()),
    "shapes": lambda: scene_of(
        floor(),
        flat_ball(),
        wrt.SphereLight((1.0, 3.0, 0.0), 0.7, 5.0),
        wrt.RectangleLight((-1.0, 3.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.5), 5.0),
    ),
    "sun": lambda: scene_of(floor(), flat_ball(), wrt.DirectionalLight((0.3, -1.0, 0.1), 3.0, angle_degrees=20.0)),
    "fog": lambda: fog(),
    "translucent": lambda: translucent(),
    "nearly smooth": nearly_smooth,
    "moving": moving,
    "deforming": deforming,
    "textured": lambda: scene_of(floor(wrt.Diffuse(wrt.ImageTexture(pixels(3)))), lamp(), block(wrt.Dielectric())),
    "bumpy": lambda: bumpy(),
    "nested": lambda: scene_of(
        floor(), lamp(), block(wrt.Dielectric(1.5, priority=1)), ball(wrt.Dielectric(1.2, priority=2))
    ),
    "frosted": lambda: scene_of(
        floor(),
        lamp(),
        block(wrt.Dielectric(), 0.7),
        wrt.Shape(wrt.box((-1.5, 0.3, -1.5), (1.5, 0.5, 1.5)), wrt.RoughDielectric(alpha=0.3)),
    ),
}


def translucent() -> wrt.Scene:
    """A sheet, seen from below, that lets more of the light from above through than it reflects."""
    sheet = wrt.Burley(0.8, thin_walled=True, diffuse_transmission=0.8, roughness=1.0)
    return from_below(scene_of(floor(sheet), lamp(), block(wrt.Dielectric())))


def from_below(scene: wrt.Scene) -> wrt.Scene:
    scene.camera = wrt.PerspectiveCamera((0.0, -3.0, 4.0), (0.0, -0.3, 0.0), fov_degrees=40.0)
    return scene


def pixels(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((4, 4, 3)).astype(np.float32)


def bumpy() -> wrt.Scene:
    """Bumps where light is turned, and where it arrives."""
    bumps = wrt.NormalMap(0.5 + (pixels(5) - 0.5) * (0.3, 0.3, 0.0) + (0.0, 0.0, 0.5))
    mesh = ball().mesh
    glass = wrt.Shape(dataclasses.replace(mesh, uvs=mesh.vertices[:, :2]), wrt.Dielectric(normal_map=bumps))
    return scene_of(floor(wrt.Diffuse(0.5, normal_map=bumps)), lamp(), glass)


def fog() -> wrt.Scene:
    """Light that the glass throws into fog stays with the path; photons have what reaches the floor."""
    mist = wrt.Null(interior=wrt.Medium(scattering=0.2, absorption=0.1))
    box = wrt.Shape(wrt.box((-2.0, 0.02, -2.0), (2.0, 2.5, 2.0)), mist)
    return scene_of(floor(), lamp(), box, block(wrt.Dielectric()))
