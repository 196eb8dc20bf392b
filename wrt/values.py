"""Checks of input: numbers, vectors, colours, arrays."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean

Vec3: TypeAlias = tuple[float, float, float]
"""Three finite numbers."""

ColorLike: TypeAlias = float | Sequence[float]
"""Linear Rec. 709 RGB: three numbers, or one for a grey.

Where a color is checked it may also be a text as in CSS, such as "#ff8800" or "red", which is sRGB; the type leaves
text out, because after the check there are numbers."""

FLOAT32_MAX = 3.4028234663852886e38
"""The largest float32; a larger colour would be infinite in kernels."""


def _shown(value: object) -> str:
    """Return the repr of a value in one line."""
    return " ".join(repr(value).split())


def number(
    value: object,
    name: str,
    *,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    above: float = -math.inf,
) -> float:
    """Return `value` as a finite float within its limits, or raise InputError naming `name`."""
    if isinstance(value, (bool, str, np.bool_)):
        raise InputError(f"{name} must be a number, not {value!r}")
    try:
        result = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, not {value!r}") from None
    except OverflowError:
        raise InputError(f"{name} is too large for a floating-point number") from None
    if not math.isfinite(result):
        raise InputError(f"{name} must be finite, not {result}")
    if result < minimum:
        raise InputError(f"{name} must be at least {minimum:g}, not {result:g}")
    if result <= above:
        raise InputError(f"{name} must be greater than {above:g}, not {result:g}")
    if result > maximum:
        raise InputError(f"{name} must be at most {maximum:g}, not {result:g}")
    return result


def integer(value: object, name: str, *, minimum: int, maximum: int) -> int:
    """Return `value` as an int within [minimum, maximum], or raise InputError naming `name`."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise InputError(f"{name} must be a whole number, not {value!r}")
    result = int(value.__index__())
    if not minimum <= result <= maximum:
        raise InputError(f"{name} must be between {minimum} and {maximum}, not {result}")
    return result


def boolean(value: object, name: str) -> bool:
    """Return `value` if it is a bool, or raise InputError naming `name`."""
    if not isinstance(value, bool):
        raise InputError(f"{name} must be true or false, not {value!r}")
    return value


def text(value: object, name: str) -> str:
    """Return `value` if it is text, or raise InputError naming `name`."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be text, not {_shown(value)}")
    return value


def one_of(value: object, choices: Sequence[str], name: str) -> str:
    """Return `value` if it is among `choices`, or raise InputError naming `name` and the choices."""
    if not isinstance(value, str) or value not in choices:
        hint = did_you_mean(value, choices) if isinstance(value, str) else ""
        raise InputError(f"{name} must be one of {', '.join(choices)}, not {_shown(value)}{hint}")
    return value


def pair(value: object, name: str) -> tuple[float, float]:
    """Return `value` as two finite floats, or raise InputError naming `name`."""
    items = list(value) if isinstance(value, (list, tuple, np.ndarray)) else []
    if len(items) != 2:
        raise InputError(f"{name} must be two numbers, not {_shown(value)}")
    return number(items[0], f"{name}[0]"), number(items[1], f"{name}[1]")


def vec3(values: NDArray[Any] | Sequence[float]) -> Vec3:
    """Return three numbers as a tuple of floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def vector(value: object, name: str) -> Vec3:
    """Return `value` as three finite floats, or raise InputError naming `name`."""
    try:
        items = list(value)  # type: ignore[call-overload]
    except TypeError:
        raise InputError(f"{name} must be three numbers, not {_shown(value)}") from None
    if isinstance(value, str) or len(items) != 3:
        raise InputError(f"{name} must be three numbers, not {_shown(value)}")
    x, y, z = (number(item, f"{name}[{i}]") for i, item in enumerate(items))
    return x, y, z


def color(value: object, name: str, *, maximum: float = FLOAT32_MAX) -> Vec3:
    """Return `value` as non-negative linear RGB; a number is a grey, and a text is decoded by `color_of_text`."""
    if isinstance(value, str):
        value = color_of_text(value, name)
    if isinstance(value, (int, float)) or getattr(value, "shape", None) == ():
        grey = number(value, name, minimum=0.0, maximum=maximum)
        return grey, grey, grey
    result = vector(value, name)
    for i, item in enumerate(result):
        number(item, f"{name}[{i}]", minimum=0.0, maximum=maximum)
    return result


def color_names() -> list[str]:
    """Return the names of CSS that `color_of_text` knows."""
    from PIL import ImageColor

    return list(ImageColor.colormap)


def is_color(text: str) -> bool:
    """Return whether `color_of_text` knows a text."""
    return text in color_names() or text.startswith("#")


