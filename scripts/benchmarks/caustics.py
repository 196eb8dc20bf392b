"""`caustics`: errors after equal seconds of CPU with and without `--caustics`, beside Mitsuba's `path` and `ptracer`.

References: of what is not smooth, as first seen, Mitsuba's `ptracer`, which follows light from the lamps and finds all
caustics there; of glass and metal long renders of wrt's with caustics. Under large lamps long renders by path tracing
are the reference of all. There are two of each, with random numbers of their own: a squared error is the product of the
differences from both, whose mean is free of the references' noise.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from peers.mitsuba_scene import to_mitsuba
from peers.mitsuba_worker import write_scene
from peers.peer import LLVM_HINT, OWN, PEERS, Environments, Session, prepare

import wrt
from benchmarks.measure import Row, geometric_mean, table
from benchmarks.scenes import Budget, cornell_glass

Array = NDArray[np.float64]

TITLES = {
    "path": "wrt `path`",
    "caustics": "wrt `--caustics`",
    "mitsuba": "Mitsuba `path`",
    "ptracer": "Mitsuba `ptracer`",
}

CHUNK = 256
"""Samples of a render of Mitsuba's, whose memory grows with them; their mean is taken."""

SEEDS_OF_REFERENCES = 2000, 3000

TRIMMED = 1e-3
"""Share of the pixels, those of the largest errors, that the robust measure leaves out."""


def floor_and_camera() -> wrt.Scene:
    """Return a diffuse floor."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 3.2, 5.5), (0.2, 0.5, 0.0), fov_degrees=40.0))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.6), name="floor")
    return scene


def add_ball(scene: wrt.Scene) -> wrt.Scene:
    """Add a glass ball above the floor."""
    scene.add(wrt.sphere((0, 1, 0), 0.8, exact=True), material=wrt.Dielectric(), name="ball")
    return scene


def add_lamp(scene: wrt.Scene) -> wrt.Scene:
    """Add a square lamp of 4 cm a side that faces the ball."""
    place, half = np.array([-1.6, 4.0, 0.6]), 0.02
    way = np.array([0.0, 1.0, 0.0]) - place
    left = np.cross([0.0, 0.0, 1.0], way)
    left /= np.linalg.norm(left)
    up = np.cross(way / np.linalg.norm(way), left)
    lamp = wrt.quad(place - half * (left + up), 2.0 * half * left, 2.0 * half * up)
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=8.0 / half**2, name="lamp")
    return scene


def point() -> wrt.Scene:
    """Return the ball in the light of a point."""
    scene = add_ball(floor_and_camera())
    scene.add_light(wrt.PointLight((-1.6, 4.0, 0.6), intensity=32.0))
    return scene


def sun() -> wrt.Scene:
    """Return the ball in parallel light."""
    scene = add_ball(floor_and_camera())
    scene.add_light(wrt.DirectionalLight((1.6, -3.0, -0.6), 2.7))
    return scene


def ring() -> wrt.Scene:
    """Return a ring of copper on the floor under the lamp."""
    scene = add_lamp(floor_and_camera())
    angle = np.linspace(0.0, 2.0 * np.pi, 257)
    normals = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=-1)
    points = np.concatenate([0.9 * normals, 0.9 * normals + np.array([0.0, 0.6, 0.0])])
    a = np.arange(256)
    faces = np.concatenate([np.stack([a, a + 257, a + 258], -1), np.stack([a, a + 258, a + 1], -1)])
    mesh = wrt.Mesh(points, faces, normals=np.concatenate([normals, normals]))
    scene.add(mesh, material=wrt.Conductor(metal="copper"), name="ring")
    return scene


def room() -> wrt.Scene:
    """Return the ball under the lamp in a room, whose walls light each other."""
    scene = add_lamp(
        add_ball(wrt.Scene(camera=wrt.PerspectiveCamera((0.3, 2.2, 3.7), (0.1, 1.1, 0.0), fov_degrees=60.0)))
    )
    walls = {
        "floor": ((-2.5, 0, 4), (5, 0, 0), (0, 0, -6.5), (0.6, 0.6, 0.6)),
        "ceiling": ((-2.5, 4.5, -2.5), (5, 0, 0), (0, 0, 6.5), (0.6, 0.6, 0.6)),
        "back": ((-2.5, 0, -2.5), (5, 0, 0), (0, 4.5, 0), (0.6, 0.6, 0.6)),
        "front": ((2.5, 0, 4), (-5, 0, 0), (0, 4.5, 0), (0.6, 0.6, 0.6)),
        "left": ((-2.5, 0, 4), (0, 0, -6.5), (0, 4.5, 0), (0.6, 0.2, 0.15)),
        "right": ((2.5, 0, -2.5), (0, 0, 6.5), (0, 4.5, 0), (0.2, 0.5, 0.2)),
    }
    for name, (corner, u, v, color) in walls.items():
        scene.add(wrt.quad(corner, u, v), material=wrt.Diffuse(color), name=name)
    return scene


SCENES: dict[str, tuple[Callable[[], wrt.Scene], str]] = {
    "lamp": (lambda: add_lamp(add_ball(floor_and_camera())), "a glass ball under a lamp of 4 cm"),
    "point": (point, "a glass ball under a point"),
    "sun": (sun, "a glass ball in the sun"),
    "ring": (ring, "a copper ring under a lamp of 4 cm"),
    "room": (room, "a glass ball in a room, a lamp of 4 cm"),
    "cornell-glass": (lambda: cornell_glass(Budget()), "balls of glass and copper under a large lamp"),
    "still-life": (lambda: wrt.load("still-life"), "glass, copper and plastic in the studio's light"),
}

LIT_BROADLY = ("cornell-glass", "still-life")
"""Scenes whose lamps are large, so that path tracing converges and is their reference."""


def benchmark(options: argparse.Namespace) -> Row:
    """Return errors after equal seconds of CPU."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        own = {"WRT_BACKGROUND": "0"} | ({} if options.folder else {"XDG_CACHE_HOME": temporary})
        environments = Environments(llvm=options.llvm, more=own)
        for name in options.scenes:
            scene = SCENES[name][0]()
            settings = wrt.RenderSettings(
                width=options.size, height=options.size, max_depth=options.depth, filter="box"
            )
            scene.settings = settings
            place = folder / name
            place.mkdir(parents=True, exist_ok=True)
            with Renderers(scene, place, environments) as renderers:
                references, is_diffuse = references_of(renderers, place, options.reference)
                for renderer in options.renderers:
                    for seconds in options.seconds:
                        picture, spent, spp = renderers.picture(renderer, seconds, 1)
                        row = {"scene": name, "renderer": renderer, "asked": seconds, "seconds": spent, "spp": spp}
                        rows.append(row | errors_of(picture, references, is_diffuse))
                        print(name, renderer, *(f"{key} {rows[-1][key]:.4g}" for key in list(row)[2:]), end=" ")
                        print(*(f"{key} {rows[-1][key]:.2%}" for key in MEASURES), flush=True)
    settings = {key: getattr(options, key) for key in ("size", "depth", "reference")}
    return {"benchmark": "caustics", "rows": rows, **settings}


