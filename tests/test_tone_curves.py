"""Tone curves agree with their published references within 1/255, and pictures keep what they should."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import wrt
from wrt.develop.curves.agx import sigmoid
from wrt.develop.tones import CURVES
from wrt.developing import TONES
from wrt.scene.srgb import srgb_from_linear

CODE = 1.0 / 255.0

COLORS = 2.0 ** np.random.default_rng(3).uniform(-9.0, 5.0, (400, 3))
"""Radiance from black to far beyond white, saturated colours among them."""
COLORS[:40] = COLORS[:40, :1]
COLORS[40:60, 1:] = 0.0


def shown(name: str, colors: np.ndarray) -> np.ndarray:
    return srgb_from_linear(CURVES[name].apply(colors, 1e3))


def columns(*values: float) -> np.ndarray:
    """A matrix as shading languages write it, column by column."""
    return np.array(values).reshape(3, 3).T


def khronos(color: np.ndarray) -> list[float]:
    """The reference of Khronos, scalar by scalar (ToneMapping, PBR_Neutral/README.md, 2024)."""
    start = 0.8 - 0.04
    x = min(color)
    offset = x - 6.25 * x * x if x < 0.08 else 0.04
    rgb = [c - offset for c in color]
    p = max(rgb)
    if p < start:
        return rgb
    d = 1.0 - start
    new = 1.0 - d * d / (p + d - start)
    g = 1.0 - 1.0 / (0.15 * (p - new) + 1.0)
    return [(c * new / p) * (1.0 - g) + new * g for c in rgb]


def hill(color: np.ndarray) -> list[float]:
    """The constants of BakingLab's ACES.hlsl, scalar by scalar."""
    into = ((0.59719, 0.35458, 0.04823), (0.07600, 0.90834, 0.01566), (0.02840, 0.13383, 0.83777))
    out = ((1.60475, -0.53108, -0.07367), (-0.10208, 1.10813, -0.00605), (-0.00327, -0.07276, 1.07602))
    v = [sum(m * c for m, c in zip(row, color, strict=True)) for row in into]
    v = [(x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081) for x in v]
    return [min(max(sum(m * x for m, x in zip(row, v, strict=True)), 0.0), 1.0) for row in out]


def polynomial(x: np.ndarray) -> np.ndarray:
    return 15.5 * x**6 - 40.14 * x**5 + 31.96 * x**4 - 6.868 * x**3 + 0.4298 * x**2 + 0.1191 * x - 0.00232


