"""Colours of glTF files: textures, alpha of vertex colours, second texture coordinates."""

from __future__ import annotations

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import map_coordinates
from support.mesh_files import add, data_uri, saved
from support.meshes import gltf_box
from support.small_scenes import image_of

import wrt
from wrt.backend.device import Device
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file
from wrt.upload.scene_data import build_scene

Array = NDArray[Any]

# --- Squares -----------------------------------------------------------------------------------------

POINTS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
FACES = np.array([0, 1, 2, 0, 2, 3], "<u2")
UVS = np.array([[0.13, 0.9], [0.9, 0.9], [0.9, 0.1], [0.1, 0.1]], "<f4")
SECOND = np.array([[0.1, 0.1], [0.1, 1.4], [0.6, 0.9], [0.7, 0.1]], "<f4")
COLORS = np.array([[255, 128, 0, 0], [0, 255, 128, 255], [255, 255, 255, 128], [64, 32, 255, 200]], "<u1")
CODES = np.random.default_rng(12).integers(0, 256, (2, 2, 4), dtype=np.uint8)
ORANGE = (255, 128, 64)
SIZE, CROP = 48, (4, 44)
"""Pixels along a side, and those of them that see nothing but the front square."""
FOV, DISTANCE = 0.7, 3.0


def png(codes: Array) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, "PNG")
    return buffer.getvalue()


def file_of(folder: Path, material: dict[str, Any], sampler: dict[str, int] | None = None, **attributes: Array) -> Path:
    """Return a glTF file of a square in front of another, which is opaque, and a camera that looks at both.

    Texture 0 is CODES, texture 1 an orange.
    """
    tree = gltf_box(POINTS, FACES)
    accessors = {key: add(tree, v, v.dtype.str, normalized=v.dtype.kind == "u") for key, v in attributes.items()}
    near, far = {"POSITION": 0, **accessors}, {"POSITION": 0, "TEXCOORD_0": accessors["TEXCOORD_0"]}
    unlit = {"extensions": {"KHR_materials_unlit": {}}}
    tree |= {
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"mesh": 0},
            {"mesh": 1, "translation": [0, 0, -1], "scale": [2, 2, 1]},
            {"camera": 0, "translation": [0, 0, DISTANCE]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": FOV, "znear": 0.1}}],
        "meshes": [
            {"primitives": [{"attributes": each, "indices": 1, "material": number}]}
            for number, each in enumerate((near, far))
        ],
        "materials": [{**unlit, **material}, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}, **unlit}],
        "textures": [{"source": 0, **({} if sampler is None else {"sampler": 0})}, {"source": 1}],
        "samplers": [sampler or {}],
        "images": [{"uri": data_uri(png(codes), "image/png")} for codes in (CODES, np.uint8([[ORANGE]]))],
    }
    return saved(folder, tree)


def textured(texture: dict[str, Any], **factors: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}, **factors}}


CASES: dict[str, tuple[dict[str, Any], dict[str, Array]]] = {
    "cut off": ({"alphaMode": "MASK", "alphaCutoff": 0.3, **textured({})}, {"COLOR_0": COLORS}),
    "with a factor": (
        {"alphaMode": "BLEND", **textured({}, baseColorFactor=[1.0, 0.5, 0.7, 0.8])},
        {"COLOR_0": (COLORS / 255.0).astype("<f4")},
    ),
    # The first set places the normal texture, which shows nowhere without light.
    "by the second set": (
        {"alphaMode": "BLEND", **textured({"texCoord": 1}), "normalTexture": {"index": 1}},
        {"TEXCOORD_1": SECOND},
    ),
}


def srgb_to_linear(codes: Array) -> Array:
    """IEC 61966-2-1."""
    c = codes / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(value: Array) -> Array:
    return 255.0 * np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.maximum(value, 1e-9) ** (1.0 / 2.4) - 0.055)


