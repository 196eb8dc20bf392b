"""A user-defined material: its model is right, and it works like a built-in one; so does docs/own.md's."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from support.bsdfs import Case, albedo, assert_finite, assert_weights, chi_square, reciprocity_error
from support.pages import definitions, program_of, run_program
from support.small_scenes import finish, image_of

import wrt
from wrt.kernels.bsdf import BSDFS, register_model
from wrt.kernels.bsdf.diffuse import DIFFUSE as LAMBERT
from wrt.kernels.core.bsdf import MAX_SLOTS
from wrt.scene.materials import MATERIALS
from wrt.scene.srgb import srgb_from_linear

CODE = (ROOT / "tests/support/moon.py").read_text("utf-8")


def lunar_of(name: str, code: str) -> Any:
    """Return the material that code registers."""
    return definitions(code, Path(tempfile.mkdtemp()) / f"{name}.py")["Lunar"]


@pytest.fixture(scope="module", autouse=True)
def lunar() -> Iterator[Any]:
    """Leave the registers as they were found, for tests of other files that look at every material."""
    yield lunar_of("lunar", CODE)
    del MATERIALS["lunar"]
    BSDFS.forget("lunar")


@pytest.mark.slow
def test_the_program_runs_and_the_full_moon_is_flat(tmp_path: Path) -> None:
    """Seen from where the light comes from, cosθi = cosθo, and the radiance is E w / 8π right to the rim."""
    run_program(CODE, tmp_path / "moon.py")
    codes = srgb_from_linear(wrt.load_image(tmp_path / "moon.png")) * 255.0
    y, x = np.meshgrid(*(2.0 * (np.arange(512) + 0.5) / 512.0 - 1.0,) * 2, indexing="ij")
    # Radii of the moon from the axis; from 220 of them away the camera does not see quite what the sun sees.
    off = np.hypot(x, y) * 220.0 * np.tan(np.radians(0.3))
    expected = 255.0 * srgb_from_linear(60.0 * np.array([0.22, 0.2, 0.18]) / (8.0 * np.pi))
    assert (off < 0.98).mean() > 0.4
    assert np.abs(codes - expected)[off < 0.98].max() < 3.0
    assert codes[off > 1.02].max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.0, 80.0])
def test_its_model_is_right(lunar: Any, degrees: float, device: str, report: Report) -> None:
    """Samples follow the density, weights are value over density, and the energy is the closed form, on both sides."""
    result = chi_square(Case(lunar(0.8)), degrees, device, tests=2)
    assert result.passed, result.message
    assert_weights(Case(lunar((1.0, 0.5, 0.0))), degrees, device)
    mu = np.cos(np.radians(degrees))
    expected = 0.5 * (1.0 - mu * np.log1p(1.0 / mu))
    for front in (True, False):
        mean, error = albedo(Case(lunar(1.0), front), degrees, device)
        report(f"Moon at {degrees:g}°: energy", float(mean[0]), float(expected))
        assert (np.abs(mean - expected) < 3.5 * error + 1e-5).all()
    assert reciprocity_error(Case(lunar((0.9, 0.5, 0.1))), device) < 1e-5
    assert_finite(Case(lunar(1.0)), device)


PLANTED = {
    "samples follow the density": ("z = 1.0 - u[0]", "z = wp.sqrt(1.0 - u[0])", "at 0°: χ²"),
    "weights are f |cos| / pdf": ("wi) * TWO_PI", "wi) * TWO_PI * 1.1", "the weight of a sample is not `evaluate`"),
    "no energy is made": ("(wi[2] / (FOUR_PI", "3.0 * (wi[2] / (FOUR_PI", "% of the light leaves"),
    "it is reciprocal": ("* (wi[2] / (FOUR_PI", "* wo[2] * (wi[2] / (FOUR_PI", "differ by up to"),
    "values are finite, and not below 0": ("    if wi[2] <= 0.0:", "    if wi[2] < -2.0:", "`evaluate` is"),
    "nothing is below the surface": ("wp.where(wi[2] > 0.0, 1.0 / TWO_PI, 0.0)", "1.0 / TWO_PI", "`pdf` is not 0"),
}
"""Faults in the page's model by the check that notices them: what is replaced, by what, and words of the message."""


