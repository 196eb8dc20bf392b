"""Parse an object of the scene: its type, its parameters, and its child objects; warn of parameters never read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io.mitsuba.document import MOST_LEVELS, Document, Element
from wrt.io.mitsuba.transforms import numbers_of, transform_of, vector_of
from wrt.linalg import determinant
from wrt.values import Vec3

OBJECTS = (
    *("shape", "bsdf", "emitter", "texture", "sensor", "film", "sampler", "rfilter", "integrator", "medium", "phase"),
    *("volume", "subsurface"),
)
"""Elements that are objects; `spectrum`, `rgb` and similar ones count as values."""

VALUES = (
    *("float", "integer", "boolean", "string", "point", "vector", "transform", "rgb", "srgb", "spectrum", "blackbody"),
    *("color", "animation"),
)
"""Elements that set a parameter."""


class Plugin:
    """An object of the scene; all references to an element share one.

    Attributes:
        kind: its tag, such as "bsdf".
        type: its plugin, such as "diffuse".
        element: its XML element.
        objects: its child objects with their names, in the order of the file.
    """

    def __init__(self, element: Element, document: Document, opened: tuple[Element, ...] = ()) -> None:
        """Parse an element.

        Raises:
            InputError: when it contains itself, or something that is neither a parameter nor an object.
        """
        self.kind, self.element, self.document = element.tag, element, document
        # Names of classes, as files of old versions have them, begin with a capital letter.
        self.type = element.attributes.get("type", "").lower()
        self.objects: list[tuple[str, Plugin]] = []
        self._values: dict[str, Element] = {}
        self._read: set[str] = set()
        for child in element.children:
            inner = document.find(child) if child.tag == "ref" else child
            if inner.tag in OBJECTS:
                if inner in opened or inner is element:
                    raise child.error(f"{inner.label} contains itself")
                self.objects.append((child.name, plugin_of(inner, document, (*opened, element))))
            elif inner.tag in VALUES:
                if child.name in self._values:
                    raise child.error(f"{self.label} has {child.name!r} twice")
                self._values[child.name] = inner
            else:
                raise child.error(f"<{inner.tag}> is not known here{did_you_mean(inner.tag, OBJECTS + VALUES)}")

    @property
    def label(self) -> str:
        """The name of the object in messages."""
        return f"{self.kind} {self.type!r}" if self.type else self.kind

    def error(self, text: str) -> InputError:
        """Return an error that names the file, the line and the object."""
        return self.element.error(f"{self.label}: {text}")

    def placed(self, error: InputError) -> InputError:
        """Return an error with file and line added, unless it has them."""
        return error if ": line " in str(error) else self.error(str(error))

    def warn(self, text: str) -> None:
        """Warn once of something in it that is left out or different."""
        self.document.warn(self.element, f"{self.label}: {text}")

    def has(self, name: str) -> bool:
        """Return whether a parameter is given, as a value or as an object."""
        return name in self._values or any(name == given for given, _ in self.objects)

    def value(self, name: str, *tags: str) -> Element | None:
        """Return the element of a parameter, or None.

        Raises:
            InputError: when its tag is none of `tags`.
        """
        self._read.add(name)
        element = self._values.get(name)
        if element is not None and element.tag not in tags:
            raise element.error(f"{self.label}: {name!r} must be given by <{tags[0]}>, not by <{element.tag}>")
        return element

    def number(self, name: str, default: float) -> float:
        """Return a number."""
        element = self.value(name, "float", "integer")
        return default if element is None else numbers_of(element, element.get("value"), 1)[0]

    def whole(self, name: str, default: int) -> int:
        """Return a whole number."""
        element = self.value(name, "integer")
        if element is None:
            return default
        try:
            return int(element.get("value"))
        except ValueError:
            raise element.error(f"{name!r} must be a whole number, not {element.get('value')!r}") from None

    def boolean(self, name: str, default: bool) -> bool:
        """Return a boolean."""
        element = self.value(name, "boolean")
        if element is None:
            return default
        text = element.get("value").lower()
        if text not in ("true", "false"):
            raise element.error(f"{name!r} must be true or false, not {element.get('value')!r}")
        return text == "true"

    def text(self, name: str, default: str) -> str:
        """Return a string."""
        element = self.value(name, "string")
        return default if element is None else element.get("value")

    def choice(self, name: str, default: str, *choices: str) -> str:
        """Return a string that must be one of `choices`."""
        result = self.text(name, default).lower()
        if result not in choices:
            where = self._values.get(name, self.element)
            raise where.error(f"{self.label}: {name!r} must be one of {', '.join(choices)}, not {result!r}")
        return result

    def point(self, name: str, default: Vec3) -> Vec3:
        """Return a point or a vector."""
        element = self.value(name, "point", "vector")
        return default if element is None else vector_of(element)

    def transform(self, name: str = "to_world") -> NDArray[np.float64]:
        """Return a (4, 4) matrix, by default `to_world`; the identity if there is none.

        Raises:
            InputError: when it is not invertible, or not affine.
        """
        element = self.value(name, "transform", "animation")
        if element is None:
            return np.eye(4)
        if element.tag == "animation":
            self.warn(f"the animation {name!r} is left out")
            return np.eye(4)
        matrix = transform_of(element)
        if abs(determinant(matrix[:3, :3])) < 1e-30 or not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)):
            raise element.error(f"{self.label}: {name!r} must be an affine transform that can be inverted")
        return matrix

    def file(self, name: str = "filename") -> Path:
        """Return the path of a required file."""
        element = self.value(name, "string")
        if element is None:
            raise self.error(f"names no file: {name!r} is missing")
        return self.document.file(element, element.get("value"))

    def of_kind(self, *kinds: str) -> Iterator[Plugin]:
        """Yield the child objects of some kinds."""
        return (each for _, each in self.objects if each.kind in kinds)

    def only(self, kind: str) -> Plugin | None:
        """Return the first child object of a kind, or None; warn of further ones."""
        found = list(self.of_kind(kind))
        for other in found[1:]:
            other.warn(f"there is more than one {kind}; left out")
        return found[0] if found else None

    def named(self, name: str) -> Plugin | None:
        """Return the child object with a name, or None."""
        return next((each for given, each in self.objects if given == name), None)

    def ignore(self, *names: str) -> None:
        """Mark parameters that do not affect the picture as read."""
        self._read.update(names)

    def ignore_all(self) -> None:
        """Mark all parameters as read."""
        self._read.update(self._values)

    def finish(self) -> None:
        """Warn of the parameters that were never read."""
        for name, element in self._values.items():
            if name not in self._read:
                hint = did_you_mean(name, self._read - {name})
                self.document.warn(element, f"{self.label}: {name!r} is not known{hint}; left out")


def plugin_of(element: Element, document: Document, opened: tuple[Element, ...] = ()) -> Plugin:
    """Return an element as an object; all references to it share one.

    Args:
        element: the element to parse.
        document: its document.
        opened: the elements that contain it.

    Raises:
        InputError: when it contains itself, is nested too deep, or cannot be parsed.
    """
    known: dict[int, Plugin] = document.plugins
    if id(element) not in known:
        if len(opened) > MOST_LEVELS:
            raise element.error(f"objects are nested more than {MOST_LEVELS} deep")
        known[id(element)] = Plugin(element, document, opened)
    return known[id(element)]


def positive(plugin: Plugin, name: str, default: float) -> float:
    """Return a number above 0."""
    result = plugin.number(name, default)
    if not (result > 0.0 and math.isfinite(result)):
        raise plugin.error(f"{name!r} must be greater than 0, not {result:g}")
    return result
