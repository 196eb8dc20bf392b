"""Materials of glTF files become the same in wrt: factors, textures, alpha, extensions, images of every kind."""

import contextlib
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image
from support.mesh_files import add, attributes, check_refused, check_values, data_uri, saved, values_of
from support.meshes import gltf_box, write

import wrt
from wrt.errors import InputError, InputWarning
from wrt.io.load_mesh import load_shapes
from wrt.io.texture_images import KTX2_IDENTIFIER, open_ktx2
from wrt.scene.srgb import linear_from_srgb

UVS = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]], "<f4")
CODES = np.random.default_rng(5).integers(0, 256, (3, 4, 4), dtype=np.uint8)
"""An image with alpha."""
NUMBERS, ALPHA = CODES[:, :, :3] / 255.0, CODES[:, :, 3] / 255.0
COLORS = linear_from_srgb(NUMBERS)
IMAGE = {"index": 0}


def png(codes: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, "PNG")
    return buffer.getvalue()


def file_with(material: dict[str, Any], *, uvs: bool = True) -> dict[str, Any]:
    """Return a triangle of one material. Texture 0 is the image CODES, texture 1 too, but held and not smoothed."""
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["meshes"][0]["primitives"][0]["material"] = 0
    if uvs:
        attributes(tree)["TEXCOORD_0"] = add(tree, UVS)
    return tree | {
        "materials": [material],
        "images": [{"uri": data_uri(png(CODES), "image/png")}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
        "textures": [{"source": 0}, {"source": 0, "sampler": 0}],
    }


def shape_of(folder: Path, tree: dict[str, Any]) -> wrt.Shape:
    (shape,) = load_shapes(saved(folder, tree))
    return shape


def made(folder: Path, material: dict[str, Any], **options: Any) -> wrt.Principled:
    result = shape_of(folder, file_with(material, **options)).material
    assert isinstance(result, wrt.Principled)
    return result


def extensions(**values: dict[str, Any]) -> dict[str, Any]:
    return {"extensions": {f"KHR_materials_{name}": value for name, value in values.items()}}


BASE = {"baseColorTexture": IMAGE, "baseColorFactor": [0.5, 0.25, 1.0, 0.75]}
PBR = {**BASE, "metallicRoughnessTexture": {"index": 1}, "roughnessFactor": 0.5}
SPECULAR = {"specularFactor": 0.8, "specularTexture": IMAGE, "specularColorFactor": [2.0, 1.0, 0.5]}
COAT = {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.2, "clearcoatRoughnessTexture": IMAGE}
SHEEN = {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenColorTexture": IMAGE, "sheenRoughnessFactor": 0.6}
BRUSHED = {"anisotropyStrength": 0.7, "anisotropyRotation": 0.2}
SHEET = {"transmission": {"transmissionFactor": 0.9, "transmissionTexture": IMAGE}}
BODY = {"volume": {"thicknessFactor": 0.1}}
DISPERSION = {"dispersion": {"dispersion": 0.36}}
FILM = {"iridescenceFactor": 0.5, "iridescenceIor": 2.0, "iridescenceTexture": IMAGE}
THICK = {"iridescenceThicknessTexture": IMAGE, "iridescenceThicknessMinimum": 200.0}
GLOSS = {"diffuseFactor": [0.2, 0.4, 0.6, 0.5], "specularFactor": [0.04, 0.4, 1.0], "glossinessFactor": 0.75}
STRONG = extensions(emissive_strength={"emissiveStrength": 4.0})
TINT = np.array([1.0, 10.0, 25.0])
RED, GREEN, BLUE = np.moveaxis(NUMBERS, 2, 0)


@pytest.mark.parametrize(
    ("described", "expected"),
    [
        ({}, {"base_color": (1.0,) * 3, "metallic": 1.0, "roughness": 1.0, "ior": 1.5, "normal_map": None}),
        ({"pbrMetallicRoughness": PBR, "occlusionTexture": {"index": 7}},
         {"base_color": COLORS * [0.5, 0.25, 1], "roughness": 0.5 * GREEN, "metallic": BLUE, "opacity": 1.0}),
        ({"alphaMode": "BLEND", "pbrMetallicRoughness": BASE}, {"opacity": 0.75 * ALPHA}),
        ({"emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": IMAGE}, {"emission": COLORS * [1.0, 0.5, 0.0]}),
        ({"emissiveFactor": [1.0, 0.5, 0.25], **STRONG}, {"emission": (4.0, 2.0, 1.0)}),
        (extensions(ior={"ior": 1.33}), {"ior": 1.33}),
        (extensions(ior={"ior": 0}), {"ior": 1.5, "specular_color": (25.0,) * 3}),
        (extensions(ior={"ior": 0}, specular=SPECULAR), {"ior": 1.5, "specular_color": (50.0, 25.0, 12.5)}),
        (extensions(specular=SPECULAR), {"specular": 0.8 * ALPHA, "specular_color": (2.0, 1.0, 0.5)}),
        (extensions(clearcoat=COAT), {"coat": 0.5, "coat_roughness": 0.2 * GREEN}),
        (extensions(sheen=SHEEN), {"sheen_color": COLORS * [0.1, 0.2, 0.3], "sheen_roughness": 0.6}),
        (extensions(anisotropy=BRUSHED), {"anisotropy": 0.7, "anisotropy_rotation": 0.2}),
        # A volume is a body and no sheet; only bodies have dispersion.
        (extensions(**SHEET), {"transmission": 0.9 * RED, "thin_walled": True}),
        (extensions(**SHEET, **BODY), {"thin_walled": False, "interior": None, "dispersion": 0.0}),
        (extensions(**SHEET, **BODY, **DISPERSION), {"dispersion": 0.36}),
        # Iridescence is a film, whose index has another name in drafts.
        (extensions(iridescence={"iridescenceFactor": 0.5}), {"film": 0.5, "film_ior": 1.3, "film_thickness": 400.0}),
        (extensions(iridescence={"iridescenceIor": 2.0}), {"has_film": False}),
        (extensions(iridescence={"iridescenceFactor": 1.0, "iridescenceIOR": 1.7}), {"film_ior": 1.7}),
        (extensions(iridescence={**FILM, **THICK, "iridescenceThicknessMaximum": 800.0}),
         {"film": 0.5 * RED, "film_ior": 2.0, "film_thickness": 200.0 + 600.0 * GREEN}),
        # Specular and glossiness are a dielectric with a tint.
        ({"alphaMode": "BLEND", **extensions(pbrSpecularGlossiness=GLOSS)},
         {"base_color": (0.2, 0.4, 0.6), "metallic": 0, "opacity": 0.5, "roughness": 0.25, "specular_color": TINT}),
        (extensions(pbrSpecularGlossiness={**GLOSS, "specularGlossinessTexture": IMAGE}),
         {"roughness": 1.0 - 0.75 * ALPHA, "specular_color": COLORS * TINT}),
    ],
)  # fmt: skip
def test_factors_textures_and_extensions(tmp_path, described, expected):
    """Colours are of sRGB, numbers linear, each of its channel."""
    check_values(made(tmp_path, described), **expected)


def test_samplers_normal_maps_and_interiors(tmp_path):
    described = {"pbrMetallicRoughness": {"baseColorTexture": IMAGE, "metallicRoughnessTexture": {"index": 1}}}
    with pytest.warns(InputWarning, match="the normal texture of material 0 is smoothed"):
        material = made(tmp_path, described | {"normalTexture": {"index": 1, "scale": 0.3}})
    base, rough, normals = material.base_color, material.roughness, material.normal_map
    assert (base.wrap, base.filter) == (("repeat", "repeat"), "bilinear")
    assert (rough.wrap, rough.filter) == (("clamp", "mirror"), "nearest")
    assert (normals.scale, normals.wrap) == (0.3, ("clamp", "mirror"))
    np.testing.assert_allclose(normals.pixels, NUMBERS, atol=1e-6)
    volume = {"volume": {"thicknessFactor": 0.1, "attenuationDistance": 0.5, "attenuationColor": [0.25, 0.5, 1.0]}}
    absorption = np.array(made(tmp_path, extensions(**SHEET, **volume)).interior.absorption)
    np.testing.assert_allclose(np.exp(-0.5 * absorption), [0.25, 0.5, 1.0], rtol=1e-6)  # what half a metre leaves
    assert material.metallic.pixels is rough.pixels


def test_masks_and_textures_without_coordinates(tmp_path):
    for fields, cutoff in (({}, 0.5), ({"alphaCutoff": 0.2}, 0.2)):
        opacity = made(tmp_path, {"pbrMetallicRoughness": BASE, "alphaMode": "MASK", **fields}).opacity
        assert opacity.cutoff == cutoff
        np.testing.assert_allclose(values_of(opacity), 0.75 * ALPHA, atol=1e-6)
    message = "the textures of material 0 are left out: its mesh has no texture coordinates"
    for mode, expected in (("MASK", 1.0), ("BLEND", 0.75)):
        with pytest.warns(InputWarning, match=message):
            assert made(tmp_path, {"pbrMetallicRoughness": BASE, "alphaMode": mode}, uvs=False).opacity == expected


@pytest.mark.parametrize("double", [False, True])
def test_what_shines_does_so_without_light_and_on_both_sides_where_it_has_two(tmp_path, double):
    described = {"doubleSided": double, "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 1]}}
    assert not shape_of(tmp_path, file_with(described)).two_sided_emission
    shape = shape_of(tmp_path, file_with({**described, "emissiveFactor": [1, 1, 1]}))
    assert shape.two_sided_emission == double
    shape = shape_of(tmp_path, file_with({**described, **extensions(unlit={})}))
    assert shape.material == wrt.Unlit((0.5, 0.25, 0.125))
    assert not shape.emits
    assert shape.emission == (0.5, 0.25, 0.125)
    for line, expected in (("", double), ("two_sided_emission = false", False)):
        text = f'[[shapes]]\ntype = "mesh"\nfile = "a.gltf"\n{line}'
        loaded = wrt.load(write(tmp_path, "one.toml", text)).shapes[0]
        assert (loaded.two_sided_emission, loaded.double_sided) == (expected, double)
    text += "\ndouble_sided = true"
    assert wrt.load(write(tmp_path, "one.toml", text)).shapes[0].double_sided
    assert wrt.load(tmp_path / "a.gltf", double_sided=True).shapes[0].double_sided
    assert shape_of(tmp_path, file_with(described)).double_sided == double


def test_transforms_move_the_coordinates_of_the_mesh(tmp_path):
    transform = {"offset": [0.2, -0.4], "rotation": 0.7, "scale": [2.0, 0.5]}
    c, s = np.cos(0.7), np.sin(0.7)  # the matrices that the extension's text gives, v downwards
    in_file = UVS * transform["scale"] @ np.array([[c, s], [-s, c]]).T + transform["offset"]
    expected = in_file * [1, -1] + [0, 1]
    placed = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    for number in (0, 1, 3):
        tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": {**placed, "texCoord": number}}}, uvs=False)
        attributes(tree)[f"TEXCOORD_{number}"] = add(tree, UVS)
        shape = shape_of(tmp_path, tree)
        np.testing.assert_allclose(shape.mesh.uvs, expected, atol=1e-6)
        assert shape.material.base_color.offset == (0.0, 0.0)
    # The first set is the transformed one, which tangents follow; the other textures lie by the second
    moved = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [4.0, 2.0]}}}
    for number in (0, 1):
        normal = {**moved, "texCoord": number}
        pbr = {"baseColorTexture": {"index": 0, "texCoord": number}, "metallicRoughnessTexture": normal}
        tree = file_with({"pbrMetallicRoughness": pbr, "normalTexture": normal}, uvs=False)
        attributes(tree)[f"TEXCOORD_{number}"] = add(tree, UVS)
        shape = shape_of(tmp_path, tree)
        expected = np.concatenate([UVS * (4, 2) + (0.25, 0.5), UVS], axis=1) * (1, -1, 1, -1) + (0, 1, 0, 1)
        np.testing.assert_allclose(shape.mesh.uvs, expected, atol=1e-6)
        base, roughness = shape.material.base_color, shape.material.roughness
        assert (base.uv_set, roughness.uv_set) == (1, 1)
        np.testing.assert_allclose(base.placement, np.eye(2, 3), atol=1e-12)
        np.testing.assert_allclose(roughness.placement, [[4, 0, 0.25], [0, 2, -1.5]], atol=1e-12)
        assert shape.material.normal_map is not None


