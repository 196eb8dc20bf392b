"""Files of an animation's frames, and the state from which it resumes.

The frames of a video are in the folder NAME.frames beside it until the video is complete. If the output is frames, such
as cow_%04d.png, they stay, and the state is in a file beside them.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from wrt.animation.video import is_video
from wrt.errors import InputError
from wrt.io.images import check_output
from wrt.io.safe_read import first_line, forget_input, read_file
from wrt.io.safe_write import Kind, NotReplacedError, write_atomically

_FIRST = '{"wrt frames": '
_FORMAT = 1
_STATE = "frames.json"
_PLACE = re.compile(r"%(0?)(\d{0,2})d")
_MOST_CHARACTERS = 24
"""Messages about differences quote values of up to this length, and not digests."""


def _is_state(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_FIRST)) == _FIRST.encode()


STATE = Kind("the state of an animation", _is_state, may_force=False)


def has_place(path: str) -> bool:
    """Return whether a file name has a place for frame numbers, such as %04d."""
    return _PLACE.search(Path(path).name) is not None


class FrameFiles:
    """The frames of one animation on disk.

    Attributes:
        numbers: the frame numbers.
        complete: numbers of complete frames, as in the state file.
        folder: the folder of a video's frames, or None.
        state: the state file.
    """

    def __init__(self, output: Path, numbers: Sequence[int], *, force: bool = False) -> None:
        """Check before a long render that the frames can be written.

        Args:
            output: a video, or a name with one place for the frame number.
            numbers: the frame numbers.
            force: whether frames may replace pictures that wrt did not make.

        Raises:
            InputError: if frames cannot be written, or would replace files that wrt did not make.
        """
        self.numbers = list(numbers)
        self.complete: set[int] = set()
        self._force = force
        self.folder: Path | None = None
        if is_video(output):
            self.folder = output.with_suffix(".frames")
            self._pattern = self.folder / "%05d.png"
            self.state = self.folder / _STATE
            try:
                is_free = not os.path.lexists(self.folder) or (self.state.is_file() and _is_state(self.state))
                is_free = is_free or (self.folder.is_dir() and not any(self.folder.iterdir()))
            except OSError as error:
                raise InputError(f"{self.folder}: {error.strerror or error}") from None
            if not is_free:
                raise NotReplacedError(
                    f"{self.folder}: the frames of {output} would go there, but wrt did not make it; name another video"
                )
            return
        if len(_PLACE.findall(output.name)) != 1 or output.name.count("%") != 1:
            raise InputError(f"{output}: the name of frames needs one place for their numbers, such as cow_%04d.png")
        self._pattern = output
        self.state = output.with_name(_PLACE.sub("", output.stem).strip("._- ") + f".{_STATE}")
        for number in self.numbers:
            check_output(self.path(number), force=force)

    def path(self, number: int) -> Path:
        """Return the path of a frame's picture."""
        name = _PLACE.sub(lambda place: f"{number:{place[1]}{place[2]}d}", self._pattern.name)
        return self._pattern.with_name(name)

    @property
    def count_complete(self) -> int:
        """Number of frames of this animation that are complete."""
        return len(self.complete.intersection(self.numbers))

    @property
    def location(self) -> Path:
        """The folder or the pattern of the frames, for messages."""
        return self.folder or self._pattern

    def begin(self, identity: Mapping[str, Any], *, resume: bool) -> bool:
        """Resume an earlier run or start over; return whether there was one.

        Args:
            identity: everything that the pictures depend on, by name; JSON values.
            resume: whether to keep the frames of an earlier run, which must have the same identity.

        Raises:
            InputError: if the earlier run differs, or its state cannot be read.
        """
        stored = self._stored()
        before, complete = stored or ({}, [])
        if stored is not None and resume:
            differences = [
                f"{name} ({before.get(name)} there, {value} here)" if len(str(value)) <= _MOST_CHARACTERS else name
                for name, value in identity.items()
                if before.get(name) != value
            ]
            if differences:
                raise InputError(f"{self.state}: cannot resume, these differ: {', '.join(differences)}")
            self.complete = {number for number in complete if self.path(number).is_file()}
        elif self.folder is not None:
            self._remove_frames(complete)
        self._identity = dict(identity)
        if self.folder is not None:
            try:
                self.folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"{self.folder}: cannot be made: {error.strerror or error}") from None
        self._save()
        return stored is not None

    def _stored(self) -> tuple[dict[str, Any], list[int]] | None:
        """Return the identity of an earlier run and the numbers of its complete frames, or None."""
        if not self.state.is_file():
            return None
        try:
            stored = json.loads(read_file(self.state))
            forget_input(self.state)
            if stored["wrt frames"] != _FORMAT or not isinstance(stored["identity"], dict):
                raise ValueError("another format")
            return stored["identity"], [int(number) for number in stored["complete"]]
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise InputError(f"{self.state}: not the state of an animation, or damaged ({first_line(error)})") from None

    def add(self, number: int, write: Callable[[Path, bool], object]) -> None:
        """Call `write` with a frame's path and `force` to save its picture, and mark the frame complete."""
        write(self.path(number), self._force)
        self.complete.add(number)
        self._save()

    def _save(self) -> None:
        content = {"wrt frames": _FORMAT, "identity": self._identity, "complete": sorted(self.complete)}
        write_atomically(self.state, lambda path: path.write_text(json.dumps(content)), STATE)

    def remove(self) -> None:
        """Remove a video's frames once the video is complete."""
        if self.folder is not None:
            self._remove_frames(self.complete)
            with contextlib.suppress(OSError):  # the folder has other files
                self.state.unlink()
                self.folder.rmdir()

    def _remove_frames(self, numbers: Sequence[int] | set[int]) -> None:
        for number in numbers:
            with contextlib.suppress(OSError):
                self.path(number).unlink()
