"""Errors suggest the right word for mistyped commands, options and names that options take."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

import wrt
from wrt.cli import main
from wrt.cli.arguments.options import parse


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("cornel-box", "cornell-box"),
        ("bunyn.obj", "bunny.obj"),
        ("bunny.opj", "bunny.obj"),
        ("rooms/kitchn.toml", "kitchen.toml"),
        ("cornell-box.png", "cornell-box"),
        ("BUNNY.obj", "bunny.obj"),
        ("LAMP.GLB", "lamp.glb"),
        ("bunny", "bunny.obj"),
    ],
)
def test_a_file_or_scene_that_nearly_has_the_name(
    name: str, meant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for file in ("bunny.obj", "lamp1.glb", "LAMP.OBJ", "lamp.glb"):
        (tmp_path / file).write_text("")
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms" / "kitchen.toml").write_text("")
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(name)
    assert str(caught.value).startswith(f"{name}: no such file")
    assert str(caught.value).endswith(f" (did you mean {meant!r}?)")


def test_nothing_is_hinted_at_where_nothing_is_near(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(wrt.InputError, match=r"^xyzzy\.obj: no such file$"):
        wrt.load("xyzzy.obj")
    with pytest.raises(wrt.InputError, match=r"^none/bunny\.obj: no such file$"):
        wrt.load("none/bunny.obj")


def test_what_is_no_file_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link.obj").symlink_to("gone.obj")
    for name, said in (
        ("https://example.org/lamp.glb", "https://example.org/lamp.glb: no such file; download it first"),
        ("-", "-: no such file; standard input is not read"),
        ("link.obj", "link.obj: is a link to 'gone.obj', which is not there"),
    ):
        with pytest.raises(wrt.InputError) as caught:
            wrt.load(name)
        assert str(caught.value) == said


@pytest.mark.parametrize(
    ("option", "value", "meant"),
    [
        ("--integrator", "pth", "path"),
        ("--sampler", "sobl", "sobol"),
        ("--device", "cdua", "cuda"),
        ("--device", "cuda0", "cuda:0"),
        ("--layers", "albedo,nromal", "normal"),
        ("--material", "steel", "stainless-steel"),
    ],
)
def test_a_name_that_an_option_takes(
    option: str,
    value: str,
    meant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["render", "cornell-box", "--size", "4x4", option, value]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"(did you mean {meant!r}?)" in said


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("rendr x", "there is no command 'rendr' (did you mean 'render'?)"),
        ("Render x", "there is no command 'Render' (did you mean 'render'?)"),
        ("matrials", "there is no command 'matrials' (did you mean 'materials'?)"),
        ("cornel-box", "there is no command 'cornel-box' (did you mean 'render cornell-box'?)"),
        ("teapot --spp 4", "'teapot' is not a command; to render it, type: wrt render teapot --spp 4"),
        ("bunny.obj --size 8x8", "'bunny.obj' is not a command; to render it, type: wrt render bunny.obj --size 8x8"),
        ("'my bunny.obj'", "'my bunny.obj' is not a command; to render it, type: wrt render 'my bunny.obj'"),
        ("--spp 4 bunny.obj", "--spp goes after a command, such as: wrt render ... --spp 4"),
        ("--vers", "there is no option --vers (see 'wrt --help')"),
        ("render x --ssp 4", "there is no option --ssp (did you mean '--spp'?)"),
        ("render --ssp=4 x", "there is no option --ssp (did you mean '--spp'?)"),
        ("render x --max_depth 4", "there is no option --max_depth (did you mean '--max-depth'?)"),
        ("render x --SIZE 4x4", "there is no option --SIZE (did you mean '--size'?)"),
        ("render x --samples 4", "there is no option --samples (did you mean '--spp'?)"),
        ("render x --width=40", "there is no option --width (did you mean '--size'?)"),
        ("info x --samples=4", "there is no option --samples (see 'wrt info --help')"),
        ("render -x.obj", "'-x.obj' begins like an option; to name the file, type ./-x.obj"),
        ("render y.obj -x.obj", "'-x.obj' begins like an option; to name the file, type ./-x.obj"),
        ("info -x.obj", "'-x.obj' begins like an option; to name the file, type ./-x.obj"),
        ("render x --xyzzy", "there is no option --xyzzy (see 'wrt render --help')"),
        ("info x --upp z", "there is no option --upp (see 'wrt info --help')"),
        ("info x y", "unexpected argument 'y' (see 'wrt info --help')"),
        ("completion bsh", "argument SHELL: must be one of bash, zsh, fish, not 'bsh' (did you mean 'bash'?)"),
        ("render x -o a.png -o b.png", "argument -o/--output: given twice, as 'a.png' and as 'b.png'"),
        ("render x --checkpoint a --checkpoint a", "argument --checkpoint: given twice, as 'a' and as 'a'"),
        ("materials difuse", "there is no material 'difuse' (did you mean 'diffuse'?)"),
    ],
)
def test_commands_and_options(
    typed: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-x.obj").write_text("")
    assert main(shlex.split(typed)) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"wrt: error: {said}")
    assert error.count("\n") == 1


def test_of_other_options_the_last_one_wins() -> None:
    options = parse(["render", "x", "--spp", "4", "--time", "1m", "--spp", "8", "--size", "4x4", "--size", "720p"])
    assert (options.spp, options.time, options.size) == (8, 60.0, (1280, 720))