@pytest.mark.parametrize("lacking", [0, 1])
def test_textures_without_their_coordinates_are_left_out_and_named_and_others_stay(lacking, tmp_path):
    other = 1 - lacking
    pbr = {"baseColorTexture": {"index": 0, "texCoord": other}, "roughnessFactor": 0.25}
    pbr["metallicRoughnessTexture"] = {"index": 0, "texCoord": lacking}
    tree = file_with({"pbrMetallicRoughness": pbr, "normalTexture": {"index": 0, "texCoord": lacking}}, uvs=False)
    missing = f"there is no TEXCOORD_{lacking}, by which textures of material 0 lie"
    with pytest.warns(InputWarning, match=f"its mesh has no texture coordinates of set {lacking}"):
        assert shape_of(tmp_path, tree).mesh.uvs is None
    attributes(tree)[f"TEXCOORD_{other}"] = add(tree, UVS)
    for message in (missing, f"TEXCOORD_{lacking} of a primitive is left out: it is 2 x 2 numbers|{missing}"):
        with pytest.warns(InputWarning, match=message):
            shape = shape_of(tmp_path, tree)
        np.testing.assert_allclose(shape.mesh.uvs, UVS * (1, -1) + (0, 1), atol=1e-6)
        np.testing.assert_allclose(shape.material.base_color.pixels, COLORS, atol=1e-6)
        assert (shape.material.roughness, shape.material.normal_map) == (0.25, None)
        attributes(tree)[f"TEXCOORD_{lacking}"] = add(tree, UVS[:2])  # damaged


