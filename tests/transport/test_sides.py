"""The back of a single-sided surface shows what is behind it to who looks, and stops light; unlit surfaces.

What is not seen changes no bit of a film: scenes are compared with others that lack it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.composites import WITH_OPACITY, render
from support.covering_kernels import rendering_with

import wrt

kernels_of_the_file = rendering_with(WITH_OPACITY, replace(WITH_OPACITY, exact="quadrics"))

BRIGHT = (1.0, 2.0, 3.0)
CAMERA = wrt.PerspectiveCamera((0, 0, 4), (0, 0, 0), fov_degrees=10)
MIRRORED = wrt.PerspectiveCamera((4, 0, 0), (0, 0, 0), fov_degrees=10)
GLASS = wrt.box((-1, -1, 1), (1, 1, 2))


def film(*shapes: wrt.Shape, camera: wrt.Camera = CAMERA, **options: Any) -> NDArray[np.float32]:
    return shown(wrt.Scene(shapes=[*shapes], camera=camera), **options)


def shown(scene: wrt.Scene, **options: Any) -> NDArray[np.float32]:
    return render(scene, "cpu", **{"spp": 8, "size": 10, **options}).image()


def square(z: float, *, half: float = 3.0) -> wrt.Mesh:
    """Return a square that faces +z, from where the camera looks."""
    return wrt.quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0))


def back(z: float = -1.0) -> wrt.Mesh:
    """Return a square whose back faces the camera."""
    return wrt.quad((3, -3, z), (-6, 0, 0), (0, 6, 0))


LAMP = wrt.Shape(square(-2.0), wrt.Emissive(BRIGHT))
WAYS: dict[str, tuple[list[wrt.Shape], wrt.Camera]] = {
    "straight": ([], CAMERA),
    "glass": ([wrt.Shape(GLASS, wrt.Dielectric(1.5))], CAMERA),
    "pane": ([wrt.Shape(square(1.0), wrt.ThinDielectric())], CAMERA),
    "mirror": ([wrt.Shape(wrt.quad((-1, -1, -1), (2, 0, 2), (0, 2, 0)), wrt.Mirror(0.9))], MIRRORED),
}
"""What the camera looks through or into, towards −z."""

SHEETS: dict[str, dict[str, Any]] = {
    "mesh": {"mesh": back()},
    "mirrored": {"mesh": square(1.0), "transform": np.diag([1.0, 1.0, -1.0, 1.0])},
    "disk": {"mesh": wrt.disk((0, 0, -1), (0, 0, -1), 2.0)},
}


@pytest.mark.parametrize("sheet", SHEETS)
@pytest.mark.parametrize("way", WAYS)
def test_what_is_behind_a_back_is_seen(way: str, sheet: str) -> None:
    """`mirrored`: a reflection keeps the front of a mesh (glTF 2.0, section 3.7.4), so the back stays towards −z."""
    before, camera = WAYS[way]
    expected = film(*before, LAMP, camera=camera)
    assert expected.mean() > 1.0
    looks = {"material": wrt.Diffuse(0.0), **SHEETS[sheet]}
    seen = film(*before, LAMP, wrt.Shape(**looks, double_sided=False), camera=camera)
    assert np.array_equal(seen, expected)
    assert film(*before, LAMP, wrt.Shape(**looks), camera=camera).mean() < 0.2


ASIDE = wrt.Shape(wrt.quad((99, 0, 0), (1, 0, 0), (0, 1, 0)), double_sided=False)
"""Out of sight, so that all scenes share a kernel, whether they have other single-sided shapes or not."""


@pytest.mark.parametrize("integrator", ["whitted", "ao"])
def test_other_integrators_see_the_same(integrator: str) -> None:
    # What lies behind darkens the lamp by occlusion.
    behind = ASIDE, LAMP, wrt.Shape(square(-1.8, half=0.1), wrt.Diffuse(0.5))
    options = {"integrator": integrator, "ao_distance": 0.5, "layers": ()}
    single, double = (wrt.Shape(back(), wrt.Diffuse(0.5), double_sided=both) for both in (False, True))
    assert np.array_equal(film(*behind, single, **options), film(*behind, **options))
    assert not np.array_equal(film(*behind, double, **options), film(*behind, **options))


def test_layers_see_the_same() -> None:
    scene = wrt.Scene(shapes=[LAMP, wrt.Shape(back(), double_sided=False)], camera=CAMERA)
    renderer = render(scene, "cpu", spp=2, size=4, layers=("depth", "object"))
    assert renderer._built.features.single_sided
    assert (renderer.layers()["object"] == 1).all()
    assert np.allclose(renderer.layers()["depth"], 6.0, atol=0.05)


def test_fronts_are_seen_and_of_two_in_one_place_the_front() -> None:
    """Many files lay two sheets back to back."""
    front = wrt.Shape(square(-1.0), wrt.Unlit((0.5, 0.25, 0.125)), double_sided=False)
    behind = wrt.Shape(back(), wrt.Unlit(9.0), double_sided=False)
    for shapes in ((front, behind), (behind, front)):
        assert np.allclose(film(LAMP, *shapes), (0.5, 0.25, 0.125))


def test_what_transmits_or_emits_to_the_back_has_two_sides() -> None:
    for material in (wrt.Dielectric(1.5), wrt.ThinDielectric(specular_transmittance=0.5)):
        one, two = (film(LAMP, wrt.Shape(GLASS, material, double_sided=double)) for double in (False, True))
        assert np.array_equal(one, two)
    lamp = wrt.Shape(back(), emission=5.0, two_sided_emission=True, double_sided=False)
    assert np.allclose(film(LAMP, lamp), 5.0)


@pytest.mark.parametrize("place", [(0, 0, 0.9), (0, 0, 4)])
def test_walls_that_face_inwards_keep_light_out(place: tuple[float, float, float]) -> None:
    """The camera is in the room, or looks into it through the back of a wall."""
    box = wrt.box((-1, -1, -1), (1, 1, 1))
    room = wrt.Shape(wrt.Mesh(box.vertices, box.faces[:, ::-1]), wrt.Diffuse(0.8), double_sided=False)
    scene = wrt.Scene(shapes=[room], environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(place, (0.1, 0, 0), fov_degrees=20)
    assert not shown(scene).any()
    if place[2] < 1:  # lit from within, as by walls of two sides
        scene.add_light(wrt.PointLight((0.2, 0.3, 0.1), 1.0))
        lit = shown(scene)
        scene.shapes = [wrt.Shape(room.mesh, room.material)]
        assert lit.mean() > 0.1
        assert np.array_equal(lit, shown(scene))


def over_a_floor(sheet: wrt.Shape) -> NDArray[np.float32]:
    """Return the picture of a floor beside a sheet that shades it from an even sky, and is out of the picture."""
    scene = wrt.Scene(shapes=[wrt.Shape(square(-1.0), wrt.Diffuse(0.5)), sheet])
    scene.environment = wrt.ConstantEnvironment(1.0)
    scene.camera = wrt.PerspectiveCamera((0, 6, 2), (0, 2.5, -1), fov_degrees=20)
    return shown(scene)


def test_what_light_scattered_to_finds_backs_and_unlit_surfaces() -> None:
    """A floor stays in the shadow of a sheet whose back faces the floor or the lamp, and of an unlit one."""
    sheet = wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    expected = over_a_floor(wrt.Shape(sheet, wrt.Diffuse(0.0)))
    assert expected.std() > 0.01
    for look in ({"material": wrt.Diffuse(0.0), "double_sided": False}, {"material": wrt.Unlit(20.0)}):
        assert np.array_equal(expected, over_a_floor(wrt.Shape(sheet, **look)))
    for mesh in (square(0.0), back()):
        assert np.allclose(film(wrt.Shape(mesh, wrt.Unlit(BRIGHT))), BRIGHT)


def outlined(*, shell: bool) -> wrt.Scene:
    """Return a lit ball, perhaps in a black unlit shell that is turned inside out."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0), camera=CAMERA)
    scene.add(wrt.sphere((0, 0, 0), 0.2), material=wrt.Diffuse((0.8, 0.4, 0.1)))
    if shell:
        ball = wrt.sphere((0, 0, 0), 0.25)
        inside_out = wrt.Mesh(ball.vertices, ball.faces[:, ::-1])
        scene.add(inside_out, material=wrt.Unlit(0.0), double_sided=False)
    return scene


def test_a_shell_of_unlit_black_draws_an_outline_and_darkens_nothing() -> None:
    plain, drawn = (shown(outlined(shell=shell), size=48, spp=16) for shell in (False, True))
    middle = slice(20, 28), slice(20, 28)
    assert np.allclose(drawn[middle].mean((0, 1)), plain[middle].mean((0, 1)), rtol=1e-3)
    dark = (drawn.sum(axis=2) == 0.0) & (plain.sum(axis=2) > 0.0)
    assert 100 < dark.sum() < 500  # a ring of 0.05 round 0.2: 390 pixels that it covers wholly
