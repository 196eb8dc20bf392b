"""Rays against every triangle in float64, and bounds on the rounding errors of float32.

A ray tracer in float32 may differ from the exact answer where a ray passes an edge, or where two
triangles are equally far. The tolerance is derived, not chosen: each intersection test is a short formula,
and the rounding errors of its steps add up to a bound (Higham, "Accuracy and Stability of Numerical
Algorithms", 2nd edition, section 3.1). `woop` returns the three edge functions, the distance, and these bounds.
`explain` then decides whether an answer can be right.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

EPSILON = 2.0**-24
"""Largest relative error of one rounded operation in float32."""

SECOND_ORDER = 1.0 + 1e-6
"""Bounds below are sums of first-order terms; products of two of them are smaller than this."""

PAIRS = 200_000
"""Rays times triangles that are held in memory at once."""

Array = NDArray[np.float64]


class Tested(NamedTuple):
    """R rays tested against T triangles: (R, T) arrays, with a third axis of length 3 for edges.

    Edge functions are not negative inside: barycentric coordinates times `det`, their sum. Errors are how wrong values
    may be in float32, infinite for `t` where the ray may lie in the plane. Of hits nearer than `least_t` the tracer may
    leave out those below its first number, and leaves out those below its second.
    """

    edges: Array
    edge_error: Array
    det: Array
    t: Array
    t_error: Array
    least_t: Array

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the ray meets the triangle."""
        return (self.edges >= 0.0).all(axis=2) & (self.det > 0.0) & (self.t >= 0.0)

    @property
    def edges_clear(self) -> NDArray[np.bool_]:
        """Whether all edge functions are greater than they can be wrong."""
        return np.asarray((self.edges > self.edge_error).all(axis=2))

    @property
    def surely(self) -> NDArray[np.bool_]:
        """Whether the ray meets it however the edge functions and t are rounded."""
        clear = (self.t - self.t_error >= 0.0) & (self.t - self.t_error > self.least_t[:, :, 0])
        return self.edges_clear & clear

    @property
    def perhaps(self) -> NDArray[np.bool_]:
        """Whether the ray meets it for some rounding of them. Either sign will do where both may be."""
        front = (self.edges >= -self.edge_error).all(axis=2)
        back = (self.edges <= self.edge_error).all(axis=2)
        clear = (self.t + self.t_error >= 0.0) & (self.t + self.t_error > self.least_t[:, :, 1])
        return (front | back) & clear


