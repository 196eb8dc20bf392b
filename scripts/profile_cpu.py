"""Profile rendering on the CPU by phase: traversal, shading, lights, random numbers, film, launches, Python.

    python scripts/profile_cpu.py [--scenes NAME ...] [--seconds S] [--functions N] [--threads N] [--docs] [--json FILE]

Needs perf (Debian: linux-perf; Ubuntu: linux-tools-generic) and addr2line (binutils). Linux only. The kernel is
compiled with line information, which does not change its code. perf samples each thread a thousand times a second, and
the functions inlined at an address tell its file in kernels/. Scenes are those of
scripts/benchmarks/scenes.py, or files.
"""

from __future__ import annotations

import argparse
import ast
import bisect
import collections
import ctypes
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.measure import machine
from benchmarks.report import write_documents
from benchmarks.scenes import CASES, ROOT, Budget

KERNELS = ROOT / "kernels"

PHASES: dict[str, tuple[str, ...]] = {
    "traversal": ("accel", "geometry/triangles", "geometry/motion"),
    "surface and material": (
        "bsdf",
        "microfacet",
        "textures",
        "scene/materials",
        "geometry/surface",
        "geometry/spheres",
        "geometry/quadrics",
    ),
    "lights": ("lights", "integrators/next_event", "sampling/cylinder", "sampling/piecewise", "sampling/solid_angle"),
    "media": ("media",),
    "random numbers": ("sampling/sampler", "sampling/low_discrepancy"),
    "path": ("integrators",),
    "camera and film": ("render", "camera", "film", "integrators/first_surface"),
}
"""Files and folders of kernels/ by phase; the longest name counts."""

WIDE_TRAVERSAL = ("follow_alone", "follow_together", "found", "set_out")
"""Functions of C++ in kernels/native/lanes/rays.h."""

HELPERS = (
    "features",
    "registry",
    "specialise",
    "spmd_marks",
    "math",
    "native",
    "sampling/bilinear",
    "sampling/warps",
    "scene/scene_data",
    "geometry/rays",
)
"""Helpers, whose time counts for their callers."""

OTHER_KERNELS = ("geometry/mesh_normals", "geometry/vertex_normals", "regeneration")
"""Files that no render kernel of a CPU uses."""

HOST = {
    "Python": ("python", "libpython", "_multiarray", "numpy", ".py", "libopenblas"),
    "Warp": ("warp.so", "warp-clang.so"),
    "system": ("[kernel", "[vdso", "libc", "libm.", "ld-linux", "libpthread", "[guest"),
}
"""Phases outside kernels, by parts of the names of libraries."""

LINES = " -debug-info-kind=line-tables-only -dwarf-version=4"
"""Flags of clang for line information."""

FREQUENCY = 997
"""Samples per second."""


class ProfileError(Exception):
    """A program is missing; the message says how to get it."""


def rendering(scene: str, size: int, threads: int | None) -> None:
    """Render a scene until standard input ends, after printing where its kernel is. Runs in its own process."""
    import warp as wp

    from wrt.backend.warp_start import initialize_warp

    initialize_warp()
    wp.config.cpu_compiler_flags = (wp.config.cpu_compiler_flags or "") + LINES
    import wrt

    described = CASES[scene].scene(size, Budget()) if scene in CASES else wrt.load(scene)
    renderer = wrt.Renderer(described, width=size, height=size, threads=threads)
    renderer.compile()
    passes = renderer.passes(time=1e6)
    for progress in passes:
        if progress.seconds > 1.0:  # threads have started, passes have their final size
            break
    kernel = renderer._kernel.in_use
    (loaded,) = kernel.module.execs.values()
    address = ctypes.cast(loaded.get_kernel_hooks(kernel).forward, ctypes.c_void_p).value
    started = {"address": address, "object": str(loaded.binary_path), "kernel": kernel.get_mangled_name()}
    print(json.dumps(started), flush=True)
    import threading

    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    for _ in passes:
        if ended.is_set():
            return


