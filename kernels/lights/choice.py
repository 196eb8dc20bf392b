"""Choosing a light for a point: by power alone if there are few, by a light tree if there are many.

The importance of a group of lights is that of Conty Estevez and Kulla, "Importance Sampling of Many Lights with
Adaptive Tree Splitting" (2018), with the trigonometry of Pharr, Jakob and Humphreys, "Physically Based Rendering",
4th edition, section 12.6.3: power over distance squared, times upper bounds of the cosines at the lights and at the
point. Nodes have eight children (`wrt/upload/lights/tree.py`), whose importances are computed together.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.rays import Receiver
from wrt.kernels.core.scene_data import LightTree, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.native import include
from wrt.kernels.sampling.warps import sample_alias

light_tree_h = include("light_tree.h")

NO_LIGHT = wp.constant(-1)
FAR_LIGHT = wp.constant(-2)


@wp.struct
class LightChoice:
    """A light's number, the probability of its choice, and two random numbers for a point on it.

    The number is NO_LIGHT and the probability 0 if no light reaches the receiver.
    """

    light: int
    probability: float
    u: wp.vec2


@wp.func_native("return wrt::sample_light_tree(tree, position, normal, receives, u);")
def _sample_tree(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int, u: wp.vec2) -> wp.vec4:
    light_tree_h()


@wp.func_native("return wrt::light_probability(tree, light, position, normal, receives);")
def light_tree_probability(tree: LightTree, light: int, position: wp.vec3, normal: wp.vec3, receives: int) -> float:
    """Return the probability with which `sample_light_tree` chooses a light, from the light upwards."""
    light_tree_h()


@wp.func_native("return wrt::far_light_probability(tree, position, normal, receives);")
def far_light_probability(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int) -> float:
    """Return the probability with which `sample_light_tree` returns FAR_LIGHT."""
    light_tree_h()


@wp.func
def sample_light_tree(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int, u: wp.vec2) -> LightChoice:
    """Return a light for the point `position`, chosen by the random number `u[0]`, whose lower digits are `u[1]`.

    It may be FAR_LIGHT, any light outside the tree. The result's random numbers are `u` rescaled.

    Args:
        tree: the lights.
        position: of the receiver.
        normal: unit vector; ignored for RECEIVES_ANYWHERE.
        receives: a RECEIVES constant.
        u: two numbers in [0, 1) with 24 bits.
    """
    found = _sample_tree(tree, position, normal, receives, u)
    choice = LightChoice()
    choice.light = wp.cast(found[0], wp.int32)
    choice.probability = found[1]
    choice.u = wp.vec2(found[2], found[3])
    return choice


class LightChoosing(NamedTuple):
    """The two functions of a method to choose lights.

    Attributes:
        choose_light: (scene, receiver, u vec4) -> LightChoice. u[2] chooses and, rescaled, is the first coordinate of
            the point on the light: so the points on a light of two triangles are as evenly spread as the pair u[2],
            u[3]. u[0] extends the digits of u[2].
        choice_probability: (scene, receiver, light) -> the probability that choose_light chooses this light there.
    """

    choose_light: wp.Function
    choice_probability: wp.Function


@wp.func
def choose_by_power(scene: SceneData, receiver: Receiver, u: wp.vec4) -> LightChoice:
    """Return a light with a probability that is the same everywhere."""
    drawn = sample_alias(scene.light_thresholds, scene.light_aliases, u[2], u[0])
    choice = LightChoice()
    choice.light = drawn.index
    choice.probability = scene.lights[choice.light].probability
    choice.u = wp.vec2(drawn.rest, u[3])
    return choice


@wp.func
def probability_by_power(scene: SceneData, receiver: Receiver, light: int) -> float:
    """Return the probability of `choose_by_power`."""
    return scene.lights[light].probability


@wp.func
def choose_by_tree(scene: SceneData, receiver: Receiver, u: wp.vec4) -> LightChoice:
    """Return a light by its importance at the receiver; the table has only those at infinity."""
    if scene.light_tree.nodes.shape[0] == 0:
        return choose_by_power(scene, receiver, u)
    u_tree = wp.vec2(u[2], u[0])
    choice = sample_light_tree(scene.light_tree, receiver.position, receiver.normal, receiver.receives, u_tree)
    if choice.light == FAR_LIGHT:
        drawn = sample_alias(scene.light_thresholds, scene.light_aliases, choice.u[0], choice.u[1])
        choice.light = drawn.index
        choice.probability = choice.probability * scene.lights[drawn.index].probability
        choice.u = wp.vec2(drawn.rest, 0.0)
    choice.u = wp.vec2(choice.u[0], u[3])
    return choice


@wp.func
def probability_by_tree(scene: SceneData, receiver: Receiver, light: int) -> float:
    """Return the probability of `choose_by_tree`."""
    if scene.light_tree.nodes.shape[0] == 0:
        return probability_by_power(scene, receiver, light)
    if scene.light_tree.places[light] != NO_LIGHT:
        return light_tree_probability(scene.light_tree, light, receiver.position, receiver.normal, receiver.receives)
    far = far_light_probability(scene.light_tree, receiver.position, receiver.normal, receiver.receives)
    return far * scene.lights[light].probability


@specialised()
def make_light_choice(light_tree: bool) -> LightChoosing:
    """Return the functions that use a light tree or power alone."""
    if light_tree:
        return LightChoosing(choose_by_tree, probability_by_tree)
    return LightChoosing(choose_by_power, probability_by_power)
