"""Presets are the numbers that were printed and measured, and metals in RGB look as their spectra do."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from metal_presets import MAX_F0, channel_response, colors, lines, measured, metal_ior
from numpy.typing import NDArray
from support.fresnel import complex_fresnel

from wrt.cli import main
from wrt.io.toml.reader import load_scene
from wrt.scene.materials import presets

Array = NDArray[np.float64]

HOFFMAN = """
Titanium 0.542,0.497,0.449 194,187,179
Chromium 0.549,0.556,0.554 196,197,196
Iron 0.562,0.565,0.578 198,198,200
Nickel 0.660,0.609,0.526 212,205,192
Platinum 0.673,0.637,0.585 214,209,201
Copper 0.955,0.638,0.538 250,209,194
Palladium 0.733,0.697,0.652 222,217,211
Zinc 0.664,0.824,0.850 213,234,237
Gold 1.022,0.782,0.344 255,229,158
Aluminium 0.913,0.922,0.924 245,246,246
Silver 0.972,0.960,0.915 252,250,245
Silicon 0.345,0.369,0.426 159,164,174
water 0.020,0.020 39,39
plastic 0.040,0.045 56,60
glass 0.040,0.045 56,60
crystalware 0.050,0.080 63,80
gems 0.050,0.080 63,80
diamond-like 0.100,0.200 90,124
"""
"""Hoffman 2014: linear values and 8-bit sRGB values of the same row; of dielectrics the ends of a range."""

RTR4_METALS = {"mercury": (0.781, 0.780, 0.778), "brass": (0.910, 0.778, 0.423)}
"""The same table in Real-Time Rendering (Akenine-Möller et al. 2018, table 9.2) has two more rows."""

DIELECTRIC_IOR = {
    "air": (1.00, 1.00),
    "water": (1.33, 1.34),
    "window glass": (1.51, 1.51),
    "optical glass": (1.49, 1.92),
    "diamond": (2.42, 2.42),
}

COSINES = np.cos(np.radians([0.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 84.0, 87.0, 89.0]))


def printed() -> dict[str, tuple[tuple[float, ...], tuple[int, ...]]]:
    rows = [row.split() for row in HOFFMAN.strip().splitlines()]
    return {a.lower(): (tuple(map(float, b.split(","))), tuple(map(int, c.split(",")))) for a, b, c in rows}


def preset_f0(name: str) -> Array:
    return complex_fresnel(1.0, *presets.metal_ior(name))


def test_values_are_those_printed() -> None:
    """And each encodes to the byte that was printed beside it, so that no digit of it is wrong.

    One does not as printed: diamond-like substances begin at "0.100, 90", while 0.100 is 89 and 90 is 0.102.
    """
    tables = {**presets.METAL_F0, **presets.SEMICONDUCTOR_F0, **presets.DIELECTRIC_F0}
    assert {name: linear for name, (linear, _) in printed().items()} == tables
    assert presets.DIELECTRIC_IOR == DIELECTRIC_IOR
    wrong = []
    for x, code in (pair for row in printed().values() for pair in zip(*row, strict=True)):
        low, high = (1.055 * min(y, 1.0) ** (1.0 / 2.4) - 0.055 for y in (x - 0.0005, x + 0.0005))
        if not round(255.0 * low) <= code <= round(255.0 * high):
            wrong.append((x, code))
    assert wrong == [(0.100, 90)]
    # Indices and reflectances agree to the three decimals; water by the lower index, that of red light.
    for index, kind in (("water", "water"), ("window glass", "glass"), ("diamond", "diamond-like")):
        n, (low, high) = DIELECTRIC_IOR[index][0], presets.DIELECTRIC_F0[kind]
        assert low <= round(((n - 1.0) / (n + 1.0)) ** 2, 3) <= high


def test_script_makes_the_presets() -> None:
    """D65 alone has the chromaticity of Rec. 709's white there, and a mirror under it is white."""
    assert metal_ior() == presets.METAL_IOR
    table = np.array([line.split() for line in lines("cie_1931.txt")], dtype=np.float64)
    xyz = table[:, 4] @ table[:, 1:4]
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [0.3127, 0.3290], atol=0.00006)
    np.testing.assert_allclose(channel_response()[1].sum(axis=0), 1.0, rtol=1e-14)


@pytest.mark.parametrize("name", ["chromium", "palladium", *RTR4_METALS])
def test_spectra_give_printed_colors(name: str) -> None:
    """To the rounding and a step more, where the table was made from the same measurements."""
    expected = RTR4_METALS.get(name) or presets.METAL_F0[name]
    assert np.abs(colors(measured()[name][1])[0] - expected).max() < 0.0015


