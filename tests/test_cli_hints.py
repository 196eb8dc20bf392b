"""Who mistypes a word is told the one that was meant: commands, options, and names that options take."""

from __future__ import annotations

from pathlib import Path

import pytest

import wrt
from wrt.cli import main


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("cornel-box", "cornell-box"),
        ("bunyn.obj", "bunny.obj"),
        ("bunny.opj", "bunny.obj"),
        ("rooms/kitchn.toml", "kitchen.toml"),
        ("cornell-box.png", "cornell-box"),
    ],
)
def test_a_file_or_scene_that_nearly_has_the_name(
    name: str, meant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bunny.obj").write_text("")
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


@pytest.mark.parametrize(
    ("option", "value", "meant"),
    [
        ("--integrator", "pth", "path"),
        ("--sampler", "sobl", "sobol"),
        ("--device", "cdua", "cuda"),
        ("--device", "cuda0", "cuda:0"),
        ("--layers", "albedo,nromal", "normal"),
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
