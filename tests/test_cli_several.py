"""Several inputs of one command: each is rendered even if others fail, and no picture replaces another."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest
from test_cli import run, start, wait_for, without_progress

from wrt.cli import main
from wrt.cli.output_paths import default_outputs
from wrt.errors import InputError

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SMALL = ["--size", "8x8", "--spp", "1"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("one.obj", "two.obj", "a/room.obj", "b/room.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(TRIANGLE)
    (tmp_path / "broken.obj").write_text("f 1 2 3\n")
    return tmp_path


def written(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.png"))


def test_each_gets_its_own_picture_and_line_of_json(folder: Path) -> None:
    result = run(folder, "render", "one.obj", *SMALL, "cornell-box", "--json", "two.obj")
    assert result.returncode == 0, result.stderr
    summaries = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["input"] for each in summaries] == ["one.obj", "cornell-box", "two.obj"]
    assert (
        [each["output"] for each in summaries]
        == ["one.png", "cornell-box.png", "two.png"]
        == [line.split()[0] for line in result.stderr.splitlines()]
    )
    assert sorted(each["output"] for each in summaries) == written(folder)
    assert summaries[2]["seconds_total"] < summaries[0]["seconds_total"], "time counts from the end of the last input"


def test_an_error_in_one_keeps_none_of_the_others_from_being_rendered(folder: Path) -> None:
    result = run(folder, "render", "absent.obj", "one.obj", "broken.obj", "two.obj", *SMALL, "--quiet")
    assert result.returncode == 2
    assert written(folder) == ["one.png", "two.png"]
    first, second = without_progress(result.stderr).splitlines()
    assert first.startswith("wrt: error: absent.obj: no such file")
    assert second.startswith("wrt: error: broken.obj: ")


def test_errors_name_the_input_and_the_worst_decides(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "pictures" / "two.png").mkdir(parents=True)
    inputs = [str(folder / name) for name in ("one.obj", "two.obj")]
    assert main(["render", *inputs, *SMALL, "--quiet", "--crop", "0,0,9,9", "-o", str(folder)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [re.match(r"wrt: error: (.*?): crop must lie", line)[1] for line in said] == inputs  # type: ignore[index]
    assert main(["render", *inputs, *SMALL, "--quiet", "-o", str(folder / "pictures")]) == 2
    assert written(folder) == ["pictures/one.png", "pictures/two.png"]


@pytest.mark.parametrize("output", ["there", "there/", "new/", "new/deeper/"])
def test_the_output_of_several_is_a_folder(output: str, folder: Path) -> None:
    (folder / "there").mkdir()
    result = run(folder, "render", "one.obj", "two.obj", *SMALL, "-o", output)
    assert result.returncode == 0, result.stderr
    assert written(folder) == [f"{output.rstrip('/')}/{name}.png" for name in ("one", "two")]


def test_a_slash_makes_it_a_folder_for_one_input_too(folder: Path) -> None:
    assert run(folder, "render", "one.obj", *SMALL, "-o", "new/", "--checkpoint", "state").returncode == 0
    assert written(folder) == ["new/one.png"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "x.png"], "x.png: for several inputs, the output must be a folder; end its name with / to create it"),
        (["-o", "new"], "new: for several inputs, the output must be a folder"),
        (["-o", "one.obj/"], "one.obj/: cannot be created: "),
        (["--checkpoint", "state"], "--checkpoint is for a single input"),
        (["one.obj"], "one.obj: given twice"),
    ],
)
def test_what_does_not_go_with_several(
    arguments: list[str], said: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    assert main(["render", "one.obj", "two.obj", *SMALL, *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"wrt: error: {said}")
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("inputs", "outputs"),
    [
        (["one.obj", "two.obj"], ["one.png", "two.png"]),
        (["a/room.obj", "b/room.obj"], ["a-room.png", "b-room.png"]),
        (["room.obj", "x.obj", "room.ply"], ["room-obj.png", "x.png", "room-ply.png"]),
        (["room.obj", "b/room.obj"], ["room.png", "b-room.png"]),
        (["../x/room.obj", "/x/y/room.obj"], ["x-room.png", "x-y-room.png"]),
        (["a/x.obj", "b/x.obj", "a/y.obj", "a/y.ply"], ["a-x.png", "b-x.png", "y-obj.png", "y-ply.png"]),
    ],
)
def test_inputs_that_are_called_alike_get_longer_names(inputs: list[str], outputs: list[str]) -> None:
    assert default_outputs(inputs) == outputs


@pytest.mark.parametrize("inputs", [["x.obj", "./x.obj"], ["a/x.obj", "b/x.obj", "a-x.obj"], ["../x.obj", "/x.obj"]])
def test_what_even_longer_names_do_not_tell_apart_is_refused(inputs: list[str]) -> None:
    with pytest.raises(InputError, match=r"would both be written to .*\.png; render them one at a time"):
        default_outputs(inputs)


def test_longer_names_are_said(folder: Path) -> None:
    result = run(folder, "render", "a/room.obj", "b/room.obj", *SMALL)
    assert written(folder) == ["a-room.png", "b-room.png"]
    said = result.stderr.splitlines()
    assert "wrt: note: a/room.obj: the picture is a-room.png, because another input has the same name" in said
    assert "wrt: note: b/room.obj: the picture is b-room.png, because another input has the same name" in said


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_ends_all(number: signal.Signals, status: int, folder: Path) -> None:
    process = start(
        folder, "render", "one.obj", "two.obj", "a/room.obj", "--size", "8x8", "--time", "1h", "--save-every", "0.2"
    )
    wait_for(folder / "one.png", process)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == status
    first, second = without_progress(said).splitlines()
    assert re.fullmatch(r"wrt: stopped: at \d+(?: to \d+)? samples per pixel; one\.png saved", first)
    assert second == "wrt: stopped: two.obj, a/room.obj: not rendered"
    assert written(folder) == ["one.png"]
