"""Videos: MP4 through ffmpeg, WebP and GIF through Pillow."""

from __future__ import annotations

import functools
import itertools
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.develop.picture import develop_image
from wrt.errors import InputError, one_line
from wrt.io.safe_read import PathLike
from wrt.io.safe_write import Kind, output_path, require_writable, write_atomically
from wrt.values import number

Pixels = NDArray[np.uint8]

VIDEO_SUFFIXES = (".mp4", ".webp", ".gif")
"""File types of videos."""

_MARK = f"wrt {__version__} video"
_MARK_PATTERN = re.compile(rb"wrt .{0,30} video", re.DOTALL)
_SEARCHED = 1 << 20
"""Bytes at the start and at the end of a file that are searched for the mark, which shows that wrt made a video."""

_ENCODERS = {
    "libx264": ("-crf", "17", "-preset", "slow"),
    "libopenh264": ("-b:v", "12M"),
    "h264_videotoolbox": ("-q:v", "70"),
}
"""H.264 encoders of ffmpeg in order of preference, with their quality settings."""

_WEBP_QUALITY = 90
_GIF_COLORS = 256
_PALETTE_FRAMES = 16
_PALETTE_WIDTH = 320


def _has_mark(path: Path) -> bool:
    size = path.stat().st_size
    with path.open("rb") as file:
        beginning = file.read(_SEARCHED)
        file.seek(max(0, size - _SEARCHED))
        return _MARK_PATTERN.search(beginning + file.read()) is not None


VIDEO = Kind("a video that wrt has made", _has_mark)


