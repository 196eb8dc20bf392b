"""Images in and out: PNG and the like, OpenEXR, Radiance HDR, NumPy arrays."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt._version import __version__
from wrt.environment import ImageEnvironment
from wrt.errors import InputError
from wrt.files import PathLike, first_line, forget_input, is_input, naming, read_file, require_file
from wrt.formats import growth
from wrt.formats.npy import read_array
from wrt.layers import channel_names
from wrt.safe_write import Kind, require_place, write_whole
from wrt.srgb import linear_from_srgb, of_codes, srgb_from_linear
from wrt.values import Vec3, sealed

if TYPE_CHECKING:
    from PIL.Image import Image

OUTPUT_SUFFIXES = (".png", ".exr", ".npy")
"""What `save_image` writes."""

_BEGINNING = 1 << 16
"""Leading bytes of a picture that contain its metadata."""

_NPY_VERSION = (2, 0)


def _is_own(path: Path) -> bool:
    """Return whether `save_image` wrote a file, judging by the metadata."""
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    if beginning.startswith(b"\x89PNG"):
        return b"iTXtSoftware\0\0\0\0\0wrt " in beginning
    if beginning.startswith(b"v/1\x01"):
        _, found, value = beginning.partition(b"Software\0string\0")
        return bool(found) and value[4:8] == b"wrt "
    version = bytes(_NPY_VERSION)
    return beginning.startswith(b"\x93NUMPY" + version) and re.search(rb"'<f4'.*, 3\)", beginning[:256]) is not None


PICTURE = Kind("a picture that wrt has made", _is_own)


MAX_PIXELS = 2**27
"""Of an image that is read: 16384x8192, for instance. In memory each takes 12 bytes."""

FLOAT_SUFFIXES = (".exr", ".hdr", ".rgbe")
"""Of files in floating point that OpenImageIO reads."""

_PIXELS_PER_BYTE = 2**16
"""More than OpenEXR, Radiance and most others can gain by compression: where the header says more, it is wrong."""

_BOUNDED = ("JPEG", "BMP", "GIF")
_DEFLATED = 1032
"""Bytes of PNG's data that one of the file can stand for. Where data end sooner, Pillow takes the rest to be black."""


