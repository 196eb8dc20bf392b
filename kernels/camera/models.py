"""Camera models by name, the dispatch among them, from a point on the film to a ray and back, and rays of samples.

A model is a `CameraModel` (`kernels/camera/camera.py`). To add one, write it into `projections.py`, name it in
`BUILT_IN`, and describe it in `wrt/scene/camera.py`; `CAMERA_MODELS.register` adds one from outside the package.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.camera.camera import Camera, CameraModel, CameraRay, shutter_time
from wrt.kernels.core.features import Features
from wrt.kernels.core.motion import transform_at
from wrt.kernels.core.registry import Registry, model_number
from wrt.kernels.core.specialise import specialised
from wrt.kernels.sampling.sampler import BLOCK_FILM_AND_LENS, BLOCK_TIME, NO_PIXEL, Sampler, make_sample_camera

BUILT_IN = ("perspective", "orthographic", "panorama", "fisheye")
"""Models in all kernels: the dispatch takes no time, and more variants would mean more kernels to compile."""


def _check(name: str, model: CameraModel) -> None:
    """Accept all models: both functions are required."""


DISTORTED = ("distorted_perspective", "distorted_fisheye")
"""Models in kernels of scenes that use them, like those from outside."""

_FILES = dict.fromkeys(BUILT_IN, "projections") | dict.fromkeys(DISTORTED, "distortion")

CAMERA_MODELS: Registry[CameraModel] = Registry(
    {name: f"wrt.kernels.camera.{file}" for name, file in _FILES.items()}, _check
)
current_name = CAMERA_MODELS.current_name


class CameraFunctions(NamedTuple):
    """The device functions that dispatch on `Camera.kind`.

    Attributes:
        ray: (camera, film: vec2, u_lens: vec2, time) -> CameraRay through a point of the picture, in pixels; (0, 0) is
            the top left corner of the whole picture.
        film_position: (camera, point, distant: bool, time) -> vec2: the point of the picture, in pixels, where the lens
            centre sees a point at a time. A `distant` point is a direction. Undefined for points that the camera
            cannot see, such as those behind it.
        along_axis: (camera, point, time) -> float: how far a point is from the lens along the viewing axis, metres.
    """

    ray: wp.Function
    film_position: wp.Function
    along_axis: wp.Function


@specialised()
def make_camera(outside: tuple[str, ...] = ()) -> CameraFunctions:
    """Return the functions for the models in all kernels and those `outside` (see `Features.cameras`)."""
    model = _make_model((*outside, *BUILT_IN))
    model_ray, project = model.ray, model.project

    @wp.func
    def camera_ray(camera: Camera, film: wp.vec2, u_lens: wp.vec2, time: float) -> CameraRay:
        x = (film[0] - 0.5 * float(camera.width)) * camera.pixel[0] + camera.shift[0]
        y = (0.5 * float(camera.height) - film[1]) * camera.pixel[1] + camera.shift[1]
        result = model_ray(camera, x, y, u_lens)
        ray = result.ray
        if camera.motion.keys > 0:
            placement = transform_at(camera.motion_keys, camera.motion, time)
            ray.origin = placement.linear * ray.origin + placement.offset
            ray.direction = wp.normalize(placement.linear * ray.direction)
        ray.time = time
        result.ray = ray
        return result

    @wp.func
    def film_position(camera: Camera, point: wp.vec3, distant: bool, time: float) -> wp.vec2:
        vector = point
        if camera.motion.keys > 0:
            placement = transform_at(camera.motion_keys, camera.motion, time)
            back = wp.inverse(placement.linear)
            if distant:
                vector = back * point
            else:
                vector = back * (point - placement.offset)
        if not distant:
            vector = vector - camera.origin
        p = project(camera, wp.dot(vector, camera.right), wp.dot(vector, camera.up), wp.dot(vector, camera.forward))
        return wp.vec2(
            (p[0] - camera.shift[0]) / camera.pixel[0] + 0.5 * float(camera.width),
            0.5 * float(camera.height) - (p[1] - camera.shift[1]) / camera.pixel[1],
        )

    @wp.func
    def along_axis(camera: Camera, point: wp.vec3, time: float) -> float:
        vector = point
        if camera.motion.keys > 0:
            placement = transform_at(camera.motion_keys, camera.motion, time)
            vector = wp.inverse(placement.linear) * (point - placement.offset)
        return wp.dot(vector - camera.origin, camera.forward)

    return CameraFunctions(camera_ray, film_position, along_axis)


@specialised()
def _make_model(names: tuple[str, ...]) -> CameraModel:
    """Return functions that dispatch among the models `names` by number, one link of a chain each."""
    model = CAMERA_MODELS.model_of(names[0])
    if not names[1:]:
        return model
    number = model_number(names[0])
    model_ray, model_project = model.ray, model.project
    following = _make_model(names[1:])
    next_ray, next_project = following.ray, following.project

    @wp.func
    def ray_through(camera: Camera, x: float, y: float, u_lens: wp.vec2) -> CameraRay:
        if camera.kind == wp.static(number):
            return model_ray(camera, x, y, u_lens)
        return next_ray(camera, x, y, u_lens)

    @wp.func
    def project(camera: Camera, right: float, up: float, forward: float) -> wp.vec2:
        if camera.kind == wp.static(number):
            return model_project(camera, right, up, forward)
        return next_project(camera, right, up, forward)

    return CameraModel(ray_through, project)


@wp.func
def filter_offset(table: wp.array(dtype=float), u: float) -> float:
    """Return the offset from the pixel's centre along one axis, in pixels."""
    last = table.shape[0] - 1
    # Entries are closer towards both ends, where the inverse distribution is steep. They are spaced by a square root:
    # an arc sine fits no better and took 4 % of a path in the Cornell box.
    x = wp.sqrt(0.5 * wp.min(u, 1.0 - u))
    x = wp.where(u < 0.5, x, 1.0 - x) * float(last)
    i = wp.min(int(x), last - 1)
    f = x - float(i)
    return table[i] * (1.0 - f) + table[i + 1] * f


