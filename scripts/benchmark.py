"""Benchmark wrt: rendering and rays beside other programs, and beside other checkouts of wrt.

    python scripts/benchmark.py render [--quick] [--scenes NAME ...] [--peers NAME ...] [--times S ...] [--docs]
    python scripts/benchmark.py rays [--triangles N ...] [--threads N ...] [--repeats N]
    python scripts/benchmark.py checkouts FOLDER ... [--scenes NAME ...] [--rounds N]
    python scripts/benchmark.py gradients [--scenes NAME ...] [--spp N] [--seeds N] [--llvm FOLDER]
    python scripts/benchmark.py caustics [--scenes NAME ...] [--seconds S ...] [--folder FOLDER] [--llvm FOLDER]
    python scripts/benchmark.py found [--scenes NAME ...] [--spp N ...] [--folder FOLDER] [--llvm FOLDER]
    python scripts/benchmark.py own [--spp N] [--repeats N]

Each command prints its results, and writes them as JSON with --json FILE. With --docs, results go to docs/measured, and
tables and pictures to docs/performance.md and docs/notes. Everything is warmed up first. Competitors are
measured alternately, A B A B, and reported as medians and their ratio; on noisy machines, ratios are more reliable than
times. docs/performance.md explains the figures.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks import caustics, checkouts, found, gradients, own, rays, render, report
from benchmarks.measure import machine

MODULES = {
    "render": render,
    "rays": rays,
    "found": found,
    "checkouts": checkouts,
    "gradients": gradients,
    "caustics": caustics,
    "own": own,
}


def command_line() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, module in MODULES.items():
        command = commands.add_parser(name)
        module.add_arguments(command)
        command.add_argument("--json", type=Path, metavar="FILE")
        if all(section.page for section in report.SECTIONS[name]):
            command.add_argument("--docs", action="store_true", help="write docs/measured and the tables of docs/")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line: measure, print and save."""
    options = command_line().parse_args(arguments)
    result = MODULES[options.command].benchmark(options) | machine()
    pictures = result.pop("pictures", {})
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print("", *report.texts(result), sep="\n")
    if getattr(options, "docs", False):
        report.write_documents(result, pictures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
