"""The text of Wavefront OBJ files as arrays: NumPy parses the lines of one kind of a megabyte at once.

Format: Wavefront, "Advanced Visualizer Manual", appendix B1.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.mesh.mtl import plain_name
from wrt.io.mesh.obj_kernel import SIZES, read_lines

_CHUNK = 1 << 20
"""Bytes parsed at a time; temporary arrays take twenty times as many."""

_KINDS = ("v", "vt", "vn", "f")
_COLUMNS = {"v": (3, 7), "vt": (1, 2), "vn": (3, 3)}
"""How many numbers of a line are needed, and how many are of use: positions may have colours or a weight after them."""

_STATEMENT = re.compile(r"[A-Za-z_][A-Za-z_0-9]{0,19}")
_INDENT, _COMMENT, _KEY = re.compile(rb"(?m)^ +"), re.compile(rb"#[^\n]*"), re.compile(rb"(?m)^v[tn]? ")
_SPACE, _NEWLINE, _SLASH, _DOT = b" \n/."
_TO_SPACES = bytes.maketrans(b"vtnf/", b"     ")
_POWERS = 10.0 ** np.arange(20)

_LONGEST = 17
"""Bytes of numbers, with the blank, whose digits are an integer that double precision holds exactly."""

_LARGEST = 2**31 - 1

_Index = NDArray[np.intp]
_Corners = NDArray[np.int32]


class ObjText:
    """The content of an OBJ file.

    Attributes:
        rows: (N, K) numbers of each kind of vertex data, "v", "vt" and "vn", float64 for "v" and otherwise float32.
        corners: (C, 3) what the corners of all faces name, of each kind, counted from 0; -1 for what they do not name.
        counts: (F,) corners of each face.
        face_materials: (F,) numbers of materials.
        face_smoothing: (F,) numbers of smoothing groups (s), 0 for none; None if the file has none.
        materials: the numbers of materials by name; 0 is "", of faces without one.
        libraries: statements for material files, each one or several names.
        others: all other statements, counted.
        colors_are_partial: whether some vertices have a colour and others have none.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        """Parse the UTF-8 data of the file.

        Raises:
            InputError: on what is no number where one should be, and on faces that name nothing.
        """
        self._path, self._line = path, 1
        self.materials, self._smoothing = {"": 0}, dict.fromkeys(("off", "0", "null"), 0)
        self._state = 0, 0  # the material, and the smoothing group
        self._widest, self.colors_are_partial = 0, False  # the most numbers of a line of "v"
        self.libraries: list[str] = []
        self.others: Counter[str] = Counter()
        self._size = dict.fromkeys(_COLUMNS, 0)
        self._found: dict[str, list[NDArray[Any]]] = {kind: [] for kind in _COLUMNS}
        data = _joined_lines(data) or b"\n"  # nothing but a byte-order mark
        lines = read_lines(data, _COLUMNS) if len(data) in SIZES else None
        if lines is not None:
            self.rows, self.corners, self.counts = lines.rows, lines.corners, lines.sizes
            changes = self._states_of(b"".join(_chunks(lines.others)).split(b"\n")[:-1], lines.faces_before.tolist())
            self.face_materials, smoothing = _states_of_faces(*changes, len(self.counts))
        else:
            corners, counts, numbers = zip(*map(self._add, _chunks(data)), strict=True)
            self.rows = {kind: self._joined(kind) for kind in _COLUMNS}
            self.corners = np.concatenate(corners)
            self.counts, (self.face_materials, smoothing) = np.concatenate(counts), np.concatenate(numbers, axis=1)
        self.face_smoothing = smoothing if self.others.pop("s", 0) else None
        for column, kind in enumerate(_COLUMNS):
            indices, count = self.corners[:, column], len(self.rows[kind])
            if (last := int(indices.max(initial=-1))) < count:
                continue
            reason = f"a face names {kind!r} {last + 1}, but there are {count}"
            if kind == "v":
                raise self._error(reason)
            warn(f"{path}: {reason}; such faces have none")
            indices[indices >= count] = -1

    def _error(self, reason: str, line: int | None = None) -> InputError:
        return InputError(f"{self._path}: {reason}" if line is None else f"{self._path}: line {line}: {reason}")

    def _joined(self, kind: str) -> NDArray[Any]:
        """Return all numbers of a kind, as many columns as every line has."""
        found = self._found.pop(kind)
        widths = {rows.shape[1] for rows in found}
        least = min(widths, default=_COLUMNS[kind][0])
        if kind == "v":
            self.colors_are_partial = least < 6 <= self._widest
        return np.concatenate([rows[:, :least] for rows in found]) if found else np.zeros((0, least), np.float32)

    def _add(self, chunk: bytes) -> tuple[_Corners, NDArray[np.int32], NDArray[np.int32]]:
        """Parse some lines of one space between words, and return the corners of their faces.

        Also how many each has, and (2, F) the material and the smoothing group of each.
        """
        letters = np.frombuffer(chunk + b"\n\n", np.uint8)
        ends = np.flatnonzero(letters[:-2] == _NEWLINE)
        starts = np.concatenate([[0], ends[:-1] + 1])
        first, second, third = (letters[starts + k] for k in range(3))
        kinds = np.full(len(starts), -1, np.int8)
        kinds[(first == ord("v")) & (second == _SPACE)] = 0
        for number, letter in ((1, "t"), (2, "n")):
            kinds[(first == ord("v")) & (second == ord(letter)) & (third == _SPACE)] = number
        kinds[(first == ord("f")) & (second == _SPACE)] = 3

        breaks = np.flatnonzero(np.diff(kinds)) + 1
        runs: dict[int, list[bytes]] = {}
        for begin, end in zip([0, *breaks.tolist()], [*breaks.tolist(), len(kinds)], strict=True):
            runs.setdefault(int(kinds[begin]), []).append(chunk[starts[begin] : ends[end - 1] + 1])
        before = dict(self._size)
        for number, kind in enumerate(_COLUMNS):
            if number in runs:
                rows = self._numbers(kind, b"".join(runs[number]), self._line + np.flatnonzero(kinds == number))
                self._found[kind].append(rows)
                self._size[kind] += len(rows)
        others = np.flatnonzero((kinds == -1) & (starts < ends))
        faces = np.flatnonzero(kinds == 3)
        statements = [
            chunk[start:end] for start, end in zip(starts[others].tolist(), ends[others].tolist(), strict=True)
        ]
        changes = self._states_of(statements, np.searchsorted(faces, others).tolist())
        of_faces = _states_of_faces(*changes, len(faces))
        corners, counts = np.zeros((0, 3), np.int32), np.zeros(0, np.int32)
        if 3 in runs:
            corners, counts = self._corners(b"".join(runs[3]), self._line + faces)
            for column, kind in enumerate(_COLUMNS):
                indices = corners[:, column]
                if (relative := np.flatnonzero(indices < 0)).size:
                    # A negative one counts from the line on which it is.
                    own = np.repeat(faces, counts)[relative]
                    indices[relative] += (before[kind] + 1 + np.cumsum(kinds == column)[own]).astype(np.int32)
                wrong = np.flatnonzero(indices < 1) if column == 0 else relative[indices[relative] < 1]
                for corner in wrong[:1].tolist():
                    place = int(self._line + np.repeat(faces, counts)[corner])
                    raise self._error(f"a face names a {kind!r} that is not there ({self._size[kind]} are)", place)
        self._line += len(starts)
        return corners - np.int32(1), counts, of_faces

    def _states_of(self, statements: list[bytes], faces_before: list[int]) -> tuple[list[int], list[tuple[int, int]]]:
        """Add statements, and return from which face on there is which state."""
        begins, states = [0], [self._state]
        for statement, begin in zip(statements, faces_before, strict=True):
            self._add_statement(statement.decode("utf-8", "surrogateescape"))
            if self._state != states[-1]:
                begins.append(begin)
                states.append(self._state)
        return begins, states

    def _add_statement(self, line: str) -> None:
        match line.split(" "):
            case ["usemtl", *name]:
                self._state = self.materials.setdefault(plain_name(name), len(self.materials)), self._state[1]
            case ["s", name, *_]:
                self._state = self._state[0], self._smoothing.setdefault(name, len(self._smoothing))
                self.others["s"] += 1
            case ["mtllib", name, *more]:
                self.libraries.append(" ".join([name, *more]))
            case [key, *_] if key in _COLUMNS:
                raise self._error(f"{key!r} has no numbers")
            case [key, *_]:
                self.others[key if _STATEMENT.fullmatch(key) else "text that is no statement"] += 1

    def _numbers(self, kind: str, text: bytes, lines: _Index) -> NDArray[Any]:
        """Return the numbers of vertex lines, as many columns as the shortest has and are of use."""
        letters = np.frombuffer(text, np.uint8)
        marks = np.flatnonzero((letters < ord("0")) & (letters != ord("-")) & (letters != ord("+")))
        signs = letters[marks]
        ends = np.flatnonzero(signs != _DOT)
        newlines = np.flatnonzero(signs[ends] == _NEWLINE)
        widths = np.diff(newlines, prepend=-1) - 1
        is_key = np.zeros(len(ends), bool)
        is_key[newlines - widths] = True
        least, most = _COLUMNS[kind]
        if (short := np.flatnonzero(widths < least)).size:
            raise self._error(f"{kind!r} has {widths[short[0]]} numbers instead of {least}", int(lines[short[0]]))
        places = marks[ends]
        dotted = signs[ends - 1] == _DOT
        dotted[0] = False
        is_plain = (
            np.count_nonzero(letters > ord("9")) == len(kind) * len(lines)
            and np.count_nonzero(dotted) == len(marks) - len(ends)
            and int(np.diff(places).max()) <= _LONGEST
        )
        count = len(ends) - len(lines)
        if is_plain:
            # Digits as an integer, divided by a power of ten: a third of the time of parsing a fraction, as exact.
            values = _parsed(text.translate(_TO_SPACES, b"."), np.int64).astype(np.float64)
            decimals = np.where(dotted, places - marks[ends - 1] - 1, 0)[~is_key]
            values = values / _POWERS[decimals] if len(values) == count else values
        else:
            values = _parsed(_KEY.sub(b" ", text), np.float64)
        if len(values) != count:
            raise self._error(f"something else where a number of {kind!r} should be, from line {lines[0]} on")
        width = int(widths.min())
        if kind == "v":
            self._widest = max(self._widest, int(widths.max()))
        if width < widths.max():
            column = np.arange(len(ends)) - np.repeat(newlines - widths, widths + 1)
            values = values[(column <= width)[~is_key]]
        rows = values.reshape(-1, width)[:, :most]
        with np.errstate(over="ignore"):
            return rows if kind == "v" else rows.astype(np.float32)

    def _corners(self, text: bytes, lines: _Index) -> tuple[_Corners, NDArray[np.int32]]:
        """Return (C, 3) what the corners of faces name, as in the file, 0 for nothing; and the corners of each face."""
        letters = np.frombuffer(text, np.uint8)
        marks = np.flatnonzero((letters <= _SLASH) & (letters != ord("-")))
        signs, gaps = letters[marks], np.diff(marks, append=0)
        values = np.clip(_parsed(text.translate(_TO_SPACES), np.int64), -_LARGEST, _LARGEST).astype(np.int32)
        is_first = signs == _SPACE
        given = (gaps > 1) & (signs != _NEWLINE)
        period = len(marks) // len(lines)
        if len(marks) == period * len(lines) and all(
            (each.reshape(-1, period) == each[:period]).all() for each in (signs, given)
        ):  # all lines are alike
            count = np.count_nonzero(is_first[:period])
            counts = np.full(len(lines), count, np.int32)
            owner, slot = _owners(is_first[:period])
            chosen = given[:period]
            corners = np.zeros((len(lines), count, 3), np.int32)
            if len(values) == len(lines) * np.count_nonzero(chosen) and slot[chosen].max(initial=0) < 3:
                corners[:, owner[chosen], slot[chosen]] = values.reshape(len(lines), -1)
                return corners.reshape(-1, 3), counts
        else:
            ends = np.flatnonzero(signs == _NEWLINE)
            owner, slot = _owners(is_first)
            counts = np.diff(owner[ends], prepend=-1).astype(np.int32)
            corners = np.zeros((np.count_nonzero(is_first), 3), np.int32)
            if len(values) == np.count_nonzero(given) and slot[given].max(initial=0) < 3:
                corners[owner[given], slot[given]] = values
                return corners, counts
        raise self._error(f"something in a face that is no index, from line {lines[0]} on")


