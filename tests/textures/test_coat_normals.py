"""A clear coat has the normals of its `coat_normal_map`, and what lies below those of `normal_map`."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from support.bsdfs import FLAT, Tilted
from support.bumps import SQUARE, constant_map, lit, rendered, unit, with_uvs
from support.wide_scenes import differences, needs_lanes

import wrt

LIGHT, VIEW = unit(0.3, 0.5, 1.0), unit(0.2, -0.3, 1.0)
COAT, BASE = (0.3, -0.15, 1.0), (-0.2, 0.25, 1.0)
LACQUER = wrt.Principled((0.6, 0.3, 0.1), coat=0.8, coat_roughness=0.4)
TURNED, MIRRORED = ((0.6, -0.8), (0.8, 0.6)), ((-1.0, 0.0), (0.0, 1.0))
"""Where x and y of the square are in u and v."""


def expected(coat: Any, base: Any, device: str, *, side: float = 1.0) -> np.ndarray:
    """Return the radiance by the model alone. Bumps are dents from behind; x and y of the frame are the same there."""
    dent = np.array([side, side, 1.0])
    material = dataclasses.replace(LACQUER, coat_normal_map=FLAT)
    case = Tilted(material, side > 0.0, tuple(coat * dent), tuple(base * dent))
    return case.evaluate(VIEW[None], LIGHT[None], device)[0][0]


def seen(mesh: wrt.Mesh, device: str, *, side: float = 1.0, integrator: str = "path", **maps: Any) -> np.ndarray:
    """Return the radiance of lacquer with these maps, seen from far away, lit by a sun on the same side."""
    towards = np.array([1.0, 1.0, side])
    camera = wrt.PerspectiveCamera(tuple(4e3 * VIEW * towards), (0.0, 0.0, 0.0), fov_degrees=0.01)
    scene = lit(mesh, dataclasses.replace(LACQUER, **maps), LIGHT * towards, camera)
    image = rendered(scene, device, integrator=integrator)
    np.testing.assert_allclose(image, np.broadcast_to(image[0, 0], image.shape), rtol=2e-3)
    return image[1, 1]


@pytest.mark.parametrize(
    ("matrix", "side", "integrator"),
    [(TURNED, 1.0, "path"), (MIRRORED, -1.0, "path"), pytest.param(MIRRORED, 1.0, "whitted", marks=pytest.mark.slow)],
)
def test_each_layer_has_its_own_normal(matrix: Any, side: float, integrator: str, device: str) -> None:
    mesh = with_uvs(wrt.quad(*SQUARE), matrix)
    options: dict[str, Any] = {"side": side, "integrator": integrator}
    coat, base = ([*(np.array(n[:2]) @ np.array(matrix)), 1.0] for n in (COAT, BASE))
    coat_map, base_map = constant_map(COAT[0] / 2, COAT[1] / 2, 1.0, scale=2.0), constant_map(*BASE)
    both = seen(mesh, device, **options, normal_map=base_map, coat_normal_map=coat_map)
    up = np.array([0.0, 0.0, 1.0])
    for found, normals in (
        (both, (coat, base)),
        (seen(mesh, device, **options, coat_normal_map=coat_map), (coat, up)),
        (seen(mesh, device, **options, normal_map=base_map, coat_normal_map=FLAT), (up, base)),
        (seen(mesh, device, **options, normal_map=base_map), (base, base)),
    ):
        np.testing.assert_allclose(found, expected(*normals, device, side=side), rtol=1e-3)
    assert np.abs(both / expected(up, base, device, side=side) - 1.0).max() > 0.1


@pytest.mark.slow
def test_the_map_of_a_coat_has_a_place_and_coordinates_of_its_own(device: str) -> None:
    """The left half of the image is flat, where the first coordinates are; the other ones lead to the right half."""
    pixels = np.repeat(np.concatenate([FLAT.pixels, constant_map(*COAT).pixels[:1, :1]], axis=1), 8, axis=1)
    quad = wrt.quad(*SQUARE)
    left, right = (0.02 * quad.uvs + [u, 0.5] for u in (0.25, 0.75))
    mesh = dataclasses.replace(quad, uvs=np.concatenate([left, right], axis=1))
    up = np.array([0.0, 0.0, 1.0])
    moves = ({}, {"uv_offset": (0.5, 0.0)}, {"uv_set": 1}, {"uv_scale": (3.0, 1.0)})
    for mapping, coat in zip(moves, (up, COAT, COAT, COAT), strict=True):
        found = seen(mesh, device, coat_normal_map=wrt.NormalMap(pixels, **mapping))
        np.testing.assert_allclose(found, expected(np.array(coat), up, device), rtol=1e-3)
    found = seen(mesh, device, normal_map=wrt.NormalMap(pixels, uv_offset=(0.5, 0.0)))
    np.testing.assert_allclose(found, expected(np.array(COAT), np.array(COAT), device), rtol=1e-3)


@pytest.mark.slow
def test_a_flat_coat_over_steep_bumps_has_no_holes(device: str) -> None:
    """Seen at a grazing angle, it mirrors the sky as over a flat base, though to below the horizon of many bumps."""
    slopes = np.random.default_rng(1).normal(scale=0.6, size=(16, 16, 2))
    normals = np.dstack([slopes, np.ones((16, 16))])
    bumps = wrt.NormalMap((0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32))
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, -4.0, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), fov_degrees=5.0)
    black = wrt.Principled(0.0, specular=0.0, coat=1.0)
    images = []
    for material in (black, dataclasses.replace(black, normal_map=bumps, coat_normal_map=FLAT)):
        scene.shapes = [wrt.Shape(wrt.quad(*SQUARE), material)]
        images.append(rendered(scene, device, spp=16, size=16))
    assert images[0].min() > 0.5
    np.testing.assert_allclose(*images, rtol=1e-4)


@needs_lanes
@pytest.mark.machinery
def test_the_wide_kernel_has_the_same_bits() -> None:
    ball = wrt.sphere(subdivisions=3)
    mesh = dataclasses.replace(ball, uvs=ball.vertices[:, [0, 1, 2, 0]])
    texels = 0.5 + 0.4 * np.random.default_rng(2).random((8, 8, 3)).astype(np.float32)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(0.5))
    maps = {"normal_map": wrt.NormalMap(texels), "coat_normal_map": wrt.NormalMap(texels[::-1], uv_set=1)}
    scene.add(mesh, material=dataclasses.replace(LACQUER, **maps))
    scene.add_light(wrt.RectangleLight((-1, 3, -1), (2, 0, 0), (0, 0, 2), 4.0))
    assert differences(scene, regularization=0.2) == []