@pytest.mark.slow
def test_check_bsdf_tells_what_is_wrong(lunar: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert wrt.check_bsdf(lunar)
    assert "FAULT" not in capsys.readouterr().out
    for number, (check, (right, wrong, words)) in enumerate(PLANTED.items()):
        code = CODE.replace(right, wrong)
        assert code != CODE
        code = code.replace('"lunar"', f'"planted-{number}"')
        try:
            assert not wrt.check_bsdf(lunar_of(f"planted_{number}", code)(1.0))
        finally:
            MATERIALS.pop(f"planted-{number}", None)
        (line,) = [line for line in capsys.readouterr().out.splitlines() if check in line]
        assert line.startswith("  FAULT"), check
        assert re.search(words, line), line


def test_check_bsdf_of_built_in_materials(capsys: pytest.CaptureFixture[str]) -> None:
    assert wrt.check_bsdf(wrt.Diffuse)
    out = capsys.readouterr().out
    assert out.count("\n  ok ") == 6
    assert re.search("samples follow the density +p 0", out)
    with pytest.raises(wrt.InputError, match="TwoSided: give a material without parts"):
        wrt.check_bsdf(wrt.TwoSided(wrt.Diffuse(), wrt.Diffuse()))


@pytest.mark.slow
def test_a_model_may_depend_on_the_place(tmp_path: Path, device: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The page's flakes: another normal in each cell, right in each; the page's programs run; no gradients."""
    try:
        paint = definitions(program_of("own", "car_paint.py"), tmp_path / "car_paint.py")["Flakes"]
        for position in ((0.3, 0.4, 0.5), (1.1, -0.2, 0.9)):
            assert wrt.check_bsdf(paint(1.0), position=position)
        out = capsys.readouterr().out
        assert len(set(re.findall("up to ([0-9.]+) % of the light", out))) == 2
        scene = wrt.Scene(camera=wrt.OrthographicCamera((0.0, 0.0, 3.0), view_height=2.0))
        scene.add(wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), material=paint(1.0, 4.0))
        scene.add_light(wrt.DirectionalLight((0.0, 0.0, -1.0), irradiance=1.0))
        renderer = wrt.Renderer(scene, width=32, height=32, filter="box", device=device)
        seen = image_of(renderer, 1)[..., 0].reshape(8, 4, 8, 4)
        assert np.ptp(seen, axis=(1, 3)).max() < 1e-5 * seen.max()  # each of 8 x 8 cells is one flake
        assert len(np.unique(seen[:, 0, :, 0])) > 40
        with pytest.raises(wrt.InputError, match="model 'flakes' has no derivatives"):
            renderer.gradients(np.zeros((32, 32, 3)), spp=1)
        wrt.save_scene(tmp_path / "a.toml", scene)
        assert wrt.load(tmp_path / "a.toml").shapes[0].material == scene.shapes[0].material
    finally:
        MATERIALS.pop("flakes", None)
        BSDFS.forget("flakes")


@pytest.mark.slow
def test_it_is_a_material_like_any_other(lunar: Any, tmp_path: Path, device: str) -> None:
    """In scene files with textures, in mixtures, among others; each with what it has by itself."""
    wrt.save_image(tmp_path / "map.npy", np.full((2, 2, 3), 0.6))
    (tmp_path / "scene.toml").write_text(
        '[environment]\ntype = "constant"\n[camera]\norigin = [0, 0, 3]\nfov_degrees = 0.1\n'
        '[materials.dust]\ntype = "lunar"\nalbedo = { texture = "map.npy" }\n'
        '[materials.both]\ntype = "mix"\nfirst = "dust"\nsecond = "white"\nweight = 0.25\n'
        '[materials.white]\ntype = "diffuse"\nreflectance = 0.8\n'
        '[[shapes]]\ntype = "quad"\norigin = [-1, -1, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 2, 0]\nmaterial = "both"\n'
    )
    scene = wrt.load(tmp_path / "scene.toml")
    material: Any = scene.shapes[0].material
    assert isinstance(material.first, lunar)
    renderer = wrt.Renderer(scene, sampler="independent", width=16, height=16, device=device)
    finish(renderer, 1024)
    error = np.sqrt(renderer.variance()[..., 0].sum()) / 256
    expected = 0.75 * 0.6 * 0.5 * (1.0 - np.log(2.0)) + 0.25 * 0.8
    assert abs(renderer.image().mean(dtype=np.float64) - expected) < 3.5 * error
    with pytest.raises(wrt.InputError, match=r"albedo must be at most 1, not 1\.5"):
        lunar(1.5)


def test_what_cannot_be_registered_is_refused() -> None:
    before, families = dict(MATERIALS), dict(BSDFS.families)
    for name, model, message in (
        ("", LAMBERT, "type_name '' is empty or taken"),
        ("lunar", LAMBERT, "type_name 'lunar' is empty or taken"),
        ("rough_conductor", LAMBERT, "there is a model 'rough_conductor' already"),
        ("odd name", LAMBERT, "a model's name must be an identifier, not 'odd name'"),
        ("greedy", LAMBERT._replace(slots=MAX_SLOTS + 1), f"greedy: a model reads 0 to {MAX_SLOTS} values"),
    ):
        with pytest.raises(wrt.InputError) as caught:
            wrt.register_material(type("Own", (wrt.Material,), {"type_name": name}), model)
        assert str(caught.value).startswith(f"Own: {message}")
    with pytest.raises(ValueError, match="there is a model 'mirror' already"):
        register_model("mirror", LAMBERT)
    assert (before, families) == (MATERIALS, BSDFS.families)
    short = {"type_name": "short", "slot_names": (), "model": "mirror"}
    for material, message in (
        (type("Unknown", (wrt.Material,), {"type_name": "unknown"}), "Unknown: there is no reflection model 'unknown'"),
        (type("Short", (wrt.Mirror,), short), "Short gives 0 values, but mirror reads 1"),
    ):
        scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
        scene.add(wrt.box(), material=material())
        with pytest.raises(wrt.InputError, match=message):
            wrt.Renderer(scene, width=4, height=4)


@pytest.mark.slow
def test_ones_own_may_be_registered_again(device: str) -> None:
    """As a cell of a notebook that is edited and run again: new functions by the same names, and no old kernel."""
    renderers, images = [], []
    bright = CODE.replace("return bsdf.slots[0] * (", "return 2.0 * bsdf.slots[0] * (")
    assert bright != CODE
    try:
        for code in (CODE, bright, CODE):
            moon = lunar_of("cell", code.replace('"lunar"', '"cell-moon"'))
            assert MATERIALS["cell-moon"] is moon
            scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0)))
            scene.add(wrt.sphere(), material=moon(0.25))
            scene.add_light(wrt.DirectionalLight((0.0, 0.0, -1.0), irradiance=60.0))
            renderers.append(wrt.Renderer(scene, width=8, height=8, max_depth=2, device=device))
            images.append(image_of(renderers[-1], 1))
        # Renderers keep the functions that they were made with.
        later = [image_of(renderer, 2) for renderer in renderers]
    finally:
        del MATERIALS["cell-moon"]
    assert images[0].max() > 0.0
    for dim, twice, repeated in (images, later):
        np.testing.assert_array_equal(twice, 2.0 * dim)
        np.testing.assert_array_equal(repeated, dim)
