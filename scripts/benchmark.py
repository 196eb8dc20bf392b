"""Measure wrt: pictures beside other renderers, how it scales, rays beside Embree, compiling, lights, loading, changes.

    python scripts/benchmark.py render [--quick] [--scenes NAME ...] [--peers NAME ...] [--times S ...] [--docs]
    python scripts/benchmark.py scaling [--quick] [--only NAME ...] [--docs]
    python scripts/benchmark.py rays [--triangles N ...] [--threads N ...] [--repeats N]
    python scripts/benchmark.py compile [--kernels TEXT ...] [--docs]
    python scripts/benchmark.py lights [--lights N ...] [--seconds S]
    python scripts/benchmark.py checkouts FOLDER ... [--scenes NAME ...] [--rounds N]
    python scripts/benchmark.py loading [--cases NAME ...] [--repeats N] [--llvm FOLDER]

Each prints what it finds, and writes it as JSON with --json FILE. With --docs, results go to docs/measured and their
tables, plots and pictures into docs/performance.md. Everything is warmed up first; what competes is measured in turn,
A B A B, and reported as medians and as the ratio of medians. Machines are noisy: ratios are worth more than times.
docs/performance.md says what each figure means.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks import checkouts, compiling, lights, loading, rays, render, scaling
from benchmarks.measure import machine
from benchmarks.report import TEXTS, write_documents

MODULES = {
    "render": render,
    "scaling": scaling,
    "rays": rays,
    "compile": compiling,
    "lights": lights,
    "loading": loading,
    "checkouts": checkouts,
}


def command_line() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, module in MODULES.items():
        command = commands.add_parser(name)
        module.add_arguments(command)
        command.add_argument("--json", type=Path, metavar="FILE")
        if name in TEXTS:
            command.add_argument("--docs", action="store_true", help="write docs/measured and docs/performance.md")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, print, and save."""
    options = command_line().parse_args(arguments)
    benchmarks = {
        "render": render.benchmark_render,
        "scaling": scaling.benchmark_scaling,
        "rays": rays.benchmark_rays,
        "compile": compiling.benchmark_compile,
        "lights": lights.benchmark_lights,
        "loading": loading.benchmark_loading,
        "checkouts": checkouts.benchmark_checkouts,
    }
    result = benchmarks[options.command](options) | machine()
    pictures = result.pop("pictures", {})
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if getattr(options, "docs", False):
        write_documents(result, pictures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
