"""Plant faults in a copy of the tree, one by one, and report which of them the tests notice.

    python scripts/mutate.py [--only NAME ...] [--jobs N] [--timeout SECONDS] [--list]

The faults stand in `mutants/`. First their tests run without them, since a test that fails anyway notices nothing. Then
each fault is planted in a copy of the tree, with a copy of the kernel cache, so that its kernels reach no other run.
What the quick tests do not notice is tried again with the slow ones. Outcomes go to docs/measured/mutants.json and into
the table of docs/proofs.md. The status is 1 if a fault survives.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutants import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parent.parent
OUTCOMES = ROOT / "docs" / "measured" / "mutants.json"
PAGE = ROOT / "docs" / "proofs.md"
TABLE = "| fault | system | file | outcome |\n| --- | --- | --- | --- |\n"
"""The head of the page's last table."""

NOTICED, SURVIVED, NO_TESTS = "noticed", "survived", "no such tests"
BROKEN, TIMED_OUT = "tests fail without it", "ran out of time"


class Runner:
    """Runs the tests of faults, several at a time.

    Attributes:
        jobs: faults to try at a time.
        timeout: seconds that the tests of one fault may take.
    """

    def __init__(self, folder: Path, jobs: int, timeout: float) -> None:
        """Create a runner that keeps its copies of the tree in a folder."""
        self.jobs, self.timeout = jobs, timeout
        self._folder = folder
        self._cache = folder / "cache"
        self._cache.mkdir()

    def outcomes(self, mutants: Sequence[Mutant], options: str = "") -> Iterator[tuple[Mutant, str]]:
        """Yield NOTICED, SURVIVED, NO_TESTS, BROKEN or TIMED_OUT for each fault, by its tests with pytest's options."""
        with ThreadPoolExecutor(self.jobs) as pool:
            tests = list(dict.fromkeys(f"{mutant.tests} {options}" for mutant in mutants))
            before = dict(zip(tests, pool.map(self._status, tests), strict=True))
            planted = pool.map(lambda mutant: self._outcome(mutant, options, before), mutants)
            yield from zip(mutants, planted, strict=True)

    def _outcome(self, mutant: Mutant, options: str, before: dict[str, int | None]) -> str:
        tests = f"{mutant.tests} {options}"
        if before[tests] != 0:
            return {None: TIMED_OUT, 5: NO_TESTS}.get(before[tests], BROKEN)
        # pytest ends with 1 if tests failed, with 2 if they cannot even be imported, and with 5 if there are none.
        return {None: TIMED_OUT, 0: SURVIVED, 1: NOTICED}.get(self._status(tests, mutant), BROKEN)

    def _status(self, tests: str, mutant: Mutant | None = None) -> int | None:
        """Return pytest's status for tests in a copy of the tree; None if they ran out of time."""
        with tempfile.TemporaryDirectory(dir=self._folder) as folder:
            tree, cache = Path(folder) / "tree", self._cache
            copy_tree(tree)
            if mutant is not None:
                plant(mutant, tree)
                cache = Path(folder) / "cache"
                shutil.copytree(self._cache, cache)
            environment = {**os.environ, "PYTHONPATH": str(tree), "XDG_CACHE_HOME": str(cache)}
            command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "--no-header", *shlex.split(tests)]
            try:
                done = subprocess.run(
                    command, cwd=tree, env=environment, capture_output=True, timeout=self.timeout, check=False
                )
            except subprocess.TimeoutExpired:
                return None
        return done.returncode


def copy_tree(target: Path) -> None:
    """Copy the files that git knows, as they are in the working tree, with their links."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    for name in filter(None, listed.decode().split("\0")):
        source, place = ROOT / name, target / name
        if source.is_symlink() or source.is_file():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, place, follow_symlinks=False)


def plant(mutant: Mutant, tree: Path) -> None:
    """Replace the first occurrence of the mutant's text in a tree.

    Raises:
        ValueError: if the text is not there.
    """
    file = tree / mutant.file
    text = file.read_text(encoding="utf-8")
    if mutant.old not in text:
        raise ValueError(f"{mutant.name}: {mutant.file} has no {mutant.old!r}")
    file.write_text(text.replace(mutant.old, mutant.new, 1), encoding="utf-8")


def page(text: str, outcomes: dict[str, str]) -> str:
    """Return the text of docs/proofs.md with a table of these outcomes at its end."""
    rows = [
        f"| {mutant.name} | {mutant.subject} | `{mutant.file}` | {outcomes.get(mutant.name, 'not tried yet')} |\n"
        for mutant in MUTANTS
    ]
    return text.partition(TABLE)[0] + TABLE + "".join(rows)


def keep(mutant: Mutant, outcome: str) -> None:
    """Print an outcome and write it to OUTCOMES and PAGE."""
    print(f"{mutant.name}: {outcome}", flush=True)
    known = json.loads(OUTCOMES.read_text(encoding="utf-8")) if OUTCOMES.is_file() else {}
    known = {each.name: known[each.name] for each in MUTANTS if each.name in known} | {mutant.name: outcome}
    OUTCOMES.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8"), known), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    names = [mutant.name for mutant in MUTANTS]
    parser = argparse.ArgumentParser(description="Plant faults and report which of them the tests notice.")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=names, help="plant these faults alone")
    parser.add_argument("--jobs", type=int, default=1, help="faults to try at a time (default: 1)")
    parser.add_argument(
        "--timeout", type=float, default=1800.0, help="seconds for the tests of a fault (default: 1800)"
    )
    parser.add_argument("--list", action="store_true", help="list the faults and their tests")
    options = parser.parse_args(arguments)
    chosen = [mutant for mutant in MUTANTS if not options.only or mutant.name in options.only]
    if options.list:
        for mutant in chosen:
            print(f"{mutant.name}: {mutant.file}; {mutant.tests}")
        return 0
    remaining = []
    noticed = 0
    with tempfile.TemporaryDirectory(prefix="wrt-mutants-") as folder:
        runner = Runner(Path(folder), options.jobs, options.timeout)
        for mutant, outcome in runner.outcomes(chosen):
            if outcome in (SURVIVED, NO_TESTS):
                remaining.append(mutant)
            else:
                keep(mutant, outcome)
                noticed += outcome == NOTICED
        for mutant, outcome in runner.outcomes(remaining, "--all"):
            keep(mutant, outcome)
            noticed += outcome == NOTICED
    print(f"{noticed} of {len(chosen)} noticed")
    return 0 if noticed == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
