"""Lights with a shape that is not made of triangles: their models, and the dispatch among them.

A model is a `LightModel` (see `kernels/lights/record.py`). To add one, write it, name its module in `_MODULES`, and
describe it in `wrt/scene/lights/`; `LIGHT_SHAPES.register` adds one from outside the package.

Lights that rays can hit have a tree of their own, through which a ray goes after the tree of triangles. In a hit, a
triangle number below NO_HIT names such a light.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import NO_HIT, Hit
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.registry import Registry, model_number
from wrt.kernels.core.scene_data import FIRST_LIGHT_SHAPE, LightBox, LightRecord, LightShape, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.lights.record import NO_MEETING, LightModel, LightSample
from wrt.kernels.native import include

light_boxes_h = include("light_boxes.h")

BUILT_IN = ("spot", "rectangle", "disk", "sphere", "sun")
"""Models in the kernels of all scenes with any light shape: further variants would mean more kernels to compile."""


def _check(name: str, model: LightModel) -> None:
    if (model.meet is None) != (model.shines_back is None):
        raise ValueError(f"{name}: a light that rays can meet needs both `meet` and `shines_back`")
    if model.meet is not None and model.covers is not None:
        raise ValueError(f"{name}: a light has `meet`, or `covers` if it is at infinity, not both")
    if (model.pdf is None) != (model.meet is None and model.covers is None):
        raise ValueError(f"{name}: a light needs a `pdf` if it has `meet` or `covers`, and only then")


_MODULES = dict.fromkeys(BUILT_IN, "wrt.kernels.lights.area_lights") | dict.fromkeys(
    ("spot", "projector"), "wrt.kernels.lights.spot"
)
LIGHT_SHAPES: Registry[LightModel] = Registry(_MODULES, _check)
current_name = LIGHT_SHAPES.current_name

_FIRST = wp.constant(-2)


@wp.func
def hit_number(shape: int) -> int:
    """Return the number that stands for a light shape in a Hit's `triangle`."""
    return _FIRST - shape


@wp.func
def shape_number(hit: Hit) -> int:
    """Return the index in `light_shapes` that was hit; negative for a triangle or a miss."""
    return _FIRST - hit.triangle


def light_order(name: str) -> int:
    """Return 0 for lights that rays can hit, 1 for those at infinity that rays find, 2 for the others.

    Raises:
        KeyError: if no model has this name.
    """
    model = LIGHT_SHAPES.model_of(name)
    return 0 if model.meet else 1 if model.covers else 2


def light_kind(name: str) -> int:
    """Return the kind that stands for a model in kernels."""
    return int(FIRST_LIGHT_SHAPE) + model_number(name)


# --- By kind ---------------------------------------------------------------------------------------


