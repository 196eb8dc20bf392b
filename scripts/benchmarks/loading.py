"""`loading`: from the shell to the first picture, beside Mitsuba: five million triangles, OBJ, a small scene."""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from peers.peer import LLVM_HINT, PEERS, Environments
from peers.ply_files import write_ply

import wrt
from benchmarks.measure import ROOT, Row, run_in_turn, table
from wrt.meshes.many_triangles import terrain

PICTURE = ("--size", "512x512", "--spp", "1", "--quiet", "-o", "wrt.png", "--force")

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


def bumpy_sphere(folder: Path) -> tuple[str, str]:
    """Write a sphere with hills as PLY: 5,242,880 triangles, whose neighbours are far apart in the file."""
    sphere = wrt.sphere(subdivisions=9)
    x, y, z = sphere.vertices.T
    radius = 1.0 + 0.15 * np.sin(9.0 * x) * np.sin(11.0 * y) * np.sin(7.0 * z) + 0.01 * np.sin(80.0 * x + 90.0 * y)
    write_ply(wrt.Mesh(sphere.vertices * radius[:, None], sphere.faces), folder / "sphere.ply")
    return "sphere.ply", "1.4, 1.2, 3.2"


def mountains(folder: Path) -> tuple[str, str]:
    """Write mountains as PLY: five million triangles, row by row."""
    mesh = terrain(5_000_000)
    write_ply(wrt.Mesh(mesh.vertices, mesh.faces), folder / "mountains.ply")
    return "mountains.ply", "2500, 2500, 4500"


def mountains_as_text(folder: Path) -> tuple[str, str]:
    """Write mountains as OBJ: a million triangles."""
    mesh = terrain(1_000_000)
    with (folder / "mountains.obj").open("w", encoding="ascii") as file:
        file.writelines(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in mesh.vertices.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist())
    return "mountains.obj", "2500, 2500, 4500"


CASES: dict[str, tuple[str, Callable[[Path], tuple[str, str]] | None]] = {
    "sphere": ("PLY, a sphere of 5.2 M triangles in no order", bumpy_sphere),
    "mountains": ("PLY, mountains of 5 M triangles in rows", mountains),
    "obj": ("OBJ, mountains of 1 M triangles", mountains_as_text),
    "cornell": ("the Cornell box", None),
}
"""Title in the table, and what writes the file and returns its name and where Mitsuba's camera is."""


def benchmark(options: argparse.Namespace) -> Row:
    """Return medians of each program's seconds and memory, run in turn."""
    mitsuba = importlib.util.find_spec("mitsuba") is not None and not options.alone
    variables = Environments(llvm=options.llvm).variables(PEERS["mitsuba-llvm"]) | {"PYTHONPATH": str(ROOT)}
    rows = []
    for name in options.cases:
        with tempfile.TemporaryDirectory() as temporary:
            programs = commands(CASES[name][1], Path(temporary), mitsuba)
            medians = run_in_turn(programs, options.repeats, Path(temporary), variables)
        rows.append({"case": name, "programs": medians})
        print(f"{name}: wrt {medians['wrt']['seconds']:.2f} s", flush=True)
    return {"benchmark": "loading", "repeats": options.repeats, "rows": rows}


def commands(make: Callable[[Path], tuple[str, str]] | None, folder: Path, mitsuba: bool) -> dict[str, list[str]]:
    """Return the command that starts each program, once the files are written."""
    ours = [sys.executable, "-m", "wrt", "render"]
    if make is None:
        file, theirs = "cornell-box", [sys.executable, "-c", CORNELL]
    else:
        # In a process of its own: a program that this one starts would inherit its peak memory.
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            file, origin = pool.submit(make, folder).result()
        scene = folder / "scene.xml"
        scene.write_text(SCENE.format(kind=Path(file).suffix[1:], file=file, origin=origin), encoding="utf-8")
        program = shutil.which("mitsuba", path=str(Path(sys.executable).parent)) or "mitsuba"
        theirs = [program, "-m", "llvm_ad_rgb", "-o", "mitsuba.exr", str(scene)]
    return {"wrt": [*ours, file, *PICTURE]} | ({"mitsuba": theirs} if mitsuba else {})


def text(result: Row) -> str:
    """Return the results as a table."""
    lines = []
    for row in result["rows"]:
        for program, found in row["programs"].items():
            seconds = [f"{found[key]:.2f}" for key in ("seconds", "cpu_seconds")]
            lines.append([CASES[row["case"]][0], program, *seconds, f"{found['peak_bytes'] / 1e6:.0f}"])
    return table(["file", "program", "seconds", "of CPU", "MB"], lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
    parser.add_argument("--alone", action="store_true", help="without Mitsuba")
