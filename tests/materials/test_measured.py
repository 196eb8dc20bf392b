"""Measured reflectances: weights are values over densities, Mitsuba says the same, and files are its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import ANGLES, Case, ask_mitsuba, hemisphere, viewer
from support.kernels import uniforms
from support.measurements import ISOTROPIC, arbitrary, azimuths
from support.scene_files import QUAD
from support.wide_scenes import differences, needs_lanes, room

import wrt
from wrt.io.measured.measurement import load_measurement, save_measurement, write_tensors
from wrt.io.measured.observer import WAVELENGTHS
from wrt.io.mitsuba.spectra import reflected
from wrt.scene.materials.measured import Measurement

N = 1000

TABLES = {
    "isotropic": arbitrary(ISOTROPIC),
    "circle": arbitrary(azimuths(1, 7)),
    "half": arbitrary(azimuths(2, 5)),
    "quarter": arbitrary(azimuths(4, 4)),
    "two azimuths": arbitrary(np.array([-3.0, -1.8], np.float32)),
    "values alone": arbitrary(ISOTROPIC, jacobian=False, seed=1),
    "steep": arbitrary(azimuths(4, 4), steep=6.0, seed=2),
}


CASES = {name: Case(wrt.Measured(tables)) for name, tables in TABLES.items()}


# --- Sampling ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, device: str) -> None:
    """`sample` knows the points of the squares, the others find them by the direction.

    That loses digits where facets face straight up, as x is the root of their angle; hence those within 1° are left
    out.
    """
    for degrees in ANGLES:
        wo = viewer(degrees)
        found = CASES[name].sample(wo, uniforms(40_000, 3, seed=1), device)
        wi = found["wi"].astype(np.float64)
        np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1.0, atol=2e-6)
        facet = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
        drawn = (found["pdf"] > 0.0) & (facet[:, 2] < np.cos(np.radians(1.0)))
        assert drawn.sum() > 8_000
        value, pdf, _ = CASES[name].evaluate(wo, wi[drawn], device)
        np.testing.assert_allclose(found["pdf"][drawn], pdf, rtol=2e-3)
        np.testing.assert_allclose(found["weight"][drawn], value / pdf[:, None], rtol=2e-3, atol=1e-5)
        assert not found["weight"][found["pdf"] == 0.0].any()


def test_only_anisotropic_ones_follow_the_texture() -> None:
    for name, tables in TABLES.items():
        assert wrt.Measured(tables).needs_tangents == (name in ("circle", "half", "quarter", "steep"))


def test_viewers_at_both_ends_of_a_half(device: str) -> None:
    """Exactly along the axis, where the azimuth could be either end."""
    wi = hemisphere(N, seed=46)
    for x in (0.6, -0.6):
        on_axis = CASES["half"].evaluate(np.array([x, 0.0, 0.8]), wi, device)[0]
        off_axis = CASES["half"].evaluate(np.array([x, 1e-6, 0.8]), wi, device)[0]
        np.testing.assert_allclose(on_axis, off_axis, rtol=1e-3)


# --- Mitsuba -----------------------------------------------------------------------------------------


def saved(folder: Path, tables: Measurement) -> Path:
    file = folder / "tables_rgb.bsdf"
    with file.open("wb") as handle:
        save_measurement(handle, tables)
    return file


def mitsubas_samples(file: Path, wo: NDArray, u: NDArray) -> tuple[NDArray, ...]:
    """Return the directions, densities and weights of Mitsuba's samples."""
    from support.mitsuba_scene import load_mitsuba

    mi = load_mitsuba()
    bsdf = mi.load_dict({"type": "measured", "filename": str(file)})
    context, surface = mi.BSDFContext(), mi.SurfaceInteraction3f()
    rows = []
    for out, (x, y, choice) in zip(wo.tolist(), u.tolist(), strict=True):
        surface.wi = mi.Vector3f(*out)
        drawn, weight = bsdf.sample(context, surface, choice, mi.Point2f(y, x))
        rows.append([*drawn.wo, drawn.pdf, *weight])
    found = np.array(rows, np.float64)
    return found[:, :3], found[:, 3], found[:, 4:]


