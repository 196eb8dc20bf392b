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

import numpy as np
from numpy.typing import NDArray
from peers.peer import OWN, PEERS, Environments, Peer, PeerError, Session, first_picture_command, prepare, prepare_file

import wrt
from benchmarks.agreement import agreement
from benchmarks.measure import ROOT, Row, gpu
from benchmarks.scenes import CASES, Budget
from wrt.slices import available_threads

Picture = NDArray[np.float64]

_SEEDS = itertools.count(1)

MOST_SPP = 2**14


def next_seed() -> int:
    """Return a new seed for each picture, so that all are independent."""
    return next(_SEEDS)


def benchmark(options: argparse.Namespace) -> Row:
    """Return what was measured of every scene, and wrt's pictures by scene as "pictures"."""
    if options.quick:  # small pictures of small scenes, which take seconds
        options.size, options.seconds, options.repeats, options.times, options.start = 64, 0.1, 2, [0.5], []
    if options.cpu_seconds and options.device != "cpu":
        raise SystemExit("--cpu-seconds: a GPU's work takes none")
    if options.resume and options.json is None:
        raise SystemExit("--resume: needs --json FILE")
    rows: list[Row] = []
    if options.resume and options.json.exists():
        rows = json.loads(options.json.read_text(encoding="utf-8"))["rows"]
    files = {file.stem: file for file in options.files or []}
    pictures: dict[str, Picture] = {}
    for name in list(files) or options.scenes:
        if any(row["scene"] == name for row in rows):
            continue
        row, pictures[name] = measure_scene(name, files.get(name), options)
        rows.append(row)
        if options.json:
            options.json.write_text(json.dumps({"rows": rows}, indent=2) + "\n", encoding="utf-8")
    order = list(files or CASES)
    rows.sort(key=lambda row: order.index(row["scene"]))
    for name in {name for row in rows for name, found in row["renderers"].items() if "left_out" in found}:
        if all("left_out" in row["renderers"].get(name, {}) for row in rows):
            print(f"\n{name} was in no scene. How to get it: {PEERS[name].hint}")
    kind = "files" if files else "gpu" if options.device == "cuda" else "render"
    result = {"benchmark": kind, "device": options.device, "size": options.size, "rows": rows}
    if options.device == "cuda":
        result["gpu"] = gpu()
    return result | {"options": {"seconds": options.seconds, "repeats": options.repeats}, "pictures": pictures}


def measure_scene(name: str, file: Path | None, options: argparse.Namespace) -> tuple[Row, Picture]:
    """Return what was measured of a scene of `CASES` or of a file, and wrt's picture."""
    scene = CASES[name].scene(options.size, Budget(0.01 if options.quick else 1.0)) if file is None else wrt.load(file)
    about = CASES[name].about if file is None else file.name
    print(f"\n{name}: {about}", flush=True)
    pythons = {"mitsuba": options.mitsuba_python, "cycles": options.cycles_python}
    environments = Environments({name: python for name, python in pythons.items() if python}, options.llvm)
    chosen = options.peers or [peer for peer in PEERS if PEERS[peer].device[options.device]]
    triangles = sum(len(shape.mesh.faces) for shape in scene.shapes)
    row: Row = {"scene": name, "about": about, "triangles": triangles, "renderers": {}}
    row |= {"size": options.size, "depth": scene.settings.max_depth}
    sessions: dict[str, Session] = {}
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        folder = Path(temporary)
        if file is not None:
            prepare_file(file, options.size, box=not options.own_filter, folder=folder)
        for peer in (OWN, *(PEERS[each] for each in chosen)):
            try:
                if file is None:
                    prepare(peer, scene, folder)
                cpus = available_threads() if options.cpu_seconds else None
                session = Session(peer, folder, environments, options.device, cpus=cpus)
                sessions[peer.name] = stack.enter_context(session)
            except (NotImplementedError, PeerError) as error:
                print(f"  {peer.name} is left out: {error}", flush=True)
                row["renderers"][peer.name] = {"left_out": str(error)}
        first_samples(sessions, row)
        picture = equal_samples(sessions, row, folder, options)
        if options.times:
            errors_at_equal_time(sessions, row, folder, options.times)
        for session in sessions.values():
            session.process.kill()
        for peer in [session.peer for session in sessions.values()] if name in options.start else []:
            try:
                seconds = start_seconds(peer, folder, environments, options.device)
            except PeerError as error:
                print(f"  {error}", flush=True)
                continue
            row["renderers"][peer.name]["first_picture_seconds"] = seconds
            print(f"  {peer.name}: seconds to a first picture: {seconds}", flush=True)
    return row, picture


def first_samples(sessions: dict[str, Session], row: Row) -> None:
    """Fill in each renderer's seconds of preparation, and of pictures of one sample per pixel."""
    for name, session in sessions.items():
        first = session.render(1, 0)
        repeated = statistics.median(session.render(1, next_seed()) for _ in range(3))
        seconds = {"compile_seconds": max(first - repeated, 0.0), "one_sample_seconds": repeated}
        row["renderers"][name] = {"about": session.about, **seconds}
        prepared = ", ".join(f"{key} {value:.2f} s" for key, value in session.about["seconds"].items())
        print(f"  {name}: {prepared}, first render {first - repeated:.2f} s longer than the next", flush=True)


