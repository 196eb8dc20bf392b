"""Report the registers and local memory of every kernel on CUDA. No GPU is needed.

    pip install nvidia-cuda-cuobjdump    # reads the output of Warp's compiler
    pip install nvidia-cuda-nvcc         # optional: its ptxas reports spills separately
    python scripts/cuda_registers.py [--arch N ...] [--kernels TEXT ...] [--json FILE]

Registers limit the number of threads on a multiprocessor. The stack is in local memory, which is cached device memory;
it holds arrays indexed at run time and registers that did not fit (spills).
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import warp as wp

import wrt
import wrt.kernels
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.features import Features
from wrt.kernels.regeneration import make_gpu_render_kernel
from wrt.scene.materials import MATERIALS

CPU_ONLY = {"trace_packets", "trace_interleaved"}
"""Kernels that are never launched on CUDA."""

REGISTERS_PER_SM = 65536
MOST_THREADS = {75: 1024, 80: 2048, 86: 1536, 89: 1536, 90: 2048, 100: 2048, 120: 1536}
"""Limits of a multiprocessor by architecture (CUDA C++ Programming Guide, technical specifications)."""

BLOCK = 256
"""Threads per block, Warp's default."""


EIGHT = (
    *("conductor", "dielectric", "diffuse", "plastic", "principled"),
    *("rough_conductor:ggx:smith:conductor", "rough_dielectric:ggx:smith", "rough_plastic:ggx:smith"),
)
"""What a scene may well have."""


def render_features() -> dict[str, Features]:
    """Return sets of scene features, from the fewest to all."""
    models = {each.model for each in (cls.example() for cls in MATERIALS.values()) if not each.parts}
    return {
        "diffuse": Features(("diffuse",), False, "none"),
        "four models": Features(("conductor", "dielectric", "diffuse", "mirror"), True, "image"),
        "eight models": Features(EIGHT, True, "image"),
        "everything": Features(tuple(sorted(models)), True, "image", opacity=True, tangents=True),
    }


def all_kernels() -> Iterator[tuple[str, wp.Kernel]]:
    """Return the kernels of the package by name: those of modules, then the renderer's."""
    for found in pkgutil.walk_packages(wrt.kernels.__path__, "wrt.kernels."):
        module = importlib.import_module(found.name)
        for name, value in vars(module).items():
            if isinstance(value, wp.Kernel) and value.func.__module__ == found.name and name not in CPU_ONLY:
                yield f"{found.name.removeprefix('wrt.kernels.')}.{name}", value
    for name, features in render_features().items():
        yield f"render.render_pass ({name})", make_gpu_render_kernel(features, regenerates=False)
        yield f"regeneration.render_pass ({name})", make_gpu_render_kernel(features)


def find_tool(name: str, package: str) -> str | None:
    """Return the path of a program of the CUDA toolkit, from its package, or from the PATH, where it may be old."""
    try:
        inside = [str(file.locate()) for file in files(package) or [] if file.name in (name, f"{name}.exe")]
    except PackageNotFoundError:
        inside = []
    return next(iter(inside), None) or shutil.which(name)


def run(*command: str) -> str:
    """Return the output of a program, or exit with its error message."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{Path(command[0]).name}: {(done.stderr or done.stdout).strip()}")
    return done.stdout + done.stderr


def resources(module: wp.Module, arch: int, cuobjdump: str, ptxas: str | None) -> dict[str, dict[str, int]]:
    """Return registers, stack bytes and spilled bytes by the mangled names of a module's kernels."""
    found: dict[str, dict[str, int]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cubin = wp.compile_aot_module(module, arch=arch, use_ptx=False, module_dir=Path(folder))[0]
        text = run(cuobjdump, "--dump-resource-usage", str(cubin))
        for name, registers, stack in re.findall(r"Function (\w+):\s+REG:(\d+) STACK:(\d+)", text):
            found[name] = {"registers": int(registers), "stack": int(stack)}
        if ptxas:
            ptx = wp.compile_aot_module(module, arch=arch, use_ptx=True, module_dir=Path(folder))[0]
            ptx.write_bytes(ptx.read_bytes().rstrip(b"\0"))
            text = run(ptxas, f"-arch=sm_{arch}", "-v", str(ptx), "-o", str(cubin))
            spilled = r"properties for (\w+)\s+\d+ bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads"
            for name, stores, loads in re.findall(spilled, text):
                found[name] |= {"spill_stores": int(stores), "spill_loads": int(loads)}
    return found


def resident_threads(registers: int, arch: int) -> int:
    """Return the number of threads on a multiprocessor at a time, as limited by registers."""
    per_warp = 32 * (-(-registers // 8) * 8)
    blocks = REGISTERS_PER_SM // per_warp // (BLOCK // 32)
    return min(blocks * BLOCK, MOST_THREADS.get(arch, 2048))


def main() -> None:
    """Run the command line: compile, print a table and save it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arch", type=int, nargs="+", default=[75, 90])
    parser.add_argument("--kernels", nargs="+", help="only kernels whose names contain one of these texts")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cuobjdump = find_tool("cuobjdump", "nvidia-cuda-cuobjdump")
    ptxas = find_tool("ptxas", "nvidia-cuda-nvcc")
    if cuobjdump is None:
        sys.exit("cuobjdump was not found: pip install nvidia-cuda-cuobjdump")
    initialize_warp()
    kernels = [
        (name, kernel)
        for name, kernel in all_kernels()
        if not options.kernels or any(text in name for text in options.kernels)
    ]
    rows: list[dict[str, Any]] = []
    print("| kernel | sm | registers | stack, bytes | spilled, bytes | threads a multiprocessor |")
    print("| --- | --- | --- | --- | --- | --- |")
    for arch in options.arch:
        compiled: dict[str, dict[str, dict[str, int]]] = {}
        for name, kernel in kernels:
            module = kernel.module
            start = time.perf_counter()
            if module.name not in compiled:
                compiled[module.name] = resources(module, arch, cuobjdump, ptxas)
                print(f"{module.name}, sm_{arch}: {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
            used = compiled[module.name][f"{kernel.get_mangled_name()}_cuda_kernel_forward"]
            threads = resident_threads(used["registers"], arch)
            rows.append({"kernel": name, "arch": arch, "threads_per_multiprocessor": threads, **used})
            spilled = used.get("spill_stores", "")
            print(f"| `{name}` | {arch} | {used['registers']} | {used['stack']} | {spilled} | {threads} |", flush=True)
    if options.json:
        toolkit = ".".join(map(str, wp.get_cuda_toolkit_version()))
        result = {"wrt": wrt.__version__, "warp": wp.__version__, "toolkit": toolkit, "rows": rows}
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
