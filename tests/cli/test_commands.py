"""`wrt render` keeps its word: exit status, one line an error, whole files, a summary that is true."""

import json
import re
import resource
from pathlib import Path

import numpy as np
import pytest
from support.commands import CAMERA, ENVIRONMENT, QUAD, SMALL, modules_imported, run, without_progress

from wrt import meshes
from wrt.cli import main

BOX = ["render", "cornell-box", "--size", "32x32"]

FILES = {
    "broken.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n0\n",
    "text.toml": "this is not TOML",
    "no-shapes.toml": CAMERA,
    "not-a-checkpoint": "hello",
}

ERRORS = {
    "broken.ply": ["render", "broken.ply"],
    "dir.png: is a directory": ["render", "dir.png"],
    "text.toml: not TOML": ["render", "text.toml"],
    "shapes": ["render", "no-shapes.toml"],
    "dir.png": [*BOX, "-o", "dir.png"],
    "nowhere": [*BOX, "-o", "nowhere/out.png"],
    "out.webm": [*BOX, "-o", "out.webm"],
    "crop must lie inside": [*BOX, "--crop", "0,0,9999,9"],
    "--spp": [*BOX, "--spp", "0"],
    "seed": [*BOX, "--seed", "4294967296"],
    "cuda:99": [*BOX, "--device", "cuda:99"],
    "--checkpoint": [*BOX, "--resume"],
    "not-a-checkpoint: ": [*BOX, "--checkpoint", "not-a-checkpoint", "--resume"],
    "text.toml": ["render", "text.toml", "--checkpoint", "text.toml"],
    "up": [*BOX, "--up", "z"],
    "COMMAND": [],
}
"""What the message names, and the command."""


def write_unusable(folder: Path) -> list[Path]:
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "dir.png").mkdir()
    return sorted(folder.rglob("*"))


def assert_one_line(printed: str, mention: str) -> None:
    assert re.fullmatch(r"wrt: error: [^\n]+\n", printed), printed
    assert mention in printed


@pytest.mark.parametrize("mention", ERRORS)
def test_unusable_input_is_one_line_and_status_2(mention, tmp_path, monkeypatch, capsys):
    before = write_unusable(tmp_path)
    monkeypatch.chdir(tmp_path)
    status = main(ERRORS[mention])
    out, err = capsys.readouterr()
    assert (status, out) == (2, ""), err
    assert_one_line(without_progress(err), mention)
    assert sorted(tmp_path.rglob("*")) == before, "a refused command left files behind"


def test_the_program_says_the_same(tmp_path):
    """A process of its own begins and ends with more than `main`; memory is counted before it is taken."""
    result = run(tmp_path, "render", "absent.ply")
    assert (result.returncode, result.stdout) == (2, "")
    assert_one_line(result.stderr, "absent.ply")
    result = run(tmp_path, "render", "cornell-box", "--size", "46000x46000")
    assert (result.returncode, result.stdout) == (1, "")
    assert_one_line(result.stderr, "a picture of 46000x46000 needs 253.9 GB, more than the ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_status_1(tmp_path):
    assert run(tmp_path, *BOX, "--spp", "1", "-o", "small.png").returncode == 0  # kernels are in the cache from here
    # Else Python would leave truncated modules in its cache for all later processes.
    environment = {**ENVIRONMENT, "PYTHONDONTWRITEBYTECODE": "1"}
    for size, *options in ((1000, "-o", "x.png"), (1000, "-o", "x.exr"), (20_000, "--checkpoint", "state", "--quiet")):

        def limit(size=size):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

        result = run(tmp_path, *BOX, "--spp", "1", *options, before=limit, env=environment)
        assert result.returncode == 1, result.stderr
        assert_one_line(result.stderr, f"{options[1]}: ")
        assert not (tmp_path / options[1]).exists()
        assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_the_summary_tells_the_truth(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*BOX, "--spp", "8", "--threads", "2", "--json", "-o", "out.npy"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out.splitlines()[-1])
    numbers = {"seconds_total", "seconds_compile", "seconds_render", "paths_per_second", "rays_per_second", "noise"}
    exact = {"input": "cornell-box", "output": "out.npy", "device": "cpu", "threads": 2, "width": 32, "height": 32}
    exact |= {"spp": 8, "seconds_compile_beside": 0.0}
    assert set(summary) == numbers | set(exact) | {"mean_radiance"}
    assert {key: summary[key] for key in exact} == exact
    assert all(isinstance(summary[key], float) and summary[key] > 0.0 for key in numbers)
    assert summary["seconds_total"] > summary["seconds_compile"] + summary["seconds_render"]
    assert summary["paths_per_second"] == pytest.approx(32 * 32 * 8 / summary["seconds_render"])
    image = np.load("out.npy")
    assert (image.shape, image.dtype) == ((32, 32, 3), np.float32)
    assert summary["mean_radiance"] == pytest.approx(image.mean(axis=(0, 1), dtype=np.float64).tolist(), rel=1e-12)
    line = r"out\.npy  32x32  8 spp  [\d.]+ s  [\d.]+ [kMG]?\s?paths/s  noise [\d.e+]+ %\n"
    assert re.fullmatch(line, without_progress(err)), err


def test_size_samples_time_and_part_of_the_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def summary(*options):
        assert main([*BOX, *options, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    summary("--spp", "1", "-o", "whole.npy")
    part = summary("--spp", "1", "-o", "part.npy", "--crop", "3,5,20,9")
    assert (part["width"], part["height"]) == (17, 4)
    np.testing.assert_array_equal(np.load("part.npy"), np.load("whole.npy")[5:9, 3:20])
    by_time = summary("--time", "0.3")
    assert by_time["seconds_render"] >= 0.3
    assert by_time["spp"] >= 1
    assert summary("--time", "1000", "--spp", "3")["spp"] == 3, "the first limit reached counts"


@pytest.mark.filterwarnings("default")
def test_quiet_says_warnings_alone_and_the_picture_is_named_after_the_input(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*BOX, "--spp", "2", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == ["cornell-box.png"]
    Path("dark.toml").write_text(CAMERA + QUAD)
    assert main(["render", "dark.toml", *SMALL, "--quiet"]) == 0
    assert re.fullmatch(r"wrt: warning: [^\n]*no light[^\n]*\n", capsys.readouterr().err)


def test_scenes_lists_every_scene_with_its_description(capsys):
    assert main(["scenes"]) == 0
    listed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert listed == meshes.scene_descriptions()


@pytest.mark.parametrize("arguments", [["render", "--help"], ["scenes"]])
def test_short_answers_import_nothing_heavy(arguments):
    imported = modules_imported(*arguments)
    heavy = {"warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO", "scipy", "wrt.kernels", "argcomplete"}
    if arguments[-1].startswith("-"):
        # Of wrt itself just what reads the options: everything else may grow heavy imports of its own.
        heavy |= {"numpy", "json", "logging"}
        of_wrt = {name for name in imported if name.startswith("wrt.") and not name.startswith("wrt.cli.arguments")}
        allowed = ("_above", "_version", "errors", "cli", "cli.process", "cli.exit_status", "cli.streams")
        assert of_wrt <= {f"wrt.{name}" for name in allowed}
    assert "wrt.cli" in imported
    assert not imported & heavy
