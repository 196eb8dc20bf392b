"""Choosing a light for a point: by power alone if there are few, by a light tree if there are many."""

from typing import NamedTuple

import warp as wp

from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.tree import (
    FAR_LIGHT,
    NO_LIGHT,
    far_light_probability,
    light_tree_probability,
    sample_light_tree,
)
from wrt.kernels.sampling.warps import sample_alias
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.specialise import specialised


@wp.struct
class LightChoice:
    """A light's number, the probability of its choice, and two random numbers for a point on it.

    The number is NO_LIGHT and the probability 0 if no light reaches the receiver.
    """

    light: int
    probability: float
    u: wp.vec2


class LightChoosing(NamedTuple):
    """The two functions of a way to choose lights.

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
    found = sample_light_tree(
        scene.light_tree, receiver.position, receiver.normal, receiver.receives, wp.vec2(u[2], u[0])
    )
    choice = LightChoice()
    choice.light = found.light
    choice.probability = found.probability
    choice.u = wp.vec2(found.rest, u[3])
    if found.light == FAR_LIGHT:
        drawn = sample_alias(scene.light_thresholds, scene.light_aliases, found.rest, found.more)
        choice.light = drawn.index
        choice.probability = found.probability * scene.lights[drawn.index].probability
        choice.u = wp.vec2(drawn.rest, u[3])
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
