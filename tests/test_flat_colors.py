"""Files of the Khronos group show the colours that glTF specifies, to 2 of 255 steps, where they are flat."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from numpy.typing import NDArray
from PIL import Image
from support.gltf_rays import Reference, Window, joined, linear_to_srgb, split

import wrt
from wrt.io.load_mesh import load_file

MESHES = ROOT.parent / "shared" / "assets" / "meshes"
needs_assets = pytest.mark.skipif(not MESHES.is_dir(), reason="the test assets are not beside this checkout")

CORNERS = [(0.0, 0.0), (-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]
STEPS = 2.0

# What is looked at: the duck, larger than its own camera shows it; and of each of five boards a column, whose alpha
# goes from 0 at the top to 1 at the bottom.
DUCK: Window = (54, 40, (4, 1, 50, 38))
BOARDS: dict[str, Window] = {
    name: (1024, 768, (x, 282, x + 12, 486))
    for name, x in {"OPAQUE": 180, "BLEND": 344, "MASK 0.25": 514, "MASK": 690, "MASK 0.75": 876}.items()
}


def prepared(folder: Path, name: str, *, unlit: bool, fov: float | None = None) -> Path:
    """Return a copy of a file without lighting (KHR_materials_unlit), or of another field of view, radians."""
    tree, binary = split(MESHES / name)
    for material in tree["materials"] if unlit else ():
        material.setdefault("extensions", {})["KHR_materials_unlit"] = {}
    if fov is not None:
        tree["cameras"][0]["perspective"]["yfov"] = fov
    path = folder / name
    path.write_bytes(joined(tree, binary))
    return path


def codes_of(scene: wrt.Scene, window: Window, path: Path, **options: Any) -> tuple[NDArray[Any], wrt.Renderer]:
    """Render a window; return the numbers in the PNG file, and the renderer."""
    width, height, crop = window
    spp = options.pop("spp")
    renderer = wrt.Renderer(scene, width=width, height=height, crop=crop, filter="box", **options)
    for _ in renderer.passes(spp=spp):
        pass
    wrt.save_image(path, renderer.image())
    return np.asarray(Image.open(path).convert("RGB"), np.float64), renderer


def flat_colors(reference: Reference, window: Window) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return (H, W, 3) codes that glTF specifies, and where they hold for all of a pixel and its neighbours."""
    pictures = [reference.picture(window, shift) for shift in CORNERS]
    codes = np.stack([255.0 * linear_to_srgb(color) for color, _ in pictures])
    flat = np.ptp(codes, axis=0).max(axis=-1) <= 1.0
    flat &= np.all([covered for _, covered in pictures], axis=0)
    around = np.pad(codes[0], ((1, 1), (1, 1), (0, 0)), mode="edge")
    h, w = flat.shape
    near = np.stack([around[y : y + h, x : x + w] for y in range(3) for x in range(3)])
    return codes.mean(axis=0), flat & (np.ptp(near, axis=0).max(axis=-1) <= 3.0)


def steps(found: NDArray[Any], expected: NDArray[Any], flat: NDArray[Any]) -> NDArray[Any]:
    return np.abs(found - expected).max(axis=-1)[flat]


@pytest.mark.slow
@needs_assets
def test_a_duck_without_light_is_its_texture(tmp_path: Path, report: Report) -> None:
    path = prepared(tmp_path, "Duck.glb", unlit=True, fov=0.26)
    expected, flat = flat_colors(Reference(path), DUCK)
    scene = load_file(path)
    # Without levels, which reach beyond the seams of the coordinates and mix in what lies there.
    shape = scene.shapes[0]
    texture = dataclasses.replace(shape.material.radiance, filter="bilinear")
    scene.shapes = [wrt.Shape(shape.mesh, wrt.Emissive(texture))]
    found, _ = codes_of(scene, DUCK, tmp_path / "duck.png", spp=8)
    off = steps(found, expected, flat)
    report("flat pixels; largest difference in steps of 255", f"{flat.sum()}; {off.max():g}", f"<= {STEPS:g}")
    assert flat.sum() > 300
    assert off.max() <= STEPS
    # Wrong partners: the texture mirrored, and sRGB taken for linear.
    for pixels in (texture.pixels[:, ::-1], linear_to_srgb(np.float64(texture.pixels)).astype(np.float32)):
        material = wrt.Emissive(dataclasses.replace(texture, pixels=pixels))
        wrong = wrt.Scene([wrt.Shape(shape.mesh, material)], camera=scene.camera)
        found, _ = codes_of(wrong, DUCK, tmp_path / "wrong.png", spp=2)
        assert (steps(found, expected, flat) > STEPS).mean() > 0.9


@needs_assets
def test_a_matt_duck_under_a_white_sky_is_its_texture_where_it_sees_only_sky(tmp_path: Path, report: Report) -> None:
    """The radiance of a diffuse surface under a sky of radiance 1 is its albedo, the mean of what it samples exactly.

    Where anything else of the duck is in the way, samples differ, by which such points are known.
    """
    path = prepared(tmp_path, "Duck.glb", unlit=False, fov=0.26)
    expected, flat = flat_colors(Reference(path), DUCK)
    scene = load_file(path)
    (shape,) = scene.shapes
    scene.shapes = [
        wrt.Shape(shape.mesh, wrt.Diffuse(dataclasses.replace(shape.material.base_color, filter="bilinear")))
    ]
    scene.environment = wrt.ConstantEnvironment(1.0)
    found, renderer = codes_of(scene, DUCK, tmp_path / "duck.png", spp=64, max_depth=2)
    flat &= np.sqrt(64.0 * renderer.variance()).max(axis=-1) < 0.01
    off = steps(found, expected, flat)
    report("flat pixels; largest difference in steps of 255", f"{flat.sum()}; {off.max():g}", f"<= {STEPS:g}")
    assert flat.sum() > 100
    assert off.max() <= STEPS


@pytest.mark.slow
@needs_assets
def test_alpha_modes_cover_as_the_specification_says(tmp_path: Path, report: Report) -> None:
    path = prepared(tmp_path, "AlphaBlendModeTest.glb", unlit=True)
    reference, scene = Reference(path), load_file(path)
    for name, window in BOARDS.items():
        expected, flat = flat_colors(reference, window)
        found, _ = codes_of(scene, window, tmp_path / "board.png", spp=256)
        off = steps(found, expected, flat)
        report(f"{name}: flat pixels; largest difference in steps", f"{flat.sum()}; {off.max():g}", f"<= {STEPS:g}")
        assert flat.sum() > 50
        assert off.max() <= STEPS
        # Wrong partners: masks cut off elsewhere, and nothing but masks blended or opaque.
        wrong = Reference(path)
        for seen in wrong.seen:
            seen.blend = not seen.blend and seen.cutoff is None
            seen.cutoff = None if seen.cutoff is None else seen.cutoff + 0.1
        off = steps(found, 255.0 * linear_to_srgb(wrong.picture(window)[0]), flat)
        assert (off > STEPS).mean() > 0.05
