"""Parse numbers, vectors and transforms from XML."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wrt.io.mitsuba.document import Element
from wrt.linalg import determinant, norm, product
from wrt.values import Vec3, vec3

Matrix = NDArray[np.float64]


def numbers_of(element: Element, text: str, *counts: int) -> tuple[float, ...]:
    """Return the finite numbers in the text of an element, as many as one of `counts`, or any number of them."""
    words = text.replace(",", " ").split()
    if counts and len(words) not in counts:
        plural = "" if counts == (1,) else "s"
        raise element.error(f"{element.label} takes {' or '.join(map(str, counts))} number{plural}, not {text!r}")
    try:
        result = tuple(float(word) for word in words)
    except ValueError:
        raise element.error(f"{element.label}: not a number in {text!r}") from None
    if not all(math.isfinite(x) for x in result):
        raise element.error(f"{element.label}: numbers must be finite, not {text!r}")
    return result


def vector_of(element: Element, default: float = 0.0) -> Vec3:
    """Return a vector from `value`, one or three numbers, or from `x`, `y` and `z`, which may be `default`."""
    if "value" in element.attributes:
        values = numbers_of(element, element.get("value"), 1, 3)
        return (values[0],) * 3 if len(values) == 1 else (values[0], values[1], values[2])
    x, y, z = (numbers_of(element, element.attributes.get(key, str(default)), 1)[0] for key in "xyz")
    return x, y, z


def transform_of(element: Element) -> Matrix:
    """Return the (4, 4) matrix of a `transform`, whose children apply in order."""
    result = np.eye(4)
    for child in element.children:
        maker = _MAKERS.get(child.tag)
        if maker is None:
            raise child.error(f"<{child.tag}> is not a transform; use one of {', '.join(_MAKERS)}")
        result = product(maker(child), result)
    return result


def _translate(element: Element) -> Matrix:
    result = np.eye(4)
    result[:3, 3] = vector_of(element)
    return result


def _scale(element: Element) -> Matrix:
    return np.diag([*vector_of(element, default=1.0), 1.0])


def _rotate(element: Element) -> Matrix:
    """Return a rotation by degrees, counter-clockwise about the axis (Rodrigues' formula)."""
    axis = np.array(vector_of(element))
    length = norm(axis)
    if length == 0.0:
        raise element.error("the axis of a rotation must not be zero")
    angle = math.radians(numbers_of(element, element.get("angle"), 1)[0])
    x, y, z = axis / length
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result = np.eye(4)
    result[:3, :3] += math.sin(angle) * k + (1.0 - math.cos(angle)) * product(k, k)
    return result


def _look_at(element: Element) -> Matrix:
    """Return the camera's left, up and forward axes and its origin as columns."""
    origin, target = (np.array(numbers_of(element, element.get(key), 3)) for key in ("origin", "target"))
    forward = target - origin
    length = norm(forward)
    if length == 0.0:
        raise element.error("origin and target must differ")
    forward /= length
    if "up" in element.attributes:
        up = np.array(numbers_of(element, element.get("up"), 3))
    else:
        up = np.eye(3)[int(np.argmin(np.abs(forward)))]
    x = np.cross(up, forward)  # to the left
    if norm(x) <= 1e-9 * max(norm(up), 1e-300):
        raise element.error("up must not be zero or parallel to the view")
    x /= norm(x)
    result = np.eye(4)
    result[:3] = np.stack([x, np.cross(forward, x), forward, origin], axis=1)
    return result


def _matrix(element: Element) -> Matrix:
    values = np.array(numbers_of(element, element.get("value"), 9, 16))
    result = np.eye(4)
    size = math.isqrt(len(values))
    result[:size, :size] = values.reshape(size, size)
    return result


_MAKERS = {
    "translate": _translate,
    "scale": _scale,
    "rotate": _rotate,
    "lookat": _look_at,
    "matrix": _matrix,
}


def rotation_part(matrix: Matrix) -> tuple[Matrix, NDArray[np.float64], bool]:
    """Return the (3, 3) rotation of a transform, its scale along the rotated axes, and whether it has shear.

    The columns of the rotation are unit vectors; a mirroring transform has a negative scale along x.
    """
    linear = matrix[:3, :3]
    stretch = np.linalg.norm(linear, axis=0)
    axes = linear / stretch
    if determinant(axes) < 0.0:
        axes[:, 0], stretch[0] = -axes[:, 0], -stretch[0]
    return axes, stretch, not np.allclose(product(axes.T, axes), np.eye(3), atol=1e-4)


def axis_and_degrees(turn: Matrix) -> tuple[Vec3, float]:
    """Return the unit axis and the angle of a (3, 3) rotation."""
    cosine = 0.5 * (float(np.trace(turn)) - 1.0)
    skew = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = norm(skew)
    if sine > 1e-6:
        axis = skew / sine
    else:
        # At 180 degrees (R + 1) / 2 is the outer product of the axis with itself; at 0 any axis will do.
        column = (turn + np.eye(3))[:, int(np.argmax(np.diag(turn)))]
        axis = column / norm(column)
    return vec3(axis), math.degrees(math.atan2(sine, cosine))
