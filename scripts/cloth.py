#!/usr/bin/env python3
"""Render a simulation: a cloth falls over a ball, frame by frame.

    python scripts/cloth.py [--frames N] [--spp N] [--size WxH] [--device cuda] [FOLDER]

Simulation and renderer share a device, which the cloth's vertices never leave. Each frame updates the ray tree
(`Renderer.update_vertices`) and writes a picture: FOLDER/cloth-000.png and so on (default: pictures/).
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import wrt
from wrt.scene.normals import vertex_normals

SIDE = 96
"""Particles along each side of the cloth."""

WIDTH = 1.6
SPACING = WIDTH / (SIDE - 1)
BALL = wp.constant(wp.vec3(0.0, 0.5, 0.0))
RADIUS = 0.42
THICKNESS = 0.008
"""Distance of the cloth from surfaces it touches, metres."""

FRAMES_PER_SECOND = 24
STEPS = 96
"""Simulation steps per frame."""

STIFFNESS = 400000.0
"""Stiffness over mass of the springs, 1/s², and their damping, 1/s."""
DAMPING = 40.0
DRAG = 0.35


@wp.func
def spring(a: wp.vec3, va: wp.vec3, b: wp.vec3, vb: wp.vec3, rest_length: float) -> wp.vec3:
    """Return the acceleration of a due to a damped spring to b."""
    edge = b - a
    length = wp.length(edge)
    along = edge / wp.max(length, 1.0e-9)
    return along * (STIFFNESS * (length - rest_length) + DAMPING * wp.dot(vb - va, along))


@wp.kernel(enable_backward=False)
def step(  # noqa: ANN201 - Warp reads annotations
    dt: float,
    points: wp.array(dtype=wp.vec3),
    velocities: wp.array(dtype=wp.vec3),
    points_out: wp.array(dtype=wp.vec3),
    velocities_out: wp.array(dtype=wp.vec3),
):
    """Advance each particle by a step: gravity, drag, springs to its neighbours, the ball and the floor."""
    k = wp.tid()
    i = k // SIDE
    j = k % SIDE
    p = points[k]
    v = velocities[k]
    acceleration = wp.vec3(0.0, -9.81, 0.0) - v * DRAG
    # Springs along the threads, diagonal ones, and ones over two particles, against folding.
    for di in range(-2, 3):
        for dj in range(-2, 3):
            reach = di * di + dj * dj
            near = reach == 1 or reach == 2 or reach == 4
            if near and i + di >= 0 and i + di < SIDE and j + dj >= 0 and j + dj < SIDE:
                neighbour = (i + di) * SIDE + j + dj
                weight = wp.where(reach == 1, 1.0, wp.where(reach == 2, 0.25, 0.08))
                rest_length = SPACING * wp.sqrt(float(reach))
                acceleration += spring(p, v, points[neighbour], velocities[neighbour], rest_length) * weight
    v += acceleration * dt
    p += v * dt
    out = p - BALL
    distance = wp.length(out)
    if distance < RADIUS + THICKNESS:
        n = out / wp.max(distance, 1.0e-9)
        p += n * (RADIUS + THICKNESS - distance)
        # Friction.
        inward = wp.min(wp.dot(v, n), 0.0)
        v = (v - n * inward) * 0.985
    if p[1] < THICKNESS:
        p[1] = THICKNESS
        v = wp.vec3(v[0] * 0.9, wp.max(v[1], 0.0), v[2] * 0.9)
    points_out[k] = p
    velocities_out[k] = v


class Cloth:
    """A square of particles on a device: the vertices of a mesh."""

    def __init__(self, device: str) -> None:
        """Lay the cloth out flat above the ball, slightly rotated."""
        a = np.linspace(-0.5 * WIDTH, 0.5 * WIDTH, SIDE)
        x, z = np.meshgrid(a, a, indexing="ij")
        c, s = math.cos(0.5), math.sin(0.5)
        flat = np.stack([c * x - s * z, np.full_like(x, 1.05), s * x + c * z], axis=2).reshape(-1, 3)
        i = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
        faces = np.concatenate([np.stack([i, i + 1, i + SIDE + 1], 1), np.stack([i, i + SIDE + 1, i + SIDE], 1)])
        mesh = wrt.Mesh(flat, faces, name="cloth")
        self.mesh = wrt.Mesh(flat, faces, normals=vertex_normals(mesh), name="cloth")
        self.device = device
        self.points = wp.array(self.mesh.vertices, dtype=wp.vec3, device=device)
        self.velocities = wp.zeros_like(self.points)
        self._spare: tuple[Any, Any] = (wp.empty_like(self.points), wp.empty_like(self.points))

    def advance(self) -> None:
        """Simulate until the next frame."""
        for _ in range(STEPS):
            points, velocities = self._spare
            dt = 1.0 / (FRAMES_PER_SECOND * STEPS)
            inputs = [dt, self.points, self.velocities]
            wp.launch(step, len(self.points), inputs, [points, velocities], device=self.device)
            self._spare = self.points, self.velocities
            self.points, self.velocities = points, velocities


def scene_of(cloth: Cloth) -> wrt.Scene:
    """Return the scene around the cloth."""
    camera = wrt.PerspectiveCamera(origin=(0.6, 1.55, 3.3), target=(0.0, 0.42, 0.0), fov_degrees=32.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment((0.32, 0.36, 0.42)))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse((0.4, 0.38, 0.35)), name="floor")
    scene.add(
        wrt.sphere(tuple(BALL), RADIUS, subdivisions=5), material=wrt.RoughConductor(0.15, metal="gold"), name="ball"
    )
    silk = wrt.Principled((0.5, 0.03, 0.05), roughness=0.45, sheen_color=(0.5, 0.2, 0.2), sheen_roughness=0.4)
    scene.add(cloth.mesh, material=silk, name="cloth")
    scene.add(wrt.quad((-2.4, 3.2, -1.2), (1.6, 0, 0), (0, 0, 1.6)), emission=(9.0, 8.3, 7.4), name="lamp")
    return scene


def main() -> None:
    """Run the command line: simulate and render alternately."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("pictures"))
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    options.folder.mkdir(parents=True, exist_ok=True)
    cloth = Cloth(options.device)
    renderer = wrt.Renderer(scene_of(cloth), width=width, height=height, device=options.device)
    for frame in range(options.frames):
        if frame:
            cloth.advance()
            renderer.update_vertices(2, cloth.points)
        for _ in renderer.passes(spp=options.spp):
            pass
        wrt.save_image(options.folder / f"cloth-{frame:03d}.png", renderer.image())
        print(f"frame {frame + 1} of {options.frames}", flush=True)


if __name__ == "__main__":
    main()
