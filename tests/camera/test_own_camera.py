"""docs/own/fisheye.py: it runs, and the camera it registers sees by its formula."""

import runpy
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from support.small_scenes import finish

import wrt
from wrt.kernels.camera.models import CAMERA_MODELS
from wrt.kernels.camera.projections import PERSPECTIVE as PINHOLE
from wrt.scene.camera import CAMERAS

CODE = (ROOT / "docs/own/fisheye.py").read_text("utf-8")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Run the page's program without its render, from a file as Warp reads it, and return what it defines."""
    path = tmp_path_factory.mktemp("own") / "stereographic.py"
    path.write_text(CODE, "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path.parent)
        patch.setattr(wrt, "render", lambda scene, **size: np.full((8, 8, 3), 0.5))
        program = runpy.run_path(str(path), run_name="__main__")
    assert wrt.load_image(path.parent / "stereographic.png").shape == (8, 8, 3)
    yield SimpleNamespace(**program)
    CAMERAS.pop("stereographic", None)  # leave the register as it was found
    CAMERA_MODELS.forget("stereographic")


@pytest.mark.slow
def test_it_sees_by_its_formula_and_projects_back(example, device):
    """Inside a large ball: positions lie in the directions of the pixels, and what stands still moves by nothing."""
    scene = wrt.Scene()
    scene.add(wrt.sphere(radius=50.0, subdivisions=6))
    motion = wrt.Motion([0.0, 1.0], [np.eye(4), np.eye(4)])
    scene.camera = example.StereographicCamera((0, 0, 0), (0, 0, -1), motion=motion, shutter_close=1.0)
    n = 24
    how = {"integrator": "aov", "layers": ("position", "motion"), "filter": "box", "device": device}
    renderer = wrt.Renderer(scene, width=n, height=n, **how)
    layers = finish(renderer, 64).layers()
    pixel = 4.0 * np.tan(np.radians(45.0)) / n
    x, y = np.meshgrid((np.arange(n) + 0.5 - n / 2) * pixel, -(np.arange(n) + 0.5 - n / 2) * pixel)
    angle, turn = 2.0 * np.arctan(np.hypot(x, y) / 2.0), np.arctan2(y, x)
    expected = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)], axis=-1)
    directions = layers["position"] / np.linalg.norm(layers["position"], axis=-1, keepdims=True)
    # The sample nearest to a pixel's middle is within a few hundredths of a pixel's width of it in most.
    assert np.median(np.linalg.norm(directions - expected, axis=-1)) < 0.15 * pixel
    assert np.abs(directions - expected).max() < pixel
    np.testing.assert_allclose(layers["motion"], 0.0, atol=2e-3)


@pytest.mark.parametrize(("name", "message"), [("fisheye", "'fisheye' is empty or taken"), ("odd name", "a mod")])
def test_what_cannot_be_registered_is_refused(name, message):
    cls = type("Own", (wrt.Camera,), {"type_name": name})
    with pytest.raises(wrt.InputError, match=rf"^Own: .*{message}"):
        wrt.register_camera(cls, PINHOLE)
