"""What no ray could meet is refused before it reaches the device; what a renderer saves says how it was made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wrt

CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (CORNERS * 1e30, "its vertices reach to 1e"),
        (CORNERS * 1e-20, "the scene is 1"),
        (CORNERS * 0.0 + 1.0, "all vertices of the scene are in one place"),
    ],
)
def test_scenes_too_large_or_too_small_for_rays_are_refused(vertices: np.ndarray, message: str) -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment())
    scene.add(wrt.Mesh(vertices, FACE), name="part")
    with pytest.raises(wrt.InputError, match=message):
        wrt.Renderer(scene, width=4, height=4)


def test_a_speck_in_a_room_is_no_mistake() -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment())
    scene.add(wrt.Mesh(CORNERS * 1e-20, FACE))
    scene.add(wrt.box())
    assert np.isfinite(wrt.render(scene, width=4, height=4, spp=1)).all()


def test_arrays_that_are_no_numbers_are_refused_in_one_line() -> None:
    with pytest.raises(wrt.InputError, match=r"mesh: vertices must be an array of numbers"):
        wrt.Mesh(CORNERS.astype(complex), FACE)
    with pytest.raises(wrt.InputError, match=r"texture image: pixels must be an array of numbers"):
        wrt.ImageTexture([["a"]])  # type: ignore[arg-type]


def test_a_saved_picture_says_how_it_was_made(tmp_path: Path) -> None:
    import OpenEXR
    from PIL import Image

    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=6, seed=7, layers=("albedo", "depth"))
    for _ in renderer.passes(spp=3):
        pass
    renderer.save(tmp_path / "a.exr")
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    assert {"R", "G", "B", "albedo.R", "depth.Z"} <= set(file.channels())
    header = file.header()
    assert (header["Samples per pixel"], header["Seed"], header["Software"]) == ("3", "7", f"wrt {wrt.__version__}")
    assert float(header["Render seconds"]) >= 0.0
    with pytest.raises(wrt.InputError, match="layers go into OpenEXR files"):
        renderer.save(tmp_path / "a.png")
    plain = wrt.Renderer(wrt.load("cornell-box"), width=8, height=6, seed=7)
    for _ in plain.passes(spp=2):
        pass
    plain.save(tmp_path / "b.png")
    with Image.open(tmp_path / "b.png") as picture:
        assert picture.info["Samples per pixel"] == "2"
