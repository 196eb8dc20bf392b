"""Parse Mitsuba's XML: elements with their lines, parameters, included files, and objects by id.

expat reads it without a document type, so that no entity can be declared or fetched.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from wrt.errors import InputError, did_you_mean, warn
from wrt.io import memory_limits
from wrt.io.safe_read import first_line, is_inside, read_file, require_file, require_inside

MOST_INCLUDES = 1000  # files that a scene may include; each inclusion counts
BYTES_PER_ELEMENT = 300  # memory of an element with one or two attributes
LONGEST_VALUE = 2**16  # most characters of an attribute value after substitution of parameters; enough for a long list
MOST_LEVELS = 64  # deepest nesting of elements
_PARAMETER = re.compile(r"\$(?:\{(\w+)\}|(\w+))")
_CAPITAL = re.compile(r"(?<=[a-z0-9])([A-Z])")


class LocatedError(InputError):
    """An InputError that already names the scene file and the line."""


@dataclass(eq=False)
class Element:
    """An XML element, its children, and its position."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The name of the property that it sets, or an empty string."""
        return self.attributes.get("name", "")

    @property
    def label(self) -> str:
        """The name of the element in messages."""
        return " ".join(
            [self.tag, *(repr(self.attributes[key]) for key in ("type", "name") if self.attributes.get(key))]
        )

    def at_line(self, text: str) -> str:
        """Return a message that names the file and the line."""
        return f"{self.file}: line {self.line}: {text}"

    def error(self, text: str) -> LocatedError:
        """Return an error that names the file and the line."""
        return LocatedError(self.at_line(text))

    @contextmanager
    def locating(self, prefix: str = "") -> Iterator[None]:
        """Within the context, add the file, the line and a prefix to each InputError that lacks a line."""
        try:
            yield
        except LocatedError:
            raise
        except InputError as error:
            raise self.error(f"{prefix}{error}") from None

    def get(self, key: str) -> str:
        """Return an attribute, or raise InputError."""
        if key not in self.attributes:
            raise self.error(f"{self.label} has no attribute {key!r}")
        return self.attributes[key]


_TEXTURES = ("bitmap", "checkerboard", "mesh_attribute")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


