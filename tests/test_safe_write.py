"""wrt never replaces a file that it has read, or a file that it did not write."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.outputs import SMALL, assert_only_added, contents, run, write_obj

import wrt
from wrt.io.images import save_image


def test_the_default_name_steps_aside_for_a_texture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    before = contents(tmp_path)
    assert run("render", "fuze.obj", *SMALL[:-1]) == 0
    assert_only_added(before, tmp_path, "fuze-render.png")
    assert "fuze.png must not be overwritten; the picture will be fuze-render.png" in capsys.readouterr().err
    # A second render replaces the first one's picture.
    assert run("render", "fuze.obj", *SMALL) == 0
    assert_only_added(before, tmp_path, "fuze-render.png")


def test_a_texture_that_wrt_rendered_is_one_all_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    (tmp_path / "fuze.png").unlink()
    script = "import sys, wrt, numpy; wrt.save_image('fuze.png', numpy.full((4, 4, 3), 0.5))"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=tmp_path)
    before = contents(tmp_path)
    assert run("render", "fuze.obj", *SMALL) == 0
    assert_only_added(before, tmp_path, "fuze-render.png")
    assert run("render", "fuze.obj", "-o", "fuze.png", "--force", *SMALL) == 2
    assert_only_added(before, tmp_path, "fuze-render.png")


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["", "force"])
@pytest.mark.parametrize("name", ["env.exr", "link.exr", "hard.exr", "sub/../env.exr"])
def test_the_environment_is_not_replaced_under_any_name(name, force, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    script = "import wrt, numpy; wrt.save_image('env.exr', numpy.full((4, 8, 3), 0.5))"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=tmp_path)
    os.symlink("env.exr", tmp_path / "link.exr")
    os.link(tmp_path / "env.exr", tmp_path / "hard.exr")
    (tmp_path / "a.toml").write_text('[environment]\ntype = "image"\nfile = "env.exr"\n[[shapes]]\ntype = "box"\n')
    before = contents(tmp_path)
    assert run("render", "a.toml", "-o", name, *SMALL, *force) == 2
    assert f"{name}: would replace a file that was read" in capsys.readouterr().err
    assert_only_added(before, tmp_path)


def test_python_keeps_to_the_rule_as_well(tmp_path):
    mesh = write_obj(tmp_path)
    before = contents(tmp_path)
    with pytest.raises(wrt.InputError, match="would replace a file that was read"):
        wrt.save_image(tmp_path / "fuze.png", wrt.render(mesh, width=8, height=8, spp=1))
    renderer = wrt.Renderer(wrt.load(mesh), width=8, height=8)
    with pytest.raises(wrt.InputError, match="would replace a file that was read"):
        renderer.save(tmp_path / "fuze.png", force=True)
    with pytest.raises(wrt.InputError, match="would replace a file that was read"):
        renderer.save_checkpoint(mesh)
    assert_only_added(before, tmp_path)


def test_what_was_read_and_written_anew_may_be_written_again(tmp_path):
    save_image(tmp_path / "a.npy", np.zeros((2, 2, 3)))
    (tmp_path / "a.npy").rename(tmp_path / "b.npy")
    wrt.load_image(tmp_path / "b.npy")
    (tmp_path / "b.npy").unlink()
    save_image(tmp_path / "b.npy", np.ones((2, 2, 3)))  # it is gone, so nothing is lost
    save_image(tmp_path / "b.npy", np.zeros((2, 2, 3)))
    assert wrt.load_image(tmp_path / "b.npy").max() == 0.0


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_a_picture_replaces_a_picture_of_wrt_alone(suffix, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = f"a{suffix}"
    for _ in range(2):  # by another process: pictures are recognized by their metadata
        script = f"import wrt.cli, sys; sys.exit(wrt.cli.main(['render', 'cornell-box', '-o', {name!r}, *{SMALL!r}]))"
        assert subprocess.run([sys.executable, "-c", script], cwd=tmp_path).returncode == 0
    foreign = {
        ".png": lambda: Image.new("RGB", (4, 4)).save(name),
        ".exr": lambda: Path(name).write_bytes(b"v/1\x01 somebody else's"),
        ".npy": lambda: np.save(name, np.zeros((4, 4, 3), np.float32)),
    }
    foreign[suffix]()
    before = contents(tmp_path)
    assert run("render", "cornell-box", "-o", name, *SMALL) == 2
    assert f"{name}: already exists and is not a picture that wrt has made" in capsys.readouterr().err
    assert_only_added(before, tmp_path)
    assert run("render", "cornell-box", "-o", name, *SMALL, "--force") == 0
    assert contents(tmp_path) != before


def test_the_default_name_steps_aside_for_what_wrt_has_not_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (4, 4)).save("cornell-box.png")
    (tmp_path / "cornell-box-render.png").write_bytes(b"notes")
    before = contents(tmp_path)
    assert run("render", "cornell-box", *SMALL, "--force") == 0
    assert_only_added(before, tmp_path, "cornell-box-render-2.png")


@pytest.mark.parametrize("content", [b"v 0 0 0\n", b"PK\3\4 an archive", None], ids=["text", "zip", "npz"])
def test_a_checkpoint_replaces_a_checkpoint_alone(content, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = ("render", "cornell-box", "--checkpoint", "a.ckpt", "-o", "a.png", *SMALL)
    assert run(*options) == 0
    assert run(*options) == 0
    if content is None:
        with open("a.ckpt", "wb") as file:
            np.savez(file, header=np.zeros(3))
    else:
        (tmp_path / "a.ckpt").write_bytes(content)
    before = contents(tmp_path)
    for force in ((), ("--force",)):
        assert run(*options, *force) == 2
        assert "a.ckpt: already exists and is not a checkpoint; name another file" in capsys.readouterr().err
        assert_only_added(before, tmp_path)


def test_a_planted_fault_is_noticed(tmp_path, monkeypatch):
    """Without the rules the texture is replaced: these tests would notice."""
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    before = contents(tmp_path)
    monkeypatch.setattr("wrt.io.safe_write._target", lambda path, kind, force: Path(os.path.realpath(path)))
    assert run("render", "fuze.obj", *SMALL) == 0
    with pytest.raises(AssertionError):
        assert_only_added(before, tmp_path)


def test_pictures_of_several_inputs_step_aside_for_files_and_for_one_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(write_obj(tmp_path), tmp_path / "fuze-render.obj")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fuze.png").write_bytes(b"notes")
    before = contents(tmp_path)
    assert run("render", "fuze.obj", "fuze-render.obj", *SMALL) == 0
    assert_only_added(before, tmp_path, "fuze-render.png", "fuze-render-render.png")
    before = contents(tmp_path)
    assert run("render", "fuze.obj", "fuze-render.obj", "-o", "out/", *SMALL) == 0
    assert_only_added(before, tmp_path, "out/fuze-render.png", "out/fuze-render-render.png")
    assert run("render", "fuze.obj", "-o", "out/", "--force", *SMALL) == 0
    assert (tmp_path / "out" / "fuze.png").read_bytes() != b"notes"


def test_one_kind_of_output_does_not_replace_another(tmp_path):
    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=8)
    list(renderer.passes(spp=1))
    renderer.save(tmp_path / "a.npy")
    with pytest.raises(wrt.InputError, match="already exists and is not a checkpoint"):
        renderer.save_checkpoint(tmp_path / "a.npy")


def test_an_empty_file_is_no_loss(tmp_path):
    (tmp_path / "a.png").touch()
    save_image(tmp_path / "a.png", np.zeros((2, 2, 3)))