def is_video(path: PathLike) -> bool:
    """Return whether a path ends like a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def check_video(path: PathLike, *, fps: float, force: bool = False) -> Path:
    """Check before a long render that a video can be written to a path, and return the path.

    Raises:
        InputError: if the suffix is not in VIDEO_SUFFIXES, the path cannot be written, an MP4 needs ffmpeg and there is
            none, or the file type does not support the frame rate.
    """
    file = output_path(path, "a video")
    if not is_video(file):
        raise InputError(f"{file}: the name of a video must end in one of {', '.join(VIDEO_SUFFIXES)}")
    number(fps, "fps", above=0.0, maximum=1000.0)
    if file.suffix.lower() == ".gif" and fps > 50.0:
        raise InputError(
            f"{file}: viewers show at most 50 frames of a GIF per second; choose fewer fps, or .webp or .mp4"
        )
    if file.suffix.lower() == ".mp4":
        find_encoder(str(file))
    require_writable(file, VIDEO, force=force)
    return file


def save_video(path: PathLike, frames: Iterable[Any], fps: float = 24.0, *, force: bool = False) -> None:
    """Write frames as an MP4 (H.264), an animated WebP or an animated GIF, by the suffix.

    WebP and GIF loop forever. An MP4 is Rec. 709 video, 4:2:0; an odd width or height loses its last column or row. A
    GIF has one palette of 256 colors for all frames, with error diffusion, and times in hundredths of a second, rounded
    so that they add up.

    Args:
        path: ends in .mp4, .webp or .gif. An MP4 needs ffmpeg, from the system or by `pip install 'wrt[video]'`.
        frames: (H, W, 3) arrays of equal size: linear radiance in floating point, or uint8 sRGB.
        fps: frames per second.
        force: whether to replace a file that wrt did not write.

    Raises:
        InputError: see `check_video`; also if there are no frames, their shapes are wrong or differ, or writing fails.
        Exception: any exception of `frames`; nothing is written then.
    """
    file = check_video(path, fps=fps, force=force)
    write = {".mp4": _write_mp4, ".webp": _write_webp, ".gif": _write_gif}[file.suffix.lower()]
    failures: list[Exception] = []
    checked = _checked(file, _recording(frames, failures))
    first = next(checked, None)
    if first is None:
        raise InputError(f"{file}: there are no frames")
    try:
        write_atomically(file, lambda temporary: write(temporary, first, checked, float(fps)), VIDEO, force=force)
    except InputError:
        if not failures:
            raise
    if failures:
        raise failures[0]


def _recording(frames: Iterable[Any], failures: list[Exception]) -> Iterator[Any]:
    """Yield frames; record their exceptions, which are not failures to write the file."""
    try:
        yield from frames
    except Exception as error:
        failures.append(error)
        raise


def _checked(file: Path, frames: Iterable[Any]) -> Iterator[Pixels]:
    """Yield frames as 8-bit pixels."""
    shape: tuple[int, ...] | None = None
    for index, frame in enumerate(frames):
        pixels = np.asarray(frame)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
            raise InputError(f"{file}: frame {index} must be (H, W, 3), not {pixels.shape}")
        if shape is not None and pixels.shape != shape:
            raise InputError(f"{file}: frame {index} is {pixels.shape}, but those before are {shape}")
        shape = pixels.shape
        if pixels.dtype == np.uint8:
            yield np.ascontiguousarray(pixels)
        elif pixels.dtype.kind == "f":
            yield develop_image(frame, exposure=0.0)  # with its background, if it is `wrt.render`'s
        else:
            raise InputError(f"{file}: frame {index} must be of floating-point numbers or uint8, not {pixels.dtype}")


@functools.cache
def _encoder_of(program: str) -> str | None:
    """Return the best H.264 encoder of an ffmpeg, or None."""
    try:
        listed = subprocess.run([program, "-hide_banner", "-encoders"], capture_output=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    words = listed.stdout.decode(errors="replace").split()
    return next((name for name in _ENCODERS if name in words), None)


def _programs() -> Iterator[str]:
    """Yield the ffmpeg of the system, then the one of imageio-ffmpeg."""
    if (program := shutil.which("ffmpeg")) is not None:
        yield program
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        yield get_ffmpeg_exe()
    except (ImportError, RuntimeError):  # not installed, or without a program for this platform
        pass


def find_encoder(path: str) -> tuple[str, str]:
    """Return the program and the encoder that write an MP4, or raise InputError about `path`."""
    has_ffmpeg = False
    for program in _programs():
        if (encoder := _encoder_of(program)) is not None:
            return program, encoder
        has_ffmpeg = True
    cause = "the ffmpeg here has no H.264 encoder" if has_ffmpeg else "an MP4 needs ffmpeg"
    raise InputError(f"{path}: {cause}; install ffmpeg, or run: pip install 'wrt[video]'; or choose .webp or .gif")


def _write_mp4(path: Path, first: Pixels, frames: Iterator[Pixels], fps: float) -> None:
    height, width, _ = first.shape
    if width < 2 or height < 2:
        raise InputError(f"an MP4 must be at least 2x2, not {width}x{height}")
    program, encoder = find_encoder(str(path))
    filters = "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"
    command = [program, "-hide_banner", "-loglevel", "error", "-nostdin", "-y"]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.6g}", "-i", "pipe:0"]
    command += ["-an", "-vf", filters, "-c:v", encoder, *_ENCODERS[encoder], "-pix_fmt", "yuv420p"]
    command += ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"]
    command += ["-movflags", "+faststart", "-metadata", f"comment={_MARK}", "-f", "mp4", os.fspath(path.absolute())]
    with tempfile.TemporaryFile() as messages:
        # A session of its own keeps Ctrl-C from it: this process decides whether to finish the video.
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=messages, start_new_session=True
        )
        assert process.stdin is not None
        try:
            for pixels in itertools.chain([first], frames):
                process.stdin.write(pixels.data)
            process.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg has ended; its message says why
        except BaseException:
            process.kill()
            process.wait()
            raise
        if process.wait() != 0:
            messages.seek(0)
            last_line = one_line(messages.read().decode(errors="replace").strip().rpartition("\n")[2])
            raise OSError(f"ffmpeg failed: {last_line or f'status {process.returncode}'}")


def _write_webp(path: Path, first: Pixels, frames: Iterator[Pixels], fps: float) -> None:
    from PIL import Image

    pictures = [Image.fromarray(pixels) for pixels in itertools.chain([first], frames)]
    mark = f"<!-- {_MARK} -->".encode()
    _save_animation(path, "WEBP", pictures, fps, unit=1, quality=_WEBP_QUALITY, method=4, xmp=mark)


def _write_gif(path: Path, first: Pixels, frames: Iterator[Pixels], fps: float) -> None:
    from PIL import Image

    pictures = [Image.fromarray(pixels) for pixels in itertools.chain([first], frames)]
    palette = _palette(pictures)
    indexed = [each.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for each in pictures]
    _save_animation(path, "GIF", indexed, fps, unit=10, optimize=False, comment=_MARK.encode())


def _palette(pictures: list[Any]) -> Any:
    """Return an image with one palette for all pictures, since colors would flicker if each had its own."""
    from PIL import Image

    step = -(-len(pictures) // _PALETTE_FRAMES)
    width, height = pictures[0].size
    share = min(1.0, _PALETTE_WIDTH / width)
    size = max(1, round(width * share)), max(1, round(height * share))
    samples = [picture.resize(size) for picture in pictures[::step]]
    sheet = Image.new("RGB", (size[0], size[1] * len(samples)))
    for row, sample in enumerate(samples):
        sheet.paste(sample, (0, row * size[1]))
    return sheet.quantize(_GIF_COLORS, method=Image.Quantize.MEDIANCUT, kmeans=1)


def _save_animation(path: Path, kind: str, pictures: list[Any], fps: float, *, unit: int, **options: Any) -> None:
    """Write a looping animation whose times, in multiples of `unit` milliseconds, add up to those of the frame rate."""
    ends = [round(1000.0 * number / fps / unit) * unit for number in range(len(pictures) + 1)]
    options["duration"] = [max(unit, end - start) for start, end in itertools.pairwise(ends)]
    pictures[0].save(path, format=kind, save_all=True, append_images=pictures[1:], loop=0, **options)
