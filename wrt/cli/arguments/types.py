"""Converters of command-line arguments, for the `type` parameter of argparse."""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Callable, Sequence
from typing import Any

from wrt.errors import InputError, did_you_mean

PICTURES = {
    "720p": (1280, 720),
    "1080p": (1920, 1080),
    "1440p": (2560, 1440),
    "2160p": (3840, 2160),
    "4k": (3840, 2160),
    "8k": (7680, 4320),
}
"""Sizes by the common names of screens. There is no 2k, because it names three different sizes."""

_NUMBER = r"(?:\d+\.?\d*|\.\d+)"
_UNITS = re.compile(
    rf"(?:({_NUMBER})\s*h(?:ours?|rs?)?)?\s*(?:({_NUMBER})\s*m(?:in(?:utes?)?)?)?\s*(?:({_NUMBER})\s*s(?:ec(?:onds?)?)?)?",
    re.ASCII,
)
_CLOCK = re.compile(r"(?:(\d+):(?=\d\d:))?(\d+):([0-5]\d(?:\.\d*)?)", re.ASCII)


def whole(minimum: int) -> Callable[[str], int]:
    """Return a converter to whole numbers of at least `minimum`."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be a whole number in digits, not {text!r}") from None
        if value < minimum:
            raise argparse.ArgumentTypeError(f"must be at least {minimum}, not {value}")
        return value

    return convert


def finite(text: str) -> float:
    """Convert text to a finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, not {text!r}") from None
    if value != value or abs(value) == float("inf"):
        raise argparse.ArgumentTypeError(f"must be finite, not {text}")
    return value


def color(text: str) -> tuple[float, float, float]:
    """Convert a colour as in CSS, or three linear numbers, to linear RGB."""
    from wrt import values

    try:
        return values.color([float(part) for part in text.split(",")] if "," in text else text, "background")
    except (InputError, ValueError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def exposure(text: str) -> float | str:
    """Convert text to stops, or return "auto"."""
    if text == "auto":
        return text
    try:
        return finite(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"must be a number of stops or auto, not {text!r}") from None


def positive(text: str) -> float:
    """Convert text to a finite number above 0."""
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"must be greater than 0, not {text}")
    return value


def share(text: str) -> float:
    """Convert text to a number above 0 and up to 1, such as 0.01 or 1%."""
    number = text.strip()
    value = positive(number.removesuffix("%").strip()) / (100.0 if number.endswith("%") else 1.0)
    if value > 1.0:
        raise argparse.ArgumentTypeError(f"must be at most 100%, such as 1% or 0.01, not {text}")
    return value


def choice(words: Sequence[str]) -> Callable[[str], str]:
    """Return a converter that accepts only the given words."""

    def convert(text: str) -> str:
        if text not in words:
            hint = did_you_mean(text.lower(), words)
            raise argparse.ArgumentTypeError(f"must be one of {', '.join(words)}, not {text!r}{hint}")
        return text

    return convert


def duration(text: str) -> float:
    """Convert text to seconds, such as 90, 90s, 1m30s, 1.5h or 1:30."""
    stripped = text.strip().lower()
    found = _CLOCK.fullmatch(stripped) or (stripped and _UNITS.fullmatch(stripped))
    if not found:
        try:
            return positive(text)
        except argparse.ArgumentTypeError as error:
            if "must be a number" not in str(error):
                raise
        raise argparse.ArgumentTypeError(f"must be a time such as 90, 90s, 1m30s or 1:30, not {text!r}")
    hours, minutes, seconds = (float(part or 0.0) for part in found.groups())
    return positive(str(hours * 3600.0 + minutes * 60.0 + seconds))


def interval(text: str) -> float:
    """Convert text to seconds as `duration` does; "never" is infinite."""
    if text.strip().lower() == "never":
        return float("inf")
    try:
        return duration(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}; or never") from None


def definition(text: str) -> tuple[str, str]:
    """Split NAME=VALUE into name and value."""
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, such as spp=64, not {text!r}")
    return name, value


def size(text: str) -> tuple[int, int]:
    """Convert text to width and height, such as 640x480 or 1080p."""
    common = PICTURES.get(text.strip().lower())
    if common is not None:
        return common
    sides = re.split(r"\s*[x×*,]\s*", text.strip().lower())
    if len(sides) == 1 and sides[0].isdecimal():
        raise argparse.ArgumentTypeError(f"must have a width and a height, such as {text}x{text}, not {text!r}")
    if len(sides) != 2:
        names = ", ".join(PICTURES)
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 640x480, or one of {names}, not {text!r}")
    pixels = whole(1)
    return pixels(sides[0]), pixels(sides[1])


def crop(text: str) -> tuple[int, ...]:
    """Convert X0,Y0,X1,Y1 to a crop window."""
    numbers = text.split(",")
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(f"must be X0,Y0,X1,Y1, such as 0,0,320,240, not {text!r}")
    pixels = whole(0)
    return tuple(pixels(number) for number in numbers)


def frames(text: str) -> tuple[int, int]:
    """Convert A-B, or a single number, to the first and the last frame."""
    first, dash, last = text.strip().partition("-")
    number = whole(0)
    try:
        found = number(first), number(last if dash else first)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"must be the first and last frame, such as 0-47, not {text!r}") from None
    if found[1] < found[0]:
        raise argparse.ArgumentTypeError(f"must not end before it begins: {text}")
    return found


def part(text: str) -> tuple[int, int]:
    """Convert I/N to the number of a part, from 1, and the number of parts."""
    first, slash, last = text.strip().partition("/")
    if not slash or not first.isdecimal() or not last.isdecimal():
        raise argparse.ArgumentTypeError(
            f"must be I/N, the number of a part and of all parts, such as 3/16, not {text!r}"
        )
    number, of = int(first), int(last)
    if not 1 <= number <= of:
        raise argparse.ArgumentTypeError(
            f"must be from 1/{of} to {of}/{of}, not {text}" if of else f"has no parts: {text}"
        )
    return number, of


def checked_by(module: str, function: str) -> Callable[[str], Any]:
    """Return a converter that calls a function of wrt, whose module is imported only then."""

    def convert(text: str) -> Any:
        try:
            return getattr(importlib.import_module(module), function)(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return convert
