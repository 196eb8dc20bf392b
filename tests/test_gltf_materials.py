"""Materials of glTF files become the same in wrt: factors, textures, alpha, extensions."""

from __future__ import annotations

import base64
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.meshes import gltf_box, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_shapes
from wrt.scene.srgb import linear_from_srgb

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
UVS = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]], "<f4")
CODES = np.random.default_rng(5).integers(0, 256, (3, 4, 4), dtype=np.uint8)
"""An image with alpha."""
PIXELS = CODES.astype(np.float64) / 255.0


LEFT_OUT = "the textures of material 0 are left out: its mesh has no texture coordinates"


def data_uri(data: bytes, kind: str = "application/octet-stream") -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def png(codes: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, "PNG")
    return buffer.getvalue()


def file_with(material: dict[str, Any], *, uvs: bool = True, colors: np.ndarray | None = None) -> dict[str, Any]:
    """Return a triangle of one material. Texture 0 is the image CODES, texture 1 too, but held and not smoothed."""
    tree = gltf_box(POINTS, np.array([[0, 1, 2]]))
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    tree["meshes"][0]["primitives"][0]["material"] = 0

    def add(name: str, array: np.ndarray, kind: str) -> None:
        tree["buffers"].append({"byteLength": array.nbytes, "uri": data_uri(array.tobytes())})
        tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": array.nbytes})
        tree["accessors"].append(
            {"bufferView": len(tree["bufferViews"]) - 1, "componentType": 5126, "type": kind, "count": len(array)}
        )
        attributes[name] = len(tree["accessors"]) - 1

    if uvs:
        add("TEXCOORD_0", UVS, "VEC2")
    if colors is not None:
        add("COLOR_0", colors.astype("<f4"), "VEC3")
    tree["materials"] = [material]
    tree["images"] = [{"uri": data_uri(png(CODES), "image/png")}]
    tree["samplers"] = [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]
    tree["textures"] = [{"source": 0}, {"source": 0, "sampler": 0}]
    return tree


def loaded(tmp_path: Path, material: dict[str, Any], **options: Any) -> wrt.Shape:
    (shape,) = load_shapes(write(tmp_path, "one.gltf", json.dumps(file_with(material, **options))))
    return shape


def made(tmp_path: Path, material: dict[str, Any], **options: Any) -> wrt.Principled:
    result = loaded(tmp_path, material, **options).material
    assert isinstance(result, wrt.Principled)
    return result


def test_what_is_not_said_is_as_the_format_says(tmp_path):
    material = made(tmp_path, {})
    assert (material.base_color, material.metallic, material.roughness) == ((1.0, 1.0, 1.0), 1.0, 1.0)
    assert (material.ior, material.opacity, material.normal_map) == (1.5, 1.0, None)


def test_images_of_the_same_bytes_are_there_once(tmp_path):
    tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveFactor": [1, 1, 1]})
    tree["materials"][0]["emissiveTexture"] = {"index": 1}
    tree["images"] *= 2
    tree["textures"][1]["source"] = 1
    (shape,) = load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))
    assert shape.material.emission.pixels is shape.material.base_color.pixels


def test_textures_are_read_in_their_color_space_and_channels(tmp_path):
    material = made(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "baseColorFactor": [0.5, 0.25, 1.0, 0.1],
                "metallicRoughnessTexture": {"index": 1},
                "roughnessFactor": 0.5,
            },
            "normalTexture": {"index": 1, "scale": 0.3},
            "occlusionTexture": {"index": 7},
        },
    )
    base, roughness, metallic = material.base_color, material.roughness, material.metallic
    np.testing.assert_allclose(base.pixels, linear_from_srgb(PIXELS[:, :, :3]), atol=1e-6)
    assert base.factor == (0.5, 0.25, 1.0)
    assert (base.wrap, base.filter) == (("repeat", "repeat"), "bilinear")
    np.testing.assert_allclose(roughness.pixels, PIXELS[:, :, :3], atol=1e-6)
    assert (roughness.channel, roughness.factor, roughness.wrap) == ("g", (0.5,) * 3, ("clamp", "mirror"))
    assert (metallic.channel, metallic.factor, metallic.filter) == ("b", (1.0,) * 3, "nearest")
    assert metallic.pixels is roughness.pixels
    np.testing.assert_allclose(material.normal_map.pixels, PIXELS[:, :, :3], atol=1e-6)
    assert (material.normal_map.scale, material.normal_map.wrap) == (0.3, ("clamp", "mirror"))
    assert material.opacity == 1.0  # OPAQUE


