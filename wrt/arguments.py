"""What is typed on the command line, as values: each of these is a `type` of argparse."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def whole(minimum: int) -> Callable[[str], int]:
    """Return the type of whole numbers from `minimum` on."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be a whole number, not {text!r}") from None
        if value < minimum:
            raise argparse.ArgumentTypeError(f"must be at least {minimum}, not {value}")
        return value

    return convert


def finite(text: str) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, not {text!r}") from None
    if value != value or abs(value) == float("inf"):
        raise argparse.ArgumentTypeError(f"must be finite, not {text}")
    return value


def positive(text: str) -> float:
    """Return a number above 0."""
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"must be greater than 0, not {text}")
    return value


def definition(text: str) -> tuple[str, str]:
    """Return name and value, from NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, such as spp=64, not {text!r}")
    return name, value


def size(text: str) -> tuple[int, int]:
    """Return width and height, from a text such as 640x480."""
    width, cross, height = text.lower().partition("x")
    if not cross:
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 640x480, not {text!r}")
    pixels = whole(1)
    return pixels(width), pixels(height)


def crop(text: str) -> tuple[int, ...]:
    """Return the four numbers of a part of a picture."""
    numbers = text.split(",")
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(f"must be X0,Y0,X1,Y1, such as 0,0,320,240, not {text!r}")
    pixels = whole(0)
    return tuple(pixels(number) for number in numbers)
