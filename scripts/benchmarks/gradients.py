"""`gradients`: derivatives of pictures beside wrt's own renders and Mitsuba's `prb` (Vicini et al. 2021)."""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.mitsuba_scene import to_mitsuba
from peers.mitsuba_worker import write_scene
from peers.peer import LLVM_HINT, OWN, PEERS, Environments, PeerError, Session, prepare

import wrt
from benchmarks.measure import Row, table
from benchmarks.scenes import GGX

MITSUBA = PEERS["mitsuba-llvm"]

FIELDS = {
    "reflectance": ("bsdf.brdf_0.reflectance.value",),
    "reflectance.texels": ("bsdf.brdf_0.reflectance.data",),
    "alpha": ("bsdf.brdf_0.alpha_u.value", "bsdf.brdf_0.alpha_v.value"),
    "eta": ("bsdf.brdf_0.eta.value",),
    "k": ("bsdf.brdf_0.k.value",),
    "roughness": ("bsdf.brdf_0.roughness.value",),
    "base_color.texels": ("bsdf.brdf_0.base_color.data",),
    "emission": ("emitter.radiance.value",),
}
"""Mitsuba's names below a shape's, by the end of wrt's."""


def room(**materials: Any) -> wrt.Scene:
    """Return a box with a lamp, open in front, with materials by the names of walls."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 1, 3.4), (0, 1, 0), fov_degrees=40.0))
    walls = {
        "floor": ((-1, 0, 1), (2, 0, 0), (0, 0, -2), (0.3, 0.5, 0.4)),
        "ceiling": ((-1, 2, -1), (2, 0, 0), (0, 0, 2), (0.7, 0.65, 0.6)),
        "back": ((-1, 0, -1), (2, 0, 0), (0, 2, 0), (0.7, 0.7, 0.6)),
        "left": ((-1, 0, 1), (0, 0, -2), (0, 2, 0), (0.6, 0.3, 0.2)),
        "right": ((1, 0, -1), (0, 0, 2), (0, 2, 0), (0.2, 0.5, 0.3)),
    }
    for name, (corner, u, v, color) in walls.items():
        scene.add(wrt.quad(corner, u, v), material=materials.get(name, wrt.Diffuse(color)), name=name)
    scene.add(wrt.quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8)), emission=(9.0, 8.0, 7.0), name="lamp")
    return scene


def diffuse() -> wrt.Scene:
    """Return a box of diffuse walls."""
    return room()


def metal() -> wrt.Scene:
    """Return a box with a floor of rough copper."""
    return room(floor=wrt.RoughConductor(alpha=0.3, **GGX))


def principled() -> wrt.Scene:
    """Return a box with a textured metal at its back: Mitsuba has the same model of such a Principled."""
    pixels = np.random.default_rng(3).uniform(0.2, 0.8, (8, 8, 3))
    return room(back=wrt.Principled(wrt.ImageTexture(pixels), metallic=1.0, roughness=0.5))


def environment() -> wrt.Scene:
    """Return a block on a floor in the light of an image."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((1, 1.5, 3.4), (0, 0.3, 0), fov_degrees=40.0))
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse((0.3, 0.5, 0.4)), name="floor")
    scene.add(wrt.box((-0.4, 0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.6, 0.3, 0.2)), name="block")
    scene.environment = wrt.ImageEnvironment(np.random.default_rng(4).uniform(0.2, 3.0, (8, 16, 3)).astype(np.float32))
    return scene


CASES: dict[str, tuple[Callable[[], wrt.Scene], tuple[str, ...]]] = {
    "diffuse": (diffuse, ("floor.reflectance", "left.reflectance", "lamp.emission")),
    "metal": (metal, ("floor.alpha", "floor.eta", "floor.k", "lamp.emission")),
    "principled": (principled, ("back.roughness", "back.base_color.texels", "left.reflectance")),
    "environment": (environment, ("environment.texels", "floor.reflectance", "block.reflectance")),
}
"""Scenes, and the parameters by which they are differentiated."""


