"""Damaged files of the kernel cache are never loaded, and rendering works without a writable cache."""

from __future__ import annotations

import contextlib
import os
import pwd
import random
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from support.caches import CORNELL_BOX, copy_of_headers, copy_of_warm_cache
from support.commands import ENVIRONMENT, run

from wrt.backend import cache_folders, kernel_cache
from wrt.backend.cache_folders import locked, put, remove_leftovers, user_folder, work_folder
from wrt.backend.kernel_cache import State, seal, state

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
        said = [line.split("UserWarning: ")[1] for line in error.splitlines() if "UserWarning: " in line]
        return int(out), "\n".join(said)

    def file(self, suffix: str) -> Path:
        """Return a file of the kernel."""
        (found,) = self.folder.glob(f"warp/*/wp_wrt.test_cache_*/*{suffix}")
        return found


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path)


def flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


# --- Digests of compiled kernels ----------------------------------------------------------------------


@pytest.fixture
def build(tmp_path: Path) -> tuple[Path, Path]:
    """Return the files of an intact build."""
    folder = tmp_path / "warp" / "module"
    folder.mkdir(parents=True)
    files = folder / "a.o", folder / "a.meta"
    for file in files:
        file.write_bytes(file.suffix.encode() * 100)
    seal(*files)
    return files


def test_any_changed_or_missing_bit_is_damage_and_a_missing_file_is_not(build: tuple[Path, Path]) -> None:
    assert state(*build) is state(build[0]) is State.WHOLE
    for file in (*build, Path(f"{build[0]}.checksum")):
        whole = file.read_bytes()
        for at in (*range(0, len(whole), 7), len(whole) - 1):
            flip(file, at)
            assert state(*build) is State.DAMAGED
            file.write_bytes(whole[:at])
            assert state(*build) is State.DAMAGED
            file.write_bytes(whole)
        file.unlink()
        assert state(*build) is State.UNKNOWN
        file.write_bytes(whole)
    assert state(*build) is State.WHOLE


def test_who_reads_while_others_write_sees_no_damage(
    build: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Two threads that write all the time keep a reader waiting for longer than the default on a busy machine.
    monkeypatch.setattr(cache_folders, "LOCK_SECONDS", 60.0)
    kept, over, others = build[0].parent, threading.Event(), []
    for k in range(2):
        own = tmp_path / f"own{k}"
        own.mkdir()
        (own / "a.o").write_bytes(bytes([k]) * 10_000)
        (own / "a.meta").write_text("{}")
        seal(own / "a.o", own / "a.meta")
        others.append(own)

    def write() -> None:
        while not over.is_set():
            for own in others:
                kernel_cache._publish(own, kept, "a.o")
            time.sleep(0.01)  # else they may never leave the lock to the reader

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    try:
        unsure = 0
        for _ in range(300):
            assert state(*build) is State.WHOLE
            unsure += kernel_cache._state(*build) is not State.WHOLE
    finally:
        over.set()
        for writer in writers:
            writer.join()
    assert unsure > 0  # a reader without the lock would have seen damage
    assert sorted(file.name for file in kept.iterdir()) == ["a.meta", "a.o", "a.o.checksum"]


def test_nobody_waits_for_ever_for_a_stopped_writer_or_writes_beside_it(
    build: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache_folders, "LOCK_SECONDS", 0.1)
    own = tmp_path / "own"
    shutil.copytree(build[0].parent, own)
    flip(build[0], 0)
    half_written = build[0].read_bytes()
    with locked(build[0].parent.parent):
        assert state(*build) is State.UNKNOWN
        assert not kernel_cache._publish(own, build[0].parent, "a.o")
        assert build[0].read_bytes() == half_written
    assert state(*build) is State.DAMAGED
    assert kernel_cache._publish(own, build[0].parent, "a.o")
    assert state(*build) is State.WHOLE


@pytest.mark.slow
def test_damage_is_told_once_and_mended_and_an_unsealed_kernel_silently_compiled(cache: Cache) -> None:
    copy_of_headers(cache.folder)
    assert cache.run() == (1, "")
    flip(cache.file(".o"), 7)
    assert cache.run() == (1, f"{cache.file('.o')}: the compiled kernel was damaged, and is compiled again")
    assert cache.run() == (0, "")
    cache.file(".checksum").unlink()  # as in the caches of older versions
    flip(cache.file(".o"), 100)
    assert cache.run() == (1, "")
    assert cache.run() == (0, "")


@pytest.mark.slow
def test_of_processes_that_need_the_same_kernel_at_once_one_compiles_it(cache: Cache) -> None:
    copy_of_headers(cache.folder)
    for damaged in (False, True):
        if damaged:
            flip(cache.file(".o"), 200)
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
    "headers": ("wrt/headers-*/*", "warp/*/wp_wrt.kernels.film_*"),
    "the source of a module": ("warp/*/*/*.cpp", TABLE),
}
"""The files to damage, and those to remove so that the damaged one is read."""