class Document:
    """A scene file and the files that it includes, with parameters substituted.

    Attributes:
        path: the scene file.
        root: its `scene` element, with each `include` replaced by the content of the file.
        ids: elements by id or alias.
        referenced: elements that a `ref` refers to.
        old: whether the scene was written for a version before 2.
        plugins: objects already made of elements (wrt.io.mitsuba.plugin).
    """

    def __init__(self, path: Path, parameters: Mapping[str, Any]) -> None:
        """Read a scene file; `parameters` are values of `$name`, which override the defaults in the file."""
        self.path = path
        self.ids: dict[str, Element] = {}
        self.plugins: dict[Element, Any] = {}
        self.referenced: set[Element] = set()
        self._parameters = {str(name): str(value) for name, value in parameters.items()}
        self._given = set(self._parameters)
        self._used: set[str] = set()
        self._folders = [path.parent]
        self._included = 0
        self._warnings: set[str] = set()
        self.root = self._read(path, ())
        self.old = _major_version(self.root) < 2
        if self.root.tag != "scene":
            raise self.root.error(f"not a Mitsuba scene: its outermost element is {self.root.tag!r}, not 'scene'")
        for name in sorted(self._given - self._used):
            hint = did_you_mean(name, self._parameters.keys() - self._given)
            raise InputError(f"{path}: the parameter {name!r} is not in the scene{hint}")

    def warn(self, where: Element, text: str) -> None:
        """Warn once of something that is left out."""
        message = where.at_line(text)
        if message not in self._warnings:
            self._warnings.add(message)
            warn(message)

    def find(self, element: Element) -> Element:
        """Return the element that a `ref` refers to."""
        name = element.get("id")
        if name not in self.ids:
            raise element.error(f"no object has the id {name!r}{did_you_mean(name, self.ids)}")
        self.referenced.add(self.ids[name])
        return self.ids[name]

    def file(self, where: Element, name: str) -> Path:
        """Return the path of a file that the scene names.

        It is searched beside the scene, in the folders of `path` elements, and beside the file that names it.
        """
        plain = name.strip().replace("\\", "/")
        candidates = [folder / plain for folder in (*self._folders, where.file.parent)]
        path = next((each for each in candidates if is_inside(each) and os.path.isfile(each)), candidates[0])
        with where.locating():
            require_file(path)
        return path

    def _read(self, path: Path, opened: tuple[str, ...]) -> Element:
        """Return the root element of a file; `opened` are the files that include it, directly or not."""
        root = parse(path)
        self._expand(root, (*opened, os.path.realpath(path)), _major_version(root) < 2, 0)
        return root

    def _expand(self, element: Element, opened: tuple[str, ...], old: bool, level: int) -> None:
        """Substitute parameters, insert included files and record ids, outermost first and in the order of the file."""
        if level > MOST_LEVELS:
            raise element.error(f"elements are nested more than {MOST_LEVELS} deep")
        for key, value in element.attributes.items():
            element.attributes[key] = self._substituted(element, value)
        if old:
            element.tag = element.tag.lower()
            if "name" in element.attributes:
                element.attributes["name"] = _CAPITAL.sub(lambda match: f"_{match[1]}", element.name).lower()
        if "id" in element.attributes and element.tag not in ("ref", "alias"):
            self._note(element, element.attributes["id"], element)
        children: list[Element] = []
        for child in element.children:
            if child.tag == "default":
                self._set_default(child)
                continue
            self._expand(child, opened, old, level + 1)
            if child.tag == "include":
                children += self._include(child, opened)
            elif child.tag == "alias":
                self._note(child, child.get("as"), self.find(child))
            elif child.tag == "path":
                self._add_folder(child)
            else:
                children.append(child)
        element.children = children

    def _substituted(self, element: Element, text: str) -> str:
        def value(match: re.Match[str]) -> str:
            name = match[1] or match[2]
            if name not in self._parameters:
                hint = did_you_mean(name, self._parameters)
                raise element.error(f"the parameter ${name} has no value{hint}; give one by -D {name}=VALUE")
            self._used.add(name)
            return self._parameters[name]

        if "$" not in text:
            return text
        # The length is known before anything is substituted.
        if sum(len(value(match)) for match in _PARAMETER.finditer(text)) > LONGEST_VALUE:
            raise element.error(f"with its parameters, a value is longer than {LONGEST_VALUE} characters")
        result = _PARAMETER.sub(value, text)
        _count_memory(element, len(result))
        return result

    def _set_default(self, element: Element) -> None:
        name = element.get("name")
        self._parameters.setdefault(name, self._substituted(element, element.get("value")))
        self._used.add(name)

    def _note(self, where: Element, name: str, element: Element) -> None:
        first = self.ids.setdefault(name, element)
        if first is not element:
            raise where.error(f"the id {name!r} is used twice, first at line {first.line} of {first.file}")

    def _include(self, element: Element, opened: tuple[str, ...]) -> list[Element]:
        """Return the elements of an included file."""
        path = self.file(element, element.get("filename"))
        if os.path.realpath(path) in opened:
            raise element.error(f"{element.get('filename')!r} includes itself")
        self._included += 1
        if self._included > MOST_INCLUDES:
            raise element.error(f"more than {MOST_INCLUDES} files are included")
        root = self._read(path, opened)
        return root.children if root.tag == "scene" else [root]

    def _add_folder(self, element: Element) -> None:
        folder = self._folders[0] / element.get("value")
        require_inside(folder)
        if not os.path.isdir(folder):
            raise element.error(f"{element.get('value')!r} is not a folder")
        self._folders.append(folder)


def parse(path: Path) -> Element:
    """Return the root element of an XML file, which must not have a document type."""
    # Mitsuba's parser takes two hyphens within a comment, which expat does not.
    data = _COMMENT.sub(lambda found: b"\n" * found[0].count(b"\n"), read_file(path))
    parser = expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag == "spectrum" and attributes.get("type") in _TEXTURES:
            tag = "texture"  # files of Mitsuba 2 have both words
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        _count_memory(element, BYTES_PER_ELEMENT)
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop()

    def refuse(reason: str) -> None:
        raise InputError(f"{path}: line {parser.CurrentLineNumber}: {reason}")

    def text(data: str) -> None:
        if data.strip():
            refuse(f"text outside of elements: {' '.join(data.split())[:40]!r}")

    def entity(*_: Any) -> None:
        refuse("document types and entities are not supported; remove <!DOCTYPE")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = entity
    parser.ExternalEntityRefHandler = entity  # type: ignore[assignment]
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        message = f"not well-formed XML: {expat.ErrorString(error.code)}"
        raise InputError(f"{path}: line {error.lineno}: {message}") from None
    except InputError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise InputError(f"{path}: cannot be read: {first_line(error)}") from None
    return roots[0]


def _count_memory(element: Element, size: int) -> None:
    with element.locating():
        memory_limits.take(memory_limits.TEXT, size)


def _major_version(root: Element) -> int:
    """Return the major version of a scene, by default 3."""
    text = root.attributes.get("version", "3").split(".")[0]
    if not text.isdigit():
        raise root.error(f"version must be a number such as 3.0.0, not {root.attributes['version']!r}")
    return int(text)
