"""Times, sizes and options as people write them; errors name the right form and suggest the likely word."""

import argparse
import re
import shlex

import pytest

import wrt
from wrt.cli import main
from wrt.cli.arguments.options import parse
from wrt.cli.arguments.types import duration, size, whole

TIMES = {"90": 90, ".5": 0.5, "1e3": 1000, "90 s": 90, "2.5sec": 2.5, "1M": 60, "1.5min": 90, "1m 30s": 90}
TIMES |= {"1h30m5s": 5405, "1h5s": 3605, "2 hours": 7200, "1:30": 90, "0:05.5": 5.5, "90:00": 5400, "1:02:03": 3723}
NO_TIMES = ("", " ", "s", "1x", "1d", "1h30", "1m1h", "1s1s", "-1m", "1m-5s")
NO_TIMES += ("1:2", "1:60", ":30", "1:", "1:2:03", "1:30s")
SIZES = dict.fromkeys(("640x480", "640X480", "640×480", "640*480", "640,480", "640 x 480"), (640, 480))
SIZES |= {"720p": (1280, 720), "1080P": (1920, 1080), "4K": (3840, 2160)}
NO_SIZES = {
    "640": "must have a width and a height, such as 640x640, not '640'",
    "big": "must be WIDTHxHEIGHT, such as 640x480, or one of 720p, 1080p,",
    "640x": "must be a whole number in digits, not ''",
    "6.5x4": "must be a whole number in digits, not '6.5'",
    "-4x4": "must be at least 1, not -4",
}


def test_times_and_sizes_and_what_is_none():
    assert {text: duration(text) for text in TIMES} == TIMES
    assert {text: size(text) for text in SIZES} == SIZES
    for text in NO_TIMES:
        message = f"must be a time such as 90, 90s, 1m30s or 1:30, not {text!r}"
        with pytest.raises(argparse.ArgumentTypeError, match=re.escape(message)):
            duration(text)
    for text in ("0", "-1", "0m0s", "0:00", "nan", "inf", "1e999"):
        with pytest.raises(argparse.ArgumentTypeError, match=r"greater than 0|finite"):
            duration(text)
    for text, message in NO_SIZES.items():
        with pytest.raises(argparse.ArgumentTypeError, match=re.escape(message)):
            size(text)
    with pytest.raises(argparse.ArgumentTypeError, match="must be a whole number in digits, not '1k'"):
        whole(1)("1k")  # 1000, or 1024?


def test_an_output_given_twice_is_an_error_and_of_other_options_the_last_one_wins():
    options = parse(["render", "x", "--spp", "4", "--time", "1m", "--spp", "8", "--size", "4x4", "--size", "720p"])
    assert (options.spp, options.time, options.size) == (8, 60.0, (1280, 720))
    with pytest.raises(wrt.InputError, match=r"--checkpoint: given twice, as 'a' and as 'a'"):
        parse(["render", "x", "--checkpoint", "a", "--checkpoint", "a"])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rooms").mkdir()
    for file in ("bunny.obj", "lamp1.glb", "LAMP.OBJ", "lamp.glb", "rooms/kitchen.toml", "-x.obj"):
        (tmp_path / file).write_text("")
    (tmp_path / "link.obj").symlink_to("gone.obj")
    return tmp_path


MEANT = {"cornel-box": "cornell-box", "bunyn.obj": "bunny.obj", "bunny.opj": "bunny.obj", "bunny": "bunny.obj"}
MEANT |= {"rooms/kitchn.toml": "kitchen.toml", "cornell-box.png": "cornell-box", "LAMP.GLB": "lamp.glb"}
ABSENT = {name: f"{name}: no such file (did you mean {meant!r}?)" for name, meant in MEANT.items()} | {
    "xyzzy.obj": "xyzzy.obj: no such file",
    "none/bunny.obj": "none/bunny.obj: no such file",
    "https://example.org/lamp.glb": "https://example.org/lamp.glb: no such file; download it first, and name the file",
    "-": "-: no such file; standard input is not read",
    "link.obj": "link.obj: is a link to 'gone.obj', which is not there",
}


@pytest.mark.parametrize("name", ABSENT)
def test_a_file_that_is_not_there(name, folder):
    start, _, end = ABSENT[name].partition(" (")  # between both stands what kinds of names there are
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(name)
    assert str(caught.value).startswith(start)
    assert str(caught.value).endswith(end)
    assert name in MEANT or str(caught.value) == start


TYPED = {
    "rendr x": "there is no command 'rendr' (did you mean 'render'?)",
    "cornel-box": "there is no command 'cornel-box' (did you mean 'render cornell-box'?)",
    "'my bunny.obj'": "'my bunny.obj' is not a command; to render it, type: wrt render 'my bunny.obj'",
    "--spp 4 bunny.obj": "--spp goes after a command, such as: wrt render ... --spp 4",
    "render --ssp=4 x": "there is no option --ssp (did you mean '--spp'?)",
    "render x --samples 4": "there is no option --samples (did you mean '--spp'?)",
    "render x --width=40": "there is no option --width (did you mean '--size'?)",
    "render y.obj -x.obj": "'-x.obj' begins like an option; to name the file, type ./-x.obj",
    "render x --xyzzy": "there is no option --xyzzy (see 'wrt render --help')",
    "convert x y z": "unexpected argument 'z' (see 'wrt convert --help')",
    "completion bsh": "argument SHELL: must be one of bash, zsh, fish, not 'bsh' (did you mean 'bash'?)",
    "render x -o a.png -o b.png": "argument -o/--output: given twice, as 'a.png' and as 'b.png'",
    "materials difuse": "there is no material 'difuse' (did you mean 'diffuse'?)",
}
NAMES = {"integrator pth": "path", "sampler sobl": "sobol", "device cdua": "cuda", "device cuda0": "cuda:0"}
NAMES |= {"layers albedo,nromal": "normal", "material steel": "stainless-steel"}
TYPED |= {f"render cornell-box --size 4x4 --{each}": f"(did you mean {meant!r}?)" for each, meant in NAMES.items()}


@pytest.mark.parametrize("typed", TYPED)
def test_a_mistyped_command_option_or_name(typed, folder, capsys):
    assert main(shlex.split(typed)) == 2
    error = capsys.readouterr().err
    assert error.startswith("wrt: error: ")
    assert TYPED[typed] in error
    assert error.count("\n") == 1