class Renderers:
    """Processes of all renderers with a scene, on one thread each; started when they are first asked."""

    def __init__(self, scene: wrt.Scene, folder: Path, environments: Environments) -> None:
        self.scene, self.folder, self.environments = scene, folder, environments
        self.sessions: dict[str, Session] = {}

    def __enter__(self) -> Renderers:
        return self

    def __exit__(self, *raised: object) -> None:
        for session in self.sessions.values():
            session.__exit__()

    def session(self, renderer: str) -> Session:
        """Return the process of a renderer."""
        if renderer not in self.sessions:
            folder = self.folder / renderer
            folder.mkdir(exist_ok=True)
            settings = self.scene.settings
            if renderer in ("path", "caustics"):
                settings = dataclasses.replace(settings, caustics=renderer == "caustics")
                prepare(OWN, dataclasses.replace(self.scene, settings=settings), folder)
                peer = OWN
            else:
                size = {"width": settings.width, "height": settings.height}
                tree = to_mitsuba(self.scene, folder, **size, max_depth=settings.max_depth)
                tree["integrator"]["type"] = "path" if renderer == "mitsuba" else renderer
                write_scene(tree, folder)
                peer = PEERS["mitsuba-llvm"]
            self.sessions[renderer] = Session(peer, folder, self.environments, threads=1)
        return self.sessions[renderer]

    def picture(self, renderer: str, seconds: float, seed: int) -> tuple[Array, float, int]:
        """Return a picture that takes about `seconds` of CPU, the seconds it took, and its samples."""
        session, file = self.session(renderer), self.folder / f"{renderer}.npy"

        def render(spp: int, seed: int) -> tuple[float, Array]:
            spent = session.ask(do="render", spp=spp, seed=seed, save=str(file))["cpu_seconds"]
            return spent, np.load(file).astype(np.float64)

        spp, spent = CHUNK, 0.0
        if renderer in ("path", "caustics"):
            for share in (0.0, 0.1, 1.0):
                spp = round(share * seconds / spent * spp) if share else 16
                spent, picture = render(max(spp, 1), seed)
            return picture, spent, spp
        render(CHUNK, seed)  # compiles
        pictures = []
        while spent < seconds:
            time, picture = render(CHUNK, seed + len(pictures))
            pictures.append(picture)
            spent += time
        return np.mean(pictures, axis=0), spent, CHUNK * len(pictures)


