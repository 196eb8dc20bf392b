"""No command ends in a traceback if standard streams are closed, full or ASCII only."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.commands import ENVIRONMENT, ROOM, SMALL, run, without_progress

from wrt.cli import main

PRINTING = {
    "--help": ["--help"],
    "scenes": ["scenes"],
    "schema": ["schema"],
    "one material": ["materials", "diffuse"],
    "completion": ["completion", "bash"],
    "info": ["info", "möbius.toml"],
    "render --json": ["render", "möbius.toml", *SMALL, "--json"],
}
"""Commands whose result is their standard output."""

WRITING = {"convert": ["convert", "teapot", "teapot.toml"], "render": ["render", "möbius.toml", *SMALL]}
"""Commands whose result is a file."""

UNUSABLE = {"no file": ["render", "abßent.obj"], "no option": ["render", "x.obj", "--nö"]}

COMMANDS = {**PRINTING, **WRITING, **UNUSABLE}

QUICK = ("--help", "no file")

FEW = ("scenes", "schema", "one material", "completion", "info", "convert", "no option")
"""Commands that share their code with others: tried with the first state of their streams alone."""


def cases(states: list) -> list:
    """Return commands and the states of their streams."""
    return [
        pytest.param(command, state, marks=() if command in QUICK else pytest.mark.slow)
        for command in COMMANDS
        for state in (states[:1] if command in FEW else states)
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "möbius.toml").write_text(ROOM)
    return tmp_path


@contextlib.contextmanager
def pipe_that_nobody_reads() -> Iterator[int]:
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


@contextlib.contextmanager
def full_device() -> Iterator[int]:
    handle = os.open("/dev/full", os.O_WRONLY)
    yield handle
    os.close(handle)


def ended(folder: Path, command: str, *, output_lost: bool = False, **options) -> subprocess.CompletedProcess[bytes]:
    done = run(folder, *COMMANDS[command], text=False, **options)
    for said in (done.stdout or b"", done.stderr or b""):
        assert b"Traceback" not in said, said.decode(errors="replace")
        assert b"Exception" not in said, said.decode(errors="replace")
    assert done.returncode == (2 if command in UNUSABLE else int(output_lost and command in PRINTING)), done.stderr
    return done


@pytest.mark.parametrize(("command", "closed"), cases([(0, 1, 2), (1,), (2,)]), ids=str)
def test_closed_streams(command: str, closed: tuple[int, ...], folder: Path) -> None:
    def close() -> None:
        for number in closed:
            os.close(number)

    done = ended(folder, command, output_lost=1 in closed, before=close)
    if command in PRINTING and closed == (1,):
        assert done.stderr.endswith(b"wrt: error: standard output: Bad file descriptor\n")
    if command == "render":  # the picture, not text for standard error
        assert (folder / "möbius.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("place", [pipe_that_nobody_reads, full_device])
@pytest.mark.parametrize(("command", "streams"), cases([("stdout",), ("stderr",), ("stdout", "stderr")]), ids=str)
def test_streams_that_cannot_be_written_to(
    command: str, streams: tuple[str, ...], place: Callable[[], contextlib.AbstractContextManager[int]], folder: Path
) -> None:
    with place() as handle:
        done = ended(folder, command, output_lost="stdout" in streams, **dict.fromkeys(streams, handle))
    if command in PRINTING and streams == ("stdout",):
        said = without_progress(done.stderr.decode()).splitlines()[command == "render --json" :]
        full = ["wrt: error: standard output: No space left on device"]
        assert said == (full if place is full_device else []), "a closed pipe is no error"


ENCODINGS = {
    "ascii:strict": {"PYTHONIOENCODING": "ascii:strict"},
    "C without coercion": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    "utf-16": {"PYTHONIOENCODING": "utf-16"},
}


@pytest.mark.parametrize(("command", "encoding"), cases([*ENCODINGS]))
def test_streams_of_few_letters(command: str, encoding: str, folder: Path) -> None:
    done = ended(folder, command, env={**ENVIRONMENT, **ENCODINGS[encoding]})
    if command == "no file" and encoding.startswith("ascii"):
        assert done.stderr.startswith(rb"wrt: error: ab\xdfent.obj: no such file")


@pytest.mark.parametrize("command", ["info", pytest.param("render", marks=pytest.mark.slow)])
def test_names_that_are_no_text(command: str, folder: Path) -> None:
    name, arguments = os.fsdecode(b"m\xff\xe9.toml"), SMALL if command == "render" else ()
    (folder / name).write_text(ROOM)
    done = run(folder, command, *arguments, name, text=False)
    assert done.returncode == 0, done.stderr
    absent = run(folder, command, *arguments, os.fsdecode(b"\xfe") + name, text=False)
    assert absent.returncode == 2
    assert absent.stderr.startswith(rb"wrt: error: \udcfem\udcff\udce9.toml: no such file")


def test_nul_characters_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in COMMANDS.values():
        for number in range(len(arguments) if arguments[0] != "--help" else 0):
            assert main([*arguments[:number], arguments[number] + "\0x", *arguments[number + 1 :]]) == 2
            said = capsys.readouterr().err
            assert said.startswith("wrt: error: ")
            assert "NUL" in said
            assert said.count("\n") == 1
