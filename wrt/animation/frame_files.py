"""The files of an animation's frames, and the state from which it is resumed.

A video's frames are kept in the folder NAME.frames beside it until it is complete. Frames that are wanted as files,
such as cow_%04d.png, stay, and the state is kept in a file beside them.
"""

from __future__ import annotations

import contextlib
import json
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


def _is_state(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_FIRST)) == _FIRST.encode()


STATE = Kind("the state of an animation", _is_state, may_force=False)


def has_place(path: str) -> bool:
    """Return whether a name is for many frames, with a place for their numbers such as %04d."""
    return _PLACE.search(Path(path).name) is not None


class FrameFiles:
    """Where the frames of one animation are, and which of them are complete.

    Attributes:
        numbers: the numbers of the frames.
        complete: numbers of the frames that are complete; the state file has them too.
        folder: the folder of a video's frames, or None.
    """

    def __init__(self, output: Path, numbers: Sequence[int], *, force: bool = False) -> None:
        """Check the names of the frames, before the long work.

        Args:
            output: a video, or a name with one place for the number of the frame.
            numbers: the numbers of the frames.
            force: whether frames may replace pictures that wrt did not make.

        Raises:
            InputError: when frames cannot be written there, or would replace files that wrt did not make.
        """
        self.numbers = list(numbers)
        self.complete: set[int] = set()
        self._force = force
        self.folder: Path | None = None
        if is_video(output):
            self.folder = output.with_suffix(".frames")
            self._pattern = self.folder / "%05d.png"
            self.state = self.folder / _STATE
            self._check_folder(output)
            return
        if len(_PLACE.findall(output.name)) != 1 or output.name.count("%") != 1:
            raise InputError(f"{output}: the name of frames needs one place for their numbers, such as cow_%04d.png")
        self._pattern = output
        self.state = output.with_name(_PLACE.sub("", output.stem).strip("._- ") + f".{_STATE}")
        for number in self.numbers:
            check_output(self.path(number), force=force)

    def _check_folder(self, output: Path) -> None:
        assert self.folder is not None
        try:
            found = self.folder.exists() or self.folder.is_symlink()
            own = self.state.is_file() and _is_state(self.state)
            empty = found and self.folder.is_dir() and not any(self.folder.iterdir())
        except OSError as error:
            raise InputError(f"{self.folder}: {error.strerror or error}") from None
        if found and not own and not empty:
            raise NotReplacedError(
                f"{self.folder}: the frames of {output} would go there, but wrt did not make it; name another video"
            )

    def path(self, number: int) -> Path:
        """Return the path of a frame's picture."""

        def digits(found: re.Match[str]) -> str:
            return f"{number:{found[1]}{found[2]}d}"

        return self._pattern.with_name(_PLACE.sub(digits, self._pattern.name))

    @property
    def done(self) -> int:
        """How many of the wanted frames are complete."""
        return len(self.complete.intersection(self.numbers))

    @property
    def missing(self) -> list[int]:
        """The numbers of the frames that are yet to be rendered."""
        return [number for number in self.numbers if number not in self.complete]

    @property
    def place(self) -> Path:
        """What messages call the place of the frames."""
        return self._pattern if self.folder is None else self.folder

    def begin(self, identity: Mapping[str, Any], *, resume: bool) -> bool:
        """Take up an earlier run's frames, or begin anew; return whether there were any.

        Args:
            identity: what the pictures depend on, by name; JSON values.
            resume: whether to keep the frames of an earlier run, which must have the same identity.

        Raises:
            InputError: when the earlier run differs, naming how; or when its state cannot be read.
        """
        stored = self._stored()
        if stored is not None and resume:
            differences = [
                f"{name} ({stored['identity'].get(name)} there, {value} here)" if _short(value) else name
                for name, value in identity.items()
                if stored["identity"].get(name) != value
            ]
            if differences:
                raise InputError(f"{self.state}: cannot resume, these differ: {', '.join(differences)}")
            self.complete = {number for number in stored["complete"] if self.path(number).is_file()}
        elif stored is not None and self.folder is not None:
            self._remove_frames(stored["complete"])
        self._identity = dict(identity)
        if self.folder is not None:
            try:
                self.folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"{self.folder}: cannot be made: {error.strerror or error}") from None
        self._save()
        return stored is not None

    def _stored(self) -> dict[str, Any] | None:
        if not self.state.is_file():
            return None
        try:
            stored = json.loads(read_file(self.state))
            forget_input(self.state)
            if stored["wrt frames"] != _FORMAT or not isinstance(stored["identity"], dict):
                raise ValueError("another format")
            stored["complete"] = [int(number) for number in stored["complete"]]
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise InputError(f"{self.state}: not the state of an animation, or damaged ({first_line(error)})") from None
        return dict(stored)

    def add(self, number: int, write: Callable[[Path, bool], object]) -> None:
        """Have `write` save a frame's picture, given its path and `force`, and note that it is complete."""
        write(self.path(number), self._force)
        self.complete.add(number)
        self._save()

    def _save(self) -> None:
        content = {"wrt frames": _FORMAT, "identity": self._identity, "complete": sorted(self.complete)}
        write_atomically(self.state, lambda path: path.write_text(json.dumps(content)), STATE)

    def remove(self) -> None:
        """Remove a video's frames, now that it is complete."""
        if self.folder is not None:
            self._remove_frames(self.complete)
            with contextlib.suppress(OSError):  # something else was put there
                self.state.unlink()
                self.folder.rmdir()

    def _remove_frames(self, numbers: Sequence[int] | set[int]) -> None:
        for number in numbers:
            with contextlib.suppress(OSError):
                self.path(number).unlink()


def _short(value: Any) -> bool:
    return len(str(value)) <= 24
