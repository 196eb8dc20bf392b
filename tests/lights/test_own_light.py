"""docs/own/ring.py: it runs, its model is right, and its light works like a built-in one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Report
from support.covering_kernels import render_with
from support.irradiance import EVERY_LIGHT, check, disk_irradiance, floor_scene, irradiance, pixel_mean
from support.pages import definitions, run_program
from support.small_scenes import image_of

import wrt
from wrt.backend.device import Device
from wrt.kernels.lights.area_lights import DISK
from wrt.kernels.lights.shapes import BUILT_IN, LIGHT_SHAPES, current_name
from wrt.scene.lights import LIGHTS
from wrt.upload.scene_data import SceneUpload

pytestmark = pytest.mark.slow

CODE = (ROOT / "docs/own/ring.py").read_text("utf-8")


@pytest.fixture(scope="module", autouse=True)
def ring(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Register the page's light, and leave the register as it was found."""
    yield definitions(CODE, tmp_path_factory.mktemp("own") / "ring.py")["RingLight"]
    del LIGHTS["ring"]
    LIGHT_SHAPES.forget("ring")


@pytest.fixture(autouse=True)
def one_kernel(ring: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([replace(EVERY_LIGHT, light_shapes=(*BUILT_IN, current_name("ring")))], monkeypatch)


def test_the_program_runs_and_its_light_is_reflected(tmp_path: Path) -> None:
    run_program(CODE, tmp_path / "ring.py")
    image = wrt.load_image(tmp_path / "ring.png")
    # By the law of reflection the ball shows the ring around its middle, which shows the hole.
    green = image[256, 256:330, 1]
    assert green[:15].max() < 0.15
    assert green[25:33].min() > 0.3
    assert green[40:].max() < 0.15


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_estimators_agree_with_the_closed_form(ring: Any, strategy: str, device: str, report: Report) -> None:
    """The irradiance of a ring: a disk minus the disk of its hole."""
    scene = floor_scene(eye=0.9)
    scene.add_light(ring((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0.4, 0.7, radiance=1.0))
    spp = 2048 if strategy == "bsdf" else 512
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    expected = pixel_mean(lambda x, z: disk_irradiance(x, z, 1.0, 0.7) - disk_irradiance(x, z, 1.0, 0.4), where)
    check(f"ring, {strategy}", measured, variance, expected, spp, report)


def test_it_is_a_light_like_any_other(ring: Any, tmp_path: Path, device: str) -> None:
    """In scene files and beside all other kinds, through the tree as by power."""
    (tmp_path / "scene.toml").write_text(
        '[camera]\norigin = [0, 0.5, 3]\n[[lights]]\ntype = "ring"\ncenter = [0, 2, 0]\nnormal = [0, -1, 0]\n'
        '[[lights]]\ntype = "sphere"\ncenter = [2, 2, 0]\nradiance = 1\n'
        '[[lights]]\ntype = "point"\nposition = [0, 3, 2]\nintensity = 1.0\n'
        '[[lights]]\ntype = "directional"\ndirection = [0, -1, 0.1]\nangle_degrees = 9\n'
        '[[shapes]]\ntype = "quad"\norigin = [-4, -0.5, 4]\nedge_u = [8, 0, 0]\nedge_v = [0, 0, -8]\n'
    )
    scene = wrt.load(tmp_path / "scene.toml")
    assert scene.lights[0] == ring((0.0, 2.0, 0.0), (0.0, -1.0, 0.0))
    assert SceneUpload(scene, Device("cpu")).features.light_shapes == (*BUILT_IN, current_name("ring"))
    means = []
    for choice in ("power", "tree"):
        options = {"device": device, "light_choice": choice, "sampler": "independent", "max_depth": 2}
        means.append(image_of(wrt.Renderer(scene, width=16, height=12, **options), 512).mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)
    with pytest.raises(wrt.InputError, match=r"outer must be greater than 0\.6"):
        ring((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.6)


def test_what_cannot_be_registered_is_refused() -> None:
    before, families = dict(LIGHTS), dict(LIGHT_SHAPES.families)
    for name, model, message in (
        ("disk", DISK, "type_name 'disk' is empty or taken"),
        ("half", DISK._replace(shines_back=None), "half: a light that rays can meet needs both"),
        ("half", DISK._replace(pdf=None), "half: a light needs a `pdf` if it has"),
    ):
        cls = type("Mine", (wrt.Light,), {"type_name": name})
        with pytest.raises(wrt.InputError) as caught:
            wrt.register_light(cls, model)
        assert str(caught.value).startswith(f"Mine: {message}")
    assert (before, families) == (LIGHTS, LIGHT_SHAPES.families)
    with pytest.raises(wrt.InputError, match=r"a light must be one of .*, not Mine"):
        floor_scene().add_light(cls())
