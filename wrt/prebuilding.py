"""Make the kernels that come compiled with the package (see `wrt.backend.prebuilt`), for one level of x86-64.

`scripts/build_wheel.py` makes them for wheels; `scripts/demo` those of most use for this processor, in a checkout.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import os
import pkgutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from wrt.backend import cache_folders, current_backend, prebuilt, processor
from wrt.backend.backend import FLAGS, Kernel
from wrt.backend.device import Device
from wrt.backend.fingerprint import digest_of_code
from wrt.backend.kernel_cache import DIGEST
from wrt.compiling import general, later
from wrt.compiling.kernel import SCALAR, compile_kernel, is_compiled
from wrt.errors import InputError

FEW = 2
"""Kernels that a checkout gets by itself, in 120 s of CPU: the fastest and the most general for meshes."""


def flags_of(level: str) -> str:
    """Return Warp's flags for compiling for all processors of a level, instead of for this one."""
    return FLAGS.replace("-march=native", f"-target-cpu x86-64-{level}")


def variants(lanes: int) -> list[tuple[Any, int]]:
    """Return the features and the lanes of each prebuilt render kernel; the first FEW are of most use."""
    from wrt.kernels.core.features import Features
    from wrt.rendering.guides import guide_features
    from wrt.scene.scene import RenderSettings

    settings = RenderSettings()
    plain = Features(("diffuse",), False, "none", sampler=settings.sampler)
    guides = guide_features(plain, settings)
    of_meshes, all_of_them, others = slice(0, None, 2), slice(None), slice(-1, None)
    chosen: tuple[tuple[Any, dict[str, Any], slice], ...] = (
        (plain, {}, of_meshes),
        (plain, {}, all_of_them),
        (guides, {}, all_of_them),
        (plain, {"aovs": True}, of_meshes),
        (plain, {"instances": "still"}, others),
        (guides, {"instances": "still"}, others),
    )
    found: dict[Any, int] = {}
    for features, changes, tiers in chosen:
        for kernel in general.general_features(dataclasses.replace(features, **changes))[tiers]:
            found.setdefault(kernel, SCALAR if kernel.guides else lanes)
    return list(found.items())


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


def build(level: str, kernels: list[tuple[Any, int]]) -> None:
    """Compile what the package lacks for a level into this process's cache."""
    import warp as wp

    backend = current_backend()
    backend.flags = wp.config.cpu_compiler_flags = flags_of(level)
    device = Device("cpu")
    compile_modules(device)
    for features, lanes in kernels:
        compile_kernel(features, lanes)
    general.exercise(device)


def publish(level: str) -> int:
    """Copy what this process has compiled into the package's folder of a level; return the folder's size in bytes.

    Raises:
        InputError: if the code has changed since.
    """
    artefacts = current_backend().artefacts
    if digest_of_code(artefacts.warp_version) != artefacts.code:
        raise InputError("the code of kernels has changed while they were compiled; run this again")
    table = {part: {**artefacts.prebuilt[part], **artefacts.table[part]} for part in artefacts.table}
    folder, kept = prebuilt.FOLDER / level, {prebuilt.table_path(level, artefacts.code)}
    folder.mkdir(parents=True, exist_ok=True)
    for entry in table["files"].values():
        for source in (Path(entry["file"]), Path(entry["file"] + DIGEST)):
            kept.add(target := folder / source.name)
            if source != target:
                cache_folders.put(target, source.read_bytes())
    prebuilt.write_prebuilt(level, artefacts.code, table)
    for stale in {*folder.iterdir()} - kept:
        stale.unlink()
    return sum(path.stat().st_size for path in kept)


def main(arguments: list[str]) -> int:
    """Make those kernels of a level, by default of this processor, that are not there yet."""
    parser = argparse.ArgumentParser(prog="python -m wrt.prebuilding", description=__doc__)
    flags = processor.processor_flags()
    fitting = [level for level, needed in prebuilt.NEEDED.items() if flags >= needed]
    parser.add_argument("level", nargs="?", choices=fitting, default=fitting[0] if fitting else None)
    beside = f"make the {FEW} of most use beside other work, unless {later.SWITCH} forbids that"
    parser.add_argument("--beside", action="store_true", help=beside)
    options = parser.parse_args(arguments[1:])
    level = options.level
    if level is None or (options.beside and not later.is_wanted()):
        return 0
    if options.beside:
        later.give_way()
    with tempfile.TemporaryDirectory() as cache:
        os.environ |= {"XDG_CACHE_HOME": cache, "WARP_CACHE_PATH": f"{cache}/warp", prebuilt.SWITCH: level}
        os.environ |= {processor.SWITCH: str(prebuilt.LANES[level]), later.SWITCH: "0"}
        kernels = variants(prebuilt.LANES[level])[: FEW if options.beside else None]
        prebuilt.FOLDER.mkdir(exist_ok=True)
        with cache_folders.locked(prebuilt.FOLDER, seconds=0.0) as is_free:
            if not is_free or all(is_compiled(*kernel) for kernel in kernels):
                return 0
            build(level, kernels)
            size = publish(level)
    print(f"{prebuilt.FOLDER / level}: {size / 1e6:.1f} MB of kernels for x86-64-{level}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