def filament(color: np.ndarray, contrast: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """AgX with the matrices of Filament, column by column, and the colour space around it as in three.js."""
    to_2020 = columns(0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0113, 0.8956)
    to_709 = columns(1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187)
    inset = columns(
        *(0.856627153315983, 0.137318972929847, 0.11189821299995),
        *(0.0951212405381588, 0.761241990602591, 0.0767994186031903),
        *(0.0482516061458583, 0.101439036467562, 0.811302368396859),
    )
    outset = np.linalg.inv(
        columns(
            *(0.899796955911611, 0.11142098895748, 0.11142098895748),
            *(0.0871996192028351, 0.875575586156966, 0.0871996192028349),
            *(0.013003424885555, 0.0130034248855548, 0.801379391839686),
        )
    )
    v = inset @ (to_2020 @ color)
    x = np.clip((np.log2(np.maximum(v, 1e-10)) + 12.47393) / (4.026069 + 12.47393), 0.0, 1.0)
    return np.clip(to_709 @ np.maximum(outset @ contrast(x), 0.0) ** 2.2, 0.0, 1.0)


@pytest.mark.parametrize(("name", "reference"), [("neutral", khronos), ("aces", hill)])
def test_a_curve_is_its_reference(name, reference):
    expected = srgb_from_linear(np.array([reference(color) for color in COLORS]))
    np.testing.assert_allclose(shown(name, COLORS), expected, atol=1e-9)


TABLE = (
    0.0,
    0.0048020,
    0.0123199,
    0.0245690,
    0.0452821,
    0.0810636,
    0.1416173,
    0.2347588,
    0.3556387,
    0.4878788,
    0.6209258,
    0.7481632,
    0.8546235,
    0.9289546,
    0.9741125,
    1.0000000,
)
"""Every 273rd of the 4096 values of AgX_Default_Contrast.spi1d (Sobotka, AgX, 2022)."""


def test_the_contrast_of_agx_is_the_published_table():
    np.testing.assert_allclose(sigmoid(np.arange(0, 4096, 273) / 4095.0), TABLE, atol=1e-7)


def test_agx_is_that_of_filament():
    expected = srgb_from_linear(np.array([filament(color, sigmoid) for color in COLORS]))
    np.testing.assert_allclose(shown("agx", COLORS), expected, atol=0.01 * CODE)


def test_the_polynomial_of_filament_is_near_enough_to_show_no_mistake():
    # It misses the published table by up to 1.47 / 255, and the matrix behind it amplifies that in saturated colours.
    grey = np.repeat(2.0 ** np.linspace(-9.0, 4.0, 60)[:, None], 3, axis=1)
    for colors, mean, most in ((COLORS, 1.0, 8.0), (grey, 1.0, 2.0)):
        expected = srgb_from_linear(np.array([filament(color, polynomial) for color in colors]))
        error = np.abs(shown("agx", colors) - expected)
        assert error.mean() < mean * CODE
        assert error.max() < most * CODE


def test_aces_is_close_to_the_transform_that_it_fits():
    """OpenColorIO has the output transform of ACES 1.x itself; Hill's fit is within 4 % for greys."""
    grey = np.repeat(2.0 ** np.linspace(-4.0, 3.0, 30)[:, None], 3, axis=1).reshape(1, 30, 3).astype(np.float32)
    config = "ocio:ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3,sRGB - Display,ACES 1.0 - SDR Video"
    ocio = wrt.develop_image(grey, tone=config, exposure=0.0).astype(float)
    ours = wrt.develop_image(grey, tone="aces", exposure=0.0).astype(float)
    assert np.abs(ours - ocio).max() < 0.04 * 255.0


def test_ocio_is_what_its_processor_gives():
    """The un-tone-mapped view of the built-in configuration is the sRGB curve, so our own curve is its reference."""
    image = COLORS[None].clip(0.0, 1.0).astype(np.float32)
    view = wrt.develop_image(image, tone="ocio:ocio://default,sRGB - Display,Un-tone-mapped", exposure=0.0)
    plain = wrt.develop_image(image, tone="none", exposure=0.0)
    assert np.abs(view.astype(int) - plain.astype(int)).max() <= 1
    # Middle grey and white in ACES 2.0, as OpenColorIO 2.4 gives them for its configurations.
    grey = np.repeat(np.array([0.18, 1.0], np.float32), 3).reshape(1, 2, 3)
    aces = wrt.develop_image(grey, tone="ocio", exposure=0.0)[0, :, 0]
    np.testing.assert_allclose(aces / 255.0, [0.34919, 0.70668], atol=1.01 * CODE)


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_stays_on_the_display_and_ascends(name):
    for values in (COLORS, COLORS * 1e30, np.zeros((1, 3))):
        out = CURVES[name].apply(values, 1e3)
        assert np.isfinite(out).all()
        assert (out >= -1e-12).all()
        assert (out <= 1.0 + 1e-12).all()
    grey = np.repeat(2.0 ** np.linspace(-9.0, 5.0, 400)[:, None], 3, axis=1)
    assert (np.diff(CURVES[name].apply(grey, 1e3)[:, 0]) >= -1e-12).all()


def test_every_name_has_a_curve():
    assert tuple(CURVES) == TONES


def test_by_default_what_fits_the_display_is_exact():
    image = np.random.default_rng(1).random((32, 32, 3)).astype(np.float32)
    np.testing.assert_array_equal(wrt.develop_image(image), wrt.develop_image(image, tone="none", exposure=0.0))
    white = np.full((8, 8, 3), 1.0)
    assert (wrt.develop_image(white) == 255).all()
    image[:4] *= 40.0  # a lamp
    codes, plain = wrt.develop_image(image), wrt.develop_image(image, tone="none", exposure=0.0)
    exact = image.max(axis=2) <= 0.8
    assert exact.mean() > 0.3
    np.testing.assert_array_equal(codes[exact], plain[exact])


def test_the_default_changes_continuously_as_a_picture_exceeds_white():
    rng = np.random.default_rng(2)
    image = rng.random((32, 32, 3))
    previous = None
    for stops in np.arange(-0.2, 1.6, 0.02):
        codes = wrt.develop_image(image * 2.0**stops, exposure=0.0).astype(int)
        if previous is not None:
            assert np.abs(codes - previous).max() <= 6
        previous = codes


@pytest.mark.parametrize(
    ("tone", "message"),
    [
        ("agxx", "did you mean 'agx'"),
        (7, "tone must be one of"),
        ("ocio:nothing.ocio", "nothing.ocio: no such OpenColorIO configuration"),
        ("ocio:ocio://nothing", "cannot be read as an OpenColorIO configuration"),
        ("ocio:,nothing", "display must be one of sRGB"),
        ("ocio:,sRGB - Display,nothing", "view of 'sRGB - Display' must be one of"),
        ("ocio:a,b,c,d", "more than a configuration"),
    ],
)
def test_an_unusable_tone_is_refused(tone, message):
    with pytest.raises(wrt.InputError, match=message):
        wrt.develop_image(np.ones((2, 2, 3)), tone=tone)


def test_a_configuration_file_is_used(tmp_path):
    config = tmp_path / "half.ocio"
    config.write_text(
        "ocio_profile_version: 2\nroles: {default: Linear Rec.709, scene_linear: Linear Rec.709}\n"
        "displays:\n  screen:\n    - !<View> {name: half, colorspace: half}\n"
        "colorspaces:\n  - !<ColorSpace> {name: Linear Rec.709}\n"
        "  - !<ColorSpace>\n    name: half\n    from_scene_reference: !<MatrixTransform>\n"
        "      matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]\n"
    )
    codes = wrt.develop_image(np.full((4, 4, 3), 100.0 / 255.0), tone=f"ocio:{config},screen,half", exposure=1.0)
    assert np.abs(codes.astype(int) - 100).max() <= 1


def test_nothing_infinite_survives():
    odd = np.array([[[math.nan, -1.0, 0.5], [math.inf, 1e38, 0.0]]])
    for tone in (*CURVES, "ocio"):
        codes = wrt.develop_image(odd, tone=tone, exposure=0.0)
        assert codes[0, 0, 0] <= codes[0, 0, 2]
        assert codes[0, 1, 0] > 200