def sampled(scene: str, options: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], list[tuple[int, str]]]:
    """Return where a scene's kernel is, and perf's samples while it rendered: addresses and libraries."""
    line = [sys.executable, __file__, "--render", scene, "--size", str(options.size)]
    if options.threads:
        line += ["--threads", str(options.threads)]
    data = folder / "perf.data"
    with subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        said = process.stdout.readline()
        if not said:
            raise ProfileError(f"{scene}: the process that renders ended")
        started: dict[str, Any] = json.loads(said)
        record = ["perf", "record", "-q", "-e", "cpu-clock", "-F", str(FREQUENCY), "-p", str(process.pid)]
        run(*record, "-o", str(data), "--", "sleep", str(options.seconds))
        process.stdin.close()
    found = []
    for text in run("perf", "script", "-i", str(data), "-F", "ip,dso").splitlines():
        if parts := re.match(r"\s*([0-9a-f]+)\s+\((.*)\)", text):
            found.append((int(parts[1], 16), parts[2]))
    return started, found


def run(*command: str, given: str | None = None) -> str:
    """Return the output of a program.

    Raises:
        ProfileError: where it fails, with what it complains of.
    """
    done = subprocess.run(command, input=given, capture_output=True, text=True)
    if done.returncode:
        raise ProfileError(f"{' '.join(command[:2])}: {(done.stderr or done.stdout).strip()}")
    return done.stdout


def place_of(kernel: str, object_file: str) -> tuple[str, int, int]:
    """Return the section of a kernel's entry in an object file, its offset there, and the section's length."""
    symbols = run("objdump", "-t", object_file)
    found = re.search(rf"^([0-9a-f]+) .* (\.\S+)\s+[0-9a-f]+ {re.escape(kernel)}_cpu_forward$", symbols, re.MULTILINE)
    if found is None:
        raise ProfileError(f"{object_file}: no {kernel}_cpu_forward; has Warp changed its names?")
    sections = run("objdump", "-h", object_file)
    length = re.search(rf"^\s*\d+ {re.escape(found[2])}\s+([0-9a-f]+)", sections, re.MULTILINE)
    assert length is not None
    return found[2], int(found[1], 16), int(length[1], 16)


def inlined(object_file: str, section: str, offsets: Sequence[int]) -> Iterator[tuple[int, list[str]]]:
    """Return for each offset its functions of kernels/, from the innermost outwards.

    By the lines of the C++ that Warp wrote: what lies in its headers belongs to whoever calls it.
    """
    source = Path(object_file.partition(".cpu")[0] + ".cpp")
    starts = []
    for number, line in enumerate(source.read_text(encoding="utf-8").splitlines(), 1):
        if (found := re.match(r"struct (\w+) {|[A-Za-z].*?\b(\w+)\(", line)) and not line.endswith(";"):
            name = plain_name(found[1] or found[2])
            # A helper of kernels/native/lanes may have the name of a function elsewhere, such as `load`.
            is_helper = line.startswith(("LANES_", "template")) and name not in WIDE_TRAVERSAL
            starts.append((number, f"lanes::{name}" if is_helper else name))
    text = run(
        *("addr2line", "-a", "-i", "-e", object_file, "-j", section),
        given="".join(f"{offset:x}\n" for offset in offsets),
    )
    for block in re.split(r"^0x", text, flags=re.MULTILINE)[1:]:
        lines = block.splitlines()
        chain = []
        for place in lines[1:]:
            if found := re.search(r"\.cpp:(\d+)", place):
                chain.append(starts[bisect.bisect(starts, (int(found[1]), "~")) - 1][1])
        yield int(lines[0], 16), chain


def plain_name(symbol: str) -> str:
    """Return the name of a function in kernels/ from Warp's name of it."""
    name = symbol.rpartition("__locals__")[2]
    name = name.removeprefix("wide_")
    name = re.sub(r"(_[0-9a-f]{8})?_cpu_(kernel_)?forward(_tasks|_dispatch)?$", "", name)
    return re.sub(r"_\d+$", "", name)


