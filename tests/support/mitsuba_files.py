"""Render Mitsuba's scene files with Mitsuba and with wrt; create the images and meshes that they name."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np

import wrt
from support.measurements import arbitrary, azimuths
from support.mitsuba_scene import VARIANT, Reference, load_mitsuba, reference_of
from support.statistics import ImageTest
from wrt.io.measured.measurement import save_measurement

SCENES = Path(__file__).resolve().parent.parent / "scenes" / "mitsuba"


def write_files(folder: Path) -> None:
    """Copy all scenes into a folder, and make the images and further meshes that they name beside them."""
    shutil.copytree(SCENES, folder, dirs_exist_ok=True)
    random = np.random.default_rng(12)
    sky = random.random((8, 16, 3)).astype(np.float32)
    sky[1:3, 5:8] = (12.0, 9.0, 6.0)
    wrt.save_image(folder / "sky.exr", sky)
    _write_png(folder / "colors.png", random.integers(30, 250, (6, 8, 3)))
    _write_png(folder / "numbers.png", np.repeat(random.integers(40, 230, (4, 4, 1)), 3, axis=2))
    normals = 0.35 * (random.random((8, 8, 3)) - 0.5) + (0.0, 0.0, 1.0)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    _write_png(folder / "normals.png", np.rint(127.5 * (normals + 1.0)))
    bumps = 0.5 + 0.5 * np.sin(2.0 * np.pi * np.arange(64) / 64.0)
    _write_png(folder / "bumps.png", np.rint(255.0 * np.repeat((bumps[:, None] * bumps)[..., None], 3, axis=2)))
    write_vol(folder / "smoke.vol", random.random((5, 4, 6)), (0.25, 0.05, -0.35), (0.95, 0.75, 0.35))
    write_vol(folder / "albedo.vol", random.random((2, 3, 2, 3)))
    for seed, name in enumerate(("metal", "brushed")):
        with (folder / f"{name}_rgb.bsdf").open("wb") as file:
            save_measurement(file, arbitrary(azimuths(4, 4), seed=seed))
    ball = wrt.sphere(subdivisions=3)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices] + [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]
    (folder / "ball.obj").write_text("\n".join(lines))


def write_vol(
    path: Path,
    values: np.ndarray,
    lower: tuple[float, float, float] = (0.0, 0.0, 0.0),
    upper: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> None:
    """Write (nz, ny, nx) numbers or (nz, ny, nx, 3) colours as Mitsuba's documentation says."""
    nz, ny, nx = values.shape[:3]
    header = b"VOL\3" + np.array([1, nx, ny, nz, values[0, 0, 0].size], "<i4").tobytes()
    path.write_bytes(header + np.array([*lower, *upper], "<f4").tobytes() + values.astype("<f4").tobytes())


def _write_png(path: Path, codes: np.ndarray) -> None:
    from PIL import Image

    Image.fromarray(codes.astype(np.uint8)).save(path)


def render_by_mitsuba(path: Path, *, spp: int, runs: int = 16, seed: int = 1, variant: str = VARIANT) -> Reference:
    """Return the picture of a scene file by a variant of Mitsuba, from several runs with their own random numbers."""
    mi = load_mitsuba()
    mi.set_variant(variant)
    return reference_of(mi.load_file(str(path)), spp=spp, runs=runs, seed=seed)


def compare(path: Path, expected: Reference, *, spp: int) -> ImageTest:
    """Return how wrt's picture of a scene file compares with Mitsuba's, with the Gaussian that "shared" stands for."""
    scene = wrt.load(path)
    exact = {"shared": "gaussian"}.get(scene.settings.filter, scene.settings.filter)
    scene.settings = dataclasses.replace(scene.settings, sampler="independent", filter=exact)
    renderer = wrt.Renderer(scene, seed=1)
    return expected.compared(renderer, spp)
