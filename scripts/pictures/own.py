"""Car paint, wood and the built-in procedural textures, for docs/own.md, whose programs it runs."""

from __future__ import annotations

import functools
import re
import tempfile
from pathlib import Path

import wrt
from wrt.scene.materials import MATERIALS
from wrt.scene.procedural import TEXTURES

from .picture import Picture

PAGE = Path(__file__).parents[2] / "docs" / "own.md"


@functools.cache
def load_programs() -> None:
    """Register the material and the texture of the page, once a process."""
    for code in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL):
        file = Path(tempfile.mkdtemp(), code.split()[1])
        file.write_text(code, "utf-8")
        wrt.load_models(file)


def scene() -> wrt.Scene:
    """Return five balls on a checkerboard, before a wall."""
    load_programs()
    made = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.3, 6.2), (0.0, 0.5, 0.0), fov_degrees=33.0))
    made.environment = wrt.ConstantEnvironment(0.35)
    ball = wrt.spheres([(0.0, 0.0, 0.0)], 0.5)
    flakes, wood = MATERIALS["flakes"], TEXTURES["wood"]
    clouds = wrt.PerlinNoise(0.9, (0.1, 0.25, 0.6), scale=3.0, solid=True, octaves=5)
    cells = wrt.WorleyNoise((0.06, 0.03, 0.02), (0.75, 0.6, 0.3), scale=6.0, solid=True)
    worn = wrt.PerlinNoise(0.15, 0.6, scale=5.0, solid=True)
    for k, material in enumerate(
        (
            wrt.Diffuse(clouds),
            wrt.Mix(wrt.Diffuse((0.02, 0.05, 0.3)), flakes((0.5, 0.7, 1.0), 90.0)),
            wrt.RoughConductor(worn, metal="gold"),
            wrt.RoughPlastic(wood(), alpha=0.2),
            wrt.Diffuse(cells),
        )
    ):
        made.add(ball.translated((1.08 * (k - 2), 0.5, 0.0)), material=material)
    floor = wrt.Checkerboard(0.5, 0.12, scale=160.0)
    made.add(wrt.quad((-40, 0, 40), (80, 0, 0), (0, 0, -80)), material=wrt.Diffuse(floor))
    wall = wrt.Bricks((0.42, 0.13, 0.08), (0.5, 0.47, 0.42), scale=(14.0, 14.0))
    made.add(wrt.quad((-4.2, 0, -1.6), (8.4, 0, 0), (0, 2.8, 0)), material=wrt.Diffuse(wall))
    made.add_light(wrt.SphereLight((-2.5, 4.0, 4.0), 1.4, radiance=10.0))
    return made


PICTURES = {"own": Picture(scene, 640, 240, 256)}