@specialised()
def make_light_model(names: tuple[str, ...]) -> LightModel:
    """Return device functions that dispatch among the models `names` by `light_kind`, one link of a chain each."""
    if not names:
        return LightModel(_no_sample, _no_pdf, _no_meeting, _no_light, _no_cover)
    model, kind = LIGHT_SHAPES.model_of(names[0]), light_kind(names[0])
    following = make_light_model(names[1:])

    @wp.func
    def sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
        if shape.kind == wp.static(kind):
            return model.sample(light, shape, receiver, u)
        return following.sample(light, shape, receiver, u)

    @wp.func
    def pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
        if shape.kind == wp.static(kind):
            return model.pdf(shape, receiver, direction, distance)
        return following.pdf(shape, receiver, direction, distance)

    @wp.func
    def meet(shape: LightShape, ray: Ray) -> float:
        if shape.kind == wp.static(kind):
            return model.meet(shape, ray)
        return following.meet(shape, ray)

    @wp.func
    def shines_back(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
        if shape.kind == wp.static(kind):
            return model.shines_back(light, shape, ray)
        return following.shines_back(light, shape, ray)

    @wp.func
    def covers(shape: LightShape, direction: wp.vec3) -> bool:
        if shape.kind == wp.static(kind):
            return model.covers(shape, direction)
        return following.covers(shape, direction)

    return LightModel(
        sample,
        pdf if model.pdf else following.pdf,
        meet if model.meet else following.meet,
        shines_back if model.shines_back else following.shines_back,
        covers if model.covers else following.covers,
    )


def are_textured(names: tuple[str, ...]) -> bool:
    """Return whether any of the models `names` has a texture."""
    return any(LIGHT_SHAPES.model_of(name).textured for name in names)


@specialised()
def make_middle_of(names: tuple[str, ...]) -> wp.Function:
    """Return the device function kind -> vec2, the numbers that sample the centre of a light."""
    if not names:
        return _no_middle
    kind, (x, y) = light_kind(names[0]), LIGHT_SHAPES.model_of(names[0]).middle
    next_middle = make_middle_of(names[1:])
    if x == y == 0.0:
        return next_middle

    @wp.func
    def middle_of(kind_of_light: int) -> wp.vec2:
        if kind_of_light == wp.static(kind):
            return wp.vec2(wp.static(x), wp.static(y))
        return next_middle(kind_of_light)

    return middle_of


@wp.func
def _no_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    return LightSample()


@wp.func
def _no_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return 0.0


@wp.func
def _no_meeting(shape: LightShape, ray: Ray) -> float:
    return NO_MEETING


@wp.func
def _no_light(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
    return False


@wp.func
def _no_cover(shape: LightShape, direction: wp.vec3) -> bool:
    return False


@wp.func
def _no_middle(kind_of_light: int) -> wp.vec2:
    return wp.vec2(0.0)


# --- All of a scene --------------------------------------------------------------------------------


@wp.func_native("return wrt::next_light_box(boxes, origin, direction, reach, skipped, place);")
def _next_light_box(
    boxes: wp.array(dtype=LightBox), origin: wp.vec3, direction: wp.vec3, reach: float, skipped: int, place: int
) -> wp.vec2i:
    """Return where the next box of a light is, from `place` on, which a ray may meet before `reach`, or −1.

    The light shape `skipped` does not count. The second number is not 0 if it may: kernels for several lanes are told
    of boxes that the ray of another lane meets.
    """
    light_boxes_h()


class LightShapes(NamedTuple):
    """Device functions for the light shapes of scenes with certain models.

    Attributes:
        sample: (scene, light record, receiver, u: vec2) -> LightSample, as of a model, with `point` filled in.
        nearer: (scene, ray, hit) -> Hit: the nearest light shape on a ray before `hit`, or else that.
        blocks: (scene, ray, distance, aim) -> bool: whether a light shape other than `aim` lies before `distance`.
    """

    sample: wp.Function
    nearer: wp.Function
    blocks: wp.Function


@specialised()
def make_light_shapes(names: tuple[str, ...]) -> LightShapes:
    """Return the functions for scenes with these models."""
    model = make_light_model(names)

    @wp.func
    def sample_light_shape(scene: SceneData, light: LightRecord, receiver: Receiver, u: wp.vec2) -> LightSample:
        sample = model.sample(light, scene.light_shapes[light.shape], receiver, u)
        sample.point.triangle = NO_HIT
        if light.shape < scene.solid_light_shapes:
            sample.point.triangle = hit_number(light.shape)
        return sample

    @wp.func
    def nearer_light_shape(scene: SceneData, ray: Ray, hit: Hit) -> Hit:
        nearest = float(hit.t)  # infinite for a miss
        found = _next_light_box(scene.light_boxes, ray.origin, ray.direction, nearest, -1, 0)
        while found[0] >= 0:
            i = scene.light_boxes[found[0]].shape
            t = model.meet(scene.light_shapes[i], ray)
            if found[1] != 0 and t > 0.0 and t < nearest:
                nearest = t
                hit.t = t
                hit.triangle = hit_number(i)
            found = _next_light_box(scene.light_boxes, ray.origin, ray.direction, nearest, -1, found[0] + 1)
        return hit

    @wp.func
    def light_shape_blocks(scene: SceneData, ray: Ray, distance: float, aim: Hit) -> bool:
        blocked = bool(False)
        found = _next_light_box(scene.light_boxes, ray.origin, ray.direction, distance, shape_number(aim), 0)
        while found[0] >= 0:
            i = scene.light_boxes[found[0]].shape
            t = model.meet(scene.light_shapes[i], ray)
            if found[1] != 0 and t > 0.0 and t < distance:
                blocked = True
            found = _next_light_box(
                scene.light_boxes, ray.origin, ray.direction, distance, shape_number(aim), found[0] + 1
            )
        return blocked

    return LightShapes(sample_light_shape, nearer_light_shape, light_shape_blocks)


@specialised("instances", "exact", "light_shapes")
def make_closest_hit(features: Features) -> wp.Function:
    """Return the device function (scene, ray) -> the nearest hit; its triangle is NO_HIT for a miss.

    For a hit on a light shape, it is a number below NO_HIT.
    """
    triangles = make_intersect(features.geometry)
    if not features.light_shapes:
        return triangles.closest_hit
    nearer_light_shape = make_light_shapes(features.light_shapes).nearer

    @wp.func(name=f"closest_hit_{features.geometry}_lights")
    def nearest(scene: SceneData, ray: Ray) -> Hit:
        return nearer_light_shape(scene, ray, triangles.closest_hit(scene, ray))

    return nearest


@specialised(*make_closest_hit.fields)
def make_hit_seen(features: Features) -> wp.Function:
    """Return the device function (scene, ray, with_lights) -> the nearest hit; without lights, on a triangle."""
    nearest, triangle_hit = make_closest_hit(features), make_intersect(features.geometry).closest_hit

    @wp.func
    def hit_seen(scene: SceneData, ray: Ray, with_lights: bool) -> Hit:
        if wp.static(bool(features.light_shapes)):
            if not with_lights:
                return triangle_hit(scene, ray)
        return nearest(scene, ray)

    return hit_seen
