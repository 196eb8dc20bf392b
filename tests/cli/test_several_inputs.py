"""Several inputs of one command: each is rendered even if others fail, and no picture replaces another."""

import json
import re
from pathlib import Path

import pytest
from support.commands import ROOM, SMALL, without_progress

from wrt.cli import main
from wrt.cli.output import default_outputs
from wrt.errors import InputError


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("one.toml", "two.toml", "a/room.toml", "b/room.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(ROOM)
    (tmp_path / "broken.obj").write_text("f 1 2 3\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.png") if path.is_file())


def test_each_gets_its_own_picture_and_line_of_json(folder, capsys):
    assert main(["render", "one.toml", *SMALL, "cornell-box", "--json", "two.toml"]) == 0
    out, err = capsys.readouterr()
    summaries = [json.loads(line) for line in out.splitlines()]
    assert [each["input"] for each in summaries] == ["one.toml", "cornell-box", "two.toml"]
    pictures = ["one.png", "cornell-box.png", "two.png"]
    assert [each["output"] for each in summaries] == pictures
    assert [line.split()[0] for line in without_progress(err).splitlines()] == pictures
    assert written(folder) == sorted(pictures)


def test_errors_name_the_input_the_worst_decides_and_the_others_are_rendered(folder, capsys):
    assert main(["render", "absent.obj", "one.toml", "broken.obj", "two.toml", *SMALL, "--quiet"]) == 2
    assert written(folder) == ["one.png", "two.png"]
    first, second = without_progress(capsys.readouterr().err).splitlines()
    assert first.startswith("wrt: error: absent.obj: no such file")
    assert second.startswith("wrt: error: broken.obj: ")
    (folder / "pictures" / "two.png").mkdir(parents=True)
    assert main(["render", "one.toml", "two.toml", *SMALL, "--quiet", "--crop", "0,0,9,9", "-o", "."]) == 2
    inputs = re.findall(r"^wrt: error: (.*?): crop must lie", capsys.readouterr().err, re.MULTILINE)
    assert inputs == ["one.toml", "two.toml"]
    assert main(["render", "one.toml", "two.toml", *SMALL, "--quiet", "-o", "pictures"]) == 2
    assert written(folder / "pictures") == ["one.png"]


def test_the_output_of_several_is_a_folder_and_a_slash_makes_one(folder):
    (folder / "there").mkdir()
    for output in ("there", "new/deeper/"):
        assert main(["render", "one.toml", "two.toml", *SMALL, "-o", output]) == 0
        assert written(folder / output) == ["one.png", "two.png"]
    assert main(["render", "one.toml", *SMALL, "-o", "single/", "--checkpoint", "state"]) == 0
    assert written(folder / "single") == ["one.png"]


def test_what_does_not_go_with_several(folder, capsys):
    for arguments, printed in (
        (["-o", "x.png"], "x.png: for several inputs, the output must be a folder; end its name with / to create it"),
        (["-o", "one.toml/"], "one.toml/: cannot be created: "),
        (["--checkpoint", "state"], "--checkpoint is for a single input"),
        (["one.toml"], "one.toml: given twice"),
    ):
        before = sorted(folder.rglob("*"))
        assert main(["render", "one.toml", "two.toml", *SMALL, *arguments]) == 2
        assert capsys.readouterr().err.startswith(f"wrt: error: {printed}")
        assert sorted(folder.rglob("*")) == before


def test_inputs_that_are_called_alike_get_longer_names_or_are_refused(folder, capsys):
    for inputs, outputs in (
        ("a/room.obj b/room.obj", "a-room.png b-room.png"),
        ("room.obj x.obj room.ply", "room-obj.png x.png room-ply.png"),
        ("../x/room.obj /x/y/room.obj", "x-room.png x-y-room.png"),
        ("a/x.obj b/x.obj a/y.obj a/y.ply", "a-x.png b-x.png y-obj.png y-ply.png"),
    ):
        assert default_outputs(inputs.split()) == outputs.split()
    with pytest.raises(InputError, match=r"would both be written to .*\.png; render them one at a time"):
        default_outputs(["a/x.obj", "b/x.obj", "a-x.obj"])
    assert main(["render", "a/room.toml", "b/room.toml", *SMALL]) == 0
    assert written(folder) == ["a-room.png", "b-room.png"]
    printed = capsys.readouterr().err.splitlines()
    for name in "ab":
        note = f"{name}/room.toml: the picture is {name}-room.png, because another input has the same name"
        assert f"wrt: note: {note}" in printed
