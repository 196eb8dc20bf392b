#!/usr/bin/env python3
"""Write tests/corpus/seeds: small files of every kind that wrt reads, for scripts/fuzz.py to damage."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from corpus_files import meshes, nodes, scenes
from corpus_files.images import write_images
from corpus_files.stages import write_stages
from corpus_files.volumes import write_volumes
from fuzz import CORPUS_VERSION

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

SEEDS = ROOT / "tests" / "corpus" / "seeds"


def main() -> None:
    """Write every file."""
    import wrt
    from wrt.io.measured.measurement import save_measurement
    from wrt.rendering.checkpoint import write_checkpoint
    from wrt.scene.materials import Measured

    SEEDS.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    write_images(SEEDS, rng)
    image = (SEEDS / "colors.png").read_bytes()
    for name, content in {**meshes.files(image), **nodes.files(image), **scenes.FILES}.items():
        (SEEDS / name).write_bytes(content.encode() if isinstance(content, str) else content)
    write_volumes(SEEDS)
    write_stages(SEEDS)
    (SEEDS / "draco.glb").write_bytes(nodes.draco())
    scene = wrt.Scene(
        [wrt.Shape(wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)))], environment=wrt.ConstantEnvironment(1.0)
    )
    part = wrt.Renderer(scene, width=4, height=3, layers=("depth",)).part(1, 1, spp=1)
    replace(part, header=part.header | {"wrt": CORPUS_VERSION}).save(SEEDS / "part.wrt")
    np.savez(SEEDS / "box.npz", vertices=meshes.VERTICES, faces=meshes.FACES)
    np.savez_compressed(SEEDS / "packed.npz", vertices=meshes.VERTICES, faces=meshes.FACES, colors=meshes.VERTICES)
    with (SEEDS / "grey.bsdf").open("wb") as file:
        save_measurement(file, Measured.example().measurement)
    count = np.full(12, 2, np.int32)
    arrays = {"total": rng.random((12, 3)), "total_of_squares": rng.random((12, 3)), "count": count, "rejected": count}
    write_checkpoint(SEEDS / "film.ckpt", {"wrt": "0", "width": 4, "height": 3, "seed": 0, "scene": {}}, arrays)


if __name__ == "__main__":
    main()
