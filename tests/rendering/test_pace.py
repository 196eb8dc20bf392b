"""How many samples passes take: with and without a viewer, within a time, and at the end."""

import itertools
import math

import pytest

import wrt
from wrt.rendering.passes import LONGEST_PASS, SAMPLES_TOGETHER, SHARE, SHORT_PASS, samples_of_next_pass

# The emulator is too slow for claims about seconds.
pytestmark = pytest.mark.not_emulated


def passes(target, sample, *, limit=math.inf, **how):
    """Return the samples and the seconds of each pass, for samples that take `sample` seconds each."""
    counts, seconds, step = [], 0.0, 1
    while sum(counts) < target and seconds < limit:
        counts.append(step)
        seconds += step * sample
        step = samples_of_next_pass(sum(counts), target, seconds, limit - seconds, sample, **how)
    return counts, [count * sample for count in counts]


def before_and_of_each(seconds):
    return zip(itertools.accumulate(seconds[:-1]), seconds[1:], strict=True)


@pytest.mark.parametrize("sample", [1e-4, 3e-3, 0.9])
def test_whoever_watches_waits_for_no_pass_longer_than_a_quarter_of_what_was_rendered(sample):
    counts, seconds = passes(10**5, sample)
    for before, duration in before_and_of_each(seconds):
        assert duration <= max(SHORT_PASS, SHARE * before, sample) + 1e-9
        assert duration <= max(LONGEST_PASS, sample)
    assert sum(counts) == 10**5
    if sample == 1e-4:
        assert counts[:6] == [1, 1, 2, 4, 8, 16]  # at first as many as there are
    if sample == 3e-3:
        assert max(seconds) > LONGEST_PASS - SAMPLES_TOGETHER * sample  # they grow to the longest


def test_where_nobody_watches_passes_are_as_long_as_asked_for_and_on_a_gpu_short():
    # The second pass takes the remaining samples in groups of SAMPLES_TOGETHER, the third the remainder.
    assert passes(64, 0.05, pass_seconds=LONGEST_PASS)[0] == [1, 48, 15]
    assert max(passes(1000, 0.05, pass_seconds=2.0)[1]) <= 2.0
    assert LONGEST_PASS < max(passes(10**4, 0.05, pass_seconds=1e6, longest=25.0)[1]) <= 25.0
    for longest in (None, 5.0):
        assert max(passes(10**4, 0.01, pass_seconds=longest, short=True)[1]) <= SHORT_PASS + 1e-9
    # A thousand samples of a GPU that takes one in a millisecond: one, a short pass, doubled, then 0.4 s each.
    assert passes(1000, 1e-3, short=True)[0] == [1, 48, 48, 96, 192, 384, 224, 7]


@pytest.mark.parametrize("pass_seconds", [None, LONGEST_PASS])
@pytest.mark.parametrize("sample", [1e-4, 3e-3, 0.07])
def test_a_time_is_kept(pass_seconds, sample):
    _, seconds = passes(10**9, sample, limit=20.0, pass_seconds=pass_seconds)
    assert 20.0 <= sum(seconds) < 20.0 + sample + 1e-6
    for before, duration in before_and_of_each(seconds):
        assert duration <= max(SHORT_PASS, 0.5 * (20.0 - before), sample) + 1e-9


@pytest.mark.parametrize("pass_seconds", [None, 10.0])
def test_no_sample_is_too_many_or_too_few(pass_seconds):
    for target in range(1, 200):
        counts, _ = passes(target, 1e-3, pass_seconds=pass_seconds)
        assert sum(counts) == target
        assert min(counts) >= 1
        assert all(count % SAMPLES_TOGETHER == 0 for count in counts if count > SAMPLES_TOGETHER)


def test_a_renderer_asks_for_passes_as_long_as_it_is_told(device):
    renderer, unlimited = (wrt.Renderer(wrt.load("cornell-box"), width=24, height=16, device=device) for _ in range(2))
    renderer.compile()
    long = [progress.spp for progress in renderer.passes(spp=64, pass_seconds=5.0)]
    assert long[0] == 1
    assert len(long) <= (4 if renderer.device.is_cpu else 20)  # on CUDA they stay short
    list(unlimited.passes(spp=64))
    assert (renderer.image() == unlimited.image()).all()
    for seconds in (0.0, math.nan, "much"):
        with pytest.raises(wrt.InputError, match="pass_seconds"):
            renderer.passes(spp=2, pass_seconds=seconds)
