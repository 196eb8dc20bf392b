"""Cryptomatte holds how much of each pixel every object covers, in the form that other programs read.

The ids are those of Psyop's specification, version 1.2.0; the decoder here shares no code with wrt.
"""

import json
import re
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import trimesh
from numpy.typing import NDArray
from support.covering_kernels import covering, rendering_with
from trimesh.visual.material import PBRMaterial, SimpleMaterial

import wrt
from wrt.cli import main
from wrt.scene.cryptomatte import id_of
from wrt.scene.layers import layer_names

LAYERS = ("alpha", "crypto_object", "crypto_material")
RED, GREEN, BLUE = "red “é”", 'green "\\', ""

kernels_of_the_file = rendering_with(covering("diffuse", aovs=True, composite="holes", instances="moving"))


def panes() -> wrt.Scene:
    """Panes out of focus that emit one channel each: red has holes, green moves, blue are two of one name."""
    view = {"fov_degrees": 40.0, "aperture_radius": 0.2, "focus_distance": 6.0, "shutter_close": 1.0}
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), **view))
    move = wrt.Motion.translation((0.4, 0.1, 0.0))
    holes, paint = wrt.Diffuse(0.5, opacity=0.4, name="paint"), wrt.Diffuse(0.5, name="paint")
    for name, material, color, corner, transform in (
        (RED, holes, (1.0, 0.0, 0.0), (-0.6, -0.5, 0.3), None),
        (GREEN, paint, (0.0, 1.0, 0.0), (-1.0, -1.0, 0.0), move),
        (BLUE, wrt.Diffuse(0.5), (0.0, 0.0, 1.0), (-0.2, -0.2, -1.0), None),
        (BLUE, wrt.Diffuse(0.1), (0.0, 0.0, 1.0), (-1.5, 0.0, -0.5), None),
    ):
        pane = wrt.quad(corner, (1.2, 0.0, 0.3), (0.2, 1.0, 0.0))
        shine = {"emission": color, "two_sided_emission": True}
        scene.add(pane, material=material, name=name, transform=transform, **shine)
    return scene


def renderer_of(scene: wrt.Scene, **options) -> wrt.Renderer:
    defaults = {"layers": LAYERS, "width": 32, "height": 24, "sampler": "independent", "max_depth": 1}
    return wrt.Renderer(scene, **{**defaults, **options})


def decode(path: Path) -> dict[str, tuple[dict[str, str], dict[float, NDArray]]]:
    """Return the manifest and the masks by id of each cryptomatte in an OpenEXR file, by its name."""
    file = OpenEXR.File(str(path), separate_channels=True)
    header, result = file.header(), {}
    for found in filter(None, (re.fullmatch(r"(cryptomatte/.{1,7}/)name", attribute) for attribute in header)):
        name = header[found[0]]
        assert header[f"{found[1]}hash"] == "MurmurHash3_32"
        assert header[f"{found[1]}conversion"] == "uint32_to_float32"
        # Programs call the channels R or red.
        pattern = re.compile(re.escape(name) + r"(\d\d)\.([rgba])(?:ed|reen|lue|lpha)?", re.IGNORECASE)
        matches = filter(None, map(pattern.fullmatch, file.channels()))
        order = sorted(matches, key=lambda match: (match[1], "rgba".index(match[2].lower())))
        planes = [file.channels()[match[0]].pixels for match in order]
        assert [plane.dtype for plane in planes] == [np.float32] * 12
        masks: dict[float, NDArray] = {}
        for ids, coverage in zip(planes[::2], planes[1::2], strict=True):
            for each in np.unique(ids[coverage > 0.0]):
                masks[float(each)] = masks.get(float(each), 0.0) + np.where(ids == each, coverage, 0.0)
        result[name] = json.loads(header.get(f"{found[1]}manifest", "{}")), masks
    return result


def test_ids_are_those_of_the_specification():
    for name, bits in (
        *(("torus", 4053562365), ("равнина", 2518896926)),
        *(("bunny", 0x13851A76), ("default", 0x42C9679F), ("bunny_porcelain_mat", 0xB24B26D4)),
    ):
        assert id_of(name) == bits
    assert id_of("") == 1 << 23
    values = np.array([id_of(str(number)) for number in range(20_000)], np.uint32).view(np.float32)
    assert np.isfinite(values).all()
    assert np.abs(values).min() >= np.finfo(np.float32).tiny
    assert layer_names("cryptomatte,alpha") == LAYERS


def test_coverage_is_the_share_of_samples_that_show_an_object(device):
    """Emission alone counts the samples of each channel, and so of each pane, in the same paths."""
    renderer = renderer_of(panes(), device=device)
    for spp in (1, 7, 16):
        image, layers = renderer.render(spp=spp), renderer.layers()
        objects, materials = layers["crypto_object"], layers["crypto_material"]
        assert objects.shape == (24, 32, 6, 2)
        masks = [wrt.cryptomatte_mask(objects, name) for name in (RED, GREEN, BLUE)]
        np.testing.assert_array_equal(np.dstack(masks), image)
        assert all(mask.max() > 0.5 for mask in masks[1:])
        np.testing.assert_allclose(wrt.cryptomatte_mask(objects, RED, GREEN, BLUE), layers["alpha"], rtol=1e-6)
        paint, *blues = (wrt.cryptomatte_mask(materials, name) for name in ("paint", "diffuse 3", "diffuse 4"))
        np.testing.assert_allclose(paint, image[..., 0] + image[..., 1], rtol=1e-6)
        np.testing.assert_allclose(sum(blues), image[..., 2], rtol=1e-6)
        assert min(blue.max() for blue in blues) > 0.0
        assert (np.diff(objects[..., 1], axis=2) <= 0.0).all()
        np.testing.assert_array_equal(objects[..., 0] == 0.0, objects[..., 1] == 0.0)
    assert (np.count_nonzero(objects[..., 1], axis=2) == 3).any()
    again = renderer_of(panes(), device=device, crop=(5, 3, 30, 20), threads=2)
    again.render(spp=16)
    for name, values in again.layers().items():
        np.testing.assert_array_equal(values, layers[name][3:20, 5:30])
    with pytest.raises(wrt.InputError, match=r"must be \(H, W, ranks, 2\) float32, not \(24, 32\) float32"):
        wrt.cryptomatte_mask(layers["alpha"], RED)


