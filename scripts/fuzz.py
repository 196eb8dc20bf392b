#!/usr/bin/env python3
"""Fuzz every file reader of wrt with damaged files.

Each input is made from tests/corpus by scripts/fuzz_mutations.py and read in a process for its kind, with limited
memory and time. It must be read, perhaps with an InputWarning, or refused by an InputError of one line that names a
file. Anything else is a failure, whose input is kept: another exception or warning, a message of several lines, output
from a library, a signal, or more memory or time than a small file needs.

    scripts/fuzz.py --inputs 20000 --jobs 2
    scripts/fuzz.py --kinds glb,toml --seconds 60 --seed 7
    scripts/fuzz.py --replay tests/corpus/failures/*

The same seed makes the same inputs for any number of jobs. The exit status is 1 if anything failed.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import multiprocessing
import multiprocessing.connection
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from fuzz_mutations import mutate

ROOT = Path(__file__).resolve().parent.parent
CORPUS = ROOT / "tests" / "corpus"
SECONDS, MEGABYTES = 10.0, 1536
"""Limits of one input: seconds of CPU, and additional address space, twice what
`wrt/io/memory_limits.py` allows for small files."""

READERS = "fuzz:readers"
"""Module and function that return the readers of a kind."""

WALL_FACTOR = 6
"""Wall-clock limit over the CPU limit, for busy machines on which a process may have to wait."""

CORPUS_VERSION = "0"
"""Version of wrt in the header of parts in the corpus; other versions are refused."""

_MEMORY = re.compile(r"memory|allocat|bad_alloc", re.IGNORECASE)
_PROCESSES = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
_LONGEST = 1000

Reader = Callable[[Path], object]


class Outcome(NamedTuple):
    """The outcome of an input: "fine", "refused" or "failed", and why."""

    verdict: str
    reason: str = ""


class Corpus:
    """The files to damage, by kind, which is their suffix."""

    def __init__(self, folder: Path = CORPUS) -> None:
        """Read the folder's `seeds` and `failures`."""
        self.seeds = folder / "seeds"
        self.files: dict[str, list[bytes]] = {}
        # Intact files are used more often, since readers soon reject damaged ones.
        for file in [*sorted(self.seeds.iterdir()) * 3, *sorted((folder / "failures").glob("*"))]:
            self.files.setdefault(file.suffix[1:], []).append(file.read_bytes())

    def input(self, seed: int, number: int, kinds: Sequence[str]) -> tuple[str, bytes]:
        """Return the kind and content of an input."""
        rng = Random(f"{seed}:{number}")
        kind = kinds[number % len(kinds)]
        return kind, mutate(rng, kind, rng.choice(self.files[kind]), self.files[kind])


# Readers ------------------------------------------------------------------------------------------


def readers(kind: str) -> list[Reader]:
    """Return the readers of a kind of file."""
    import wrt
    from wrt.describe.scene import scene_text
    from wrt.io.images import load_environment, load_image
    from wrt.rendering import part
    from wrt.rendering.checkpoint import read_checkpoint
    from wrt.rendering.merge import merge

    part.__version__ = CORPUS_VERSION

    def loaded(path: Path) -> None:
        scene_text(wrt.load(path))

    def with_material(path: Path) -> None:
        loaded(_beside(path, ".obj", f"mtllib {path.name}\n{_TRIANGLES}"))

    def as_textures(path: Path) -> None:
        maps = "".join(f"map_{key} {path.name}\n" for key in ("Kd", "Ks", "d", "Bump", "Pr"))
        _beside(path, ".mtl", f"newmtl glass\nnewmtl lamp\nnewmtl wood\nKs 1 1 1\nPr 0.5\n{maps}")
        with_material(path.with_suffix(".mtl"))

    if kind == "mtl":
        return [with_material]
    if kind == "json":
        return [wrt.load_cameras]
    if kind == "txt":
        return [lambda path: wrt.load_cameras(_dataset(path))]
    if kind == "ckpt":
        return [read_checkpoint]
    if kind == "wrt":
        return [lambda path: merge([path])]
    if kind in ("vol", "nvdb"):
        return [wrt.load_density]
    if kind == "bsdf":
        return [wrt.load_measurement]
    if kind in ("png", "jpg", "bmp", "exr", "hdr", "npy"):
        return [load_image, lambda path: load_image(path, linear=True), load_environment, as_textures]
    return [loaded]


def _dataset(path: Path) -> Path:
    """Return a folder with a dataset of COLMAP, one of whose two files is replaced."""
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    replaced = "images.txt" if b"IMAGE_ID" in path.read_bytes() else "cameras.txt"
    for name in ("images.txt", "cameras.txt"):
        shutil.copy(path if name == replaced else path.with_name(name), folder / name)
    return folder


_TRIANGLES = """\
v 0 0 0
v 1 0 0
v 0 1 0
vt 0 0
vt 1 0
vt 0 1
usemtl wood
f 1/1 2/2 3/3
usemtl glass
f 1/1 2/2 3/3
usemtl lamp
f 1/1 2/2 3/3
"""


