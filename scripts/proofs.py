"""Make docs/proofs.md from what tests measured and from which planted faults they noticed.

    python scripts/proofs.py                     writes docs/proofs.md from docs/measured/proofs
    python scripts/proofs.py --record [NAME ...] runs the tests of subjects first, by default of all, and keeps the rows

A subject is a row of the table, with the files of tests that prove it. `--record` takes as long as these tests; what
other subjects measured before stays. Faults are planted by `mutate.py`.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mutants import MUTANTS

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "proofs.md"
ROWS = ROOT / "docs" / "measured" / "proofs" / "tests.json"
FAULTS = ROOT / "docs" / "measured" / "proofs" / "mutants.json"

SUBJECTS: dict[str, tuple[str, ...]] = {
    "fresnel": ("fresnel",),
    "dielectric": ("fresnel", "dielectric_agreement", "rough_dielectric"),
    "glossy": ("glossy",),
    "microfacets": ("microfacet", "masking", "rough_conductor", "multiple_bounces"),
    "normal-maps": ("normal_maps", "normal_filtering", "bumpy_ggx"),
    "oren-nayar": ("oren_nayar",),
    "plastic": ("plastic",),
    "principled": ("principled", "principled_agreement"),
    "burley": ("burley",),
    "dispersion": ("dispersion",),
    "thin-films": ("thin_film",),
    "measured": ("measured",),
    "constants": ("presets",),
    "media": ("phase", "absorption", "scattering", "grid_media"),
    "lights": ("irradiance", "light_tree", "environment_sampling", "multiple_importance", "alias"),
    "spheres": ("spheres", "sphere_pictures", "spheres_of_mitsuba"),
    "quadrics": ("quadrics", "quadric_pictures", "cylinder_lights", "skin"),
    "cameras": ("cameras", "lenses", "shutter"),
    "path": ("furnace", "estimators", "against_mitsuba"),
    "whitted": ("whitted",),
    "samples": ("warps", "sampler", "samplers", "low_discrepancy", "solid_angle"),
    "film": ("film", "film_statistics", "filters"),
    "checkpoints": ("checkpoint", "fingerprint"),
    "colours": ("image_files", "tone_curves"),
    "cuda": ("emulated_instructions", "emulated_memory", "emulated_cuda"),
}
"""By subject, the names of files tests/test_NAME.py."""

COLUMNS = {
    "energy and furnace": r"energy|furnace|white|albedo",
    "reciprocity": r"recipro|symmetr",
    "agreement": r"mitsuba|agree|against|estimators|light_of_paths",
    "convergence": r"falls_as_fast|converge|variance",
}
"""By column, what the names of its tests contain."""

OF_FAULTS = r"would_be_seen|is_found|notice|mistake|fault|without_it|wrong"
"""What the names of tests contain that show that a fault is seen: their p-values are small."""

HEAD = """# Proofs

What the tests of each system measured, and which planted faults they noticed. `scripts/proofs.py` makes this page,
`scripts/proofs.py --record` runs tests and keeps what they say, and `scripts/mutate.py` plants the faults. Columns
count tests that passed, of those that were run: all of them; those by chi-square and other tests with a p-value, with
the least p, which may itself be the least of hundreds of pixels or pairs; and those whose names say that they are about
energy, reciprocity, agreement with another renderer or estimator, and convergence. A dash stands for none.

"""


def record(subjects: Sequence[str]) -> None:
    """Run the tests of subjects, and keep their outcomes and rows."""
    known: dict[str, Any] = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.is_file() else {}
    for subject in subjects:
        files = [f"tests/test_{name}.py" for name in SUBJECTS[subject]]
        with tempfile.TemporaryDirectory() as folder:
            found = Path(folder) / "rows.json"
            command = [sys.executable, "-m", "pytest", "-q", "-n", "0", f"--record={found}", *files]
            subprocess.run(command, cwd=ROOT, check=False)
            known[subject] = json.loads(found.read_text(encoding="utf-8"))
        ROWS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def page() -> str:
    """Return the text of docs/proofs.md."""
    rows: dict[str, dict[str, Any]] = json.loads(ROWS.read_text(encoding="utf-8"))
    faults: dict[str, str] = json.loads(FAULTS.read_text(encoding="utf-8"))
    lines = [
        "| system | tests | chi-square and others | " + " | ".join(COLUMNS) + " | faults noticed |",
        "| --- " * 8 + "|",
    ]
    for subject in SUBJECTS:
        tests: dict[str, Any] = rows.get(subject, {})
        sound = [test for name, test in tests.items() if not re.search(OF_FAULTS, name)]
        least = [(float(row[3]), test["passed"]) for test in sound for row in test["rows"] if row[3]]
        by_p = f"{_share([passed for _, passed in least])}, p ≥ {min(least)[0]:.2g}" if least else "–"
        cells = [_share([test["passed"] for test in tests.values()]) if tests else "not recorded yet", by_p]
        for pattern in COLUMNS.values():
            cells.append(_share([test["passed"] for name, test in tests.items() if re.search(pattern, name)]))
        cells.append(
            _share([faults[m.name] == "noticed" for m in MUTANTS if m.subject == subject and m.name in faults])
        )
        lines.append(f"| {subject} | " + " | ".join(cells) + " |")
    lines += ["", "## Planted faults", "", "| fault | system | file | outcome |", "| --- | --- | --- | --- |"]
    for mutant in MUTANTS:
        outcome = faults.get(mutant.name, "not tried yet")
        lines.append(f"| {mutant.name} | {mutant.subject} | `{mutant.file}` | {outcome} |")
    return HEAD + "\n".join(lines) + "\n"


def _share(passed: Sequence[bool]) -> str:
    return f"{sum(passed)} of {len(passed)}" if passed else "–"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Make docs/proofs.md from what tests measured.")
    parser.add_argument("--record", nargs="*", choices=list(SUBJECTS), metavar="NAME", help="run these tests first")
    options = parser.parse_args(arguments)
    if options.record is not None:
        record(options.record or list(SUBJECTS))
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
