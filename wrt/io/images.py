"""Read and write images: PNG and other Pillow formats, OpenEXR, Radiance HDR, NumPy arrays."""

from __future__ import annotations

import functools
import io
import math
import mmap
import os
import re
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt._version import __version__
from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.npy import read_array
from wrt.io.safe_read import PathLike, first_line, forget_input, is_input, naming_file, read_file, require_file
from wrt.io.safe_write import Kind, output_path, require_writable, write_atomically
from wrt.scene.cryptomatte import TYPES, metadata_of
from wrt.scene.developing import DEFAULT_TONE, DEVELOPED_SUFFIXES, Exposure
from wrt.scene.environment import ImageEnvironment
from wrt.scene.layers import channel_names
from wrt.scene.srgb import linear_from_srgb, of_codes
from wrt.values import ColorLike, Vec3, color, sealed

if TYPE_CHECKING:
    from PIL.Image import Image

    from wrt.develop.picture import Developed

OUTPUT_SUFFIXES = (*DEVELOPED_SUFFIXES, ".exr", ".npy")  # formats that `save_image` writes

# Near the best that JPEG has: a colour for each pixel, and errors of few codes.
_JPEG = {"quality": 95, "subsampling": 0, "optimize": True}
_JPEG_SIDE, _JPEG_COMMENT = 65535, 65533  # most pixels a side, and most bytes of metadata
_BEGINNING = 1 << 16  # bytes at the start of a picture file that hold its metadata
_NPY_VERSION = (2, 0)


def _is_own(path: Path) -> bool:
    """Return whether `save_image` wrote a file, judging by the metadata."""
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    if beginning.startswith(b"\x89PNG"):
        return b"iTXtSoftware\0\0\0\0\0wrt " in beginning
    if beginning.startswith(b"\xff\xd8\xff"):
        return re.search(rb"\xff\xfe..Software: wrt ", beginning, re.DOTALL) is not None
    if beginning.startswith(b"v/1\x01"):
        return _exr_attribute(path, b"Software").startswith(b"wrt ")
    version = bytes(_NPY_VERSION)
    return beginning.startswith(b"\x93NUMPY" + version) and re.search(rb"'<f4'.*, 3\)", beginning[:256]) is not None


def _exr_attribute(path: Path, name: bytes) -> bytes:
    """Return the start of an attribute in the header of an OpenEXR file, or nothing.

    Attributes are in alphabetical order, and those before this one may have megabytes of names.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = 8  # after magic number and version
        while (end := data.find(b"\0", at)) > at and (kind_end := data.find(b"\0", end + 1)) > 0:
            start = kind_end + 5
            if data[at:end] == name:
                return data[start : start + _BEGINNING]
            at = start + int.from_bytes(data[kind_end + 1 : start], "little")
    return b""


PICTURE = Kind("a picture that wrt has made", _is_own)

MAX_PIXELS = 2**27  # limit for images that are read, such as 16384x8192. A pixel takes 12 bytes of memory
FLOAT_SUFFIXES = (".exr", ".hdr", ".rgbe")  # floating-point formats that OpenImageIO reads

# More than OpenEXR, Radiance and most other formats can compress: a header that claims more is wrong.
_PIXELS_PER_BYTE = 2**16
_BOUNDED = ("JPEG", "BMP", "GIF")
# Most bytes that deflate can make of one byte of a PNG file. Pillow fills a truncated file with black pixels.
_DEFLATED = 1032


def load_image(path: PathLike, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Read an image as (H, W, 3) float32, linear Rec. 709; row 0 is the top.

    Reads OpenEXR, Radiance HDR, NumPy (.npy) and every format that Pillow knows. Alpha is dropped; grey becomes three
    equal channels. `save_image` may replace the file, unlike the images of a scene.

    Args:
        path: the file.
        linear: whether integer formats hold linear values instead of sRGB. Floating-point formats are always linear.

    Raises:
        InputError: when the file does not exist or cannot be decoded.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"an image is read from a path, not from {type(path).__name__}")
    file = Path(path)
    was_input = is_input(file)
    pixels = read_image(file, linear=linear)
    if not was_input:
        forget_input(file)
    return pixels


@memory_limits.one_load()
def read_image(file: Path, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Read an image as `load_image` does, and mark it as an input that no output may replace."""
    require_file(file)
    suffix = file.suffix.lower()
    try:
        with naming_file(file):
            if suffix in FLOAT_SUFFIXES:
                pixels = read_float(file)
            elif suffix == ".npy":
                pixels = _read_npy(file)
            else:
                with open_image(file) as image:
                    pixels = pixels_of(image, linear=linear)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - decoders raise undocumented exceptions on damaged files
        raise InputError(f"{file}: cannot be read as an image: {first_line(error)}") from None
    if pixels.size == 0:
        raise InputError(f"{file}: the image has no pixels")
    return pixels


