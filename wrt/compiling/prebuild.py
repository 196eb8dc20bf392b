"""Make the kernels that come compiled with the package (see `wrt.backend.prebuilt`), for one level of x86-64.

`scripts/build_wheel.py` makes them for wheels. In a checkout, `python -m wrt.compiling.prebuild` makes those of this
processor.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wrt.backend import cache_folders, current_backend, prebuilt, processor
from wrt.backend.artefacts import Artefacts
from wrt.backend.backend import FLAGS, Kernel
from wrt.backend.device import Device
from wrt.backend.kernel_cache import DIGEST
from wrt.compiling import general, later
from wrt.compiling.kernel import SCALAR, compile_kernel


def flags_of(level: str) -> str:
    """Return Warp's flags for compiling for all processors of a level, instead of for this one."""
    return FLAGS.replace("-march=native", f"-target-cpu x86-64-{level}")


def variants(lanes: int) -> Iterator[tuple[Any, int]]:
    """Return the features and the lanes of each prebuilt render kernel."""
    from wrt.kernels.core.features import Features
    from wrt.rendering.guides import guide_features
    from wrt.scene.scene import RenderSettings

    settings = RenderSettings()
    plain = Features(("diffuse",), False, "none", sampler=settings.sampler)
    for features in general.general_features(plain):
        yield features, lanes
    for features in general.general_features(guide_features(plain, settings)):
        yield features, SCALAR


def compile_modules(device: Device) -> None:
    """Compile the kernels that do not depend on a scene, and put all constants and structs into the table."""
    package = importlib.import_module("wrt.kernels")
    for module in pkgutil.walk_packages(package.__path__, "wrt.kernels."):
        names = vars(importlib.import_module(module.name))
        attributes = device.backend.kernels(module.name)
        for name in [name for name in names if not name.startswith("_")]:
            value = getattr(attributes, name, None)
            if isinstance(value, Kernel) and value.module.startswith("wrt."):
                device.compile(value)


def build(level: str) -> None:
    """Compile everything for a level into this process's cache."""
    import warp as wp

    backend = current_backend()
    backend.flags = wp.config.cpu_compiler_flags = flags_of(level)
    device = Device("cpu")
    compile_modules(device)
    for features, lanes in variants(prebuilt.LANES[level]):
        compile_kernel(features, lanes)
    general.exercise(device)


def publish(level: str) -> int:
    """Copy what this process has compiled into the package's folder of a level; return the bytes that it takes."""
    artefacts = current_backend().artefacts
    folder, written = prebuilt.FOLDER / level, {prebuilt.table_path(level, artefacts.code)}
    folder.mkdir(parents=True, exist_ok=True)
    for entry in artefacts.table["files"].values():
        for file in (entry["file"], entry["file"] + DIGEST):
            written.add(target := folder / Path(file).name)
            cache_folders.put(target, Path(file).read_bytes())
    prebuilt.write_prebuilt(level, artefacts.code, artefacts.table)
    for stale in {*folder.iterdir()} - written:
        stale.unlink()
    return sum(path.stat().st_size for path in written)


def main(arguments: list[str]) -> int:
    """Make the kernels of a level, by default of this processor; they replace those that are there."""
    parser = argparse.ArgumentParser(prog="python -m wrt.compiling.prebuild", description=__doc__)
    flags = processor.processor_flags()
    fitting = [level for level, needed in prebuilt.NEEDED.items() if flags >= needed]
    parser.add_argument("level", nargs="?", choices=fitting, default=fitting[0] if fitting else None)
    level = parser.parse_args(arguments[1:]).level
    if level is None:
        print("this processor has no prebuilt kernels; those of its own are compiled on first use")
        return 0
    if prebuilt.table_path(level, Artefacts().code).exists():
        return 0
    cache = tempfile.mkdtemp()
    try:
        os.environ |= {"XDG_CACHE_HOME": cache, prebuilt.SWITCH: "0", later.SWITCH: "0"}
        os.environ |= {processor.SWITCH: str(prebuilt.LANES[level]), "WARP_CACHE_PATH": f"{cache}/warp"}
        build(level)
        size = publish(level)
    finally:
        shutil.rmtree(cache)
    print(f"{prebuilt.FOLDER / level}: {size / 1e6:.1f} MB of kernels for x86-64-{level}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
