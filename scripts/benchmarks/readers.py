"""`readers`: seconds of CPU that reading a large file takes, beside trimesh's loader and other checkouts of wrt."""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from benchmarks.loading import write_ply
from benchmarks.measure import ROOT
from wrt.io.gltf.writer import save_glb
from wrt.meshes.many_triangles import terrain

BY_WRT = "import wrt; load = wrt.load"
BY_TRIMESH = "import trimesh; load = lambda file: trimesh.load(file, process=False)"
WORKER = """\
import sys, time
import numpy, trimesh
{program}
start = time.process_time()
kept = load(sys.argv[1])
print(time.process_time() - start)
"""
"""Both programs find trimesh imported, which wrt loads too."""


def ply(folder: Path, mesh: wrt.Mesh) -> Path:
    """Write a binary PLY file."""
    write_ply(folder / "mesh.ply", mesh.vertices, mesh.faces)
    return folder / "mesh.ply"


def obj(folder: Path, mesh: wrt.Mesh) -> Path:
    """Write an OBJ file with normals."""
    up = np.broadcast_to(np.float32((0.0, 1.0, 0.0)), mesh.vertices.shape)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in up]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in mesh.faces + 1]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n", "ascii")
    return folder / "mesh.obj"


def stl(folder: Path, mesh: wrt.Mesh) -> Path:
    """Write a binary STL file."""
    rows = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    rows["corners"] = mesh.vertices[mesh.faces]
    rows["normal"] = (0.0, 1.0, 0.0)
    (folder / "mesh.stl").write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
    return folder / "mesh.stl"


def off(folder: Path, mesh: wrt.Mesh) -> Path:
    """Write an OFF file."""
    lines = ["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [f"{x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    (folder / "mesh.off").write_text("\n".join(lines) + "\n", "ascii")
    return folder / "mesh.off"


def glb(folder: Path, mesh: wrt.Mesh) -> Path:
    """Write a GLB file with normals."""
    save_glb(folder / "mesh.glb", wrt.Scene([wrt.Shape(mesh, wrt.Principled())]))
    return folder / "mesh.glb"


WRITERS: dict[str, Callable[[Path, wrt.Mesh], Path]] = {"ply": ply, "obj": obj, "stl": stl, "off": off, "glb": glb}


def cpu_seconds(program: str, file: Path, checkout: Path) -> float:
    """Return the seconds of CPU that loading takes in a process of its own."""
    variables = os.environ | {"PYTHONPATH": str(checkout)}
    command = [sys.executable, "-W", "ignore", "-c", WORKER.format(program=program), str(file)]
    found = subprocess.run(command, capture_output=True, text=True, env=variables, check=True, cwd=file.parent)
    return float(found.stdout.splitlines()[-1])


def benchmark_readers(options: argparse.Namespace) -> dict[str, Any]:
    """Return medians of seconds of CPU, of loads in turn, and of the ratios of neighbours in that turn."""
    for checkout in options.checkouts:
        if not (checkout / "wrt" / "__init__.py").is_file():
            raise SystemExit(f"{checkout}: no checkout of wrt")
    programs = {"trimesh": (BY_TRIMESH, ROOT)}
    programs |= {str(checkout): (BY_WRT, checkout.resolve()) for checkout in options.checkouts}
    rows = []
    print("| file | MB | wrt | beside | seconds | ratio | quartiles |\n| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as temporary:
        mesh = terrain(options.triangles)
        for name in options.formats:
            file = WRITERS[name](Path(temporary), mesh)
            runs = []
            for _ in range(1 + options.repeats):
                own = cpu_seconds(BY_WRT, file, ROOT)
                runs.append({"wrt": own} | {key: cpu_seconds(code, file, at) for key, (code, at) in programs.items()})
            own = statistics.median(run["wrt"] for run in runs[1:])
            for key in programs:
                ratios = [run["wrt"] / run[key] for run in runs[1:]]
                low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75))
                theirs = statistics.median(run[key] for run in runs[1:])
                cells = [name, f"{file.stat().st_size / 1e6:.0f}", f"{own:.2f}", key, f"{theirs:.2f}", f"{ratio:.3f}"]
                print(f"| {' | '.join(cells)} | {low:.2f} to {high:.2f} |", flush=True)
                rows.append({"format": name, "beside": key, "wrt": own, "other": theirs, "ratio": float(ratio)})
            file.unlink()
    return {"benchmark": "readers", "triangles": options.triangles, "repeats": options.repeats, "rows": rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("checkouts", type=Path, nargs="*", metavar="FOLDER", help="other checkouts of wrt")
    parser.add_argument("--formats", nargs="+", choices=list(WRITERS), default=list(WRITERS), metavar="NAME")
    parser.add_argument("--triangles", type=int, default=500_000)
    parser.add_argument("--repeats", type=int, default=5)
