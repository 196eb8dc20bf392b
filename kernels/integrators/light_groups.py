"""Light groups: the radiance of a path, by the group of the light that it comes from."""

import warp as wp

from wrt.kernels.core.rays import Receiver
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.lights.choice import make_light_choice

GROUPS = 16
"""Most groups, of light without one included: each path has three numbers for each."""

GroupSums = wp.types.vector(length=3 * GROUPS, dtype=float)
"""Radiance by group: three channels of light without a group, then those of the first named group, and so on."""

GroupTotals = wp.types.vector(length=3 * GROUPS, dtype=wp.float64)
"""Such sums over the samples of a pixel."""

NO_LIGHT_OF_TABLE = wp.constant(-1)
"""Stands for the emission of media and of unlit surfaces, which are no lights of the table."""


@wp.func
def add_to_group(scene: SceneData, sums: GroupSums, light: int, radiance: wp.vec3) -> GroupSums:
    """Return the sums with the radiance of a light; the number of lights stands for the environment."""
    result = sums
    first = 3 * scene.light_groups[light + 1]
    for k in range(3):
        result[first + k] = sums[first + k] + radiance[k]
    return result


@wp.func
def colored(sums: GroupSums, factor: wp.vec3) -> GroupSums:
    """Return the sums with the channels of each group multiplied by a factor."""
    result = sums
    for k in range(3 * GROUPS):
        result[k] = sums[k] * factor[k % 3]
    return result


@specialised()
def make_add_to_chosen_group(light_tree: bool) -> wp.Function:
    """Return (scene, sums, receiver, u_light, radiance) -> the sums with the radiance of the light that was sampled.

    That light is chosen once more, as for next-event estimation, so that kernels without groups need not pass it on.
    """
    choose_light = make_light_choice(light_tree).choose_light

    @wp.func
    def add_to_chosen_group(
        scene: SceneData, sums: GroupSums, receiver: Receiver, u_light: wp.vec4, radiance: wp.vec3
    ) -> GroupSums:
        result = sums
        if wp.max(radiance) > 0.0:
            result = add_to_group(scene, sums, choose_light(scene, receiver, u_light).light, radiance)
        return result

    return add_to_chosen_group


@wp.func
def read_totals(sums: wp.array2d(dtype=wp.float64), pixel: int, first: int) -> GroupTotals:
    """Return the totals of a pixel, whose channels of groups are those from `first` on."""
    totals = GroupTotals()
    for k in range(3 * GROUPS):
        if first + k < sums.shape[1]:
            totals[k] = sums[pixel, first + k]
    return totals


@wp.func
def write_totals(sums_out: wp.array2d(dtype=wp.float64), pixel: int, first: int, totals: GroupTotals):
    """Set what `read_totals` reads."""
    for k in range(3 * GROUPS):
        if first + k < sums_out.shape[1]:
            sums_out[pixel, first + k] = totals[k]


@wp.func
def add_to_layers(sums_out: wp.array2d(dtype=wp.float64), pixel: int, first: int, sample: GroupSums):
    """Add a sample to the totals of a pixel, in memory."""
    for channel in range(first, sums_out.shape[1]):
        sums_out[pixel, channel] = sums_out[pixel, channel] + wp.float64(sample[channel - first])