def load_environment(
    path: PathLike,
    *,
    scale: float = 1.0,
    rotation_degrees: float = 0.0,
    rotation_axis: Vec3 = (0.0, 1.0, 0.0),
    group: str | None = None,
) -> ImageEnvironment:
    """Read a latitude-longitude image as an environment; see `load_image` and `ImageEnvironment`."""
    pixels = sealed(read_image(Path(path)))
    with naming_file(Path(path)):
        return ImageEnvironment(pixels, scale, rotation_degrees, Path(path).name, rotation_axis, group=group)


def require_pixels(width: int, height: int) -> None:
    """Raise InputError if an image is too large to decode: a few bytes can expand to very many pixels."""
    if width * height > MAX_PIXELS:
        raise InputError(f"the image is too large: {width}x{height}; it may have {MAX_PIXELS} pixels at most")
    memory_limits.require(memory_limits.IMAGES, width * height * memory_limits.BYTES_PER_PIXEL)


def open_image(file: Path | io.BytesIO) -> Image:
    """Return a Pillow image, not decoded yet, after checking its size; a damaged file may raise any Exception."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # large pictures are normal here
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
    except InputError:
        image.close()
        raise
    return image


def _most_pixels(image: Image, size: int) -> float:
    """Return the most pixels that a file of `size` bytes can hold in the image's format."""
    from PIL.ImageFile import ImageFile

    if image.format == "PNG" and isinstance(image, ImageFile) and image.tile:
        # The raw mode of the pixels in the file, such as "RGB", "L;4" or "I;16B".
        kind, _, depth = str(image.tile[0][3]).partition(";")
        bits = int("".join(c for c in depth if c.isdecimal()) or (1 if kind == "1" else 8)) * len(image.getbands())
        return 8 * _DEFLATED * size / bits
    return _PIXELS_PER_BYTE * size if image.format in _BOUNDED else math.inf


