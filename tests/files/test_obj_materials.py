"""Materials of OBJ files: what each statement of an MTL file becomes, and where files and images are found."""

import re
import warnings
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from support.mesh_files import check_values
from support.meshes import SQUARE, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_shapes
from wrt.io.mesh.mtl import WITHOUT_EFFECT
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


def test_names_may_have_the_sign_of_comments(tmp_path):
    write(tmp_path, "m#1.mtl", "newmtl a#1\nKd 1 0 0\nnewmtl a#2\nKd 0 1 0\n")
    text = OBJ.replace("m.mtl", "m#1.mtl #m").replace("usemtl m", "usemtl a#2 # a#1")
    (shape,) = load_shapes(write(tmp_path, "mesh.obj", text))
    assert shape.material.reflectance == (0, 1, 0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # Without gloss it is matt.
        ("", wrt.Diffuse((0.5, 0.25, 0.1))),
        ("Ks 0 0 0\nNs 100\nillum 2", wrt.Diffuse((0.5, 0.25, 0.1))),
        # Gloss is a dielectric's, which reflects Ks at normal incidence.
        (
            "Ks 0.5 0.25 1\nNs 250\nNi 1.45\nillum 2",
            {"base_color": (0.5, 0.25, 0.1), "metallic": 0.0, "ior": 1.45, "roughness": 0.5,
             "specular_color": (1.0, 0.5, 2.0)},
        ),
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
    path = write(tmp_path, "mesh.obj", OBJ + "usemtl n\nf 3/3 2/2 1/1\n")
    for opacity, message, expected in (
        (1, "'m' is invisible: its opacity is 0", [0.0, 1.0]),
        (0, "all of it would be invisible, as the opacity of its materials is 0; it is shown opaque", [1.0, 1.0]),
    ):
        write(tmp_path, "m.mtl", f"newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 1 0\nd {opacity}\n")
        with pytest.warns(InputWarning, match=rf"mesh\.obj: {message}"):
            assert [shape.material.opacity for shape in load_shapes(path)] == expected


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
    # Their values are linear; only emission may exceed 1
    values = np.random.default_rng(9).uniform(0.0, 3.0, (4, 4, 4)).astype(np.float32)
    channels = {name: np.ascontiguousarray(values[:, :, k]) for k, name in enumerate("RGBA")}
    OpenEXR.File({}, channels).write(str(tmp_path / "a map.exr"))
    text = "Kd 1 1 1\nmap_Kd -s 2 2 1 a map.exr\nmap_Ke a map.exr\nmap_d a map.exr\nmap_Pr a map.exr"
    material = material_of(tmp_path, text)
    bounded = np.minimum(values, 1.0)
    assert material.base_color.scale == (2.0, 2.0)
    expected = {"base_color": bounded[:, :, :3], "emission": values[:, :, :3], "roughness": bounded[:, :, 0]}
    check_values(material, **expected, opacity=bounded[:, :, 3])


def test_a_bump_map_is_a_relief(tmp_path):
    # A ramp along u: heights grow by 8 / 255 from texel to texel, but where it repeats.
    save_rgb(tmp_path / "ramp.png", np.repeat(np.arange(0, 256, 8, dtype=np.uint8)[None, :], 4, axis=0))
    pixels = material_of(tmp_path, "Kd 1 1 1\nmap_bump -bm 0.5 ramp.png").normal_map.pixels
    normal = 2.0 * pixels[2, 10].astype(np.float64) - 1.0
    assert -normal[0] / normal[2] == pytest.approx(2.0 * 0.5 * 8 / 255, rel=1e-4)
    assert abs(normal[1]) < 1e-6


def test_maps_that_cannot_be_used_are_told_once_and_left_out(tmp_path):
    pixels = np.where(np.eye(64) > 0, np.nan, 1.0).astype(np.float32)
    OpenEXR.File({}, dict.fromkeys("RGB", pixels)).write(str(tmp_path / "nan.exr"))
    write(tmp_path, "cut.exr", (tmp_path / "nan.exr").read_bytes()[:400])
    write(tmp_path, "bomb.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 60000\n\2\2")
    write(tmp_path, "words.png", "no image")
    for name, reason in (
        ("cut.exr", ""),
        ("nan.exr", "infinite or NaN values"),
        ("bomb.hdr", "(too large|claims)"),
        ("words.png", ""),
        ("none.exr", "no such file"),
    ):
        maps = "".join(f"\n{statement} {name}" for statement in ("map_Kd", "map_Ke", "map_d", "map_Ks", "bump"))
        with pytest.warns(InputWarning, match=rf"{re.escape(name)}(?=.*{reason}).*left out") as caught:
            material = material_of(tmp_path, f"Kd 0.5 0.25 0.1\n{maps}")
        assert len(caught) == 1
        assert material == wrt.Diffuse((0.5, 0.25, 0.1)) or material.base_color == (0.5, 0.25, 0.1)
        assert (material.opacity, material.normal_map) == (1.0, None)
    with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file"):  # black may be a default
        assert material_of(tmp_path, "Kd 0 0 0\nmap_Kd none.png") == wrt.Diffuse(DEFAULT_REFLECTANCE)


@pytest.mark.filterwarnings("ignore:.*a face names 'vt' 9, but there are 3; such faces have none")
@pytest.mark.parametrize("corners", ["1 2 3", "1/1 2/1 3/9"])
def test_without_coordinates_maps_are_left_out_and_the_color_is_the_mean(tmp_path, corners):
    text = "Kd 0.5 0.5 0.5\nmap_Kd rgb.png\nmap_d rgb.png\nbump rgb.png"
    with pytest.warns(InputWarning, match=r"texture rgb\.png cannot be laid"):
        material = material_of(tmp_path, text, OBJ.replace("1/1 2/2 3/3", corners))
    assert isinstance(material, wrt.Diffuse)
    np.testing.assert_allclose(material.reflectance, 0.5 * COLORS.mean(axis=(0, 1)), rtol=1e-5)
    assert (material.opacity, material.normal_map) == (1.0, None)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        (r"Maps\Rgb.PNG", "meshes/maps/rgb.png"),
        (r"C:\work\maps\rgb.png", "meshes/rgb.png"),
        ("rgb.png", "meshes/textures/RGB.png"),
        ("rgb.png", "textures/RGB.png"),
        ("rgb.png", "materials/textures/RGB.png"),
    ],
)
def test_images_are_found_in_any_case_and_where_programs_keep_them(name, place, tmp_path):
    (tmp_path / "meshes").mkdir()
    save_rgb(tmp_path / place)
    write(tmp_path / "meshes", "m.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    path = write(tmp_path / "meshes", "mesh.obj", OBJ)
    with pytest.warns(InputWarning, match=r"is not there; '.*(?i:rgb\.png)' is taken"):
        (shape,) = load_shapes(path)
    np.testing.assert_allclose(shape.material.reflectance.pixels, COLORS, atol=1e-6)
    if name == "rgb.png":
        with pytest.warns(InputWarning, match="is taken" if place.startswith("meshes") else "no such file"):
            wrt.load(path, confined=True)  # looks into no other folder


def test_materials_split_the_mesh_and_may_be_in_several_files(tmp_path):
    write(tmp_path, "a.mtl", "newmtl dark red\nKd 0.1 0.2 0.3\n")
    write(tmp_path, "two b.mtl", "newmtl two\nKd 0.3 0.2 0.1\n")
    write(tmp_path, "mesh.mtl", "newmtl dark red\nKd 0.9 0.9 0.9\n")
    # A roof folded by 20 degrees, one side of each material: its ridge is smooth all the same.
    y = np.tan(np.deg2rad(10))
    points = f"v -1 0 0\nv 0 {y} 0\nv 0 {y} 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\n"
    text = f"mtllib a.mtl none.MTL\nmtllib two b.mtl\n{points}usemtl dark red\nf 1 4 3 2\nusemtl two\nf 2 3 6 5\n"
    with pytest.warns(InputWarning, match=r"none\.MTL', which") as caught:
        shapes = load_shapes(write(tmp_path, "mesh.obj", text))
    assert len(caught) == 1
    assert [shape.material for shape in shapes] == [wrt.Diffuse((0.1, 0.2, 0.3)), wrt.Diffuse((0.3, 0.2, 0.1))]
    for shape in shapes:
        ridge = shape.mesh.vertices[:, 1] > 0.1
        np.testing.assert_allclose(shape.mesh.normals[ridge], [[0, 1, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("mtllib old name.mtl\n", r"'old name\.mtl', which it refers to, is not there; '.*renamed\.MTL' is taken"),
        ("", r"it names no file \(mtllib\) that describes its materials, 'x' and 1 more; '.*renamed\.MTL' is taken"),
    ],
)
def test_the_material_file_of_its_own_name_is_taken_where_there_is_no_other(tmp_path, statement, message):
    material_file = write(tmp_path, "renamed.MTL", "newmtl x\nKd 0.1 0.2 0.3\n")
    path = write(tmp_path, "renamed.obj", statement + SQUARE + "usemtl x\nf 1 2 3\nusemtl y\nf 1 3 4\n")
    with pytest.warns(InputWarning, match="describes 'y'"), pytest.warns(InputWarning, match=message):
        assert load_shapes(path)[0].material.reflectance == pytest.approx((0.1, 0.2, 0.3))
    material_file.unlink()
    with pytest.warns(InputWarning, match="it names no file" if not statement else r"old name\.mtl'.*: no such file"):
        assert load_shapes(path)[0].material.reflectance == DEFAULT_REFLECTANCE


# Statements and options of appendix B2 and for physically based materials; after & what they need to have an effect.
STATEMENTS = """
    Ka .2 .2 .2 | Kd spectral file.rfl 1 | Ks xyz 1 1 1 | Tf .5 .5 .5 & d .5 & illum 4 | illum 3 | illum 10 | d .5
    d -halo .5 | Tr .5 | Ns 10 | sharpness 60 | Ni 1.4 | map_Ka rgb.png | map_Kd rgb.png | map_Ks rgb.png
    map_Ns rgb.png | map_d rgb.png | map_aat on | decal rgb.png | disp rgb.png | bump rgb.png | map_bump rgb.png
    refl -type sphere rgb.png | Pr .5 | Pm .5 | Ps .5 | Pc .5 | Pcr .5 & Pc .5 | aniso .5 & Pr .5 | anisor .5
    norm rgb.png | Ke 1 1 1 | map_Ke rgb.png | map_Pr rgb.png | map_Pm rgb.png | map_Ps rgb.png | map_Pc rgb.png
    map_Pcr rgb.png & Pc .5 | map_aniso rgb.png | map_Kd -blendu off rgb.png
    map_Kd -blendv on rgb.png
    map_Kd -boost 2 rgb.png | map_Kd -cc on rgb.png | map_Kd -clamp on rgb.png & map_Kd rgb.png
    map_d -imfchan l rgb.png & map_d rgb.png | map_d -imfchan z rgb.png | map_d -imfchan rgb rgb.png
    map_Kd -clamp no rgb.png | map_Kd -mm .1 .5 rgb.png & map_Kd rgb.png
    map_Kd -o .1 .1 0 rgb.png & map_Kd rgb.png | map_Kd -s 2 2 1 rgb.png & map_Kd rgb.png | map_Kd -t .1 .1 0 rgb.png
    map_Kd -texres 64 rgb.png | map_Kd -bm .5 rgb.png | bump -bm .5 rgb.png & bump rgb.png | map_new rgb.png
"""
LEFT_OUT = """
    kd spectral|ks xyz|illum 10|d -halo|map_ns|decal|disp|refl|anisor|map_aniso|map_kd -blendu off|map_kd -cc on
    map_d -imfchan z|map_d -imfchan rgb|-clamp no|map_kd -t|map_kd -bm|map_new
"""


def test_each_statement_and_option_is_used_or_excused_or_warned_of(tmp_path):
    left_out = [kind.strip() for line in LEFT_OUT.strip().splitlines() for kind in line.split("|")]
    for entry in (each for line in STATEMENTS.strip().splitlines() for each in line.split("|")):
        statement, *needed = (each.strip() for each in entry.split("&"))
        context = "\n".join(["Kd .8 .8 .8\nKs .5 .5 .5", *needed, ""])
        before = material_of(tmp_path, context)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            after = material_of(tmp_path, context + statement)
        messages = [str(each.message).partition("mesh.obj: ")[2] for each in caught]
        if messages:
            assert messages == [f"{left_out.pop(0)} is unknown to wrt and left out"], statement
        elif not any(fnmatchcase(statement.lower(), f"{kind.replace('* ', 'map_kd ')}*") for kind in WITHOUT_EFFECT):
            assert repr(after) != repr(before) or not same_images(after, before), statement
    assert not left_out


def same_images(a: wrt.Material, b: wrt.Material) -> bool:
    """Whether two materials have the same pixels and placements of textures."""

    def content(material: wrt.Material) -> list[object]:
        values = [value for _, value in sorted(vars(material).items()) if hasattr(value, "pixels")]
        return [(each.pixels.tobytes(), {k: v for k, v in vars(each).items() if k != "pixels"}) for each in values]

    return content(a) == content(b)


def test_options_place_each_map_by_itself_and_scale_normals(tmp_path):
    """The mesh has the coordinates of the normal map, and other textures undo that."""
    save_rgb(tmp_path / "blue.png", np.array([[[140, 128, 255], [128, 128, 255]]], np.uint8))
    text = (
        "Kd 1 1 1\nmap_Bump -s 2 4 1 -o 0.5 0.25 0 -bm 0.5 blue.png\nmap_d -s 3 1 1 -clamp on rgb.png\nmap_Kd rgb.png"
    )
    material = material_of(tmp_path, text)
    (shape,) = load_shapes(tmp_path / "mesh.obj")
    np.testing.assert_allclose(shape.mesh.uvs, [[0.5, 0.25], [2.5, 0.25], [0.5, 4.25]])
    assert (material.normal_map.scale, material.normal_map.pixels[0, 0, 0]) == (0.5, pytest.approx(140 / 255))
    for texture, scale in ((material.reflectance, (1.0, 1.0)), (material.opacity, (3.0, 1.0))):
        places = shape.mesh.uvs @ texture.placement[:, :2].T + texture.placement[:, 2]
        np.testing.assert_allclose(places, np.array([[0, 0], [1, 0], [0, 1]]) * scale, atol=1e-12)


def test_materials_are_found_in_another_case_and_missing_ones_named(tmp_path):
    write(tmp_path, "m.mtl", 'Kd 1 0 0\nnewmtl  Dark  Red \nKd 1 0 0\nnewmtl "b"\nKd 0 1 0\n')
    text = "usemtl dark red\nf 1 2 3\nmtllib M.MTL\nusemtl b\nf 1 2 3\nusemtl gone\nf 1 3 4\nusemtl\nf 1 3 4\n"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        shapes = load_shapes(write(tmp_path, "mesh.obj", SQUARE + text))
    for message, expected in zip(
        (each.message for each in caught),
        ("'M.MTL', which it refers", "m.mtl: kd before the first", "'dark red' is not described; 'Dark Red' is taken",
         "no material file describes 'gone'; the default"),
        strict=True,
    ):  # fmt: skip
        assert expected in str(message)
    colors = [shape.material.reflectance for shape in shapes]
    assert colors == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), DEFAULT_REFLECTANCE, DEFAULT_REFLECTANCE]
