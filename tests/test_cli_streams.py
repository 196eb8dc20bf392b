"""No command ends in a traceback if standard streams are closed, full or ASCII only."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from test_cli import ENVIRONMENT, without_progress

from wrt.cli import main

PRINTING = {
    "--help": ["--help"],
    "--version": ["--version"],
    "render --help": ["render", "--help"],
    "scenes": ["scenes"],
    "schema": ["schema"],
    "materials": ["materials"],
    "one material": ["materials", "diffuse"],
    "completion": ["completion", "bash"],
    "info": ["info", "möbius.obj"],
    "render --json": ["render", "möbius.obj", "--size", "8x8", "--spp", "1", "--json"],
}
"""Commands whose result is their standard output."""

WRITING = {
    "convert": ["convert", "teapot", "teapot.toml"],
    "render": ["render", "möbius.obj", "--size", "8x8", "--spp", "1"],
}
"""Commands whose result is a file."""

UNUSABLE = {"no file": ["render", "abßent.obj"], "no option": ["render", "x.obj", "--nö"], "no command": ["rendr"]}

COMMANDS = {**PRINTING, **WRITING, **UNUSABLE}

QUICK = ("--help", "render --json", "no file")
"""Commands that are not left out of a quick run of the tests."""

EVERY_WAY = (*QUICK, "render")
"""Commands that are tried with all streams in all states; the others share their code, and are tried with some."""


def cases(states: Iterable[object], some: Iterable[object]) -> list[Any]:
    """Return commands and states of their streams: all states for EVERY_WAY, and `some` for the others."""
    return [
        pytest.param(command, state, marks=() if command in QUICK else pytest.mark.slow)
        for command in COMMANDS
        for state in (states if command in EVERY_WAY else some)
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "möbius.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
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


def run(folder: Path, arguments: list[str], *, close: tuple[int, ...] = (), **options) -> subprocess.CompletedProcess:
    def close_streams() -> None:
        for number in close:
            os.close(number)

    environment = {**ENVIRONMENT, **options.pop("env", {})}
    program = [sys.executable, "-m", "wrt", *arguments]
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.run(program, cwd=folder, env=environment, preexec_fn=close_streams, check=False, **streams)


def require_quiet(done: subprocess.CompletedProcess) -> None:
    for said in (done.stdout or b"", done.stderr or b""):
        assert b"Traceback" not in said, said.decode(errors="replace")
        assert b"Exception" not in said, said.decode(errors="replace")


def status_of(command: str, *, output_lost: bool) -> int:
    return 2 if command in UNUSABLE else int(output_lost and command in PRINTING)


@pytest.mark.parametrize(("command", "close"), cases([(1,), (2,), (0, 1, 2)], [(0, 1, 2)]), ids=str)
def test_closed_streams(command: str, close: tuple[int, ...], folder: Path) -> None:
    done = run(folder, COMMANDS[command], close=close)
    require_quiet(done)
    assert done.returncode == status_of(command, output_lost=1 in close)
    said = without_progress(done.stderr.decode())
    if command in PRINTING and close == (1,):
        assert said.endswith("wrt: error: standard output: Bad file descriptor\n")
    if command == "render":  # the picture, not text for standard error
        assert (folder / "möbius.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("place", [pipe_that_nobody_reads, full_device])
@pytest.mark.parametrize(
    ("command", "streams"), cases([("stdout",), ("stderr",), ("stdout", "stderr")], [("stdout",)]), ids=str
)
def test_streams_that_cannot_be_written_to(
    command: str, streams: tuple[str, ...], place: Callable[[], contextlib.AbstractContextManager[int]], folder: Path
) -> None:
    with place() as handle:
        done = run(folder, COMMANDS[command], **dict.fromkeys(streams, handle))
    require_quiet(done)
    assert done.returncode == status_of(command, output_lost="stdout" in streams)
    if command in PRINTING and streams == ("stdout",):
        said = without_progress(done.stderr.decode()).splitlines()[command == "render --json" :]
        full = ["wrt: error: standard output: No space left on device"]
        assert said == (full if place is full_device else []), "a closed pipe is no error"


ENCODINGS = {
    "C without coercion": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    "ascii:strict": {"PYTHONIOENCODING": "ascii:strict"},
    "latin-1:strict": {"PYTHONIOENCODING": "latin-1:strict"},
    "utf-16": {"PYTHONIOENCODING": "utf-16"},
}


@pytest.mark.parametrize(("command", "encoding"), cases(ENCODINGS, ["ascii:strict"]))
def test_streams_of_few_letters(command: str, encoding: str, folder: Path) -> None:
    done = run(folder, COMMANDS[command], env=ENCODINGS[encoding])
    require_quiet(done)
    assert done.returncode == status_of(command, output_lost=False), done.stderr
    if command == "no file" and encoding.startswith("ascii"):
        assert done.stderr.startswith(rb"wrt: error: ab\xdfent.obj: no such file")


@pytest.mark.parametrize("command", [["info"], ["render", "--size", "8x8", "--spp", "1", "--json"]])
def test_names_that_are_no_text(command: list[str], folder: Path) -> None:
    name = b"m\xff\xe9.obj"
    mesh = (folder / "möbius.obj").read_bytes()
    (folder / os.fsdecode(name)).write_bytes(mesh)
    done = run(folder, [*command, os.fsdecode(name)])
    require_quiet(done)
    assert done.returncode == 0, done.stderr
    absent = run(folder, [*command, os.fsdecode(b"\xfe" + name)])
    assert absent.returncode == 2
    assert absent.stderr.startswith(rb"wrt: error: \udcfem\udcff\udce9.obj: no such file")


@pytest.mark.parametrize("command", [command for command in COMMANDS if command not in ("--help", "--version")])
def test_nul_characters(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = COMMANDS[command]
    for number in range(len(arguments)):
        assert main([*arguments[:number], arguments[number] + "\0x", *arguments[number + 1 :]]) == 2
        said = capsys.readouterr().err
        assert said.startswith("wrt: error: ")
        assert "NUL" in said
        assert said.count("\n") == 1
