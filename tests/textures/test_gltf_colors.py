"""Colours of glTF files: second texture coordinates, samplers, and the alpha of vertex colours."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.mesh_files import add, data_uri, saved
from support.meshes import gltf_box

import wrt
from wrt.backend.device import Device
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file
from wrt.upload.scene_data import SceneUpload

POINTS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
FACES = np.array([0, 1, 2, 0, 2, 3], "<u2")
UVS = np.array([[0.13, 0.9], [0.9, 0.9], [0.9, 0.1], [0.1, 0.1]], "<f4")
SECOND = np.array([[0.1, 0.1], [0.1, 1.4], [0.6, 0.9], [0.7, 0.1]], "<f4")
COLORS = np.array([[255, 128, 0, 0], [0, 255, 128, 255], [255, 255, 255, 128], [64, 32, 255, 200]], "<u1")
UNLIT = {"KHR_materials_unlit": {}}


def png(*codes: int) -> str:
    buffer = io.BytesIO()
    Image.fromarray(np.uint8([[codes]])).save(buffer, "PNG")
    return data_uri(buffer.getvalue(), "image/png")


def textured(texture: dict[str, Any], **factors: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}, **factors}}


def scene_of(
    folder: Path, material: dict[str, Any], sampler: dict[str, int] | None = None, **attributes: Any
) -> wrt.Scene:
    """Return the scene of a glTF file of a square. Its texture 0 has an alpha, its texture 1 none."""
    tree = gltf_box(POINTS, FACES)
    accessors = {key: add(tree, v, v.dtype.str, normalized=v.dtype.kind == "u") for key, v in attributes.items()}
    tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, **accessors}, "indices": 1, "material": 0}]}]
    tree |= {
        "materials": [material],
        "textures": [{"source": 0, **({} if sampler is None else {"sampler": 0})}, {"source": 1}],
        "samplers": [sampler or {}],
        "images": [{"uri": png(9, 99, 200, 100)}, {"uri": png(255, 128, 64)}],
    }
    return load_file(saved(folder, tree))


def test_textures_by_two_sets(tmp_path: Path) -> None:
    """Each has its set and its transform, in scene files too; the first set places the normal texture."""
    transform = {"KHR_texture_transform": {"offset": [0.25, 0.0], "scale": [2.0, 1.0]}}
    material = textured({"texCoord": 1, "extensions": transform}, metallicRoughnessTexture={"index": 1})
    material |= {"normalTexture": {"index": 0}, "alphaMode": "BLEND"}
    scene = scene_of(tmp_path, material, TEXCOORD_0=UVS, TEXCOORD_1=SECOND, COLOR_0=COLORS)
    wrt.save_scene(tmp_path / "scene.toml", scene)
    shape: Any = wrt.load(tmp_path / "scene.toml").shapes[0]
    assert (shape.material.opacity.uv_set, shape.material.opacity.vertex_alpha) == (1, True)
    turned = np.concatenate([UVS, SECOND], axis=1) * (1, -1, 1, -1) + (0, 1, 0, 1)
    np.testing.assert_allclose(shape.mesh.uvs, turned, atol=1e-6)
    base, roughness = shape.material.base_color, shape.material.roughness
    assert (base.uv_set, roughness.uv_set) == (1, 0)
    np.testing.assert_allclose(base.placement, [[2, 0, 0.25], [0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(roughness.placement, np.eye(2, 3))
    with pytest.warns(InputWarning, match="there is no TEXCOORD_1, by which textures of material 0 lie"):
        shape = scene_of(tmp_path, material, TEXCOORD_0=UVS).shapes[0]
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
    material: Any = scene_of(tmp_path, textured({}), sampler, TEXCOORD_0=UVS).shapes[0].material
    assert material.base_color.filter == filter


def test_meshes_without_alpha_and_opaque_materials_are_opaque(tmp_path: Path) -> None:
    mesh = wrt.Mesh(POINTS, FACES.reshape(2, 3))
    scene = wrt.Scene([wrt.Shape(mesh, wrt.Diffuse(opacity=wrt.VertexColor(alpha=True)))])
    np.testing.assert_array_equal(SceneUpload(scene, Device("cpu")).finish().data.uv2_alpha.numpy(), [[0, 0, 1]] * 4)
    unlit = {**textured({}), "extensions": UNLIT}
    material: Any = scene_of(tmp_path, unlit, TEXCOORD_0=UVS, COLOR_0=COLORS).shapes[0].material
    assert material.opacity == 1.0
    assert material.radiance.vertex_colors
