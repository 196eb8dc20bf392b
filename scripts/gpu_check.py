"""Check wrt on an NVIDIA GPU, then measure it there.

    python scripts/gpu_check.py [--device cuda:0] [--output FOLDER] [--quick]

First films of many small scenes are compared with those of the CPU, then the kernel tests run on the GPU, then a few
scenes are timed. FOLDER (default: gpu-check) gets `gpu-check.json` and `gpu-check.md`. Ends with status 1 if there is
no GPU, or if something does not agree. Most of the time goes to compiling kernels; --quick skips slow tests and
films. Nothing else should run on the machine.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "scripts")]

SCENES = ("cornell-box", "still-life", "teapot", "many-triangles")
"""Built-in scenes that are timed, at SIZE."""

SIZE = {"width": 1280, "height": 720}

Results = dict[str, Any]


def compare_films(device: str, quick: bool) -> list[Results]:
    """Compare films with those of the CPU."""
    from support.films_of_devices import FILMS, film_cases, films_of

    cases, results = film_cases(), []
    for name in FILMS[:4] if quick else FILMS:
        films = films_of(name, cases[name], device)
        results.append({"name": name, "rays": films.rays, "agreeing": films.agreeing, "problems": films.problems})
        print(f"{name}: {'; '.join(films.problems) or 'agrees'}", flush=True)
    return results


def run_tests(quick: bool) -> Results:
    """Run the kernel tests on the GPU, whose name for them is cuda:0; return how many passed and which failed."""
    from wrt.slices import available_threads

    command = f"-m pytest -q -n {min(available_threads(), 16)} --dist loadfile --device cuda -k cuda:0"
    command += "" if quick else " --all"
    print("tests: this takes a while", flush=True)
    done = subprocess.run([sys.executable, *command.split()], cwd=ROOT, capture_output=True, text=True, check=False)
    passed = re.findall(r"(\d+) passed", done.stdout)
    failed = re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return {"status": done.returncode, "passed": int(passed[-1]) if passed else 0, "failed": failed}


def time_scene(name: str, device: str, seconds: float) -> Results:
    """Return paths and rays a second of a scene, after a first pass that is not counted."""
    import wrt

    renderer = wrt.Renderer(wrt.load(name), **SIZE, device=device)
    renderer.compile()  # the wide kernel of the CPU
    for _ in renderer.passes(spp=1):
        pass
    paths, rays, began = renderer.paths, renderer.rays, renderer.seconds_render
    for _ in renderer.passes(time=seconds):
        pass
    spent = renderer.seconds_render - began
    result = {"scene": name, "device": device, "samples": int(renderer.film.counts.min())}
    result |= {"paths_per_second": (renderer.paths - paths) / spent, "rays_per_second": (renderer.rays - rays) / spent}
    print(f"{name} on {device}: {result['paths_per_second']:.3g} paths/s", flush=True)
    return result


def describe_machine() -> Results:
    """Return what the figures depend on."""
    from wrt._version import __version__
    from wrt.backend import current_backend

    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total,power.limit", "--format=csv,noheader"]
    has_tool = shutil.which(query[0]) is not None
    gpus = subprocess.run(query, capture_output=True, text=True, check=False).stdout if has_tool else ""
    return {
        "wrt": __version__,
        "warp": current_backend().version,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "gpus": gpus.strip().splitlines(),
    }


def page(results: Results) -> str:
    """Return the results as a page of Markdown."""
    from benchmarks.measure import table

    films, tests, speed = results["films"], results["tests"], results["speed"]
    films_table = table(
        ["film", "rays, CPU", "rays, GPU", "pixels that agree", "problems"],
        [
            [film["name"], *map(str, film["rays"])]
            + [", ".join(f"{layer} {share:.2%}" for layer, share in film["agreeing"].items())]
            + ["; ".join(film["problems"]) or "none"]
            for film in films
        ],
    )
    speed_table = table(
        ["scene", "device", "samples a pixel", "paths/s", "rays/s"],
        [
            [row["scene"], row["device"], str(row["samples"])]
            + [f"{row['paths_per_second']:.3g}", f"{row['rays_per_second']:.3g}"]
            for row in speed
        ],
    )
    tests_text = "They were not run.\n"
    if tests is not None:
        tests_text = f"{tests['passed']} passed, {len(tests['failed'])} failed (status {tests['status']}).\n"
        tests_text += "".join(f"\n- `{name}`" for name in tests["failed"])
    parts = [
        "# wrt on a GPU\n",
        *(f"- {key}: {value}" for key, value in results["machine"].items()),
        f"- device: {results['device']}, sm_{results['architecture']}\n",
        f"## Films against the CPU\n\n{films_table}",
        f"## Tests\n\n{tests_text}",
        f"## Speed, {SIZE['width']}x{SIZE['height']} pixels\n\n{speed_table}",
        "Everything agrees." if results["agrees"] else "Something does not agree, see above.",
    ]
    return "\n".join(parts) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Check wrt on an NVIDIA GPU, then measure it there.")
    parser.add_argument("--device", default="cuda:0", help="the GPU (default: cuda:0)")
    parser.add_argument("--output", type=Path, default=Path("gpu-check"), help="folder of the results")
    parser.add_argument("--quick", action="store_true", help="skip slow tests and films")
    parser.add_argument("--no-tests", action="store_true", help="skip the tests")
    parser.add_argument("--scenes", nargs="*", default=SCENES, metavar="SCENE", help="scenes to time")
    parser.add_argument("--seconds", type=float, default=10.0, help="seconds of a timed render (default: 10)")
    options = parser.parse_args(arguments)

    import wrt
    from wrt.backend.device import Device

    try:
        device = Device(options.device)
        if device.is_cpu:
            raise wrt.InputError("--device must be a GPU, such as cuda:0")
        options.output.mkdir(parents=True, exist_ok=True)
    except (wrt.InputError, OSError) as error:
        print(f"gpu_check: {error}", file=sys.stderr)
        return 1
    results: Results = {"machine": describe_machine(), "device": device.name}
    results["architecture"] = device.backend.architecture_of(device.name)
    results["films"] = compare_films(device.name, options.quick)
    results["tests"] = None if options.no_tests else run_tests(options.quick)
    results["speed"] = [time_scene(name, d, options.seconds) for name in options.scenes for d in (device.name, "cpu")]
    tests_pass = results["tests"] is None or results["tests"]["status"] == 0
    results["agrees"] = tests_pass and not any(film["problems"] for film in results["films"])
    (options.output / "gpu-check.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (options.output / "gpu-check.md").write_text(page(results), encoding="utf-8")
    print(f"{page(results)}\nThe results are in {options.output}: gpu-check.md is the page to send.")
    return 0 if results["agrees"] else 1


if __name__ == "__main__":
    sys.exit(main())