def equal_samples(sessions: dict[str, Session], row: Row, folder: Path, options: argparse.Namespace) -> Picture:
    """Fill in speed, memory and agreement at as many samples as take wrt `options.seconds`; return wrt's picture."""
    spp = row["spp"] = samples_for(sessions[OWN.name], options.seconds)
    runs: dict[str, list[tuple[Picture, float]]] = {name: [] for name in sessions}
    for _ in range(1 + options.repeats):  # the first one warms up, but its picture counts
        for name, session in sessions.items():
            runs[name].append(session.picture(spp, next_seed(), folder / f"{name}.npy"))
    images = {name: np.stack([image for image, _ in pairs]) for name, pairs in runs.items()}
    for name, session in sessions.items():
        found = row["renderers"][name]
        found["seconds"] = [seconds for _, seconds in runs[name][1:]]
        seconds = statistics.median(found["seconds"]) - found["one_sample_seconds"]
        found["paths_per_second"] = row["size"] ** 2 * (spp - 1) / seconds
        found["ratio"] = row["renderers"][OWN.name]["paths_per_second"] / found["paths_per_second"]
        found["peak_bytes"] = session.peak_memory()
        if name != OWN.name:
            result = agreement(images[OWN.name], images[name], exact=session.peer.exact)
            found["agreement"] = dataclasses.asdict(result)
            print(f"  {name} and wrt {'show the same' if result.agrees else 'DIFFER'}: {result.message}", flush=True)
            print(f"  {name}: wrt is {found['ratio']:.2f} times as fast", flush=True)
    mean: Picture = images[OWN.name].mean(axis=0)
    return mean


def samples_for(session: Session, seconds: float) -> int:
    """Return the power of two of samples per pixel that takes a session about this number of seconds."""
    spp = 4
    while spp < MOST_SPP:
        measured = session.render(spp, next_seed())
        if measured >= 0.25 * seconds:
            return int(min(MOST_SPP, 2 ** round(np.log2(max(4.0, spp * seconds / measured)))))
        spp *= 4
    return MOST_SPP


def errors_at_equal_time(sessions: dict[str, Session], row: Row, folder: Path, times: Sequence[float]) -> None:
    """Fill in the errors of pictures that took equal seconds, start and compilation excluded.

    Each is compared with two independent converged pictures, by wrt and by another renderer of the same meaning where
    there is one. The mean of the product of both differences is free of their own noise, and treats both renderers
    alike where their pictures differ slightly.
    """
    renderers = row["renderers"]

    def picture(name: str, seconds: float) -> tuple[Picture, float, int]:
        spp = max(1, round(seconds * renderers[name]["paths_per_second"] / row["size"] ** 2))
        image, measured = sessions[name].picture(spp, next_seed(), folder / f"{name}.npy")
        return image, measured - renderers[name]["one_sample_seconds"] * (1.0 - 1.0 / spp), spp

    exact = [name for name, session in sessions.items() if session.peer.exact and name != OWN.name]
    pair = row["references"] = (OWN.name, exact[0] if exact else OWN.name)
    references = [picture(name, max(times))[0] for name in pair]
    for name in sessions:
        renderers[name]["errors"] = []
    for seconds, name in itertools.product(times, sessions):
        image, measured, spp = picture(name, seconds)
        # Samples come in whole numbers: brought to equal time by error² ∝ 1 / time.
        error = max(squared_error(image, references) * measured / seconds, 0.0) ** 0.5
        renderers[name]["errors"].append({"seconds": seconds, "spp": spp, "rmse": error})
        print(f"  {name}: {seconds:g} s, {spp} spp: error {error:.5f} of the mean", flush=True)


def squared_error(image: Picture, references: Sequence[Picture]) -> float:
    """Return an unbiased estimate of the squared error over the squared mean, from two noisy pictures of the truth."""
    a, b = references
    return float(((image - a) * (image - b)).mean()) / float(0.5 * (a + b).mean()) ** 2


def start_seconds(peer: Peer, folder: Path, environments: Environments, device: str) -> Row:
    """Return the seconds from the shell to a picture, cold (nothing compiled) and warm (the median of several).

    Cold is about compiled kernels: files are in the system's cache either way.
    """
    picture = folder / "first.png"
    line = first_picture_command(peer, folder, environments, device, picture)
    variables = environments.variables(peer)

    def run(**caches: str) -> float:
        picture.unlink(missing_ok=True)
        started = time.perf_counter()
        done = subprocess.run(line, cwd=ROOT, env={**variables, **caches}, capture_output=True, text=True)
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
    """Add the options of the command."""
    names = list(CASES)
    parser.add_argument("--scenes", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--files", nargs="+", type=Path, metavar="FILE", help="Mitsuba's XML instead of these scenes")
    parser.add_argument("--own-filter", action="store_true", help="the filters of --files, not a box")
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), metavar="NAME", help=f"of {', '.join(PEERS)}")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--seconds", type=float, default=2.0, help="of wrt for a run at equal samples")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--cpu-seconds", action="store_true", help="time renders by seconds of CPU over cores")
    parser.add_argument("--times", type=float, nargs="*", default=[10.0, 60.0], help="seconds for equal time; none: no")
    parser.add_argument("--start", nargs="*", choices=names, default=names, metavar="NAME", help="time from the shell")
    parser.add_argument("--quick", action="store_true", help="small pictures of small scenes, to see that all works")
    parser.add_argument("--resume", action="store_true", help="keep what --json FILE has; it is written scene by scene")
    parser.add_argument("--llvm", type=Path, help="folder below which libLLVM*.so is, for Mitsuba")
    for name in ("mitsuba", "cycles"):
        parser.add_argument(f"--{name}-python", metavar="FILE", help="the Python that has it (default: this one)")