@pytest.mark.parametrize(("mode", "cutoff"), [("BLEND", None), ("MASK", 0.5), ("MASK", 0.2)])
def test_alpha(tmp_path, mode, cutoff):
    described = {
        "alphaMode": mode,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.75]},
    }
    if cutoff not in (None, 0.5):
        described["alphaCutoff"] = cutoff
    opacity = made(tmp_path, described).opacity
    np.testing.assert_allclose(opacity.pixels[:, :, 0], PIXELS[:, :, 3], atol=1e-6)
    assert (opacity.channel, opacity.factor, opacity.cutoff) == ("r", (0.75,) * 3, cutoff)
    with pytest.warns(InputWarning, match=LEFT_OUT):
        bare = made(tmp_path, described, uvs=False).opacity
    assert bare == (0.75 if cutoff is None else 1.0)


def test_extensions(tmp_path):
    material = made(
        tmp_path,
        {
            "pbrMetallicRoughness": {"metallicFactor": 0.0},
            "emissiveFactor": [1.0, 0.5, 0.25],
            "extensions": {
                "KHR_materials_ior": {"ior": 1.33},
                "KHR_materials_emissive_strength": {"emissiveStrength": 4.0},
                "KHR_materials_specular": {
                    "specularFactor": 0.8,
                    "specularTexture": {"index": 0},
                    "specularColorFactor": [2.0, 1.0, 0.5],
                },
                "KHR_materials_transmission": {"transmissionFactor": 0.9, "transmissionTexture": {"index": 0}},
                "KHR_materials_clearcoat": {
                    "clearcoatFactor": 0.5,
                    "clearcoatRoughnessFactor": 0.25,
                    "clearcoatRoughnessTexture": {"index": 0},
                },
                "KHR_materials_sheen": {
                    "sheenColorFactor": [0.1, 0.2, 0.3],
                    "sheenColorTexture": {"index": 0},
                    "sheenRoughnessFactor": 0.6,
                },
                "KHR_materials_anisotropy": {"anisotropyStrength": 0.7, "anisotropyRotation": 0.2},
            },
        },
    )
    assert material.ior == 1.33
    assert material.emission == (4.0, 2.0, 1.0)
    np.testing.assert_allclose(material.specular.pixels[:, :, 0], PIXELS[:, :, 3], atol=1e-6)
    assert material.specular.factor == (0.8,) * 3
    assert material.specular_color == (2.0, 1.0, 0.5)
    assert (material.transmission.channel, material.transmission.factor) == ("r", (0.9,) * 3)
    assert material.thin_walled
    assert (material.coat, material.coat_roughness.channel) == (0.5, "g")
    np.testing.assert_allclose(material.sheen_color.pixels, linear_from_srgb(PIXELS[:, :, :3]), atol=1e-6)
    assert (material.sheen_color.factor, material.sheen_roughness) == ((0.1, 0.2, 0.3), 0.6)
    assert (material.anisotropy, material.anisotropy_rotation) == (0.7, 0.2)


def test_a_volume_is_a_body_and_no_sheet(tmp_path):
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": {"thicknessFactor": 0.1},
    }
    material = made(tmp_path, {"extensions": extensions})
    assert (material.thin_walled, material.interior) == (False, None)
    extensions["KHR_materials_volume"] |= {"attenuationDistance": 0.5, "attenuationColor": [0.25, 0.5, 1.0]}
    interior = made(tmp_path, {"extensions": extensions}).interior
    # After half a metre that colour is left.
    np.testing.assert_allclose(np.exp(-0.5 * np.array(interior.absorption)), [0.25, 0.5, 1.0], rtol=1e-6)


