"""`wrt convert` replaces no files of others, and leaves whole files or none."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest
from support.outputs import CUBE, assert_only_added, contents, run, write_obj

import wrt


def test_convert_replaces_nothing_without_leave(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    (tmp_path / "fuze.toml").write_text("# by hand\n")
    before = contents(tmp_path)
    assert run("convert", "fuze.obj", "fuze.toml") == 2
    assert "fuze.toml: already exists; name another file, or replace it by --force" in capsys.readouterr().err
    assert_only_added(before, tmp_path)
    assert run("convert", "fuze.obj", "fuze.toml", "--force") == 0
    after = contents(tmp_path)
    assert after["fuze.toml"] != before["fuze.toml"]
    wrt.load("fuze.toml")


def test_convert_replaces_no_folder_and_no_scene_that_it_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    assert run("convert", "fuze.obj", "ok.toml") == 0
    before = contents(tmp_path)
    for force in ((), ("--force",)):
        assert run("convert", "ok.toml", "ok.toml", *force) == 2
        assert_only_added(before, tmp_path)
    shutil.copy("ok.toml", "kept.toml")
    (tmp_path / "ok.toml").unlink()
    before = contents(tmp_path)
    # The arrays of the scene that was copied are left alone.
    assert run("convert", "fuze.obj", "ok.toml") == 0
    added = set(contents(tmp_path)) - set(before)
    assert_only_added(before, tmp_path, *added)
    assert {name.split("/")[0] for name in added} == {"ok.toml", "ok_files-2"}
    assert wrt.load("ok.toml").shapes


def test_a_conversion_that_replaces_another_leaves_that_whole_until_its_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    assert run("convert", "cornell-box", "a.toml") == 0
    (tmp_path / "a_files" / "notes.txt").write_text("mine")
    before = contents(tmp_path)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("wrt.io.toml.writer._write_text", interrupted)
        with pytest.raises(KeyboardInterrupt):
            wrt.save_scene("a.toml", wrt.load("fuze.obj"), force=True)
    assert {name: contents(tmp_path)[name] for name in before} == before
    wrt.load("a.toml")
    script = "import wrt; wrt.save_scene('a.toml', wrt.load('fuze.obj'), force=True)"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=tmp_path)
    assert sorted(os.listdir(tmp_path / "a_files")) == ["notes.txt"]
    assert wrt.load("a.toml").shapes


def test_a_conversion_that_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = wrt.load("cornell-box")

    class Own(wrt.Diffuse):
        type_name = "own"

    scene.add(CUBE, material=Own())
    with pytest.raises(wrt.InputError, match="cannot hold materials of one's own"):
        wrt.save_scene("a.toml", scene)
    assert contents(tmp_path) == {}
    assert os.listdir(tmp_path) == []