def test_a_clear_coat_has_normals_of_its_own(tmp_path):
    """It is flat without a map, also over bumps (KHR_materials_clearcoat)."""
    bumps = {"index": 0, "scale": 0.5}
    coat = {**COAT, "clearcoatNormalTexture": {"index": 0, "scale": 0.25}}
    material = made(tmp_path, {"normalTexture": bumps, **extensions(clearcoat=coat)})
    assert (material.normal_map.scale, material.coat_normal_map.scale) == (0.5, 0.25)
    np.testing.assert_allclose(material.coat_normal_map.pixels, NUMBERS, atol=1e-6)
    material = made(tmp_path, {"normalTexture": bumps, **extensions(clearcoat=COAT)})
    assert material.normal_map is not None
    np.testing.assert_array_equal(material.coat_normal_map.pixels, [[[0.5, 0.5, 1.0]]])
    material = made(tmp_path, extensions(clearcoat=coat))
    assert (material.normal_map, material.coat_normal_map.scale) == (None, 0.25)
    # The same map for both, no bumps at all, and no coat
    same = {**COAT, "clearcoatNormalTexture": bumps}
    for described in (
        {"normalTexture": bumps, **extensions(clearcoat=same)},
        extensions(clearcoat=COAT),
        {"normalTexture": bumps, **extensions(clearcoat={**coat, "clearcoatFactor": 0.0})},
    ):
        assert made(tmp_path, described).coat_normal_map is None