def test_dispersion_is_that_of_a_body(tmp_path):
    dispersion = {"KHR_materials_dispersion": {"dispersion": 0.36}}
    sheet = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    body = sheet | {"KHR_materials_volume": {"thicknessFactor": 0.1}}
    assert made(tmp_path, {"extensions": dispersion | body}).dispersion == 0.36
    assert made(tmp_path, {"extensions": dispersion | sheet}).dispersion == 0.0
    assert made(tmp_path, {"extensions": dispersion}).dispersion == 0.0
    assert made(tmp_path, {"extensions": body | {"KHR_materials_dispersion": {}}}).dispersion == 0.0


def test_iridescence_is_a_film(tmp_path):
    def film(**values):
        return made(tmp_path, {"extensions": {"KHR_materials_iridescence": values}})

    plain = film(iridescenceFactor=0.5)
    assert (plain.film, plain.film_ior, plain.film_thickness) == (0.5, 1.3, 400.0)
    assert not film(iridescenceIor=2.0).has_film
    # The name of the published extension, and that of its drafts
    assert film(iridescenceFactor=1.0, iridescenceIor=2.0).film_ior == 2.0
    assert film(iridescenceFactor=1.0, iridescenceIOR=1.7).film_ior == 1.7
    thick = {"iridescenceThicknessMinimum": 200.0, "iridescenceThicknessMaximum": 800.0}
    assert film(iridescenceFactor=1.0, **thick).film_thickness == 800.0
    for least, most in ((200.0, 800.0), (800.0, 200.0)):
        found = film(
            iridescenceFactor=0.5,
            iridescenceTexture={"index": 0},
            iridescenceIor=1.8,
            iridescenceThicknessMinimum=least,
            iridescenceThicknessMaximum=most,
            iridescenceThicknessTexture={"index": 0},
        )
        assert (found.film.channel, found.film.factor, found.film_ior) == ("r", (0.5,) * 3, 1.8)
        thickness = found.film_thickness
        nanometres = thickness.pixels[:, :, "rgb".index(thickness.channel)] * thickness.factor[0]
        np.testing.assert_allclose(nanometres, least + (most - least) * PIXELS[:, :, 1], rtol=1e-5)


def test_emission_with_a_texture_and_without_light(tmp_path):
    emission = made(tmp_path, {"emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": {"index": 0}}).emission
    np.testing.assert_allclose(emission.pixels, linear_from_srgb(PIXELS[:, :, :3]), atol=1e-6)
    assert emission.factor == (1.0, 0.5, 0.0)
    described = {
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 1.0]},
        "extensions": {"KHR_materials_unlit": {}},
    }
    shape = loaded(tmp_path, described)
    assert shape.material == wrt.Emissive((0.5, 0.25, 0.125))
    assert shape.emission == (0.5, 0.25, 0.125)


@pytest.mark.parametrize("double", [False, True])
def test_double_sided_materials_shine_on_both_sides(tmp_path, double):
    for described in ({"extensions": {"KHR_materials_unlit": {}}}, {"emissiveFactor": [1, 1, 1]}):
        shape = loaded(tmp_path, {"doubleSided": double, **described})
        assert shape.two_sided_emission == double
        text = '[[shapes]]\ntype = "mesh"\nfile = "one.gltf"\n'
        for line, expected in (("", double), ("two_sided_emission = false", False)):
            (again,) = wrt.load(write(tmp_path, "one.toml", text + line)).shapes
            assert again.two_sided_emission == expected
    assert not loaded(tmp_path, {"doubleSided": True}).two_sided_emission