def load_image(path: PathLike, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Read an image as (H, W, 3) float32, linear Rec. 709; row 0 is the top.

    OpenEXR, Radiance HDR, NumPy (.npy) and everything Pillow reads. Alpha is dropped; grey
    becomes three equal channels. `save_image` may replace the file, unlike the images of a scene.

    Args:
        path: the file.
        linear: whether whole-number formats hold linear values; by default they hold sRGB.
            Floating-point formats are always linear.

    Raises:
        InputError: when there is no such file or it cannot be decoded.
    """
    file = Path(path)
    was_input = is_input(file)
    pixels = read_image(file, linear=linear)
    if not was_input:
        forget_input(file)
    return pixels


@growth.one_load()
def read_image(file: Path, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Read an image of a scene, which no output may replace; see `load_image`."""
    require_file(file)
    suffix = file.suffix.lower()
    try:
        with naming(file):
            if suffix in FLOAT_SUFFIXES:
                pixels = read_float(file)
            else:
                pixels = _read_npy(file) if suffix == ".npy" else _read_pillow(file, linear)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - decoders fail on damaged files in ways they do not list
        raise InputError(f"{file}: cannot be read as an image: {first_line(error)}") from None
    if pixels.size == 0:
        raise InputError(f"{file}: the image has no pixels")
    return pixels


def load_environment(
    path: PathLike, *, scale: float = 1.0, rotation_degrees: float = 0.0, rotation_axis: Vec3 = (0.0, 1.0, 0.0)
) -> ImageEnvironment:
    """Read a latitude-longitude image as an environment.

    Args:
        path: the file; see `load_image`.
        scale: multiplies the pixels.
        rotation_degrees: see `ImageEnvironment`.
        rotation_axis: likewise.

    Raises:
        InputError: when the file cannot be read, or holds negative values or values not finite.
    """
    pixels = sealed(read_image(Path(path)))
    with naming(Path(path)):
        return ImageEnvironment(pixels, scale, rotation_degrees, Path(path).name, rotation_axis)


def require_pixels(width: int, height: int) -> None:
    """Raise InputError where an image is too large to be decoded: few bytes may stand for very many pixels."""
    if width * height > MAX_PIXELS:
        raise InputError(f"the image is too large: {width}x{height}; it may have {MAX_PIXELS} pixels at most")


def open_image(file: Path | io.BytesIO) -> Image:
    """Return a Pillow image, not decoded yet, of a size that may be.

    Raises:
        InputError: where it is too large, or no image.
        Exception: of any kind where the file is damaged.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # Large pictures are normal here.
            warnings.simplefilter("ignore")
            image = Image.open(file)
    except Image.DecompressionBombError:
        raise InputError(f"the image is too large; it may have {MAX_PIXELS} pixels at most") from None
    except UnidentifiedImageError:
        raise InputError("not an image of a known format") from None
    size = file.stat().st_size if isinstance(file, Path) else len(file.getbuffer())
    try:
        require_pixels(*image.size)
        if image.width * image.height > _most_pixels(image, size):
            raise InputError(f"the file is too short for {image.width}x{image.height} pixels; it is truncated")
        growth.require(growth.IMAGES, image.width * image.height * growth.BYTES_PER_PIXEL)
    except InputError:
        image.close()
        raise
    return image


def _most_pixels(image: Image, size: int) -> float:
    """Return how many pixels a file of so many bytes can have in the image's format."""
    from PIL.ImageFile import ImageFile

    if image.format == "PNG" and isinstance(image, ImageFile) and image.tile:
        # How a pixel lies in the file, such as "RGB", "L;4" or "I;16B".
        kind, _, depth = str(image.tile[0][3]).partition(";")
        bits = int("".join(c for c in depth if c.isdecimal()) or (1 if kind == "1" else 8)) * len(image.getbands())
        return 8 * _DEFLATED * size / bits
    return _PIXELS_PER_BYTE * size if image.format in _BOUNDED else math.inf


def pixels_of(image: Image, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Return a Pillow image as (H, W, 3) float32, linear Rec. 709; see `load_image`."""
    require_pixels(*image.size)
    growth.take(growth.IMAGES, image.width * image.height * growth.BYTES_PER_PIXEL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what decoders say about odd files is for those who made them
        return _pixels_of(image, linear=linear)


def _pixels_of(image: Image, *, linear: bool | None) -> NDArray[np.float32]:
    if image.mode == "F":
        values = np.asarray(image, np.float32)
        return np.ascontiguousarray(np.repeat(values[:, :, None], 3, axis=2))
    if image.mode.startswith("I"):  # 16-bit grey, held in 16 or in 32 bits
        grey = np.clip(np.asarray(image).astype(np.float64) / 65535.0, 0.0, 1.0)
        grey = grey if linear else linear_from_srgb(grey)
        return np.repeat(grey.astype(np.float32)[:, :, None], 3, axis=2)
    if image.mode == "P" and "transparency" in image.info:
        image = image.convert("RGBA")
    codes = np.asarray(image if image.mode == "RGB" else image.convert("RGB"))
    pixels: NDArray[np.float32] = of_codes(linear=bool(linear))[codes]
    return pixels


def _read_pillow(path: Path, linear: bool | None) -> NDArray[np.float32]:
    with open_image(path) as image:
        return pixels_of(image, linear=linear)


def read_float(path: Path, *, alpha: bool = False) -> NDArray[np.float32]:
    """Read OpenEXR or Radiance HDR as (H, W, 3) float32; OpenImageIO says what is wrong with a damaged file, in words.

    Args:
        path: the file.
        alpha: whether its alpha channel is read, three times, instead of colours, where it has one.

    Raises:
        InputError: where it cannot be decoded, is too large or has no such channels.
    """
    import OpenImageIO

    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        raise InputError(f"{path}: cannot be read as an image: {_complaint(path, OpenImageIO.geterror())}")
    try:
        spec = source.spec()
        names = list(spec.channelnames)
        require_pixels(spec.width, spec.height * spec.depth)
        if spec.width * spec.height * len(names) > _PIXELS_PER_BYTE * path.stat().st_size:
            raise InputError(f"{path}: the file is too short for {spec.width}x{spec.height} pixels; it is truncated")
        require_pixels(spec.width, spec.height * -(-len(names) // 16))
        per_pixel = max(growth.BYTES_PER_PIXEL, 4 * len(names))
        growth.take(growth.IMAGES, spec.width * spec.height * spec.depth * per_pixel)
        pixels = source.read_image("float")
        if pixels is None:
            raise InputError(f"{path}: cannot be read as an image: {_complaint(path, source.geterror())}")
    finally:
        source.close()
    for wanted in ([("A", "A", "A")] * alpha) + [("R", "G", "B"), ("r", "g", "b"), ("Y", "Y", "Y")]:
        if all(name in names for name in wanted):
            return np.ascontiguousarray(pixels[:, :, [names.index(name) for name in wanted]], np.float32)
    raise InputError(f"{path}: no channels R, G, B or Y in it, only {', '.join(names)}")


def _complaint(path: Path, text: str) -> str:
    """Return OpenImageIO's words without the path, which the message has already."""
    return " ".join(text.replace(f" ({path})", "").split()) or "damaged"


def _read_npy(path: Path) -> NDArray[np.float32]:
    pixels = read_array(read_file(path))
    if pixels.ndim != 3 or pixels.shape[2] != 3:
        raise InputError(f"the array must be (H, W, 3), not {pixels.shape}")
    require_pixels(pixels.shape[1], pixels.shape[0])
    with np.errstate(all="ignore"):
        return np.ascontiguousarray(pixels, np.float32)


def check_output(path: PathLike, *, force: bool = False) -> Path:
    """Check before a long render that a picture may be written at a path, and return the path.

    Raises:
        InputError: on a suffix that `save_image` does not write, a directory, a folder that does not exist or may not
            be written to, or a file that may not be replaced (see `wrt.safe_write`).
    """
    file = _picture_name(path)
    require_place(file, PICTURE, force=force)
    return file


def _picture_name(path: PathLike) -> Path:
    file = Path(path)
    if file.suffix.lower() not in OUTPUT_SUFFIXES:
        known = ", ".join(OUTPUT_SUFFIXES)
        raise InputError(f"{file}: the name of a picture must end in one of {known}")
    return file


def save_image(
    path: PathLike,
    image: ArrayLike | None,
    *,
    exposure: float = 0.0,
    metadata: Mapping[str, object] | None = None,
    layers: Mapping[str, NDArray[Any]] | None = None,
    force: bool = False,
) -> None:
    """Write a linear Rec. 709 image as PNG, OpenEXR or NumPy array, by its suffix.

    The file appears whole or not at all: it is written under another name beside its place and
    then moved there. It replaces pictures that wrt wrote; with `force` also other files, but never one that this
    process has read.

    Args:
        path: ends in .png (8-bit sRGB, clipped and dithered), .exr (float32 R, G, B) or .npy
            (float32 (H, W, 3)).
        image: (H, W, 3), row 0 at the top; None where there are layers only.
        exposure: stops (factors of two) by which a PNG is brightened; the other two keep the
            radiance as it is.
        metadata: names and values, kept as text in PNG and as attributes in OpenEXR.
        layers: what `wrt.Renderer.layers` returns, for OpenEXR: channels such as `albedo.R`, 32-bit.
        force: whether to replace a file that wrt did not write.

    Raises:
        InputError: see `check_output`; also when the image has another shape or writing fails.
    """
    file = check_output(path, force=force)
    notes = {"Software": f"wrt {__version__}", **{str(key): str(value) for key, value in (metadata or {}).items()}}

    def save(write: Callable[[Path], object]) -> None:
        write_whole(file, write, PICTURE, force=force)

    if layers:
        if file.suffix.lower() != ".exr":
            raise InputError(f"{file}: layers go into OpenEXR files; give it a name that ends in .exr")
        save(lambda temporary: _write_exr(temporary, _channels(image, layers), notes))
        return
    pixels = np.ascontiguousarray(image, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise InputError(f"{file}: an image must be (H, W, 3), not {pixels.shape}")
    if file.suffix.lower() == ".exr":
        save(lambda temporary: _write_exr(temporary, _channels(pixels, {}), notes))
    elif file.suffix.lower() == ".npy":
        save(lambda temporary: _write_npy(temporary, pixels))
    else:
        with np.errstate(over="ignore"):
            pixels = pixels * np.float32(2.0**exposure)
        save(lambda temporary: _write_png(temporary, pixels, notes))


ROWS_AT_ONCE = 16
"""Of a picture that is made 8-bit: few enough to stay in a core's cache."""


def quantize(image: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Return (H, W, 3) linear values as 8-bit sRGB codes, clipped to [0, 1]; NaN becomes black.

    Dithered, so that dark gradients do not show as bands: floor(255 v + u), where u in (0, 1) is
    a fixed hash of column, row and channel. Values that lie on a code, 0 and 1 among them, come
    out as that code.
    """
    height, width, channels = image.shape
    codes = np.empty(image.shape, np.uint8)
    x = np.arange(width, dtype=np.uint32)[:, None]
    c = np.arange(channels, dtype=np.uint32)
    columns = _hash(x ^ _hash(c + np.uint32(0x9E3779B9)))

    def fill(rows: slice) -> None:
        values = np.clip(np.nan_to_num(image[rows].astype(np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
        noise = _hash(columns + _hash(np.arange(height, dtype=np.uint32)[rows, None, None]))
        # 256 levels from 1/512 to 511/512: rounding errors of a value on a code cannot leave it.
        u = ((noise >> np.uint32(24)).astype(np.float64) + 0.5) / 256.0
        codes[rows] = np.floor(255.0 * srgb_from_linear(values) + u).astype(np.uint8)

    # Some rows at a time: float64 of a whole picture would take four times its memory.
    with ThreadPoolExecutor() as pool:
        list(pool.map(fill, (slice(y, y + ROWS_AT_ONCE) for y in range(0, height, ROWS_AT_ONCE))))
    return codes


def _hash(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Mix 32 bits (Wellons 2018, the "lowbias32" function)."""
    x = x ^ (x >> np.uint32(16))
    with np.errstate(over="ignore"):
        x = x * np.uint32(0x7FEB352D)
        x = x ^ (x >> np.uint32(15))
        x = x * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def _write_png(path: Path, pixels: NDArray[np.float32], notes: Mapping[str, str]) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    for key, value in notes.items():
        info.add_itxt(key, value)  # UTF-8, unlike the older text chunk
    Image.fromarray(quantize(pixels)).save(path, format="PNG", pnginfo=info)


def _channels(image: ArrayLike | None, layers: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return what an OpenEXR file holds, by the channels' names.

    Numbers of objects too are 32-bit floats, exact up to 2²⁴: many programs take whole numbers for shares of 2³².
    """
    parts = [(["R", "G", "B"], np.asarray(image, np.float32))] if image is not None else []
    parts += [(channel_names(name), values) for name, values in layers.items()]
    return {
        name: np.ascontiguousarray(values.reshape(*values.shape[:2], len(names))[:, :, k], np.float32)
        for names, values in parts
        for k, name in enumerate(names)
    }


def _write_exr(path: Path, channels: dict[str, NDArray[Any]], notes: Mapping[str, str]) -> None:
    import OpenEXR

    header = {**notes, "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def _write_npy(path: Path, pixels: NDArray[np.float32]) -> None:
    # Version 2 of the format marks the picture as wrt's: NumPy itself uses it only for headers over 64 KB.
    with path.open("wb") as file:
        np.lib.format.write_array(file, pixels, version=_NPY_VERSION)