def expected(material: dict[str, Any], attributes: dict[str, Array], shift: tuple[float, float]) -> Array:
    """Return the sRGB codes of the front square over the one behind, through points `shift` from middles of pixels.

    KHR_materials_unlit: the colour is the vertex colour times the factor times the texture, whose origin is its upper
    left corner (Khronos Group 2021, "glTF 2.0 Specification", section 3.8.4).
    """
    across, down = (2.0 * (np.arange(*CROP) + 0.5 + s) / SIZE - 1.0 for s in shift)
    x, y = np.meshgrid(DISTANCE * np.tan(0.5 * FOV) * across, -DISTANCE * np.tan(0.5 * FOV) * down)
    # Of the corners, in the triangle of the first three and in the other one.
    weights = np.where(y < x, [1.0 - x, x - y, 1.0 + y, 0.0 * x], [1.0 - y, 0.0 * x, 1.0 + x, y - x]).transpose(1, 2, 0)
    info = material["pbrMetallicRoughness"]
    u, v = np.moveaxis(0.5 * weights @ attributes.get("TEXCOORD_1", UVS), -1, 0)
    image = np.dstack([srgb_to_linear(CODES[..., :3]), CODES[..., 3:] / 255.0])
    place = (v * len(image) - 0.5, u * len(image) - 0.5)
    texture = [map_coordinates(image[..., k], place, order=1, mode="grid-wrap") for k in range(4)]
    colors = attributes.get("COLOR_0", np.ones((4, 4)))
    rgba = 0.5 * weights @ (colors / (255.0 if colors.dtype == np.uint8 else 1.0)) * np.stack(texture, axis=-1)
    rgba *= info.get("baseColorFactor", 1.0)
    alpha = rgba[..., 3:] >= material["alphaCutoff"] if material["alphaMode"] == "MASK" else rgba[..., 3:]
    return linear_to_srgb(alpha * rgba[..., :3] + (1.0 - alpha) * srgb_to_linear(np.array(ORANGE)))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_squares_have_the_colors_that_the_specification_gives(name: str, tmp_path: Path, report: Report) -> None:
    """Pixels over the edges of masks and texels aside, all are right to 2 of 255 steps.

    Ray trees follow all that is partly there, without noise.
    """
    material, attributes = CASES[name]
    scene = load_file(file_of(tmp_path, material, TEXCOORD_0=UVS, **attributes))
    options = {"width": SIZE, "height": SIZE, "crop": (CROP[0], CROP[0], CROP[1], CROP[1]), "filter": "box"}
    renderer = wrt.Renderer(scene, integrator="whitted", **options)
    found = linear_to_srgb(image_of(renderer, 16).astype(np.float64))

    def around(reach: float) -> Array:
        return np.stack([expected(material, attributes, s) for s in itertools.product((-reach, 0.0, reach), repeat=2)])

    # Pixels across the edge of a mask are left out; all else changes evenly.
    flat = np.ptp(around(0.6), axis=0).max(axis=-1) < (3.0 if material["alphaMode"] == "MASK" else 30.0)
    off = np.abs(found - around(1.0 / 3.0).mean(axis=0)).max(axis=-1)[flat]
    report(f"{name}: pixels; mean and largest difference in steps", f"{flat.sum()}; {off.mean():.3g}, {off.max():.3g}")
    assert flat.sum() > 500
    assert off.max() <= 2.0


def test_textures_by_two_sets(tmp_path: Path) -> None:
    """Each has its set and its transform, in scene files too; the first set places the normal texture."""
    transform = {"KHR_texture_transform": {"offset": [0.25, 0.0], "scale": [2.0, 1.0]}}
    material = textured({"texCoord": 1, "extensions": transform}, metallicRoughnessTexture={"index": 1})
    material |= {"normalTexture": {"index": 0}, "extensions": {}, "alphaMode": "BLEND"}
    path = file_of(tmp_path, material, TEXCOORD_0=UVS, TEXCOORD_1=SECOND, COLOR_0=COLORS)
    wrt.save_scene(tmp_path / "scene.toml", load_file(path))
    shape = wrt.load(tmp_path / "scene.toml").shapes[0]
    assert (shape.material.opacity.uv_set, shape.material.opacity.vertex_alpha) == (1, True)
    turned = np.concatenate([UVS, SECOND], axis=1) * (1, -1, 1, -1) + (0, 1, 0, 1)
    np.testing.assert_allclose(shape.mesh.uvs, turned, atol=1e-6)
    base, roughness = shape.material.base_color, shape.material.roughness
    assert (base.uv_set, roughness.uv_set) == (1, 0)
    np.testing.assert_allclose(base.placement, [[2, 0, 0.25], [0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(roughness.placement, np.eye(2, 3))
    with pytest.warns(InputWarning, match="there is no TEXCOORD_1, by which textures of material 0 lie"):
        shape = load_file(file_of(tmp_path, material, TEXCOORD_0=UVS)).shapes[0]
    assert shape.material.base_color == (1.0, 1.0, 1.0)
    assert shape.mesh.uvs.shape == (4, 2)


@pytest.mark.parametrize(
    ("sampler", "filter"),
    [
        ({}, "bilinear"),
        ({"minFilter": 9985}, "trilinear"),
        ({"minFilter": 9987, "magFilter": 9728}, "nearest"),
    ],
)
def test_samplers_say_whether_they_want_levels(tmp_path: Path, sampler: dict[str, int], filter: str) -> None:
    material = {**textured({}), "extensions": {}}
    shape = load_file(file_of(tmp_path, material, sampler, TEXCOORD_0=UVS)).shapes[0]
    assert shape.material.base_color.filter == filter


def test_meshes_without_alpha_and_opaque_materials_are_opaque(tmp_path: Path) -> None:
    mesh = wrt.Mesh(POINTS, FACES.reshape(2, 3))
    scene = wrt.Scene([wrt.Shape(mesh, wrt.Diffuse(opacity=wrt.VertexColor(alpha=True)))])
    np.testing.assert_array_equal(build_scene(scene, Device("cpu")).data.uv2_alpha.numpy(), [[0, 0, 1]] * 4)
    opaque = load_file(file_of(tmp_path, textured({}), TEXCOORD_0=UVS, COLOR_0=COLORS)).shapes[0].material
    assert opaque.opacity == 1.0
    assert opaque.radiance.vertex_colors
