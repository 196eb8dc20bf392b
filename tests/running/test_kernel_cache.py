"""Damaged files of the kernel cache are never loaded, and rendering works without a writable cache."""

import os
import pwd
import random
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from conftest import ROOT
from support.caches import CORNELL_BOX, copy_of_headers, copy_of_warm_cache
from support.commands import ENVIRONMENT, run

from wrt.backend import cache_folders, kernel_cache
from wrt.backend.cache_folders import locked, put, remove_leftovers, user_folder, work_folder
from wrt.backend.kernel_cache import COMPILED, Build, State, state

SMALL = """
import sys
import warp as wp
from wrt.backend.device import Device

@wp.kernel(enable_backward=False, module=wp.get_module("wrt.test_cache"))
def double(first: int, x: wp.array(dtype=float)):
    x[first + wp.tid()] *= 2.0

device = Device("cpu", threads=2)
compiled = []
import warp._src.build as build
build_cpu, build.build_cpu = build.build_cpu, lambda *a, **k: (compiled.append(a), build_cpu(*a, **k))
x = device.backend.array([1.0] * 100, float)
device.launch(double, 100, [x])
assert (x.numpy() == 2.0).all()
print(sum("test_cache" in a[1] for a in compiled))
"""
"""A program that needs one kernel, and prints how often it was compiled."""


