"""Damaged files never kill it: they are read, or refused in one line; and the fuzzer would notice if they did."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random
from types import ModuleType

import pytest
from conftest import ROOT
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

CORPUS = ROOT / "tests" / "corpus"
FAULTS = {
    "raise": "KeyError at planted_readers.py",
    "recurse": "RecursionError",
    "spin": "hang",
    "sleep": "hang",
    "warn": "RuntimeWarning at planted_readers.py",
    "allocate": "MemoryError",
    "fill": "MemoryError",
    "refuse for memory": "memory is allocated",
    "print": "output from below: libfault: something is odd",
    "crash": "crash: SIGSEGV",
    "exit": "exit status 3",
    "refuse without a name": "does not name the file",
    "refuse in two lines": "not one short line",
}


@pytest.fixture(scope="module")
def fuzz() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("fuzz")
        for name in ("fuzz", "fuzz_mutations"):
            sys.modules.pop(name, None)


@pytest.mark.slow
def test_planted_faults_are_noticed(fuzz):
    faults = [*FAULTS, "refuse", "tell", "nothing"]
    inputs = iter([(number, "png", fault.encode()) for number, fault in enumerate(faults)])
    planted = "support.planted_readers:readers"
    outcomes = {
        data.decode(): outcome
        for _, _, data, outcome in fuzz.run(inputs, make_readers=planted, seconds=1.0, megabytes=128, wall_factor=4)
    }
    for fault, reason in FAULTS.items():
        assert outcomes[fault].verdict == "failed", fault
        assert reason in outcomes[fault].reason
    assert outcomes["refuse"].verdict == "refused"
    assert outcomes["tell"].verdict == outcomes["nothing"].verdict == "fine"


def test_what_once_failed_does_not_any_more(fuzz):
    files = sorted((CORPUS / "failures").iterdir())
    inputs = ((number, file.suffix[1:], file.read_bytes()) for number, file in enumerate(files))
    failed = {files[number].name: out.reason for number, _, _, out in fuzz.run(inputs) if out.verdict == "failed"}
    assert not failed


def test_every_seed_is_read_without_a_warning(fuzz):
    files = sorted((CORPUS / "seeds").iterdir())
    inputs = ((number, file.suffix[1:], file.read_bytes()) for number, file in enumerate(files))
    for number, kind, _, outcome in fuzz.run(inputs):
        # As textures of a mesh NumPy files are left out with a warning.
        others = {"npy": "not an image of a known format", "stl": "the STL file has no normals", "dae": "bind pose"}
        expected = others.get(kind, "")
        assert outcome.verdict == "fine"
        assert (expected in outcome.reason) if expected else not outcome.reason, (
            f"{files[number].name}: {outcome.reason}"
        )


def test_damaged_files_are_read_or_refused(fuzz, report):
    """Hypothesis makes the same inputs every time, and of one that fails the least damage that does it."""
    corpus = fuzz.Corpus()
    kinds = sorted(corpus.files)
    worker = fuzz.Worker("fuzz:readers", corpus.seeds, fuzz.SECONDS, fuzz.MEGABYTES)
    count = {"fine": 0, "refused": 0}

    @settings(
        max_examples=300,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.sampled_from(kinds), st.randoms(use_true_random=False))
    def read(kind: str, rng: Random) -> None:
        seeds = corpus.files[kind]
        worker.give(0, kind, fuzz.mutate(rng, kind, rng.choice(seeds), seeds))
        outcome = worker.wait()
        assert outcome.verdict in count, f"{kind}: {outcome.reason}"
        count[outcome.verdict] += 1

    try:
        read()
    finally:
        worker.close()
    report("damaged files", f"{count['fine']} read, {count['refused']} refused")
    assert min(count.values()) > 20


@pytest.mark.slow
def test_the_inputs_of_the_command_are_read_or_refused(fuzz, report):
    corpus = fuzz.Corpus()
    kinds = sorted(corpus.files)
    inputs = ((number, *corpus.input(0, number, kinds)) for number in range(300))
    outcomes = [outcome for _, _, _, outcome in fuzz.run(inputs)]
    assert not [outcome.reason for outcome in outcomes if outcome.verdict == "failed"]
    fine = sum(outcome.verdict == "fine" for outcome in outcomes)
    report("damaged files", f"{fine} read, {len(outcomes) - fine} refused")
    assert 40 < fine < 260


def test_the_same_seed_makes_the_same_inputs(fuzz):
    corpus = fuzz.Corpus()
    kinds = sorted(corpus.files)
    once, again = ([corpus.input(5, number, kinds) for number in range(60)] for _ in range(2))
    assert once == again
    assert len({data for _, data in once}) > 50
    assert {kind for kind, _ in once} == set(kinds)


def test_the_command_says_what_failed(fuzz, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert fuzz.main(["--inputs", "6", "--kinds", "off,stl"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split()[:2] == ["all", "6"]
    monkeypatch.setattr(fuzz, "READERS", "support.planted_readers:readers")
    (tmp_path / "bad.off").write_text("raise")
    assert fuzz.main(["--replay", "bad.off"]) == 1
    assert "bad.off: failed: KeyError" in capsys.readouterr().out
