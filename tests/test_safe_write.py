"""wrt never replaces a file that it has read, a file that it did not write, or anything but a regular file."""

from __future__ import annotations

import os
import shutil
import socket
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import wrt
from wrt.cli import main
from wrt.formats.images import PICTURE, save_image
from wrt.safe_write import write_whole

CUBE = wrt.box((-1, -1, -1), (1, 1, 1))
SMALL = ("--size", "8x8", "--spp", "1", "--quiet")


def write_obj(folder: Path, texture: str = "fuze.png") -> Path:
    """Write a textured triangle as an OBJ file with its material and its image."""
    (folder / "fuze.obj").write_text(
        "mtllib fuze.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    )
    (folder / "fuze.mtl").write_text(f"newmtl a\nmap_Kd {texture}\n")
    Image.new("RGB", (4, 4), (200, 100, 50)).save(folder / texture)
    return folder / "fuze.obj"


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_only_added(before: dict[str, bytes], folder: Path, *added: str) -> None:
    after = contents(folder)
    assert {name: after.get(name) for name in before} == before
    assert set(after) - set(before) == set(added)


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


# Files that the scene reads.


def test_the_default_name_steps_aside_for_a_texture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    before = contents(tmp_path)
    assert run("render", "fuze.obj", *SMALL[:-1]) == 0
    assert_only_added(before, tmp_path, "fuze-render.png")
    assert "fuze.png must not be replaced; the picture goes to fuze-render.png" in capsys.readouterr().err
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


# Files that wrt did not write.


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
        patch.setattr("wrt.formats.scene_writer._write_text", interrupted)
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


# Devices, pipes and folders.


def make_special(kind: str, path: Path) -> None:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(path))
    elif kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path.name)
    else:
        try:
            os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))  # as /dev/null
        except PermissionError:
            pytest.skip("making device nodes takes root")


SPECIAL = ("pipe", "socket", "device", "folder", "loop")


@pytest.mark.parametrize("linked", [False, True], ids=["itself", "linked"])
@pytest.mark.parametrize("kind", SPECIAL)
def test_what_is_no_file_is_refused_in_every_place(kind, linked, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    for name in ("a.png", "a.exr", "a.npy", "a.toml", "a.ckpt", "fuze-render.png"):
        make_special(kind, tmp_path / (f"to-{name}" if linked else name))
        if linked:
            (tmp_path / name).symlink_to(f"to-{name}")

    def modes() -> list[tuple[str, int]]:
        return sorted((path.name, path.lstat().st_mode) for path in tmp_path.iterdir())

    before = modes()
    suffixes = (".png", ".exr", ".npy")
    commands: list[tuple[object, ...]] = [("render", "fuze.obj", "-o", f"a{suffix}", *SMALL) for suffix in suffixes]
    commands += [("render", "fuze.obj", "-o", "b.png", "--checkpoint", "a.ckpt", *SMALL)]
    commands += [("convert", "fuze.obj", "a.toml"), ("render", "a.toml", "-o", "b.png", *SMALL), ("info", "a.toml")]
    commands += [("render", "fuze.obj", "-o", "b.png", "--checkpoint", "a.ckpt", "--resume", *SMALL)]
    for command in commands:
        for force in ((), ("--force",)) if command[0] != "info" else ((),):
            assert run(*command, *force) == 2, command
            error = capsys.readouterr().err
            assert error.count("\n") == 1
            assert error.startswith("wrt: error: a."), error
            assert modes() == before


def test_links_are_followed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disk").mkdir()
    for name in ("a.png", "a.ckpt", "a.toml"):
        (tmp_path / name).symlink_to(f"disk/{name}")
    for _ in range(2):
        assert run("render", "cornell-box", "-o", "a.png", "--checkpoint", "a.ckpt", *SMALL) == 0
    assert run("convert", "cornell-box", "a.toml") == 0
    assert sorted(os.listdir(tmp_path / "disk")) == ["a.ckpt", "a.png", "a.toml"]
    assert all((tmp_path / name).is_symlink() for name in ("a.png", "a.ckpt", "a.toml"))


def test_a_write_protected_file_is_left_alone(tmp_path, capsys):
    save_image(tmp_path / "a.png", np.zeros((2, 2, 3)))
    (tmp_path / "a.png").chmod(0o444)
    before = contents(tmp_path)
    assert run("render", "cornell-box", "-o", tmp_path / "a.png", *SMALL) == 2
    assert "a.png: is write-protected" in capsys.readouterr().err
    assert_only_added(before, tmp_path)


def test_what_replaces_a_file_may_be_read_by_the_same_people(tmp_path):
    save_image(tmp_path / "a.png", np.zeros((2, 2, 3)))
    (tmp_path / "a.png").chmod(0o640)
    save_image(tmp_path / "a.png", np.ones((2, 2, 3)))
    assert stat.S_IMODE((tmp_path / "a.png").stat().st_mode) == 0o640


# Temporary files.

WRITING = """
import sys, time
from pathlib import Path
from wrt.formats.images import PICTURE
from wrt.safe_write import write_whole

def write(temporary):
    temporary.write_bytes(b"half")
    print("writing", flush=True)
    time.sleep(60)

write_whole(Path(sys.argv[1]), write, PICTURE)
"""


def test_leftovers_of_killed_writes_are_removed_and_no_others(tmp_path):
    mine = tmp_path / ".wrt-notes.part"
    mine.write_text("mine")
    processes = []
    for _ in range(2):
        command = [sys.executable, "-c", WRITING, str(tmp_path / "a.png")]
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE))
        assert processes[-1].stdout is not None
        assert processes[-1].stdout.readline() == b"writing\n"
    killed, living = processes
    killed.kill()
    killed.wait()
    assert len(list(tmp_path.glob(".wrt-????????-????????.part.png"))) == 2
    next_run = WRITING.replace("time.sleep(60)", "")
    subprocess.run([sys.executable, "-c", next_run, str(tmp_path / "b.png")], check=True, stdout=subprocess.DEVNULL)
    left = [path.name for path in tmp_path.glob(".wrt-*.part*")]
    living.kill()
    living.wait()
    assert len(left) == 2  # the file that is still being written, and the file that is not wrt's
    assert mine.name in left
    assert (tmp_path / "b.png").read_bytes() == b"half"
    for process in processes:
        assert process.stdout is not None
        process.stdout.close()


def test_names_as_long_as_they_may_be(tmp_path):
    name = "a" * 251 + ".png"
    write_whole(tmp_path / name, lambda file: file.write_bytes(b"x"), PICTURE)
    assert os.listdir(tmp_path) == [name]


def test_a_planted_fault_is_noticed(tmp_path, monkeypatch):
    """Without the rules the texture is replaced: these tests would notice."""
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path)
    before = contents(tmp_path)
    monkeypatch.setattr("wrt.safe_write._target", lambda path, kind, force: Path(os.path.realpath(path)))
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


def test_one_kind_of_output_does_not_replace_another(tmp_path):
    renderer = wrt.Renderer(wrt.load("cornell-box"), width=8, height=8)
    list(renderer.passes(spp=1))
    renderer.save(tmp_path / "a.npy")
    with pytest.raises(wrt.InputError, match="already exists and is not a checkpoint"):
        renderer.save_checkpoint(tmp_path / "a.npy")


def test_an_empty_file_is_no_loss(tmp_path):
    (tmp_path / "a.png").touch()
    save_image(tmp_path / "a.png", np.zeros((2, 2, 3)))
