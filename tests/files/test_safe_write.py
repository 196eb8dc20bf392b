"""wrt replaces no file that it has read or did not write; it writes files whole, and never into devices and pipes."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.outputs import SMALL, assert_only_added, contents, run, write_obj

import wrt
from wrt.io.images import PICTURE, save_image
from wrt.io.safe_write import write_atomically
from wrt.rendering.picture import Picture
from wrt.rendering.render_kernel import RenderKernel

pytestmark = pytest.mark.filterwarnings("ignore:the picture is black")

SAVE = """import sys, wrt, numpy
names = {"Objects": "name" * 20_000}  # comes before the name of wrt in an OpenEXR file
wrt.save_image(sys.argv[1], numpy.full((4, 8, 3), 0.5), metadata=names)"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Renders trace nothing, so their pictures are black."""
    monkeypatch.setattr(RenderKernel, "to_compile", lambda _: [])
    monkeypatch.setattr(RenderKernel, "launch", lambda *_: None)
    monkeypatch.setattr(Picture, "_require_samples", lambda _: None)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def save_elsewhere(name: str) -> None:
    """Save a picture in another process: files that this one has written may be replaced."""
    subprocess.run([sys.executable, "-c", SAVE, name], check=True)


def check_refused(message: str, folder: Path, capsys: pytest.CaptureFixture[str], *command: str) -> None:
    """Check that a command says why it ends, and writes nothing; with --force neither."""
    before = contents(folder)
    for force in ((), ("--force",)):
        assert run(*command, *force) == 2
        assert message in capsys.readouterr().err
        assert_only_added(before, folder)


def test_an_input_is_not_replaced_under_any_name_unless_it_is_empty_or_gone(folder, capsys):
    (folder / "sub").mkdir()
    save_elsewhere("env.exr")
    os.symlink("env.exr", "link.exr")
    os.link("env.exr", "hard.exr")
    (folder / "a.toml").write_text('[environment]\ntype = "image"\nfile = "env.exr"\n[[shapes]]\ntype = "box"\n')
    for name in ("env.exr", "link.exr", "hard.exr", "sub/../env.exr"):
        message = f"{name}: would replace a file that was read"
        check_refused(message, folder, capsys, "render", "a.toml", "-o", name, *SMALL)
    np.save("a.npy", np.zeros((2, 2, 3), np.float32))
    wrt.load_image("a.npy")
    Path("a.npy").unlink()
    Path("a.png").touch()
    for name in ("a.npy", "a.png"):
        save_image(name, np.ones((2, 2, 3)))


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_pictures_replace_only_pictures_of_wrt(suffix, folder, capsys):
    name = f"a{suffix}"
    save_elsewhere(name)  # pictures are recognized by their metadata
    assert run("render", "cornell-box", "-o", name, *SMALL) == 0
    foreign = {
        ".png": lambda: Image.new("RGB", (4, 4)).save(name),
        ".exr": lambda: Path(name).write_bytes(b"v/1\x01 somebody else's"),
        ".npy": lambda: np.save(name, np.zeros((4, 4, 3), np.float32)),
    }
    foreign[suffix]()
    before = contents(folder)
    assert run("render", "cornell-box", "-o", name, *SMALL) == 2
    assert f"{name}: already exists and is not a picture that wrt has made" in capsys.readouterr().err
    assert_only_added(before, folder)
    assert run("render", "cornell-box", "-o", name, *SMALL, "--force") == 0
    assert contents(folder) != before


def test_default_names_step_aside_for_files_and_for_one_another(folder, capsys):
    Image.new("RGB", (4, 4)).save("cornell-box.png")
    Path("cornell-box-render.png").write_bytes(b"notes")
    shutil.copy(write_obj(folder), "fuze-render.obj")
    before = contents(folder)
    assert run("render", "cornell-box", *SMALL, "--force") == 0
    for _ in range(2):  # the second pictures replace the first ones; fuze.png is a texture
        assert run("render", "fuze.obj", "fuze-render.obj", *SMALL[:-1]) == 0
        added = ("cornell-box-render-2.png", "fuze-render.png", "fuze-render-render.png")
        assert_only_added(before, folder, *added)
    assert "fuze.png must not be overwritten; the picture will be fuze-render.png" in capsys.readouterr().err


