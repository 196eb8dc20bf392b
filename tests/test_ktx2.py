"""KTX2 images of Basis Universal are decoded; without the decoder one line says what to install."""

from __future__ import annotations

import base64
import contextlib
import json
import sys

import numpy as np
import pytest
from support.meshes import write

import wrt
from wrt.errors import InputError, InputWarning
from wrt.io.ktx2 import IDENTIFIER, open_ktx2
from wrt.io.load_mesh import load_shapes
from wrt.scene.srgb import linear_from_srgb

CODES = np.array([[[200, 40, 40, 255], [40, 180, 60, 255]], [[30, 60, 190, 255], [220, 210, 90, 96]]], np.uint8)
"""Quarters of the pictures below, 24 by 16 pixels, which basisu 1.15 encoded."""

ETC1S = base64.b64decode(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAYAAAAEAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAADwAAACkAAAAJAAAAMgAAAAAAAAAoQAAAAAAAABpAQAA"
    "AAAAABMAAAAAAAAAAAAAAAAAAAA8AAAAAAAAAAIAOACjAQIAAwMAAAAAAAAAAAAAAAA/AAAAAAAAAAAA/////0AAPw8AAAAAAAAAAP////8fAAAA"
    "S1RYd3JpdGVyAEJhc2lzIFVuaXZlcnNhbCAxLjE1AAAGAAMANgAAAA0AAAA2AAAAAAAAAAAAAAAAAAAACwAAAAsAAAAIAAAAH0CUAAAAAACIA5Ku"
    "A5gaMAAAAAjDLiCI2XIAMQAAAAAAQf6QFwIwBQAAAAAAAmUBqvLGRvQBrKqqqvr///9XVVVVBU3AhIABAABAEPYKzloYAFMABAAAAABIBiIgbsAA"
    "AIMwTMVBDIw5gX4SA2ACQAAAAAAI2gQEAP8uX9PKL2L5TjsNV8drWrEKCAQ="
)
UASTC_ZSTANDARD = base64.b64decode(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAYAAAAEAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAAAAAAAAC4AAAA"
    "AAAAAD0AAAAAAAAAgAEAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAAAAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMg"
    "VW5pdmVyc2FsIDEuMTUAACi1L/1ggACdAQD4FxkF5T/IxgCFluc/MBcB14PH9/9LrQOXW1oLLNp6AQcADSYQlPxMyTziKQCQzRzgBVw="
)
KINDS = {"etc1s": (ETC1S, 6), "uastc": (UASTC_ZSTANDARD, 0)}
"""Files, and how far a code may be from that of the picture: 5-bit base colours, and exact ones."""


def file_with(image: bytes) -> str:
    """Return a glTF file of a triangle whose colour is an image that only KHR_texture_basisu names."""
    numbers = (
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
        + np.array([[0, 0], [1, 0], [0, 1]], "<f4").tobytes()
    )
    uri = "data:application/octet-stream;base64,"
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_texture_basisu"],
            "extensionsRequired": ["KHR_texture_basisu"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [
                {
                    "pbrMetallicRoughness": {
                        "baseColorTexture": {"index": 0},
                        "metallicRoughnessTexture": {"index": 0},
                    },
                    "alphaMode": "BLEND",
                }
            ],
            "textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
            "images": [{"uri": uri + base64.b64encode(image).decode(), "mimeType": "image/ktx2"}],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": 5126,
                    "count": 3,
                    "type": "VEC3",
                    "max": [1, 1, 0],
                    "min": [0, 0, 0],
                },
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 36},
                {"buffer": 0, "byteOffset": 36, "byteLength": 24},
            ],
            "buffers": [{"byteLength": 60, "uri": uri + base64.b64encode(numbers).decode()}],
        }
    )


@pytest.mark.parametrize("kind", KINDS)
def test_images_are_decoded(tmp_path, kind):
    pytest.importorskip("opengl_basisu")
    data, off = KINDS[kind]
    image = open_ktx2(data)
    assert (image.mode, image.size) == ("RGBA", (24, 16))
    quarters = np.asarray(image).reshape(2, 8, 2, 12, 4)
    assert np.abs(quarters.astype(int) - CODES[:, None, :, None]).max() <= off
    (shape,) = load_shapes(write(tmp_path, "one.gltf", file_with(data)))
    assert isinstance(shape.material, wrt.Principled)
    colors = shape.material.base_color.pixels[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(
        colors, linear_from_srgb(np.asarray(image)[[0, 0, -1, -1], [0, -1, 0, -1], :3] / 255.0), atol=1e-6
    )
    np.testing.assert_allclose(shape.material.opacity.pixels[-1, -1], np.asarray(image)[-1, -1, 3] / 255.0, atol=1e-6)


def test_without_the_decoder_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    with pytest.warns(InputWarning) as caught:
        (shape,) = load_shapes(write(tmp_path, "one.gltf", file_with(ETC1S)))
    (line,) = {str(each.message) for each in caught}
    assert line.endswith(
        "one.gltf: textures in KTX2 images are left out, which need a decoder: pip install 'wrt[ktx2]'"
    )
    assert shape.material.base_color == (1.0, 1.0, 1.0)
    with pytest.raises(InputError, match=r"needs a decoder: pip install 'wrt\[ktx2\]'"):
        open_ktx2(ETC1S)


def test_another_image_of_the_texture_needs_no_decoder(tmp_path, monkeypatch, recwarn):
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    tree = json.loads(file_with(ETC1S))
    tree["textures"][0]["source"] = 1
    tree["images"].append({"uri": "beside.png"})
    from PIL import Image

    Image.fromarray(CODES).save(tmp_path / "beside.png")
    (shape,) = load_shapes(write(tmp_path, "one.gltf", json.dumps(tree)))
    assert shape.material.base_color.pixels.shape == (2, 2, 3)
    assert not recwarn.list


def resized(width: int, height: int) -> bytes:
    return ETC1S[:20] + width.to_bytes(4, "little") + height.to_bytes(4, "little") + ETC1S[28:]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (IDENTIFIER, "truncated"),
        (resized(2**20, 2**20), "too large"),
        (resized(0, 16), "no flat image"),
        (ETC1S[:36] + b"\6\0\0\0" + ETC1S[40:], "no flat image"),
    ],
)
def test_headers_are_checked_before_the_decoder(data, message):
    with pytest.raises(InputError, match=message):
        open_ktx2(data)


def test_damaged_images_are_left_out(tmp_path):
    pytest.importorskip("opengl_basisu")
    random = np.random.default_rng(1)
    for data in (ETC1S, UASTC_ZSTANDARD):
        for _ in range(200):
            damaged = bytearray(data)
            damaged[random.integers(12, len(data))] = random.integers(256)
            with contextlib.suppress(InputError):
                open_ktx2(bytes(damaged))
        with pytest.warns(InputWarning, match="image 0 left out: it cannot be decoded"):
            load_shapes(write(tmp_path, "one.gltf", file_with(data[:-30])))
