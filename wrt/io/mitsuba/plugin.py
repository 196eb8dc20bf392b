"""An object of the scene: its type, its parameters, and its child objects; warnings of parameters never read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, did_you_mean
from wrt.io.mitsuba.document import MOST_LEVELS, Document, Element
from wrt.io.mitsuba.transforms import numbers_of, rotation_part, transform_of, vector_of
from wrt.linalg import determinant
from wrt.values import Vec3, one_of

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
        """Parse an element; `opened` are the elements that contain it."""
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

    def locating(self) -> AbstractContextManager[None]:
        """Within the context, add the file, the line and the object to each InputError that lacks a line."""
        return self.element.locating(f"{self.label}: ")

    def warn(self, text: str) -> None:
        """Warn once of something in it that is left out or different."""
        self.document.warn(self.element, f"{self.label}: {text}")

    def warn_of_all(self, text: str) -> None:
        """Warn that all of it is left out or replaced, and so all of its parameters."""
        self.warn(text)
        self.ignore_all()

    def has(self, name: str) -> bool:
        """Return whether a parameter is given, as a value or as an object."""
        return name in self._values or any(child == name for child, _ in self.objects)

    def value(self, name: str, *tags: str) -> Element | None:
        """Return the element of a parameter, which must have one of these tags; None if it is not given."""
        self._read.add(name)
        element = self._values.get(name)
        if element is not None and element.tag not in tags:
            raise element.error(f"{self.label}: {name!r} must be given by <{tags[0]}>, not by <{element.tag}>")
        return element

    def number(self, name: str, default: float, *, positive: bool = False) -> float:
        """Return a number, which must be above 0 if `positive`."""
        element = self.value(name, "float", "integer")
        result = default if element is None else numbers_of(element, element.get("value"), 1)[0]
        if positive and not result > 0.0:
            raise self.error(f"{name!r} must be greater than 0, not {result:g}")
        return result

    def integer(self, name: str, default: int) -> int:
        """Return a whole number."""
        text = self.text(name, str(default), "integer")
        try:
            return int(text)
        except ValueError:
            raise self._values[name].error(f"{name!r} must be a whole number, not {text!r}") from None

    def boolean(self, name: str, default: bool) -> bool:
        """Return a boolean."""
        text = self.text(name, str(default), "boolean")
        if text.lower() not in ("true", "false"):
            raise self._values[name].error(f"{name!r} must be true or false, not {text!r}")
        return text.lower() == "true"

    def text(self, name: str, default: str, tag: str = "string") -> str:
        """Return a string, or the text of another value."""
        element = self.value(name, tag)
        return default if element is None else element.get("value")

    def choice(self, name: str, *choices: str) -> str:
        """Return a string that must be one of `choices`, by default the first."""
        with self.locating():
            return one_of(self.text(name, choices[0]).lower(), choices, repr(name))

    def point(self, name: str, default: Vec3) -> Vec3:
        """Return a point or a vector."""
        element = self.value(name, "point", "vector")
        return default if element is None else vector_of(element)

    def transform(self, name: str = "to_world") -> NDArray[np.float64]:
        """Return a (4, 4) matrix, which must be affine and invertible; the identity if there is none."""
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

    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (3, 3) rotation of `to_world`, and its scale along the rotated axes; see `rotation_part`."""
        axes, stretch, has_shear = rotation_part(self.transform())
        if has_shear:
            self.warn("'to_world' has shear, which is left out")
        return axes, stretch

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
        return first_of(kind, self.of_kind(kind))

    def named(self, name: str) -> Plugin | None:
        """Return the child object with a name, or None."""
        self._read.add(name)
        return next((each for child, each in self.objects if child == name), None)

    def ignore(self, *names: str) -> None:
        """Mark parameters that do not affect the picture as read, and the object as used."""
        self._read.update(("", *names))

    def ignore_all(self) -> None:
        """Mark all parameters as read."""
        self._read.update(self._values)

    def finish(self) -> None:
        """Warn of the parameters that were never read, unless the object was not used at all."""
        for name in [name for name in self._values if name not in self._read] if self._read else ():
            hint = did_you_mean(name, self._read)
            self.document.warn(self._values[name], f"{self.label}: {name!r} is not known{hint}; left out")


def first_of(kind: str, plugins: Iterable[Plugin]) -> Plugin | None:
    """Return the first of some objects of a kind, or None; warn of further ones."""
    first = None
    for each in plugins:
        if first is not None:
            each.warn(f"there is more than one {kind}; left out")
        first = first or each
    return first


def plugin_of(element: Element, document: Document, opened: tuple[Element, ...] = ()) -> Plugin:
    """Return an element as an object; all references to it share one. `opened` are the elements that contain it."""
    plugins: dict[Element, Plugin] = document.plugins
    if element not in plugins:
        if len(opened) > MOST_LEVELS:
            raise element.error(f"objects are nested more than {MOST_LEVELS} deep")
        plugins[element] = Plugin(element, document, opened)
    return plugins[element]
