"""What was rendered is saved, whatever goes wrong, and elsewhere if need be."""

from __future__ import annotations

import pytest
from support.outputs import SMALL, contents, run

import wrt


def test_a_file_that_appears_during_the_render_is_kept_and_so_is_the_picture(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    passes = wrt.Renderer.passes

    def interfere(self, **options):
        yield from passes(self, **options)
        (tmp_path / "a.png").write_bytes(b"notes")

    monkeypatch.setattr(wrt.Renderer, "passes", interfere)
    assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 0
    assert sorted(contents(tmp_path)) == ["a-render.png", "a.png"]
    assert (tmp_path / "a.png").read_bytes() == b"notes"


def test_a_checkpoint_that_cannot_be_written_does_not_keep_the_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    passes = wrt.Renderer.passes

    def interfere(self, **options):
        yield from passes(self, **options)
        (tmp_path / "a.ckpt").write_bytes(b"notes")

    monkeypatch.setattr(wrt.Renderer, "passes", interfere)
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 1
    assert "a.ckpt: already exists" in capsys.readouterr().err
    assert (tmp_path / "a.ckpt").read_bytes() == b"notes"
    assert wrt.load_image(tmp_path / "a.png").shape == (8, 8, 3)


def test_a_picture_whose_folder_is_gone_is_written_elsewhere(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    passes = wrt.Renderer.passes

    def interfere(self, **options):
        yield from passes(self, **options)
        (tmp_path / "out").rmdir()

    monkeypatch.setattr(wrt.Renderer, "passes", interfere)
    assert run("render", "cornell-box", "-o", "out/a.png", *SMALL) == 1
    assert "does not exist; make it first; the picture is a.png" in capsys.readouterr().err
    assert sorted(contents(tmp_path)) == ["a.png"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), MemoryError(), RuntimeError("CUDA error")])
def test_an_error_in_a_pass_loses_nothing_that_was_rendered(error, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    passes = wrt.Renderer.passes

    def fail(self, **options):
        yield from passes(self, **options)
        raise error

    monkeypatch.setattr(wrt.Renderer, "passes", fail)
    if isinstance(error, RuntimeError):
        with pytest.raises(RuntimeError, match="CUDA error"):
            run("render", "cornell-box", "-o", "a.png", *SMALL)
    else:
        assert run("render", "cornell-box", "-o", "a.png", *SMALL) == 1
    assert wrt.load_image(tmp_path / "a.png").shape == (8, 8, 3)


def test_a_save_that_fails_meanwhile_is_a_warning(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
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
    assert sorted(contents(tmp_path)) == ["a.ckpt", "a.png"]
