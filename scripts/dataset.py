"""Write a dataset of pictures of a mesh with known cameras, as NeRF and Gaussian splatting take them.

    python scripts/dataset.py teapot -o teapot-dataset --views 100 [--size 256] [--spp 64] [--threads N] [--device NAME]

The folder has `transforms.json` in the layout of the synthetic scenes of Mildenhall and others (NeRF, 2020): the
horizontal field of view in radians, and for each picture the matrix from camera to world, whose camera looks along −z
with y up. Pictures are PNG files with an alpha channel; beside each is an .npz file with depth, position, normal and
object of each pixel. The world is wrt's, with y up.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import wrt

LAYERS = ("depth", "position", "normal", "object")


def cameras_around(scene: wrt.Scene, views: int) -> list[wrt.PerspectiveCamera]:
    """Return cameras on the upper half of a sphere, evenly by the golden angle, that show the whole mesh."""
    bounds = np.array([shape.bounds for shape in scene.shapes[: scene.studio_shapes or None]])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    center, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    fov = 40.0
    distance = 1.05 * radius / math.sin(math.radians(fov) / 2.0)
    cameras = []
    for index in range(views):
        height = (index + 0.5) / views * 0.95
        turn = index * math.pi * (3.0 - math.sqrt(5.0))
        ring = math.sqrt(1.0 - height * height)
        place = center + distance * np.array([ring * math.sin(turn), height, ring * math.cos(turn)])
        cameras.append(wrt.PerspectiveCamera(tuple(place), tuple(center), fov_degrees=fov))
    return cameras


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the dataset."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", help="a mesh file, or teapot")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write")
    parser.add_argument("--views", type=int, default=100)
    parser.add_argument("--size", type=int, default=256, help="width and height, pixels")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args(arguments)

    teapot = Path(__file__).resolve().parent.parent / "meshes" / "teapot.ply"
    scene = wrt.load(teapot if options.mesh == "teapot" else options.mesh, transparent=True)
    cameras = cameras_around(scene, options.views)
    (options.output / "train").mkdir(parents=True, exist_ok=True)
    names = [f"train/r_{index:04d}" for index in range(len(cameras))]
    views = wrt.render_views(
        scene,
        cameras,
        width=options.size,
        height=options.size,
        spp=options.spp,
        layers=LAYERS,
        threads=options.threads,
        device=options.device,
    )
    for view, name in zip(views, names, strict=True):
        color, alpha = view.image[..., :3], view.image[..., 3]
        wrt.save_image(options.output / f"{name}.png", color, alpha=alpha, exposure=0.0)
        np.savez_compressed(options.output / f"{name}.npz", **view.layers)
    by_picture = {f"{name}.png": camera for name, camera in zip(names, cameras, strict=True)}
    wrt.save_cameras(options.output / "transforms.json", by_picture, options.size, options.size)
    print(f"{options.output}: {len(names)} views")
    return 0


if __name__ == "__main__":
    sys.exit(main())
