"""`lights`: the error after equal seconds of CPU, where lights are chosen by power and where by the tree."""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from night_city import night_city

import wrt


def lit_picture(scene: wrt.Scene, spp: int, **options: Any) -> tuple[np.ndarray, float]:
    """Return a picture without the lights that are seen themselves, and the seconds of CPU it took.

    Two pictures of equal samples see the same lights, bit for bit; one that stops there shows nothing else.
    """
    renderer = wrt.Renderer(scene, sampler="independent", threads=1, **options)
    renderer.compile()
    seconds = time.process_time()
    for _ in renderer.passes(spp=spp):
        pass
    seconds = time.process_time() - seconds
    seen = wrt.Renderer(scene, sampler="independent", max_depth=1, **options)
    for _ in seen.passes(spp=spp):
        pass
    return renderer.image().astype(np.float64) - seen.image(), seconds


def benchmark_lights(options: argparse.Namespace) -> dict[str, Any]:
    """Return the error of pictures of a city at night at equal time, by how lights are chosen."""
    rows = []
    print("| lights | samples/s, power | tree | RMSE, power | tree | ratio | relative error, power | tree | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for lights in options.lights:
        scene = night_city(lights)
        size = {"width": options.width, "height": options.width * 9 // 16}
        pixels = size["width"] * size["height"]
        reference, _ = lit_picture(scene, options.reference, light_choice="tree", seed=1, **size)
        mean = float(reference.mean())
        row: dict[str, Any] = {"lights": lights}
        for choice in ("power", "tree"):
            _, seconds = lit_picture(scene, 4, light_choice=choice, **size)
            spp = max(4, round(4.0 * options.seconds / seconds))
            picture, seconds = lit_picture(scene, spp, light_choice=choice, **size)
            # Brought to equal time. The reference's own error counts against the tree more than against power.
            squares = (picture - reference) ** 2 * seconds / options.seconds
            row[choice] = {
                "samples_per_second": spp * pixels / seconds,
                "rmse": float(np.sqrt(squares.mean())) / mean,
                "relative": float(np.sqrt(np.mean(squares / (reference**2 + (0.1 * mean) ** 2)))),
            }
        power, tree = row["power"], row["tree"]
        ratios = {key: power[key] / tree[key] for key in ("rmse", "relative")}
        print(
            f"| {lights:,} | {power['samples_per_second'] / 1e6:.2f} M | {tree['samples_per_second'] / 1e6:.2f} M "
            f"| {power['rmse']:.3f} | {tree['rmse']:.3f} | {ratios['rmse']:.1f} "
            f"| {power['relative']:.3f} | {tree['relative']:.3f} | {ratios['relative']:.1f} |",
            flush=True,
        )
        rows.append(row | {"ratios": ratios})
    return {"benchmark": "lights", "seconds": options.seconds, "rows": rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Tell what the command line takes."""
    parser.add_argument("--lights", type=int, nargs="+", default=[10, 1000, 10_000, 100_000])
    parser.add_argument("--seconds", type=float, default=20.0, help="of CPU for each picture (default %(default)s)")
    parser.add_argument("--width", type=int, default=64)
    parser.add_argument("--reference", type=int, default=16384, help="samples per pixel of what is compared with")
