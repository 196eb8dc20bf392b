"""What was rendered is saved, whatever goes wrong; `wrt convert` leaves whole files or none, and those of others."""

import os
import shutil

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


def fail_with(error):
    def fail(*_, **__):
        raise error

    return fail


def assert_one_error(capsys, beginning):
    err = capsys.readouterr().err
    assert err.startswith(f"wrt: error: {beginning}")
    assert err.count("\n") == 1
    return err


def test_the_picture_is_saved_when_the_checkpoint_cannot_be(folder, after_passes, capsys):
    after_passes(lambda: (folder / "a.ckpt").write_bytes(b"notes"))
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 1
    assert "a.ckpt: already exists" in capsys.readouterr().err
    assert (folder / "a.ckpt").read_bytes() == b"notes"
    assert wrt.load_image("a.png").shape == (8, 8, 3)


def test_a_picture_whose_folder_disappears_is_saved_elsewhere(folder, after_passes, capsys):
    (folder / "out").mkdir()
    after_passes((folder / "out").rmdir)
    assert run("render", "cornell-box", "-o", "out/a.png", *SMALL) == 1
    assert "does not exist; make it first; the picture is a.png" in capsys.readouterr().err
    assert sorted(contents(folder)) == ["a.png"]


FAILURES = {
    "disk": (OSError(28, "No space left on device", "a.tmp"), "a.tmp: No space left on device"),
    "memory": (MemoryError(), "not enough memory"),
    "device": (RuntimeError("CUDA error 700"), "RuntimeError: CUDA error 700 (test_saving.py, line "),
    "fault": (AttributeError("no ncores"), "AttributeError: no ncores (test_saving.py, line "),
    "threads": (RuntimeError("can't start new thread"), "the system allows no more threads or processes (ulimit -u"),
    "input": (wrt.InputError("the workers cannot render this scene"), "the workers cannot render this scene"),
}


@pytest.mark.parametrize("failure", FAILURES)
def test_samples_are_saved_after_an_error_in_a_pass(failure, after_passes, capsys):
    error, message = FAILURES[failure]
    after_passes(fail_with(error))
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 1
    err = assert_one_error(capsys, message)
    assert err.endswith("; stopped at 1 samples per pixel; a.png and a.ckpt saved\n")
    assert wrt.load_image("a.png").shape == (8, 8, 3)
    assert wrt.Renderer.resume("a.ckpt", wrt.load("cornell-box")).spp == 1


@pytest.mark.parametrize(
    ("function", "options"),
    [
        ("wrt.rendering.render_kernel.RenderKernel.launch", ("-o", "a.png")),
        ("wrt.rendering.part.render_part", ("--part", "1/2", "-o", "a.wrt")),
    ],
    ids=["before the first sample", "in a part"],
)
def test_an_error_with_nothing_to_save_is_one_line(function, options, folder, monkeypatch, capsys):
    monkeypatch.setattr(function, fail_with(AttributeError("no ncores")))
    assert run("render", "cornell-box", *options, *SMALL) == 1
    assert_one_error(capsys, "AttributeError: no ncores (test_saving.py, line ")
    assert not contents(folder)


def test_a_picture_that_cannot_be_denoised_is_saved_with_its_noise(monkeypatch, capsys):
    monkeypatch.setattr("wrt.develop.denoise.require_denoiser", lambda: None)
    monkeypatch.setattr(wrt.Renderer, "denoised", fail_with(RuntimeError("out of threads")))
    assert run("render", "cornell-box", "-o", "a.png", "--denoise", *SMALL) == 1
    message = "wrt: error: a.png: saved with its noise, denoising failed: RuntimeError: out of threads"
    assert message in capsys.readouterr().err
    assert wrt.load_image("a.png").shape == (8, 8, 3)


def test_an_error_in_a_frame_is_one_line_and_complete_frames_stay(folder, monkeypatch, capsys):
    passes, begun = wrt.Renderer.passes, []

    def fail_at_third(self, **options):  # the first is for the exposure of all frames
        begun.append(1)
        if len(begun) == 3:
            raise AttributeError("no ncores")
        yield from passes(self, **options)

    monkeypatch.setattr(wrt.Renderer, "passes", fail_at_third)
    assert run("render", "cornell-box", "--turntable", "3", "-o", "a_%d.png", *SMALL) == 1
    assert_one_error(capsys, "AttributeError: no ncores (test_saving.py, line ")
    assert [name for name in contents(folder) if name.endswith(".png")] == ["a_0.png"]


def test_a_failed_intermediate_save_is_a_warning(folder, monkeypatch, capsys):
    save, calls = wrt.Renderer.save_checkpoint, []

    def fail_once(self, path):
        calls.append(path)
        if len(calls) == 1:
            raise OSError(28, "No space left on device")
        save(self, path)

    monkeypatch.setattr(wrt.Renderer, "save_checkpoint", fail_once)
    options = ("--checkpoint", "a.ckpt", "--save-every", "0.001", "--size", "16x16", "--spp", "8")
    assert run("render", "cornell-box", "-o", "a.png", *options) == 0
    assert "a.ckpt: cannot be written: No space left on device; rendering continues" in capsys.readouterr().err
    assert sorted(contents(folder)) == ["a.ckpt", "a.png"]


def test_convert_replaces_files_only_with_force_and_never_its_input(folder, capsys):
    write_obj(folder)
    (folder / "ok.toml").write_text("# by hand\n")
    before = contents(folder)
    assert run("convert", "fuze.obj", "ok.toml") == 2
    assert "ok.toml: already exists; name another file, or replace it by --force" in capsys.readouterr().err
    assert_only_added(before, folder)
    assert run("convert", "fuze.obj", "ok.toml", "--force") == 0
    before = contents(folder)
    for force in ((), ("--force",)):
        assert run("convert", "ok.toml", "ok.toml", *force) == 2
        assert_only_added(before, folder)
    shutil.move("ok.toml", "kept.toml")
    before = contents(folder)
    # The arrays of the scene that was moved are left alone.
    assert run("convert", "fuze.obj", "ok.toml") == 0
    added = set(contents(folder)) - set(before)
    assert_only_added(before, folder, *added)
    assert {name.split("/")[0] for name in added} == {"ok.toml", "ok_files-2"}
    assert wrt.load("ok.toml").shapes
    assert wrt.load("kept.toml").shapes


def test_a_conversion_that_fails_or_is_interrupted_leaves_what_there_was(folder, monkeypatch):
    scene = wrt.load("cornell-box")
    scene.add(CUBE, material=type("Own", (wrt.Diffuse,), {"type_name": "own"})())
    with pytest.raises(wrt.InputError, match="Own: a scene file holds only what is registered"):
        wrt.save_scene("a.toml", scene)
    assert os.listdir(folder) == []
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
    assert contents(folder) == before
    wrt.load("a.toml")
