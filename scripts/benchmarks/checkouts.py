"""`checkouts`: this checkout beside others of wrt, such as one from before a change."""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from peers.peer import OWN, Environments, Peer, PeerError, Session, prepare

import wrt
from benchmarks.render import next_seed, samples_for
from benchmarks.scenes import CASES, Budget

_LEAST_SPP = 16
"""Passes of fewer samples are rendered another way: fewer of a pixel side by side."""


def benchmark_checkouts(options: argparse.Namespace) -> dict[str, Any]:
    """Return how many times as fast this checkout renders each scene as every other one.

    Short renders in turn, of the same samples. Each ratio is that of two renders one after the other, so what slows the
    machine for longer than that slows both. Seconds are of CPU: what other work takes of the machine is not counted.
    """
    workers = [OWN, *(worker_of(checkout, k) for k, checkout in enumerate(options.checkouts))]
    print("| scene | spp | M paths/s | over | ratio | quartiles |\n| --- | --- | --- | --- | --- | --- |")
    rows = []
    for name in options.scenes:
        scene = CASES[name].scene(options.size, Budget(options.share)) if name in CASES else wrt.load(name)
        scene = dataclasses.replace(
            scene, settings=dataclasses.replace(scene.settings, width=options.size, height=options.size)
        )
        with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
            folder = Path(temporary)
            prepare(OWN, scene, folder)
            sessions = [stack.enter_context(session_of(worker, folder, options)) for worker in workers]
            spp = max(_LEAST_SPP, samples_for(sessions[0], options.seconds))
            seconds = [[cpu_seconds(session, spp) for session in sessions] for _ in range(1 + options.rounds)][1:]
        rate = options.size**2 * spp / statistics.median(row[0] for row in seconds) / 1e6 * options.threads
        for k, checkout in enumerate(options.checkouts, start=1):
            ratios = [row[k] / row[0] for row in seconds]
            low, ratio, high = quartiles(ratios)
            print(
                f"| `{Path(name).stem}` | {spp} | {rate:.3f} | {checkout} | {ratio:.3f} | {low:.2f} to {high:.2f} |",
                flush=True,
            )
            rows.append({"scene": name, "spp": spp, "checkout": str(checkout), "ratio": ratio, "ratios": ratios})
    return {"benchmark": "checkouts", "size": options.size, "threads": options.threads, "rows": rows}


def worker_of(checkout: Path, number: int) -> Peer:
    """Return wrt as a folder has it, by a name of its own."""
    worker = checkout.resolve() / "scripts" / "peers" / OWN.script
    if not worker.is_file():
        raise SystemExit(f"{checkout}: no checkout of wrt, as it has no scripts/peers/{OWN.script}")
    return dataclasses.replace(OWN, name=f"{OWN.name}-{number}", script=str(worker))


def session_of(worker: Peer, folder: Path, options: argparse.Namespace) -> Session:
    """Return the process of a checkout, with the scene in a folder."""
    try:
        return Session(worker, folder, Environments(), threads=options.threads)
    except PeerError as error:
        raise SystemExit(f"{worker.script}: {error}") from None


def cpu_seconds(session: Session, spp: int) -> float:
    """Return the seconds of CPU of a new picture."""
    answer = session.ask(do="render", spp=spp, seed=next_seed())
    if "cpu_seconds" not in answer:
        raise SystemExit(f"{session.peer.script}: a checkout from before workers told seconds of CPU")
    return float(answer["cpu_seconds"])


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the lower quartile, the median and the upper quartile of values."""
    low, median, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
    return low, median, high


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("checkouts", type=Path, nargs="+", metavar="FOLDER", help="another checkout of wrt")
    parser.add_argument("--scenes", nargs="+", default=list(CASES), metavar="NAME", help="names, or scene files")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--size", type=int, default=256, help="pixels a side")
    parser.add_argument("--seconds", type=float, default=0.35, help="for each render, about (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=21, help="renders of each (default %(default)s)")
    parser.add_argument("--share", type=float, default=1.0, help="of the triangles and lights of each scene")
