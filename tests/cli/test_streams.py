"""No command ends in a traceback if standard streams are closed, full, without a reader or ASCII only."""

import contextlib
import os
from collections.abc import Iterator
from typing import Any

import pytest
from support.commands import ENVIRONMENT, ROOM, SMALL, run, without_progress

PRINTING = {
    "--help": ["--help"],
    "info": ["info", "möbius.toml"],
    "render --json": ["render", "möbius.toml", *SMALL, "--json"],
}
"""Commands whose result is their standard output; that of others is a file."""

UNUSABLE = {"no file": ["render", "abßent.obj"], "no option": ["render", "x.obj", "--nö"]}
WRITING = {"convert": ["convert", "teapot", "teapot.toml"], "render": ["render", "möbius.toml", *SMALL]}
COMMANDS = {**PRINTING, **WRITING, **UNUSABLE}

STATES = ("stdout full", "ascii:strict", "both closed", "stdout closed", "stderr closed", "stdout broken")
STATES += ("stderr full", "utf-16", "C")
THOROUGH = {"--help": 6, "no file": 9, "render": 3, "render --json": 1}
"""In how many states these commands are tried; others share their code, and are tried in the first two."""

QUICK = {"--help": ("stdout full", "stdout closed", "stdout broken"), "no file": STATES[1:3]}

PRINTED = {
    "stdout closed": "standard output: Bad file descriptor",
    "stdout full": "standard output: No space left on device",
}


@contextlib.contextmanager
def streams(state: str) -> Iterator[dict[str, Any]]:
    """Yield options of a process whose streams are in a state."""
    what, _, how = state.partition(" ")
    names = ("stdout", "stderr") if what == "both" else (what,)
    if how == "closed":
        yield {"before": lambda: [os.close({"stdout": 1, "stderr": 2}[name]) for name in names]}
    elif how == "full":
        with open("/dev/full", "wb", buffering=0) as device:
            yield dict.fromkeys(names, device)
    elif how == "broken":
        reading, writing = os.pipe()
        os.close(reading)
        yield dict.fromkeys(names, writing)
        os.close(writing)
    elif state == "C":
        yield {"env": {**ENVIRONMENT, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}}
    else:
        yield {"env": {**ENVIRONMENT, "PYTHONIOENCODING": state}}


@pytest.mark.parametrize(
    ("command", "state"),
    [
        pytest.param(command, state, marks=() if state in QUICK.get(command, ()) else pytest.mark.slow)
        for command in COMMANDS
        for state in STATES[: THOROUGH.get(command, 2)]
    ],
)
def test_streams_in_every_state(command, state, tmp_path):
    (tmp_path / "möbius.toml").write_text(ROOM)
    with streams(state) as options:
        done = run(tmp_path, *COMMANDS[command], text=False, **options)
    for printed in (done.stdout or b"", done.stderr or b""):
        assert b"Traceback" not in printed, printed.decode(errors="replace")
        assert b"Exception" not in printed, printed.decode(errors="replace")
    is_lost = state.startswith(("stdout", "both")) and command in PRINTING
    assert done.returncode == (2 if command in UNUSABLE else int(is_lost)), done.stderr
    if is_lost and state.startswith("stdout"):
        printed = without_progress(done.stderr.decode()).splitlines()[command == "render --json" :]
        assert printed == ([f"wrt: error: {PRINTED[state]}"] if state in PRINTED else []), "a closed pipe is no error"
    if command == "render":  # the picture, not text for standard error
        assert (tmp_path / "möbius.png").read_bytes().startswith(b"\x89PNG")
    if (command, state) == ("no file", "ascii:strict"):
        assert done.stderr.startswith(rb"wrt: error: ab\xdfent.obj: no such file")


def test_names_that_are_no_text(tmp_path):
    name = os.fsdecode(b"m\xff\xe9.toml")
    (tmp_path / name).write_text(ROOM)
    done = run(tmp_path, "info", name, text=False)
    assert done.returncode == 0, done.stderr
    absent = run(tmp_path, "info", os.fsdecode(b"\xfe") + name, text=False)
    assert absent.returncode == 2
    assert absent.stderr.startswith(rb"wrt: error: \udcfem\udcff\udce9.toml: no such file")
