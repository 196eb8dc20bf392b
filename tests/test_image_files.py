"""Pictures are written exactly and all or nothing, and read back as linear light."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import wrt
from wrt.develop.picture import develop_image
from wrt.io.images import PICTURE, check_output, load_environment, load_image, save_image
from wrt.io.safe_write import write_atomically
from wrt.scene.srgb import linear_from_srgb, srgb_from_linear

ASSETS = Path(__file__).resolve().parent.parent.parent / "shared" / "assets"


def noise(height: int = 13, width: int = 17) -> np.ndarray:
    return np.random.default_rng(5).random((height, width, 3)).astype(np.float32)


def quantized(image: np.ndarray) -> np.ndarray:
    return develop_image(image, tone="none", exposure=0.0)


def test_srgb_curve_has_its_published_values_and_inverse():
    # IEC 61966-2-1: half of the code range is 21.4 % of the light; the two pieces meet at 0.0031308.
    assert linear_from_srgb(0.5) == pytest.approx(0.21404114, abs=1e-8)
    assert srgb_from_linear(0.0031308) == pytest.approx(0.04045, abs=1e-5)
    assert srgb_from_linear(0.18) == pytest.approx(0.46135612, abs=1e-7)
    x = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(linear_from_srgb(srgb_from_linear(x)), x, atol=1e-7)


@pytest.mark.parametrize("name", ["a.exr", "a.npy", "A.EXR"])
def test_float_formats_keep_every_bit(tmp_path, name):
    image = noise() * 1e3 - 100.0
    image[0, 0] = (np.inf, 1e-30, 6e4)
    save_image(tmp_path / name, image, exposure=3.0)
    np.testing.assert_array_equal(load_image(tmp_path / name), image)


def test_png_keeps_every_code_and_clips(tmp_path):
    codes = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    codes.reshape(-1)[:256] = np.arange(256)
    path = tmp_path / "a.png"
    save_image(path, linear_from_srgb(codes / 255.0))
    np.testing.assert_array_equal(np.asarray(Image.open(path)), codes)
    save_image(path, load_image(path))
    np.testing.assert_array_equal(np.asarray(Image.open(path)), codes)
    save_image(path, np.array([[[-1.0, 0.0, 1.0], [2.0, np.inf, np.nan]]]), tone="none", exposure=0.0)
    np.testing.assert_array_equal(np.asarray(Image.open(path)), [[[0, 0, 255], [255, 255, 0]]])


def test_png_exposure_is_in_stops(tmp_path):
    save_image(tmp_path / "a.png", np.full((8, 8, 3), 0.1), exposure=2.0)
    save_image(tmp_path / "b.png", np.full((8, 8, 3), 0.4))
    np.testing.assert_array_equal(load_image(tmp_path / "a.png"), load_image(tmp_path / "b.png"))


@pytest.mark.parametrize("name", ["a.jpg", "b.JPEG"])
def test_jpeg_shows_what_png_does(tmp_path, name):
    """At quality 95, without chroma subsampling: colours that change from pixel to pixel stay."""
    ramp = np.linspace(0.0, 1.2, 64)
    image = np.stack(np.broadcast_arrays(ramp[None, :], ramp[:, None], 0.3), axis=2).astype(np.float32)
    image[:, 32:, 2] = image[:, 32:, 2] * (np.arange(32) % 2)
    developed = save_image(tmp_path / name, image, tone="aces", exposure=0.5, metadata={"spp": 12, "scène": "boîte"})
    with Image.open(tmp_path / name) as picture:
        assert (picture.format, picture.size, picture.mode) == ("JPEG", (64, 64), "RGB")
        assert [component[1:3] for component in picture.layer] == [(1, 1)] * 3
        pixels = np.asarray(picture)
        said = dict(line.split(": ", 1) for line in picture.info["comment"].decode().splitlines())
    Image.fromarray(developed.codes).save(tmp_path / "expected.jpg", quality=95, subsampling=0)
    np.testing.assert_array_equal(pixels, np.asarray(Image.open(tmp_path / "expected.jpg")))
    assert said == {
        "Software": f"wrt {wrt.__version__}",
        "spp": "12",
        "scène": "boîte",
        "Tone": "aces",
        "Exposure": "0.5 stops",
    }


def test_jpeg_replaces_what_wrt_made_and_refuses_what_it_cannot_hold(tmp_path):
    path = tmp_path / "a.jpg"
    save_image(path, noise())
    save_image(path, noise() * 0.5)
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(path, comment="wrt was here")
    with pytest.raises(wrt.InputError, match=r"a\.jpg: already exists and is not a picture that wrt has made"):
        save_image(path, noise())
    with pytest.raises(
        wrt.InputError, match=r"b\.jpg: a JPEG has no alpha; give it a name that ends in \.png or \.exr"
    ):
        save_image(tmp_path / "b.jpg", np.ones((4, 4, 4)))
    with pytest.raises(wrt.InputError, match=r"b\.jpg: a JPEG has 65535 pixels a side at most, not 65536x1"):
        save_image(tmp_path / "b.jpg", np.zeros((1, 65536, 3)))
    with pytest.raises(wrt.InputError, match=r"b\.jpg: the metadata of a JPEG may have 65533 bytes"):
        save_image(tmp_path / "b.jpg", noise(), metadata={"long": "x" * 70_000})
    assert not (tmp_path / "b.jpg").exists()


def test_dither_keeps_the_mean_and_leaves_no_bands():
    value = linear_from_srgb((100 + np.linspace(0.05, 0.95, 19)) / 255.0)
    image = np.broadcast_to(value[:, None, None, None], (19, 128, 128, 3)).reshape(-1, 128, 3)
    codes = quantized(image).reshape(19, -1)
    assert set(np.unique(codes)) == {100, 101}
    # 49152 coin flips: the mean lies within 5 standard deviations of the value.
    np.testing.assert_allclose(codes.mean(axis=1) - 100, np.linspace(0.05, 0.95, 19), atol=5 * 0.5 / 49152**0.5)
    np.testing.assert_array_equal(quantized(image), quantized(image.copy()))
    # Neighbours and channels are decided independently of each other.
    half = quantized(np.full((256, 256, 3), linear_from_srgb(100.5 / 255.0))).astype(float) - 100.5
    for other in (np.roll(half, 1, axis=0), np.roll(half, 1, axis=1), np.roll(half, 1, axis=2)):
        assert abs((half * other).mean()) < 0.25 * 5 / half.size**0.5


def test_metadata_is_found_again(tmp_path):
    import OpenEXR

    notes = {"software": "wrt", "spp": 12, "scène": "boîte"}
    save_image(tmp_path / "a.png", noise(), metadata=notes)
    with Image.open(tmp_path / "a.png") as image:
        found = {key: str(value) for key, value in image.text.items()}
        assert found.pop("Software").startswith("wrt ")
        assert found == {**{k: str(v) for k, v in notes.items()}, "Tone": "soft", "Exposure": "0 stops"}
    save_image(tmp_path / "a.exr", noise(), metadata={"software": "wrt", "spp": 12})
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert header["software"] == "wrt"
    assert header["spp"] == "12"


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.exr", "a.npy"])
def test_a_write_that_fails_changes_nothing(tmp_path, name, monkeypatch):
    path = tmp_path / name
    save_image(path, noise())
    before = path.read_bytes()

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(wrt.InputError, match=f"{name}: cannot be written: No space left on device"):
        save_image(path, noise() * 0.5)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_an_interrupted_write_leaves_nothing(tmp_path):
    def interrupted(temporary: Path) -> None:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "a.png", interrupted, PICTURE)
    assert list(tmp_path.iterdir()) == []


def test_written_files_have_ordinary_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    expected = (tmp_path / "plain").stat().st_mode
    for name in ("a.png", "a.exr", "a.npy"):
        save_image(tmp_path / name, noise())
        assert (tmp_path / name).stat().st_mode == expected


def test_outputs_that_could_not_be_written_are_refused_before(tmp_path, monkeypatch):
    assert check_output(tmp_path / "a.png") == tmp_path / "a.png"
    assert list(tmp_path.iterdir()) == []
    for name in ("a.gif", "a", ".png"):
        with pytest.raises(wrt.InputError, match=r"must end in one of \.png, \.jpg, \.jpeg, \.exr, \.npy"):
            check_output(tmp_path / name)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(wrt.InputError, match="is a directory"):
        check_output(tmp_path / "folder.png")
    with pytest.raises(wrt.InputError, match="does not exist"):
        check_output(tmp_path / "none" / "a.png")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(wrt.InputError, match="is not a folder"):
        check_output(tmp_path / "file" / "a.png")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(wrt.InputError, match="may not be written to"):
        check_output(tmp_path / "a.png")
    monkeypatch.undo()
    with pytest.raises(wrt.InputError, match=r"must be \(H, W, 3\)"):
        save_image(tmp_path / "a.png", np.zeros((4, 4)))
    with pytest.raises(wrt.InputError, match=r"^a picture is written to a path, not to BytesIO; .*wrt.develop_image"):
        save_image(io.BytesIO(), noise())
    with pytest.raises(wrt.InputError, match=r"^a picture is written to a path, not to ndarray"):
        save_image(noise(), tmp_path / "a.png")


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npy"])
def test_codes_are_not_taken_for_light(tmp_path, name):
    codes = np.full((2, 2, 3), 200, np.uint8)
    with pytest.raises(wrt.InputError, match=rf"^.*{name}: an image must be linear numbers, not codes up to 200"):
        save_image(tmp_path / name, codes)
    with pytest.raises(wrt.InputError, match=r"^an image must be linear numbers, not codes up to 200"):
        wrt.develop_image(codes)
    assert list(tmp_path.iterdir()) == []
    assert (wrt.develop_image(np.ones((2, 2, 3), np.uint8), tone="none") == 255).all()


def test_eight_bit_modes_decode_alike(tmp_path):
    grey = np.array([[0, 10, 128, 255]], np.uint8)
    expected = np.repeat(linear_from_srgb(grey / 255.0)[:, :, None], 3, axis=2).astype(np.float32)
    image = Image.fromarray(grey)
    for mode in ("L", "LA", "RGB", "RGBA", "P"):
        image.convert(mode).save(tmp_path / "a.png")
        np.testing.assert_array_equal(load_image(tmp_path / "a.png"), expected, err_msg=mode)
    linear = load_image(tmp_path / "a.png", linear=True)
    np.testing.assert_allclose(linear[0, :, 0], grey[0] / 255.0, rtol=1e-6)
    clear = Image.fromarray(np.array([[[200, 100, 50, 0]]], np.uint8))
    clear.save(tmp_path / "a.png")
    np.testing.assert_allclose(load_image(tmp_path / "a.png")[0, 0], linear_from_srgb([200 / 255, 100 / 255, 50 / 255]))


def test_sixteen_bit_grey_keeps_its_depth(tmp_path):
    values = np.array([[0, 1, 257, 32768, 65535]], np.uint16)
    Image.fromarray(values).save(tmp_path / "a.png")
    expected = linear_from_srgb(values / 65535.0).astype(np.float32)
    np.testing.assert_array_equal(load_image(tmp_path / "a.png")[:, :, 1], expected)
    np.testing.assert_allclose(load_image(tmp_path / "a.png", linear=True)[0, :, 0], values[0] / 65535.0, rtol=1e-6)


def test_float_tiff_and_grey_exr_are_linear(tmp_path):
    import OpenEXR

    values = np.array([[0.25, 4.0, -1.0]], np.float32)
    Image.fromarray(values).save(tmp_path / "a.tif")
    np.testing.assert_array_equal(load_image(tmp_path / "a.tif")[:, :, 2], values)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": values}).write(str(tmp_path / "y.exr"))
    np.testing.assert_array_equal(load_image(tmp_path / "y.exr")[:, :, 0], values)
    OpenEXR.File(header, {"Z": values}).write(str(tmp_path / "z.exr"))
    with pytest.raises(wrt.InputError, match=r"z\.exr: no channels R, G, B or Y in it, only Z"):
        load_image(tmp_path / "z.exr")


def test_radiance_hdr_decodes_shared_exponents(tmp_path):
    # Ward 1991: (mantissa + 0.5 or 0) / 256 * 2^(exponent - 128); the mantissas here are exact.
    pixels = bytes([128, 64, 32, 129, 255, 0, 1, 136, 0, 0, 0, 0])
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 3\n" + pixels)
    expected = [[[1.0, 0.5, 0.25], [255.0, 0.0, 1.0], [0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(load_image(tmp_path / "a.hdr"), expected, rtol=0.005)


@pytest.mark.skipif(not ASSETS.is_dir(), reason="the test assets are not beside this checkout")
def test_a_real_environment_loads():
    environment = load_environment(ASSETS / "textures" / "envmap.hdr", scale=2.0, rotation_degrees=30)
    assert environment.pixels.shape == (512, 1024, 3)
    assert environment.pixels.max() > 100.0  # the sun, which 8 bits would have clipped
    assert (environment.scale, environment.rotation_degrees) == (2.0, 30.0)
    assert environment.name == "envmap.hdr"


def test_files_that_are_no_images_are_refused(tmp_path, capfd):
    with pytest.raises(wrt.InputError, match=r"^an image is read from a path, not from BytesIO$"):
        load_image(io.BytesIO())
    with pytest.raises(wrt.InputError, match=r"none\.png: no such file"):
        load_image(tmp_path / "none.png")
    with pytest.raises(wrt.InputError, match="is a directory"):
        load_image(tmp_path)
    for suffix in ("png", "jpg", "exr", "hdr", "npy", "txt"):
        path = tmp_path / f"a.{suffix}"
        path.write_bytes(b"")
        with pytest.raises(wrt.InputError, match="the file is empty"):
            load_image(path)
        path.write_bytes(b"not an image at all")
        with pytest.raises(wrt.InputError) as caught:
            load_image(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)
        assert str(caught.value).count(str(path)) == 1
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npy"])
def test_truncated_images_are_refused_or_whole(tmp_path, name, capfd):
    path = tmp_path / name
    save_image(path, noise())
    pixels, whole = load_image(path), path.read_bytes()
    refused = 0
    for length in np.linspace(1, len(whole) - 1, 40).astype(int):
        path.write_bytes(whole[:length])
        try:
            # Past the last pixel PNG has checksums, which decoders may do without.
            np.testing.assert_array_equal(load_image(path), pixels)
        except wrt.InputError:
            refused += 1
    assert refused >= 38
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"])
def test_png_files_cannot_have_more_pixels_than_their_bytes_stand_for(tmp_path, mode):
    path = tmp_path / "even.png"
    Image.new(mode, (1500, 1000)).save(path, optimize=True)  # nothing packs better
    assert load_image(path).shape == (1000, 1500, 3)
    whole = path.read_bytes()
    # Twice the rows, of which Pillow would take half to be black.
    header = whole[12:20] + struct.pack(">I", 2000) + whole[24:29]
    path.write_bytes(whole[:12] + header + struct.pack(">I", zlib.crc32(header)) + whole[33:])
    with pytest.raises(wrt.InputError, match=r"even\.png: the file is too short for 1500x2000 pixels"):
        load_image(path)


def test_decompression_bombs_are_refused(tmp_path):
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    (tmp_path / "bomb.png").write_bytes(bomb + chunk(b"IEND", b""))
    with pytest.raises(wrt.InputError, match=r"bomb\.png: the image is too large"):
        load_image(tmp_path / "bomb.png")


def test_arrays_of_objects_are_never_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"x": 1}], object), allow_pickle=True)
    with pytest.raises(wrt.InputError, match=r"a\.npy: "):
        load_image(tmp_path / "a.npy")


def test_environments_with_negative_light_are_refused(tmp_path):
    save_image(tmp_path / "a.exr", noise() - 2.0)
    with pytest.raises(wrt.InputError, match=r"a\.exr: .*not negative"):
        load_environment(tmp_path / "a.exr")
