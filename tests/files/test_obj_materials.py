"""Materials of OBJ files: what each statement of an MTL file becomes, and where files and images are found."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from support.mesh_files import check_values
from support.meshes import SQUARE, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

CODES = np.random.default_rng(8).integers(0, 256, (4, 4, 4), dtype=np.uint8)
NUMBERS = CODES[:, :, :3] / 255.0
COLORS = linear_from_srgb(NUMBERS)
OBJ = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def save_rgb(path: Path, codes: np.ndarray = CODES[:, :, :3]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(codes).save(path)


def material_of(folder: Path, text: str, obj: str = OBJ) -> wrt.Material:
    save_rgb(folder / "with alpha.png", CODES)
    save_rgb(folder / "rgb.png")
    write(folder, "m.mtl", "newmtl m\n" + text)
    (shape,) = load_shapes(write(folder, "mesh.obj", obj))
    return shape.material


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # Without gloss it is matt.
        ("", wrt.Diffuse((0.5, 0.25, 0.1))),
        ("Ks 1 1 1\nillum 1", wrt.Diffuse((0.5, 0.25, 0.1))),
        ("Ks 0 0 0\nNs 100\nillum 2", wrt.Diffuse((0.5, 0.25, 0.1))),
        # Gloss is that of a dielectric, which straight on reflects Ks.
        (
            "Ks 0.5 0.25 1\nNs 250\nNi 1.45\nillum 2",
            {"base_color": (0.5, 0.25, 0.1), "metallic": 0.0, "ior": 1.45, "roughness": 0.5,
             "specular_color": (1.0, 0.5, 2.0)},
        ),
        ("Ks 0.9 0.8 0.7\nNs 1000\nillum 3", {"specular_color": (22.5, 20.0, 17.5), "roughness": 0.0}),
        (
            "Kd 0.2 0.2 0.2\nTf 0.9 0.95 1\nd 0.1\nNi 1.5\nNs 1000\nillum 7",
            {"transmission": 0.9, "opacity": 1.0, "ior": 1.5, "base_color": (0.9, 0.95, 1.0), "roughness": 0.0,
             "thin_walled": False},
        ),
        (
            "Pr 0.4\nPm 1\nPc 0.5\nPcr 0.1\nPs 0.2\naniso 0.6\nKe 1 2 3",
            {"roughness": 0.4, "metallic": 1.0, "coat": 0.5, "coat_roughness": 0.1, "sheen_color": (0.2,) * 3,
             "anisotropy": 0.6, "emission": (1.0, 2.0, 3.0)},
        ),
        ("d 0.3", {"opacity": 0.3}),
        ("Tr 0.3", {"opacity": 0.7}),
        ("d 0.3\nTr 0.3", {"opacity": 0.3}),  # d is the one that all agree on
        ("Tr 1", {"opacity": 1.0}),
        ("Tr 0", {"opacity": 1.0}),
        ("d -halo 0.6", {"opacity": 0.6}),
        ("d none", {"opacity": 1.0}),
    ],
)  # fmt: skip
def test_statements(tmp_path, text, expected):
    material = material_of(tmp_path, f"Kd 0.5 0.25 0.1\n{text}")
    if isinstance(expected, wrt.Material):
        assert material == expected
    else:
        check_values(material, **expected)


def test_opacity_0_is_named_and_ignored_where_it_hides_everything(tmp_path):
    """Some exporters write a transparency, 0, for d."""
    write(tmp_path, "m.mtl", "newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 1 0\nnewmtl o\nKd 1 0 0\nd 0\n")
    path = write(tmp_path, "mesh.obj", OBJ + "usemtl n\nf 3/3 2/2 1/1\nusemtl o\nf 2/2 3/3 1/1\n")
    with pytest.warns(InputWarning, match=r"mesh\.obj: 'm' and 1 more are invisible: their opacity is 0"):
        assert [shape.material.opacity for shape in load_shapes(path)] == [0.0, 1.0, 0.0]
    write(tmp_path, "m.mtl", "newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 1 0\nKs 1 1 1\nillum 2\nd 0\n")
    path = write(tmp_path, "mesh.obj", OBJ + "usemtl n\nf 3/3 2/2 1/1\nusemtl m\nf 2/2 3/3 1/1\n")
    words = "all of it would be invisible, as the opacity of its materials is 0; it is shown opaque"
    with pytest.warns(InputWarning, match=rf"mesh\.obj: {words}"):
        shapes = load_shapes(path)
    assert {shape.material.opacity for shape in shapes} == {1.0}
    assert {shape.material.type_name for shape in shapes} == {"diffuse", "principled"}


def test_maps(tmp_path):
    text = "Kd 0.5 1 1\nKs 1 1 1\nillum 2\nd 0\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on with alpha.png\nmap_Ks rgb.png\n"
    text += "map_d with alpha.png\nnorm rgb.png\nmap_Pr rgb.png\n"
    material = material_of(tmp_path, text)
    base = material.base_color
    assert (base.scale, base.offset, base.wrap) == ((2.0, 3.0), (0.5, 0.25), ("clamp", "clamp"))
    expected = {"base_color": COLORS * [0.5, 1, 1], "specular_color": 2.0 * COLORS, "roughness": NUMBERS[:, :, 0]}
    check_values(material, **expected, opacity=CODES[:, :, 3] / 255.0)
    np.testing.assert_allclose(material.normal_map.pixels, NUMBERS, atol=1e-6)
    check_values(material_of(tmp_path, "Kd 1 1 1\nmap_d -imfchan g rgb.png"), opacity=NUMBERS[:, :, 1])


def test_a_bump_map_is_a_relief(tmp_path):
    # A ramp along u: heights grow by 8 / 255 from texel to texel, but where it repeats.
    save_rgb(tmp_path / "ramp.png", np.repeat(np.arange(0, 256, 8, dtype=np.uint8)[None, :], 4, axis=0))
    pixels = material_of(tmp_path, "Kd 1 1 1\nmap_bump -bm 0.5 ramp.png").normal_map.pixels
    normal = 2.0 * pixels[2, 10].astype(np.float64) - 1.0
    assert -normal[0] / normal[2] == pytest.approx(2.0 * 0.5 * 8 / 255, rel=1e-4)
    assert abs(normal[1]) < 1e-6
    # What is blue holds normals, whatever the statement calls it.
    blue = np.zeros((4, 4, 3), np.uint8) + np.array([128, 128, 250], np.uint8)
    save_rgb(tmp_path / "normals.png", blue)
    pixels = material_of(tmp_path, "Kd 1 1 1\nbump normals.png").normal_map.pixels
    np.testing.assert_allclose(pixels, blue / 255.0, atol=1e-6)


def test_maps_in_floating_point(tmp_path):
    """Linear as they are; only what shines may be brighter than 1, only heights less than 0."""
    values = np.random.default_rng(9).uniform(0.0, 3.0, (4, 4, 4)).astype(np.float32)
    channels = {name: np.ascontiguousarray(values[:, :, k]) for k, name in enumerate("RGBA")}
    OpenEXR.File({}, channels).write(str(tmp_path / "a map.exr"))
    text = "Kd 1 1 1\nmap_Kd -s 2 2 1 a map.exr\nmap_Ke a map.exr\nmap_d a map.exr\nmap_Pr a map.exr"
    material = material_of(tmp_path, text)
    bounded = np.minimum(values, 1.0)
    assert material.base_color.scale == (2.0, 2.0)
    expected = {"base_color": bounded[:, :, :3], "emission": values[:, :, :3], "roughness": bounded[:, :, 0]}
    check_values(material, **expected, opacity=bounded[:, :, 3])
    heights = np.tile(np.linspace(-4.0, 4.0, 16, dtype=np.float32), (4, 1))
    OpenEXR.File({}, {"Y": heights}).write(str(tmp_path / "heights.exr"))
    normals = 2.0 * material_of(tmp_path, "Kd 1 1 1\nmap_bump -bm 0.5 heights.exr").normal_map.pixels - 1.0
    np.testing.assert_allclose(-normals[:, 1:-1, 0] / normals[:, 1:-1, 2], 8.0 / 15.0, rtol=1e-4)
    rgbe = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes([128, 64, 0, 131, 128, 0, 0, 130])
    write(tmp_path, "light.hdr", rgbe)
    emission = material_of(tmp_path, "Kd 1 1 1\nmap_Ke light.hdr").emission
    np.testing.assert_allclose(emission.pixels, [[[4.0, 2.0, 0.0], [2.0, 0.0, 0.0]]], atol=0.05)


def test_maps_that_cannot_be_used_are_told_once_and_left_out(tmp_path):
    good = np.ones((64, 64), np.float32)
    for name, pixels in (("whole", good), ("nan", np.where(np.eye(64) > 0, np.nan, good).astype(np.float32))):
        OpenEXR.File({}, dict.fromkeys("RGB", pixels)).write(str(tmp_path / f"{name}.exr"))
    write(tmp_path, "cut.exr", (tmp_path / "whole.exr").read_bytes()[:400])
    write(tmp_path, "bomb.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 60000\n\2\2")
    save_rgb(tmp_path / "whole.png", np.zeros((999, 999), np.uint8))
    write(tmp_path, "cut.png", (tmp_path / "whole.png").read_bytes()[:60])
    write(tmp_path, "words.png", "no image")
    for name, reason in (
        ("cut.exr", ""),
        ("nan.exr", "infinite or NaN values"),
        ("bomb.hdr", "too large|claims"),
        ("cut.png", ""),
        ("words.png", "texture words.png left out"),
        ("none.exr", "no such file"),
    ):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            maps = "".join(f"\n{statement} {name}" for statement in ("map_Kd", "map_Ke", "map_d", "map_Ks", "bump"))
            material = material_of(tmp_path, f"Kd 0.5 0.25 0.1\n{maps}")
        told = [str(each.message) for each in caught if each.category is InputWarning]
        assert len(told) == 1, (name, told)
        assert name in told[0]
        assert "left out" in told[0]
        assert re.search(reason, told[0]), told
        assert material == wrt.Diffuse((0.5, 0.25, 0.1)) or material.base_color == (0.5, 0.25, 0.1)
        assert (material.opacity, material.normal_map) == (1.0, None)
    with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file"):  # black may be a default
        assert material_of(tmp_path, "Kd 0 0 0\nmap_Kd none.png") == wrt.Diffuse(DEFAULT_REFLECTANCE)


@pytest.mark.parametrize("corners", ["1 2 3", "1/1 2/1 3/9"])
def test_without_coordinates_maps_are_left_out_and_the_color_is_the_mean(tmp_path, corners):
    text = "Kd 0.5 0.5 0.5\nmap_Kd rgb.png\nmap_d rgb.png\nbump rgb.png"
    with pytest.warns(InputWarning, match=r"texture rgb\.png cannot be laid"):
        material = material_of(tmp_path, text, OBJ.replace("1/1 2/2 3/3", corners))
    assert isinstance(material, wrt.Diffuse)
    np.testing.assert_allclose(material.reflectance, 0.5 * COLORS.mean(axis=(0, 1)), rtol=1e-5)
    assert (material.opacity, material.normal_map) == (1.0, None)


@pytest.mark.parametrize(
    ("named", "place"),
    [
        ("RGB.png", "meshes/rgb.png"),
        (r"Maps\Rgb.PNG", "meshes/maps/rgb.png"),
        (r"C:\work\maps\rgb.png", "meshes/rgb.png"),
        ("/home/else/RGB.png", "meshes/rgb.png"),
        ("rgb.png", "meshes/textures/RGB.png"),
        ("rgb.png", "textures/RGB.png"),
        ("rgb.png", "materials/textures/RGB.png"),
    ],
)
def test_images_are_found_in_any_case_and_where_programs_keep_them(named, place, tmp_path):
    (tmp_path / "meshes").mkdir()
    save_rgb(tmp_path / place)
    write(tmp_path / "meshes", "m.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {named}\n")
    path = write(tmp_path / "meshes", "mesh.obj", OBJ)
    with pytest.warns(InputWarning, match=r"is not there; '.*(?i:rgb\.png)' is taken"):
        (shape,) = load_shapes(path)
    np.testing.assert_allclose(shape.material.reflectance.pixels, COLORS, atol=1e-6)
    if named == "rgb.png":
        with pytest.warns(InputWarning, match="is taken" if place.startswith("meshes") else "no such file"):
            wrt.load(path, confined=True)  # looks into no other folder


def test_images_beside_the_mesh_come_before_those_beside_its_materials(tmp_path):
    save_rgb(tmp_path / "materials/maps/rgb.png")
    write(tmp_path / "materials", "m.mtl", "newmtl m\nKd 1 1 1\nmap_Kd maps/rgb.png\n")
    path = write(tmp_path, "mesh.obj", OBJ.replace("m.mtl", "materials/m.mtl"))
    np.testing.assert_allclose(load_shapes(path)[0].material.reflectance.pixels, COLORS, atol=1e-6)
    save_rgb(tmp_path / "maps/rgb.png", CODES[::-1, :, :3])
    np.testing.assert_allclose(load_shapes(path)[0].material.reflectance.pixels, COLORS[::-1], atol=1e-6)


@pytest.mark.parametrize("named", ["mtllib a.mtl\nmtllib two b.mtl\n", "mtllib a.mtl none.MTL\nmtllib two b.mtl\n"])
def test_materials_split_the_mesh_and_may_be_in_several_files(tmp_path, named):
    write(tmp_path, "a.mtl", "newmtl one\nKd 0.1 0.2 0.3\n")
    write(tmp_path, "two b.mtl", "newmtl two\nKd 0.3 0.2 0.1\n")
    write(tmp_path, "mesh.mtl", "newmtl one\nKd 0.9 0.9 0.9\n")
    # A roof folded by 20 degrees, one side of each material: its ridge is smooth all the same.
    y = np.tan(np.deg2rad(10))
    points = f"v -1 0 0\nv 0 {y} 0\nv 0 {y} 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\n"
    path = write(tmp_path, "mesh.obj", f"{named}{points}usemtl one\nf 1 4 3 2\nusemtl two\nf 2 3 6 5\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        shapes = load_shapes(path)
    assert [shape.material for shape in shapes] == [wrt.Diffuse((0.1, 0.2, 0.3)), wrt.Diffuse((0.3, 0.2, 0.1))]
    for shape in shapes:
        ridge = shape.mesh.vertices[:, 1] > 0.1
        np.testing.assert_allclose(shape.mesh.normals[ridge], [[0, 1, 0]] * 2, atol=1e-6)
    assert [str(each.message).partition(", which")[0][-9:] for each in caught] == ["none.MTL'"] * ("none" in named)


def test_names_with_spaces(tmp_path):
    """Of the file, its folder, its materials' file, a material, and images, one of them above the folder."""
    folder = tmp_path / "my meshes"
    save_rgb(folder / "dark wood.png")
    save_rgb(tmp_path / "light wood.png", CODES[::-1, :, :3])
    text = "newmtl dark red\nKd 0.5 0.1 0.1\nnewmtl dark\nKd 1 1 1\nmap_Kd dark wood.png\n"
    write(folder, "my materials.mtl", text + "newmtl light\nKd 1 1 1\nmap_Kd ..\\light wood.png\n")
    text = "mtllib my materials.mtl\no one thing\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\n"
    text += "usemtl dark red\nf 1 2 3\nusemtl dark\nf 1/1 2/2 3/3\nusemtl light\nf 1/1 3/2 4/3\n"
    shapes = load_shapes(write(folder, "my mesh.obj", text))
    found = {shape.name.partition(": ")[2]: shape.material.reflectance for shape in shapes}
    assert found["dark red"] == pytest.approx((0.5, 0.1, 0.1))
    np.testing.assert_allclose(found["dark"].pixels, COLORS, atol=1e-6)
    np.testing.assert_allclose(found["light"].pixels, COLORS[::-1], atol=1e-6)


