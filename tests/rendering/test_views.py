"""`wrt.render_views` and `Renderer.set_camera` give the pictures of new renderers, from one build of the scene."""

import dataclasses
import json
import math
import threading

import dataset
import numpy as np
import pytest
from support.small_scenes import assert_same_arrays, block_scene, finish, image_of

import wrt
from wrt.rendering import renderer as renderers

SIZE = {"width": 16, "height": 12, "max_depth": 3}
LAYERS = ("albedo", "depth", "object", "material")
CAMERAS = [wrt.PerspectiveCamera((4.0 * math.sin(a), 1.0, 4.0 * math.cos(a)), (0.0, 0.0, 0.0)) for a in range(5)]
INSIDE = wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def test_views_are_the_pictures_of_single_renders(monkeypatch):
    builds, build = [], renderers.SceneUpload
    monkeypatch.setattr(renderers, "SceneUpload", lambda *a, **k: builds.append(1) or build(*a, **k))
    views = list(wrt.render_views(block_scene(), iter(CAMERAS), spp=3, layers=LAYERS, **SIZE))
    assert len(builds) == 1
    assert [(view.index, view.camera, view.spp) for view in views] == [(i, c, 3) for i, c in enumerate(CAMERAS)]
    for view in views:
        single = finish(wrt.Renderer(block_scene(camera=view.camera), layers=LAYERS, **SIZE), 3)
        np.testing.assert_array_equal(view.image, single.image())
        assert_same_arrays(view.layers, single.layers())


@pytest.mark.slow
def test_views_in_media_begin_in_their_own_bodies():
    """The bodies around the camera are found again for each camera."""
    absorption = (0.5, 1.0, 2.0)
    outside = wrt.PerspectiveCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
    fog = wrt.Scene(camera=outside, environment=wrt.ConstantEnvironment(1.0))
    fog.add(wrt.sphere(radius=2.0, subdivisions=3), material=wrt.Null(interior=wrt.Medium(absorption=absorption)))
    size = {"width": 24, "height": 16}
    cameras = (INSIDE, outside)
    pictures = {c: image_of(wrt.Renderer(dataclasses.replace(fog, camera=c), **size), 2) for c in cameras}
    for view in wrt.render_views(fog, [*cameras] * 3, **size, spp=2):
        np.testing.assert_array_equal(view.image, pictures[view.camera])
    renderer = finish(wrt.Renderer(fog, **size), 2)
    renderer.set_camera(INSIDE)
    np.testing.assert_array_equal(image_of(renderer, 2), pictures[INSIDE])
    np.testing.assert_allclose(renderer.image()[8, 12], np.exp(-2.0 * np.array(absorption)), rtol=0.02)


def test_leaving_the_loop_ends_rendering():
    before = threading.active_count()
    for view in wrt.render_views(block_scene(), CAMERAS, spp=200_000, threads=1, noise=0.5, **SIZE):
        assert view.index == 0
        break
    views = wrt.render_views(block_scene(), CAMERAS * 9, spp=1, threads=1, **SIZE)
    next(views)
    views.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("wrt-view")]
    assert threading.active_count() <= before + 3  # those of the device stay


def test_a_camera_that_does_not_fit_is_named():
    late = dataclasses.replace(CAMERAS[1], shutter_close=0.5)
    views = wrt.render_views(block_scene(), [CAMERAS[0], late], spp=1, **SIZE)
    next(views)
    with pytest.raises(wrt.InputError, match=r"^camera 1: the camera must have the same shutter times"):
        next(views)
    assert list(wrt.render_views(block_scene(), [])) == []
    with pytest.raises(wrt.InputError, match=r"^cameras must be several of wrt's cameras, not PerspectiveCamera$"):
        next(wrt.render_views(block_scene(), CAMERAS[0]))
    renderer = wrt.Renderer(block_scene(), **SIZE)
    for camera, message in ((late, "same shutter times"), ("a camera", "must be one of wrt's cameras, not str")):
        with pytest.raises(wrt.InputError, match=message):
            renderer.set_camera(camera)
    with pytest.raises(AttributeError):
        renderer.camera = CAMERAS[1]


@pytest.mark.parametrize("camera", [CAMERAS[1], wrt.PanoramaCamera(origin=(0.0, 0.0, 2.5), target=(0.0, 0.0, 0.0))])
def test_the_picture_of_a_camera_that_is_set_is_a_new_renderers(camera):
    scene = block_scene()
    renderer = finish(wrt.Renderer(scene, **SIZE), 2)
    before = renderer.image()
    renderer.set_camera(camera)
    assert renderer.camera is camera
    assert renderer.spp == 0
    assert not np.array_equal(image_of(renderer, 2), before)
    np.testing.assert_array_equal(renderer.image(), image_of(wrt.Renderer(block_scene(camera=camera), **SIZE), 2))
    assert scene.camera != camera  # the caller's scene stays


@pytest.mark.slow
def test_a_dataset_maps_points_to_the_pixels_that_show_them(tmp_path):
    """The teapot of scripts/dataset.py: positions of the layer, moved by the matrices, project onto their pixels."""
    folder = tmp_path / "d"
    assert dataset.main(["teapot", "-o", str(folder), "--views", "2", "--size", "32", "--spp", "2"]) == 0
    written = json.loads((folder / "transforms.json").read_text())
    assert len(written["frames"]) == 2
    assert [each.camera.fov_degrees for each in wrt.load_cameras(folder / "transforms.json").values()] == [
        pytest.approx(40.0)
    ] * 2
    for frame in written["frames"]:
        to_world = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(np.linalg.inv(to_world[:3, :3]), to_world[:3, :3].T, atol=1e-6)
        assert np.linalg.det(to_world[:3, :3]) == pytest.approx(1.0)
        layers = np.load((folder / frame["file_path"]).with_suffix(".npz"))
        visible = layers["object"] > 0
        assert 0.05 < visible.mean() < 0.9
        points = np.c_[layers["position"][visible], np.ones(visible.sum())] @ np.linalg.inv(to_world).T
        places = points[:, :2] / -points[:, 2:3] / math.tan(written["camera_angle_x"] / 2.0)
        rows, columns = np.nonzero(visible)
        # A filter is wider than a pixel.
        assert np.abs(16.0 + 16.0 * places[:, 0] - columns - 0.5).max() < 1.5
        assert np.abs(16.0 - 16.0 * places[:, 1] - rows - 0.5).max() < 1.5
        assert wrt.load_image(folder / frame["file_path"]).shape == (32, 32, 3)
