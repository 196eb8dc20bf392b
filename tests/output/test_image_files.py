"""Pictures are written exactly and all or nothing, and read back as linear light."""

import io
import os
import re
import struct
import zlib

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import wrt
from wrt.develop.picture import develop_image
from wrt.io.images import check_output, load_environment, load_image, save_image
from wrt.scene.srgb import linear_from_srgb, srgb_from_linear

NOISE = np.random.default_rng(5).random((13, 17, 3)).astype(np.float32)


def codes_of(path):
    with Image.open(path) as image:
        return np.asarray(image)


def refused(message, call, *arguments, **options):
    with pytest.raises(wrt.InputError, match=message):
        call(*arguments, **options)


def test_srgb_curve_has_its_published_values_and_inverse():
    # IEC 61966-2-1: half of the code range is 21.4 % of the light; the two pieces meet at 0.0031308.
    assert linear_from_srgb(0.5) == pytest.approx(0.21404114, abs=1e-8)
    assert srgb_from_linear(0.0031308) == pytest.approx(0.04045, abs=1e-5)
    assert srgb_from_linear(0.18) == pytest.approx(0.46135612, abs=1e-7)
    x = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(linear_from_srgb(srgb_from_linear(x)), x, atol=1e-7)


@pytest.mark.parametrize("name", ["a.npy", "A.EXR"])
def test_float_formats_keep_every_bit(tmp_path, name):
    image = NOISE * 1e3 - 100.0
    image[0, 0] = (np.inf, 1e-30, 6e4)
    save_image(tmp_path / name, image, exposure=3.0, metadata={"spp": 12})
    np.testing.assert_array_equal(load_image(tmp_path / name), image)
    assert name != "A.EXR" or OpenEXR.File(str(tmp_path / name)).header()["spp"] == "12"


def test_png_keeps_every_code_and_clips(tmp_path):
    codes = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    codes.reshape(-1)[:256] = np.arange(256)
    path = tmp_path / "a.png"
    for image in (linear_from_srgb(codes / 255.0), None):
        save_image(path, load_image(path) if image is None else image)
        np.testing.assert_array_equal(codes_of(path), codes)
    save_image(path, np.array([[[-1.0, 0.0, 1.0], [2.0, np.inf, np.nan]]]), tone="none", exposure=0.0)
    np.testing.assert_array_equal(codes_of(path), [[[0, 0, 255], [255, 255, 0]]])


def test_jpeg_has_the_codes_of_png(tmp_path):
    """At quality 95, without chroma subsampling: colours that change from pixel to pixel stay."""
    path, image = tmp_path / "a.JPEG", NOISE.copy()
    image[:, ::2, 2] = 0.0
    developed = save_image(path, image, tone="aces", exposure=0.5, metadata={"spp": 12, "scène": "boîte"})
    with Image.open(path) as picture:
        assert [component[1:3] for component in picture.layer] == [(1, 1)] * 3
        printed = dict(line.split(": ", 1) for line in picture.info["comment"].decode().splitlines())
    Image.fromarray(developed.codes).save(tmp_path / "expected.jpg", quality=95, subsampling=0)
    np.testing.assert_array_equal(codes_of(path), codes_of(tmp_path / "expected.jpg"))
    developed_by = {"Tone": "aces", "Exposure": "0.5 stops"}
    assert printed == {"Software": f"wrt {wrt.__version__}", "spp": "12", "scène": "boîte", **developed_by}
    jpeg = tmp_path / "b.jpg"
    refused(r"b\.jpg: a JPEG has no alpha; .* \.png or \.exr", save_image, jpeg, np.ones((4, 4, 4)))
    refused(r"b\.jpg: the metadata of a JPEG", save_image, jpeg, NOISE, metadata={"long": "x" * 70_000})
    assert not jpeg.exists()


def test_dither_keeps_the_mean_and_leaves_no_bands():
    def quantized(image):
        return develop_image(image, tone="none", exposure=0.0)

    levels = np.linspace(0.05, 0.95, 19)
    value = linear_from_srgb((100 + levels) / 255.0)
    image = np.broadcast_to(value[:, None, None, None], (19, 128, 128, 3)).reshape(-1, 128, 3)
    codes = quantized(image).reshape(19, -1)
    assert set(np.unique(codes)) == {100, 101}
    # 49152 coin flips: the mean lies within 5 standard deviations of the value.
    np.testing.assert_allclose(codes.mean(axis=1) - 100, levels, atol=5 * 0.5 / 49152**0.5)
    # Neighbours and channels are decided independently of each other.
    half = quantized(np.full((256, 256, 3), linear_from_srgb(100.5 / 255.0))).astype(float) - 100.5
    for axis in range(3):
        assert abs((half * np.roll(half, 1, axis=axis)).mean()) < 0.25 * 5 / half.size**0.5


