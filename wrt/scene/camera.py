"""Cameras: position, projection, lens and shutter."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import inverse, norm, product
from wrt.scene.camera_matrices import Intrinsics, pose_of_extrinsics, pose_of_matrix
from wrt.scene.description import Flag, Kind, NotNegative, Number, Positive, Vector, instance_of, optional, word_of
from wrt.scene.distortion import BROWN, FISHEYE, brown, coefficients, film_of_brown, film_of_fisheye, fisheye_radius
from wrt.scene.motion import Motion
from wrt.values import array, integer, number

APERTURES = ("disk", "square", "polygon")
"""Shapes of the aperture."""

_RIGID = 1e-4
"""Tolerance for stretch in a camera's motion, due to rounding."""

_PARALLEL = 1e-9
"""Sine of the angle between `up` and the view below which they count as parallel."""

C = TypeVar("C", bound="Camera")
Points = NDArray[np.float64]


@dataclass(frozen=True)
class Camera(Kind):
    """Base of all cameras.

    Attributes:
        origin: position of the camera, metres; the centre of the lens if it has one.
        target: point the camera looks at, in the centre of the picture unless the lens is shifted.
        up: a direction that points up in the picture. If it is parallel to the view, +x points right instead, or +y
            if the view is along x.
        shutter_open: time when the shutter begins to open, seconds.
        shutter_close: time when the shutter is closed again, seconds; equal to `shutter_open` for an instant.
        shutter_ramp: fraction of that time that opening and closing take, half each, linearly: 0 is a box, 1 a
            triangle.
        motion: motion of the camera, applied to `origin`, `target` and `up`.
    """

    origin: Vector = (0.0, 0.0, 3.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    _: KW_ONLY
    shutter_open: Number = 0.0
    shutter_close: Number = 0.0
    shutter_ramp: Annotated[float, partial(number, minimum=0.0, maximum=1.0)] = 0.0
    motion: Annotated[Motion | None, optional(instance_of(Motion))] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shutter_close < self.shutter_open:
            raise InputError(
                f"camera shutter_close must not be before shutter_open: {self.shutter_close:g} is before "
                f"{self.shutter_open:g}"
            )
        if self.motion is not None and np.abs(self.motion.parts.stretches - np.eye(3)).max() > _RIGID:
            raise InputError("camera motion must be rigid: one of its keys stretches or mirrors")
        self.frame()

    def _label(self, name: str) -> str:
        return f"camera {name}"

    def frame(self) -> np.ndarray:
        """Return the orthonormal rows right, up and forward, (3, 3) float64."""
        forward = np.subtract(self.target, self.origin)
        distance = norm(forward)
        if distance == 0.0:
            raise InputError("camera origin and target must differ")
        forward = forward / distance
        if not np.any(self.up):
            raise InputError("camera up must not be zero")
        right = np.cross(forward, self.up)
        if norm(right) <= _PARALLEL * norm(self.up):
            axis = np.eye(3)[0 if abs(forward[0]) < 0.9 else 1]
            right = axis - forward * product(axis, forward)
        right = right / norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    @classmethod
    def from_matrix(cls: type[C], matrix: ArrayLike, *, convention: str = "opengl", **fields: Any) -> C:
        """Return a camera at a rigid transform from its axes to the world.

        Args:
            matrix: (4, 4) or (3, 4), such as `transform_matrix` in a file transforms.json.
            convention: the camera's axes: "opengl", x right, y up and z backward, as in Blender and nerfstudio, or
                "opencv", x right, y down and z forward.
            fields: the camera's other fields.

        Raises:
            InputError: if the matrix is not rigid.
        """
        return cls(**pose_of_matrix(matrix, convention), **fields)

    @classmethod
    def from_opencv(
        cls: type[C],
        K: ArrayLike,
        R: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        t: ArrayLike = (0.0, 0.0, 0.0),
        width: int | None = None,
        height: int | None = None,
        *,
        pixel_center: float = 0.0,
        **fields: Any,
    ) -> C:
        """Return the camera of matrices in OpenCV's convention, for pictures of width x height pixels.

        A point X of the world is at R X + t along the camera's axes, x right, y down and z forward, and without
        distortion at the pixel K (R X + t) / z of a perspective camera. The camera renders the same view at other sizes
        of the same aspect.

        Args:
            K: (3, 3) matrix of intrinsics, pixels: focal lengths fx and fy, the principal point cx and cy, no skew.
            R: (3, 3) rotation from the world to the camera, or a rotation vector (3,) as of `cv2.solvePnP`.
            t: (3,) translation, metres.
            width: of the picture, pixels.
            height: of the picture, pixels.
            pixel_center: both coordinates of the middle of the first pixel: 0 in OpenCV, 0.5 in COLMAP and nerfstudio.
            fields: the camera's other fields, such as `distortion`.

        Raises:
            InputError: if a matrix is not of its kind, or the camera neither perspective nor a fisheye.
        """
        if width is None or height is None:
            raise InputError("from_opencv needs the width and the height of the picture to which K belongs, in pixels")
        width, height = (
            integer(n, what, minimum=1, maximum=2**31) for n, what in ((width, "width"), (height, "height"))
        )
        intrinsics = cls._with_intrinsics(Intrinsics.of_matrix(K, width, height, pixel_center))
        return cls(**pose_of_extrinsics(R, t), **intrinsics, **fields)

    @classmethod
    def _with_intrinsics(cls, lens: Intrinsics) -> dict[str, Any]:
        """Return fields for focal lengths and a principal point."""
        raise InputError(f"{cls.__name__} has no focal lengths; take a PerspectiveCamera or a FisheyeCamera")

    def matrix(self) -> Points:
        """Return the (4, 4) float64 transform from OpenGL's axes of the camera to the world, at shutter open.

        The inverse of `from_matrix`.
        """
        right, up, forward = self.frame()
        matrix = np.eye(4)
        matrix[:3] = np.stack([right, up, -forward, self.origin], axis=1)
        return matrix if self.motion is None else product(self.motion.at(self.shutter_open), matrix)

    def project(self, points: ArrayLike, width: int, height: int, *, time: float | None = None) -> Points:
        """Return where points of the world are in a picture, (N, 2) float64 pixels to the right and down.

        (0, 0) is the top left corner of the picture, and (0.5, 0.5) the middle of its first pixel, which is (0, 0) in
        OpenCV. Points that the camera cannot see, such as those behind it, are NaN; others may be beside the picture.

        Args:
            points: (N, 3) metres.
            width: of the picture, pixels.
            height: of the picture, pixels.
            time: seconds, for a camera that moves; by default when the shutter opens.
        """
        places = array(points, "points", np.float64)
        if places.ndim != 2 or places.shape[1] != 3:
            raise InputError(f"points must be (N, 3), not {places.shape}")
        if self.motion is not None:
            matrix = inverse(self.motion.at(self.shutter_open if time is None else time))
            places = product(places, matrix[:3, :3].T) + matrix[:3, 3]
        film = self.film(width, height)
        with np.errstate(all="ignore"):
            seen = self._on_film(product(places - np.array(self.origin), self.frame().T), film)
        offset = (seen - film.get("shift", (0.0, 0.0))) / film["pixel"]
        return np.asarray(np.array([0.5 * width, 0.5 * height]) + offset * (1.0, -1.0))

    def _on_film(self, points: Points, film: dict[str, Any]) -> Points:
        """Return the points of the film, (N, 2), where the camera sees (N, 3) points along its axes; NaN if nowhere."""
        raise InputError(f"{type(self).__name__} does not say where points are in its picture")

    def film(self, width: int, height: int) -> dict[str, Any]:
        """Return fields of the kernels' Camera for a picture of this size in pixels.

        `pixel` is the width and the height of a pixel on the film, in the model's unit. `shift` (the centre of the
        picture on the film), `limit` and `parameters` are given if the model needs them.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class LensCamera(Camera):
    """A camera with a thin lens, whose aperture shapes out-of-focus highlights.

    Attributes:
        aperture_radius: radius of the aperture or of the circle around it, metres. At 0 everything is in focus.
        focus_distance: distance to the focal plane, along the view; by default that to `target`.
        aperture: "disk", "square" with upright sides, or "polygon" with a corner at the top.
        aperture_blades: number of corners of the polygon.
        aperture_rotation_degrees: turns the aperture counter-clockwise, as lights beyond the focal plane show it.
    """

    _: KW_ONLY
    aperture_radius: NotNegative = 0.0
    focus_distance: Annotated[float | None, optional(partial(number, above=0.0))] = None
    aperture: Annotated[str, word_of(APERTURES)] = "disk"
    aperture_blades: Annotated[int, partial(integer, minimum=3, maximum=1000)] = 6
    aperture_rotation_degrees: Number = 0.0

    @property
    def distance_in_focus(self) -> float:
        """The focus distance in use, metres."""
        if self.focus_distance is not None:
            return self.focus_distance
        return norm(np.subtract(self.target, self.origin))


@dataclass(frozen=True)
class PerspectiveCamera(LensCamera):
    """A thin-lens perspective camera; with aperture radius 0 a pinhole.

    Attributes:
        fov_degrees: vertical field of view before any shift, at most 179.
        pixel_aspect: width of a pixel on the film over its height: fy / fx for focal lengths in pixels.
        shift_x: lens shift to the right, in picture heights.
        shift_y: lens shift upwards, in picture heights.
        distortion: Brown's coefficients k1, k2, p1, p2, k3, k4, k5 and k6 as in OpenCV; those left out are 0.
    """

    type_name: ClassVar[str] = "perspective"

    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=179.0)] = 40.0
    _: KW_ONLY
    pixel_aspect: Positive = 1.0
    shift_x: Number = 0.0
    shift_y: Number = 0.0
    distortion: Annotated[tuple[float, ...], partial(coefficients, names=BROWN)] = ()

    @property
    def model(self) -> str:
        return "distorted_perspective" if self.distortion else "perspective"

    @classmethod
    def _with_intrinsics(cls, lens: Intrinsics) -> dict[str, Any]:
        return {**lens.film(), "fov_degrees": math.degrees(2.0 * math.atan(0.5 * lens.height / lens.fy))}

    def film(self, width: int, height: int) -> dict[str, Any]:
        pixel = 2.0 * math.tan(math.radians(self.fov_degrees) / 2.0) / height
        shift = (self.shift_x * height * pixel, self.shift_y * height * pixel)
        distortion = film_of_brown(self.distortion) if self.distortion else {}
        return {"pixel": (pixel * self.pixel_aspect, pixel), "shift": shift, **distortion}

    def _on_film(self, points: Points, film: dict[str, Any]) -> Points:
        plane = np.where(points[:, 2:] > 0.0, points[:, :2] / points[:, 2:], np.nan)
        return brown(plane, film) if self.distortion else plane


@dataclass(frozen=True)
class OrthographicCamera(LensCamera):
    """A camera with parallel rays: objects do not shrink with distance.

    It sees everything in front of the plane through `origin`.

    Attributes:
        view_height: height of the view, metres.
    """

    type_name: ClassVar[str] = "orthographic"

    view_height: Positive = 2.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        return {"pixel": (self.view_height / height, self.view_height / height)}

    def _on_film(self, points: Points, film: dict[str, Any]) -> Points:
        return np.where(points[:, 2:] >= 0.0, points[:, :2], np.nan)


@dataclass(frozen=True)
class PanoramaCamera(Camera):
    """A spherical camera in latitude-longitude layout, like an environment image.

    Attributes:
        horizontal_degrees: range of longitude, at most 360, centred on the target.
        vertical_degrees: range of latitude, at most 180, centred on the target.
    """

    type_name: ClassVar[str] = "panorama"

    horizontal_degrees: Annotated[float, partial(number, above=0.0, maximum=360.0)] = 360.0
    vertical_degrees: Annotated[float, partial(number, above=0.0, maximum=180.0)] = 180.0

    def film(self, width: int, height: int) -> dict[str, Any]:
        degrees = (self.horizontal_degrees / width, self.vertical_degrees / height)
        return {"pixel": (math.radians(degrees[0]), math.radians(degrees[1]))}

    def _on_film(self, points: Points, film: dict[str, Any]) -> Points:
        right, up, forward = points.T
        return np.stack([np.arctan2(right, forward), np.arctan2(up, np.hypot(right, forward))], axis=1)


@dataclass(frozen=True)
class FisheyeCamera(Camera):
    """An equidistant fisheye: distance from the picture's centre is proportional to the angle.

    The picture is a circle as wide as its shorter side, black outside.

    Attributes:
        fov_degrees: field of view across the circle before any distortion, at most 360.
        pixel_aspect: width of a pixel on the film over its height: fy / fx for focal lengths in pixels.
        shift_x: lens shift to the right, in picture heights.
        shift_y: lens shift upwards, in picture heights.
        distortion: coefficients k1, k2, k3 and k4 of OpenCV's fisheye; those left out are 0.
        circular: whether the picture is black beyond `fov_degrees`; otherwise it is filled up to its corners.
    """

    type_name: ClassVar[str] = "fisheye"

    fov_degrees: Annotated[float, partial(number, above=0.0, maximum=360.0)] = 180.0
    _: KW_ONLY
    pixel_aspect: Positive = 1.0
    shift_x: Number = 0.0
    shift_y: Number = 0.0
    distortion: Annotated[tuple[float, ...], partial(coefficients, names=FISHEYE)] = ()
    circular: Flag = True

    @property
    def model(self) -> str:
        return "distorted_fisheye" if self.distortion else "fisheye"

    @classmethod
    def _with_intrinsics(cls, lens: Intrinsics) -> dict[str, Any]:
        side = min(lens.width, lens.height)
        return {**lens.film(), "fov_degrees": math.degrees(side / lens.fy), "circular": False}

    def film(self, width: int, height: int) -> dict[str, Any]:
        pixel = math.radians(self.fov_degrees) / min(width, height)
        shift = (self.shift_x * height * pixel, self.shift_y * height * pixel)
        limit = math.radians(self.fov_degrees) / 2.0 if self.circular else math.pi
        distortion = film_of_fisheye(self.distortion, limit) if self.distortion else {"limit": limit}
        return {"pixel": (pixel * self.pixel_aspect, pixel), "shift": shift, **distortion}

    def _on_film(self, points: Points, film: dict[str, Any]) -> Points:
        across = np.hypot(points[:, 0], points[:, 1])
        radius = fisheye_radius(np.arctan2(across, points[:, 2]), film)
        return points[:, :2] * np.where(across > 0.0, radius / across, radius)[:, None]


CAMERAS: dict[str, type[Camera]] = {
    cls.type_name: cls for cls in (PerspectiveCamera, OrthographicCamera, PanoramaCamera, FisheyeCamera)
}
"""Cameras by their `type` in scene files."""


def require_camera(value: object) -> None:
    """Raise InputError unless a value is a camera."""
    if not isinstance(value, tuple(CAMERAS.values())):
        raise InputError(f"the scene's camera must be one of wrt's cameras, not {type(value).__name__}")
