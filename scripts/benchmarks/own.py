"""`own`: copies of built-in models and a ball by its distance, registered from outside, beside the built-in ones."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import resource
import statistics
import time
from pathlib import Path
from typing import Any, ClassVar

import warp as wp

import wrt
from benchmarks.measure import Row, table
from benchmarks.own_integrators import OwnOcclusion, PlainPaths
from wrt.compiling.kernel import SCALAR, declaration
from wrt.kernels.bsdf.diffuse import DIFFUSE
from wrt.kernels.camera.projections import PERSPECTIVE
from wrt.kernels.lights.area_lights import DISK
from wrt.rendering.wide_kernel import threads_of
from wrt.scene.description import Positive


@dataclasses.dataclass(frozen=True)
class OwnDiffuse(wrt.Diffuse):
    """A copy of `wrt.Diffuse`."""

    type_name: ClassVar[str] = "own-diffuse"


@dataclasses.dataclass(frozen=True)
class OwnDisk(wrt.DiskLight):
    """A copy of `wrt.DiskLight`."""

    type_name: ClassVar[str] = "own-disk"


@dataclasses.dataclass(frozen=True)
class OwnPerspective(wrt.PerspectiveCamera):
    """A copy of `wrt.PerspectiveCamera`."""

    type_name: ClassVar[str] = "own-perspective"
    model: ClassVar[str] = "own_perspective"


@wp.func
def ball(point: wp.vec3, radius: float) -> float:
    """Return the distance to a sphere around the origin."""
    return wp.length(point) - radius


@dataclasses.dataclass(frozen=True)
class OwnBall(wrt.DistanceShape):
    """A sphere around the origin by its distance function."""

    radius: Positive = 1.0

    type_name: ClassVar[str] = "own-ball"

    def bounds(self) -> tuple[Any, Any]:
        """Return the cube around it."""
        return (-self.radius,) * 3, (self.radius,) * 3


KINDS: dict[str, tuple[Any, Any, Any, Any, str]] = {
    "built-in": (wrt.Diffuse, wrt.DiskLight, wrt.PerspectiveCamera, wrt.sphere, "path"),
    "BSDF": (OwnDiffuse, wrt.DiskLight, wrt.PerspectiveCamera, wrt.sphere, "path"),
    "light": (wrt.Diffuse, OwnDisk, wrt.PerspectiveCamera, wrt.sphere, "path"),
    "camera": (wrt.Diffuse, wrt.DiskLight, OwnPerspective, wrt.sphere, "path"),
    "exact sphere": (
        *(wrt.Diffuse, wrt.DiskLight, wrt.PerspectiveCamera),
        functools.partial(wrt.sphere, exact=True),
        "path",
    ),
    "shape": (wrt.Diffuse, wrt.DiskLight, wrt.PerspectiveCamera, OwnBall, "path"),
    "built-in ao": (wrt.Diffuse, wrt.PointLight, wrt.PerspectiveCamera, wrt.sphere, "ao"),
    **{
        name: (
            *(wrt.Diffuse, wrt.PointLight if name.endswith("ao") else wrt.DiskLight),
            *(wrt.PerspectiveCamera, wrt.sphere, integrator),
        )
        for name, integrator in {
            "ao": "own-ao",
            "fading ao": "depth-cue",
            "path": "plain-paths",
            "heat map": "heat-map",
            "toon": "toon",
        }.items()
    },
}
"""Material, light, camera, sphere and integrator of each scene: one is a copy, or what to compare it with."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--spp", type=int, default=64, metavar="N")
    parser.add_argument("--repeats", type=int, default=5, metavar="N")


def benchmark(options: argparse.Namespace) -> Row:
    """Return seconds of CPU by scalar kernels and by the wide ones that there are, and until each kernel was there."""
    wrt.register_material(OwnDiffuse, DIFFUSE)
    wrt.register_light(OwnDisk, DISK)
    wrt.register_camera(OwnPerspective, PERSPECTIVE)
    wrt.register_shape(OwnBall, ball)
    wrt.register_integrator(OwnOcclusion)
    wrt.register_integrator(PlainPaths)
    wrt.load_models(Path(__file__).parents[1] / "sketches.py")
    renderers, rows = {}, {}
    for name, (material, light, camera, ball_of, integrator) in KINDS.items():
        scene = wrt.Scene(camera=camera((0.0, 1.0, 4.0)))
        scene.add(ball_of(), material=material(0.6))
        scene.add(wrt.quad((-4, -1, 4), (8, 0, 0), (0, 0, -8)), material=material(0.6))
        size = () if light is wrt.PointLight else ((0.0, -1.0, 0.0), 1.0)
        scene.add_light(light((0.0, 4.0, 2.0), *size, 9.0))
        start = time.perf_counter()
        renderer = wrt.Renderer(scene, integrator=integrator, width=200, height=150, threads=1)
        renderer.render(spp=1)
        first = time.perf_counter() - start
        wide = renderer.compile()
        renderers[name], rows[name] = renderer, {"first": first, "compiling": wide, "lanes": renderer.lanes}
    for kernel in ("scalar", "wide"):
        able = {name: renderer for name, renderer in renderers.items() if kernel == "scalar" or renderer.lanes > 1}
        seconds: dict[str, list[float]] = {name: [] for name in able}
        for _ in range(options.repeats):
            for name, renderer in able.items():  # in turn: the machine's speed changes
                seconds[name].append(_seconds(renderer, options.spp, kernel))
        for name, found in seconds.items():
            rows[name][kernel] = statistics.median(found)
    return {"benchmark": "own", "rows": rows, "spp": options.spp}


def _seconds(renderer: wrt.Renderer, spp: int, kernel: str) -> float:
    """Return seconds of CPU of the first `spp` samples of each pixel by one of the renderer's kernels."""
    film, wide = renderer.film, renderer._kernel.wide
    if kernel == "wide":
        threads, launched = threads_of(film.width, film.height, wide.tile), wide.kernel
    else:
        declared = declaration(renderer._kernel.features, SCALAR)
        threads, launched = film.pixels, renderer._kernel.scalar or renderer.device.backend.call(*declared)
        renderer.device.compile(launched)
    film.data.count.zero_()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    renderer.device.launch(launched, threads, [spp, *renderer._inputs])
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime - before


def text(result: Row) -> str:
    """Return the speeds as shares of the built-in models' own; sketches are compared with `path` or `ao`."""
    rows = result["rows"]
    of = {name: rows["built-in ao" if name.endswith("ao") else "built-in"] for name in rows}
    head = ("a copy of", "scalar", "wide", "scalar / wide", "lanes", "until the first picture", "wide kernel")
    return table(
        head,
        (
            (
                name,
                *(f"{of[name][kernel] / row[kernel]:.2f}" if kernel in row else "-" for kernel in ("scalar", "wide")),
                f"{row['scalar'] / row['wide']:.2f}" if "wide" in row else "-",
                str(row["lanes"]),
                *(f"{row[key]:.1f} s" for key in ("first", "compiling")),
            )
            for name, row in rows.items()
        ),
    )
