#!/usr/bin/env python3
"""Damage the kernel cache, one file a round, and check that renders cope with it.

    scripts/damage_cache.py --rounds 1000 --jobs 2 --seed 1

A round damages one byte of one file of a warm cache, or truncates the file, and renders a small scene from the shell.
The render must end with status 0, print nothing but one-line warnings, and give the same bits as with an intact cache;
the next render must print nothing. The script prints the outcomes for each kind of file, and ends with status 1 if any
round failed. `--only N` repeats one round of a seed.
"""

from __future__ import annotations

import argparse
import os
import queue
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

COMMAND = ("render", "cornell-box", "--size", "32x32", "--spp", "2", "--quiet", "-o", "film.npy")

SECONDS = 300.0
"""Time after which a render counts as hung."""

NOTES = "wrt/builds-*.json"
FILM = "warp/*/wp_wrt.kernels.film_*"


@dataclass(frozen=True)
class Kind:
    """A kind of damage: a pattern for the file to damage, files to remove so that it is read, and a weight."""

    files: str
    removed: tuple[str, ...]
    weight: int


KINDS = {
    "object": Kind("warp/*/*/*.o", (), 4),
    "object, read by Warp": Kind("warp/*/*/*.o", (NOTES,), 4),
    "digest": Kind("warp/*/*/*.checksum", (), 2),
    "digest, read by Warp": Kind("warp/*/*/*.checksum", (NOTES,), 2),
    "meta": Kind("warp/*/*/*.meta", (NOTES,), 2),
    "notes": Kind(NOTES, (), 3),
    "headers": Kind("wrt/headers-*/*", (FILM,), 2),
    "source": Kind("warp/*/*/*.cpp", (NOTES,), 1),
}


class Place:
    """A folder with a cache of its own, and an intact copy of the cache."""

    def __init__(self, folder: Path, start: Path | None = None) -> None:
        """Fill the cache by rendering, into a copy of `start` if given."""
        self.cache, self._whole, self._folder = folder / "cache", folder / "whole", folder
        folder.mkdir()
        if start is not None:
            shutil.copytree(start, self.cache)
        for _ in range(2):  # the second render uses the notes of the first
            status, said = self.render()
            if status != 0 or said:
                raise SystemExit(f"a render with an empty cache ends with status {status}: {said}")
        self.film = (folder / "film.npy").read_bytes()
        shutil.copytree(self.cache, self._whole)

    def restore(self) -> None:
        """Undo all damage."""
        shutil.rmtree(self.cache)
        shutil.copytree(self._whole, self.cache)

    def render(self) -> tuple[int, str]:
        """Render; return the exit status and the output."""
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("WARP_", "WRT_"))}
        environment |= {"XDG_CACHE_HOME": str(self.cache), "PYTHONPATH": str(ROOT)}
        (self._folder / "film.npy").unlink(missing_ok=True)
        command = [sys.executable, "-m", "wrt", *COMMAND]
        try:
            done = subprocess.run(
                command, cwd=self._folder, env=environment, capture_output=True, text=True, timeout=SECONDS
            )
        except subprocess.TimeoutExpired:
            return -1, f"not done after {SECONDS:.0f} s"
        return done.returncode, done.stdout + done.stderr

    def failure(self) -> tuple[str, str]:
        """Render; return what went wrong (empty if nothing) and the output."""
        status, said = self.render()
        if status != 0:
            return f"status {status}", said
        if not all(line.startswith("wrt: warning: ") for line in said.splitlines()):
            return "something else than warnings", said
        film = self._folder / "film.npy"
        return ("" if film.exists() and film.read_bytes() == self.film else "another picture"), said


def damage(file: Path, chance: random.Random) -> str:
    """Damage a file; return a description of the damage."""
    data = bytearray(file.read_bytes())
    at = chance.randrange(len(data))
    if chance.random() < 0.25:
        file.write_bytes(data[:at])
        return f"cut off after {at} bytes"
    if chance.random() < 0.5:
        data[at] ^= 1 << chance.randrange(8)
    else:
        data[at] ^= chance.randrange(1, 256)
    file.write_bytes(data)
    return f"byte {at} is {data[at]:#04x}"


def play(place: Place, seed: int, number: int) -> tuple[str, str, str]:
    """Play a round; return its kind, its outcome, and the reason if it failed."""
    chance = random.Random(f"{seed} {number}")
    (name,) = chance.choices(list(KINDS), [kind.weight for kind in KINDS.values()])
    kind = KINDS[name]
    place.restore()
    file = chance.choice(sorted(place.cache.glob(kind.files)))
    how = damage(file, chance)
    for pattern in kind.removed:
        for path in place.cache.glob(pattern):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    failed, said = place.failure()
    if said and not failed:
        again, said_again = place.failure()
        failed = f"the next render: {again or 'says something'}" if again or said_again else ""
        said = said_again if failed else said
    if failed:
        return name, "failed", f"round {number}, {file.relative_to(place.cache)}, {how}: {failed}\n{said.strip()}"
    return name, "noticed" if said else "harmless", ""


def run(
    rounds: Sequence[int], jobs: int, seed: int, tell: Callable[[str], None] = print, start: Path | None = None
) -> Counter[tuple[str, str]]:
    """Play rounds; return the number of rounds by kind and outcome.

    Args:
        rounds: the numbers of the rounds.
        jobs: how many rounds to play at once.
        seed: determines what each round does.
        tell: called with a description of each failure.
        start: a cache to begin with copies of; None for empty ones.
    """
    counts: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(prefix="damage-cache-") as folder, ThreadPoolExecutor(jobs) as pool:
        places: queue.SimpleQueue[Place] = queue.SimpleQueue()
        for place in pool.map(lambda job: Place(Path(folder, str(job)), start), range(jobs)):
            places.put(place)

        def play_somewhere(number: int) -> tuple[str, str, str]:
            place = places.get()
            try:
                return play(place, seed, number)
            finally:
                places.put(place)

        for name, outcome, text in pool.map(play_somewhere, rounds):
            counts[name, outcome] += 1
            if text:
                tell(text)
    return counts


def main() -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=100, help="default: 100")
    parser.add_argument("--jobs", type=int, default=2, help="number of renders at a time (default: 2)")
    parser.add_argument("--seed", type=int, default=0, help="random seed (default: 0)")
    parser.add_argument("--only", type=int, metavar="N", help="play only this round")
    options = parser.parse_args()
    rounds = range(options.rounds) if options.only is None else range(options.only, options.only + 1)
    start = time.monotonic()
    counts = run(rounds, options.jobs, options.seed, lambda text: print(text, flush=True))
    seconds = time.monotonic() - start
    for name in KINDS:
        found = {outcome: counts[name, outcome] for outcome in ("noticed", "harmless", "failed")}
        print(f"{name:<22}" + "".join(f"{count:>6} {outcome}" for outcome, count in found.items()))
    failed = sum(count for (_, outcome), count in counts.items() if outcome == "failed")
    print(f"{len(rounds)} rounds in {seconds:.0f} s, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
