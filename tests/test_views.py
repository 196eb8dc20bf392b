"""`wrt.render_views` yields the pictures of `wrt.render`, in order, from one build of the scene."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import json
import math
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from test_checkpoint import scene

import wrt
from wrt.rendering import renderer as renderers
from wrt.rendering.render_kernel import RenderKernel

SIZE = {"width": 16, "height": 12, "max_depth": 3}
LAYERS = ("albedo", "depth", "object", "material")
CAMERAS = [wrt.PerspectiveCamera((4.0 * math.sin(a), 1.0, 4.0 * math.cos(a)), (0.0, 0.0, 0.0)) for a in range(5)]


def test_views_are_the_pictures_of_single_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    builds = []
    build = renderers.build_scene
    monkeypatch.setattr(renderers, "build_scene", lambda *a, **k: builds.append(1) or build(*a, **k))
    views = list(wrt.render_views(scene(), iter(CAMERAS), spp=3, layers=LAYERS, **SIZE))
    assert len(builds) == 1
    assert [view.index for view in views] == list(range(5))
    for view, camera in zip(views, CAMERAS, strict=True):
        assert view.camera == camera
        single = wrt.Renderer(dataclasses.replace(scene(), camera=camera), layers=LAYERS, **SIZE)
        for _ in single.passes(spp=3):
            pass
        np.testing.assert_array_equal(view.image, single.image())
        assert view.layers.keys() == set(LAYERS)
        for name, layer in single.layers().items():
            np.testing.assert_array_equal(view.layers[name], layer)
        assert view.spp == 3


def test_a_view_is_one_pass_once_the_time_of_one_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = []
    trace = wrt.Renderer._trace
    monkeypatch.setattr(wrt.Renderer, "_trace", lambda self, spp, left: targets.append(spp) or trace(self, spp, left))
    views = list(wrt.render_views(scene(), CAMERAS, spp=5, **SIZE))
    assert [view.spp for view in views] == [5] * 5
    # The first two are rendered at once, both before the time is known.
    assert 1 <= targets.count(1) <= 2
    targets.clear()
    list(wrt.render_views(scene(), CAMERAS, noise=0.5, **SIZE))
    assert targets.count(1) == 5


@pytest.mark.slow
def test_views_of_a_scene_with_media_begin_in_their_own_bodies() -> None:
    """The bodies around the camera belong to the built scene."""
    inside = wrt.PerspectiveCamera(origin=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0))
    outside = wrt.PerspectiveCamera(origin=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0))
    fog = wrt.Scene(camera=outside, environment=wrt.ConstantEnvironment(1.0))
    medium = wrt.Medium(absorption=(0.5, 1.0, 2.0))
    fog.add(wrt.sphere(radius=2.0, subdivisions=3), material=wrt.Null(interior=medium))
    pictures = {}
    for camera in (inside, outside):
        single = wrt.Renderer(dataclasses.replace(fog, camera=camera), width=24, height=16)
        for _ in single.passes(spp=2):
            pass
        pictures[camera] = single.image()
    for view in wrt.render_views(fog, [inside, outside] * 3, width=24, height=16, spp=2):
        np.testing.assert_array_equal(view.image, pictures[view.camera])


def test_a_view_knows_that_others_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone it would be too short to load the wide kernel."""
    after: dict[int, list[float]] = {0: [], 1: []}
    launch = RenderKernel.launch
    for known, cameras in enumerate((iter(lambda: CAMERAS[0], None), CAMERAS)):

        def noted(kernel: RenderKernel, *arguments: object, known: int = known) -> None:
            after[known].append(kernel.seconds_after)
            launch(kernel, *arguments)

        monkeypatch.setattr(RenderKernel, "launch", noted)
        views = wrt.render_views(scene(), cameras, spp=1, **SIZE)
        assert len(list(itertools.islice(views, len(CAMERAS)))) == len(CAMERAS)
        views.close()
    assert after[0][0] == after[1][0] == 0.0  # nothing is known
    assert max(after[0]) > 0.0
    assert max(after[1]) > 0.0


def test_leaving_the_loop_ends_rendering() -> None:
    before = threading.active_count()
    for view in wrt.render_views(scene(), CAMERAS, spp=200_000, threads=1, noise=0.5, **SIZE):
        assert view.index == 0
        break
    views = wrt.render_views(scene(), CAMERAS * 9, spp=1, threads=1, **SIZE)
    next(views)
    views.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("wrt-view")]
    assert threading.active_count() <= before + 3  # those of the device stay


def test_a_camera_that_does_not_fit_is_named() -> None:
    views = wrt.render_views(scene(), [CAMERAS[0], dataclasses.replace(CAMERAS[1], shutter_close=0.5)], spp=1, **SIZE)
    next(views)
    with pytest.raises(wrt.InputError, match=r"^camera 1: the camera must have the same shutter times"):
        next(views)
    assert list(wrt.render_views(scene(), [])) == []
    for alone in (CAMERAS[0], None):
        with pytest.raises(
            wrt.InputError, match=rf"^cameras must be several of wrt's cameras, not {type(alone).__name__}$"
        ):
            next(wrt.render_views(scene(), alone))  # type: ignore[arg-type]


def test_a_dataset_maps_points_to_the_pixels_that_show_them(tmp_path: Path) -> None:
    """The teapot of scripts/dataset.py: positions of the layer, moved by the matrices, project onto their pixels."""
    spec = importlib.util.spec_from_file_location("dataset", ROOT / "scripts" / "dataset.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["dataset"] = module
    spec.loader.exec_module(module)
    assert module.main(["teapot", "-o", str(tmp_path / "d"), "--views", "2", "--size", "32", "--spp", "2"]) == 0
    written = json.loads((tmp_path / "d" / "transforms.json").read_text())
    assert len(written["frames"]) == 2
    half = math.tan(written["camera_angle_x"] / 2.0)
    for frame in written["frames"]:
        to_world = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(np.linalg.inv(to_world[:3, :3]), to_world[:3, :3].T, atol=1e-6)
        assert np.linalg.det(to_world[:3, :3]) == pytest.approx(1.0)
        layers = np.load(tmp_path / "d" / frame["layers_path"])
        seen = layers["object"] > 0
        assert 0.05 < seen.mean() < 0.9
        points = np.c_[layers["position"][seen], np.ones(seen.sum())] @ np.linalg.inv(to_world).T
        x = 16.0 + 16.0 * points[:, 0] / -points[:, 2] / half
        y = 16.0 - 16.0 * points[:, 1] / -points[:, 2] / half
        rows, columns = np.nonzero(seen)
        assert np.abs(x - columns - 0.5).max() < 1.5  # a filter is wider than a pixel
        assert np.abs(y - rows - 0.5).max() < 1.5
        image = wrt.load_image(tmp_path / "d" / f"{frame['file_path']}.png")
        assert image.shape == (32, 32, 3)
