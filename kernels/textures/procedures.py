"""Procedural textures by name, and the dispatch among those of a scene.

A model is a device function (values, surface) -> vec3 of the rows that the texture's description names and of the point
on the surface. Built-in ones are in the files beside this; `register_procedure` adds one from outside the package.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.bsdf import MAX_SLOTS, slot_values
from wrt.kernels.core.registry import Registry, model_number
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface


class Procedure(NamedTuple):
    """A procedural texture.

    Attributes:
        evaluate: (values: slot_values, surface) -> vec3, the colour at a point, or a number in its first channel.
        slots: the number of values that it reads, at most MAX_SLOTS.
    """

    evaluate: wp.Function
    slots: int


def _check(name: str, procedure: Procedure) -> None:
    if procedure.slots > MAX_SLOTS:
        raise ValueError(f"{name}: a texture reads at most {MAX_SLOTS} values, not {procedure.slots}")


_FILES = {"checkerboard": "patterns", "bricks": "patterns", "perlin": "noise", "worley": "noise"}
PROCEDURES: Registry[Procedure] = Registry(
    {name: f"wrt.kernels.textures.{file}" for name, file in _FILES.items()}, _check
)
register_procedure = PROCEDURES.register
current_name = PROCEDURES.current_name
model_of = PROCEDURES.model_of


@specialised()
def make_procedure(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (scene, model, first slot, surface) -> vec3 for the procedures `names`."""
    if not names:
        return _black
    (evaluate, count), number = model_of(names[0]), model_number(names[0])
    following = make_procedure(names[1:])

    @wp.func
    def procedure(scene: SceneData, model: int, first: int, surface: Surface) -> wp.vec3:
        if model == wp.static(number):
            values = slot_values()
            for k in range(wp.static(count)):
                values[k] = scene.slots[first + k].value
            return evaluate(values, surface)
        return following(scene, model, first, surface)

    return procedure


@wp.func
def _black(scene: SceneData, model: int, first: int, surface: Surface) -> wp.vec3:
    return wp.vec3(0.0)
