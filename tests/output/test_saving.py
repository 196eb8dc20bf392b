"""What was rendered is saved, whatever goes wrong; `wrt convert` leaves whole files or none, and those of others."""

import os
import shutil
from contextlib import nullcontext

import pytest
from support.outputs import CUBE, SMALL, assert_only_added, contents, run, write_obj

import wrt


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def after_passes(monkeypatch):
    """Return a function that has something happen after the passes of a render."""
    passes = wrt.Renderer.passes

    def set_event(event):
        def interfere(self, **options):
            yield from passes(self, **options)
            event()

        monkeypatch.setattr(wrt.Renderer, "passes", interfere)

    return set_event


def test_a_checkpoint_that_cannot_be_written_does_not_keep_the_picture(folder, after_passes, capsys):
    after_passes(lambda: (folder / "a.ckpt").write_bytes(b"notes"))
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 1
    assert "a.ckpt: already exists" in capsys.readouterr().err
    assert (folder / "a.ckpt").read_bytes() == b"notes"
    assert wrt.load_image("a.png").shape == (8, 8, 3)


def test_a_picture_whose_folder_is_gone_is_written_elsewhere(folder, after_passes, capsys):
    (folder / "out").mkdir()
    after_passes((folder / "out").rmdir)
    assert run("render", "cornell-box", "-o", "out/a.png", *SMALL) == 1
    assert "does not exist; make it first; the picture is a.png" in capsys.readouterr().err
    assert sorted(contents(folder)) == ["a.png"]


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("CUDA error")])
def test_an_error_in_a_pass_loses_nothing_that_was_rendered(error, after_passes):
    def fail():
        raise error

    after_passes(fail)
    with pytest.raises(RuntimeError, match="CUDA error") if isinstance(error, RuntimeError) else nullcontext():
        assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 1
    assert wrt.load_image("a.png").shape == (8, 8, 3)


def test_convert_replaces_no_file_without_leave_nor_one_that_it_reads(folder, capsys):
    write_obj(folder)
    (folder / "ok.toml").write_text("# by hand\n")
    before = contents(folder)
    assert run("convert", "fuze.obj", "ok.toml") == 2
    assert "ok.toml: already exists; name another file, or replace it by --force" in capsys.readouterr().err
    assert_only_added(before, folder)
    assert run("convert", "fuze.obj", "ok.toml", "--force") == 0
    before = contents(folder)
    assert run("convert", "ok.toml", "ok.toml", "--force") == 2
    assert_only_added(before, folder)
    shutil.move("ok.toml", "kept.toml")
    # The arrays of the scene that was moved are left alone.
    assert run("convert", "fuze.obj", "ok.toml") == 0
    assert {name.split("/")[0] for name in set(contents(folder)) - set(before)} == {"kept.toml", "ok_files-2"}
    assert wrt.load("kept.toml").shapes


def test_a_conversion_that_replaces_another_leaves_that_whole_until_its_end(folder, monkeypatch):
    write_obj(folder)
    assert run("convert", "cornell-box", "a.toml") == 0
    (folder / "a_files" / "notes.txt").write_text("mine")
    before = contents(folder)

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("wrt.io.toml.writer._write_text", interrupted)
        with pytest.raises(KeyboardInterrupt):
            wrt.save_scene("a.toml", wrt.load("fuze.obj"), force=True)
    assert {name: contents(folder)[name] for name in before} == before
    wrt.load("a.toml")


def test_a_conversion_that_fails_leaves_nothing(folder):
    scene = wrt.load("cornell-box")
    scene.add(CUBE, material=type("Own", (wrt.Diffuse,), {"type_name": "own"})())
    with pytest.raises(wrt.InputError, match="cannot hold materials of one's own"):
        wrt.save_scene("a.toml", scene)
    assert os.listdir(folder) == []