def references_of(renderers: Renderers, folder: Path, seconds: float) -> tuple[list[Array], NDArray[np.bool_]]:
    """Return two references, and which pixels see neither a caster nor the edge of one."""
    is_diffuse = sees_no_caster(renderers.scene)
    references = []
    for seed in SEEDS_OF_REFERENCES:
        pictures = []
        for renderer in ("path",) if folder.name in LIT_BROADLY else ("ptracer", "caustics"):
            file = folder / f"reference_{renderer}_{seed}.npy"
            if not file.exists():
                np.save(file, renderers.picture(renderer, 0.5 * seconds, seed)[0])
            pictures.append(np.load(file))
        references.append(np.where(is_diffuse[..., None], pictures[0], pictures[-1]))
    return references, is_diffuse


def sees_no_caster(scene: wrt.Scene, margin: int = 2) -> NDArray[np.bool_]:
    """Return (H, W) whether pixels, and all within a margin, see only surfaces that scatter light."""
    renderer = wrt.Renderer(scene, integrator="aov", layers=("object",))
    for _ in renderer.passes(spp=16):
        pass
    seen = renderer.layers()["object"]
    numbers = [i for i, shape in enumerate(scene.shapes, 1) if not isinstance(shape.material, wrt.Diffuse)]
    others = np.pad(np.isin(seen, [0, *numbers]), margin, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(others, (2 * margin + 1, 2 * margin + 1))
    return ~np.asarray(windows.any(axis=(2, 3)))


MEASURES = {
    "whole": "RMSE over the RMS of the picture",
    "diffuse": "the same where the camera sees no glass and no metal",
    "trimmed": "root of the mean squared relative error, without the worst 0.1 % of pixels",
}


def errors_of(picture: Array, references: list[Array], is_diffuse: NDArray[np.bool_]) -> Row:
    """Return the errors of a picture by MEASURES; where the references do not resolve one, what they resolve."""

    def root(squares: Array) -> float:
        return float(np.sqrt(max(squares.mean(), squares.std() / np.sqrt(squares.size))))

    reference = np.mean(references, axis=0)
    squares = ((picture - references[0]) * (picture - references[1])).mean(axis=2)
    power = (reference**2).mean(axis=2)
    scale = power + 1e-2 * reference.mean() ** 2
    order = np.argsort((((picture - reference) ** 2).mean(axis=2) / scale).ravel())
    kept = order[: order.size - max(round(TRIMMED * order.size), 1)]
    return {
        "whole": root(squares / power.mean()),
        "diffuse": root(squares[is_diffuse] / power[is_diffuse].mean()),
        "trimmed": root((squares / scale).ravel()[kept]),
    }


def text(result: Row) -> str:
    """Return the tables of the result."""
    size = f"{result['size']} x {result['size']} pixels, depth {result['depth']}"
    parts = [f"On {result['machine']}, one thread; {size}; references of {result['reference']:g} s each."]
    found = {(row["scene"], row["asked"], row["renderer"]): row for row in result["rows"]}
    renderers = list(dict.fromkeys(key[2] for key in found))
    for measure, about in MEASURES.items():
        head = ["scene", "seconds", *(TITLES[each] for each in renderers)]
        lines = []
        for scene, seconds in dict.fromkeys(key[:2] for key in found):
            values = [found[scene, seconds, each][measure] for each in renderers]
            lines.append([f"`{scene}`", f"{seconds:g}", *(f"{value:.2%}" for value in values)])
        if "caustics" in renderers:
            for other in renderers:
                if other != "caustics":
                    ratios = [
                        found[(*key, other)][measure] / found[(*key, "caustics")][measure]
                        for key in dict.fromkeys(key[:2] for key in found)
                    ]
                    about += f"; {TITLES[other]} has {geometric_mean(ratios):.1f} times that of `--caustics`"
        parts.append(f"Error `{measure}`: {about}.\n\n{table(head, lines)}")
    return "\n\n".join(parts)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES), metavar="NAME")
    parser.add_argument("--renderers", nargs="+", choices=list(TITLES), default=list(TITLES), metavar="NAME")
    parser.add_argument("--seconds", nargs="+", type=float, default=[10.0, 60.0], help="of CPU (default: 10 60)")
    parser.add_argument("--reference", type=float, default=300.0, help="seconds of CPU of references (default: 300)")
    parser.add_argument("--size", type=int, default=96, help="pixels on each side (default: 96)")
    parser.add_argument("--depth", type=int, default=10, help="most segments of a path (default: 10)")
    parser.add_argument("--folder", type=Path, help="keep scenes and references here, and use those that are here")
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