def _beside(path: Path, suffix: str, text: str) -> Path:
    file = path.with_suffix(suffix)
    file.write_text(text)
    return file


# Reading processes --------------------------------------------------------------------------------


def judge(read: Reader, path: Path, allowed: tuple[type[Exception], type[Warning]]) -> Outcome:
    """Return the outcome of reading a file; `allowed` are the permitted error and warning."""
    verdict, words = "fine", []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            read(path)
        except allowed[0] as error:
            verdict, words = "refused", [("the message", str(error))]
        except Exception as error:  # noqa: BLE001 - the failures to find
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            return Outcome("failed", f"{type(error).__name__} at {where}: {_short(str(error))}")
    for warning in caught:
        # A note, such as that points are drawn, is a UserWarning; like others it must name the file.
        if not issubclass(warning.category, allowed[1]) and warning.category is not UserWarning:
            where = f"{Path(warning.filename).name}:{warning.lineno}"
            return Outcome("failed", f"{warning.category.__name__} at {where}: {_short(str(warning.message))}")
        words.append(("a warning", str(warning.message)))
    for what, text in words:
        if _CONTROL.search(text) or len(text) > _LONGEST:
            return Outcome("failed", f"{what} is not one short line of plain text: {_short(text)}")
        if path.stem not in text and str(path.parent) not in text:  # or of a file that it names
            return Outcome("failed", f"{what} does not name the file: {_short(text)}")
        if _MEMORY.search(text):
            return Outcome("failed", f"memory is allocated before the size is checked: {_short(text)}")
    return Outcome(verdict, words[0][1] if words else "")


def _short(text: str) -> str:
    return repr(text if len(text) < 200 else f"{text[:150]}...")[1:-1]


