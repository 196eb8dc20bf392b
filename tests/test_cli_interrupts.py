"""Ctrl-C at any time ends a command without a traceback, and leaves no file half written."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import ENVIRONMENT, without_progress

# The program sends itself the signal after a number of function calls from its first line on. What Python prints when
# it is interrupted earlier is beyond the program's control.
PROGRAM = """
import sys, _signal
left = int(sys.argv.pop(1))

def count(frame, event, argument):
    global left
    left -= 1
    if left == 0:
        sys.setprofile(None)
        _signal.raise_signal(_signal.SIGINT)

_signal.signal(_signal.SIGINT, _signal.default_int_handler)
import wrt
assert _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler, "a library leaves signals alone"
import importlib.util
spec = importlib.util.find_spec("wrt.__main__")
program = importlib.util.module_from_spec(spec)
source = spec.loader.get_source("wrt.__main__")
first, found, rest = source.partition("from wrt.cli import main")
assert found
exec(compile(first, "first", "exec"), vars(program))
sys.setprofile(count)
exec(compile(found + rest, "rest", "exec"), vars(program))
program.run()
"""

COMMANDS = {
    "scenes": ["scenes"],
    "materials": ["materials"],
    "help": ["render", "--help"],
    "info": ["info", "teapot"],
    "convert": ["convert", "teapot", "teapot.toml"],
    "render": ["render", "cornell-box", "--size", "16x16", "--spp", "4"],
}


@pytest.mark.parametrize("moment", [1, 30, 300, 3000, 10_000, 30_000, 60_000, 100_000, 300_000])
@pytest.mark.parametrize("command", COMMANDS)
def test_at_any_moment(command: str, moment: int, tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(moment), *COMMANDS[command]],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode in (0, 130, -signal.SIGINT), result.stderr
    if moment == 1:
        assert result.returncode == -signal.SIGINT, "the signal never came"
    assert "Traceback" not in result.stderr
    assert "ignored" not in result.stderr
    said = without_progress(result.stderr)
    if result.returncode == 130:
        assert said.startswith("wrt: stopped: ")
        assert said.count("\n") == 1
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")], "a file is left half written"