def test_checkpoints_replace_only_checkpoints(folder, capsys):
    options = ("render", "cornell-box", "--checkpoint", "a.ckpt", "-o", "a.png", *SMALL)
    assert run(*options) == 0
    assert run(*options) == 0
    np.savez("a.npz", header=np.zeros(3))
    for content in (b"v 0 0 0\n", Path("a.npz").read_bytes()):
        Path("a.ckpt").write_bytes(content)
        check_refused("a.ckpt: already exists and is not a checkpoint; name another file", folder, capsys, *options)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to(path.name)])
def test_pipes_folders_and_circular_links_are_refused_everywhere(make, folder, capsys):
    write_obj(folder)
    for name in ("a.png", "a.npy", "a.toml", "a.ckpt", "fuze-render.png"):
        make(folder / name)
    (folder / "link.png").symlink_to("a.png")

    def modes():
        return sorted((path.name, path.lstat().st_mode) for path in folder.iterdir())

    before = modes()
    render = ("render", "fuze.obj", *SMALL, "-o")
    commands = [(*render, name, *force) for name in ("a.png", "a.npy", "link.png") for force in ((), ("--force",))]
    commands += [(*render, "b.png", "--checkpoint", "a.ckpt"), (*render, "b.png", "--checkpoint", "a.ckpt", "--resume")]
    commands += [("convert", "fuze.obj", "a.toml"), ("render", "a.toml", "-o", "b.png"), ("info", "a.toml")]
    for command in commands:
        assert run(*command) == 2, command
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert error.startswith(("wrt: error: a.", "wrt: error: link.")), error
        assert modes() == before


def test_files_are_flushed_before_they_are_renamed(folder, monkeypatch):
    done, fsync, replace = [], os.fsync, Path.replace

    def flush(handle):
        fsync(handle)
        done.append(os.readlink(f"/proc/self/fd/{handle}"))

    def rename(self, target):
        done.append((str(self), str(target)))
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", flush)
    monkeypatch.setattr(Path, "replace", rename)
    wrt.save_image("a.png", np.ones((2, 2, 3), np.float32))
    flushed, (temporary, place) = done
    assert flushed == temporary
    assert place == str(folder / "a.png")
    assert Path(temporary).parent == folder
    assert sorted(path.name for path in folder.iterdir()) == ["a.png"]


def test_links_are_followed_permissions_kept_and_a_write_protected_file_left_alone(folder, capsys):
    (folder / "disk").mkdir()
    names = ("a.ckpt", "a.png", "a.toml")
    for name in names:
        (folder / name).symlink_to(f"disk/{name}")
    assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 0
    assert run("convert", "cornell-box", "a.toml") == 0
    assert sorted(os.listdir(folder / "disk")) == list(names)
    assert all((folder / name).is_symlink() for name in names)
    (folder / "plain").touch()
    save_image("a.png", np.zeros((2, 2, 3)))
    assert (folder / "a.png").stat().st_mode == (folder / "plain").stat().st_mode
    (folder / "a.png").chmod(0o640)
    save_image("a.png", np.ones((2, 2, 3)))
    assert stat.S_IMODE((folder / "a.png").stat().st_mode) == 0o640
    (folder / "a.png").chmod(0o444)
    check_refused("a.png: is write-protected", folder, capsys, "render", "cornell-box", "-o", "a.png", *SMALL)


WRITING = """
import sys, time
from pathlib import Path
from wrt.io.images import PICTURE
from wrt.io.safe_write import write_atomically

def write(temporary):
    temporary.write_bytes(b"half")
    print("writing", flush=True)
    time.sleep(60)

write_atomically(Path(sys.argv[1]), write, PICTURE)
"""


def test_leftovers_of_killed_writes_are_removed_and_no_others(folder):
    (folder / ".wrt-notes.part").write_text("mine")
    command = [sys.executable, "-c", WRITING, "a.png"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE) as killed,
        subprocess.Popen(command, stdout=subprocess.PIPE) as living,
    ):
        for process in (killed, living):
            assert process.stdout.readline() == b"writing\n"
        killed.kill()
        killed.wait()
        assert len(list(folder.glob(".wrt-????????-????????.part.png"))) == 2
        write_atomically(folder / "b.png", lambda file: file.write_bytes(b"whole"), PICTURE)
        remaining = [path.name for path in folder.glob(".wrt-*.part*")]
        living.kill()
    assert len(remaining) == 2  # the file that is still being written, and the file that is not wrt's
    assert ".wrt-notes.part" in remaining
    assert (folder / "b.png").read_bytes() == b"whole"