def color_of_text(text: str, name: str) -> Vec3:
    """Return linear RGB of "#rrggbb", "#rgb" or the name of a colour in CSS, which are sRGB, or raise InputError."""
    from PIL import ImageColor

    from wrt.scene.srgb import linear_from_srgb

    word = text.strip().lower()
    try:
        codes = ImageColor.getrgb(word)
    except ValueError:
        hint, examples = did_you_mean(word, color_names()), "red, #ff8800 or three numbers"
        raise InputError(f"{name} must be a colour, such as {examples}, not {text!r}{hint}") from None
    if len(codes) != 3:
        raise InputError(f"{name} must be a colour without alpha, not {text!r}")
    return vec3(linear_from_srgb(np.array(codes) / 255.0))


def array(value: object, name: str, dtype: type[Any] | None = None) -> NDArray[Any]:
    """Return `value` as an array, or raise InputError naming `name` if it is ragged, masked or no numbers.

    Warp and torch arrays on a GPU are copied to the CPU.
    """
    if not isinstance(value, np.ndarray) and callable(to_numpy := getattr(value, "numpy", None)):
        try:
            value = to_numpy() if not callable(to_cpu := getattr(value, "cpu", None)) else to_cpu().numpy()
        except (TypeError, RuntimeError) as error:  # of torch: a tensor that tracks gradients, or is sparse
            raise InputError(f"{name} cannot be an array of NumPy: {error}") from None
    refuse_masked(value, name)
    try:
        if isinstance(value, np.ndarray) and value.dtype.kind == "c":
            raise TypeError
        return np.asarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be an array of numbers with rows of equal length") from None


def refuse_masked(value: object, name: str) -> None:
    """Raise InputError naming `name` if an array has masked values: under the mask there may be anything."""
    made_by = sys.modules.get("numpy.ma")  # NumPy imports it when it is first used, which takes 50 ms
    if made_by and isinstance(value, made_by.MaskedArray) and (bad := np.argwhere(value.mask)).size:
        raise InputError(f"{name} must not have masked values; the first is number {bad[0][0]}")


def owned(value: object, name: str, dtype: type[Any] | None = None) -> NDArray[Any]:
    """Return `value` as a contiguous read-only array, or raise InputError as `array` does.

    Arrays that others could still write to are copied; read-only arrays are not.
    """
    result = np.ascontiguousarray(array(value, name, dtype))
    made_here = isinstance(value, (list, tuple)) or (
        isinstance(value, np.ndarray) and not np.may_share_memory(result, value)
    )
    if not made_here and not _is_read_only(result):
        result = result.copy()
    result.flags.writeable = False
    return result


def sealed(made: NDArray[Any]) -> NDArray[Any]:
    """Make an array and the arrays it is a view of read-only, and return it.

    `owned` then does not copy it. Call it only for arrays that no other code writes to.
    """
    viewed: Any = made
    while isinstance(viewed, np.ndarray):
        viewed.flags.writeable = False
        viewed = viewed.base
    return made


def _is_read_only(values: NDArray[Any]) -> bool:
    """Return whether an array and all arrays it is a view of are read-only."""
    viewed: Any = values
    while isinstance(viewed, np.ndarray):
        if viewed.flags.writeable:
            return False
        viewed = viewed.base
    return True


def key_times(value: object, what: str) -> NDArray[np.float64]:
    """Return a copy of the times of keys as (N,) float64, or raise InputError naming `what`, such as "motion".

    They must be finite and ascend even when rounded to float32, as in kernels.
    """
    times = array(value, f"{what} times", np.float64).copy()
    with np.errstate(over="ignore", invalid="ignore"):
        rounded = times.astype(np.float32)
        ascend = times.ndim == 1 and bool((np.diff(rounded) > 0.0).all())
    if times.ndim != 1 or len(times) == 0 or not np.isfinite(rounded).all():
        raise InputError(f"{what} times must be one or more finite numbers")
    if not ascend:
        raise InputError(f"{what} times must ascend, each greater than the one before, not {times.tolist()}")
    return times


_DECODED = "for sRGB, take wrt.scene.srgb.linear_from_srgb(codes / 255)"


def refuse_codes(value: object, name: str) -> None:
    """Raise InputError naming `name` if values are codes, such as 0 to 255, which are not linear either."""
    values = array(value, name)
    if values.dtype.kind in "iu" and values.size and values.max() > 1:
        raise InputError(f"{name} must be linear numbers, not codes up to {values.max()}; {_DECODED}")


def image(value: object, name: str) -> NDArray[np.float32]:
    """Return `value` as finite, non-negative, read-only (H, W, 3) float32 pixels; see `owned`.

    Raises:
        InputError: if it is not such an image; the message names `name`.
    """
    if isinstance(value, (str, os.PathLike)):
        raise InputError(f"{name} must be an array, such as wrt.load_image({str(value)!r}) returns")
    refuse_codes(value, name)
    with np.errstate(over="ignore"):
        pixels = owned(value, name, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise InputError(f"{name} must be (H, W, 3), not {pixels.shape}")
    if not np.isfinite(pixels).all() or (pixels < 0).any():
        raise InputError(f"{name} must be finite and not negative")
    return pixels