@pytest.mark.parametrize(
    ("named", "told"),
    [
        ("mtllib old name.mtl\n", r"'old name\.mtl', which it refers to, is not there; '.*renamed\.MTL' is taken"),
        ("", r"it names no file \(mtllib\) that describes its materials, 'x'; '.*renamed\.MTL' is taken"),
    ],
)
def test_the_material_file_of_its_own_name_is_taken_where_there_is_no_other(tmp_path, named, told):
    material_file = write(tmp_path, "renamed.MTL", "newmtl x\nKd 0.1 0.2 0.3\n")
    path = write(tmp_path, "renamed.obj", named + SQUARE + "usemtl x\nf 1 2 3\nusemtl y\nf 1 3 4\n")
    with pytest.warns(InputWarning, match=told.replace("'x'", "'x' and 1 more")):
        assert load_shapes(path)[0].material.reflectance == pytest.approx((0.1, 0.2, 0.3))
    material_file.unlink()
    told = told.partition(";")[0].replace("'x'", "'x' and 1 more") if not named else r"old name\.mtl'.*: no such file"
    with pytest.warns(InputWarning, match=told):
        assert load_shapes(path)[0].material.reflectance == DEFAULT_REFLECTANCE
    assert len(load_mesh(write(tmp_path, "plain.obj", SQUARE + "f 1 2 3 4\n")).faces) == 2  # without a word
