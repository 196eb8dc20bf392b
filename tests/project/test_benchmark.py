"""What would make a published figure wrong: verdicts, errors, tables; and planted faults."""

import json
import re
import shlex

import benchmark
import mutate
import numpy as np
import pytest
from benchmarks import agreement, gradient_scenes, measure, render, report
from conftest import ROOT
from peers.mitsuba_scene import to_mitsuba
from peers.picture_tests import image_z_test
from support import statistics

import wrt


def stack(factor: float, seed: int, count: int = 6, noise: float = 0.3) -> np.ndarray:
    truth = 1.0 + np.sin(np.arange(64.0))[:, None, None] * np.cos(np.arange(64.0))[None, :, None] * np.ones(3)
    return factor * truth * (1.0 + noise * np.random.default_rng(seed).normal(size=(count, 64, 64, 3)))


@pytest.mark.parametrize(("exact", "factor"), [(True, 1.02), (False, 1.08)])
def test_same_pictures_agree_and_others_do_not(exact, factor):
    assert statistics.image_z_test is image_z_test
    assert agreement.agreement(stack(1.0, 1), stack(1.0, 2), exact=exact).agrees
    result = agreement.agreement(stack(1.0, 1), stack(factor, 3), exact=exact)
    assert not result.agrees
    assert result.mean_difference == pytest.approx(1.0 - factor, abs=0.005)
    assert result.block_difference == pytest.approx(factor - 1.0, rel=0.3)


def test_errors_are_free_of_the_noise_of_references(report):
    """A picture of 10 % noise against two of 30 %: against one of them the error would be 32 %."""
    truth = np.ones((256, 256, 3))
    rng = np.random.default_rng(6)
    image = truth + 0.1 * rng.normal(size=truth.shape)
    references = [truth + 0.3 * rng.normal(size=truth.shape) for _ in range(2)]
    error = render.squared_error(image, references)
    report("squared error", error, 0.01)
    # Of each product the standard deviation is about sqrt(3 · 0.01² + 2 · 0.01 · 0.09 + 0.09²).
    assert error == pytest.approx(0.01, abs=4.0 * 0.1 / np.sqrt(truth.size))
    assert render.squared_error(truth, references) == pytest.approx(0.0, abs=4.0 * 0.09 / np.sqrt(truth.size))


def test_derivatives_by_an_environment_follow_its_conversion(tmp_path):
    """Mitsuba's image is a linear function A of wrt's, so that the derivative is Aᵀ of Mitsuba's."""
    pytest.importorskip("mitsuba")
    rng = np.random.default_rng(7)
    pixels = rng.uniform(size=(4, 6, 3)).astype(np.float32)
    scene = gradient_scenes.environment()
    scene.environment = wrt.ImageEnvironment(pixels)
    bitmap = to_mitsuba(scene, tmp_path, width=4, height=4, max_depth=2)["environment"]["bitmap"]
    padded = np.pad(np.array(bitmap), ((0, 0), (1, 1), (0, 0)), mode="wrap")
    derivative = rng.normal(size=padded.shape)
    ours = gradient_scenes.as_ours("environment.texels", derivative, pixels.shape)
    assert (ours * pixels).sum() == pytest.approx((derivative * padded).sum(), rel=1e-5)


def test_commands_of_the_pages_are_understood():
    pages = [ROOT / "docs" / "performance.md", *sorted((ROOT / "docs" / "notes").glob("*.md"))]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    lines = re.findall(r"^python scripts/benchmark\.py (.*)$", text, re.MULTILINE)
    assert len(lines) >= 5
    for line in lines:
        benchmark.command_line().parse_args(shlex.split(line, comments=True))


def test_pages_show_what_was_measured():
    """The tables of the docs are those of docs/measured."""
    for name in {path.stem for path in measure.MEASURED_FOLDER.glob("*.json")} - {mutate.OUTCOMES.stem}:
        result = measure.result_of(name)
        assert result["benchmark"] == name
        for section in report.SECTIONS[name]:
            page = section.page.read_text(encoding="utf-8")
            assert f"<!-- {section.name} -->\n{section.text(result).strip()}\n<!-- end of {section.name} -->" in page


def test_every_fault_can_be_planted_and_the_page_has_its_outcome():
    """A refactoring that moves a line must move its fault."""
    assert len(mutate.MUTANTS) >= 40
    for mutant in mutate.MUTANTS:
        assert mutant.old in (ROOT / mutant.file).read_text(encoding="utf-8"), mutant.name
        assert mutant.old != mutant.new
        files = [word for word in shlex.split(mutant.tests) if word.startswith("tests/")]
        assert files
        assert all((ROOT / file).is_file() for file in files), mutant.name
    page = mutate.PAGE.read_text(encoding="utf-8")
    assert page == mutate.page(page, json.loads(mutate.OUTCOMES.read_text(encoding="utf-8")))
