"""The settings of developing, which turns radiance into a PNG or JPEG: tone curve and exposure."""

from __future__ import annotations

from typing import TypeAlias

from wrt.errors import InputError, did_you_mean
from wrt.values import number

Exposure: TypeAlias = float | str | None  # stops, "auto", or None for the default; see `wrt.develop.exposure.stops`

DEVELOPED_SUFFIXES = (".png", ".jpg", ".jpeg")
"""Lower-case suffixes of pictures that are developed; other formats keep the radiance."""

AUTO = "auto"

LIMIT = 100.0  # most stops, up or down

EXPOSURE_SCHEMA = {"anyOf": [{"type": "number", "minimum": -LIMIT, "maximum": LIMIT}, {"const": AUTO}]}
"""The JSON schema of an exposure in a scene file."""

TONES = ("soft", "none", "neutral", "agx", "aces")  # names of tone curves; `wrt.develop.tones` has the curves
DEFAULT_TONE = "soft"

OCIO = "ocio"

TONE_SCHEMA = {"anyOf": [{"enum": [*TONES, OCIO]}, {"type": "string", "pattern": f"^{OCIO}:"}]}
"""The JSON schema of a tone in a scene file."""


def names_file(tone: str) -> bool:
    """Return whether a tone curve is a configuration of OpenColorIO in a file."""
    config = tone.partition(":")[2].split(",")[0].strip()
    return tone.startswith(f"{OCIO}:") and bool(config) and not config.startswith("ocio://")


def check_exposure(value: object) -> Exposure:
    """Return `value` if it is an exposure, or raise InputError."""
    if value is None or (isinstance(value, str) and value == AUTO):
        return value
    if isinstance(value, str):
        raise InputError(f'exposure must be a number of stops or "auto", not {value!r}')
    return number(value, "exposure", minimum=-LIMIT, maximum=LIMIT)


def check_tone(value: object) -> str:
    """Return `value` if it names a tone curve or an OpenColorIO view, or raise InputError.

    A configuration is opened only when a picture is developed.
    """
    if isinstance(value, str) and (value in TONES or value == OCIO or value.startswith(f"{OCIO}:")):
        return value
    hint = did_you_mean(value, [*TONES, OCIO]) if isinstance(value, str) else ""
    names = f"{', '.join(TONES)}, {OCIO} or {OCIO}:CONFIG,DISPLAY,VIEW"
    raise InputError(f"tone must be one of {names}, not {value!r}{hint}")
