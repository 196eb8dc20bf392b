"""`loading`: from the shell to the first picture, beside Mitsuba: five million triangles, OBJ, a small scene."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from peers.peer import LLVM_HINT, PEERS, Environments

import wrt
from benchmarks.measure import ROOT
from wrt.meshes.many_triangles import terrain

PICTURE = ("--size", "512x512", "--spp", "1", "--quiet")

SCENE = """\
<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="64"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="{origin}" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="512"/><integer name="height" value="512"/></film>
    <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
  </sensor>
  <emitter type="constant"/>
  <shape type="{kind}"><string name="filename" value="{file}"/><bsdf type="diffuse"/></shape>
</scene>
"""

CORNELL = """\
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.cornell_box()
scene["sensor"]["film"] |= {"width": 512, "height": 512}
mi.util.write_bitmap("mitsuba.png", mi.render(mi.load_dict(scene), spp=1))
"""


class Case(NamedTuple):
    """What is rendered.

    Attributes:
        title: in the table.
        make: what writes its file into a folder and returns the file's name and where Mitsuba's camera is; None for
            the Cornell box.
    """

    title: str
    make: Callable[[Path], tuple[str, str]] | None


def bumpy_sphere(folder: Path) -> tuple[str, str]:
    """Write a sphere with hills as PLY: 5,242,880 triangles, whose neighbours are far apart in the file."""
    sphere = wrt.sphere(subdivisions=9)
    x, y, z = sphere.vertices.T
    radius = 1.0 + 0.15 * np.sin(9.0 * x) * np.sin(11.0 * y) * np.sin(7.0 * z) + 0.01 * np.sin(80.0 * x + 90.0 * y)
    write_ply(folder / "sphere.ply", sphere.vertices * radius[:, None].astype(np.float32), sphere.faces)
    return "sphere.ply", "1.4, 1.2, 3.2"


def mountains(folder: Path) -> tuple[str, str]:
    """Write mountains as PLY: five million triangles, row by row."""
    mesh = terrain(5_000_000)
    write_ply(folder / "mountains.ply", mesh.vertices, mesh.faces)
    return "mountains.ply", "2500, 2500, 4500"


def mountains_as_text(folder: Path) -> tuple[str, str]:
    """Write mountains as OBJ: a million triangles."""
    mesh = terrain(1_000_000)
    with (folder / "mountains.obj").open("w", encoding="ascii") as file:
        file.writelines(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in mesh.vertices.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist())
    return "mountains.obj", "2500, 2500, 4500"


CASES = {
    "sphere": Case("PLY, a sphere of 5.2 M triangles in no order", bumpy_sphere),
    "mountains": Case("PLY, mountains of 5 M triangles in rows", mountains),
    "obj": Case("OBJ, mountains of 1 M triangles", mountains_as_text),
    "cornell": Case("the Cornell box", None),
}


def write_ply(path: Path, points: np.ndarray, faces: np.ndarray) -> None:
    """Write a little-endian binary PLY of positions and triangles."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    path.write_bytes(header.encode("ascii") + points.astype("<f4").tobytes() + rows.tobytes())


def commands(case: Case, folder: Path, mitsuba: bool) -> dict[str, list[str]]:
    """Return what each program is started by, once the files are written."""
    own = [sys.executable, "-m", "wrt", "render"]
    if case.make is None:
        found = {"wrt": [*own, "cornell-box", *PICTURE, "-o", "wrt.png"]}
        return found | ({"mitsuba": [sys.executable, "-c", CORNELL]} if mitsuba else {})
    # In a process of its own: what this one holds, programs started from it would be said to have held.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        file, origin = pool.submit(case.make, folder).result()
    found = {"wrt": [*own, file, *PICTURE, "-o", "wrt.png"]}
    if mitsuba:
        scene = folder / "scene.xml"
        scene.write_text(SCENE.format(kind=Path(file).suffix[1:], file=file, origin=origin), encoding="utf-8")
        program = shutil.which("mitsuba", path=str(Path(sys.executable).parent)) or "mitsuba"
        found["mitsuba"] = [program, "-m", "llvm_ad_rgb", "-o", "mitsuba.exr", str(scene)]
    return found


def run(command: list[str], folder: Path, variables: dict[str, str]) -> dict[str, float]:
    """Return wall seconds, seconds of CPU and peak bytes of a program that is run to its end.

    Raises:
        RuntimeError: with what it said last, where it fails.
    """
    with (folder / "log").open("w+", encoding="utf-8", errors="replace") as log:
        start = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, env=variables, stdout=log, stderr=log)
        _, status, used = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            log.seek(0)
            raise RuntimeError(f"{command[0]} ended with {process.returncode}: {log.read()[-500:]}")
    return {"seconds": seconds, "cpu_seconds": used.ru_utime + used.ru_stime, "peak_bytes": 1024.0 * used.ru_maxrss}


def benchmark_loading(options: argparse.Namespace) -> dict[str, Any]:
    """Return medians of each program's seconds and memory, run in turn after a run that fills their caches."""
    mitsuba = importlib.util.find_spec("mitsuba") is not None and not options.alone
    variables = Environments(llvm=options.llvm).variables(PEERS["mitsuba-llvm"])
    variables["PYTHONPATH"] = str(ROOT)
    rows = []
    print("| what | program | seconds | of CPU | MB | seconds, wrt / Mitsuba | of CPU | MB |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in options.cases:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            programs = commands(CASES[name], folder, mitsuba)
            runs: dict[str, list[dict[str, float]]] = {program: [] for program in programs}
            for repeat in range(1 + options.repeats):
                for program, command in programs.items():
                    found = run(command, folder, variables)
                    if repeat > 0:
                        runs[program].append(found)
        medians = {
            program: {key: statistics.median(each[key] for each in found) for key in found[0]}
            for program, found in runs.items()
        }
        row: dict[str, Any] = {"case": name, "programs": medians}
        if "mitsuba" in medians:
            row["ratios"] = {key: value / medians["mitsuba"][key] for key, value in medians["wrt"].items()}
        rows.append(row)
        print_row(CASES[name].title, medians, row.get("ratios", {}))
    return {"benchmark": "loading", "repeats": options.repeats, "rows": rows}


def print_row(title: str, medians: dict[str, dict[str, float]], ratios: dict[str, float]) -> None:
    """Print the table's lines of a case."""
    for program, found in medians.items():
        seconds = [f"{found[key]:.2f}" for key in ("seconds", "cpu_seconds")]
        cells = [title, program, *seconds, f"{found['peak_bytes'] / 1e6:.0f}"]
        cells += [f"{ratio:.2f}" for ratio in ratios.values()] if program == "wrt" and ratios else [""] * 3
        print(f"| {' | '.join(cells)} |", flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
    parser.add_argument("--alone", action="store_true", help="without Mitsuba")