@pytest.mark.machinery
def test_damage_to_any_file_is_harmless_and_reported_once_at_most(tmp_path: Path) -> None:
    cache, intact, film = tmp_path / "cache", tmp_path / "intact", tmp_path / "film.npy"
    environment = {name: value for name, value in ENVIRONMENT.items() if not name.startswith(("WARP_", "WRT_"))}
    environment["XDG_CACHE_HOME"] = str(cache)

    def rendered() -> tuple[bytes, list[str]]:
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


def test_where_caches_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    for told, expected in (
        ("/elsewhere", "/elsewhere"),
        ("", "/home/somebody/.cache"),
        ("./x", "/home/somebody/.cache"),
    ):
        monkeypatch.setenv("XDG_CACHE_HOME", told)
        assert user_folder() == Path(expected)
    monkeypatch.setenv("HOME", "relative")
    assert user_folder() == Path(pwd.getpwuid(os.getuid()).pw_dir, ".cache")


@contextlib.contextmanager
def mounted(folder: Path, *options: str) -> Iterator[None]:
    """Mount a file system in a folder for the context; skip the test where that is not permitted."""
    folder.mkdir(exist_ok=True)
    try:
        subprocess.run(["mount", "-t", "tmpfs", *options, "none", str(folder)], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no file system can be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_done_without(cache: Cache) -> None:
    cache.folder.write_text("a file where the folder should be")
    count, said = cache.run()
    assert (count, said.count("\n")) == (1, 0)
    assert f"{cache.folder}/warp: cannot be written: Not a directory; compiled kernels are kept in " in said
    assert not Path(said.split(" kept in ")[1].split()[0]).exists()  # once the process has ended


@pytest.mark.machinery
def test_a_read_only_cache_is_of_use_and_a_full_disk_is_done_without(cache: Cache) -> None:
    with mounted(cache.folder):
        assert cache.run() == (1, "")
        subprocess.run(["mount", "-o", "remount,ro", str(cache.folder)], check=True)
        assert cache.run() == (0, "")
        cache.program.write_text(SMALL.replace("*= 2.0", "+= 1.0"))  # another kernel
        count, said = cache.run()
        assert (count, said.count("cannot be written: Read-only file system")) == (1, 1)
    with mounted(cache.folder, "-o", "size=8k"):
        for _ in range(2):
            count, said = cache.run()
            assert (count, said.count("\n")) == (1, 0)
            assert said.count("cannot be written: No space left on device") == 1
    assert cache.run() == (1, "")


def test_a_write_that_fails_in_the_middle_leaves_nothing_behind(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    put(tmp_path / "file", b"as it was")
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match="large"):
            put(tmp_path / "file", bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"as it was")]


def test_no_room_to_compile_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache_folders, "ROOM", 1 << 60)
    monkeypatch.setattr(cache_folders, "_work", None)
    with pytest.raises(OSError, match="compiling kernels takes"):
        work_folder()


# --- What killed processes leave ----------------------------------------------------------------------


def test_leftovers_of_the_dead_go_and_those_of_the_living_stay(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    stays = {
        f"wp_wrt.render.x_1234567_p{ended.pid}_t99": False,
        f".0011_p{ended.pid}_t99": False,
        f"wp_wrt.render.x_1234567_p{os.getpid()}_t99": True,
        f".0011_p{os.getpid()}_t99": True,
        f"wp_other.program_1234567_p{ended.pid}_t99": True,  # not ours
        "wp_wrt.render.x_1234567": True,
    }
    for name in stays:
        if name.startswith("."):
            (tmp_path / name).write_text("half")
        else:
            (tmp_path / name).mkdir()
            (tmp_path / name / "half.cpp").write_text("half")
    remove_leftovers(tmp_path, tmp_path / "not there")
    assert {path.name for path in tmp_path.iterdir()} == {name for name in stays if stays[name]}


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
def test_the_folder_of_a_killed_process_is_removed_by_the_next(cache: Cache, tmp_path: Path) -> None:
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
