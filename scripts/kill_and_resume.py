"""Kill renders at random moments, resume them, and compare the pictures with those of uninterrupted renders.

    scripts/kill_and_resume.py --rounds 100

Each round renders a scene with a checkpoint, kills it (SIGKILL) one to three times, and lets it finish. Half of the
kills are aimed at a moment when a file is being written, and a tenth at a compile with an empty cache. After each kill,
existing files must be intact. At the end no temporary files may be left, and the picture must be the same, byte for
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
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LEFTOVER = re.compile(r"\.wrt-[0-9a-f-]+\.part.*")

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

COMPILING = 4.0
"""Seconds for which a render with an empty cache compiles its kernels."""


AIMS = {"write": 0.5, "time": 0.4, "compile": 0.1}
"""The moments that kills are aimed at, and their shares."""


class RoundError(Exception):
    """A round failed."""


@dataclass
class Kills:
    """Counts of kills, by the moments they were aimed at and the moments they hit."""

    aimed: Counter[str]
    met: Counter[str]


def command(scene: tuple[str, ...], output: str, interval: float | None) -> list[str]:
    """Return the command that renders a scene, with a checkpoint every `interval` seconds."""
    saving = [] if interval is None else ["--checkpoint", "a.ckpt", "--resume", "--save-every", str(interval)]
    return [sys.executable, "-m", "wrt", "render", *scene, *saving, "-o", output, "--quiet"]


def suffix_of(scene: tuple[str, ...]) -> str:
    """Return the suffix of a scene's picture."""
    return ".exr" if "--layers" in scene else ".npy"


def environment(cache: Path | None) -> dict[str, str]:
    """Return the environment variables of a render; `cache` replaces the cache folder if it is given."""
    own = {} if cache is None else {"XDG_CACHE_HOME": str(cache)}
    return {**os.environ, "PYTHONPATH": str(ROOT), **own}


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
    for k, scene in enumerate(SCENES):
        output = folder / f"whole-{k}{suffix_of(scene)}"
        subprocess.run(command(scene, output.name, None), cwd=folder, env=environment(None), check=True)
        found.append(picture(output))
    return found


def require_whole(folder: Path) -> None:
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


def leftovers(folder: Path) -> list[str]:
    """Return the names of temporary files: of files being written, or left by a killed render."""
    return [name for name in os.listdir(folder) if LEFTOVER.fullmatch(name)]


def kill_at_a_moment(process: subprocess.Popen[bytes], folder: Path, aim: str, chance: random.Random) -> str:
    """Kill a render at the moment `aim`; return the moment it hit, or "ended before"."""
    deadline = time.monotonic() + LONGEST_WAIT
    before = set(leftovers(folder))
    writes = chance.randrange(1, 12)
    moment = time.monotonic() + chance.uniform(0.3, COMPILING if aim == "compile" else 4.0)
    while process.poll() is None:
        if time.monotonic() > deadline:
            process.kill()
            process.wait()
            raise RoundError("a render did not end")
        if aim == "write":
            begun = set(leftovers(folder)) - before
            if begun:
                before |= begun
                writes -= 1
                if writes == 0:
                    time.sleep(chance.uniform(0.0, 2e-3))
                    break
        elif time.monotonic() > moment:
            break
        time.sleep(1e-4)
    process.kill()
    if process.wait() == 0:
        return "ended before"
    return "half-written file" if set(leftovers(folder)) else aim


def play_round(whole: list[bytes], folder: Path, chance: random.Random, kills: Kills) -> None:
    """Kill and resume one render.

    Raises:
        RoundError: where the round fails.
    """
    k = chance.randrange(len(SCENES))
    scene, interval = SCENES[k], chance.choice(INTERVALS)
    cache = None
    output = f"out{suffix_of(scene)}"
    resume = command(scene, output, interval)
    for _ in range(chance.randrange(1, 4)):
        (aim,) = chance.choices(tuple(AIMS), tuple(AIMS.values()))
        if aim == "compile":
            cache = folder / "cache"
            shutil.rmtree(cache, ignore_errors=True)
        process = subprocess.Popen(resume, cwd=folder, env=environment(cache), stderr=subprocess.DEVNULL)
        kills.aimed[aim] += 1
        kills.met[kill_at_a_moment(process, folder, aim, chance)] += 1
        require_whole(folder)
    ended = subprocess.run(resume, cwd=folder, env=environment(cache), capture_output=True, text=True)
    if ended.returncode != 0 or "Traceback" in ended.stderr:
        raise RoundError(f"status {ended.returncode}: {ended.stderr}")
    if picture(folder / output) != whole[k]:
        raise RoundError(f"another picture of {scene[0]}")
    if left := leftovers(folder):
        raise RoundError(f"left over: {', '.join(left)}")


def main() -> int:
    """Run the rounds; return 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=100, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    options = parser.parse_args()
    chance, kills, failed = random.Random(options.seed), Kills(Counter(), Counter()), 0
    home = Path(tempfile.mkdtemp(prefix="wrt-kills-"))
    whole = references(home)
    for number in range(options.rounds):
        folder = home / f"round-{number}"
        folder.mkdir()
        try:
            play_round(whole, folder, chance, kills)
        except RoundError as error:
            failed += 1
            print(f"round {number} failed, see {folder}: {error}", flush=True)
        else:
            shutil.rmtree(folder)
        if (number + 1) % 10 == 0:
            print(f"{number + 1} rounds, {failed} failed", flush=True)
    print(f"{options.rounds - failed} of {options.rounds} resumed to the byte")
    print(f"kills aimed at {dict(kills.aimed)}, met {dict(kills.met)}")
    if not failed:
        shutil.rmtree(home)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
