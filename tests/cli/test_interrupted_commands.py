"""Ctrl-C and SIGTERM: status and one line, and no file half written."""

import contextlib
import re
import signal
import subprocess
import sys

import pytest
from PIL import Image
from support.commands import ENVIRONMENT, ROOM, SMALL, run, start, wait_for, without_progress

from wrt.cli import main
from wrt.cli.signals import Interrupts

BOX = ["render", "cornell-box", "--size", "32x32"]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_saves_picture_and_checkpoint(number, status, tmp_path):
    command = [*BOX, "--spp", "100000000", "--checkpoint", "state", "-o", "out.png"]
    process = start(tmp_path, *command, "--save-every", "0.3")
    wait_for(tmp_path / "out.png", process)
    process.send_signal(number)
    out, printed = process.communicate(timeout=60)
    assert (process.returncode, out) == (status, "")
    stopped = r"wrt: stopped: at ((\d+)(?: to \d+)?) samples per pixel; out\.png and state saved\n"
    found = re.fullmatch(stopped, without_progress(printed))
    assert found, printed
    # Both hold what was there at the end, not what an earlier save left.
    with Image.open(tmp_path / "out.png") as picture:
        assert picture.size == (32, 32)
        assert picture.text["Samples per pixel"] == found[2]
    resumed = run(tmp_path, *BOX, "--spp", "1", "--checkpoint", "state", "--resume", "-o", "out.png")
    assert resumed.returncode == 0
    assert resumed.stderr.startswith(f"wrt: resuming from state, {found[1]} samples per pixel\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.png", "state"]


@pytest.mark.slow
def test_an_interrupt_ends_all_inputs(tmp_path):
    for name in ("one.toml", "two.toml"):
        (tmp_path / name).write_text(ROOM)
    process = start(tmp_path, "render", "one.toml", "two.toml", *SMALL[:2], "--time", "1h", "--save-every", "0.2")
    wait_for(tmp_path / "one.png", process)
    process.send_signal(signal.SIGINT)
    _, printed = process.communicate(timeout=60)
    assert process.returncode == 130
    first, second = without_progress(printed).splitlines()
    assert re.fullmatch(r"wrt: stopped: at \d+(?: to \d+)? samples per pixel; one\.png saved", first)
    assert second == "wrt: stopped: two.toml: not rendered"
    assert not list(tmp_path.glob("two*.png"))


def test_an_interrupt_while_saving_waits_for_the_end_and_only_the_first_counts():
    done = []

    def save():
        signal.raise_signal(signal.SIGTERM)
        done.append("saved")

    with Interrupts("", own_process=False) as interrupts:
        with pytest.raises(KeyboardInterrupt):
            interrupts.hold(save)
        assert done == ["saved"]
        signal.raise_signal(signal.SIGTERM)  # an impatient second one
        assert interrupts.exit_status == 143


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

RENDER = "render cornell-box --size 16x16 --spp 4"


def test_an_interrupt_that_a_library_swallows_is_one(monkeypatch, capsys):
    """NumPy raises an ImportError where it is interrupted while it is imported."""

    def swallow(_: object, **options: object) -> int:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise ImportError

    monkeypatch.setattr("wrt.cli.commands.scenes", swallow)
    assert main(["scenes"]) == 130
    assert capsys.readouterr().err == "wrt: stopped: before it was done\n"


@pytest.mark.parametrize(
    ("command", "moment"),
    [
        *(("scenes", 1), ("scenes", 300), ("info teapot", 30_000)),
        *(pytest.param("convert teapot teapot.toml", n, marks=pytest.mark.slow) for n in (60_000, 300_000)),
        *(pytest.param(RENDER, n, marks=pytest.mark.slow) for n in (3000, 30_000, 100_000, 300_000)),
    ],
)
def test_no_traceback_at_any_moment(command, moment, tmp_path):
    program = [sys.executable, "-c", PROGRAM, str(moment), *command.split()]
    result = subprocess.run(program, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert result.returncode in (0, 130, -signal.SIGINT), result.stderr
    if moment == 1:
        assert result.returncode == -signal.SIGINT, "the signal never came"
    assert "Traceback" not in result.stderr
    assert "ignored" not in result.stderr
    printed = without_progress(result.stderr)
    if result.returncode == 130:
        assert printed.startswith("wrt: stopped: ")
        assert printed.count("\n") == 1
        assert list(tmp_path.iterdir()) == [] or "saved" in printed, "a file is left that nothing tells of"
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")], "a file is left half written"