def pixels_of(image: Image, *, linear: bool | None = None) -> NDArray[np.float32]:
    """Return a Pillow image as (H, W, 3) float32, linear Rec. 709; see `load_image`."""
    require_pixels(*image.size)
    memory_limits.take(memory_limits.IMAGES, image.width * image.height * memory_limits.BYTES_PER_PIXEL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # decoders warn of details that users cannot change
        if image.mode == "F" or image.mode.startswith("I"):
            grey = np.asarray(image)
            if image.mode != "F":  # 16 bits, held in 16 or in 32
                grey = np.clip(grey.astype(np.float64) / 65535.0, 0.0, 1.0)
                grey = grey if linear else linear_from_srgb(grey)
            return np.repeat(grey.astype(np.float32)[:, :, None], 3, axis=2)
        if image.mode == "P" and "transparency" in image.info:
            image = image.convert("RGBA")
        codes = np.asarray(image if image.mode == "RGB" else image.convert("RGB"))
    pixels: NDArray[np.float32] = of_codes(linear=bool(linear))[codes]
    return pixels


def read_float(path: Path, *, alpha: bool = False) -> NDArray[np.float32]:
    """Read OpenEXR or Radiance HDR as (H, W, 3) float32 with OpenImageIO, whose error messages are readable.

    With `alpha` the alpha channel, if there is one, is returned three times instead of the colours.
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
        per_pixel = max(memory_limits.BYTES_PER_PIXEL, 4 * len(names))
        memory_limits.take(memory_limits.IMAGES, spec.width * spec.height * spec.depth * per_pixel)
        pixels = source.read_image("float")
        if pixels is None:
            raise InputError(f"{path}: cannot be read as an image: {_complaint(path, source.geterror())}")
    finally:
        source.close()
    for channels in ["AAA"] * alpha + ["RGB", "rgb", "YYY"]:
        if set(channels) <= set(names):
            return np.ascontiguousarray(pixels[:, :, [names.index(name) for name in channels]], np.float32)
    raise InputError(f"{path}: no channels R, G, B or Y in it, only {', '.join(names)}")


def _complaint(path: Path, text: str) -> str:
    """Return OpenImageIO's message without the path, which ours names already."""
    return " ".join(text.replace(f" ({path})", "").split()) or "damaged"


def _read_npy(path: Path) -> NDArray[np.float32]:
    pixels = read_array(read_file(path))
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise InputError(f"the array must be (H, W, 3), or (H, W, 4) with alpha, not {pixels.shape}")
    require_pixels(pixels.shape[1], pixels.shape[0])
    with np.errstate(all="ignore"):
        return np.ascontiguousarray(pixels[:, :, :3], np.float32)


def check_output(path: PathLike, *, force: bool = False) -> Path:
    """Return the path of a picture after checking, before a long render, that it can be written."""
    file = picture_path(path)
    require_writable(file, PICTURE, force=force)
    return file


def picture_path(path: PathLike) -> Path:
    """Return the path of a picture that will be written, or raise InputError."""
    file = output_path(path, "a picture", "; Pillow writes the codes of wrt.develop_image into open files")
    if file.suffix.lower() not in OUTPUT_SUFFIXES:
        raise InputError(f"{file}: the name of a picture must end in one of {', '.join(OUTPUT_SUFFIXES)}")
    return file


def save_image(
    path: PathLike,
    image: ArrayLike | None,
    *,
    tone: str = DEFAULT_TONE,
    exposure: Exposure = None,
    alpha: ArrayLike | None = None,
    metadata: Mapping[str, object] | None = None,
    layers: Mapping[str, NDArray[Any]] | None = None,
    background: ColorLike | None = None,
    edges: NDArray[np.float32] | None = None,
    edge_color: ColorLike = (0.0, 0.0, 0.0),
    force: bool = False,
) -> Developed | None:
    """Write a linear Rec. 709 image as PNG, JPEG, OpenEXR or NumPy array, by its suffix.

    The file appears whole or not at all: it is written under a temporary name in the same folder and then renamed.
    It replaces pictures that wrt wrote; with `force` also other files, but never one that this process has read.

    Args:
        path: ends in .png, .jpg or .jpeg (8 bits, as by `develop_image`), .exr (float32) or .npy (float32 (H, W, 3)).
        image: (H, W, 3), (H, W, 4) whose last channel is `alpha`, or (H, W), row 0 at the top; None to write layers
            only.
        tone: tone curve of a PNG or JPEG, see `develop_image`.
        exposure: exposure of a PNG or JPEG, see `develop_image`.
        alpha: (H, W) coverage, 0 to 1, by which the radiance is multiplied already (associated alpha). A PNG holds the
            quotient; a JPEG has no alpha.
        metadata: names and values, as text in PNG and JPEG, attributes in OpenEXR.
        layers: the result of `wrt.Renderer.layers`, for OpenEXR: 32-bit channels such as `albedo.R`.
        background: linear colour behind a PNG or JPEG with alpha, which then has none. The tone curve leaves it as it
            is.
        edges: (H, W) share of each pixel that lines cover, to draw them over a PNG or JPEG: the layer of this name.
        edge_color: linear colour of these lines, likewise exact.
        force: whether to replace a file that wrt did not write.

    Returns:
        How a PNG or JPEG was developed, otherwise None.

    Raises:
        InputError: see `check_output` and `develop_image`; also when the shape of the image is wrong or writing fails.
    """
    file = check_output(path, force=force)
    suffix = file.suffix.lower()
    cover: dict[str, NDArray[np.float32]] = {}
    source: Any = image
    if image is not None or not layers:
        image, cover = _with_coverage(file, image, alpha)
    notes = {"Software": f"wrt {__version__}", **{str(key): str(value) for key, value in (metadata or {}).items()}}
    developed: Developed | None = None
    write: Callable[[Path], None]
    if suffix == ".exr":
        write = functools.partial(_write_exr, image=image, layers={**(layers or {}), **cover}, notes=notes)
    elif layers:
        raise InputError(f"{file}: layers go into OpenEXR files; give it a name that ends in .exr")
    elif suffix == ".npy":
        write = functools.partial(_write_npy, pixels=np.dstack([np.asarray(image), *cover.values()]))
    else:
        from wrt.develop.picture import develop

        behind = None if background is None else color(background, "background", maximum=1.0)
        height, width = np.asarray(image).shape[:2]
        require_room(file, width, height, alpha=bool(cover) and behind is None)
        developed = develop(
            source,
            tone=tone,
            exposure=exposure,
            alpha=cover.get("alpha"),
            background=behind,
            lines=edges,
            line_color=color(edge_color, "edge_color", maximum=1.0),
        )
        codes = developed.codes
        notes |= {"Tone": developed.tone, "Exposure": f"{developed.stops:.6g} stops"}
        if suffix == ".png":
            write = functools.partial(_write_png, codes=codes, notes=notes)
        else:
            write = functools.partial(_write_jpeg, codes=codes, notes=notes, name=file)
    write_atomically(file, write, PICTURE, force=force)
    return developed


def require_room(file: Path, width: int, height: int, *, alpha: bool) -> None:
    """Raise InputError if a JPEG cannot hold a picture."""
    if file.suffix.lower() not in (".jpg", ".jpeg"):
        return
    if alpha:
        raise InputError(f"{file}: a JPEG has no alpha; give it a name that ends in .png or .exr")
    if max(width, height) > _JPEG_SIDE:
        raise InputError(f"{file}: a JPEG has {_JPEG_SIDE} pixels a side at most, not {width}x{height}")


def _with_coverage(
    file: Path, image: ArrayLike | None, alpha: ArrayLike | None
) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]]]:
    """Return the (H, W, 3) colours of an image, and its coverage as a layer if there is any."""
    from wrt.develop.picture import colors_and_alpha

    pixels, coverage = colors_and_alpha(image, f"{file}: an image")
    alpha = coverage if alpha is None else alpha
    if alpha is None:
        return pixels, {}
    cover = np.asarray(alpha, np.float32)
    if cover.shape != pixels.shape[:2]:
        raise InputError(f"{file}: alpha must be (H, W) as the image is, {pixels.shape[:2]}, not {cover.shape}")
    return pixels, {"alpha": cover}