def test_specular_glossiness_is_a_dielectric_with_a_tint(tmp_path):
    gloss = {
        "diffuseFactor": [0.2, 0.4, 0.6, 0.5],
        "specularFactor": [0.04, 0.4, 1.0],
        "glossinessFactor": 0.75,
        "specularGlossinessTexture": {"index": 0},
    }
    described = {"alphaMode": "BLEND", "extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}}
    with pytest.warns(InputWarning, match=LEFT_OUT):
        material = made(tmp_path, described, uvs=False)
    assert (material.base_color, material.metallic, material.opacity) == ((0.2, 0.4, 0.6), 0.0, 0.5)
    assert material.roughness == 0.25
    assert material.specular_color == pytest.approx((1.0, 10.0, 25.0))
    laid = made(tmp_path, {"extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}})
    np.testing.assert_allclose(laid.roughness.pixels[:, :, 0], 1.0 - 0.75 * PIXELS[:, :, 3], atol=1e-6)
    assert laid.specular_color.factor == pytest.approx((1.0, 10.0, 25.0))


def test_vertex_colors_multiply(tmp_path):
    colors = np.array([[1.0, 0.5, 0.25]] * 3)
    described = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.1, 1.0]}}
    shape = loaded(tmp_path, described, colors=colors)
    assert isinstance(shape.material.base_color, wrt.VertexColor)
    np.testing.assert_allclose(shape.mesh.colors, colors * [0.5, 0.5, 0.1], rtol=1e-6)
    described["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    shape = loaded(tmp_path, described, colors=colors)
    assert shape.material.base_color.vertex_colors
    assert shape.material.base_color.factor == (1.0, 1.0, 1.0)
    np.testing.assert_allclose(shape.mesh.colors, colors * [0.5, 0.5, 0.1], rtol=1e-6)


def in_file(uv: np.ndarray, transform: dict[str, Any]) -> np.ndarray:
    """Return coordinates by the matrices that the extension's text gives, v downwards."""
    c, s = np.cos(transform["rotation"]), np.sin(transform["rotation"])
    move = np.array([[1, 0, transform["offset"][0]], [0, 1, transform["offset"][1]], [0, 0, 1]])
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    scale = np.diag([*transform["scale"], 1.0])
    return (np.column_stack([uv, np.ones(len(uv))]) @ (move @ turn @ scale).T)[:, :2]


def test_texture_transforms(tmp_path):
    transform = {"offset": [0.2, -0.4], "rotation": 0.7, "scale": [2.0, 0.5]}
    expected = in_file(UVS, transform) * [1, -1] + [0, 1]
    placed = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    # One for all textures: in the mesh, where normal maps find it too.
    shape = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": placed}})
    np.testing.assert_allclose(shape.mesh.uvs, expected, atol=1e-6)
    assert shape.material.base_color.offset == (0.0, 0.0)
    # Of several: each its own.
    both = {"baseColorTexture": placed, "metallicRoughnessTexture": {"index": 0}}
    shape = loaded(tmp_path, {"pbrMetallicRoughness": both})
    np.testing.assert_allclose(shape.mesh.uvs, UVS * [1, -1] + [0, 1], atol=1e-6)
    matrix = shape.material.base_color.placement
    np.testing.assert_allclose(shape.mesh.uvs @ matrix[:, :2].T + matrix[:, 2], expected, atol=1e-6)
    np.testing.assert_allclose(shape.material.roughness.placement, np.eye(2, 3))


def test_what_cannot_be_read_is_told_and_left_out(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    tree = file_with(
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.5, 0.5, 1]}}
    )
    good = tree["images"][0]["uri"]
    for uri, message in (
        ("missing.png", r"missing\.png', which it refers to: no such file"),
        (good[:60], "image 0 left out: it cannot be decoded|a data URI in it is damaged"),
        (data_uri(b"no image"), "image 0 left out: it cannot be decoded"),
    ):
        tree["images"][0]["uri"] = uri
        with pytest.warns(InputWarning, match=message):
            (shape,) = load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))
        assert shape.material.base_color == (0.5, 0.5, 0.5)
    with pytest.warns(InputWarning, match="diffuse transmission of material 0 is left out"):
        made(tmp_path, {"extensions": {"KHR_materials_diffuse_transmission": {}}})
    tree["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    with pytest.warns(InputWarning, match=r"textures in KTX2 images are left out, which need a decoder"):
        load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))
    tree["textures"][0]["source"] = 0  # the same for programs without a decoder
    tree["images"][0]["uri"] = good
    assert isinstance(
        load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))[0].material.base_color, wrt.ImageTexture
    )


def test_variants_that_are_not_shown_are_named(tmp_path):
    tree = file_with({})
    tree["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "red"}, {"name": "blue"}]}}
    with pytest.warns(InputWarning, match=r"material variants are left out \('red', 'blue'\)"):
        load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))


def test_a_number_where_a_texture_should_be_is_refused(tmp_path):
    tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": {"index": 12}}})
    with pytest.raises(wrt.InputError, match="damaged or not as specified"):
        load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))
