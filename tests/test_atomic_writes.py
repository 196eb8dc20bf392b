"""Files are written whole, through links but never into devices, pipes or protected files, and leave nothing behind."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.outputs import SMALL, assert_only_added, contents, run, write_obj

from wrt.io.images import PICTURE, save_image
from wrt.io.safe_write import write_atomically


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
    write_atomically(tmp_path / name, lambda file: file.write_bytes(b"x"), PICTURE)
    assert os.listdir(tmp_path) == [name]
