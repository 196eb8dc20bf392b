"""Faults that `scripts/mutate.py` plants exist in the code, its verdicts are right, and docs/proofs.md is current."""

from __future__ import annotations

import importlib
import shlex
from types import ModuleType

import pytest
from conftest import ROOT


def script(name: str) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        return importlib.import_module(name)


def test_every_fault_can_be_planted() -> None:
    """A refactoring that moves a line must move its fault."""
    mutants = script("mutants").MUTANTS
    names = [mutant.name for mutant in mutants]
    assert len(set(names)) == len(names) >= 40
    for mutant in mutants:
        assert mutant.old in (ROOT / mutant.file).read_text(encoding="utf-8"), mutant.name
        assert mutant.old != mutant.new
        files = [word for word in shlex.split(mutant.tests) if word.startswith("tests/")]
        assert files
        assert all((ROOT / file).is_file() for file in files), mutant.name


def test_the_page_is_made_of_what_was_measured() -> None:
    proofs = script("proofs")
    assert (ROOT / "docs" / "proofs.md").read_text(encoding="utf-8") == proofs.page()
    assert {mutant.subject for mutant in proofs.MUTANTS} <= set(proofs.SUBJECTS)
    for names in proofs.SUBJECTS.values():
        assert all((ROOT / "tests" / f"test_{name}.py").is_file() for name in names)


@pytest.mark.parametrize(
    ("before", "after", "outcome"),
    [
        (0, 0, "survived"),
        (0, 1, "noticed"),
        (0, 2, "tests fail without it"),
        (1, 1, "tests fail without it"),
        (5, 1, "no such tests"),
        (0, None, "ran out of time"),
    ],
)
def test_a_fault_is_noticed_only_by_tests_that_pass_without_it(before: int, after: int | None, outcome: str) -> None:
    mutate = script("mutate")
    runner = mutate.Runner(1.0)
    runner._status = lambda mutant, tests, planted: after if planted else before
    assert runner.outcome(mutate.MUTANTS[0]) == outcome
