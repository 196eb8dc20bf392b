"""Kill renders at random moments, resume them, and compare the pictures with those of uninterrupted renders.

    scripts/kill_and_resume.py --rounds 100

Each round renders a scene with a checkpoint, kills it (SIGKILL) one to three times, and lets it finish. Half of the
kills are aimed at a moment when a file is being written, and a tenth at a compile with an empty cache. After each kill,
existing files must be intact. At the end no temporary files may remain, and the picture must be the same, byte for
byte. If a round fails, its folder is kept and the script ends with status 1.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TEMPORARY = re.compile(r"\.wrt-[0-9a-f-]+\.part.*")

SCENES = (
    ("cornell-box", "--size", "96x96", "--spp", "192"),
    ("cornell-box", "--size", "64x48", "--spp", "512", "--sampler", "independent"),
    ("teapot", "--size", "96x64", "--spp", "160"),
    ("still-life", "--size", "80x60", "--spp", "96", "--layers", "albedo,normal"),
    ("many-triangles", "--triangles", "20000", "--size", "96x64", "--spp", "128"),
)
"""The scenes and options: each renders for about two to five seconds on two cores."""

INTERVALS = (0.05, 0.1, 0.3)
"""Seconds between checkpoints."""

LONGEST_WAIT = 120.0
"""Seconds after which a render has failed that neither ended nor reached the moment of its kill."""

AIMS = {"write": 0.5, "time": 0.4, "compile": 0.1}
"""The moments that kills are aimed at, and their shares."""

ENDED_BEFORE = "ended before"


class RoundError(Exception):
    """A round failed."""


def command(scene: tuple[str, ...], output: Path, *options: str) -> list[str]:
    """Return the command that renders a scene."""
    return [sys.executable, "-m", "wrt", "render", *scene, *options, "-o", str(output), "--quiet"]


def output_of(scene: tuple[str, ...], folder: Path) -> Path:
    """Return the path of a scene's picture in a folder."""
    return folder / ("out.exr" if "--layers" in scene else "out.npy")


def environment(cache: Path | None) -> dict[str, str]:
    """Return the environment variables of a render; `cache` replaces the cache folder if it is given."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    return variables if cache is None else {**variables, "XDG_CACHE_HOME": str(cache)}


def picture(path: Path) -> bytes:
    """Return the bytes to compare: for OpenEXR files only the pixels, since their metadata contain times."""
    if path.suffix == ".npy":
        return path.read_bytes()
    import OpenEXR

    channels = OpenEXR.File(str(path)).channels()
    return b"".join(name.encode() + channels[name].pixels.tobytes() for name in sorted(channels))


def references(folder: Path) -> list[bytes]:
    """Return the pictures of uninterrupted renders."""
    found = []
    for scene in SCENES:
        output = output_of(scene, folder)
        subprocess.run([*command(scene, output), "--force"], env=environment(None), check=True)
        found.append(picture(output))
    return found


def require_intact(folder: Path) -> None:
    """Raise RoundError if an existing checkpoint or picture cannot be read."""
    import numpy as np

    try:
        if (folder / "a.ckpt").exists():
            with (folder / "a.ckpt").open("rb") as file, np.load(file) as arrays:
                json.loads(str(arrays["header"]))
                for name in arrays.files:
                    arrays[name]
        for path in folder.glob("out.*"):
            picture(path)
    except Exception as error:
        raise RoundError(f"a damaged file after a kill: {error!r}") from error


def temporary_files(folder: Path) -> set[str]:
    """Return the names of temporary files: of files being written, or abandoned by a killed render."""
    return {name for name in os.listdir(folder) if TEMPORARY.fullmatch(name)}


def kill_at_a_moment(process: subprocess.Popen[bytes], folder: Path, aim: str, chance: random.Random) -> str:
    """Kill a render at the moment `aim`; return the moment it hit, or ENDED_BEFORE."""
    start = time.monotonic()
    moment = start + chance.uniform(0.3, 4.0)
    before, writes = temporary_files(folder), chance.randrange(1, 12)
    while process.poll() is None and (aim == "write" or time.monotonic() < moment):
        if time.monotonic() > start + LONGEST_WAIT:
            process.kill()
            process.wait()
            raise RoundError("a render did not end")
        if aim == "write" and (begun := temporary_files(folder) - before):
            before |= begun
            writes -= 1
            if writes == 0:
                time.sleep(chance.uniform(0.0, 2e-3))
                break
        time.sleep(1e-4)
    process.kill()
    if process.wait() == 0:
        return ENDED_BEFORE
    return "half-written file" if temporary_files(folder) else aim


def play_round(expected: list[bytes], folder: Path, chance: random.Random) -> Counter[str]:
    """Kill and resume one render; return how many kills hit which moment.

    Raises:
        RoundError: where the round fails.
    """
    k = chance.randrange(len(SCENES))
    output, cache, hits = output_of(SCENES[k], folder), None, Counter[str]()
    saving = ("--checkpoint", str(folder / "a.ckpt"), "--resume", "--save-every", str(chance.choice(INTERVALS)))
    resume = command(SCENES[k], output, *saving)
    for _ in range(chance.randrange(1, 4)):
        (aim,) = chance.choices(tuple(AIMS), tuple(AIMS.values()))
        if aim == "compile":
            cache = folder / "cache"
            shutil.rmtree(cache, ignore_errors=True)
        process = subprocess.Popen(resume, env=environment(cache), stderr=subprocess.DEVNULL)
        hits[kill_at_a_moment(process, folder, aim, chance)] += 1
        require_intact(folder)
    ended = subprocess.run(resume, env=environment(cache), capture_output=True, text=True)
    if ended.returncode != 0 or "Traceback" in ended.stderr:
        raise RoundError(f"status {ended.returncode}: {ended.stderr}")
    if picture(output) != expected[k]:
        raise RoundError(f"another picture of {SCENES[k][0]}")
    if abandoned := temporary_files(folder):
        raise RoundError(f"temporary files remain: {', '.join(sorted(abandoned))}")
    return hits


def main() -> int:
    """Run the rounds; return 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=100, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    options = parser.parse_args()
    chance, hits, failed = random.Random(options.seed), Counter[str](), 0
    home = Path(tempfile.mkdtemp(prefix="wrt-kills-"))
    expected = references(home)
    for number in range(options.rounds):
        folder = home / f"round-{number}"
        folder.mkdir()
        try:
            hits += play_round(expected, folder, chance)
        except RoundError as error:
            failed += 1
            print(f"round {number} failed, see {folder}: {error}", flush=True)
        else:
            shutil.rmtree(folder)
    print(f"{options.rounds - failed} of {options.rounds} resumed to the byte; kills hit {dict(hits)}")
    if not failed:
        shutil.rmtree(home)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
