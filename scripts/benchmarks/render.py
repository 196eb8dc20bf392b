"""`render`: wrt beside other renderers, scene by scene, at equal samples and at equal time."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.peer import OWN, PEERS, Environments, Peer, PeerError, Session, first_picture_command, prepare, prepare_file

import wrt
from benchmarks.agreement import agreement
from benchmarks.measure import ROOT
from benchmarks.scenes import CASES, Budget
from wrt.backend.slices import available_threads

Picture = NDArray[np.float64]
Row = dict[str, Any]

_SEEDS = itertools.count(1)

MOST_SPP = 2**14


def next_seed() -> int:
    """Return a number for each picture, so that no two are alike by chance."""
    return next(_SEEDS)


def benchmark_render(options: argparse.Namespace) -> Row:
    """Return what was measured of every scene, and the pictures of wrt by `options.pictures`."""
    if options.quick:
        make_quick(options)
    if options.cpu_seconds and options.device != "cpu":
        raise SystemExit("--cpu-seconds: a GPU's work takes none")
    environments = environments_of(options)
    asked = options.peers or [name for name, peer in PEERS.items() if peer.device[options.device]]
    peers = [OWN, *(PEERS[name] for name in asked)]
    cpus = available_threads() if options.cpu_seconds else None
    rows = rows_of(options.json) if options.resume else []
    pictures: dict[str, Picture] = {}
    left_out: dict[str, str] = {}
    files = {file.stem: file for file in options.files or []}
    names = list(files) or options.scenes
    for name in names:
        if any(row["scene"] == name for row in rows):
            continue
        file = files.get(name)
        scene = CASES[name].scene(options.size, Budget(options.share)) if file is None else wrt.load(file)
        about = CASES[name].about if file is None else file.name
        print(f"\n{name}: {about}", flush=True)
        with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
            folder = Path(temporary)
            triangles = sum(len(shape.mesh.faces) for shape in scene.shapes)
            row: Row = {"scene": name, "about": about, "triangles": triangles, "renderers": {}}
            sessions: dict[str, Session] = {}
            if file is not None:
                prepare_file(file, options.size, box=not options.own_filter, folder=folder)
            for peer in peers:
                try:
                    if file is None:
                        prepare(peer, scene, folder)
                    sessions[peer.name] = stack.enter_context(
                        Session(peer, folder, environments, options.device, cpus=cpus)
                    )
                except (NotImplementedError, PeerError) as error:
                    print(f"  {peer.name} is left out: {error}", flush=True)
                    row["renderers"][peer.name] = {"left_out": str(error)}
                    left_out[peer.name] = peer.hint
            row |= {"size": options.size, "depth": scene.settings.max_depth}
            pictures[name] = measure_scene(sessions, row, folder, options)
            for session in sessions.values():
                session.process.kill()
            if name in options.start:
                measure_starts(sessions, row, folder, environments, options)
            rows.append(row)
            if options.json:
                options.json.write_text(json.dumps({"rows": rows}, indent=2) + "\n", encoding="utf-8")
    order = list(files or CASES)
    rows.sort(key=lambda row: order.index(row["scene"]))
    for name in left_out:
        if all("left_out" in row["renderers"].get(name, {}) for row in rows):
            print(f"\n{name} was in no scene. How to get it: {PEERS[name].hint}")
    kind = "files" if files else "gpu" if options.device == "cuda" else "render"
    result = {"benchmark": kind, "device": options.device, "size": options.size, "rows": rows}
    return result | {"options": {"seconds": options.seconds, "repeats": options.repeats}, "pictures": pictures}


def rows_of(file: Path | None) -> list[Row]:
    """Return the scenes that an earlier run has measured; none where there is no such file yet."""
    if file is None:
        raise SystemExit("--resume: needs --json FILE")
    if not file.exists():
        return []
    rows: list[Row] = json.loads(file.read_text(encoding="utf-8"))["rows"]
    return rows


def environments_of(options: argparse.Namespace) -> Environments:
    """Return where the renderers are, of the command line."""
    pythons = {"mitsuba": options.mitsuba_python, "cycles": options.cycles_python, "luxcore": options.luxcore_python}
    return Environments({name: python for name, python in pythons.items() if python}, options.llvm)


def in_words(started: Row) -> str:
    """Return the seconds to a first picture as a text."""
    return ", ".join(f"{seconds:.2f} s {name}" for name, seconds in started.items())


def measure_scene(sessions: dict[str, Session], row: Row, folder: Path, options: argparse.Namespace) -> Picture:
    """Fill in a scene's row: preparation, speed, agreement, memory, error at equal time; return wrt's picture."""
    pixels = row["size"] ** 2
    found = row["renderers"]
    for name, session in sessions.items():
        first = session.render(1, 0)
        again = statistics.median(session.render(1, next_seed()) for _ in range(3))
        own = {"about": session.about, "compile_seconds": max(first - again, 0.0), "one_sample_seconds": again}
        found[name] = own
        seconds = ", ".join(f"{key} {value:.2f} s" for key, value in session.about["seconds"].items())
        print(f"  {name}: {seconds}, first render {first - again:.2f} s longer than the next", flush=True)

    # Speed, at as many samples as give wrt the seconds asked for.
    spp = samples_for(sessions[OWN.name], options.seconds)
    row["spp"] = spp
    runs: dict[str, list[tuple[Picture, float]]] = {name: [] for name in sessions}
    for _ in range(1 + options.repeats):  # the first is to warm up, but its picture counts
        for name, session in sessions.items():
            runs[name].append(session.picture(spp, next_seed(), folder / f"{name}.npy"))
    images = {name: np.stack([image for image, _ in pairs]) for name, pairs in runs.items()}
    exact = [name for name, session in sessions.items() if session.peer.exact]
    for name, session in sessions.items():
        own = found[name]
        own["seconds"] = [seconds for _, seconds in runs[name][1:]]
        rate = pixels * (spp - 1) / (statistics.median(own["seconds"]) - own["one_sample_seconds"])
        own["paths_per_second"] = rate
        own["peak_bytes"] = session.peak_memory()
        if name != OWN.name:
            result = agreement(images[OWN.name], images[name], exact=session.peer.exact)
            own["agreement"] = dataclasses.asdict(result)
            print(f"  {name} and wrt {'show the same' if result.agrees else 'DIFFER'}: {result.message}", flush=True)
    ours = found[OWN.name]["paths_per_second"]
    for name in sessions:
        own = found[name]
        own["ratio"] = ours / own["paths_per_second"]
        text = f"{own['paths_per_second'] / 1e6:.3f} M paths/s, wrt is {own['ratio']:.2f} times as fast"
        print(f"  {name}: {text}, {own['peak_bytes'] / 1e6:.0f} MB", flush=True)

    if options.times:
        errors_at_equal_time(sessions, exact, row, folder, options)
    best: Picture = images[OWN.name].mean(axis=0)
    return best


def samples_for(session: Session, seconds: float) -> int:
    """Return the power of two of samples per pixel that takes a session about so long."""
    spp = 4
    while spp < MOST_SPP:
        taken = session.render(spp, next_seed())
        if taken >= 0.25 * seconds:
            return int(min(MOST_SPP, 2 ** round(np.log2(max(4.0, spp * seconds / taken)))))
        spp *= 4
    return MOST_SPP


def errors_at_equal_time(
    sessions: dict[str, Session], exact: Sequence[str], row: Row, folder: Path, options: argparse.Namespace
) -> None:
    """Fill in the errors of pictures that took equal seconds, start and compilation apart.

    Each is compared with two converged pictures that know nothing of each other, by wrt and by another renderer of the
    same meaning where there is one. The mean of the product of both differences is free of their own noise, and
    treats both alike where they do not mean quite the same.
    """
    pixels = row["size"] ** 2
    found = row["renderers"]

    def picture(name: str, seconds: float) -> tuple[Picture, float, int]:
        spp = max(1, round(seconds * found[name]["paths_per_second"] / pixels))
        image, taken = sessions[name].picture(spp, next_seed(), folder / f"{name}.npy")
        return image, taken - found[name]["one_sample_seconds"] * (1.0 - 1.0 / spp), spp

    pair = (OWN.name, next((name for name in exact if name != OWN.name), OWN.name))
    references = [picture(name, options.reference or max(options.times))[0] for name in pair]
    row["references"] = pair
    for name in sessions:
        found[name]["errors"] = []
    for seconds in options.times:
        for name in sessions:
            squares = []
            for _ in range(options.error_repeats):
                image, taken, spp = picture(name, seconds)
                # Samples come in whole numbers: brought to equal time by error² ∝ 1 / time.
                squares.append({key: s * taken / seconds for key, s in squared_errors(image, references).items()})
            errors = {key: statistics.median(s[key] for s in squares) for key in squares[0]}
            errors = {key: float(np.sqrt(max(value, 0.0))) for key, value in errors.items()}
            found[name]["errors"].append({"seconds": seconds, "spp": spp, **errors})
            text = f"error {errors['rmse']:.5f} of the mean, relative error {errors['relative']:.5f}"
            print(f"  {name}: {seconds:g} s, {spp} spp: {text}", flush=True)


def squared_errors(image: Picture, references: Sequence[Picture]) -> dict[str, float]:
    """Return unbiased estimates of squared errors against what two noisy pictures both stand for.

    "rmse" is over the picture's mean; "relative" weighs every pixel by its own radiance, and a tenth of the mean.
    """
    a, b = references
    both = 0.5 * (a + b)
    mean = float(both.mean())
    product = (image - a) * (image - b)
    relative = product / (both**2 + (0.1 * mean) ** 2)
    return {"rmse": float(product.mean()) / mean**2, "relative": float(relative.mean())}


def measure_starts(
    sessions: dict[str, Session], row: Row, folder: Path, environments: Environments, options: argparse.Namespace
) -> None:
    """Fill in each renderer's seconds from the shell to a first picture."""
    for name, session in sessions.items():
        try:
            started = start_seconds(session.peer, folder, environments, options)
        except PeerError as error:
            print(f"  {error}", flush=True)
            continue
        row["renderers"][name]["first_picture_seconds"] = started
        print(f"  {name}: first picture after {in_words(started)}", flush=True)