@wp.struct
class CameraSample:
    """A camera ray, and the point through which it goes, in pixels of the whole picture."""

    seen: CameraRay
    position: wp.vec2


@specialised("sampler", "caustics", "instances")
def make_camera_time(features: Features) -> wp.Function:
    """Return the device function (camera, sampler) -> time of a sample, seconds, while the shutter is open."""
    sample_camera = make_sample_camera(features.sampler)

    @wp.func
    def camera_time(camera: Camera, sampler: Sampler) -> float:
        if not camera.shutter_close > camera.shutter_open:
            return camera.shutter_open
        clock = Sampler()
        clock.seed = sampler.seed
        clock.index = sampler.index
        clock.pixel = sampler.pixel
        if wp.static(features.shares_times):
            clock.pixel = NO_PIXEL
        return shutter_time(camera, sample_camera(clock, BLOCK_TIME)[0])

    return camera_time


@specialised("cameras", *make_camera_time.fields)
def make_camera_sample(features: Features) -> wp.Function:
    """Return (camera, filter_table, sampler, x, y) -> CameraSample through the pixel in column x and row y."""
    camera_ray = make_camera(features.cameras).ray
    sample_camera, camera_time = make_sample_camera(features.sampler), make_camera_time(features)

    @wp.func
    def camera_sample(
        camera: Camera, filter_table: wp.array(dtype=float), sampler: Sampler, x: int, y: int
    ) -> CameraSample:
        sample = CameraSample()
        u = sample_camera(sampler, BLOCK_FILM_AND_LENS)
        sample.position = wp.vec2(
            float(x) + 0.5 + filter_offset(filter_table, u[0]),
            float(y) + 0.5 + filter_offset(filter_table, u[1]),
        )
        sample.seen = camera_ray(camera, sample.position, wp.vec2(u[2], u[3]), camera_time(camera, sampler))
        return sample

    return camera_sample
