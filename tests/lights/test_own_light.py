"""docs/own-light.md: its program runs, its model is right, and its light works like a built-in one."""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT, Report
from support.covering_kernels import rendering_with
from support.irradiance import EVERY_LIGHT, check, disk_irradiance, floor_scene, irradiance, pixel_mean
from support.small_scenes import image_of

import wrt
from wrt.backend.device import Device
from wrt.kernels.lights.area_lights import DISK
from wrt.kernels.lights.shapes import BUILT_IN, LIGHT_SHAPES
from wrt.scene.lights import LIGHTS
from wrt.upload.scene_data import build_scene

pytestmark = pytest.mark.slow

(CODE,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs" / "own-light.md").read_text("utf-8"), re.M | re.S)

INNER, OUTER, HEIGHT = 0.4, 0.7, 1.0


@functools.cache
def example() -> ModuleType:
    """Return the page's program as a module, from a file since Warp reads it; it registers its light."""
    path = Path(tempfile.mkdtemp()) / "ring.py"
    path.write_text(CODE, "utf-8")
    spec = importlib.util.spec_from_file_location("ring", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", autouse=True)
def _forget() -> Iterator[None]:
    """Leave the registers as they were found, for tests of other files that look at every light."""
    LIGHTS.setdefault("ring", example().RingLight)
    yield
    LIGHTS.pop("ring", None)


one_kernel = rendering_with(replace(EVERY_LIGHT, light_shapes=(*BUILT_IN, "ring")))


def ring() -> wrt.Light:
    return example().RingLight((0.0, HEIGHT, 0.0), (0.0, -1.0, 0.0), INNER, OUTER, radiance=1.0)


def test_the_program_runs_and_its_light_is_reflected(tmp_path: Path) -> None:
    (tmp_path / "ring.py").write_text(CODE, "utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "ring.py"], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    image = wrt.load_image(tmp_path / "ring.png")
    # By the law of reflection the ball shows the ring around its middle, which shows the hole.
    green = image[256, 256:330, 1]
    assert green[:15].max() < 0.15
    assert green[25:33].min() > 0.3
    assert green[40:].max() < 0.15


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_estimators_agree_with_the_closed_form(strategy: str, device: str, report: Report) -> None:
    """The irradiance of a ring: a disk minus the disk of its hole."""
    scene = floor_scene(eye=0.9)
    scene.add_light(ring())
    spp = 2048 if strategy == "bsdf" else 512
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)

    def exact(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return disk_irradiance(x, z, HEIGHT, OUTER) - disk_irradiance(x, z, HEIGHT, INNER)

    check(f"ring, {strategy}", measured, variance, pixel_mean(exact, where), spp, report)


def test_it_is_a_light_like_any_other(tmp_path: Path, device: str) -> None:
    """In scene files and beside all other kinds, through the tree as by power."""
    (tmp_path / "scene.toml").write_text(
        '[camera]\norigin = [0, 0.5, 3]\n[[lights]]\ntype = "ring"\ncenter = [0, 2, 0]\nnormal = [0, -1, 0]\n'
        '[[lights]]\ntype = "sphere"\ncenter = [2, 2, 0]\nradiance = 1\n'
        '[[lights]]\ntype = "point"\nposition = [0, 3, 2]\nintensity = 1.0\n'
        '[[lights]]\ntype = "directional"\ndirection = [0, -1, 0.1]\nangle_degrees = 9\n'
        '[[shapes]]\ntype = "quad"\norigin = [-4, -0.5, 4]\nedge_u = [8, 0, 0]\nedge_v = [0, 0, -8]\n'
    )
    scene = wrt.load(tmp_path / "scene.toml")
    assert scene.lights[0] == example().RingLight((0.0, 2.0, 0.0), (0.0, -1.0, 0.0))
    assert build_scene(scene, Device("cpu")).features.light_shapes == (*BUILT_IN, "ring")
    means = []
    for choice in ("power", "tree"):
        options = {"device": device, "light_choice": choice, "sampler": "independent", "max_depth": 2}
        means.append(image_of(wrt.Renderer(scene, width=16, height=12, **options), 512).mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)
    with pytest.raises(wrt.InputError, match=r"outer must be greater than 0\.6"):
        example().RingLight((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.6)


def test_what_cannot_be_registered_is_refused() -> None:
    before, families = dict(LIGHTS), dict(LIGHT_SHAPES.families)
    half = "half: a light that rays can meet needs both"
    for name, model, message in (
        ("disk", DISK, "type_name 'disk' is empty or taken"),
        ("half", DISK._replace(shines_back=None), half),
        ("half", DISK._replace(pdf=None), "half: a light needs a `pdf` if it has"),
    ):
        cls = type("Mine", (wrt.Light,), {"type_name": name} if name else {})
        with pytest.raises(wrt.InputError) as caught:
            wrt.register_light(cls, model)
        assert str(caught.value).startswith(f"Mine: {message}")
    assert (before, families) == (LIGHTS, LIGHT_SHAPES.families)
    with pytest.raises(wrt.InputError, match=r"a light must be one of .*, not Mine"):
        floor_scene().add_light(cls())
