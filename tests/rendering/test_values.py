"""Values are checked, and a wrong one is refused in one line that names it."""

import decimal
import fractions
import math
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.values import array, boolean, color, integer, number, vector


def test_values_of_every_kind_and_what_is_wrong():
    for make, value, expected in (
        *((number, v, 2.0) for v in (2, np.float32(2), np.array(2.0), fractions.Fraction(2), decimal.Decimal(2))),
        *((integer, v, 3) for v in (3, np.uint8(3))),
        (boolean, True, True),
        *((vector, v, (1.0, 2.0, 3.0)) for v in ((1, 2, 3), np.array([1, 2, 3], np.float32))),
        *((color, v, (0.5, 0.5, 0.5)) for v in (0.5, np.float32(0.5), np.array(0.5), (0.5, 0.5, 0.5))),
    ):
        found = make(value, "thing", **({"minimum": 3, "maximum": 3} if make is integer else {}))
        assert found == expected
        assert type(found) is type(expected)
        assert not isinstance(found, tuple) or all(type(x) is float for x in found)
    for make, value, message in (
        *((number, v, f"must be a number, not {v!r}") for v in (None, "1", True, np.True_, [1.0], 1j)),
        *((number, v, "must be finite") for v in (math.nan, -math.inf, decimal.Decimal("nan"))),
        *((number, v, "") for v in (HUGE, fractions.Fraction(HUGE))),
        *((integer, v, "must be a whole number") for v in (3.0, "3", True, math.nan)),
        *((integer, v, "must be between 0 and 9, not ") for v in (-1, 10, HUGE)),
        *((boolean, v, f"must be true or false, not {v!r}") for v in (1, "true", np.True_)),
        *((vector, v, "must be three numbers") for v in (None, "abc", (1, 2), np.zeros((2, 3)))),
        (vector, (1, "2", 3), "[1] must be a number, not '2'"),
        (vector, {"x": 1, "y": 2, "z": 3}, "[0] must be a number"),
        (color, -1, "must be at least 0, not -1"),
        (color, (1, 1, 2), "[2] must be at most 1, not 2"),
        *((color, v, "") for v in (None, "rad", (1, 2), math.nan, (1, True, 1))),
    ):
        with pytest.raises(wrt.InputError) as caught:
            make(value, "thing", **LIMITS.get(make, {}))
        text = str(caught.value)
        assert "\n" not in text
        assert text.startswith(f"thing {message}" if message[:1].isalpha() else f"thing{message}")


HUGE = 10**400
"""A TOML file can hold it."""
LIMITS: dict[Any, dict[str, Any]] = {integer: {"minimum": 0, "maximum": 9}, color: {"maximum": 1.0}}


def test_limits_of_numbers_and_arrays_that_are_none():
    assert number(0, "thing", minimum=0.0) == 0.0
    assert number(1, "thing", maximum=1.0) == 1.0
    assert number(1e-300, "thing", above=0.0) == 1e-300
    with pytest.raises(wrt.InputError, match=r"^thing must be greater than 0, not 0$"):
        number(0, "thing", above=0.0)
    # Kernels would see infinity, and every sample of that light would be thrown away.
    with pytest.raises(wrt.InputError):
        wrt.Shape(wrt.box(), emission=(0.0, 0.0, 3.5e38))
    for value in ([[1.0, 2.0], [3.0]], "words", [None, "x"], {"a": 1}):
        with pytest.raises(wrt.InputError, match=r"^thing must be an array of numbers with rows of equal length$"):
            array(value, "thing", np.float64)
    vertices, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    projection = np.eye(4)
    projection[3, 2] = 0.5
    with pytest.raises(wrt.InputError, match=r"^mesh: a transform must be affine: its last row must be 0 0 0 1, not"):
        wrt.Mesh(vertices, faces).transformed(projection)