@pytest.mark.parametrize("name", presets.METAL_IOR)
def test_index_reflects_as_the_spectrum(name: str, report: Report) -> None:
    """At normal incidence to the rounding of η and k to four digits; at every angle to 0.01.

    Channels outside the gamut are left out.
    """
    _, table = measured()[name]
    np.testing.assert_allclose(preset_f0(name), np.clip(colors(table)[0], 0.0, MAX_F0), atol=1e-4)
    wavelengths, response = channel_response()
    n, k = (np.interp(wavelengths, table[:, 0], table[:, i]) for i in (1, 2))
    found = [complex_fresnel(c, *presets.metal_ior(name)) for c in COSINES]
    errors = np.array(found) - [complex_fresnel(c, n, k) @ response for c in COSINES]
    inside = complex_fresnel(1.0, n, k) @ response <= MAX_F0
    assert inside.sum() == (2 if name == "gold" else 3)
    report(f"F of {name} over angles, error", float(np.abs(errors[:, inside]).max()), "< 0.01")
    assert np.abs(errors[:, inside]).max() < 0.01


def test_tables_of_metals_differ_as_said() -> None:
    """The module says by how much; a metal it does not name is off by less than nickel."""
    limits = {"titanium": 0.1, "iron": 0.1, "silver": 0.065, "gold": 0.065}
    for name in presets.METAL_F0.keys() & presets.METAL_IOR.keys():
        assert np.abs(preset_f0(name) - presets.metal_f0(name)).max() < limits.get(name, 0.04), name


def test_names() -> None:
    assert presets.metal_ior("Au") == presets.metal_ior(" gold ") == presets.METAL_IOR["gold"]
    assert presets.metal_ior("aluminum") == presets.metal_ior("Al") == presets.METAL_IOR["aluminium"]
    assert presets.metal_f0("gold") == (1.0, 0.782, 0.344)
    assert presets.dielectric_ior("glass") == 1.51
    names = {*presets.METAL_F0, *presets.METAL_IOR, *presets.DIELECTRIC_IOR, *presets.SEMICONDUCTOR_F0}
    assert set(presets.ALIASES.values()) <= names
    assert names.isdisjoint(presets.ALIASES)


def test_every_constant_has_a_name_in_a_scene(tmp_path: Path) -> None:
    """The values as printed, of ranges the middle."""
    reflectances = {**presets.METAL_F0, **presets.SEMICONDUCTOR_F0}
    ranges = {name: (sum(ends) / 2.0,) * 3 for name, ends in presets.DIELECTRIC_F0.items()}
    indices = {name: sum(ends) / 2.0 for name, ends in presets.DIELECTRIC_IOR.items()}
    rows = [f'type = "conductor"\nf0 = "{name}"' for name in (*reflectances, *ranges)]
    rows += [f'type = "dielectric"\nior = "{name}"' for name in (*indices, *presets.DIELECTRIC_F0)]
    rows += [f'type = "conductor"\nmetal = "{name}"' for name in ("Si", *presets.METAL_IOR)]
    file = tmp_path / "scene.toml"
    file.write_text(
        "\n".join(f"[materials.m{i}]\n{row}" for i, row in enumerate(rows))
        + "".join(f'\n[[shapes]]\ntype = "sphere"\nmaterial = "m{i}"' for i in range(len(rows)))
    )
    found = iter([shape.material for shape in load_scene(file).shapes])
    for color in (*reflectances.values(), *ranges.values()):
        assert next(found).f0 == tuple(min(x, 1.0) for x in color)
    for index in indices.values():
        assert next(found).ior == index
    for name in presets.DIELECTRIC_F0:
        material = next(found)
        if name not in ("water", "glass"):  # which have an index of their own
            assert ((material.ior - 1.0) / (material.ior + 1.0)) ** 2 == pytest.approx(ranges[name][0])
    assert next(found).f0 == presets.SEMICONDUCTOR_F0["silicon"]
    for eta, k in presets.METAL_IOR.values():
        metal = next(found)
        assert (metal.eta, metal.k) == (eta, k)


def test_the_command_line_lists_every_name_with_its_source(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", "--presets"]) == 0
    tables = {"metal": presets.METAL_IOR, "f0": presets.METAL_F0}
    for paragraph, (key, table) in zip(capsys.readouterr().out.split("\n\n"), tables.items(), strict=False):
        head, source, *rows = paragraph.split("\n")
        assert head.startswith(f"{key} = NAME")
        assert source.startswith("(")
        rows = [row.strip() for row in rows if row.startswith("  ")]
        assert [re.split(r"  +", row)[0] for row in rows] == list(table)
        for row, values in zip(rows, table.values(), strict=True):
            numbers = {float(x) for x in re.findall(r"\d+\.?\d*", row)}
            assert numbers == {float(f"{x:.3f}") for x in np.ravel(values)}
    assert main(["materials", "glass", "--presets"]) == 2