def mitsuba_names(scene: wrt.Scene, name: str) -> list[str]:
    """Return what Mitsuba calls a parameter: the sum of the derivatives by these is that by wrt's."""
    if name == "environment.texels":
        return ["environment.data"]
    shape, _, field = name.partition(".")
    number = [each.name for each in scene.shapes].index(shape)
    return [f"shape_{number}.{end}" for end in FIELDS[field]]


def as_ours(name: str, gradient: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return Mitsuba's derivative by a parameter in wrt's layout; see `to_mitsuba` for textures."""
    if name == "environment.texels":
        # A column is repeated on either side, and between two rows their mean is.
        gradient = gradient.reshape(2 * shape[0] + 1, shape[1] + 2, 3)
        columns = gradient[:, 1:-1].copy()
        columns[:, -1] += gradient[:, 0]
        columns[:, 0] += gradient[:, -1]
        rows = columns[1::2] + 0.5 * (columns[:-1:2] + columns[2::2])
        rows[0] += 0.5 * columns[0]
        rows[-1] += 0.5 * columns[-1]
        return rows
    gradient = gradient.reshape(shape)
    return gradient[::-1] if name.endswith(".texels") else gradient


def benchmark(options: argparse.Namespace) -> Row:
    """Return seconds of CPU of gradients and renders, their ratios, and z-values between the gradients."""
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        for name in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(measured(name, Path(folder), Path(cache), options))
            print(texts_of([rows[-1]]), flush=True)
    settings = {key: getattr(options, key) for key in ("size", "spp", "depth", "seeds")}
    return {"benchmark": "gradients", "rows": rows, **settings}


def measured(name: str, folder: Path, cache: Path, options: argparse.Namespace) -> Row:
    """Return the results of a scene."""
    make, names = CASES[name]
    scene = make()
    size = options.size
    scene.settings = wrt.RenderSettings(width=size, height=size, max_depth=options.depth, filter="box")
    shapes = {key: value.shape for key, value in wrt.parameters(scene).items() if key in names}
    d_image = folder / "d_image.npy"
    np.save(d_image, np.random.default_rng(0).uniform(0.5, 1.5, (size, size, 3)).astype(np.float32) / size**2)
    prepare(OWN, scene, folder)
    question = {"d_image": str(d_image), "spp": options.spp, "save": str(folder / "gradients.npz")}
    ours, theirs = [*names], [key for each in names for key in mitsuba_names(scene, each)]

    def gradients(session: Session, keys: list[str], seed: int) -> tuple[float, dict[str, NDArray[np.float64]]]:
        seconds = session.ask(do="gradients", names=keys, seed=seed, **question)["cpu_seconds"]
        with np.load(question["save"]) as found:
            return seconds, {key: found[key].astype(np.float64) for key in keys}

    own_cache = {"XDG_CACHE_HOME": str(cache), "WRT_BACKGROUND": "0"}
    environments = Environments(llvm=options.llvm, more=own_cache)
    scalar = Environments(more=own_cache | {"WRT_WIDE": "0"})
    row: Row = {"scene": name}
    seconds: dict[str, list[float]] = {}
    found: dict[str, list[dict[str, NDArray[np.float64]]]] = {"wrt": [], "mitsuba": []}
    with Session(OWN, folder, environments, threads=1) as wide:
        row["cold"] = gradients(wide, ours, 0)[0]
        with Session(OWN, folder, scalar, threads=1) as narrow:
            mitsuba = start_mitsuba(scene, folder, environments, options.depth)
            row["mitsuba"] = mitsuba.about["variant"] if isinstance(mitsuba, Session) else mitsuba
            for seed in range(1 + options.seeds):
                times, ours_now = {}, gradients(wide, ours, seed)
                times["wrt"], values = ours_now
                if seed:
                    found["wrt"].append(values)
                if seed <= options.repeats:
                    times["wrt as rendered"] = wide.ask(do="render", spp=options.spp, seed=seed)["cpu_seconds"]
                    times["wrt scalar"] = narrow.ask(do="render", spp=options.spp, seed=seed)["cpu_seconds"]
                if isinstance(mitsuba, Session):
                    times["mitsuba"], values = gradients(mitsuba, theirs, seed)
                    if seed:
                        found["mitsuba"].append(
                            {
                                key: as_ours(key, sum(values[k] for k in mitsuba_names(scene, key)), shapes[key])
                                for key in names
                            }
                        )
                    if seed <= options.repeats:
                        times["mitsuba rendered"] = mitsuba.ask(do="render", spp=options.spp, seed=seed)["cpu_seconds"]
                for key, value in times.items() if seed else ():
                    seconds.setdefault(key, []).append(value)
            if isinstance(mitsuba, Session):
                mitsuba.__exit__()
    row["seconds"] = {key: statistics.median(values) for key, values in seconds.items()}
    if found["mitsuba"]:
        row["agreement"] = {key: agreement(*([each[key] for each in found[k]] for k in found)) for key in names}
    return row


def start_mitsuba(scene: wrt.Scene, folder: Path, environments: Environments, depth: int) -> Session | str:
    """Return Mitsuba with the scene, or why there is none; its scalar variants have no derivatives."""
    try:
        size = {"width": scene.settings.width, "height": scene.settings.height}
        tree = to_mitsuba(scene, folder, **size, max_depth=depth)
        tree["integrator"]["type"] = "prb"
        write_scene(tree, folder)
        return Session(MITSUBA, folder, environments, threads=1)
    except (PeerError, ImportError) as error:
        return f"none: {error}"


def agreement(ours: list[NDArray[np.float64]], theirs: list[NDArray[np.float64]]) -> Row:
    """Return means over seeds of both gradients' sums, Welch's z of these, and the largest z of single values."""

    def z(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        variance = a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)
        difference = a.mean(axis=0) - b.mean(axis=0)
        return np.divide(difference, np.sqrt(variance), out=np.zeros_like(difference), where=variance > 0.0)

    a, b = (np.stack(each).reshape(len(each), -1) for each in (ours, theirs))
    return {
        "wrt": float(a.sum(axis=1).mean()),
        "mitsuba": float(b.sum(axis=1).mean()),
        "z": float(z(a.sum(axis=1), b.sum(axis=1))),
        "largest_z": float(np.abs(z(a, b)).max()),
        "values": a.shape[1],
    }


def texts_of(rows: list[Row]) -> str:
    """Return the tables of some scenes."""
    head = ["scene", "wrt, seconds of CPU", "cold", "/ wrt scalar", "/ wrt as rendered", "Mitsuba `prb` / wrt"]
    lines, others = [], []
    for row in rows:
        seconds = row["seconds"]
        ratios = [f"{seconds['wrt'] / seconds[key]:.2f}" for key in ("wrt scalar", "wrt as rendered")]
        peer = f"{seconds['mitsuba'] / seconds['wrt']:.2f}" if "mitsuba" in seconds else row["mitsuba"]
        lines.append([f"`{row['scene']}`", f"{seconds['wrt']:.3f}", f"{row['cold']:.1f}", *ratios, peer])
        for key, of in row.get("agreement", {}).items():
            numbers = [f"{of['wrt']:.5g}", f"{of['mitsuba']:.5g}", f"{of['z']:+.2f}", f"{of['largest_z']:.2f}"]
            others.append([f"`{row['scene']}`", f"`{key}`", *numbers, str(of["values"])])
    agreement_head = ["scene", "parameter", "sum, wrt", "Mitsuba", "z", "largest z of one value", "values"]
    return table(head, lines) + ("\n" + table(agreement_head, others) if others else "")


def text(result: Row) -> str:
    """Return the tables of the result."""
    size = f"{result['size']} x {result['size']} pixels, {result['spp']} samples, depth {result['depth']}"
    variants = ", ".join(dict.fromkeys(row["mitsuba"] for row in result["rows"]))
    return f"On {result['machine']}, one thread; {size}; Mitsuba: {variants}.\n\n{texts_of(result['rows'])}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--scenes", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    parser.add_argument("--size", type=int, default=64, help="pixels on each side (default: 64)")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--depth", type=int, default=5, help="most segments of a path (default: 5)")
    parser.add_argument("--repeats", type=int, default=5, help="renders that are timed (default: 5)")
    parser.add_argument("--seeds", type=int, default=32, help="gradients that are timed and compared (default: 32)")
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)