def moved(number: int, **transform: Any) -> dict[str, Any]:
    return {"index": 0, "texCoord": number, "extensions": {"KHR_texture_transform": transform}}


@pytest.mark.parametrize("tangents", [False, True])
def test_the_normals_of_a_coat_lie_by_their_own_transform(tangents, tmp_path):
    """Its x and y turn with the image, where the mesh has no tangents; those of the base's map stay the axes."""
    turn = {"rotation": 0.5, "scale": [4.0, 4.0]}
    coat = extensions(clearcoat={**COAT, "clearcoatNormalTexture": moved(0, **turn)})
    tree = file_with({"normalTexture": {"index": 0}, **coat})
    if tangents:
        attributes(tree)["NORMAL"] = add(tree, np.tile([0.0, 0.0, 1.0], (3, 1)))
        attributes(tree)["TANGENT"] = add(tree, np.tile([1.0, 0.0, 0.0, 1.0], (3, 1)))
    shape = shape_of(tmp_path, tree)
    assert shape.material.normal_map.uv_scale == (1.0, 1.0)
    normals = shape.material.coat_normal_map
    in_file = moved_by(shape.mesh.uvs[:, 2 * normals.uv_set :][:, :2], normals.placement) * [1, -1] + [0, 1]
    c, s = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(in_file, 4.0 * UVS @ np.array([[c, s], [-s, c]]).T, atol=1e-5)
    # The image's u grows along (c, −s), v upwards.
    slopes = NUMBERS[..., :2] - 0.5
    turned = slopes if tangents else slopes @ [[c, -s], [s, c]]
    np.testing.assert_allclose(normals.pixels[..., :2], np.clip(0.5 + turned, 0.0, 1.0), atol=1e-6)


def moved_by(uvs: np.ndarray, placement: np.ndarray) -> np.ndarray:
    return uvs @ placement[:, :2].T + placement[:, 2]