def work(pipe: Any, make_readers: str, seeds: Path, folder: Path, seconds: float, megabytes: int) -> None:
    """Read what comes through the pipe and send back what came of it; the body of a process.

    Args:
        pipe: gives (kind, data), takes outcomes; None ends it.
        make_readers: "module:function", which returns the readers of a kind.
        seeds: the corpus, copied into `folder`, since files name one another.
        folder: a new folder to work in.
        seconds: see SECONDS.
        megabytes: see MEGABYTES.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.path[:0] = [str(ROOT), str(ROOT / "scripts"), str(ROOT / "tests")]
    module, _, name = make_readers.partition(":")
    find = getattr(importlib.import_module(module), name)
    from wrt.errors import InputError, InputWarning

    shutil.copytree(seeds, folder, dirs_exist_ok=True)
    for file in sorted(seeds.iterdir()) if name == "readers" and module == "fuzz" else ():
        for read in find(file.suffix[1:]):  # slow imports happen here
            judge(read, shutil.copy(file, folder / f"input{file.suffix}"), (InputError, InputWarning))
    noise = (folder / "noise").open("w+b")
    os.dup2(noise.fileno(), 1)
    os.dup2(noise.fileno(), 2)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + megabytes * 2**20, resource.RLIM_INFINITY))
    pipe.send(None)
    while (task := pipe.recv()) is not None:
        kind, data = task
        path = folder / f"input.{kind}"
        path.write_bytes(data)
        result = Outcome("fine")
        for read in find(kind):
            spent, of_children = (sum(resource.getrusage(who)[:2]) for who in _PROCESSES)
            resource.setrlimit(resource.RLIMIT_CPU, (int(spent + seconds) + 1, resource.RLIM_INFINITY))
            outcome = judge(read, path, (InputError, InputWarning))
            if sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) > of_children + seconds:
                outcome = Outcome("failed", f"hang: more than {seconds:g} s in another process")
            if noise.seek(0, 2):
                noise.seek(0)
                outcome = Outcome("failed", f"output from below: {_short(noise.read().decode(errors='replace'))}")
                noise.truncate(0)
                noise.seek(0)
            if result.verdict == "fine" or outcome.verdict == "failed":
                result = outcome
            if result.verdict == "failed":
                break
        pipe.send(result)


class Worker:
    """A reading process, which is restarted when an input has killed it."""

    def __init__(
        self,
        seeds: Path = CORPUS / "seeds",
        make_readers: str = READERS,
        seconds: float = SECONDS,
        megabytes: int = MEGABYTES,
        wall_factor: float = WALL_FACTOR,
    ) -> None:
        """Start it; for the arguments see `work` and the constants."""
        self._folder = Path(tempfile.mkdtemp(prefix="wrt-fuzz-"))
        self._arguments = (make_readers, seeds, self._folder, seconds, megabytes)
        self._seconds, self._wall_seconds = seconds, seconds * wall_factor
        self.task: tuple[int, str, bytes] | None = None
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, end_of_process = context.Pipe()
        self._process = context.Process(target=work, args=(end_of_process, *self._arguments), daemon=True)
        self._process.start()
        end_of_process.close()
        self.pipe.recv()  # it is ready

    def give(self, number: int, kind: str, data: bytes) -> None:
        """Send it an input."""
        self.task = number, kind, data
        self.deadline = time.monotonic() + self._wall_seconds
        self.pipe.send((kind, data))

    def wait(self) -> Outcome:
        """Return the outcome, once there is one or the deadline has passed."""
        self.pipe.poll(max(self.deadline - time.monotonic(), 0.0) + 0.01)
        return self.take()

    def take(self) -> Outcome:
        """Return the outcome; call it when `pipe` is ready or `deadline` has passed."""
        hung = Outcome("failed", f"hang: more than {self._seconds:g} s")
        self.task = None
        if time.monotonic() > self.deadline and not self.pipe.poll():
            self._process.kill()
            self._process.join()
            self._start()
            return hung
        try:
            result: Outcome = self.pipe.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode or 0
            self._start()
            if code == -signal.SIGXCPU:
                return hung
            return Outcome("failed", f"crash: {signal.Signals(-code).name}" if code < 0 else f"exit status {code}")
        return result

    def close(self) -> None:
        """End it."""
        with contextlib.suppress(OSError):
            self.pipe.send(None)
        self._process.join(10)
        if self._process.is_alive():
            self._process.kill()
        shutil.rmtree(self._folder, ignore_errors=True)


def run(
    inputs: Iterator[tuple[int, str, bytes]], *, jobs: int = 1, **options: Any
) -> Iterator[tuple[int, str, bytes, Outcome]]:
    """Yield each input (number, kind, content) with its outcome, in the order in which they finish.

    `options` are arguments of `Worker`.
    """
    workers = [Worker(**options) for _ in range(jobs)]
    try:
        for worker in workers:
            if (task := next(inputs, None)) is not None:
                worker.give(*task)
        while busy := [worker for worker in workers if worker.task is not None]:
            wait = max(min(worker.deadline for worker in busy) - time.monotonic(), 0.0) + 0.01
            ready = multiprocessing.connection.wait([worker.pipe for worker in busy], wait)
            for worker in busy:
                if worker.pipe in ready or time.monotonic() > worker.deadline:
                    assert worker.task is not None
                    task = worker.task
                    outcome = worker.take()
                    if (following := next(inputs, None)) is not None:
                        worker.give(*following)
                    yield *task, outcome
    finally:
        for worker in workers:
            worker.close()


# The command --------------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    """Run and return the exit status."""
    parser = argparse.ArgumentParser(description="Fuzz every file reader of wrt with damaged files.")
    parser.add_argument("--inputs", type=int, default=20000, help="number of inputs (default: 20000)")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after this many seconds")
    parser.add_argument("--seed", type=int, default=0, help="random seed (default: 0)")
    parser.add_argument("--kinds", help="suffixes, such as obj,glb (default: all in the corpus)")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes (default: 1)")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for failing inputs")
    parser.add_argument("--replay", type=Path, nargs="+", help="read these files unchanged instead")
    options = parser.parse_args(argv)

    corpus = Corpus()
    kinds = options.kinds.split(",") if options.kinds else sorted(corpus.files)
    end = time.monotonic() + options.seconds

    def inputs() -> Iterator[tuple[int, str, bytes]]:
        if options.replay:
            for number, file in enumerate(options.replay):
                yield number, file.suffix[1:], file.read_bytes()
            return
        for number in range(options.inputs):
            if time.monotonic() < end:
                yield number, *corpus.input(options.seed, number, kinds)

    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    reasons: collections.Counter[tuple[str, str]] = collections.Counter()
    for number, kind, data, outcome in run(inputs(), jobs=options.jobs):
        counts[kind, outcome.verdict] += 1
        if options.replay:
            print(f"{options.replay[number]}: {outcome.verdict}: {outcome.reason}", flush=True)
        elif outcome.verdict == "failed":
            # Keep a few failures of each kind; reasons that differ only in numbers are the same kind.
            alike = kind, re.sub(r"\d+|0x\w+|'[^']*'", "N", outcome.reason)[:120]
            reasons[alike] += 1
            if reasons[alike] <= 3:
                options.keep.mkdir(parents=True, exist_ok=True)
                file = options.keep / f"{options.seed}-{number}.{kind}"
                file.write_bytes(data)
                print(f"{file}: {outcome.reason}", flush=True)
    verdicts = ("fine", "refused", "failed")
    for kind in sorted({kind for kind, _ in counts}):
        print(f"{kind:<6}", *(f"{counts[kind, verdict]:>8} {verdict}" for verdict in verdicts))
    total = {verdict: sum(counts[kind, verdict] for kind, v in counts if v == verdict) for verdict in verdicts}
    print("all   ", *(f"{count:>8} {verdict}" for verdict, count in total.items()))
    return 1 if total["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
