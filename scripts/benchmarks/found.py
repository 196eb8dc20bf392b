"""`found`: first renders from the shell, and those after `wrt compile`, beside Mitsuba, on Mitsuba's own scenes."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from peers.peer import LLVM_HINT, PEERS, Environments

from benchmarks.measure import ROOT, Row, geometric_mean, run_in_turn, table

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
"""Scenes of Mitsuba's documentation, for which wrt was not tuned; they are not part of this project."""

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


def benchmark(options: argparse.Namespace) -> Row:
    """Return medians of each program's seconds for each scene and number of samples, and their ratios."""
    variables = Environments(llvm=options.llvm).variables(PEERS["mitsuba-llvm"])
    variables |= {"PYTHONPATH": str(ROOT), "WRT_BACKGROUND": "0"}
    variables.pop("WARP_CACHE_PATH", None)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as temporary:
        scenes = options.folder or Path(temporary, "scenes")
        if options.folder is None:
            clone = ["git", "clone", "--quiet", "--depth", "1", SOURCE, str(scenes)]
            subprocess.run(clone, check=True, timeout=600.0)
        cache = options.cache or Path(temporary, "cache")
        variables["XDG_CACHE_HOME"] = str(cache)
        for name in options.scenes:
            file = (scenes / FILES[name]).resolve()
            for spp in options.spp:
                try:
                    with tempfile.TemporaryDirectory() as folder:
                        programs = commands(file, spp, options.size)
                        compile_all = partial(compile_kernels, file, {**os.environ, **variables})
                        medians = run_in_turn(programs, options.repeats, Path(folder), variables, compile_all)
                except RuntimeError as error:
                    print(f"{name}: {error}", file=sys.stderr)
                    continue
                ratio = medians["mitsuba"]["cpu_seconds"] / medians["wrt"]["cpu_seconds"]
                rows.append({"scene": name, "spp": spp, "programs": medians, "ratio": ratio})
                print(f"{name}, {spp} spp: wrt {ratio:.2f} times as fast", flush=True)
    return {"benchmark": "found", "repeats": options.repeats, "size": options.size, "rows": rows}


def commands(file: Path, spp: int, size: int) -> dict[str, list[str]]:
    """Return the command that starts each program."""
    ours = [sys.executable, "-m", "wrt", "render", str(file), "--size", f"{size}x{size}", "--spp", str(spp)]
    return {
        "wrt": [*ours, "--quiet", "-o", "wrt.png", "--force"],
        "mitsuba": [sys.executable, "-c", MITSUBA, str(file), str(spp), str(size), str(ROOT / "scripts")],
    }


def compile_kernels(file: Path, environment: dict[str, str]) -> None:
    """Compile all kernels of a scene, for the renders after the first."""
    compiling = [sys.executable, "-m", "wrt", "compile", str(file)]
    subprocess.run(compiling, env=environment, check=True, capture_output=True)


def text(result: Row) -> str:
    """Return the table for docs/performance.md."""
    head = ["scene", "spp", "second render: seconds of CPU, wrt", "Mitsuba", "Mitsuba / wrt", "first render: wrt"]
    lines, means = [], []
    for spp in dict.fromkeys(row["spp"] for row in result["rows"]):
        rows = [row for row in result["rows"] if row["spp"] == spp]
        first_ratios = []
        for row in rows:
            ours, theirs = row["programs"]["wrt"], row["programs"]["mitsuba"]["cpu_seconds"]
            line = [f"`{row['scene']}`", str(spp), f"{ours['cpu_seconds']:.2f}", f"{theirs:.2f}", f"{row['ratio']:.2f}"]
            first = ours.get("first_cpu_seconds")  # missing where the cache had the scene's kernel already
            if first is not None:
                first_ratios.append(theirs / first)
            if spp == result["rows"][0]["spp"]:  # of further numbers of samples the mean is enough
                lines.append([*line, *((f"{first:.2f}", f"{theirs / first:.2f}") if first is not None else ("", ""))])
        mean = f"**{geometric_mean(row['ratio'] for row in rows):.2f}**"
        mean_of_first = f"**{geometric_mean(first_ratios):.2f}**" if first_ratios else ""
        means.append(["geometric mean", str(spp), "", "", mean, "", mean_of_first])
    about = f"On {result['machine']}, {result['cores']} cores; pictures of {result['size']} x {result['size']} pixels."
    return f"{about}\n\n{table([*head, 'Mitsuba / wrt'], [*lines, *means])}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--scenes", nargs="+", choices=list(FILES), default=list(FILES), metavar="NAME")
    parser.add_argument("--folder", type=Path, help=f"a checkout of {SOURCE} (default: clone it)")
    parser.add_argument("--cache", type=Path, metavar="FOLDER", help="wrt's cache (default: an empty one)")
    parser.add_argument("--spp", nargs="+", type=int, default=[64, 512])
    parser.add_argument("--size", type=int, default=384, help="pixels on each side (default: 384)")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
