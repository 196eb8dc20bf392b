"""Pictures of files are compared with those of other viewers where both show the same (scripts/viewer_pairs.py)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import viewer_pairs
from PIL import Image

import wrt


def test_lightness_and_chroma_are_those_of_cielab() -> None:
    # sRGB red, green and blue in CIELAB under D65, as printed by every colour calculator.
    codes = np.array([[255, 255, 255], [0, 0, 0], [119, 119, 119], [255, 0, 0], [0, 0, 255]], np.uint8)
    expected = [[100, 0, 0], [0, 0, 0], [50.03, 0, 0], [53.24, 80.09, 67.20], [32.30, 79.19, -107.86]]
    assert viewer_pairs.cielab(codes) == pytest.approx(np.array(expected), abs=0.1)


@pytest.mark.parametrize(
    ("theta", "phi", "origin"), [(0.0, 90.0, (1, 2, 7)), (90.0, 90.0, (5, 2, 3)), (-90.0, 30.0, (-1, 2 + 12**0.5, 3))]
)
def test_an_orbit_is_a_camera_around_its_target(theta: float, phi: float, origin: tuple[float, ...]) -> None:
    camera = viewer_pairs.Orbit(theta, phi, 4.0, (1.0, 2.0, 3.0), 45.0).camera(0.5)
    assert camera.origin == pytest.approx(0.5 * np.array(origin))
    assert camera.target == pytest.approx((0.5, 1.0, 1.5))
    assert camera.fov_degrees == 45.0


@pytest.mark.slow
def test_the_same_camera_sees_the_same_pixels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # A white card to the left of a black one, 4 cm wide together, so that the studio makes them larger.
    scene = wrt.Scene()
    for k, colour in enumerate((0.9, 0.01)):
        card = wrt.quad((0.02 * k - 0.02, 0.0, 0.0), (0.02, 0.0, 0.0), (0.0, 0.02, 0.0))
        scene.add(card, material=wrt.Principled(base_color=colour, roughness=1.0, specular=0.0))
    wrt.save_scene(tmp_path / "cards.glb", scene)
    # The other viewer's picture: the left half of the frame white, the right one black, where the cards are.
    other = np.zeros((32, 64, 4), np.uint8)
    other[8:24, 16:48, 3] = 255
    other[8:24, 16:32, :3] = 255
    (tmp_path / "goldens" / "cards").mkdir(parents=True)
    Image.fromarray(other).save(tmp_path / "goldens" / "cards" / "mine-golden.png")
    scenario = {
        "name": "cards",
        "model": "somewhere/cards.gltf",
        "orbit": {"theta": 0, "phi": 90, "radius": 0.02},
        "target": {"x": 0, "y": 0.01, "z": 0},
        "verticalFoV": 90,
        "dimensions": {"width": 64, "height": 32},
    }
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"scenarios": [scenario]}))
    (subject,) = viewer_pairs.subjects_of_scenarios(config, tmp_path / "goldens", tmp_path, "")
    # At a distance of 2 cm the picture is 4 cm high and 8 cm wide: the cards cover its middle, 16 by 32 pixels.
    renderer = viewer_pairs.rendered(viewer_pairs.loaded(subject, transparent=True), 64, 32, 16)
    alpha = renderer.alpha()
    assert alpha is not None
    assert alpha[9:23, 17:47].min() > 0.99
    assert alpha[:7].max() < 0.01
    image = renderer.image()
    assert image[10:22, 18:31].min() > 10.0 * image[10:22, 33:46].max()

    out = tmp_path / "out.png"
    folders = ["--goldens", str(tmp_path / "goldens"), "--models", str(tmp_path)]
    assert viewer_pairs.main([str(out), "--scenarios", str(config), *folders, "--size", "32", "--spp", "4"]) == 0
    assert "| `cards` | 1 |" in capsys.readouterr().out
    with Image.open(out) as picture:
        assert picture.size == (128, 32 + viewer_pairs.LINE)
