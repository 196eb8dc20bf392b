"""Media that absorb and emit: Beer's law per channel, towards the camera and towards a light.

Where nothing scatters and nothing reflects a path has one way to go, and pictures have no noise at all.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from support.covering_kernels import rendering_with
from support.fresnel import cook_torrance as fresnel
from support.media import KERNELS, mean_and_error, render, stage

import wrt

B = np.array([0.5, 1.0, 2.0])
MEDIUM = wrt.Medium(absorption=tuple(B))
WALL = wrt.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0))


few_kernels = rendering_with(*KERNELS)


def slab(material: wrt.Material, thickness: float = 0.7, *, degrees: float = 0.0, sky: float = 1.0) -> wrt.Scene:
    """Return a large slab of a material before a bright sky, looked through at an angle to its normal."""
    a = math.radians(degrees)
    scene = stage(sky=sky, origin=(3.0 * math.sin(a), 0.0, 3.0 * math.cos(a)))
    scene.add(wrt.box((-20, -20, -thickness), (20, 20, 0.0)), material=material)
    return scene


def fog(medium: wrt.Medium, *bodies: wrt.Mesh, emission: tuple[float, ...] = (1.0, 1.0, 1.0)) -> wrt.Scene:
    """Return a glowing wall 5 m away in fog, which does not reach into bodies."""
    scene = stage(medium=medium)
    scene.add(WALL, material=wrt.Diffuse(0.0), emission=emission)
    for body in bodies:
        scene.add(body, material=wrt.Null())
    return scene


def within_two_bodies() -> wrt.Scene:
    """Of the outer one a side is missing: whether the camera is inside is decided by most directions."""
    scene = stage(sky=1.0)
    scene.add(wrt.box((-2, -2, 0), (2, 2, 5)), material=wrt.Null(interior=MEDIUM))
    outer = wrt.box((-9, -9, -1), (9, 9, 9))
    side = (outer.vertices[outer.faces][..., 0] > 8.0).all(axis=1)
    assert side.sum() == 2
    outer = wrt.Mesh(outer.vertices, outer.faces[~side])
    scene.add(outer, material=wrt.Null(interior=wrt.Medium(tuple(2.0 * B))))
    return scene


COLOR = (0.9, 0.4, 0.05)
GLOW, ABSORBED = np.array([3.0, 2.0, 1.0]), np.array([1e-20, 0.5, 4.0])
FAINT = np.array([1e-9, 1e-6, 1e-4])
T5 = np.exp(-B * 5.0)
EXACT: dict[str, tuple[wrt.Scene, NDArray]] = {
    "slab": (slab(wrt.Null(interior=MEDIUM), degrees=60.0), np.exp(-B * 1.4)),
    "slab of index 1": (slab(wrt.Dielectric(1.0, interior=MEDIUM), degrees=60.0), np.exp(-B * 1.4)),
    # b = −ln I(1): what `from_color` is given comes out after just that distance.
    "colour": (slab(wrt.Null(interior=wrt.Medium.from_color(COLOR, distance=2.5)), 5.0), np.square(COLOR)),
    # L = e / a (1 − exp(−a d)), e d where nothing absorbs; of the slightest absorption that would have no digits.
    "emission": (
        slab(wrt.Null(interior=wrt.Medium((0.0, *ABSORBED[1:]), emission=tuple(GLOW))), sky=0.0),
        GLOW / ABSORBED * -np.expm1(-ABSORBED * 0.7),
    ),
    "emission of what hardly absorbs": (
        slab(wrt.Null(interior=wrt.Medium(tuple(FAINT), emission=1.0)), sky=0.0),
        0.7 * (1.0 - FAINT * 0.35),
    ),
    "glowing fog": (
        fog(wrt.Medium(tuple(B), emission=(0.3, 0.2, 0.1)), emission=(10.0, 20.0, 30.0)),
        np.array([10.0, 20.0, 30.0]) * T5 + np.array([0.3, 0.2, 0.1]) / B * (1.0 - T5),
    ),
    "no fog in a body": (fog(MEDIUM, wrt.box((-3, -3, -0.5), (3, 3, 1.5))), np.exp(-B * 3.0)),
    # The path begins in the bodies that the camera stands in: the inner of two, which lies in the other.
    "camera in bodies": (within_two_bodies(), np.exp(-B * 3.0 - 2.0 * B)),
}


@pytest.mark.parametrize("name", EXACT)
def test_radiance_has_its_closed_form(name: str, device: str) -> None:
    scene, expected = EXACT[name]
    image = render(scene, device).image()
    assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=2e-6 if "hardly" in name else 2e-5)


def test_a_slab_of_coloured_glass(device: str, report: Report) -> None:
    """All reflections between its faces summed: of each face F, on each way T, the sky is 1 on both sides.

    What is seen is F + (1 − F)² T (1 + F T) / (1 − F² T²), a series in F T.
    """
    degrees = 50.0
    renderer = render(slab(wrt.Dielectric(1.5, interior=MEDIUM), degrees=degrees), device, size=(16, 16), spp=256)
    mean, error = mean_and_error(renderer)

    def seen(thickness: float) -> np.ndarray:
        f = fresnel(math.cos(math.radians(degrees)), 1.5)
        t = np.exp(-B * thickness / math.sqrt(1.0 - (math.sin(math.radians(degrees)) / 1.5) ** 2))
        return f + (1.0 - f) ** 2 * t * (1.0 + f * t) / (1.0 - (f * t) ** 2)

    report("glass of 0.7 m, red green blue", str(mean.round(5)), str(seen(0.7).round(5)))
    assert (np.abs(mean - seen(0.7)) < 3.5 * error).all()
    # Of a slab 1 % thicker it would not be so.
    assert (np.abs(mean - seen(0.7 * 1.01)) > 3.5 * error).all()


def test_fog_without_end(device: str) -> None:
    """Nothing of the sky comes through, and the fog's own light is e / a."""
    with pytest.warns(UserWarning, match="reaches to infinity"):
        image = render(stage(sky=7.0, medium=wrt.Medium(tuple(B), emission=1.0)), device).image()
    assert_allclose(image[0, 0], 1.0 / B, rtol=2e-5)
    with pytest.raises(wrt.InputError, match="reaches to infinity"):
        render(stage(medium=wrt.Medium((1.0, 0.0, 1.0), emission=1.0)), device)


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_bodies_that_touch(turn: float, device: str) -> None:
    """Blocks share faces, whose triangles are the same, or others in the same plane: neither is overlooked."""
    scene = stage(sky=1.0, fov_degrees=20.0)
    for low, absorption in ((-1.0, B), (-2.0, 3.0 * B), (-3.0, B[::-1])):
        box = wrt.box((-4.0, -4.0, low), (4.0, 4.0, low + 1.0)).rotated((0, 0, 1), turn if low == -2.0 else 0.0)
        scene.add(box, material=wrt.Null(interior=wrt.Medium(tuple(absorption))))
    total = -np.log(render(scene, device, size=(64, 64)).image()) / (B + 3.0 * B + B[::-1])
    # The way through each block is 1 / cosθ, the same in all channels and somewhat random within a pixel.
    assert_allclose(total, np.broadcast_to(total[..., :1], total.shape), rtol=2e-4)
    assert 0.9999 < total.min() <= total.max() < 1.0 / math.cos(math.radians(15.0))


