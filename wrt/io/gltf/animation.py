"""The first animation of a glTF file: its nodes, and the weights of their morph targets, at a time.

Format: Khronos Group 2021, "glTF 2.0 Specification", section 3.11 and appendix C (interpolation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.gltf.buffers import Buffers, Tree
from wrt.linalg import norm, product

Array = NDArray[np.float64]

_PLACE = {"translation": 3, "rotation": 4, "scale": 3}
"""Properties of a node's place, with their numbers of components."""

PATHS = (*_PLACE, "weights")
"""Properties of a node that are followed."""

_NEARLY_ALIKE = 0.9995
"""Cosine of half the angle between two rotations above which slerp divides by almost nothing."""


def ends_of(tree: Tree, buffers: Buffers) -> tuple[float, float] | None:
    """Return the times of the first and last keyframe of the first animation, seconds; None if there is none.

    Raises:
        InputError: on times that do not increase.
    """
    used = {sampler["input"] for _, _, sampler in _channels(tree)}
    times = [_times(number, buffers) for number in sorted(used)]
    return (min(float(t[0]) for t in times), max(float(t[-1]) for t in times)) if times else None


def pose(tree: Tree, buffers: Buffers, seconds: float) -> None:
    """Give the nodes the places and weights that they have at a time; before and after all keyframes they rest.

    Raises:
        InputError: on an animation that cannot be evaluated.
    """
    nodes = tree["nodes"]
    for number, name, sampler in _channels(tree):
        node = nodes[number]
        if name in _PLACE and "matrix" in node:
            raise InputError(f"{buffers.path}: node {number} is animated, but placed by a matrix, which glTF forbids")
        times = _times(sampler["input"], buffers)
        method = sampler.get("interpolation", "LINEAR")
        rows = buffers.numbers(sampler["output"]).astype(np.float64)
        keys = rows.reshape(len(times), 3 if method == "CUBICSPLINE" else 1, -1)
        if name in _PLACE and keys.shape[2] != _PLACE[name]:
            raise InputError(f"{buffers.path}: keyframes of a {name} do not have {_PLACE[name]} numbers each")
        if not np.isfinite(keys).all():
            raise InputError(f"{buffers.path}: keyframes of a {name} are not finite")
        value = interpolated(times, keys, method, seconds, rotation=name == "rotation")
        node[name] = value.tolist()


def interpolated(times: Array, keys: Array, method: str, seconds: float, *, rotation: bool = False) -> Array:
    """Return (C,) the value of a curve at a time.

    Args:
        times: (K,) seconds, increasing.
        keys: (K, 1, C) values, or for CUBICSPLINE (K, 3, C) in-tangents, values and out-tangents.
        method: LINEAR, STEP or CUBICSPLINE.
        seconds: the time; before the first and after the last key the value is theirs.
        rotation: whether values are quaternions; they are interpolated along the shorter arc and have unit length.

    Raises:
        InputError: on another method.
    """
    if method not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise InputError(f"keyframes are interpolated by {method!r}, which glTF does not have")
    values = keys[:, keys.shape[1] // 2]
    last = int(np.searchsorted(times, seconds, side="right")) - 1
    if last < 0 or last == len(times) - 1 or method == "STEP":
        value = values[max(last, 0)]
    else:
        step = float(times[last + 1] - times[last])
        t = (seconds - float(times[last])) / step
        if method == "CUBICSPLINE":
            value = _hermite(values[last], step * keys[last, 2], values[last + 1], step * keys[last + 1, 0], t)
        elif rotation:
            value = _slerp(_unit(values[last]), _unit(values[last + 1]), t)
        else:
            value = (1.0 - t) * values[last] + t * values[last + 1]
    return _unit(value) if rotation else value


def _hermite(start: Array, leaving: Array, end: Array, arriving: Array, t: float) -> Array:
    """Return the cubic with the values and derivatives by t at t = 0 and t = 1."""
    t2, t3 = t * t, t * t * t
    return (
        (2.0 * t3 - 3.0 * t2 + 1.0) * start
        + (t3 - 2.0 * t2 + t) * leaving
        + (3.0 * t2 - 2.0 * t3) * end
        + (t3 - t2) * arriving
    )


def _slerp(start: Array, end: Array, t: float) -> Array:
    """Return the unit quaternion a part t of the shorter arc from one to another, up to its length."""
    cosine = float(product(start, end))
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > _NEARLY_ALIKE:
        return (1.0 - t) * start + t * end
    angle = np.arccos(cosine)
    return np.asarray(np.sin((1.0 - t) * angle) * start + np.sin(t * angle) * end)


def _unit(quaternion: Array) -> Array:
    length = norm(quaternion)
    return quaternion / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])


def _channels(tree: Tree) -> list[tuple[int, str, Tree]]:
    """Return the node's number, the property and the sampler of each channel that is followed."""
    animation: Tree = next(iter(tree.get("animations", [])), {})
    return [
        (channel["target"]["node"], channel["target"]["path"], animation["samplers"][channel["sampler"]])
        for channel in animation.get("channels", [])
        if channel["target"]["path"] in PATHS and "node" in channel["target"]
    ]


def _times(number: int, buffers: Buffers) -> Array:
    """Return (K,) the times of keyframes."""
    times = buffers.numbers(number).astype(np.float64)
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        raise InputError(f"{buffers.path}: the times of an animation's keyframes do not increase")
    return times
