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


def test_a_file_that_appears_during_the_render_is_kept_and_so_is_the_picture(folder, after_passes):
    after_passes(lambda: (folder / "a.png").write_bytes(b"notes"))
    assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 0
    assert sorted(contents(folder)) == ["a-render.png", "a.png"]
    assert (folder / "a.png").read_bytes() == b"notes"


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


FAILURES = {
    "disk": (OSError(28, "No space left on device", "a.tmp"), "a.tmp: No space left on device"),
    "memory": (MemoryError(), "not enough memory"),
    "device": (RuntimeError("CUDA error 700"), "RuntimeError: CUDA error 700 (test_saving.py, line "),
    "fault": (AttributeError("no ncores"), "AttributeError: no ncores (test_saving.py, line "),
    "threads": (RuntimeError("can't start new thread"), "the system allows no more threads or processes (ulimit -u"),
    "input": (wrt.InputError("the workers cannot render this scene"), "the workers cannot render this scene"),
}


@pytest.mark.parametrize("failure", FAILURES)
def test_an_error_in_a_pass_loses_nothing_that_was_rendered(failure, after_passes, capsys):
    error, said = FAILURES[failure]

    def fail():
        raise error

    after_passes(fail)
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"wrt: error: {said}")
    assert err.endswith("; stopped at 1 samples per pixel; a.png and a.ckpt saved\n")
    assert err.count("\n") == 1
    assert wrt.load_image("a.png").shape == (8, 8, 3)
    assert wrt.Renderer.resume("a.ckpt", wrt.load("cornell-box")).spp == 1


def test_an_error_in_a_pass_and_another_in_saving_are_one_line(after_passes, monkeypatch, capsys):
    """As when a GPU is lost, which has the film."""

    def fail(*_, **__):
        raise RuntimeError("CUDA error 700")

    after_passes(fail)
    monkeypatch.setattr(wrt.Renderer, "image", fail)
    assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 1
    err = capsys.readouterr().err
    assert err.count("CUDA error 700") == 2
    assert "; saving the samples so far failed: " in err
    assert err.count("\n") == 1


def test_an_error_before_the_first_sample_is_one_line(folder, monkeypatch, capsys):
    def fail(*_, **__):
        raise RuntimeError("CUDA error 700")

    monkeypatch.setattr("wrt.rendering.render_kernel.RenderKernel.launch", fail)
    assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 1
    err = capsys.readouterr().err
    assert err.startswith("wrt: error: RuntimeError: CUDA error 700 (test_saving.py, line ")
    assert err.count("\n") == 1
    assert not contents(folder)


def test_a_picture_that_cannot_be_denoised_is_saved_with_its_noise(monkeypatch, capsys):
    def fail(*_, **__):
        raise RuntimeError("out of threads")

    monkeypatch.setattr("wrt.develop.denoise.require_denoiser", lambda: None)
    monkeypatch.setattr(wrt.Renderer, "denoised", fail)
    assert run("render", "cornell-box", "-o", "a.png", "--denoise", *SMALL) == 1
    said = capsys.readouterr().err
    assert "wrt: error: a.png: saved with its noise, denoising failed: RuntimeError: out of threads" in said
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
    err = capsys.readouterr().err
    assert err.startswith("wrt: error: AttributeError: no ncores (test_saving.py, line ")
    assert err.count("\n") == 1
    assert [name for name in contents(folder) if name.endswith(".png")] == ["a_0.png"]


def test_an_error_in_a_part_is_one_line(folder, monkeypatch, capsys):
    def fail(*_, **__):
        raise AttributeError("no ncores")

    monkeypatch.setattr("wrt.parts.render.render_windows", fail)
    assert run("render", "cornell-box", "--part", "1/2", "-o", "a.wrt", *SMALL) == 1
    err = capsys.readouterr().err
    assert err.startswith("wrt: error: AttributeError: no ncores (test_saving.py, line ")
    assert err.count("\n") == 1
    assert not contents(folder)


def test_a_save_that_fails_meanwhile_is_a_warning(folder, monkeypatch, capsys):
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


def test_convert_replaces_no_file_without_leave_nor_one_that_it_reads(folder, capsys):
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


def test_an_error_of_the_progress_display_loses_nothing_that_was_rendered(monkeypatch, capsys):
    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("wrt.progress.bar.ProgressBar.update", fail)
    assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 1
    assert capsys.readouterr().err == "wrt: error: Input/output error; stopped at 1 samples per pixel; a.png saved\n"
    assert wrt.load_image("a.png").shape == (8, 8, 3)