def test_a_coat_that_alone_has_normals_gives_the_axes(tmp_path):
    """With other coordinates than those of the base's map, it cannot, and a warning says so."""
    coat = extensions(clearcoat={**COAT, "clearcoatNormalTexture": moved(1, offset=[0.25, 0.5])})
    for base, names in (({}, "alone"), ({"normalTexture": {"index": 0}}, "both")):
        tree = file_with({**base, **coat})
        attributes(tree)["TEXCOORD_1"] = add(tree, UVS[::-1])
        if names == "both":
            with pytest.warns(InputWarning, match="the clear coat of material 0 has other coordinates"):
                shape = shape_of(tmp_path, tree)
        else:
            shape = shape_of(tmp_path, tree)
        normals = shape.material.coat_normal_map
        found = moved_by(shape.mesh.uvs[:, 2 * normals.uv_set :][:, :2], normals.placement)
        np.testing.assert_allclose(found * [1, -1] + [0, 1], UVS[::-1] + [0.25, 0.5], atol=1e-6)
        assert normals.uv_set == (names == "both")


def test_what_cannot_be_read_is_told_and_left_out(tmp_path):
    tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": IMAGE, "baseColorFactor": [0.5, 0.5, 0.5, 1]}})
    for uri, message in (
        ("missing.png", r"missing\.png', which it refers to: no such file"),
        (data_uri(b"no image"), "image 0 left out: it cannot be decoded"),
    ):
        tree["images"][0]["uri"] = uri
        with pytest.warns(InputWarning, match=message):
            assert shape_of(tmp_path, tree).material.base_color == (0.5, 0.5, 0.5)
    with pytest.warns(
        InputWarning, match=r"materials\.extensions\.KHR_materials_diffuse_transmission is unknown to wrt"
    ):
        made(tmp_path, extensions(diffuse_transmission={}))
    tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": {"index": 12}}})
    check_refused("damaged or not as specified", load_shapes, saved(tmp_path, tree))


QUARTERS = np.array([[[200, 40, 40, 255], [40, 180, 60, 255]], [[30, 60, 190, 255], [220, 210, 90, 96]]], np.uint8)
"""Quarters of the pictures below, 24 by 16 pixels, which basisu 1.15 encoded."""

ETC1S = (ROOT / "tests/scenes/meshes/etc1s.ktx2").read_bytes()
UASTC_ZSTANDARD = (ROOT / "tests/scenes/meshes/uastc.ktx2").read_bytes()


def ktx2_file(image: bytes) -> dict[str, Any]:
    described = {"pbrMetallicRoughness": {"baseColorTexture": IMAGE, "metallicRoughnessTexture": IMAGE}}
    tree = file_with({**described, "alphaMode": "BLEND"})
    tree["extensionsRequired"] = ["KHR_texture_basisu"]
    tree["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    tree["images"] = [{"uri": data_uri(image), "mimeType": "image/ktx2"}]
    return tree


@pytest.mark.parametrize(("data", "most"), [(ETC1S, 6), (UASTC_ZSTANDARD, 0)], ids=["etc1s", "uastc"])
def test_ktx2_images_are_decoded_and_damaged_ones_left_out(tmp_path, data, most):
    """ETC1S has base colours of 5 bits, UASTC exact ones."""
    pytest.importorskip("opengl_basisu")
    material = shape_of(tmp_path, ktx2_file(data)).material
    opened = np.asarray(open_ktx2(data))
    off = np.abs(opened.reshape(2, 8, 2, 12, 4).astype(int) - QUARTERS[:, None, :, None])
    assert off.max() <= most
    np.testing.assert_allclose(material.base_color.pixels, linear_from_srgb(opened[:, :, :3] / 255.0), atol=1e-6)
    np.testing.assert_allclose(material.opacity.pixels[:, :, 0], opened[:, :, 3] / 255.0, atol=1e-6)
    random = np.random.default_rng(1)
    for _ in range(100):
        damaged = bytearray(data)
        damaged[random.integers(12, len(data))] = random.integers(256)
        with contextlib.suppress(InputError):
            open_ktx2(bytes(damaged))
    with pytest.warns(InputWarning, match="image 0 left out: it cannot be decoded"):
        shape_of(tmp_path, ktx2_file(data[:-30]))


def test_headers_of_ktx2_are_checked_and_a_missing_decoder_is_named(tmp_path, monkeypatch):
    for data, message in (
        (KTX2_IDENTIFIER, "truncated"),
        (ETC1S[:20] + (2**20).to_bytes(4, "little") * 2 + ETC1S[28:], "too large"),
        (ETC1S[:20] + bytes(4) + ETC1S[24:], "no flat image"),
    ):
        with pytest.raises(InputError, match=message):
            open_ktx2(data)
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    tree = ktx2_file(ETC1S)
    with pytest.warns(InputWarning, match=r"KTX2 images are left out, which need a decoder: pip install 'wrt\[ktx2\]'"):
        assert shape_of(tmp_path, tree).material.base_color == (1.0, 1.0, 1.0)