def test_light_through_bodies_and_panes(device: str) -> None:
    """A point light lights a plate at 45 degrees: through 0.5 m / cos 45° of a block, which is not in the camera's
    way, or through thin glass, which leaves 1 − 2 F / (1 + F), times its colour."""
    color = np.array([0.9, 0.5, 0.1])
    glass = wrt.ThinDielectric(1.5, specular_transmittance=tuple(color))
    images = []
    for pane in (
        None,
        wrt.Shape(wrt.box((0.2, -4, -0.6), (9, 4, -0.1)), wrt.Null(interior=MEDIUM)),
        wrt.Shape(wrt.quad((0.1, -4, -0.4), (9, 0, 0), (0, 8, 0)), glass),
    ):
        scene = stage(origin=(0.0, 0.0, 3.0), medium=None)
        scene.add(wrt.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0)), material=wrt.Diffuse(0.5))
        scene.add_light(wrt.PointLight((2.0, 0.0, 1.0), intensity=1.0))
        scene.add(wrt.box((99, 99, 99), (100, 100, 100)), material=wrt.Null(interior=MEDIUM))
        scene.shapes += [pane] if pane else []
        images.append(render(scene, device, spp=4, max_depth=2).image()[0, 0])
    plain, dimmed, lit = images
    assert_allclose(plain, 0.5 / np.pi / 8.0 * math.sqrt(0.5), rtol=1e-4)
    assert_allclose(dimmed / plain, np.exp(-B * 0.5 * math.sqrt(2.0)), rtol=1e-4)
    f = fresnel(math.sqrt(0.5), 1.5)
    assert_allclose(lit / plain, color * (1.0 - 2.0 * f / (1.0 + f)), rtol=1e-4)


@pytest.mark.parametrize("strategy", ["mis", "bsdf"])
def test_a_lamp_behind_coloured_panes(strategy: str, device: str, report: Report) -> None:
    """Light found by chance behind a pane is weighed against shadow rays as if the pane were not there."""
    scene = stage()
    scene.add(wrt.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0)), material=wrt.Diffuse(0.5))
    lamp = wrt.quad((0.5, -1.0, -0.5), (0, 0, 2.0), (0, 2.0, 0))  # its front towards −x
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=3.0)
    scene.add(wrt.box((0.2, -6, -0.9), (0.4, 6, 6)), material=wrt.Null(interior=MEDIUM))
    scene.add(wrt.quad((0.15, -6, -0.95), (0, 12, 0), (0, 0, 9)), material=wrt.ThinDielectric(1.5))
    options = {"size": (32, 32), "spp": 256, "max_depth": 2}
    mean, error = mean_and_error(render(scene, device, strategy=strategy, **options))
    by_light, by_light_error = mean_and_error(render(scene, device, strategy="light", seed=5, **options))
    report(f"{strategy}: red green blue", str(mean.round(6)), f"± {error.round(6)}")
    assert by_light.min() > 0.0
    assert (np.abs(mean - by_light) < 3.5 * np.hypot(error, by_light_error)).all()


def test_media_that_cannot_be_are_refused() -> None:
    scene = stage(sky=1.0)
    two = wrt.Mix(wrt.Dielectric(interior=MEDIUM), wrt.Dielectric())
    scene.add(wrt.box((-1, -1, -1), (1, 1, 1)), material=two, name="odd")
    with pytest.raises(wrt.InputError, match="odd: the parts of a material must have the same interior"):
        wrt.Renderer(scene, width=2, height=2)