def start_seconds(peer: Peer, folder: Path, environments: Environments, options: argparse.Namespace) -> Row:
    """Return the seconds from the shell to a picture, cold (nothing compiled) and warm (the median of several).

    Cold is about compiled kernels: files are in the system's cache either way.
    """
    picture = folder / "first.png"
    line = first_picture_command(peer, folder, environments, options.device, picture)
    variables = environments.variables(peer)

    def run(**extra: str) -> float:
        picture.unlink(missing_ok=True)
        started = time.perf_counter()
        done = subprocess.run(line, cwd=ROOT, env={**variables, **extra}, capture_output=True, text=True)
        seconds = time.perf_counter() - started
        if done.returncode or not picture.exists():
            raise PeerError(f"{peer.name}: no first picture: {done.stderr.strip().splitlines()[-1:]}")
        return seconds

    with tempfile.TemporaryDirectory() as cache:
        # Mitsuba keeps its kernels below HOME, wrt where Warp does.
        cold = run(HOME=cache, XDG_CACHE_HOME=cache, WARP_CACHE_PATH=cache)
    run()
    return {"cold": cold, "warm": statistics.median(run() for _ in range(3))}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--scenes", nargs="+", choices=list(CASES), default=list(CASES), metavar="NAME")
    parser.add_argument("--files", nargs="+", type=Path, metavar="FILE", help="Mitsuba's XML instead of these scenes")
    parser.add_argument("--own-filter", action="store_true", help="the filters of --files, not a box")
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), metavar="NAME", help=f"of {', '.join(PEERS)}")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--seconds", type=float, default=2.0, help="of wrt for a run at equal samples")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--cpu-seconds",
        action="store_true",
        help="time renders by seconds of CPU over cores, if others use them",
    )
    parser.add_argument("--times", type=float, nargs="*", default=[10.0, 60.0], help="seconds for equal time; none: no")
    parser.add_argument("--error-repeats", type=int, default=1, help="pictures behind each error, of which the median")
    parser.add_argument("--reference", type=float, help="seconds of each converged picture (default: the most of them)")
    parser.add_argument("--share", type=float, default=1.0, help="of the triangles and lights of each scene")
    parser.add_argument(
        "--start",
        nargs="*",
        choices=list(CASES),
        default=list(CASES),
        metavar="NAME",
        help="scenes to time from the shell",
    )
    parser.add_argument("--quick", action="store_true", help="small pictures of small scenes, to see that all works")
    parser.add_argument("--resume", action="store_true", help="keep what --json FILE has; it is written scene by scene")
    parser.add_argument("--llvm", type=Path, help="folder below which libLLVM*.so is, for Mitsuba")
    for name in ("mitsuba", "cycles", "luxcore"):
        parser.add_argument(f"--{name}-python", metavar="FILE", help="the Python that has it (default: this one)")


def make_quick(options: argparse.Namespace) -> None:
    """Have everything take seconds."""
    options.size, options.seconds, options.repeats, options.share = 64, 0.1, 2, 0.01
    options.times, options.start = [0.5], []
