"""`Renderer.set_camera` gives the picture that a new renderer with that camera gives."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import wrt

NEAR = wrt.PerspectiveCamera(origin=(0.4, 0.1, 2.6), target=(0.0, -0.2, 0.0), fov_degrees=50.0)


def small(scene: wrt.Scene) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, width=24, height=16, threads=1)
    for _ in renderer.passes(spp=2):
        pass
    return renderer


@pytest.mark.parametrize("camera", [NEAR, wrt.PanoramaCamera(origin=(0.0, 0.0, 0.5), target=(0.0, 0.0, 0.0))])
def test_the_picture_is_a_new_renderers(camera: wrt.Camera) -> None:
    scene = wrt.load("cornell-box")
    renderer = small(scene)
    before = renderer.image()
    renderer.set_camera(camera)
    assert renderer.spp == 0
    for _ in renderer.passes(spp=2):
        pass
    expected = small(dataclasses.replace(scene, camera=camera)).image()
    assert not np.array_equal(renderer.image(), before)
    np.testing.assert_array_equal(renderer.image(), expected)
    assert scene.camera != camera  # the caller's scene stays


@pytest.mark.slow
def test_a_camera_may_enter_a_body() -> None:
    """Paths begin in the medium around the camera, which is found again."""
    inside = wrt.PerspectiveCamera(origin=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0))
    outside = wrt.PerspectiveCamera(origin=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0))
    fog = wrt.Medium(absorption=(0.5, 1.0, 2.0))
    scene = wrt.Scene(camera=outside, environment=wrt.ConstantEnvironment(1.0))
    scene.add(wrt.sphere(radius=2.0, subdivisions=3), material=wrt.Null(interior=fog))
    renderer = small(scene)
    renderer.set_camera(inside)
    for _ in renderer.passes(spp=2):
        pass
    np.testing.assert_allclose(renderer.image()[8, 12], np.exp(-2.0 * np.array([0.5, 1.0, 2.0])), rtol=0.02)


def test_what_needs_a_new_renderer_is_refused() -> None:
    renderer = small(wrt.load("cornell-box"))
    with pytest.raises(wrt.InputError, match="same shutter times"):
        renderer.set_camera(dataclasses.replace(NEAR, shutter_close=1.0))
    with pytest.raises(wrt.InputError, match="must be one of wrt's cameras, not str"):
        renderer.set_camera("a camera")  # type: ignore[arg-type]


def test_a_camera_that_is_assigned_is_no_camera_that_is_left_out() -> None:
    renderer = small(wrt.load("cornell-box"))
    with pytest.raises(AttributeError):
        renderer.camera = NEAR  # type: ignore[misc]
    renderer.set_camera(NEAR)
    assert renderer.camera is NEAR
