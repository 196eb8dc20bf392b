import math
from dataclasses import dataclass

import warp as wp

import wrt
from wrt.kernels.core.rays import Ray, Receiver, make_frame, to_world
from wrt.kernels.core.scene_data import LightRecord, LightShape
from wrt.kernels.lights.area_lights import front_shines_back, meet_plane
from wrt.kernels.lights.record import BEFORE_LIGHT, NO_MEETING, LightModel, LightSample
from wrt.scene.description import Color, NotNegative, Number, Vector
from wrt.scene.lights.light import Direction, LightExtent
from wrt.values import number


@wp.func
def pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    area = wp.pi * (shape.size[1] * shape.size[1] - shape.size[0] * shape.size[0])
    return distance * distance / (wp.abs(wp.dot(direction, shape.normal)) * area)


@wp.func
def sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    s = LightSample()
    r = wp.sqrt(wp.lerp(shape.size[0] * shape.size[0], shape.size[1] * shape.size[1], u[0]))
    phi = 2.0 * wp.pi * u[1]
    on_ring = to_world(make_frame(shape.normal), wp.vec3(r * wp.cos(phi), r * wp.sin(phi), 0.0))
    to_light = shape.place + on_ring - receiver.position
    distance = wp.length(to_light)
    if wp.dot(to_light, shape.normal) < 0.0:
        s.wi = to_light / distance
        s.distance = distance * BEFORE_LIGHT
        s.pdf = pdf(shape, receiver, s.wi, distance)
        s.radiance = light.value
    return s


@wp.func
def meet(shape: LightShape, ray: Ray) -> float:
    t = meet_plane(shape, ray)
    r = wp.length(ray.origin + ray.direction * t - shape.place)
    return wp.where(r >= shape.size[0] and r <= shape.size[1], t, NO_MEETING)


@dataclass(frozen=True)
class RingLight(wrt.Light):
    """A flat ring of constant radiance (W·sr⁻¹·m⁻²), from its front, to which its normal points; in metres."""

    center: Vector
    normal: Direction
    inner: NotNegative = 0.3
    outer: Number = 0.5
    radiance: Color = 1.0

    type_name = "ring"

    def __post_init__(self) -> None:
        super().__post_init__()
        number(self.outer, "outer", above=self.inner)

    def record(self):
        return {"value": self.radiance}

    def shape(self):
        return {"place": self.center, "normal": self.normal, "size": (self.inner, self.outer)}

    def extent(self) -> LightExtent:
        reach = [self.outer * math.sqrt(max(1.0 - n * n, 0.0)) for n in self.normal]
        corners = [[c + sign * r for c, r in zip(self.center, reach)] for sign in (-1.0, 1.0)]
        area = math.pi * (self.outer**2 - self.inner**2)
        return LightExtent(corners, self.normal, self.radiance, math.pi * area)


wrt.register_light(RingLight, LightModel(sample, pdf, meet, front_shines_back))

if __name__ == "__main__":
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 4.0), fov_degrees=35.0))
    scene.add(wrt.sphere(), material=wrt.Plastic((0.5, 0.1, 0.1)))
    scene.add(wrt.quad((-9.0, -9.0, -2.0), (18.0, 0.0, 0.0), (0.0, 18.0, 0.0)))
    scene.add_light(RingLight((0.0, 0.0, 4.5), (0.0, 0.0, -1.0), 0.8, 1.2, radiance=12.0))
    wrt.save_image("ring.png", wrt.render(scene, width=512, height=512, spp=32))
