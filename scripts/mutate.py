"""Plant faults in a copy of the tree, one by one, and report which of them the tests notice.

    python scripts/mutate.py [--only NAME ...] [--jobs N] [--timeout SECONDS] [--list]

The faults are in mutants.toml. First their tests run without them, since a test that fails anyway notices nothing. Then
each fault is planted in a copy of the tree, with a copy of the kernel cache, so that its kernels reach no other run.
Faults that the quick tests miss are tried again with the slow ones. Outcomes go to docs/measured/mutants.json and into
the list of docs/proofs.md. The status is 1 if a fault survives.
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
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
OUTCOMES = ROOT / "docs" / "measured" / "mutants.json"
PAGE = ROOT / "docs" / "proofs.md"
HEAD = "Their numbers by system: "
"""The text of the page before the numbers."""

NOTICED, SURVIVED, NO_TESTS = "noticed", "survived", "no such tests"
BROKEN, TIMED_OUT = "tests fail without it", "ran out of time"


class Mutant(NamedTuple):
    """A fault of mutants.toml, which describes its fields."""

    name: str
    subject: str
    file: str
    old: str
    new: str
    tests: str


FAULTS = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))
MUTANTS = tuple(Mutant(name, **fields) for name, fields in FAULTS.items())


def outcomes(
    mutants: Sequence[Mutant], folder: Path, jobs: int, timeout: float, options: str = ""
) -> Iterator[tuple[Mutant, str]]:
    """Yield each fault with its outcome, several at a time.

    Args:
        mutants: the faults.
        folder: where copies of the tree and of the kernel cache are kept.
        jobs: faults to try at a time.
        timeout: seconds that the tests of one fault may take.
        options: further options of pytest.
    """

    def status(tests: str, mutant: Mutant | None = None) -> int | None:
        return pytest_status(f"{tests} {options}", mutant, folder, timeout)

    with ThreadPoolExecutor(jobs) as pool:
        tests = list(dict.fromkeys(mutant.tests for mutant in mutants))
        without = dict(zip(tests, pool.map(status, tests), strict=True))
        tried = [mutant for mutant in mutants if without[mutant.tests] == 0]
        planted = dict(zip(tried, pool.map(lambda mutant: status(mutant.tests, mutant), tried), strict=True))
        for mutant in mutants:
            yield mutant, outcome(without[mutant.tests], planted.get(mutant))


def outcome(without: int | None, planted: int | None) -> str:
    """Return the outcome of a fault for the status of pytest without it and with it; None stands for a timeout."""
    if without != 0:
        return {None: TIMED_OUT, 5: NO_TESTS}.get(without, BROKEN)
    # pytest ends with 1 if tests failed, with 2 if they cannot even be imported, and with 5 if there are none.
    return {None: TIMED_OUT, 0: SURVIVED, 1: NOTICED}.get(planted, BROKEN)


def pytest_status(tests: str, mutant: Mutant | None, folder: Path, timeout: float) -> int | None:
    """Return pytest's status for tests in a copy of the tree; None if they ran out of time."""
    cache = folder / "cache"
    cache.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        tree = Path(temporary) / "tree"
        copy_tree(tree)
        if mutant is not None:
            plant(mutant, tree)
            cache = Path(shutil.copytree(cache, Path(temporary) / "cache"))
        environment = {**os.environ, "PYTHONPATH": str(tree), "XDG_CACHE_HOME": str(cache)}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "--no-header", *shlex.split(tests)]
        try:
            return subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            return None


def copy_tree(target: Path) -> None:
    """Copy the files that git knows, as they are in the working tree, with their links."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    for name in filter(None, listed.decode().split("\0")):
        source, copy = ROOT / name, target / name
        if source.is_symlink() or source.is_file():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy, follow_symlinks=False)


def plant(mutant: Mutant, tree: Path) -> None:
    """Replace the first occurrence of the mutant's text in a tree.

    Raises:
        ValueError: if the file does not have the text.
    """
    file = tree / mutant.file
    text = file.read_text(encoding="utf-8")
    if mutant.old not in text:
        raise ValueError(f"{mutant.name}: {mutant.file} has no {mutant.old!r}")
    file.write_text(text.replace(mutant.old, mutant.new, 1), encoding="utf-8")


def page(text: str, results: dict[str, str]) -> str:
    """Return the text of docs/proofs.md with the number of faults of each system, and other outcomes, at its end."""
    subjects = Counter(mutant.subject for mutant in MUTANTS)
    counts = ", ".join(f"{subject} {count}" for subject, count in subjects.items())
    outcomes = {mutant.name: results.get(mutant.name, "not tried yet") for mutant in MUTANTS}
    others = ", ".join(f"{name} ({outcome})" for name, outcome in outcomes.items() if outcome != NOTICED)
    except_for = f", except: {others}" if others else ""
    return f"{text.partition(HEAD)[0]}{HEAD}{counts}.\n\nAll are noticed{except_for}.\n"


def record(mutant: Mutant, result: str) -> None:
    """Print an outcome and write it to OUTCOMES and PAGE."""
    print(f"{mutant.name}: {result}", flush=True)
    results = json.loads(OUTCOMES.read_text(encoding="utf-8")) | {mutant.name: result}
    results = {each.name: results[each.name] for each in MUTANTS if each.name in results}
    OUTCOMES.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8"), results), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    names = [mutant.name for mutant in MUTANTS]
    parser = argparse.ArgumentParser(description="Plant faults and report which of them the tests notice.")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=names, help="plant these faults alone")
    parser.add_argument("--jobs", type=int, default=1, help="faults to try at a time (default: 1)")
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for the tests of a fault")
    parser.add_argument("--list", action="store_true", help="list the faults and their tests")
    options = parser.parse_args(arguments)
    chosen = [mutant for mutant in MUTANTS if not options.only or mutant.name in options.only]
    if options.list:
        for mutant in chosen:
            print(f"{mutant.name}: {mutant.file}; {mutant.tests}")
        return 0
    missed = []
    noticed = 0
    with tempfile.TemporaryDirectory(prefix="wrt-mutants-") as folder:
        settings = (Path(folder), options.jobs, options.timeout)
        for mutant, result in outcomes(chosen, *settings):
            if result in (SURVIVED, NO_TESTS):
                missed.append(mutant)
            else:
                record(mutant, result)
                noticed += result == NOTICED
        for mutant, result in outcomes(missed, *settings, "--all"):
            record(mutant, result)
            noticed += result == NOTICED
    print(f"{noticed} of {len(chosen)} noticed")
    return 0 if noticed == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
