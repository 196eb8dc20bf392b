"""What a person types is checked, and what is wrong is said in one line that names it."""

from __future__ import annotations

import decimal
import fractions
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.values import array, boolean, color, integer, number, vector

NOT_NUMBERS: list[Any] = [None, "1", "nan", True, False, [1.0], (1.0, 2.0, 3.0), {}, 1j, slice(1)]


def message(call: Callable[[], object]) -> str:
    with pytest.raises(wrt.InputError) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("thing")
    return text


@pytest.mark.parametrize(
    "value",
    [2, 2.0, np.float32(2), np.float64(2), np.int64(2), np.array(2.0), fractions.Fraction(2), decimal.Decimal(2)],
)
def test_numbers_of_every_kind(value: Any) -> None:
    result = number(value, "thing")
    assert result == 2.0
    assert type(result) is float


@pytest.mark.parametrize("value", NOT_NUMBERS, ids=repr)
def test_what_is_no_number(value: Any) -> None:
    assert message(lambda: number(value, "thing")) == f"thing must be a number, not {value!r}"


def test_numpy_truth_is_no_number() -> None:
    message(lambda: number(np.True_, "thing"))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, np.float32(np.inf), np.nan, decimal.Decimal("nan")])
def test_numbers_must_be_finite(value: Any) -> None:
    assert "must be finite" in message(lambda: number(value, "thing"))


@pytest.mark.parametrize("value", [10**400, -(10**400), fractions.Fraction(10**400)], ids=["int", "-int", "fraction"])
def test_whole_numbers_too_large_for_a_float(value: Any) -> None:
    """A TOML file can hold them."""
    message(lambda: number(value, "thing"))


def test_limits_of_numbers() -> None:
    assert number(0, "thing", minimum=0.0) == 0.0
    assert number(1, "thing", maximum=1.0) == 1.0
    assert number(1e-300, "thing", above=0.0) == 1e-300
    assert message(lambda: number(-0.5, "thing", minimum=0.0)) == "thing must be at least 0, not -0.5"
    assert message(lambda: number(1.5, "thing", maximum=1.0)) == "thing must be at most 1, not 1.5"
    assert message(lambda: number(0, "thing", above=0.0)) == "thing must be greater than 0, not 0"


@pytest.mark.parametrize("value", [3, np.int32(3), np.uint8(3)])
def test_whole_numbers_of_every_kind(value: Any) -> None:
    result = integer(value, "thing", minimum=3, maximum=3)
    assert result == 3
    assert type(result) is int


@pytest.mark.parametrize("value", [3.0, "3", True, None, np.float64(3), math.nan, [3]], ids=repr)
def test_what_is_no_whole_number(value: Any) -> None:
    assert message(lambda: integer(value, "thing", minimum=0, maximum=9)).startswith("thing must be a whole number")


@pytest.mark.parametrize("value", [-1, 10, 10**400, -(10**400)], ids=["-1", "10", "large", "-large"])
def test_limits_of_whole_numbers(value: int) -> None:
    text = message(lambda: integer(value, "thing", minimum=0, maximum=9))
    assert text.startswith("thing must be between 0 and 9, not ")


@pytest.mark.parametrize("value", [0, 1, 1.0, "true", None, [], np.True_])
def test_what_is_neither_true_nor_false(value: Any) -> None:
    assert message(lambda: boolean(value, "thing")) == f"thing must be true or false, not {value!r}"
    assert boolean(True, "thing") is True
    assert boolean(False, "thing") is False


@pytest.mark.parametrize("value", [(1, 2, 3), [1.0, 2.0, 3.0], np.array([1, 2, 3]), np.array([1, 2, 3], np.float32)])
def test_vectors_of_every_kind(value: Any) -> None:
    result = vector(value, "thing")
    assert result == (1.0, 2.0, 3.0)
    assert all(type(x) is float for x in result)


@pytest.mark.parametrize("value", [None, 1.0, "abc", "1", (1, 2), (1, 2, 3, 4), [], np.zeros((2, 3)), np.zeros(())])
def test_what_is_no_vector(value: Any) -> None:
    assert message(lambda: vector(value, "thing")).startswith("thing must be three numbers")


def test_a_vector_names_its_bad_part() -> None:
    assert message(lambda: vector((1, "2", 3), "thing")) == "thing[1] must be a number, not '2'"
    assert message(lambda: vector((1, 2, math.inf), "thing")).startswith("thing[2] must be finite")
    assert message(lambda: vector({"x": 1, "y": 2, "z": 3}, "thing")).startswith("thing[0] must be a number")


@pytest.mark.parametrize("value", [1, 0.5, np.float32(0.5), np.array(0.5)])
def test_a_number_is_a_grey(value: Any) -> None:
    assert color(value, "thing") == (float(value),) * 3


def test_colors() -> None:
    assert color((0, 0.5, 1), "thing", maximum=1.0) == (0.0, 0.5, 1.0)
    assert color(np.array([0.25, 0.5, 1.0], np.float32), "thing") == (0.25, 0.5, 1.0)
    assert message(lambda: color(-1, "thing")) == "thing must be at least 0, not -1"
    assert message(lambda: color(1.5, "thing", maximum=1.0)) == "thing must be at most 1, not 1.5"
    assert message(lambda: color((1, -1, 1), "thing")) == "thing[1] must be at least 0, not -1"
    assert message(lambda: color((1, 1, 2), "thing", maximum=1.0)) == "thing[2] must be at most 1, not 2"
    for value in (None, "red", True, (1, 2), math.nan, (1, True, 1)):
        message(lambda value=value: color(value, "thing"))


@pytest.mark.parametrize("value", [1e39, (0.0, 0.0, 3.5e38)])
def test_light_must_fit_a_float32(value: Any) -> None:
    """Kernels would see infinity, and every sample of that light would be thrown away."""
    with pytest.raises(wrt.InputError):
        wrt.Shape(wrt.box(), emission=value)


@pytest.mark.parametrize("value", [[[1.0, 2.0], [3.0]], "words", [None, "x"], {"a": 1}])
def test_what_is_no_array_of_numbers(value: Any) -> None:
    text = message(lambda: array(value, "thing", np.float64))
    assert text == "thing must be an array of numbers with rows of equal length"


def test_meshes_of_ragged_arrays_and_projections_are_refused() -> None:
    vertices, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    for arguments, what in (((vertices[:2] + [[1, 2]], faces), "vertices"), ((vertices, [[0, 1, 2], [0]]), "faces")):
        with pytest.raises(wrt.InputError, match=f"^mesh: {what} must be an array of numbers"):
            wrt.Mesh(*arguments)
    mesh = wrt.Mesh(vertices, faces)
    projection = np.eye(4)
    projection[3, 2] = 0.5
    with pytest.raises(wrt.InputError, match=r"^mesh: a transform must be affine: its last row must be 0 0 0 1$"):
        mesh.transformed(projection)