def _write_jpeg(path: Path, codes: NDArray[np.uint8], notes: Mapping[str, str], name: Path) -> None:
    from PIL import Image

    comment = "\n".join(f"{key}: {value}" for key, value in notes.items()).encode()
    if len(comment) > _JPEG_COMMENT:
        raise InputError(f"{name}: the metadata of a JPEG may have {_JPEG_COMMENT} bytes, not {len(comment)}")
    Image.fromarray(codes).save(path, format="JPEG", comment=comment, **_JPEG)


def _write_png(path: Path, codes: NDArray[np.uint8], notes: Mapping[str, str]) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    for key, value in notes.items():
        info.add_itxt(key, value)  # UTF-8, unlike the older text chunk
    Image.fromarray(codes).save(path, format="PNG", pnginfo=info)


def _write_exr(
    path: Path, image: ArrayLike | None, layers: Mapping[str, NDArray[Any]], notes: Mapping[str, str]
) -> None:
    import OpenEXR

    parts = [(["R", "G", "B"], np.asarray(image, np.float32))] if image is not None else []
    parts += [(channel_names(name), values) for name, values in layers.items()]
    # Object numbers are 32-bit floats too, exact up to 2²⁴: many programs scale integer channels by 2⁻³².
    channels = {
        name: np.ascontiguousarray(values.reshape(*values.shape[:2], len(names))[:, :, k], np.float32)
        for names, values in parts
        for k, name in enumerate(names)
    }
    known = {key: value for name in TYPES if name in layers for key, value in metadata_of(name).items()}
    header = {**known, **notes, "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def _write_npy(path: Path, pixels: NDArray[np.float32]) -> None:
    # Version 2 of the format marks the picture as written by wrt: NumPy uses it only for headers over 64 KB.
    with path.open("wb") as file:
        np.lib.format.write_array(file, pixels, version=_NPY_VERSION)


# --- Textures as images of 8 bits ------------------------------------------------------------------


def codes_of(pixels: NDArray[np.float32], *, linear: bool) -> NDArray[np.uint8] | None:
    """Return the 8-bit codes that decode to the (H, W, 3) values of an image, or None if there are none.

    Codes stand for linear values if `linear`, otherwise for sRGB.
    """
    values = of_codes(linear=linear)
    places = np.searchsorted(values, pixels).clip(0, 255)
    return places.astype(np.uint8) if np.array_equal(values[places], pixels) else None


def save_codes(handle: BinaryIO, codes: NDArray[np.uint8]) -> None:
    """Write (H, W, 3) codes to an open file as a PNG, with one channel where all three are the same."""
    from PIL import Image

    grey = bool((codes == codes[..., :1]).all())
    Image.fromarray(np.ascontiguousarray(codes[..., 0] if grey else codes)).save(handle, format="PNG")
