"""`found`: the second render of a scene from the shell, as a user finds it, beside Mitsuba, on scenes of others."""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from peers.peer import LLVM_HINT, PEERS, Environments

from benchmarks.loading import run
from benchmarks.measure import ROOT, geometric_mean

SOURCE = "https://github.com/mitsuba-renderer/mitsuba-data"

FILES = {
    "cbox": "scenes/cbox/cbox-rgb.xml",
    "matpreview": "scenes/matpreview/matpreview.xml",
    "diffuse": "docs/scenes/bsdf_diffuse_plain.xml",
    "textured": "docs/scenes/bsdf_diffuse_textured.xml",
    "plastic": "docs/scenes/bsdf_plastic_default.xml",
    "copper": "docs/scenes/bsdf_roughconductor_copper.xml",
    "glass": "docs/scenes/bsdf_dielectric_glass.xml",
    "bunny": "docs/scenes/shape_ply_bunny.xml",
}
"""Scenes of Mitsuba's documentation, which nobody here wrote or tuned for; none is part of this project."""

MITSUBA = """\
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[4])
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
from peers.mitsuba_worker import load_square
scene = load_square(Path(sys.argv[1]), int(sys.argv[3]))
mi.util.write_bitmap("mitsuba.png", mi.render(scene, spp=int(sys.argv[2])), write_async=False)
"""

COMPILING_SECONDS = 600.0
"""Longest wait for what wrt compiles for the next render."""


def fetched(folder: Path) -> Path | None:
    """Clone the scenes into a folder, and return where they are; None where that is not possible."""
    command = ["git", "clone", "--quiet", "--depth", "1", SOURCE, str(folder / "scenes")]
    try:
        subprocess.run(command, check=True, timeout=600.0)
    except (OSError, subprocess.SubprocessError) as error:
        print(f"the scenes cannot be fetched, and are left out: {error}", file=sys.stderr)
        return None
    return folder / "scenes"


def wait_for_compiler(cache: Path) -> None:
    """Return once nothing is being compiled for later renders."""
    limit = time.monotonic() + COMPILING_SECONDS
    requests = cache / "wrt" / "requests"
    while requests.is_dir() and any(requests.iterdir()) and time.monotonic() < limit:
        time.sleep(0.1)


def commands(file: Path, spp: int, size: int) -> dict[str, list[str]]:
    """Return what each program is started by."""
    own = [sys.executable, "-m", "wrt", "render", str(file), "--size", f"{size}x{size}", "--spp", str(spp)]
    return {
        "wrt": [*own, "--quiet", "-o", "wrt.png", "--force"],
        "mitsuba": [sys.executable, "-c", MITSUBA, str(file), str(spp), str(size), str(ROOT / "scripts")],
    }


def measured(
    file: Path, spp: int, options: argparse.Namespace, variables: dict[str, str]
) -> dict[str, dict[str, float]]:
    """Return medians of whole processes by program, in turn, after a first run whose compilers have ended.

    Each program has `first_cpu_seconds` and `first_seconds`, of that run, besides.

    Raises:
        RuntimeError: when a program fails.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        runs: dict[str, list[dict[str, float]]] = {"wrt": [], "mitsuba": []}
        for _ in range(1 + options.repeats):
            for program, command in commands(file, spp, options.size).items():
                found = run(command, folder, variables)
                wait_for_compiler(Path(variables["XDG_CACHE_HOME"]))
                runs[program].append(found)
    medians: dict[str, dict[str, float]] = {}
    for program, (first, *others) in runs.items():
        medians[program] = {key: statistics.median(each[key] for each in others) for key in first}
        medians[program] |= {f"first_{key}": first[key] for key in ("cpu_seconds", "seconds")}
    return medians


def benchmark_found(options: argparse.Namespace) -> dict[str, Any]:
    """Return medians of each program's seconds for each scene and number of samples, and their ratios."""
    variables = Environments(llvm=options.llvm).variables(PEERS["mitsuba-llvm"])
    variables |= {"PYTHONPATH": str(ROOT), "WRT_BACKGROUND": "1"}
    variables.pop("WARP_CACHE_PATH", None)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or fetched(Path(temporary))
        variables["XDG_CACHE_HOME"] = str(options.cache or Path(temporary, "cache"))
        print("| scene | spp | wrt, s of CPU | Mitsuba | ratio | wrt, s | Mitsuba | wrt's first, s of CPU | s |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
        for name in options.scenes:
            if folder is None or not (file := folder / FILES[name]).is_file():
                print(f"{name}: not there, and left out", file=sys.stderr)
                continue
            for spp in options.spp:
                try:
                    medians = measured(file.resolve(), spp, options, variables)
                except RuntimeError as error:
                    print(f"{name}: {error}", file=sys.stderr)
                    continue
                wrt, other = medians["wrt"], medians["mitsuba"]
                ratio = other["cpu_seconds"] / wrt["cpu_seconds"]
                rows.append({"scene": name, "spp": spp, "programs": medians, "ratio": ratio})
                cpu = f"{wrt['cpu_seconds']:.2f} | {other['cpu_seconds']:.2f} | {ratio:.2f}"
                first = f"{wrt['first_cpu_seconds']:.2f} | {wrt['first_seconds']:.2f}"
                seconds = f"{wrt['seconds']:.2f} | {other['seconds']:.2f}"
                print(f"| `{name}` | {spp} | {cpu} | {seconds} | {first} |", flush=True)
    for spp in options.spp:
        if ratios := [row["ratio"] for row in rows if row["spp"] == spp]:
            print(f"| geometric mean | {spp} |  |  | **{geometric_mean(ratios):.2f}** |  |  |  |  |")
    return {"benchmark": "found", "repeats": options.repeats, "size": options.size, "rows": rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--scenes", nargs="+", choices=list(FILES), default=list(FILES), metavar="NAME")
    parser.add_argument("--folder", type=Path, help=f"a checkout of {SOURCE}, which is cloned otherwise")
    parser.add_argument("--cache", type=Path, metavar="FOLDER", help="wrt's cache (default: an empty one)")
    parser.add_argument("--spp", nargs="+", type=int, default=[64, 512])
    parser.add_argument("--size", type=int, default=384, help="pixels on each side (default: 384)")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