def _parsed(text: bytes, kind: type[np.generic]) -> NDArray[Any]:
    """Return the numbers of a text, or fewer if something else is in it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # NumPy before 2.3 warns of that
        try:
            return np.fromstring(text, kind, sep=" ")
        except ValueError:
            return np.zeros(0, kind)


def _owners(is_first: NDArray[np.bool_]) -> tuple[_Index, _Index]:
    """Return the corner that each mark belongs to, and its place in that corner, from where corners begin."""
    place = np.arange(len(is_first))
    return np.cumsum(is_first) - 1, place - np.maximum.accumulate(np.where(is_first, place, 0))


def _states_of_faces(begins: list[int], states: list[tuple[int, int]], count: int) -> NDArray[np.int32]:
    """Return (2, F) the state of each of `count` faces, from the faces at which states begin."""
    return np.repeat(np.array(states, np.int32).T, np.diff([*begins, count]), axis=1)


def _joined_lines(data: bytes) -> bytes:
    """Return a text with continued lines joined, and newlines between lines."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data.replace(b"\\\n", b" ") if b"\\" in data else data


def _name_or_nothing(found: re.Match[bytes]) -> bytes:
    """Return what a match of _COMMENT has of a name, in which "#" may be: the start of a word begins a comment."""
    text, start = found.string, found.start()
    before = text[text.rfind(b"\n", 0, start) + 1 : start]
    is_comment = not before or before[-1] <= _SPACE or before.lstrip()[:1] in b"vf"
    return b"" if is_comment else re.split(rb"\s#", found[0], maxsplit=1)[0]


def _chunks(data: bytes) -> Iterator[bytes]:
    """Yield whole lines of some bytes each, without comments, and with one space between words and no other."""
    start = 0
    while start < len(data):
        end = data.find(b"\n", start + _CHUNK) + 1 or len(data)
        chunk = data[start:end]
        chunk = chunk if chunk.endswith(b"\n") else chunk + b"\n"
        start = end
        if b"#" in chunk:
            chunk = _COMMENT.sub(_name_or_nothing, chunk)
        if b"\t" in chunk:
            chunk = chunk.replace(b"\t", b" ")
        blank = np.frombuffer(chunk, np.uint8) <= _SPACE
        if blank[0] or (blank[1:] & blank[:-1]).any():
            while b"  " in chunk:
                chunk = chunk.replace(b"  ", b" ")
            chunk = _INDENT.sub(b"", chunk).replace(b" \n", b"\n")
        yield chunk
