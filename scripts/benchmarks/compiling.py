"""`compile`: seconds of CPU that each kernel costs where Warp's cache is empty."""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import os
import pkgutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from wrt.scene.materials import MATERIALS

SAMPLER = wrt.RenderSettings().sampler

LIGHT_SHAPES = ("spot", "rectangle", "disk", "sphere", "sun")

VARIANTS: dict[str, dict[str, Any]] = {
    "no environment": {},
    "an image around": {"environment": "image"},
    "textures": {"textured": True},
    "opacity and mixtures": {"opacity": True},
    "mixtures": {"composite": "mixed"},
    "two sides": {"composite": "sides"},
    "normal maps or brushed surfaces": {"tangents": True},
    "lights with shapes": {"light_shapes": LIGHT_SHAPES},
    "many lights": {"light_tree": True},
    "instances": {"instances": "still"},
    "deforming instances": {"instances": "deforming"},
    "layers": {"aovs": True},
}
"""What a kernel of one model may have besides."""

BODIES: dict[str, dict[str, Any]] = {
    "clear": {},
    "absorbing": {"media": "absorbing"},
    "scattering": {"media": "scattering"},
    "scattering, nested": {"media": "scattering", "nested": True},
}
"""What may fill bodies."""

EVERYTHING: dict[str, Any] = {
    "instances": "deforming",
    "light_shapes": LIGHT_SHAPES,
    "clamped": True,
    "regularized": True,
    "aovs": True,
    "light_tree": True,
    "media": "scattering",
    "nested": True,
    "uv2_alpha": True,
}
"""All that a path may meet beside what surfaces are."""


@dataclasses.dataclass(frozen=True)
class Wide:
    """The kernel of `wrt/spmd` for the same features."""

    features: Any
    lanes: int


def largest_models() -> tuple[str, ...]:
    """Return each family of models once, in the variant that has most in it."""
    every = [cls.example() for cls in MATERIALS.values()]
    models = {material.model for material in every if not material.parts}
    image = wrt.ImageTexture(np.ones((1, 1, 3), np.float32))
    large = (
        wrt.RoughConductor(multiple_bounces=True),
        wrt.RoughDielectric(multiple_bounces=True),
        wrt.Principled(anisotropy=0.5, transmission=image, coat=image, sheen_color=image, multiple_bounces=True),
    )
    for material in large:
        models = {name for name in models if name.split(":")[0] != material.model.split(":")[0]} | {material.model}
    return tuple(sorted(models))


def compile_cases() -> dict[str, Any]:
    """Return what is compiled, by name: Features of render kernels, names of modules, kinds of tables."""
    import importlib

    import warp as wp

    import wrt.kernels
    from wrt.backend.lanes import WIDTHS, lanes_of, processor_flags
    from wrt.kernels.core.features import Features

    every = [cls.example() for cls in MATERIALS.values()]
    usual = tuple(sorted({material.model for material in every if not material.parts}))
    largest = largest_models()
    cases: dict[str, Any] = {f"scene {name}": scene_features(name) for name in ("cornell-box", "teapot", "still-life")}
    for name in (*usual, *sorted(set(largest) - set(usual))):
        cases[f"model {name}"] = Features((name,), False, "constant", sampler=SAMPLER)
    diffuse = Features(("diffuse",), False, "none", sampler=SAMPLER)
    cases |= {f"diffuse, {name}": dataclasses.replace(diffuse, **given) for name, given in VARIANTS.items()}
    glass = Features(("dielectric", "diffuse"), False, "constant", sampler=SAMPLER)
    for name, given in BODIES.items():
        cases[f"diffuse and dielectric, {name}"] = dataclasses.replace(glass, **given)
    cases["every model as it comes"] = Features(usual, False, "constant", sampler=SAMPLER)
    surfaces = {"textured": True, "environment": "image", "opacity": True, "tangents": True, "sampler": SAMPLER}
    cases["every model as it comes, textures and images"] = Features(usual, **surfaces)
    cases["every model at its largest, textures and images"] = Features(largest, **surfaces)
    cases["every model at its largest, everything"] = Features(largest, **surfaces, **EVERYTHING)
    lanes = lanes_of(processor_flags()) or min(WIDTHS)
    some = [name for name in cases if name.startswith(("scene", "every model as it comes"))]
    cases |= {f"{lanes} lanes, {name}": Wide(cases[name], lanes) for name in some}
    for found in pkgutil.walk_packages(wrt.kernels.__path__, "wrt.kernels."):
        kernels = [x for x in vars(importlib.import_module(found.name)).values() if isinstance(x, wp.Kernel)]
        if any(kernel.module.name == found.name for kernel in kernels):
            cases[f"module {found.name.rpartition('.')[2]}"] = found.name
    cases |= {f"table, {kind}": kind for kind in ("reflection", "dielectric", "coat")}
    return cases


def scene_features(name: str) -> Any:
    """Return what the kernel of a built-in scene contains."""
    from wrt.backend.device import Device
    from wrt.upload.scene_data import build_scene

    scene = wrt.load(name)
    return dataclasses.replace(build_scene(scene, Device("cpu")).features, sampler=scene.settings.sampler)


def kernel_module(case: Any) -> Any:
    """Return the Warp module of a case."""
    import importlib

    import warp as wp

    from wrt.kernels.bsdf.lobes.albedo import make_missing_kernel
    from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel
    from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel
    from wrt.kernels.render import make_render_kernel
    from wrt.spmd.kernel import make_wide_render_kernel

    if isinstance(case, Wide):
        return make_wide_render_kernel(case.features, case.lanes).module
    if not isinstance(case, str):
        return make_render_kernel(case).module
    makers = {"reflection": make_missing_kernel, "dielectric": make_missing_dielectric_kernel, "coat": make_coat_kernel}
    if case in makers:
        return makers[case]("ggx", "smith").module
    importlib.import_module(case)
    return wp.get_module(case)


def compile_seconds(case: Any) -> tuple[float, int]:
    """Return CPU seconds to compile a case, and bytes of object code; for a new process with an empty cache."""
    import warp as wp

    from wrt.backend import kernel_cache
    from wrt.backend.device import Device

    device = Device("cpu")
    start = time.process_time()
    kernel_cache.provide(kernel_module(case), device.name)
    seconds = time.process_time() - start
    built = [path.stat().st_size for path in Path(wp.config.kernel_cache_dir).rglob("*.o")]
    if len(built) != 1:
        raise RuntimeError(f"{case}: {len(built)} modules were built instead of one")
    return seconds, built[0]


def benchmark_compile(options: argparse.Namespace) -> dict[str, Any]:
    """Return CPU seconds to compile each case, and bytes of object code."""
    rows: list[dict[str, Any]] = []
    print("| kernel | seconds | kB |\n| --- | --- | --- |")
    for name, case in compile_cases().items():
        if options.kernels and not any(text in name for text in options.kernels):
            continue
        with tempfile.TemporaryDirectory() as folder:
            os.environ["WARP_CACHE_PATH"] = folder
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                seconds, size = pool.apply(compile_seconds, (case,))
        rows.append({"kernel": name, "seconds": seconds, "bytes": size})
        print(f"| {name} | {seconds:.1f} | {size / 1e3:.0f} |", flush=True)
    return {"benchmark": "compile", "rows": rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--kernels", nargs="+", help="only those whose names contain one of these texts")
