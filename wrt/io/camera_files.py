"""Cameras of files transforms.json (instant-ngp, nerfstudio) and of COLMAP's text files.

Formats: the documentation of nerfstudio ("Data conventions") and of COLMAP ("Output format", "Camera models"). Both
count pixels from the corner of the picture, so the middle of the first one is (0.5, 0.5).
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from wrt._version import __version__
from wrt.errors import InputError, did_you_mean
from wrt.io.cameras import unique
from wrt.io.safe_read import PathLike, as_text, confined_to, naming_file, read_file, require_inside
from wrt.io.safe_write import Kind, output_path, write_atomically
from wrt.scene.camera import Camera, FisheyeCamera, PerspectiveCamera
from wrt.scene.camera_matrices import pose_of_extrinsics, pose_of_matrix
from wrt.values import array, integer, number

_MOST_PIXELS = 65536


@dataclass(frozen=True)
class FileCamera:
    """A camera of a file, and the size of its picture.

    Attributes:
        camera: the camera.
        width: of the picture, pixels.
        height: of the picture, pixels.
    """

    camera: Camera
    width: int
    height: int


def load_cameras(path: PathLike, *, confined: bool = False) -> dict[str, FileCamera]:
    """Load the cameras of a dataset of pictures, by the names of the pictures without folder and suffix.

    Args:
        path: a file transforms.json of instant-ngp or nerfstudio, or a folder with COLMAP's cameras.txt and images.txt,
            or one of these two files. Places are those of the file: `applied_transform` of nerfstudio, which its
            points have as well, is not undone.
        confined: refuse to look at pictures outside the file's folder, by whose size frames without w and h are read.

    Raises:
        InputError: if it cannot be used; the message names the file and the picture.
    """
    file = Path(path)
    if confined:
        with confined_to(file if file.is_dir() else file.parent):
            return load_cameras(path)
    if file.is_dir() or file.name in ("cameras.txt", "images.txt"):
        folder = file if file.is_dir() else file.parent
        found = list(_of_colmap(folder))
        file = folder / "images.txt"
    elif file.suffix.lower() == ".json":
        with naming_file(file):
            found = list(_of_transforms(file))
    else:
        raise InputError(f"{path}: cameras are read from transforms.json, or from COLMAP's cameras.txt and images.txt")
    if not found:
        raise InputError(f"{file}: has no cameras")
    names = [PurePosixPath(name.replace("\\", "/")) for name, _ in found]
    short = [name.stem for name in names]
    if len(set(short)) < len(short):
        short = ["_".join(part for part in name.with_suffix("").parts if part not in ("/", "..")) for name in names]
    return dict(zip(unique(short), (camera for _, camera in found), strict=True))


def _camera(
    kind: type[Camera], f: tuple[float, float], c: tuple[float, float], size: tuple[int, int], distortion: Any
) -> FileCamera:
    """Return a camera with intrinsics, at the origin."""
    k = np.array([[f[0], 0.0, c[0]], [0.0, f[1], c[1]], [0.0, 0.0, 1.0]])
    camera = kind.from_opencv(k, width=size[0], height=size[1], pixel_center=0.5, distortion=distortion)
    return FileCamera(camera, *size)


@contextmanager
def _naming(what: str) -> Iterator[None]:
    """Within the context, make every InputError begin with a name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from None


def _placed(found: FileCamera, pose: dict[str, Any]) -> FileCamera:
    return dataclasses.replace(found, camera=dataclasses.replace(found.camera, **pose))


# --- transforms.json -------------------------------------------------------------------------------

