"""The animation of a file: where it goes, so that one studio and one camera serve for all frames."""

from __future__ import annotations

import os
import warnings
from functools import lru_cache

import numpy as np

from wrt.errors import InputError
from wrt.io.gltf.reader import NO_ANIMATION
from wrt.io.load_mesh import animation_of, load_file
from wrt.io.safe_read import PathLike
from wrt.studio.subjects import Reach, reach_of

TIMES = 12
"""Times, from the first keyframe to the last, at which it is looked where the shapes are."""


def is_animated(path: PathLike) -> bool:
    """Return whether a file has an animation that `wrt.load` evaluates at a time."""
    return os.path.isfile(path) and animation_of(path) is not None


def reach_of_file(path: PathLike) -> Reach:
    """Return what a file's first animation shows from its first keyframe to its last.

    It is kept for the file that was asked for last, since each frame of an animation needs it.

    Raises:
        InputError: when the file has no animation, or cannot be read.
    """
    if (ends := animation_of(path)) is None:
        raise InputError(f"{path}: {NO_ANIMATION}")
    found = os.stat(path)
    return _reach(os.fspath(path), ends, (found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size))


@lru_cache(maxsize=1)
def _reach(path: str, ends: tuple[float, float], _version: tuple[int, ...]) -> Reach:
    times = np.unique(np.linspace(*ends, TIMES)).tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the load of the frame itself gives them
        return reach_of(load_file(path, time=time) for time in times)
