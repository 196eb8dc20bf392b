"""Images of 8 bits take four bytes a texel on the device, and not one bit of their colours changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from test_textures import coordinates, looked_up

import wrt
from wrt.backend.device import Device
from wrt.kernels.scene.scene_data import SceneData
from wrt.scene.srgb import of_codes
from wrt.upload.materials import describe_materials
from wrt.upload.textures import texels
from wrt.upload.textures.normal_maps import normals_of
from wrt.upload.textures.texels import FEWEST_TEXELS, Texels, codes_of

CODES = np.random.default_rng(5).integers(0, 256, (40, 33, 3), dtype=np.uint8)
COLORS = of_codes(linear=False)[CODES]
FLOATS = np.random.default_rng(6).random((40, 33, 3)).astype(np.float32)


def uploaded(*materials: wrt.Material) -> SceneData:
    data = SceneData()
    describe_materials(list(materials)).upload(data, Device("cpu"))
    return data


def decoded(found: Texels) -> NDArray[np.float32]:
    """Return (N, 3) what the codes of one image stand for."""
    bytes_ = found.codes.astype("<u4").view(np.uint8).reshape(-1, 4)
    assert not bytes_[:, 3].any()
    return np.stack([found.palettes[k][bytes_[:, k]] for k in range(3)], axis=1)


@pytest.mark.parametrize(
    "pixels",
    [
        COLORS,
        of_codes(linear=True)[CODES],
        COLORS * np.float32((0.3, 0.7, 1.1)),
        normals_of(wrt.NormalMap(of_codes(linear=True)[np.maximum(CODES, 140)], scale=0.7)),
        np.float32(1.0) - np.float32(0.6) * of_codes(linear=True)[CODES],
        np.full((40, 40, 3), 3.7e-12, np.float32),
    ],
    ids=["sRGB", "linear", "tinted", "normals", "inverted", "one value"],
)
def test_few_values_become_codes_that_give_the_same_bits(pixels: NDArray[np.float32]) -> None:
    found = Texels([pixels])
    assert len(found.colors) == 0
    np.testing.assert_array_equal(decoded(found).view(np.uint32), pixels.reshape(-1, 3).view(np.uint32))


def test_many_values_stay_as_they_are() -> None:
    one_more = np.arange(300 * 4, dtype=np.float32) % 257
    for pixels in (FLOATS, np.repeat(one_more, 3).reshape(40, 30, 3)):
        found = Texels([pixels])
        assert len(found.codes) == 0
        np.testing.assert_array_equal(found.colors, pixels.reshape(-1, 3))
    # Also where they begin late: what was looked at before is of no use then.
    late = np.zeros(200_000, np.float32)
    late[-257:] = np.arange(257)
    assert codes_of(late) is None
    fewer = codes_of(late[:-1])
    assert fewer is not None
    np.testing.assert_array_equal(fewer[1][fewer[0]], late[:-1])


def test_an_image_of_8_bits_takes_four_bytes_a_texel() -> None:
    data = uploaded(
        wrt.Diffuse(wrt.ImageTexture(COLORS)),
        wrt.Principled(roughness=wrt.ImageTexture(of_codes(linear=True)[CODES], channel="g")),
        wrt.Diffuse(wrt.ImageTexture(COLORS[::-1])),
    )
    assert len(data.texels) == 0
    assert len(data.texel_codes) == 3 * CODES.shape[0] * CODES.shape[1]
    assert data.texel_codes.dtype.__name__ == "uint32"
    assert len(data.palettes) == 2 * 3 * 256  # the third has that of the first


def test_small_and_floating_point_images_stay_as_they_are() -> None:
    small = COLORS[:5, :7]
    assert small.shape[0] * small.shape[1] < FEWEST_TEXELS
    data = uploaded(wrt.Diffuse(wrt.ImageTexture(small)), wrt.Diffuse(wrt.ImageTexture(FLOATS)))
    assert len(data.texel_codes) == 0
    assert len(data.texels) == 5 * 7 + FLOATS.shape[0] * FLOATS.shape[1]


@pytest.mark.parametrize("filter", ["bilinear", "nearest"])
def test_what_materials_read_is_the_same_to_the_bit(filter: str, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    texture = wrt.ImageTexture(COLORS, scale=(0.7, 1.6), rotation_degrees=33.0, wrap=("mirror", "clamp"), filter=filter)
    uvs = coordinates(7)
    coded = looked_up(texture, uvs, device)
    monkeypatch.setattr(texels, "FEWEST_TEXELS", 10**9)
    np.testing.assert_array_equal(coded, looked_up(texture, uvs, device))
    monkeypatch.undo()
    # Of another image there must be a difference, were it one code.
    changed = CODES.copy()
    changed[20, 20, 2] ^= 1
    other = wrt.ImageTexture(of_codes(linear=False)[changed], scale=(0.7, 1.6), rotation_degrees=33.0,
                             wrap=("mirror", "clamp"), filter=filter)  # fmt: skip
    assert (coded != looked_up(other, uvs, device)).any()