def woop(corners: Array, origins: Array, directions: Array) -> Tested:
    """Test as `kernels/native/triangles.h` does (Woop, Benthin and Wald 2013).

    `corners` are (1, T, 3, 3) for all rays or (R, T, 3, 3) for each; origins and directions are (R, 3).

    There each corner is sheared so that the ray becomes the z axis; S is the shear, A = X − S Z one of a
    corner's coordinates. S takes two roundings, X and Z one, S Z one, the difference one; in sum
    e (|X| + 4 |S Z| + |A|). Its edge functions are differences of two products of such numbers.
    """
    parts: list[NDArray[np.int64]] = []
    results: list[Tested] = []
    main_axis = _main_axis(directions)
    for kz in range(3):
        rays = np.flatnonzero(main_axis == kz)
        parts.append(rays)
        kx, ky = (1, 2) if kz == 0 else (2, 0) if kz == 1 else (0, 1)
        o, d = origins[rays], directions[rays]
        near = corners if len(corners) == 1 else corners[rays]
        x, y, z = (near[:, :, :, k] - o[:, None, None, k] for k in (kx, ky, kz))
        shear_x, shear_y = (d[:, k, None, None] / d[:, kz, None, None] for k in (kx, ky))
        ax, ay = x - shear_x * z, y - shear_y * z
        ax_error = EPSILON * (np.abs(x) + 4.0 * np.abs(shear_x * z) + np.abs(ax))
        ay_error = EPSILON * (np.abs(y) + 4.0 * np.abs(shear_y * z) + np.abs(ay))
        bx, by, cx, cy = (np.roll(a, shift, axis=2) for shift in (-1, -2) for a in (ax, ay))
        bx_error, by_error, cx_error, cy_error = (
            np.roll(a, shift, axis=2) for shift in (-1, -2) for a in (ax_error, ay_error)
        )
        edges = cx * by - cy * bx
        products = np.abs(cx * by) + np.abs(cy * bx)
        moved = np.abs(cx) * by_error + np.abs(by) * cx_error + np.abs(cy) * bx_error + np.abs(bx) * cy_error
        # The rounded products decide the sign of the difference; the bound covers the value as well. Two moved corners
        # together add a second-order term, which matters beside a corner that lies on the ray.
        edge_error = moved + cx_error * by_error + cy_error * bx_error + EPSILON * (products + np.abs(edges))
        edge_error *= SECOND_ORDER
        # t is a mean of the corners' z, weighted by the edge functions. Beside those: z, product, two
        # sums, shear, reciprocal of the determinant (three), and two products.
        numerator = (edges * z).sum(axis=2)
        inverse = 1.0 / d[:, None, kz]
        det = edges.sum(axis=2)
        sign = np.where(det < 0.0, -1.0, 1.0)
        edges, det = edges * sign[:, :, None], det * sign
        with np.errstate(divide="ignore", invalid="ignore"):
            t = numerator * inverse * sign / det
        t = np.where(np.isfinite(t), t, 0.0)  # a ray in the plane has no distance that could be compared
        spread = (edge_error * np.abs(z - (t * d[:, None, kz])[:, :, None])).sum(axis=2)
        spread += 10.0 * EPSILON * np.abs(edges * z).sum(axis=2)
        det_error = edge_error.sum(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            t_error = np.where(det > det_error, np.abs(inverse) * spread / (det - det_error), np.inf)
            # As `error_of_distance` of kernels/native/triangles.h: least_t, 0 where the triangle is wholly in front.
            most_x, most_y, most_z = (np.abs(a).max(axis=2) for a in (ax, ay, z))
            error_x, error_y = 5.0 * EPSILON * (most_x + most_z), 5.0 * EPSILON * (most_y + most_z)
            error_e = 2.0 * (2.0 * EPSILON * most_x * most_y + error_y * most_x + error_x * most_y)
            extent = z.max(axis=2) - z.min(axis=2)
            least_t = np.abs(inverse) * (18.0 * EPSILON * most_z + 3.0 * extent * error_e / det)
            least = np.stack(
                [
                    np.where(most_z - extent > 24.0 * EPSILON * most_z, 0.0, least_t * SECOND_ORDER),
                    np.where(most_z - extent > 12.0 * EPSILON * most_z, 0.0, least_t / SECOND_ORDER),
                ],
                axis=2,
            )
        results.append(Tested(edges, edge_error, det, t, t_error, least))
    order = np.argsort(np.concatenate(parts))
    return Tested(*(np.concatenate(pieces)[order] for pieces in zip(*results, strict=True)))


def _main_axis(directions: Array) -> NDArray[np.int64]:
    """Return the axis along which each ray runs fastest; of equal ones the last, as in kernels/native/boxes.h."""
    dx, dy, dz = np.abs(directions).T
    return np.where(dx > dy, np.where(dx > dz, 0, 2), np.where(dy > dz, 1, 2))


class Reason(enum.Enum):
    """Why an answer is not the exact one."""

    SAME = "same triangle"
    ROUNDING = "another within rounding"
    NONE = "not explained"


class Explained(NamedTuple):
    """What `explain` finds, ray by ray: why, and the exact answer, −1 for none.

    `open`: whether another answer than the exact one could be explained.
    """

    reason: NDArray[np.object_]
    nearest: NDArray[np.int64]
    open: NDArray[np.bool_]

    def counts(self) -> dict[Reason, int]:
        """Return how many rays there are of each reason."""
        return {reason: int((self.reason == reason).sum()) for reason in Reason}


def ulps(difference: ArrayLike, t: ArrayLike) -> Array:
    """Return a difference of distances in units of the last place of t in float32."""
    with np.errstate(invalid="ignore"):
        return np.abs(difference) / np.spacing(np.abs(t).astype(np.float32)).astype(np.float64)


def exact_distances(corners: ArrayLike, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Return for each ray the exact distance to the plane of its own (3, 3) corners, and how wrong t may be."""
    triangles, o, d = (np.asarray(a, np.float64) for a in (corners, origins, directions))
    tested = woop(triangles[:, None], o, d)
    return tested.t[:, 0], tested.t_error[:, 0]


def explain(corners: ArrayLike, origins: ArrayLike, directions: ArrayLike, triangle: ArrayLike) -> Explained:
    """Judge the (R,) triangles that a tracer says rays hit first, −1 for none, against all triangles in float64.

    An answer can be right if the ray meets that triangle for some rounding, and no triangle that it meets for any
    rounding is nearer. Triangles whose circle around the mean of the corners is farther from the lines of the rays than
    1e-4 of its own distance, a thousand times what rounding may do, can neither be hit nor seem to be.
    """
    corners, origins, directions = (np.asarray(a, np.float64) for a in (corners, origins, directions))
    answers, middle = np.asarray(triangle), corners.mean(axis=1)
    radius = np.sqrt(((corners - middle[:, None]) ** 2).sum(axis=2).max(axis=1))
    found, size = [], max(1, PAIRS // len(corners))
    for i in range(0, max(1, len(origins)), size):
        o, d, answer = (a[i : i + size] for a in (origins, directions, answers))
        away = middle - o[:, None]
        along2 = np.einsum("rtk,rk->rt", away, d) ** 2 / (d**2).sum(axis=1, keepdims=True)
        away2 = (away**2).sum(axis=2)
        near = (away2 - along2 <= (1.0001 * radius + 1e-4 * np.sqrt(away2)) ** 2).any(axis=0)
        near[answer[answer >= 0]] = True
        numbers = np.flatnonzero(near) if near.any() else np.array([0])
        place = np.where(answer >= 0, np.searchsorted(numbers, answer), -1)
        one = _explain(woop(corners[None, numbers], o, d), place)
        found.append(one._replace(nearest=np.where(one.nearest >= 0, numbers[one.nearest], -1)))
    return Explained(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _explain(tested: Tested, answer: NDArray[np.integer]) -> Explained:
    rows = np.arange(len(answer))
    inside, surely, perhaps = tested.inside, tested.surely, tested.perhaps
    t, t_error = tested.t, tested.t_error

    t_inside = np.where(inside, t, np.inf)
    nearest = np.argmin(t_inside, axis=1)
    exact = np.isfinite(t_inside[rows, nearest])
    reach = np.where(surely, t + t_error, np.inf).min(axis=1)

    is_hit = answer >= 0
    t_given = np.where(is_hit, t[rows, answer], np.inf)
    error_given = np.where(is_hit, t_error[rows, answer], 0.0)
    possible = np.where(is_hit, perhaps[rows, answer] & ~(t_given - error_given > reach), ~np.isfinite(reach))

    same = np.where(is_hit, exact & (nearest == answer), ~exact)
    reason = np.where(same & possible, Reason.SAME, np.where(possible, Reason.ROUNDING, Reason.NONE))
    candidates = (perhaps & ~((t - t_error) > reach[:, None])).sum(axis=1)
    unsure = (candidates > 1) | ((candidates == 1) & ~np.isfinite(reach))
    return Explained(reason, np.where(exact, nearest, -1), unsure)
