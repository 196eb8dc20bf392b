"""Whether two renderers show the same picture, of several pictures by each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from peers.picture_tests import image_z_test

BLOCK = 16
"""Side of the blocks whose means are compared, pixels."""

CLOSE = 0.05
"""Most relative difference of blocks, root mean square, to renderers that do not mean quite the same."""

PASSING = 0.995
"""Least share of pixels that must not differ significantly, of renderers that mean the same."""

SMALL = 0.005
"""Most relative difference of the mean, of renderers that mean the same, unless noise is more."""


@dataclass(frozen=True)
class Agreement:
    """Whether two renderers agree, and by how much.

    Attributes:
        agrees: the verdict.
        pass_fraction: of pixels whose difference is no more than noise, at 1 % for the picture as a whole.
        mean_difference: of the pictures' means, relative.
        block_difference: of the means of blocks, root mean square, relative to the picture's mean, of brighter blocks
            to their own.
        block_noise: what of that noise alone would make.
        message: in a line.
    """

    agrees: bool
    pass_fraction: float
    mean_difference: float
    block_difference: float
    block_noise: float
    message: str


def agreement(ours: NDArray[np.float64], theirs: NDArray[np.float64], *, exact: bool) -> Agreement:
    """Compare two stacks of independent pictures.

    Args:
        ours: (N, H, W, 3) pictures of the same scene with N different seeds.
        theirs: (M, H, W, 3).
        exact: whether only noise may differ: by the z-test of each pixel, and the mean. Otherwise blocks may
            differ by CLOSE, or by little more than noise.
    """
    mean_a, mean_b = ours.mean(axis=0), theirs.mean(axis=0)
    variances = [stack.var(axis=0, ddof=1) / len(stack) for stack in (ours, theirs)]
    test = image_z_test(mean_a, variances[0], mean_b, variances[1], n_a=len(ours), n_b=len(theirs), floor=1e-4)
    mean = float(0.5 * (mean_a.mean() + mean_b.mean()))
    difference = float(mean_a.mean() - mean_b.mean()) / mean
    scale = np.maximum(block_means(0.5 * (mean_a + mean_b)), mean)
    blocks = block_means(mean_a - mean_b) / scale
    noise = np.sqrt(block_means(variances[0] + variances[1]) / BLOCK**2) / scale
    block_difference, block_noise = (float(np.sqrt(np.mean(x**2))) for x in (blocks, noise))
    error = float(np.sqrt((variances[0] + variances[1]).mean() / mean_a.size)) / mean
    same = test.pass_fraction >= PASSING and abs(difference) < max(SMALL, 4.0 * error)
    agrees = same if exact else block_difference < max(CLOSE, 1.5 * block_noise)
    message = (
        f"{100.0 * test.pass_fraction:.2f} % of pixels within noise, "
        f"mean {100.0 * difference:+.2f} % (noise {100.0 * error:.2f} %), "
        f"blocks of {BLOCK} x {BLOCK} differ by {100.0 * block_difference:.2f} % (noise {100.0 * block_noise:.2f} %)"
    )
    return Agreement(agrees, test.pass_fraction, difference, block_difference, block_noise, message)


def block_means(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of blocks, those at the right and below cut off where they are not whole."""
    rows, columns = (n // BLOCK * BLOCK for n in picture.shape[:2])
    cut = picture[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK, 3)
    return np.asarray(cut.mean(axis=(1, 3)))
