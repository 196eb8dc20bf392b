"""What benchmarks are made of, where no other renderer is needed: scenes, verdicts, errors, laws, tables, processes."""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import shlex
import threading
from pathlib import Path
from xml.etree import ElementTree

import benchmark
import numpy as np
import pytest
from benchmarks import agreement, checkouts, figures, found, measure, render, report, scaling, scenes
from conftest import ROOT, Report
from peers import peer
from peers.mitsuba_worker import square_text
from peers.picture_tests import image_z_test
from peers.worker import NamedFile, named_file

import wrt
from wrt.backend.device import Device
from wrt.upload.scene_data import build_scene

SMALL = scenes.Budget(share=0.01, assets=Path("/nowhere"))


# --- Scenes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", scenes.CASES)
def test_every_scene_is_built_and_written(name: str, tmp_path: Path) -> None:
    scene = scenes.CASES[name].scene(16, SMALL)
    peer.prepare(peer.OWN, scene, tmp_path)
    read = wrt.load(tmp_path / "scene.toml")
    assert read.settings == scene.settings
    assert (scene.settings.width, scene.settings.filter) == (16, "box")
    assert build_scene(read, Device("cpu")).features == build_scene(scene, Device("cpu")).features


def test_all_but_moving_scenes_are_given_to_mitsuba(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    for name, case in scenes.CASES.items():
        folder = tmp_path / name
        folder.mkdir()
        if name == "motion":
            with pytest.raises(NotImplementedError, match="motion"):
                peer.prepare(peer.PEERS["mitsuba-llvm"], case.scene(16, SMALL), folder)
        else:
            peer.prepare(peer.PEERS["mitsuba-llvm"], case.scene(16, SMALL), folder)
            tree = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
            assert tree["integrator"]["max_depth"] == case.depth


def test_lanterns_have_their_number_and_their_power() -> None:
    def power(scene: wrt.Scene) -> tuple[int, float]:
        lamps = [shape for shape in scene.shapes if shape.emits]
        areas = [
            np.linalg.norm(np.cross(*np.diff(s.mesh.vertices[s.mesh.faces], axis=1).swapaxes(0, 1)), axis=1)
            for s in lamps
        ]
        count = sum(len(shape.mesh.faces) for shape in lamps)
        return count, sum(0.5 * a.sum() * s.emission[0] for a, s in zip(areas, lamps, strict=True))  # type: ignore[index]

    counts, powers = zip(*(power(scenes.lanterns(n)) for n in (10, 1000, 10_000)), strict=True)
    assert counts == (10, 1000, 10_000)
    np.testing.assert_allclose(powers, powers[0], rtol=1e-3)
    assert scenes.shares(11, 5) == [3, 2, 2, 2, 2]


# --- Verdicts and errors -----------------------------------------------------------------------------


def stack(factor: float, seed: int, count: int = 6, noise: float = 0.3) -> np.ndarray:
    truth = 1.0 + np.sin(np.arange(64.0))[:, None, None] * np.cos(np.arange(64.0))[None, :, None] * np.ones(3)
    return factor * truth * (1.0 + noise * np.random.default_rng(seed).normal(size=(count, 64, 64, 3)))


@pytest.mark.parametrize("exact", [True, False])
def test_same_pictures_agree_and_others_do_not(exact: bool) -> None:
    assert agreement.agreement(stack(1.0, 1), stack(1.0, 2), exact=exact).agrees
    other = 1.02 if exact else 1.08
    result = agreement.agreement(stack(1.0, 1), stack(other, 3), exact=exact)
    assert not result.agrees
    assert result.mean_difference == pytest.approx(1.0 - other, abs=0.005)
    assert result.block_difference == pytest.approx(other - 1.0, rel=0.3)


def test_a_difference_in_one_place_is_seen_by_pixels() -> None:
    theirs = stack(1.0, 4, noise=0.01)
    theirs[:, 10:16, 10:18] *= 1.2
    result = agreement.agreement(stack(1.0, 5, noise=0.01), theirs, exact=True)
    assert not result.agrees
    assert abs(result.mean_difference) < agreement.SMALL


def test_errors_are_free_of_the_noise_of_references(report: Report) -> None:
    """A picture of 10 % noise against two of 30 %: against one of them the error would be 32 %."""
    truth = np.ones((256, 256, 3))
    rng = np.random.default_rng(6)
    image = truth + 0.1 * rng.normal(size=truth.shape)
    references = [truth + 0.3 * rng.normal(size=truth.shape) for _ in range(2)]
    errors = render.squared_errors(image, references)
    report("squared error", errors["rmse"], 0.01)
    # Of each product the standard deviation is about sqrt(3 · 0.01² + 2 · 0.01 · 0.09 + 0.09²).
    assert errors["rmse"] == pytest.approx(0.01, abs=4.0 * 0.1 / np.sqrt(truth.size))
    assert render.squared_errors(truth, references)["rmse"] == pytest.approx(0.0, abs=4.0 * 0.09 / np.sqrt(truth.size))


def test_z_test_is_the_tests_own() -> None:
    from support import statistics

    assert statistics.image_z_test is image_z_test


# --- Laws, tables, pages -------------------------------------------------------------------------------


def test_laws_are_found() -> None:
    x = np.array([1e3, 1e4, 1e5, 1e6])
    factor, exponent, quality = measure.law_of_power(x, 5.0 * x**-0.2)
    assert (factor, exponent, quality) == pytest.approx((5.0, -0.2, 1.0))
    assert measure.line_through(x, 200.0 + 7e-5 * x) == pytest.approx((200.0, 7e-5, 1.0))
    points = [{"triangles": n, "paths_per_second": 1e6, "peak_bytes": 2e8 + 70 * n} for n in x]
    assert scaling.laws("triangles", points)["memory"].startswith("200 MB + 70 bytes · triangles")


def test_geometric_mean() -> None:
    assert measure.geometric_mean([0.5, 2.0, 8.0]) == pytest.approx(2.0)


def test_sections_of_pages_are_replaced(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- x -->\nold\n<!-- end of x -->\nb\n", encoding="utf-8")
    for text in ("new", "newer\nlines"):
        measure.write_section(page, "x", text)
        assert page.read_text(encoding="utf-8") == f"a\n<!-- x -->\n{text}\n<!-- end of x -->\nb\n"
    with pytest.raises(ValueError, match="0 places are called y"):
        measure.write_section(page, "y", "text")


def test_commands_of_the_page_are_understood() -> None:
    pages = [ROOT / "docs" / "performance.md", *sorted((ROOT / "docs" / "notes").glob("*.md"))]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    lines = re.findall(r"^python scripts/benchmark\.py (.*)$", text, re.MULTILINE)
    assert len(lines) >= 7
    for line in lines:
        benchmark.command_line().parse_args(shlex.split(line, comments=True))


@pytest.mark.parametrize("name", sorted(path.stem for path in measure.MEASURED_FOLDER.glob("*.json")))
def test_pages_show_what_was_measured(name: str, tmp_path: Path) -> None:
    """The tables of the docs are those of docs/measured, and their plots can be drawn from it."""
    result = figures.result_of(name)
    assert result["benchmark"] == name
    for section in report.SECTIONS[name]:
        page = section.page.read_text(encoding="utf-8")
        assert f"<!-- {section.name} -->\n{section.text(result).strip()}\n<!-- end of {section.name} -->" in page
    if f"benchmark-{name}" in figures.MEASURED:
        pytest.importorskip("matplotlib", reason="plots need matplotlib")
        figures.MEASURED[f"benchmark-{name}"](tmp_path / "plot.png")
        assert (tmp_path / "plot.png").stat().st_size > 5_000


# --- Processes -----------------------------------------------------------------------------------------


def test_a_renderer_in_a_process_of_its_own(tmp_path: Path) -> None:
    """Bits are those of this process; memory is counted; a first picture comes from the command line."""
    scene = scenes.CASES["cornell"].scene(24, SMALL)
    peer.prepare(peer.OWN, scene, tmp_path)
    with peer.Session(peer.OWN, tmp_path, peer.Environments(), threads=1) as session:
        assert session.about["threads"] == 1
        assert {"import", "load", "build", "kernel"} <= set(session.about["seconds"])
        image, seconds = session.picture(2, 5, tmp_path / "image.npy")
        again, _ = session.picture(2, 5, tmp_path / "image.npy")
        assert session.peak_memory() > 50e6
    renderer = wrt.Renderer(scene, seed=5)
    for _ in renderer.passes(spp=2):
        pass
    np.testing.assert_array_equal(image, renderer.image())
    np.testing.assert_array_equal(again, image)
    assert seconds > 0.0
    options = argparse.Namespace(device="cpu")
    line = peer.first_picture_command(peer.OWN, tmp_path, peer.Environments(), options.device, tmp_path / "first.png")
    assert line[2:4] == ["wrt", "render"]


def test_renders_are_timed_by_seconds_of_cpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over as many cores as are given; on a GPU there are none to count."""
    peer.prepare(peer.OWN, scenes.CASES["cornell"].scene(24, SMALL), tmp_path)
    with peer.Session(peer.OWN, tmp_path, peer.Environments(), threads=1, cpus=4) as session:
        assert session.render(8, 2) > 0.0
        monkeypatch.setattr(session, "ask", lambda **_: {"seconds": 1.0, "cpu_seconds": 8.0})
        assert session.render(8, 3) == 2.0
        monkeypatch.undo()
    with pytest.raises(SystemExit, match="GPU"):
        benchmark.main(["render", "--cpu-seconds", "--device", "cuda", "--peers", "mitsuba-llvm"])


def test_a_run_goes_on_where_another_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes are written one by one; those that are there are not measured again."""
    saved = tmp_path / "found.json"
    line = ["render", "--quick", "--peers", "mitsuba-cuda", "--json", str(saved)]
    measured = []

    def measure_scene(sessions: dict, row: dict, *_: object) -> np.ndarray:
        measured.append(row["scene"])
        if len(measured) == 2:
            raise KeyboardInterrupt
        return np.zeros((2, 2, 3))

    monkeypatch.setattr(render, "measure_scene", measure_scene)
    monkeypatch.setattr(render, "Session", lambda given, *_, **__: contextlib.nullcontext(FakeSession(given)))
    with pytest.raises(KeyboardInterrupt):
        benchmark.main([*line, "--scenes", "lens", "cornell"])
    benchmark.main([*line, "--scenes", "lens", "cornell", "--resume"])
    assert measured == ["lens", "cornell", "cornell"]
    result = json.loads(saved.read_text())
    assert [row["scene"] for row in result["rows"]] == ["cornell", "lens"]
    assert result["cores"] > 0
    with pytest.raises(SystemExit, match="--json"):
        benchmark.main(["render", "--quick", "--resume"])


def test_scene_files_of_others_are_rendered_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All workers get the file; Mitsuba's text has the size and the filter, also where another file has the film."""
    (tmp_path / "camera.xml").write_text(
        '<scene><sensor type="perspective"><film type="hdrfilm"><integer name="width" value="$width"/>'
        '<integer name="height" value="32"/><rfilter type="gaussian"/></film></sensor></scene>',
        encoding="utf-8",
    )
    file = tmp_path / "box.xml"
    file.write_text(
        '<scene version="3.0.0"><default name="width" value="64"/><include filename="camera.xml"/>'
        '<integrator type="path"/><shape type="rectangle"/></scene>',
        encoding="utf-8",
    )
    film = ElementTree.fromstring(square_text(file, 24, box=True)).find("sensor/film")
    assert film is not None
    assert [entry.get("value") for entry in film.iterfind("integer")] == ["24", "24"]
    assert [entry.get("type") for entry in film.iterfind("rfilter")] == ["box"]
    assert 'rfilter type="gaussian"' in square_text(file, 24)

    notes = []

    def measure_scene(sessions: dict, row: dict, folder: Path, *_: object) -> np.ndarray:
        notes.append(named_file(folder))
        return np.zeros((2, 2, 3))

    monkeypatch.setattr(render, "measure_scene", measure_scene)
    monkeypatch.setattr(render, "Session", lambda given, *_, **__: contextlib.nullcontext(FakeSession(given)))
    saved = tmp_path / "found.json"
    benchmark.main(["render", "--peers", "mitsuba-llvm", "--size", "24", "--files", str(file), "--json", str(saved)])
    assert notes == [NamedFile(file, 24, box=True)]
    result = json.loads(saved.read_text())
    assert (result["benchmark"], [row["scene"] for row in result["rows"]]) == ("files", ["box"])


class FakeSession:
    """A renderer that is never asked for anything."""

    def __init__(self, given: peer.Peer) -> None:
        self.peer, self.process = given, argparse.Namespace(kill=lambda: None)


@pytest.mark.slow
def test_checkouts_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two of the same, in turn; and what is no checkout, or one whose worker does not tell what is needed."""
    options = ["--scenes", "cornell", "--size", "24", "--seconds", "0.01", "--rounds", "3"]
    saved = tmp_path / "found.json"
    assert benchmark.main(["checkouts", str(ROOT), *options, "--json", str(saved)]) == 0
    (row,) = json.loads(saved.read_text(encoding="utf-8"))["rows"]
    assert (row["scene"], row["checkout"], len(row["ratios"])) == ("cornell", str(ROOT), 3)
    assert 0.0 < min(row["ratios"]) <= row["ratio"] <= max(row["ratios"])
    assert "`cornell`" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="no checkout of wrt"):
        benchmark.main(["checkouts", str(tmp_path), *options])
    worker = tmp_path / "scripts" / "peers" / "wrt_worker.py"
    worker.parent.mkdir(parents=True)
    worker.write_text("import sys\nsys.exit('too old')\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="ended: too old"):
        benchmark.main(["checkouts", str(tmp_path), *options])
    worker.write_text("print('{}', flush=True)\nfor _ in open(0):\n    print('{}', flush=True)\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="seconds of CPU"):
        benchmark.main(["checkouts", str(tmp_path), *options])
    assert checkouts.quartiles([3.0]) == (3.0, 3.0, 3.0)


def test_scenes_of_others_that_are_not_there_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved = tmp_path / "found.json"
    assert benchmark.main(["found", "--folder", str(tmp_path), "--scenes", "cbox", "--json", str(saved)]) == 0
    assert capsys.readouterr().err == "cbox: not there, and left out\n"
    assert json.loads(saved.read_text())["rows"] == []


def test_scenes_that_cannot_be_fetched_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(found, "SOURCE", (tmp_path / "nothing").as_uri())
    assert benchmark.main(["found", "--scenes", "cbox"]) == 0
    assert "cannot be fetched" in capsys.readouterr().err


def test_the_compiler_of_later_renders_is_waited_for(tmp_path: Path) -> None:
    requests = tmp_path / "wrt" / "requests"
    found.wait_for_compiler(tmp_path)
    requests.mkdir(parents=True)
    (begun := requests / "a.begun").touch()
    timer = threading.Timer(0.3, begun.unlink)
    timer.start()
    found.wait_for_compiler(tmp_path)
    assert not begun.exists()


def test_what_a_renderer_said_last_is_told(tmp_path: Path) -> None:
    with pytest.raises(peer.PeerError, match=r"wrt ended: .*scene\.toml"):
        peer.Session(peer.OWN, tmp_path, peer.Environments())
    with pytest.raises(peer.PeerError, match="no libLLVM"):
        peer.Environments(llvm=tmp_path).variables(peer.PEERS["mitsuba-llvm"])
    with pytest.raises(peer.PeerError, match="does not run on cpu"):
        peer.command(peer.PEERS["mitsuba-cuda"], tmp_path, peer.Environments(), "cpu")
