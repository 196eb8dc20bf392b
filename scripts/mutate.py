"""Plant faults in a copy of the tree, one by one, and report which of them the tests notice.

    python scripts/mutate.py [--only NAME ...] [--jobs N] [--timeout SECONDS] [--list]

The faults stand in `mutants/`. Each has a copy of the tree and a kernel cache of its own, since kernels of a fault
must not reach other runs. First the tests run without the fault, for a test that fails anyway notices nothing; what
passed before in this run is not repeated. Results go to docs/measured/proofs/mutants.json, from which `proofs.py` makes
docs/proofs.md. The status is 1 if a fault survives.
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
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutants import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "measured" / "proofs" / "mutants.json"

NOTICED, SURVIVED, NO_TESTS = "noticed", "survived", "no such tests"
BROKEN, TIMED_OUT = "tests fail without it", "ran out of time"


class Runner:
    """Runs mutants, several at a time.

    Attributes:
        timeout: seconds that the tests of one mutant may take.
    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self._before: dict[str, int | None] = {}
        self._locks: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()

    def outcome(self, mutant: Mutant) -> str:
        """Return NOTICED, SURVIVED, NO_TESTS, BROKEN or TIMED_OUT."""
        found = self._outcome(mutant, ())
        # Only what the quick tests did not notice is worth the time of all of them.
        return self._outcome(mutant, ("--all",)) if found in (SURVIVED, NO_TESTS) else found

    def _outcome(self, mutant: Mutant, marks: tuple[str, ...]) -> str:
        tests = shlex.join((*shlex.split(mutant.tests), *marks))
        with self._lock:
            lock = self._locks.setdefault(tests, threading.Lock())
        with lock:
            if tests not in self._before:
                self._before[tests] = self._status(mutant, tests, planted=False)
        if self._before[tests] != 0:
            return {None: TIMED_OUT, 5: NO_TESTS}.get(self._before[tests], BROKEN)
        status = self._status(mutant, tests, planted=True)
        # pytest ends with 1 if tests failed, with 2 if they cannot even be imported, and with 5 if there are none.
        return {None: TIMED_OUT, 0: SURVIVED, 1: NOTICED}.get(status, BROKEN)

    def _status(self, mutant: Mutant, tests: str, *, planted: bool) -> int | None:
        """Return pytest's status for the tests in a copy of the tree; None if they ran out of time."""
        with tempfile.TemporaryDirectory(prefix="wrt-mutant-") as folder:
            copy = Path(folder) / "tree"
            copy_tree(copy)
            if planted:
                plant(mutant, copy)
            environment = {**os.environ, "PYTHONPATH": str(copy), "XDG_CACHE_HOME": str(Path(folder) / "cache")}
            command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "--no-header", *shlex.split(tests)]
            try:
                done = subprocess.run(
                    command, cwd=copy, env=environment, capture_output=True, timeout=self.timeout, check=False
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
    runner, outcomes = Runner(options.timeout), []
    with ThreadPoolExecutor(options.jobs) as pool:
        for mutant, outcome in zip(chosen, pool.map(runner.outcome, chosen), strict=True):
            print(f"{mutant.name}: {outcome}", flush=True)
            outcomes.append(outcome)
            known = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
            known = {name: known[name] for name in names if name in known} | {mutant.name: outcome}
            RESULTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    print(f"{outcomes.count(NOTICED)} of {len(outcomes)} noticed")
    return 0 if outcomes.count(NOTICED) == len(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