class Cache:
    """A test's own cache folder, with the program above."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.program = folder / "cache", folder / "program.py"
        self.program.write_text(SMALL)

    def begin(self, **variables: str) -> subprocess.Popen[str]:
        environment = {name: value for name, value in os.environ.items() if not name.startswith("WARP_")}
        environment |= {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(self.folder), **variables}
        command, pipe = [sys.executable, "-W", "always", str(self.program)], subprocess.PIPE
        return subprocess.Popen(command, cwd=self.program.parent, env=environment, stdout=pipe, stderr=pipe, text=True)

    def run(self, **variables: str) -> tuple[int, str]:
        """Run the program; return how many kernels were compiled, and warnings."""
        process = self.begin(**variables)
        out, error = process.communicate()
        assert process.returncode == 0, error
        warnings = [line.split("UserWarning: ")[1] for line in error.splitlines() if "UserWarning: " in line]
        return int(out), "\n".join(warnings)


@pytest.fixture
def cache(tmp_path):
    return Cache(tmp_path)


def flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


# --- Digests of compiled kernels ----------------------------------------------------------------------


class SmallBuild(Build):
    """A build without Warp, whose files have the given contents."""

    def __init__(self, content: bytes = b"new") -> None:
        self.content = content
        self._module: Any = SimpleNamespace(name="small", get_module_identifier=lambda _: "small")
        self._device, self._block = SimpleNamespace(is_cpu=False), 1

    def files_in(self, folder: Path) -> tuple[Path, Path]:
        return folder / "a.o", folder / "a.meta"

    def run_compiler(self, folder: Path) -> None:
        folder.mkdir()
        for file in self.files_in(folder):
            file.write_bytes(file.suffix.encode() * 100 + self.content)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Return the files of an intact build in a cache."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    found = SmallBuild().provide()
    assert found == tmp_path / "small"
    return SmallBuild().files_in(found)


def test_any_changed_or_missing_bit_is_damage_and_a_missing_file_is_not(files):
    assert state(*files) is state(files[0]) is State.WHOLE
    for file in (*files, Path(f"{files[0]}.checksum")):
        intact = file.read_bytes()
        for at in (*range(0, len(intact), 7), len(intact) - 1):
            flip(file, at)
            assert state(*files) is State.DAMAGED
            file.write_bytes(intact[:at])
            assert state(*files) is State.DAMAGED
            file.write_bytes(intact)
        file.unlink()
        assert state(*files) is State.UNKNOWN
        file.write_bytes(intact)
    assert state(*files) is State.WHOLE


def test_damage_is_told_once_and_mended_and_an_unsealed_kernel_silently_compiled(files):
    folder, before = files[0].parent, len(COMPILED)
    flip(files[0], 7)
    with pytest.warns(UserWarning, match="a.o: the compiled kernel was damaged, and is compiled again") as warned:
        assert SmallBuild().provide() == SmallBuild().provide() == folder
    assert (len(warned), len(COMPILED)) == (1, before + 1)
    Path(f"{files[0]}.checksum").unlink()  # as in the caches of older versions
    flip(files[0], 100)
    assert SmallBuild().provide() == SmallBuild().provide() == folder
    assert (state(*files), len(COMPILED)) == (State.WHOLE, before + 2)


def test_readers_see_no_damage_while_another_build_is_written(files, tmp_path, monkeypatch):
    states = []

    def put_and_look(path, data):
        states.append(state(*files))
        put(path, data)
        states.append(state(*files))

    SmallBuild(b"other")._compile(tmp_path / "other")
    monkeypatch.setattr(kernel_cache, "put", put_and_look)
    kernel_cache.publish(tmp_path / "other", files[0].parent)
    assert states == [State.UNKNOWN] * 5 + [State.WHOLE]
    assert sorted(file.name for file in files[0].parent.iterdir()) == ["a.meta", "a.o", "a.o.checksum"]


def test_nobody_waits_for_ever_for_a_stopped_compiler_or_writes_beside_it(files, monkeypatch):
    monkeypatch.setattr(kernel_cache, "COMPILING_SECONDS", 0.1)
    flip(files[0], 0)
    half_written = files[0].read_bytes()
    with locked(files[0].parent, seconds=1.0):
        found = SmallBuild().provide()
        assert state(*SmallBuild().files_in(found)) is State.WHOLE
    assert found.parent == work_folder() / "kernels"
    assert files[0].read_bytes() == half_written
    with pytest.warns(UserWarning, match="damaged"):
        assert SmallBuild().provide() == files[0].parent
    assert state(*files) is State.WHOLE


@pytest.mark.slow
def test_of_processes_that_need_the_same_kernel_at_once_one_compiles_it(cache):
    copy_of_headers(cache.folder)
    for damaged in (False, True):
        if damaged:
            (binary,) = cache.folder.glob("warp/*/wp_wrt.test_cache_*/*.o")
            flip(binary, 200)
        compiled = 0
        for process in [cache.begin() for _ in range(3)]:
            out, error = process.communicate()
            assert process.returncode == 0, error
            assert damaged or "UserWarning" not in error
            compiled += int(out)
        assert compiled == 1
        assert cache.run() == (0, "")


TABLE = "wrt/artefacts-*.json"
DAMAGED_FILES: dict[str, tuple[str, ...]] = {
    "an object": ("warp/*/*/*.o",),
    "an object that Warp reads": ("warp/*/*/*.o", TABLE),
    "a digest": ("warp/*/*/*.checksum",),
    "a digest that Warp reads": ("warp/*/*/*.checksum", TABLE),
    "the description of a module": ("warp/*/*/*.meta", TABLE),
    "the table of artefacts": (TABLE,),
    "headers": ("wrt/headers-*/*.pch", "warp/*/wp_wrt.kernels.film_*"),
    "the source of a module": ("warp/*/*/*.cpp", TABLE),
}
"""The files to damage, and those to remove so that the damaged one is read."""


@pytest.mark.machinery
def test_damage_to_any_file_is_harmless_and_reported_once_at_most(tmp_path):
    cache, intact, film = tmp_path / "cache", tmp_path / "intact", tmp_path / "film.npy"
    environment = {name: value for name, value in ENVIRONMENT.items() if not name.startswith(("WARP_", "WRT_"))}
    environment["XDG_CACHE_HOME"] = str(cache)

    def rendered():
        film.unlink(missing_ok=True)
        done = run(tmp_path, *CORNELL_BOX, str(film), env=environment)
        assert done.returncode == 0, done.stderr
        return film.read_bytes(), done.stderr.splitlines()

    copy_of_warm_cache(cache)
    rendered()
    expected = rendered()
    assert expected[1] == []
    shutil.copytree(cache, intact)
    noticed = set()
    for number, (kind, (damaged, *removed)) in enumerate(DAMAGED_FILES.items()):
        chance = random.Random(number)
        shutil.rmtree(cache)
        shutil.copytree(intact, cache)
        file = chance.choice(sorted(cache.glob(damaged)))
        if number % 2:
            file.write_bytes(file.read_bytes()[: chance.randrange(file.stat().st_size)])
        else:
            flip(file, chance.randrange(file.stat().st_size))
        for path in (path for pattern in removed for path in cache.glob(pattern)):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        picture, messages = rendered()
        assert picture == expected[0], kind
        assert all(line.startswith("wrt: warning: ") for line in messages), kind
        assert not messages or rendered() == expected, kind
        noticed |= {kind} if messages else set()
    assert len(noticed) >= len(DAMAGED_FILES) - 3


# --- Folders ------------------------------------------------------------------------------------------


def test_where_caches_are(monkeypatch):
    monkeypatch.setenv("HOME", "/home/somebody")
    home_cache = "/home/somebody/.cache"
    for variable, expected in ("/elsewhere", "/elsewhere"), ("", home_cache), ("./x", home_cache):
        monkeypatch.setenv("XDG_CACHE_HOME", variable)
        assert user_folder() == Path(expected)
    monkeypatch.setenv("HOME", "relative")
    assert user_folder() == Path(pwd.getpwuid(os.getuid()).pw_dir, ".cache")


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_done_without(cache):
    cache.folder.write_text("a file where the folder should be")
    count, warned = cache.run()
    assert (count, warned.count("\n")) == (1, 0)
    assert f"{cache.folder}/warp: cannot be written: Not a directory; compiled kernels are kept in " in warned
    assert not Path(warned.split(" kept in ")[1].split()[0]).exists()  # once the process has ended


def test_a_write_that_fails_leaves_nothing_behind_and_no_room_is_told(tmp_path, monkeypatch):
    (tmp_path / "file").mkdir()
    with pytest.raises(OSError, match="directory"):
        put(tmp_path / "file", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    monkeypatch.setattr(cache_folders, "ROOM", 1 << 60)
    monkeypatch.setattr(cache_folders, "_work", None)
    with pytest.raises(OSError, match="compiling kernels takes"):
        work_folder()


# --- What killed processes leave ----------------------------------------------------------------------


def test_what_a_killed_process_was_writing_is_removed_after_an_hour(tmp_path):
    for name in (".0011", ".0022", "kernel.o"):
        (tmp_path / name).write_text("half")
    for name in (".0011", "kernel.o"):
        os.utime(tmp_path / name, (1.0, 1.0))
    remove_leftovers(tmp_path, tmp_path / "not there")
    assert {path.name for path in tmp_path.iterdir()} == {".0022", "kernel.o"}


WORK = """
import os, time
from wrt.backend.cache_folders import work_folder
folder = work_folder()
if not os.fork():  # a child has a folder of its own, which goes with it
    assert work_folder() != folder and work_folder().is_dir()
    raise SystemExit
assert os.wait()[1] == 0 and folder.is_dir()
print(folder, flush=True)
time.sleep(600)
"""


@pytest.mark.slow
def test_the_folder_of_a_killed_process_is_removed_by_the_next(cache, tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    copy_of_headers(cache.folder)
    cache.program.write_text(WORK)
    processes = [cache.begin(TMPDIR=str(temporary)) for _ in range(2)]
    try:
        folders = [Path(process.stdout.readline().strip()) for process in processes if process.stdout]
        assert all(folder.parent == temporary and folder.stat().st_mode & 0o777 == 0o700 for folder in folders)
        assert len(list(temporary.iterdir())) == 2
        processes[0].kill()
        processes[0].communicate()
        cache.program.write_text(SMALL)
        assert cache.run(TMPDIR=str(temporary)) == (1, "")
        assert list(temporary.iterdir()) == [folders[1]]
    finally:
        for process in processes:
            process.kill()
            process.communicate()
