"""Materials of OBJ files: what each statement of an MTL file becomes."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from support.meshes import write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

CODES = np.random.default_rng(8).integers(0, 256, (4, 4, 4), dtype=np.uint8)
OBJ = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def material_of(folder: Path, text: str, obj: str = OBJ) -> wrt.Material:
    Image.fromarray(CODES).save(folder / "with alpha.png")
    Image.fromarray(CODES[:, :, :3]).save(folder / "rgb.png")
    write(folder, "m.mtl", "newmtl m\n" + text)
    (shape,) = load_shapes(write(folder, "mesh.obj", obj))
    return shape.material


def test_without_gloss_it_is_matt(tmp_path):
    for text in ("Kd 0.5 0.25 0.1", "Kd 0.5 0.25 0.1\nKs 1 1 1\nillum 1", "Kd 0.5 0.25 0.1\nKs 0 0 0\nNs 100\nillum 2"):
        assert material_of(tmp_path, text) == wrt.Diffuse((0.5, 0.25, 0.1))


def test_gloss_is_that_of_a_dielectric(tmp_path):
    material = material_of(tmp_path, "Kd 0.5 0.25 0.1\nKs 0.5 0.25 1\nNs 250\nNi 1.45\nillum 2")
    assert isinstance(material, wrt.Principled)
    assert (material.base_color, material.metallic, material.ior) == ((0.5, 0.25, 0.1), 0.0, 1.45)
    assert material.specular_color == (1.0, 0.5, 2.0)
    assert material.roughness == pytest.approx(0.5)
    mirror = material_of(tmp_path, "Kd 0 0 0\nKs 0.9 0.8 0.7\nNs 1000\nillum 3")
    # Straight on it reflects Ks.
    np.testing.assert_allclose(0.04 * np.array(mirror.specular_color), (0.9, 0.8, 0.7), rtol=1e-6)
    assert mirror.roughness == 0.0


@pytest.mark.parametrize(
    ("text", "opacity"),
    [
        ("d 0.3", 0.3),
        ("Tr 0.3", 0.7),
        ("d 0.3\nTr 0.3", 0.3),  # d is the one that all agree on
        ("Tr 1", 1.0),
        ("Tr 0", 1.0),
        ("d -halo 0.6", 0.6),
        ("d none", 1.0),
    ],
)
def test_dissolve_and_transparency(tmp_path, text, opacity):
    assert material_of(tmp_path, f"Kd 1 1 1\n{text}").opacity == pytest.approx(opacity)


def test_what_is_invisible_is_named(tmp_path):
    write(tmp_path, "m.mtl", "newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 1 0\nnewmtl o\nKd 1 0 0\nd 0\n")
    path = write(tmp_path, "mesh.obj", OBJ + "usemtl n\nf 3/3 2/2 1/1\nusemtl o\nf 2/2 3/3 1/1\n")
    words = "'m' and 1 more are invisible: their opacity is 0"
    with pytest.warns(InputWarning, match=rf"mesh\.obj: {words}"):
        shapes = load_shapes(path)
    assert [shape.material.opacity for shape in shapes] == [0.0, 1.0, 0.0]


def test_a_file_that_would_be_invisible_is_opaque(tmp_path):
    """Some exporters write a transparency, 0, for d."""
    write(tmp_path, "m.mtl", "newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 1 0\nKs 1 1 1\nillum 2\nd 0\n")
    path = write(tmp_path, "mesh.obj", OBJ + "usemtl n\nf 3/3 2/2 1/1\nusemtl m\nf 2/2 3/3 1/1\n")
    words = "all of it would be invisible, as the opacity of its materials is 0; it is shown opaque"
    with pytest.warns(InputWarning, match=rf"mesh\.obj: {words}"):
        shapes = load_shapes(path)
    assert [shape.material.opacity for shape in shapes] == [1.0] * len(shapes)
    assert {shape.material.type_name for shape in shapes} == {"diffuse", "principled"}
    assert len({id(shape.material) for shape in shapes}) == 2


def test_glass(tmp_path):
    material = material_of(tmp_path, "Kd 0.2 0.2 0.2\nTf 0.9 0.95 1\nd 0.1\nNi 1.5\nNs 1000\nillum 7")
    assert (material.transmission, material.opacity, material.ior) == (pytest.approx(0.9), 1.0, 1.5)
    assert (material.base_color, material.roughness) == ((0.9, 0.95, 1.0), 0.0)
    assert not material.thin_walled


def test_physically_based_statements(tmp_path):
    material = material_of(
        tmp_path, "Kd 1 0.5 0.2\nPr 0.4\nPm 1\nPc 0.5\nPcr 0.1\nPs 0.2\naniso 0.6\nKe 1 2 3\nmap_Pr rgb.png"
    )
    assert (material.metallic, material.coat, material.coat_roughness) == (1.0, 0.5, 0.1)
    assert (material.sheen_color, material.anisotropy, material.emission) == ((0.2,) * 3, 0.6, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(material.roughness.pixels, CODES[:, :, :3] / 255.0, atol=1e-6)
    assert material.roughness.channel == "r"


def test_maps(tmp_path):
    text = "Kd 0.5 1 1\nKs 1 1 1\nillum 2\nd 0\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on with alpha.png\nmap_Ks rgb.png\n"
    text += "map_d with alpha.png\nnorm rgb.png\n"
    material = material_of(tmp_path, text)
    base = material.base_color
    np.testing.assert_allclose(base.pixels, linear_from_srgb(CODES[:, :, :3] / 255.0), atol=1e-6)
    assert (base.factor, base.scale, base.offset, base.wrap) == (
        (0.5, 1.0, 1.0),
        (2.0, 3.0),
        (0.5, 0.25),
        ("clamp",) * 2,
    )
    np.testing.assert_allclose(material.opacity.pixels[:, :, 0], CODES[:, :, 3] / 255.0, atol=1e-6)
    assert material.opacity.factor == (1.0,) * 3
    assert material.specular_color.factor == (2.0,) * 3
    np.testing.assert_allclose(material.normal_map.pixels, CODES[:, :, :3] / 255.0, atol=1e-6)
    mask = material_of(tmp_path, "Kd 1 1 1\nmap_d -imfchan g rgb.png").opacity
    assert mask.channel == "g"


def test_a_bump_map_is_a_relief(tmp_path):
    # A ramp along u: heights grow by 8 / 255 from texel to texel, but where it repeats.
    ramp = np.repeat(np.arange(0, 256, 8, dtype=np.uint8)[None, :], 4, axis=0)
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    pixels = material_of(tmp_path, "Kd 1 1 1\nmap_bump -bm 0.5 ramp.png").normal_map.pixels
    normal = 2.0 * pixels[2, 10].astype(np.float64) - 1.0
    assert -normal[0] / normal[2] == pytest.approx(2.0 * 0.5 * 8 / 255, rel=1e-4)
    assert abs(normal[1]) < 1e-6
    # What is blue holds normals, whatever the statement calls it.
    blue = np.zeros((4, 4, 3), np.uint8) + np.array([128, 128, 250], np.uint8)
    Image.fromarray(blue).save(tmp_path / "normals.png")
    pixels = material_of(tmp_path, "Kd 1 1 1\nbump normals.png").normal_map.pixels
    np.testing.assert_allclose(pixels, blue / 255.0, atol=1e-6)


@pytest.mark.parametrize("name", ["RGB.png", r"Maps\Rgb.PNG", r"C:\work\maps\rgb.png", "/home/else/RGB.png"])
def test_images_are_found_in_any_case_and_beside_the_file(name, tmp_path):
    folder = tmp_path / "maps" if name.startswith("Maps") else tmp_path
    folder.mkdir(exist_ok=True)
    Image.fromarray(CODES[:, :, :3]).save(folder / "rgb.png")
    write(tmp_path, "m.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    with pytest.warns(InputWarning, match=r"is not there; '.*rgb\.png' is taken"):
        (shape,) = load_shapes(write(tmp_path, "mesh.obj", OBJ))
    pixels = shape.material.reflectance.pixels
    np.testing.assert_allclose(pixels, linear_from_srgb(CODES[:, :, :3] / 255.0), atol=1e-6)


def test_images_are_found_beside_their_material_file(tmp_path):
    (tmp_path / "materials/maps").mkdir(parents=True)
    Image.fromarray(CODES[:, :, :3]).save(tmp_path / "materials/maps/rgb.png")
    write(tmp_path / "materials", "m.mtl", "newmtl m\nKd 1 1 1\nmap_Kd maps/rgb.png\n")
    path = write(tmp_path, "mesh.obj", OBJ.replace("m.mtl", "materials/m.mtl"))
    (shape,) = load_shapes(path)
    expected = linear_from_srgb(CODES[:, :, :3] / 255.0)
    np.testing.assert_allclose(shape.material.reflectance.pixels, expected, atol=1e-6)
    (tmp_path / "maps").mkdir()
    Image.fromarray(CODES[::-1, :, :3]).save(tmp_path / "maps/rgb.png")  # first comes what lies beside the mesh
    (shape,) = load_shapes(path)
    np.testing.assert_allclose(shape.material.reflectance.pixels, expected[::-1], atol=1e-6)


@pytest.mark.parametrize("folder", ["meshes/textures", "textures", "materials/textures"])
def test_images_are_found_where_programs_keep_them(tmp_path, folder):
    (tmp_path / "meshes").mkdir()
    (tmp_path / folder).mkdir(parents=True)
    Image.fromarray(CODES[:, :, :3]).save(tmp_path / folder / "RGB.png")
    write(tmp_path / "meshes", "m.mtl", "newmtl m\nKd 1 1 1\nmap_Kd rgb.png\n")
    path = write(tmp_path / "meshes", "mesh.obj", OBJ)
    with pytest.warns(InputWarning, match=r"'rgb\.png', which it refers to, is not there; '.*RGB\.png' is taken"):
        (shape,) = load_shapes(path)
    assert isinstance(shape.material.reflectance, wrt.ImageTexture)
    with pytest.warns(InputWarning, match="no such file" if folder != "meshes/textures" else "is taken"):
        wrt.load(path, confined=True)  # looks into no other folder


@pytest.mark.parametrize("named", ["mtllib a.mtl\nmtllib b.mtl\n", "mtllib a.mtl none.MTL b.mtl\n"])
def test_materials_may_be_in_several_files(tmp_path, named):
    write(tmp_path, "a.mtl", "newmtl one\nKd 0.1 0.2 0.3\n")
    write(tmp_path, "b.mtl", "newmtl two\nKd 0.3 0.2 0.1\n")
    points = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
    path = write(tmp_path, "mesh.obj", f"{named}{points}usemtl one\nf 1 2 3\nusemtl two\nf 2 4 3\n")
    write(tmp_path, "mesh.mtl", "newmtl one\nKd 0.9 0.9 0.9\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        materials = [shape.material for shape in load_shapes(path)]
    assert materials == [wrt.Diffuse((0.1, 0.2, 0.3)), wrt.Diffuse((0.3, 0.2, 0.1))]
    assert [str(each.message).partition(", which")[0][-9:] for each in caught] == ["none.MTL'"] * ("none" in named)


def test_black_beside_an_image_that_is_not_there_is_grey(tmp_path):
    with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file"):
        assert material_of(tmp_path, "Kd 0 0 0\nmap_Kd none.png") == wrt.Diffuse(DEFAULT_REFLECTANCE)


def test_images_that_are_not_there_are_told(tmp_path):
    for text in ("map_Ks none.png\nKs 1 1 1\nillum 2", "map_d none.png", "bump none.png", "map_Pr none.png"):
        with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file"):
            material = material_of(tmp_path, f"Kd 0.5 0.5 0.5\n{text}")
        assert material.opacity == 1.0
    with pytest.warns(InputWarning, match=r"texture m\.mtl left out"):
        material_of(tmp_path, "Kd 0.5 0.5 0.5\nbump m.mtl")


def test_without_coordinates_maps_are_left_out_and_the_color_is_the_mean(tmp_path):
    text = "Kd 0.5 0.5 0.5\nmap_Kd rgb.png\nmap_d rgb.png\nbump rgb.png"
    bare = OBJ.replace("1/1 2/2 3/3", "1 2 3")
    with pytest.warns(InputWarning, match=r"texture rgb\.png cannot be laid"):
        material = material_of(tmp_path, text, bare)
    assert isinstance(material, wrt.Diffuse)
    expected = 0.5 * linear_from_srgb(CODES[:, :, :3] / 255.0).mean(axis=(0, 1))
    np.testing.assert_allclose(material.reflectance, expected, rtol=1e-5)
    assert (material.opacity, material.normal_map) == (1.0, None)


def test_maps_in_floating_point(tmp_path):
    """Linear as they are; only what shines may be brighter than 1, only heights less than 0."""
    values = np.random.default_rng(9).uniform(0.0, 3.0, (4, 4, 4)).astype(np.float32)
    channels = {name: np.ascontiguousarray(values[:, :, k]) for k, name in enumerate("RGBA")}
    OpenEXR.File({}, channels).write(str(tmp_path / "a map.exr"))
    text = "Kd 1 1 1\nmap_Kd -s 2 2 1 a map.exr\nmap_Ke a map.exr\nmap_d a map.exr\nmap_Pr a map.exr"
    material = material_of(tmp_path, text)
    bounded = np.minimum(values, 1.0)
    np.testing.assert_array_equal(material.base_color.pixels, bounded[:, :, :3])
    assert material.base_color.scale == (2.0, 2.0)
    np.testing.assert_array_equal(material.emission.pixels, values[:, :, :3])
    np.testing.assert_array_equal(material.opacity.pixels, np.repeat(bounded[:, :, 3:], 3, axis=2))
    np.testing.assert_array_equal(material.roughness.pixels, bounded[:, :, :3])

    heights = np.tile(np.linspace(-4.0, 4.0, 16, dtype=np.float32), (4, 1))
    OpenEXR.File({}, {"Y": heights}).write(str(tmp_path / "heights.exr"))
    normals = 2.0 * material_of(tmp_path, "Kd 1 1 1\nmap_bump -bm 0.5 heights.exr").normal_map.pixels - 1.0
    np.testing.assert_allclose(-normals[:, 1:-1, 0] / normals[:, 1:-1, 2], 8.0 / 15.0, rtol=1e-4)

    (tmp_path / "light.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes([128, 64, 0, 131, 128, 0, 0, 130])
    )
    emission = material_of(tmp_path, "Kd 1 1 1\nmap_Ke light.hdr").emission
    np.testing.assert_allclose(emission.pixels, [[[4.0, 2.0, 0.0], [2.0, 0.0, 0.0]]], atol=0.05)


def test_maps_that_cannot_be_decoded_are_told_once_and_left_out(tmp_path):
    good = np.ones((64, 64), np.float32)
    for name, pixels in (("whole", good), ("nan", np.where(np.eye(64) > 0, np.nan, good).astype(np.float32))):
        OpenEXR.File({}, dict.fromkeys("RGB", pixels)).write(str(tmp_path / f"{name}.exr"))
    (tmp_path / "cut.exr").write_bytes((tmp_path / "whole.exr").read_bytes()[:400])
    (tmp_path / "bomb.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 60000\n\2\2")
    Image.fromarray(np.zeros((999, 999), np.uint8)).save(tmp_path / "whole.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:60])
    for name, reason in (
        ("cut.exr", ""),
        ("nan.exr", "infinite or NaN values"),
        ("bomb.hdr", "too large|claims"),
        ("cut.png", ""),
        ("none.exr", "no such file"),
    ):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            material = material_of(tmp_path, f"Kd 0.5 0.25 0.1\nmap_Kd {name}\nmap_Ke {name}\nmap_d {name}")
        told = [str(each.message) for each in caught if each.category is InputWarning]
        assert len(told) == 1, (name, told)
        assert name in told[0]
        assert "left out" in told[0]
        assert re.search(reason, told[0]), told
        assert material == wrt.Diffuse((0.5, 0.25, 0.1)) or material.base_color == (0.5, 0.25, 0.1)
        assert material.opacity == 1.0
