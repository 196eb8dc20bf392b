"""Choosing among many lights by their importance at a point, in a descent of a light tree.

The importance of a group of lights is that of Conty Estevez and Kulla, "Importance Sampling of Many Lights with
Adaptive Tree Splitting" (2018), with the trigonometry of Pharr, Jakob and Humphreys, "Physically Based Rendering",
4th edition, section 12.6.3: power over distance squared, times upper bounds of the cosines at the lights and at the
point. Nodes have eight children (`wrt/upload/lights/tree.py`), whose importances are computed together.
"""

import warp as wp

from wrt.kernels.native import include

light_tree_h = include("light_tree.h")

NO_LIGHT = wp.constant(-1)
FAR_LIGHT = wp.constant(-2)


@wp.struct
class LightTree:
    """The tree in the layout of `wrt.upload.lights.tree.LightTree`, with at least one node.

    `far` is the irradiance of all lights at infinity; `scale` converts the importance of the root's children to an
    irradiance.
    """

    nodes: wp.array(dtype=float)
    parents: wp.array(dtype=int)
    places: wp.array(dtype=int)
    scale: float
    far: float


@wp.struct
class TreeChoice:
    """A light, FAR_LIGHT for the lights outside the tree, or NO_LIGHT, and the probability of the choice.

    `rest` and `more` are the rescaled random numbers: uniform in [0, 1), `more` with the further digits.
    """

    light: int
    probability: float
    rest: float
    more: float


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
def sample_light_tree(tree: LightTree, position: wp.vec3, normal: wp.vec3, receives: int, u: wp.vec2) -> TreeChoice:
    """Return a light for the point `position`, chosen by the random number `u[0]`, whose lower digits are `u[1]`.

    Args:
        tree: the lights.
        position: of the receiver.
        normal: unit vector; ignored for RECEIVES_ANYWHERE.
        receives: a RECEIVES constant.
        u: two numbers in [0, 1) with 24 bits.
    """
    found = _sample_tree(tree, position, normal, receives, u)
    choice = TreeChoice()
    choice.light = wp.cast(found[0], wp.int32)
    choice.probability = found[1]
    choice.rest = found[2]
    choice.more = found[3]
    return choice