@pytest.mark.parametrize("name", CASES)
def test_mitsuba_says_the_same(name: str, tmp_path: Path, device: str, report: Report) -> None:
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    case = CASES[name]
    file = saved(tmp_path, TABLES[name])
    n = 500
    wo, wi = (hemisphere(n, seed).astype(np.float32) for seed in (50, 51))
    if TABLES[name].is_isotropic:
        # Mitsuba (up to 3.9) does not set how much of the circle these cover, and mirrors directions by what happens
        # to be in memory; but not those of this quarter.
        wo[:, :2] = -np.abs(wo[:, :2])
    u = uniforms(n, 3, seed=52)
    value, pdf = ask_mitsuba({"type": "measured", "filename": str(file)}, wo, wi)
    direction, density, weight = mitsubas_samples(file, wo, u)
    found, found_pdf, _ = case.evaluate(wo, wi, device)
    drawn = case.sample(wo, u, device)
    report(f"{name}: largest difference of values", float(np.abs(found / np.maximum(value, 1e-9) - 1.0).max()), 0.0)
    # Where tables are steep, little is left of sums in single precision.
    rtol = 2e-4 if name == "steep" else 2e-5
    np.testing.assert_allclose(found, value, rtol=rtol, atol=1e-7)
    np.testing.assert_allclose(found_pdf, pdf, rtol=rtol, atol=1e-7)
    above = (drawn["pdf"] > 0.0) & (direction[:, 2] > 1e-4)
    assert above.sum() > n / 4
    np.testing.assert_allclose(drawn["wi"][above], direction[above], atol=2e-4)
    assert np.mean(np.abs(drawn["pdf"][above] / density[above] - 1.0) < 2e-3) > 0.99
    assert np.mean(np.abs(drawn["weight"][above] - weight[above]).max(axis=1) < 2e-3 * weight[above].max()) > 0.99


# --- Files -------------------------------------------------------------------------------------------


def fields_of(tables: Measurement) -> dict[str, NDArray[Any]]:
    names = ("phi_i", "theta_i", "ndf", "sigma", "vndf", "luminance", "rgb")
    return {
        "description": np.frombuffer(b"made", np.uint8),
        **{name: np.array(getattr(tables, name)) for name in names},
        "jacobian": np.ones(1, np.uint8),
    }


def written(file: Path, fields: dict[str, NDArray[Any]]) -> Path:
    with file.open("wb") as handle:
        write_tensors(handle, fields)
    return file


def same(a: Measurement, b: Measurement) -> bool:
    return a.jacobian == b.jacobian and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in fields_of(a) if name[0] not in "dj"
    )


def test_files_are_mitsubas_and_are_read_back_bit_for_bit(tmp_path: Path) -> None:
    for tables in TABLES.values():
        assert same(load_measurement(saved(tmp_path, tables)), tables)
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    from mitsuba.python import tensor_io

    tables = TABLES["half"]
    tensor_io.write(str(tmp_path / "theirs.bsdf"), **fields_of(tables))
    assert same(load_measurement(tmp_path / "theirs.bsdf"), tables)
    read = tensor_io.read(str(saved(tmp_path, tables)))
    assert all(np.array_equal(read[name], values) for name, values in fields_of(tables).items() if name[0] != "d")


def spectral(tmp_path: Path, wavelengths: NDArray[Any], spectrum: NDArray[Any]) -> Measurement:
    """Return a measurement that reflects one spectrum everywhere."""
    fields = fields_of(TABLES["isotropic"])
    shape = fields.pop("rgb").shape
    fields["wavelengths"] = wavelengths.astype(np.float32)
    spectra = np.broadcast_to(spectrum[None, None, :, None, None], (*shape[:2], len(spectrum), *shape[3:]))
    fields["spectra"] = np.array(spectra, np.float32)
    return load_measurement(written(tmp_path / "tables_spec.bsdf", fields))


def test_spectra_become_colours_as_other_reflectances_do(tmp_path: Path) -> None:
    even = np.linspace(360.0, 1000.0, 195)
    np.testing.assert_allclose(spectral(tmp_path, even, np.full(195, 0.7)).rgb, 0.7, rtol=1e-6)
    spectrum = 0.5 + 0.4 * np.sin(even / 40.0)
    found = spectral(tmp_path, even, spectrum).rgb
    expected = reflected(np.interp(WAVELENGTHS, even, spectrum))
    np.testing.assert_allclose(found[0, 1, :, 3, 4], expected, rtol=1e-5)
    # Beyond what was measured the last value holds, as in Mitsuba; a pure green is outside of the colours.
    narrow = spectral(tmp_path, np.array([500.0, 600.0]), np.array([0.3, 0.3])).rgb
    np.testing.assert_allclose(narrow, 0.3, rtol=1e-6)
    green = spectral(tmp_path, np.array([500.0, 515.0, 530.0]), np.array([0.0, 1.0, 0.0])).rgb
    assert green[0, 0, 0].max() == 0.0
    assert green[0, 0, 1].min() > 0.0


