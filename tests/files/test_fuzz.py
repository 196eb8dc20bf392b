"""Damaged files never kill it: they are read, or refused in one line; and the fuzzer would notice if they did."""

import collections

import fuzz
import pytest
from conftest import ROOT

CORPUS = ROOT / "tests" / "corpus"
PLANTED = "support.planted_readers:readers"
FAULTS = {
    "raise": "KeyError at planted_readers.py",
    "sleep": "hang",
    "spin": "hang",
    "warn": "RuntimeWarning at planted_readers.py",
    "fill": "MemoryError",
    "print": "output from below: libfault: something is odd",
    "crash": "crash: SIGSEGV",
    "exit": "exit status 3",
    "refuse without a name": "does not name the file",
    "refuse in two lines": "not one short line",
}


@pytest.mark.slow
def test_planted_faults_are_noticed():
    faults = [*FAULTS, "refuse", "tell", "nothing"]
    inputs = iter([(number, "png", fault.encode()) for number, fault in enumerate(faults)])
    found = fuzz.run(inputs, make_readers=PLANTED, seconds=1.0, megabytes=128, wall_factor=4)
    outcomes = {data.decode(): outcome for _, _, data, outcome in found}
    for fault, reason in FAULTS.items():
        assert outcomes[fault].verdict == "failed", fault
        assert reason in outcomes[fault].reason
    assert outcomes["refuse"].verdict == "refused"
    assert outcomes["tell"].verdict == outcomes["nothing"].verdict == "fine"


@pytest.mark.slow
def test_earlier_failures_and_seeds_are_read():
    files = [file for folder in ("failures", "seeds") for file in sorted((CORPUS / folder).iterdir())]
    inputs = ((number, file.suffix[1:], file.read_bytes()) for number, file in enumerate(files))
    # As textures of a mesh NumPy files are left out with a warning.
    warned = {"npy": "not an image of a known format", "stl": "the STL file has no normals", "dae": "bind pose"}
    warned |= dict.fromkeys(("polygons.obj", "plugins.xml"), "is unknown to wrt and left out")  # a line and a point
    for number, kind, _, outcome in fuzz.run(inputs):
        message = f"{files[number].name}: {outcome.reason}"
        if files[number].parent.name == "failures":
            assert outcome.verdict != "failed", message
        else:
            assert outcome.verdict == "fine", message
            expected = warned.get(files[number].name, warned.get(kind))
            assert (expected in message) if expected else not outcome.reason, message


@pytest.mark.slow
def test_damaged_files_are_read_or_refused(report):
    """The fuzzer's first inputs, of every kind in turn."""
    corpus = fuzz.Corpus()
    inputs = ((number, *corpus.input(0, number, sorted(corpus.files))) for number in range(300))
    count = collections.Counter()
    for number, kind, _, outcome in fuzz.run(inputs):
        assert outcome.verdict in ("fine", "refused"), f"{number}, {kind}: {outcome.reason}"
        count[outcome.verdict] += 1
    report("damaged files", f"{count['fine']} read, {count['refused']} refused")
    assert min(count.values()) > 20
