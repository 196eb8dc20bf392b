"""The command line keeps its word: exit status, one line an error, whole files, the same bytes after a kill."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from wrt import meshes
from wrt.cli import main
from wrt.cli.arguments.options import parse
from wrt.cli.signals import Interrupts
from wrt.progress.terminal import columns_of

SMALL = ["render", "cornell-box", "--size", "32x32"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}


def _default_interrupt() -> None:
    # A test run started in the background hands down SIGINT ignored, and wrt would rightly go on ignoring it.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def start(folder: Path, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "wrt", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        **{"env": ENVIRONMENT, "stderr": subprocess.PIPE, "preexec_fn": _default_interrupt, **options},
    )


def run(folder: Path, *arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    process = start(folder, *arguments, **options)
    out, err = process.communicate(timeout=300)
    return subprocess.CompletedProcess(arguments, process.returncode, out, without_progress(err or ""))


def without_progress(said: str) -> str:
    """Remove progress lines, which appear when a render is slow, as on a busy machine or while kernels are compiled."""
    lines = said.splitlines(keepends=True)
    return "".join(line for line in lines if not re.match(r"wrt: .*: (getting ready;|\d+ %  \d)", line))


def summary_of(result: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout.splitlines()[-1])
    assert isinstance(summary, dict)
    return summary


UNCOMPILED = {**ENVIRONMENT, "PYTHONDONTWRITEBYTECODE": "1"}
"""With a limit on files, Python would leave truncated modules in its cache for all later tests."""

CAMERA = "[camera]\norigin = [0, 0, {z}]\ntarget = [0, 0, 0]\n"
QUAD = '[[shapes]]\ntype = "quad"\norigin = [-1, -1, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 2, 0]\n'

FILES = {
    "empty.obj": "# no faces\nv 0 0 0\n",
    "broken.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n0\n",
    "nothing.stl": "",
    "text.toml": "this is not TOML",
    "unknown-key.toml": CAMERA.format(z=3) + QUAD + 'materal = "white"\n',
    "nan-camera.toml": CAMERA.format(z="nan") + QUAD,
    "no-shapes.toml": CAMERA.format(z=3),
    "not-a-checkpoint": "hello",
}

ERRORS = {
    "missing file": (["render", "absent.ply"], "absent.ply"),
    "missing scene": (["render", "cornel-box"], "cornel-box"),
    "mesh without faces": (["render", "empty.obj"], "empty.obj"),
    "mesh of broken content": (["render", "broken.ply"], "broken.ply"),
    "empty file": (["render", "nothing.stl"], "nothing.stl"),
    "directory as input": (["render", "folder"], "folder"),
    "unknown format": (["render", "not-a-checkpoint"], "not-a-checkpoint"),
    "not TOML": (["render", "text.toml"], "text.toml"),
    "unknown key": (["render", "unknown-key.toml"], "unknown-key.toml: shapes[0].materal"),
    "camera of NaN": (["render", "nan-camera.toml"], "nan-camera.toml: camera"),
    "scene without shapes": (["render", "no-shapes.toml"], "shapes"),
    "directory as output": ([*SMALL, "-o", "folder"], "folder"),
    "directory with a suffix as output": ([*SMALL, "-o", "folder.png"], "folder.png"),
    "output in no folder": ([*SMALL, "-o", "nowhere/out.png"], "nowhere"),
    "output of unknown format": ([*SMALL, "-o", "out.webm"], "out.webm"),
    "zero size": (["render", "cornell-box", "--size", "0x32"], "--size"),
    "more pixels than can be": (["render", "cornell-box", "--size", "60000x60000"], "60000x60000"),
    "a part with three corners": (["render", "cornell-box", "--crop", "0,0,32"], "--crop"),
    "a part beyond the picture": (["render", "cornell-box", "--crop", "0,0,9999,9"], "crop must lie inside"),
    "size without height": (["render", "cornell-box", "--size", "32"], "--size"),
    "no samples": ([*SMALL, "--spp", "0"], "--spp"),
    "too many samples": ([*SMALL, "--spp", "3000000000"], "spp"),
    "no time": ([*SMALL, "--time", "0"], "--time"),
    "time of NaN": ([*SMALL, "--time", "nan"], "--time"),
    "exposure beyond all": ([*SMALL, "--exposure", "1e9"], "exposure"),
    "seed too large": ([*SMALL, "--seed", "4294967296"], "seed"),
    "unknown device": ([*SMALL, "--device", "tpu"], "tpu"),
    "device that is not there": ([*SMALL, "--device", "cuda:99"], "cuda:99"),
    "resume from nothing": ([*SMALL, "--resume"], "--checkpoint"),
    "resume from another file": ([*SMALL, "--checkpoint", "not-a-checkpoint", "--resume"], "not-a-checkpoint"),
    "directory as checkpoint": ([*SMALL, "--checkpoint", "folder"], "folder"),
    "checkpoint over the input": (["render", "text.toml", "--checkpoint", "text.toml"], "text.toml"),
    "triangles where none are made": ([*SMALL, "--triangles", "10"], "triangles"),
    "up axis of a scene": ([*SMALL, "--up", "z"], "up"),
    "unknown option": ([*SMALL, "--sp", "4"], "--sp"),
    "no command": ([], "COMMAND"),
}


def write_unusable(folder: Path) -> list[Path]:
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "folder").mkdir()
    (folder / "folder.png").mkdir()
    return sorted(folder.rglob("*"))


@pytest.mark.parametrize("case", ERRORS)
def test_unusable_input_is_one_line_and_status_2(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, mention = ERRORS[case]
    before = write_unusable(tmp_path)
    monkeypatch.chdir(tmp_path)
    status = main(arguments)
    out, err = capsys.readouterr()
    err = without_progress(err)
    assert (status, out) == (2, ""), err
    assert re.fullmatch(r"wrt: error: [^\n]+\n", err), err
    assert mention in err
    assert sorted(tmp_path.rglob("*")) == before, "a refused command left files behind"


@pytest.mark.parametrize("case", ["missing file", "directory as output", "no command"])
def test_the_program_says_the_same(case: str, tmp_path: Path) -> None:
    """A process of its own, which begins and ends with more than `main`."""
    arguments, mention = ERRORS[case]
    before = write_unusable(tmp_path)
    result = run(tmp_path, *arguments)
    assert (result.returncode, result.stdout) == (2, ""), result.stderr
    assert re.fullmatch(r"wrt: error: [^\n]+\n", result.stderr), result.stderr
    assert mention in result.stderr
    assert sorted(tmp_path.rglob("*")) == before, "a refused command left files behind"


def test_more_pixels_than_memory_is_one_line_and_status_1(tmp_path: Path) -> None:
    result = run(tmp_path, "render", "cornell-box", "--size", "46000x46000")
    assert result.returncode == 1, result.stderr
    assert result.stdout == ""
    found = re.fullmatch(r"wrt: error: a picture of 46000x46000 needs 253\.9 GB, more than the .+\n", result.stderr)
    assert found, result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file_is_one_line_and_status_2(tmp_path: Path) -> None:
    mesh = tmp_path / "secret.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh.chmod(0)
    result = run(tmp_path, "render", "secret.obj")
    assert result.returncode == 2
    assert re.fullmatch(r"wrt: error: secret\.obj: [^\n]+\n", result.stderr)


@pytest.mark.parametrize("suffix", ["png", "exr", "npy"])
def test_file_that_cannot_be_written_is_one_line_and_status_1(suffix: str, tmp_path: Path) -> None:
    summary_of(run(tmp_path, *SMALL, "--spp", "1", "--json", "-o", "small.png"))  # kernels are in the cache from here

    def full_disk() -> None:
        _default_interrupt()
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    result = run(tmp_path, *SMALL, "--spp", "1", "-o", f"big.{suffix}", preexec_fn=full_disk, env=UNCOMPILED)
    assert result.returncode == 1, result.stderr
    assert re.fullmatch(rf"wrt: error: big\.{suffix}: [^\n]+\n", result.stderr), result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["small.png"]


def test_checkpoint_that_cannot_be_written_is_one_line_and_status_1(tmp_path: Path) -> None:
    def full_disk() -> None:
        _default_interrupt()
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    result = run(tmp_path, *SMALL, "--spp", "1", "--checkpoint", "state", preexec_fn=full_disk, env=UNCOMPILED)
    assert result.returncode == 1, result.stderr
    assert re.fullmatch(r"wrt: error: [^\n]+\n", result.stderr), result.stderr
    assert not (tmp_path / "state").exists()


def test_json_summary_is_the_last_line_and_tells_the_truth(tmp_path: Path) -> None:
    result = run(tmp_path, *SMALL, "--spp", "8", "--threads", "2", "--json", "-o", "out.npy")
    summary = summary_of(result)
    numbers = {"seconds_total", "seconds_compile", "seconds_render", "paths_per_second", "rays_per_second", "noise"}
    exact = {
        "input": "cornell-box",
        "output": "out.npy",
        "device": "cpu",
        "threads": 2,
        "width": 32,
        "height": 32,
        "spp": 8,
        "seconds_compile_beside": 0.0,
    }
    assert set(summary) == numbers | set(exact) | {"mean_radiance"}
    assert {key: summary[key] for key in exact} == exact
    assert all(isinstance(summary[key], float) and summary[key] > 0.0 for key in numbers)
    assert summary["seconds_total"] > summary["seconds_compile"] + summary["seconds_render"]
    assert summary["paths_per_second"] == pytest.approx(32 * 32 * 8 / summary["seconds_render"])
    image = np.load(tmp_path / "out.npy")
    assert image.shape == (32, 32, 3)
    assert image.dtype == np.float32
    assert summary["mean_radiance"] == pytest.approx(image.mean(axis=(0, 1), dtype=np.float64).tolist(), rel=1e-12)
    rate = r"[\d.]+ [kMG]?\s?paths/s"
    assert re.fullmatch(rf"out\.npy  32x32  8 spp  [\d.]+ s  {rate}  noise [\d.e+]+ %\n", result.stderr), result.stderr


def test_a_part_of_the_picture(tmp_path: Path) -> None:
    whole, part = ["--spp", "1", "-o", "whole.npy"], ["--spp", "1", "-o", "part.npy", "--crop", "3,5,20,9"]
    run(tmp_path, *SMALL, *whole)
    assert "  17x4  " in run(tmp_path, *SMALL, *part).stderr
    np.testing.assert_array_equal(np.load(tmp_path / "part.npy"), np.load(tmp_path / "whole.npy")[5:9, 3:20])


def test_quiet_says_nothing_and_the_picture_is_named_after_the_input(tmp_path: Path) -> None:
    result = run(tmp_path, *SMALL, "--spp", "2", "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["cornell-box.png"]


def test_time_limits_rendering_and_the_first_limit_reached_counts(tmp_path: Path) -> None:
    by_time = summary_of(run(tmp_path, *SMALL, "--time", "0.5", "--json"))
    assert by_time["seconds_render"] >= 0.5
    assert by_time["spp"] >= 1
    assert summary_of(run(tmp_path, *SMALL, "--time", "1000", "--spp", "3", "--json"))["spp"] == 3


def test_warning_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "dark.toml").write_text(CAMERA.format(z=3) + QUAD)
    result = run(tmp_path, "render", "dark.toml", "--size", "8x8", "--spp", "1", "--quiet")
    assert result.returncode == 0
    assert re.fullmatch(r"wrt: warning: [^\n]*no light[^\n]*\n", result.stderr), result.stderr


def test_scenes_lists_every_scene_with_its_description(tmp_path: Path) -> None:
    result = run(tmp_path, "scenes")
    assert result.returncode == 0
    listed = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert listed == meshes.scene_descriptions()


@pytest.mark.parametrize("arguments", [["--help"], ["render", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(arguments: list[str], tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "wrt", *arguments],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    imported = {line.rpartition("|")[2].strip() for line in result.stderr.splitlines()}
    assert "wrt.cli" in imported
    # Of wrt itself just what reads the options: everything else may grow heavy imports of its own.
    assert {name for name in imported if name.partition(".")[0] == "wrt"} <= {
        *(
            "wrt",
            "wrt._version",
            "wrt.errors",
            "wrt.cli.process",
            "wrt.cli",
            "wrt.cli.arguments",
            "wrt.cli.arguments.types",
            "wrt.cli.arguments.options",
            "wrt.cli.arguments.studio",
            "wrt.cli.arguments.parser",
        ),
        *("wrt.cli.exit_status", "wrt.cli.streams"),
    }
    assert not imported & {"numpy", "warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO", "json", "logging"}


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 240.0
    while not path.exists():
        assert process.poll() is None, f"ended too early: {process.communicate()}"
        assert time.monotonic() < deadline, f"{path.name} never came"
        time.sleep(0.01)


@pytest.mark.slow
def test_killed_and_resumed_gives_the_same_bytes(tmp_path: Path) -> None:
    samples = 2048
    command = [*SMALL, "--spp", str(samples), "--checkpoint", "state", "--resume", "--save-every", "0.05"]
    killed = start(tmp_path, *command, "-o", "resumed.npy")
    wait_for(tmp_path / "state", killed)
    killed.kill()
    _, said = killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    assert without_progress(said) == "wrt: no checkpoint state yet; starting from the beginning\n"

    resumed = run(tmp_path, *command, "-o", "resumed.npy")
    assert resumed.returncode == 0, resumed.stderr
    found = re.match(r"wrt: resuming from state, (\d+) samples per pixel\n", resumed.stderr)
    assert found, resumed.stderr
    assert 0 < int(found[1]) < samples, "the kill came too late to prove anything"

    whole = run(tmp_path, *SMALL, "--spp", str(samples), "--threads", "1", "-o", "whole.npy")
    assert whole.returncode == 0, whole.stderr
    assert (tmp_path / "resumed.npy").read_bytes() == (tmp_path / "whole.npy").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupt_saves_picture_and_checkpoint(number: signal.Signals, status: int, tmp_path: Path) -> None:
    from PIL import Image

    command = [*SMALL, "--spp", "100000000", "--checkpoint", "state", "-o", "out.png"]
    process = start(tmp_path, *command, "--save-every", "0.3")
    wait_for(tmp_path / "out.png", process)
    process.send_signal(number)
    out, said = process.communicate(timeout=60)
    assert process.returncode == status
    assert out == ""
    found = re.fullmatch(
        r"wrt: stopped: at ((\d+)(?: to \d+)?) samples per pixel; out\.png and state saved\n", without_progress(said)
    )
    assert found, said
    # Both hold what was there at the end, not what an earlier save left.
    with Image.open(tmp_path / "out.png") as picture:
        assert picture.size == (32, 32)
        assert picture.text["Samples per pixel"] == found[2]  # type: ignore[attr-defined]
    resumed = run(tmp_path, *SMALL, "--spp", "1", "--checkpoint", "state", "--resume", "-o", "out.png")
    assert resumed.returncode == 0
    assert resumed.stderr.startswith(f"wrt: resuming from state, {found[1]} samples per pixel\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.png", "state"]


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupt_before_the_first_sample_leaves_no_file(
    number: signal.Signals,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted_loading(*_: object, **__: object) -> None:
        signal.raise_signal(number)

    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("wrt.api.load", interrupted_loading)
    try:
        assert main([*SMALL, "--checkpoint", "state"]) == status
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "the handler found was not put back"
    finally:
        signal.signal(signal.SIGINT, handlers[0])
    assert signal.getsignal(signal.SIGTERM) is handlers[1]
    assert capsys.readouterr().err == "wrt: stopped: nothing was rendered yet\n"
    assert list(tmp_path.iterdir()) == []


def test_interrupt_while_saving_waits_for_the_end_and_only_the_first_counts() -> None:
    done: list[str] = []

    def save() -> None:
        signal.raise_signal(signal.SIGTERM)
        done.append("saved")

    with Interrupts() as interrupts:
        with pytest.raises(KeyboardInterrupt):
            interrupts.hold(save)
        assert done == ["saved"]
        signal.raise_signal(signal.SIGTERM)  # an impatient second one
        assert interrupts.exit_status == 143


def test_checkpoint_of_another_render_is_refused(tmp_path: Path) -> None:
    summary_of(run(tmp_path, *SMALL, "--spp", "2", "--checkpoint", "state", "--json"))
    picture = (tmp_path / "cornell-box.png").read_bytes()
    for other in (["--size", "16x16"], ["--seed", "1"], ["--max-depth", "2"]):
        result = run(tmp_path, *SMALL, *other, "--spp", "4", "--checkpoint", "state", "--resume")
        assert result.returncode == 2
        assert re.fullmatch(r"wrt: error: state: [^\n]*differ[^\n]*\n", result.stderr), result.stderr
    assert (tmp_path / "cornell-box.png").read_bytes() == picture


def shown_on_terminal(folder: Path, columns: int, *arguments: str) -> list[str]:
    """Return what is sent to a terminal of some width, by lines and frames; width 0 means unknown."""
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = {name: value for name, value in ENVIRONMENT.items() if name != "COLUMNS"}
    process = start(folder, *arguments, stderr=theirs, env=environment)
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 4096)
        except OSError:  # how Linux says that the other side of a pseudo-terminal is closed
            break
        if not part:
            break
        shown += part
    os.close(ours)
    process.communicate(timeout=60)
    assert process.returncode == 0
    return re.split(r"[\r\n]+", shown.decode())


def test_bar_is_drawn_on_a_terminal_and_wiped(tmp_path: Path) -> None:
    frames = shown_on_terminal(tmp_path, 120, *SMALL, "--time", "0.6")
    assert any(re.match(r"cornell-box\s+\d+%\|.*\| +\d+/1 s  \d+ spp  pass \d+  .*paths/s", frame) for frame in frames)
    assert "cornell-box.png  32x32" in frames[-2], "the summary stands alone on the last line"


@pytest.mark.parametrize("columns", [0, 12, *(pytest.param(each, marks=pytest.mark.slow) for each in (40, 80))])
def test_the_bar_fits_the_terminal(columns: int, tmp_path: Path) -> None:
    name = "a-long-name-絵絵絵絵絵絵絵絵-of-a-picture-that-takes-more-than-there-is.png"
    *frames, _, _ = shown_on_terminal(tmp_path, columns, *SMALL, "--time", "0.6", "-o", name)
    assert any("%" in frame for frame in frames)
    assert all(columns_of(frame) < (columns or 80) for frame in frames)


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_up_axis_may_be_negative(axis: str) -> None:
    for arguments in (["--up", axis], [f"--up={axis}"]):
        assert parse(["render", "mesh.ply", *arguments]).up == axis


@pytest.mark.slow
def test_seconds_of_compiling_are_those_waited_for(tmp_path: Path) -> None:
    # With its own caches, as after an installation.
    options: dict[str, Any] = {"env": {**ENVIRONMENT, "XDG_CACHE_HOME": str(tmp_path / "cache")}}
    cold, warm, again = (summary_of(run(tmp_path, *SMALL, "--spp", "1", "--json", **options)) for _ in range(3))
    assert cold["seconds_compile"] > 0.5 * cold["seconds_total"]
    for summary in (warm, again):
        assert summary["seconds_compile"] < 0.1 * cold["seconds_compile"]
        assert summary["seconds_total"] - summary["seconds_compile"] > 0.8 * summary["seconds_total"]
    assert cold["mean_radiance"] == warm["mean_radiance"]