BAD: list[tuple[str, Any, str]] = [
    ("vndf", None, "it lacks 'vndf'"),
    ("ndf", lambda x: x.astype(np.float64), "must be of float32 numbers"),
    ("luminance", lambda x: x[..., :5], "must have the shape (5, 4, 5, 5)"),
    ("rgb", lambda x: x[0], "must have five dimensions"),
    ("rgb", lambda x: x * np.float32(np.inf), "not finite"),
    ("luminance", lambda x: -x, "finite numbers from 0"),
    ("theta_i", lambda x: x[::-1], "ascending angles"),
    ("phi_i", lambda x: x / 3.0, "1/6"),
]
"""Name of a table, how to damage it, and the message."""


DAMAGED = [
    (lambda _: b"tensor", "not a tensor file"),
    (lambda data: data[:20], "ends within the list"),
    (lambda data: data[:-4000], "but it is shorter"),
    (lambda data: data[:12] + b"\2" + data[13:], "version 2.0"),
]


def test_bad_files_are_refused_in_one_line(tmp_path: Path) -> None:
    intact, file = saved(tmp_path, TABLES["isotropic"]).read_bytes(), tmp_path / "bad.bsdf"

    def assert_refused(message: str) -> None:
        with pytest.raises(wrt.InputError) as caught:
            load_measurement(file)
        assert str(caught.value).startswith(f"{file}: ")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)

    for name, alter, message in BAD:
        fields = fields_of(TABLES["half"])
        table = fields.pop(name)
        written(file, fields if alter is None else {**fields, name: alter(table)})
        assert_refused(message)
    for damage, message in DAMAGED:
        file.write_bytes(damage(intact))
        assert_refused(message)
    written(file, {name: np.zeros(1, np.float32) for name in ("theta_h", "theta_d", "phi_d", "wvls", "M")})
    assert_refused("polarised measurement")


# --- Scenes ------------------------------------------------------------------------------------------


def test_scene_files(tmp_path: Path) -> None:
    saved(tmp_path, TABLES["half"])
    text = '[materials.paint]\ntype = "measured"\nmeasurement = "tables_rgb.bsdf"\n'
    (tmp_path / "scene.toml").write_text(text + 2 * f'{QUAD}material = "paint"\n')
    wrt.save_scene(tmp_path / "again.toml", wrt.load(tmp_path / "scene.toml"))
    first, second = (shape.material.measurement for shape in wrt.load(tmp_path / "again.toml").shapes)
    assert first is second  # a file is read once
    assert same(first, TABLES["half"])
    (tmp_path / "bad.toml").write_text(text.replace("tables", "no"))
    with pytest.raises(wrt.InputError, match=r"bad\.toml: materials\.paint\.measurement: .*no_rgb.bsdf: no such file"):
        wrt.load(tmp_path / "bad.toml")


def test_scenes_of_mitsuba(tmp_path: Path) -> None:
    def scene(kind: str, name: str = "tables_rgb.bsdf") -> Path:
        bsdf = f'<bsdf type="{kind}"><string name="filename" value="{name}"/></bsdf>'
        file = tmp_path / "scene.xml"
        file.write_text(f'<scene version="3.0.0"><shape type="rectangle">{bsdf}</shape></scene>')
        return file

    saved(tmp_path, TABLES["quarter"])
    (shape,) = wrt.load(scene("measured"), strict=True).shapes
    assert same(shape.material.front.measurement, TABLES["quarter"])
    assert shape.material.back == wrt.Diffuse(0.0)
    with pytest.raises(wrt.InputError, match=r"scene\.xml: line 1: .*other\.bsdf: no such file"):
        wrt.load(scene("measured", "other.bsdf"))
    with pytest.warns(UserWarning, match="measured_polarized.*grey stands in for it"):
        wrt.load(scene("measured_polarized"))


@needs_lanes
@pytest.mark.machinery
def test_the_wide_kernel_has_the_same_bits() -> None:
    assert differences(room(wrt.Diffuse(), CASES["isotropic"].material, CASES["circle"].material)) == []
