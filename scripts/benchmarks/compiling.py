"""`compile`: seconds of CPU that each kernel costs where Warp's cache is empty."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import pkgutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from benchmarks.measure import Row, table, with_empty_cache
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


def largest_models(models: set[str]) -> tuple[str, ...]:
    """Return each family of models once, in the variant that has most in it."""
    image = wrt.ImageTexture(np.ones((1, 1, 3), np.float32))
    for material in (
        wrt.RoughConductor(multiple_bounces=True),
        wrt.RoughDielectric(multiple_bounces=True),
        wrt.Principled(anisotropy=0.5, transmission=image, coat=image, sheen_color=image, multiple_bounces=True),
    ):
        models = {name for name in models if name.split(":")[0] != material.model.split(":")[0]} | {material.model}
    return tuple(sorted(models))


def compile_cases() -> dict[str, Callable[[], Any]]:
    """Return functions that return the Warp module to compile, by names for the table."""
    import warp as wp

    import wrt.kernels
    from wrt.backend.device import Device
    from wrt.backend.processor import WIDTHS, lanes_of, processor_flags
    from wrt.kernels.core.features import Features
    from wrt.upload.scene_data import build_scene

    examples = [cls.example() for cls in MATERIALS.values()]
    models = tuple(sorted({material.model for material in examples if not material.parts}))
    largest = largest_models(set(models))
    found: dict[str, Features] = {}
    for name in ("cornell-box", "teapot", "still-life"):
        scene = wrt.load(name)
        features = build_scene(scene, Device("cpu")).features
        found[f"scene {name}"] = dataclasses.replace(features, sampler=scene.settings.sampler)
    for name in (*models, *sorted(set(largest) - set(models))):
        found[f"model {name}"] = Features((name,), False, "constant", sampler=SAMPLER)
    diffuse = Features(("diffuse",), False, "none", sampler=SAMPLER)
    found |= {f"diffuse, {name}": dataclasses.replace(diffuse, **has) for name, has in VARIANTS.items()}
    glass = Features(("dielectric", "diffuse"), False, "constant", sampler=SAMPLER)
    found |= {f"diffuse and dielectric, {name}": dataclasses.replace(glass, **has) for name, has in BODIES.items()}
    found["every model as it comes"] = Features(models, False, "constant", sampler=SAMPLER)
    surfaces = {"textured": True, "environment": "image", "opacity": True, "tangents": True, "sampler": SAMPLER}
    found["every model as it comes, textures and images"] = Features(models, **surfaces)
    found["every model at its largest, textures and images"] = Features(largest, **surfaces)
    found["every model at its largest, everything"] = Features(largest, **surfaces, **EVERYTHING)

    cases: dict[str, Callable[[], Any]] = {name: partial(render_module, features) for name, features in found.items()}
    lanes = lanes_of(processor_flags()) or min(WIDTHS)
    for name, features in found.items():
        if name.startswith(("scene", "every model as it comes")):
            cases[f"{lanes} lanes, {name}"] = partial(wide_module, features, lanes)
    for module in pkgutil.walk_packages(wrt.kernels.__path__, "wrt.kernels."):
        kernels = [x for x in vars(importlib.import_module(module.name)).values() if isinstance(x, wp.Kernel)]
        if any(kernel.module.name == module.name for kernel in kernels):
            cases[f"module {module.name.rpartition('.')[2]}"] = partial(module_of_file, module.name)
    return cases | {f"table, {kind}": partial(table_module, kind) for kind in ("reflection", "dielectric", "coat")}


def render_module(features: Any) -> Any:
    """Return the module of the scalar render kernel."""
    from wrt.kernels.render import make_render_kernel

    return make_render_kernel(features).module


def wide_module(features: Any, lanes: int) -> Any:
    """Return the module of the wide render kernel."""
    from wrt.spmd.kernel import make_wide_render_kernel

    return make_wide_render_kernel(features, lanes).module


def module_of_file(name: str) -> Any:
    """Return the module of the kernels that a file declares."""
    import warp as wp

    importlib.import_module(name)
    return wp.get_module(name)


def table_module(kind: str) -> Any:
    """Return the module of a kernel that fills a table of energies."""
    from wrt.kernels.bsdf.lobes.albedo import make_missing_kernel
    from wrt.kernels.bsdf.lobes.albedo_dielectric import make_missing_dielectric_kernel
    from wrt.kernels.bsdf.lobes.coat_transmittance import make_coat_kernel

    makers = {"reflection": make_missing_kernel, "dielectric": make_missing_dielectric_kernel, "coat": make_coat_kernel}
    return makers[kind]("ggx", "smith").module


def compile_seconds(module: Callable[[], Any]) -> tuple[float, int]:
    """Return CPU seconds to compile a case, and bytes of object code; for a new process with an empty cache."""
    import warp as wp

    from wrt.backend import kernel_cache
    from wrt.backend.warp_start import initialize_warp

    initialize_warp()
    start = time.process_time()
    kernel_cache.Build(module(), "cpu").provide()
    seconds = time.process_time() - start
    built = [path.stat().st_size for path in Path(wp.config.kernel_cache_dir).rglob("*.o")]
    if len(built) != 1:
        raise RuntimeError(f"{module}: {len(built)} modules were built instead of one")
    return seconds, built[0]


def benchmark(options: argparse.Namespace) -> Row:
    """Return CPU seconds to compile each case, and bytes of object code."""
    rows = []
    for name, module in compile_cases().items():
        if not options.kernels or any(part in name for part in options.kernels):
            seconds, size = with_empty_cache(compile_seconds, module)
            rows.append({"kernel": name, "seconds": seconds, "bytes": size})
            print(f"{name}: {seconds:.1f} s", flush=True)
    return {"benchmark": "compile", "rows": rows}


def text(result: Row) -> str:
    """Return the table for docs/notes/compiling.md."""
    lines = [[f"`{row['kernel']}`", f"{row['seconds']:.1f}", f"{row['bytes'] / 1e3:.0f}"] for row in result["rows"]]
    return f"On {result['machine']}.\n\n" + table(["kernel", "seconds", "kB of code"], lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--kernels", nargs="+", help="only those whose names contain one of these texts")