def test_a_large_object_is_found_behind_many_small_ones(device):
    """It covers a fifth of pixels that show 40 others; at most eight are counted."""
    camera = wrt.OrthographicCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), view_height=1.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera)
    for number in range(41):
        low, size = 0.02 * number - 0.5, 0.2 if number == 40 else 0.02
        stripe = wrt.quad((-99.0, low, 0.0), (198.0, 0.0, 0.0), (0.0, size, 0.0))
        scene.add(stripe, name=str(number), transform=wrt.Motion.translation((0.1, 0.0, 0.0)))
    options = {"integrator": "aov", "width": 128, "height": 1, "filter": "box", "device": device}
    renderer = renderer_of(scene, **options)
    renderer.render(spp=64)
    objects = renderer.layers()["crypto_object"]
    found = wrt.cryptomatte_mask(objects, "40")
    assert (found > 0.0).mean() > 0.95
    assert abs(found.mean() - 0.2) < 0.02
    assert (objects[..., 1].sum(axis=2) < 1.0).all()
    np.testing.assert_array_equal(renderer.layers()["alpha"], 1.0)


def test_other_programs_can_read_the_files_of_a_render(tmp_path, capsys):
    scene = panes()
    wrt.save_scene(tmp_path / "a.toml", scene)
    command = ["render", str(tmp_path / "a.toml"), "--layers", "cryptomatte", "--size", "32x24", "--spp", "4"]
    command += ["--sampler", "independent", "--max-depth", "1", "-o"]
    assert main([*command, str(tmp_path / "a.exr")]) == 0
    renderer = renderer_of(scene)
    image = renderer.render(spp=4)
    found = decode(tmp_path / "a.exr")
    assert set(found) == {"CryptoObject", "CryptoMaterial"}
    manifest, masks = found["CryptoObject"]
    assert set(manifest) == {RED, GREEN, BLUE}
    by_name = {name: struct.unpack(">f", bytes.fromhex(digits))[0] for name, digits in manifest.items()}
    assert set(by_name.values()) == set(masks)
    for channel, name in enumerate((RED, GREEN, BLUE)):
        np.testing.assert_array_equal(masks[by_name[name]], image[..., channel])
    manifest, masks = found["CryptoMaterial"]
    assert next(iter(manifest)) == "paint"
    assert {struct.unpack(">f", bytes.fromhex(digits))[0] for digits in manifest.values()} == set(masks)
    # Without the renderer there are no names, but ids.
    wrt.save_image(tmp_path / "b.exr", image, layers=renderer.layers())
    assert decode(tmp_path / "b.exr")["CryptoObject"][1].keys() == set(by_name.values())


MTL = "newmtl Gold\nKd 1 0.8 0.2\n"
OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl Gold\nf 1 2 3\n"
XML = """<scene version="3.0.0"><bsdf type="diffuse" id="Gold"/>
<shape type="rectangle"><ref id="Gold"/></shape></scene>"""
TOML = '[materials.Gold]\ntype = "diffuse"\n[[shapes]]\ntype = "box"\nmaterial = "Gold"\n'


def test_materials_keep_the_names_of_their_files(tmp_path):
    (tmp_path / "a.mtl").write_text(MTL)
    for name, text in (("a.obj", OBJ), ("a.xml", XML), ("a.toml", TOML)):
        (tmp_path / name).write_text(text)
    scene = wrt.Scene()
    for material in (PBRMaterial(name="Gold"), SimpleMaterial(name="Gold", diffuse=(9, 9, 9, 255))):
        box = trimesh.creation.box()
        box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
        assert scene.add(box).material.name == "Gold"
        if isinstance(material, PBRMaterial):
            box.export(tmp_path / "a.glb")
    for path in sorted(tmp_path.glob("a.*")):
        if path.suffix == ".mtl":
            continue
        loaded = wrt.load(path)
        assert "Gold" in [shape.material.name for shape in loaded.shapes], path
        wrt.save_scene(tmp_path / f"copy{path.suffix}.toml", loaded)
        copy = wrt.load(tmp_path / f"copy{path.suffix}.toml")
        assert "Gold" in [shape.material.name for shape in copy.shapes], path
    assert scene.add(wrt.box(), material="Gold").material.name == "Gold"
    assert wrt.Diffuse(0.5, name="a") == wrt.Diffuse(0.5, name="b")
    with pytest.raises(wrt.InputError, match="name must be text, not 5"):
        wrt.Diffuse(0.5, name=5)
