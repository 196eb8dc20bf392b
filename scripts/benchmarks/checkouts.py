"""`checkouts`: this checkout beside others of wrt, such as one from before a change."""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from peers.peer import OWN, Environments, Peer, Session, prepare

import wrt
from benchmarks.measure import Row, table
from benchmarks.render import next_seed, samples_for
from benchmarks.scenes import CASES, Budget

_LEAST_SPP = 16
"""Passes of fewer samples follow fewer samples of a pixel side by side, and are not representative."""


def benchmark(options: argparse.Namespace) -> Row:
    """Return how many times as fast this checkout renders each scene as every other one.

    Short renders in turn, of the same samples. Each ratio is that of two consecutive renders, so what slows the machine
    for longer than that slows both. Seconds are of CPU, which excludes other work on the machine.
    """
    workers = [OWN, *(worker_of(checkout, k) for k, checkout in enumerate(options.checkouts))]
    rows = []
    for name in options.scenes:
        scene = CASES[name].scene(options.size, Budget()) if name in CASES else wrt.load(name)
        settings = dataclasses.replace(scene.settings, width=options.size, height=options.size)
        with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
            folder = Path(temporary)
            prepare(OWN, dataclasses.replace(scene, settings=settings), folder)
            sessions = [
                stack.enter_context(Session(worker, folder, Environments(), threads=options.threads, cpus=1))
                for worker in workers
            ]
            spp = max(_LEAST_SPP, samples_for(sessions[0], options.seconds))
            rounds = [[session.render(spp, next_seed()) for session in sessions] for _ in range(1 + options.rounds)][1:]
        rate = options.size**2 * spp / statistics.median(ours for ours, *_ in rounds) / 1e6 * options.threads
        for k, checkout in enumerate(options.checkouts, start=1):
            ratios = [seconds[k] / seconds[0] for seconds in rounds]
            low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75)).tolist()
            print(f"{name}: {ratio:.3f} times as fast as {checkout} ({low:.2f} to {high:.2f})", flush=True)
            row = {"scene": name, "spp": spp, "mega_paths_per_second": rate, "checkout": str(checkout)}
            rows.append(row | {"ratio": ratio, "quartiles": [low, high], "ratios": ratios})
    return {"benchmark": "checkouts", "size": options.size, "threads": options.threads, "rows": rows}


def worker_of(checkout: Path, number: int) -> Peer:
    """Return the wrt of a folder as a renderer to compare with."""
    worker = checkout.resolve() / "scripts" / "peers" / OWN.script
    if not worker.is_file():
        raise SystemExit(f"{checkout}: not a checkout of wrt, as it has no scripts/peers/{OWN.script}")
    return dataclasses.replace(OWN, name=f"{OWN.name}-{number}", script=str(worker))


def text(result: Row) -> str:
    """Return the results as a table."""
    lines = [
        [f"`{Path(row['scene']).stem}`", str(row["spp"]), f"{row['mega_paths_per_second']:.3f}", row["checkout"]]
        + [f"{row['ratio']:.3f}", "{:.2f} to {:.2f}".format(*row["quartiles"])]
        for row in result["rows"]
    ]
    return table(["scene", "spp", "M paths/s", "over", "ratio", "quartiles"], lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("checkouts", type=Path, nargs="+", metavar="FOLDER", help="another checkout of wrt")
    parser.add_argument("--scenes", nargs="+", default=list(CASES), metavar="NAME", help="names, or scene files")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--size", type=int, default=256, help="pixels a side")
    parser.add_argument("--seconds", type=float, default=0.35, help="for each render, about (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=21, help="renders of each (default %(default)s)")