def test_outputs_that_could_not_be_written_are_refused_before(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    for name, message in (
        ("a.gif", r"must end in one of \.png, \.jpg, \.jpeg, \.exr, \.npy"),
        ("none/a.png", "does not exist"),
        ("file/a.png", "is not a folder"),
    ):
        refused(message, check_output, tmp_path / name)
    monkeypatch.setattr(os, "access", lambda *_: False)
    refused("may not be written to", check_output, tmp_path / "a.png")
    monkeypatch.undo()
    refused(r"must be \(H, W, 3\)", save_image, tmp_path / "a.png", np.zeros((4, 4, 2)))
    refused(r"^a picture is written to a path, not to BytesIO; .*wrt.develop_image", save_image, io.BytesIO(), NOISE)
    codes = np.full((2, 2, 3), 200, np.uint8)
    for name in ("a.png", "a.exr", "a.npy"):
        refused(f"{name}: an image must be linear numbers, not codes up to 200", save_image, tmp_path / name, codes)
    assert (wrt.develop_image(np.ones((2, 2, 3), np.uint8), tone="none") == 255).all()


def test_eight_bit_modes_decode_alike_and_sixteen_bits_are_read(tmp_path):
    path, grey = tmp_path / "a.png", np.array([[0, 10, 128, 255]], np.uint8)
    expected = np.repeat(linear_from_srgb(grey / 255.0)[:, :, None], 3, axis=2).astype(np.float32)
    for mode in ("L", "LA", "RGB", "RGBA", "P"):
        Image.fromarray(grey).convert(mode).save(path)
        np.testing.assert_array_equal(load_image(path), expected, err_msg=mode)
    np.testing.assert_allclose(load_image(path, linear=True)[0, :, 0], grey[0] / 255.0, rtol=1e-6)
    values = np.array([[0, 1, 257, 32768, 65535]], np.uint16)  # keep their depth
    Image.fromarray(values).save(path)
    np.testing.assert_array_equal(load_image(path)[:, :, 1], linear_from_srgb(values / 65535.0).astype(np.float32))


def test_float_formats_and_shared_exponents_are_linear(tmp_path):
    values = np.array([[0.25, 4.0, -1.0]], np.float32)
    Image.fromarray(values).save(tmp_path / "a.tif")
    np.testing.assert_array_equal(load_image(tmp_path / "a.tif")[:, :, 2], values)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for channel in "YZ":
        OpenEXR.File(header, {channel: values}).write(str(tmp_path / f"{channel}.exr"))
    np.testing.assert_array_equal(load_image(tmp_path / "Y.exr")[:, :, 0], values)
    refused(r"Z\.exr: no channels R, G, B or Y in it, only Z", load_image, tmp_path / "Z.exr")
    # Ward 1991: (mantissa + 0.5 or 0) / 256 * 2^(exponent - 128); the mantissas here are exact.
    pixels = bytes([128, 64, 32, 129, 255, 0, 1, 136, 0, 0, 0, 0])
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 3\n" + pixels)
    expected = [[[1.0, 0.5, 0.25], [255.0, 0.0, 1.0], [0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(load_image(tmp_path / "a.hdr"), expected, rtol=0.005)


def test_other_files_are_refused_as_images(tmp_path, capfd):
    refused("^an image is read from a path, not from BytesIO$", load_image, io.BytesIO())
    for suffix in ("png", "jpg", "exr", "hdr", "npy", "txt"):
        path = tmp_path / f"a.{suffix}"
        path.write_bytes(b"not an image at all")
        refused(rf"^{re.escape(str(path))}: (?!.*{re.escape(str(path))})[^\n]+\Z", load_image, path)
    save_image(tmp_path / "b.exr", NOISE - 2.0)
    refused(r"b\.exr: .*not negative", load_environment, tmp_path / "b.exr")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_truncated_images_are_refused_or_complete(tmp_path, name, capfd):
    path = tmp_path / name
    save_image(path, NOISE)
    pixels, data = load_image(path), path.read_bytes()
    refusals = 0
    for length in np.linspace(1, len(data) - 1, 20).astype(int):
        path.write_bytes(data[:length])
        try:
            # Past the last pixel PNG has checksums, which decoders may do without.
            np.testing.assert_array_equal(load_image(path), pixels)
        except wrt.InputError:
            refusals += 1
    assert refusals >= 18
    assert capfd.readouterr() == ("", "")


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@pytest.mark.parametrize("mode", ["1", "P", "RGB"])
def test_png_files_cannot_have_more_pixels_than_their_bytes_stand_for(tmp_path, mode):
    path = tmp_path / "even.png"
    Image.new(mode, (1500, 1000)).save(path, optimize=True)  # nothing packs better
    assert load_image(path).shape == (1000, 1500, 3)
    data = path.read_bytes()
    # Twice the rows: Pillow would read the missing half as black.
    path.write_bytes(data[:8] + chunk(b"IHDR", data[16:20] + struct.pack(">I", 2000) + data[24:29]) + data[33:])
    refused(r"even\.png: the file is too short for 1500x2000 pixels", load_image, path)


@pytest.mark.parametrize("side", [12_000, 100_000])  # Pillow itself refuses the larger one
def test_small_files_that_claim_huge_pictures_are_refused(tmp_path, side):
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + body)
    refused(r"bomb\.png: the image is too large", load_image, tmp_path / "bomb.png")