_KINDS: dict[str, tuple[type[Camera], tuple[str, ...]]] = {
    "OPENCV": (PerspectiveCamera, ("k1", "k2", "p1", "p2", "k3")),
    "FULL_OPENCV": (PerspectiveCamera, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "PINHOLE": (PerspectiveCamera, ()),
    "SIMPLE_PINHOLE": (PerspectiveCamera, ()),
    "OPENCV_FISHEYE": (FisheyeCamera, ("k1", "k2", "k3", "k4")),
}
"""Classes and coefficients of distortion by `camera_model`."""

_COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


def _of_transforms(file: Path) -> Iterator[tuple[str, FileCamera]]:
    text = as_text(read_file(file))
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not valid JSON: {error}") from None
    frames = tree.get("frames") if isinstance(tree, dict) else None
    if not isinstance(frames, list):
        raise InputError("has no list of frames")
    size_of = functools.cache(_size_of_picture)  # frames may share a picture
    for index, frame in enumerate(frames):
        if not isinstance(frame, dict):
            raise InputError(f"frame {index} is no table")
        name = str(frame.get("file_path") or f"frame_{index:05d}")
        with _naming(f"frame {index} ({name})"):
            if "transform_matrix" not in frame:
                raise InputError("has no transform_matrix")
            pose = pose_of_matrix(frame["transform_matrix"], "opengl")
            placed = _placed(_intrinsics({**tree, **frame}, file.parent / name, size_of), pose)
        yield name, placed


def _intrinsics(values: dict[str, Any], picture: Path, size_of: Callable[[Path], tuple[int, int]]) -> FileCamera:
    """Return the camera of a frame, given its keys and those of the file, and the path of its picture."""
    default = "OPENCV_FISHEYE" if values.get("is_fisheye") is True else "OPENCV"
    model = str(values.get("camera_model") or default)
    if model not in _KINDS:
        raise InputError(
            f"camera_model {model!r} is unknown{did_you_mean(model, _KINDS)}; known are {', '.join(_KINDS)}"
        )
    kind, names = _KINDS[model]
    if other := [name for name in _COEFFICIENTS if name not in names and _number(values, name, 0.0) != 0.0]:
        raise InputError(f"camera_model {model} has no {other[0]}, which is not 0")
    if "w" in values and "h" in values:
        # instant-ngp writes whole numbers with a decimal point.
        size = _pixels(number(values["w"], "w"), "w"), _pixels(number(values["h"], "h"), "h")
    else:
        size = size_of(picture)
    f = []
    for axis, side in zip("xy", size, strict=True):
        if (length := _number(values, f"fl_{axis}")) is None and (angle := _number(values, f"camera_angle_{axis}")):
            if not 0.0 < angle < math.pi:
                raise InputError(f"camera_angle_{axis} must be between 0 and pi radians, not {angle:g}")
            length = 0.5 * side / math.tan(0.5 * angle)
        f.append(length)
    fx, fy = (f[1] if f[0] is None else f[0], f[0] if f[1] is None else f[1])
    if fx is None or fy is None:
        raise InputError("has neither fl_x nor camera_angle_x")
    c = tuple(_number(values, f"c{axis}", 0.5 * side) for axis, side in zip("xy", size, strict=True))
    return _camera(kind, (fx, fy), c, size, [_number(values, name, 0.0) for name in names])


def _number(values: dict[str, Any], name: str, default: Any = None) -> Any:
    return default if values.get(name) is None else number(values[name], name)


def _size_of_picture(picture: Path) -> tuple[int, int]:
    for path in (picture, picture.with_name(f"{picture.name}.png")):
        require_inside(path)
        if path.is_file():
            from wrt.io.images import load_image

            height, width = load_image(path).shape[:2]
            return width, height
    raise InputError(f"has no w and h, and its picture {picture} is missing")


def _pixels(value: float, name: str) -> int:
    whole: Any = int(value) if value == int(value) else value
    return integer(whole, name, minimum=1, maximum=_MOST_PIXELS)


def save_cameras(
    path: PathLike, cameras: Mapping[str, Camera], width: int, height: int, *, force: bool = False
) -> None:
    """Write the cameras of a dataset of pictures as transforms.json, which nerfstudio and `load_cameras` read.

    Intrinsics are in pixels from the corner of the picture, matrices lead from the camera's axes of OpenGL to the
    world. Apertures and shutters are not part of the format; of a camera that moves it has the pose at shutter open.

    Args:
        path: ends in .json.
        cameras: perspective cameras and fisheyes, by the paths of their pictures relative to the file's folder.
        width: of the pictures, pixels.
        height: of the pictures, pixels.
        force: whether to replace a file that wrt did not write.

    Raises:
        InputError: for other cameras, or if the file cannot be written.
    """
    file = output_path(path, "a file of cameras")
    if file.suffix.lower() != ".json":
        raise InputError(f"{file}: the name of a file of cameras must end in .json")
    if not cameras:
        raise InputError(f"{file}: there are no cameras to write")
    lenses = []
    for name, camera in cameras.items():
        with _naming(f"{file}: {name}"):
            lenses.append(_written(camera, width, height))
    # What all have stands once, where readers of other programs expect it.
    shared = {key: value for key, value in lenses[0].items() if all(lens.get(key) == value for lens in lenses)}
    frames = [
        {"file_path": name, "transform_matrix": camera.matrix().tolist(), **lens}
        for (name, camera), lens in zip(cameras.items(), lenses, strict=True)
    ]
    frames = [{key: value for key, value in frame.items() if key not in shared} for frame in frames]
    tree = {"generator": f"wrt {__version__}", **shared, "frames": frames}
    text = json.dumps(tree, indent=1) + "\n"
    write_atomically(file, lambda made: made.write_text(text, encoding="utf-8"), _TRANSFORMS, force=force)


def _written(camera: Camera, width: int, height: int) -> dict[str, Any]:
    """Return the intrinsics of a camera for pictures of a size, and its distortion."""
    if isinstance(camera, PerspectiveCamera):
        fy, model = 0.5 * height / math.tan(0.5 * math.radians(camera.fov_degrees)), "OPENCV"
        model = "FULL_OPENCV" if any(camera.distortion[5:]) else model
    elif isinstance(camera, FisheyeCamera):
        fy, model = min(width, height) / math.radians(camera.fov_degrees), "OPENCV_FISHEYE"
    else:
        raise InputError(f"a {type(camera).__name__} has no focal lengths")
    fx = fy / camera.pixel_aspect
    values = {"camera_model": model, "w": width, "h": height, "fl_x": fx, "fl_y": fy}
    values["cx"] = 0.5 * width - camera.shift_x * height / camera.pixel_aspect
    values["cy"] = 0.5 * height + camera.shift_y * height
    if model != "OPENCV_FISHEYE":
        values["camera_angle_x"] = 2.0 * math.atan(0.5 * width / fx)
    _, names = _KINDS[model]
    return values | dict(zip(names, (float(each) for each in camera.distortion), strict=False))


def _is_own(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(32).startswith(b'{\n "generator": "wrt ')


_TRANSFORMS = Kind("a file of cameras that wrt has made", _is_own)

# --- COLMAP ----------------------------------------------------------------------------------------

_COLMAP: dict[str, tuple[type[Camera], str]] = {
    "SIMPLE_PINHOLE": (PerspectiveCamera, "f cx cy"),
    "PINHOLE": (PerspectiveCamera, "fx fy cx cy"),
    "SIMPLE_RADIAL": (PerspectiveCamera, "f cx cy k1"),
    "RADIAL": (PerspectiveCamera, "f cx cy k1 k2"),
    "OPENCV": (PerspectiveCamera, "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": (PerspectiveCamera, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": (FisheyeCamera, "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": (FisheyeCamera, "f cx cy k1"),
    "RADIAL_FISHEYE": (FisheyeCamera, "f cx cy k1 k2"),
}
"""Classes and parameters by COLMAP's names of models. Coefficients are in the order of `distortion`."""


def _of_colmap(folder: Path) -> Iterator[tuple[str, FileCamera]]:
    cameras = dict(_lines(folder / "cameras.txt", _lens_of, every=1))
    images = folder / "images.txt"
    for name, (camera, pose) in _lines(images, _image_of, every=2):
        with _naming(f"{images}: {name}"):
            if camera not in cameras:
                raise InputError(f"camera {camera} is not in cameras.txt")
            placed = _placed(cameras[camera], pose)
        yield name, placed


def _lines(file: Path, read: Callable[[list[str]], tuple[str, Any]], every: int) -> Iterator[tuple[str, Any]]:
    """Yield what `read` returns for each first of `every` lines that are no comments; points may be an empty line."""
    if not file.is_file() and file.with_suffix(".bin").is_file():
        raise InputError(
            f"{file}: no such file; 'colmap model_converter --output_type TXT' makes it of {file.stem}.bin"
        )
    with naming_file(file):
        lines = as_text(read_file(file)).splitlines()
    skip = 0
    for count, line in enumerate(lines, 1):
        if line.startswith("#"):
            continue
        if skip:
            skip -= 1
            continue
        if words := line.split():
            with _naming(f"{file}: line {count}"):
                yield read(words)
            skip = every - 1


def _lens_of(words: list[str]) -> tuple[str, FileCamera]:
    if len(words) < 2:
        raise InputError("a camera needs CAMERA_ID, MODEL, WIDTH, HEIGHT and parameters")
    name, model, *values = words
    if model not in _COLMAP:
        raise InputError(f"camera model {model!r} is unknown; known are {', '.join(_COLMAP)}")
    kind, text = _COLMAP[model]
    names = text.split()
    if len(values) != 2 + len(names):
        raise InputError(f"{model} needs width, height and {', '.join(names)}, not {len(values)} numbers")
    w, h, *found = (_float(value) for value in values)
    size = _pixels(w, "width"), _pixels(h, "height")
    focal = names.index("cx")
    fx, fy = found[0], found[focal - 1]
    return name, _camera(kind, (fx, fy), (found[focal], found[focal + 1]), size, found[focal + 2 :])


def _image_of(words: list[str]) -> tuple[str, tuple[str, dict[str, Any]]]:
    if len(words) < 10:
        raise InputError("an image needs IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID and NAME")
    w, x, y, z = (_float(word) for word in words[1:5])
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < length < 1.1:
        raise InputError(f"its quaternion must have the length 1, not {length:g}")
    w, x, y, z = (value / length for value in (w, x, y, z))
    rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    pose = pose_of_extrinsics(array(rotation, "rotation"), [_float(word) for word in words[5:8]])
    return " ".join(words[9:]), (words[8], pose)


def _float(word: str) -> float:
    try:
        return number(float(word), word)
    except ValueError:
        raise InputError(f"{word!r} is no number") from None
