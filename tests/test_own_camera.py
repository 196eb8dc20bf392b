"""docs/own-camera.md: its program runs, and a camera of one's own sees what its formula says."""

from __future__ import annotations

import functools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from test_cli import ENVIRONMENT
from test_own_bsdf import module_of

import wrt
from wrt.kernels.camera.perspective import MODEL as PINHOLE
from wrt.scene.camera import CAMERAS

(CODE,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs" / "own-camera.md").read_text("utf-8"), re.M | re.S)


@functools.cache
def example() -> ModuleType:
    """Return the page's program as a module; it registers its camera."""
    return module_of("stereographic", CODE)


@pytest.fixture(scope="module", autouse=True)
def _forget() -> Iterator[None]:
    """Leave the registers as they were found."""
    CAMERAS.setdefault("stereographic", example().StereographicCamera)
    yield
    CAMERAS.pop("stereographic", None)


@pytest.mark.slow
def test_the_program_runs(tmp_path: Path) -> None:
    (tmp_path / "camera.py").write_text(CODE, "utf-8")
    done = subprocess.run([sys.executable, "camera.py"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    image = wrt.load_image(tmp_path / "stereographic.png")
    assert image[64:192, 64:192].mean() > 0.05


def test_it_sees_by_its_formula_and_projects_back(device: str) -> None:
    """Inside a large ball: positions lie in the directions of the pixels, and what stands still moves by nothing."""
    scene = wrt.Scene()
    scene.add(wrt.sphere(radius=50.0, subdivisions=6))
    motion = wrt.Motion([0.0, 1.0], [np.eye(4), np.eye(4)])
    scene.camera = example().StereographicCamera((0, 0, 0), (0, 0, -1), motion=motion, shutter_close=1.0)
    n = 24
    renderer = wrt.Renderer(
        scene, width=n, height=n, integrator="aov", layers=("position", "motion"), filter="box", device=device
    )
    for _ in renderer.passes(spp=64):
        pass
    layers = renderer.layers()
    pixel = 4.0 * np.tan(np.radians(45.0)) / n
    x, y = np.meshgrid((np.arange(n) + 0.5 - n / 2) * pixel, -(np.arange(n) + 0.5 - n / 2) * pixel)
    angle, turn = 2.0 * np.arctan(np.hypot(x, y) / 2.0), np.arctan2(y, x)
    expected = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)], axis=-1)
    seen = layers["position"] / np.linalg.norm(layers["position"], axis=-1, keepdims=True)
    # The sample nearest to a pixel's middle is within a few hundredths of a pixel's width of it in most.
    assert np.median(np.linalg.norm(seen - expected, axis=-1)) < 0.15 * pixel
    assert np.abs(seen - expected).max() < pixel
    np.testing.assert_allclose(layers["motion"], 0.0, atol=2e-3)


def test_a_copy_of_the_pinhole_is_the_pinhole(device: str) -> None:
    class Copy(wrt.PerspectiveCamera):
        type_name = "copy-of-perspective"

    wrt.register_camera(Copy, PINHOLE)
    try:
        scene = wrt.load("cornell-box")
        assert scene.camera is not None
        place = {"origin": scene.camera.origin, "target": scene.camera.target, "aperture_radius": 0.05}
        images = []
        for cls in (wrt.PerspectiveCamera, Copy):
            scene.camera = cls(**place)  # type: ignore[arg-type]
            images.append(wrt.render(scene, width=16, height=16, spp=2, device=device))
    finally:
        del CAMERAS[Copy.type_name]
    assert images[0].max() > 0.0
    np.testing.assert_array_equal(*images)


def test_what_cannot_be_registered_is_refused() -> None:
    class Nameless(wrt.Camera):
        pass

    class Taken(wrt.Camera):
        type_name = "fisheye"

    class Odd(wrt.Camera):
        type_name = "odd name"

    for cls, message in (
        (Nameless, "Nameless: type_name '' is empty or taken"),
        (Taken, "Taken: type_name 'fisheye' is empty or taken"),
        (Odd, "Odd: a model's name must be an identifier"),
    ):
        with pytest.raises(wrt.InputError) as caught:
            wrt.register_camera(cls, PINHOLE)
        assert str(caught.value).startswith(message)