def phase_of_file(path: Path) -> str | None:
    """Return the phase of a file of kernels/; None for helpers and for files that no render kernel uses.

    Raises:
        ProfileError: where the file is not accounted for.
    """
    name = path.relative_to(KERNELS).with_suffix("").as_posix()
    phases: dict[str, str | None] = {part: phase for phase, parts in PHASES.items() for part in parts}
    phases |= dict.fromkeys((*HELPERS, *OTHER_KERNELS))
    known = [part for part in phases if name == part or name.startswith(f"{part}/")]
    if not known and path.name != "__init__.py":
        raise ProfileError(f"{path}: not in PHASES of scripts/profile_cpu.py")
    return phases[max(known, key=len)] if known else None


def phases_of_functions() -> dict[str, str]:
    """Return the phase of every function in kernels/ by its name; functions of helpers have none."""
    found = dict.fromkeys(WIDE_TRAVERSAL, "traversal")
    for path in sorted(KERNELS.rglob("*.py")):
        phase = phase_of_file(path)
        if phase is not None:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    found[node.name] = phase
    return found


def host_phase(library: str) -> str:
    """Return the phase of an address outside the kernel."""
    for phase, parts in HOST.items():
        if any(part in library for part in parts):
            return phase
    return "everything else"


def shares(
    samples: Iterable[tuple[int, str]], started: dict[str, Any], functions: dict[str, str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the share of each phase, and of each function that has a phase, among all samples."""
    section, entry, length = place_of(started["kernel"], started["object"])
    base = started["address"] - entry
    inside: collections.Counter[int] = collections.Counter()
    phases: collections.Counter[str] = collections.Counter()
    by_function: collections.Counter[str] = collections.Counter()
    for address, library in samples:
        if 0 <= address - base < length:
            inside[address - base] += 1
        else:
            phases[host_phase(library)] += 1
    for offset, chain in inlined(started["object"], section, list(inside)):
        name = next((name for name in chain if name in functions), None)
        phases["everything else" if name is None else functions[name]] += inside[offset]
        by_function[name or "in no function"] += inside[offset]
    total = sum(phases.values())
    if total == 0:
        raise ProfileError("perf saw nothing")
    return {name: n / total for name, n in phases.items()}, {name: n / total for name, n in by_function.most_common()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = ["cornell", "cornell-glossy", "bunny", "mountains", "lanterns", "textured", "fog"]
    parser.add_argument("--scenes", nargs="+", metavar="NAME", default=default, help="names, or scene files")
    parser.add_argument("--seconds", type=float, default=10.0, help="sampling time for each scene")
    parser.add_argument(
        "--functions", type=int, default=0, metavar="N", help="number of functions to list for each scene"
    )
    parser.add_argument("--size", type=int, default=512, help="width and height in pixels")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--docs", action="store_true", help="write docs/measured and docs/notes/profile.md")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--render", metavar="NAME", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.render:
        rendering(options.render, options.size, options.threads)
        return 0
    try:
        for tool, package in (("perf", "linux-perf (Ubuntu: linux-tools-generic)"), ("addr2line", "binutils")):
            if shutil.which(tool) is None:
                raise ProfileError(f"{tool} was not found: apt-get install {package}")
        functions = phases_of_functions()
        rows = []
        for scene in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                started, samples = sampled(scene, options, Path(folder))
            phases, by_function = shares(samples, started, functions)
            rows.append({"scene": scene, "samples": len(samples), "phases": phases, "functions": by_function})
            text = ", ".join(
                f"{name} {100.0 * share:.1f} %" for name, share in sorted(phases.items(), key=lambda x: -x[1])
            )
            print(f"{scene}, {len(samples)} samples: {text}", flush=True)
            for name, share in list(by_function.items())[: options.functions]:
                print(f"  {100.0 * share:5.1f} %  {name}", flush=True)
    except ProfileError as error:
        print(f"profile_cpu: error: {error}", file=sys.stderr)
        return 2
    result = {"benchmark": "profile", **machine(), "rows": rows}
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if options.docs:
        write_documents(result, {})
    return 0


if __name__ == "__main__":
    sys.exit(main())
