#!/usr/bin/env python3
"""How many workers one head node keeps busy.

Measures what a window costs the head node (client and scheduler) and a worker of Dask, in CPU time, for windows of
several sizes; fits a cost per window and one per byte; and counts the windows of some pictures with the code that cuts
them. The head node is taken to be a single core, whose time a pass must not exceed.

With --check it also renders windows of one row on this machine, whose work is far less than what they cost the head
node, and prints its CPU time as the model has it and as it is.

    python scripts/cluster_model.py
    python scripts/cluster_model.py --check
    python scripts/cluster_model.py --path-us 1.2 --scene-mb 300
"""

from __future__ import annotations

import argparse
import copy
import os
import threading
import time

import numpy as np

import wrt
from wrt.distributed import DistributedRenderer, windows
from wrt.distributed.clients import client_of
from wrt.distributed.dask_cluster import DaskCluster
from wrt.distributed.head import LONGEST_PASS
from wrt.distributed.windows import windows_of_pass

BYTES = 56
"""Of a film's pixel without layers, to the worker and back."""

WIDTH = 64
"""Pixels of a window that --check renders."""

PIXELS = (1_000, 20_000, 100_000)
"""Sizes of windows that are measured."""


def film(pixels: int) -> dict[str, np.ndarray]:
    """Return arrays like those of a film."""
    sums = np.random.default_rng(1).random((2, pixels, 3))
    counts = np.zeros((2, pixels), np.int32)
    return {"total": sums[0], "total_of_squares": sums[1], "count": counts[0], "rejected": counts[1]}


def seconds_of(pids: list[int]) -> list[float]:
    """Return the CPU seconds of processes."""
    import psutil

    return [sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids]


def measure(calls: int) -> np.ndarray:
    """Return seconds a window and seconds a byte, for the head node and for a worker: (2, 2)."""
    client = client_of("local:1")
    cluster, ended = DaskCluster(client), threading.Event()
    address = cluster.addresses()[0]
    pids = [os.getpid(), client.run(os.getpid)[address]]
    found = []
    for pixels in PIXELS:
        state = film(pixels)
        before = seconds_of(pids)
        for call in range(calls):
            future = cluster.submit(address, ended.set, f"{pixels}-{call}", copy.copy, state)
            while not future.done():
                ended.wait(0.2)
                ended.clear()
            cluster.result(future)
        found.append((np.array(seconds_of(pids)) - before) / calls)
        head, worker = 1e3 * found[-1]
        size = f"{pixels:6d} pixels, {pixels * BYTES / 1e6:4.1f} MB"
        print(f"window of {size}: head {head:5.1f} ms, worker {worker:5.1f} ms")
    client.close()
    sizes = np.array([[1.0, pixels * BYTES] for pixels in PIXELS])
    costs, *_ = np.linalg.lstsq(sizes, np.array(found), rcond=None)
    return np.asarray(costs.T)


def head_share(size: tuple[int, int], spp: int, workers: int, path: float, costs: np.ndarray) -> tuple[float, int]:
    """Return the head node's CPU time over the time of a render, and the windows of a pass.

    Args:
        size: pixels.
        spp: samples per pixel.
        workers: workers of one core.
        path: seconds of a path on a core.
        costs: of the head node, seconds a window and seconds a byte.
    """
    pixels = size[0] * size[1]
    seconds = pixels * spp * path / workers
    passes = max(1, round(seconds / LONGEST_PASS))
    crop, of_pixel = (0, 0, *size), spp / passes * path
    windows = sum(1 for _ in windows_of_pass(crop, lambda: workers, lambda: of_pixel))
    head = passes * (windows * costs[0] + pixels * BYTES * costs[1])
    return float(head / seconds), windows


def check(workers: int, costs: np.ndarray, rows: int, passes: int) -> None:
    """Render windows of one row on so many workers of this machine; print what they cost and should cost."""
    windows.SHORTEST_SECONDS = windows.LONGEST_SECONDS = 1e-12
    client = client_of(f"local:{workers}")
    try:
        renderer = DistributedRenderer(wrt.load("cornell-box"), client=client, width=WIDTH, height=rows)
        for _ in renderer.passes(spp=1):
            pass  # the scene is built, and later passes have a state to go on from
        before, began = seconds_of([os.getpid()])[0], time.perf_counter()
        for target in range(2, passes + 2):
            renderer._trace(target, 0.0)
        head, clock = seconds_of([os.getpid()])[0] - before, time.perf_counter() - began
    finally:
        client.close()
    count = rows * passes
    model = count * costs[0] + count * WIDTH * BYTES * costs[1]
    print(
        f"{workers} workers, {count} windows of {WIDTH} pixels: head node {1e3 * head / count:.1f} ms each, "
        f"model {1e3 * model / count:.1f}; busy for {head / clock:.2f} of the time, model {model / clock:.2f}"
    )


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=100, help="windows of each size that are measured")
    parser.add_argument("--path-us", type=float, default=0.8, help="microseconds of a path on a core of a worker")
    parser.add_argument("--scene-mb", type=float, default=30.0, help="megabytes of a scene, which goes to each worker")
    parser.add_argument("--check", action="store_true", help="compare with renders on 1, 2, 4 and 7 workers here")
    options = parser.parse_args()
    costs = measure(options.calls)[0]
    print(f"head: {1e3 * costs[0]:.1f} ms a window, {1e9 * costs[1]:.2f} ms a megabyte")
    if options.check:
        for workers in (1, 2, 4, 7):
            check(workers, costs, rows=64, passes=4)
        return
    path, scene = 1e-6 * options.path_us, 1e6 * options.scene_mb * costs[1] / 2.0  # a scene goes one way
    print("picture, workers: windows a pass, head's share of the time")
    for name, size, spp, frames in (
        ("4k, 1024 spp", (3840, 2160), 1024, 1),
        ("1000 frames of 1920x1080, 256 spp", (1920, 1080), 256, 1000),
        ("10000 views of 256x256, 64 spp", (256, 256), 64, 10_000),
    ):
        for workers in (4, 16, 64, 128, 256, 512, 1024):
            share, windows = head_share(size, spp, workers, path, costs)
            seconds = size[0] * size[1] * spp * path / workers
            if name.startswith("1000 "):  # each frame is a scene of its own
                share += workers * (scene + 2.0 * costs[0]) / seconds
            total = frames * seconds * max(share, 1.0)
            print(f"{name}, {workers:5d}: {windows:6d}, {share:7.3f}, {total / 3600.0:8.2f} h")
            if share > 1.0:
                break


if __name__ == "__main__":
    main()
