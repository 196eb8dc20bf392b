"""Tone curves agree with their published references within 1/255, and pictures keep what they should."""

import math

import numpy as np
import pytest

import wrt
from wrt.develop.tones import CURVES, agx_contrast
from wrt.scene.developing import TONES
from wrt.scene.srgb import srgb_from_linear

CODE = 1.0 / 255.0

COLORS = 2.0 ** np.random.default_rng(3).uniform(-9.0, 5.0, (400, 3))
"""Radiance from black to far beyond white, saturated colours among them."""
COLORS[:40] = COLORS[:40, :1]
COLORS[40:60, 1:] = 0.0


def greys(low, high, n):
    return np.repeat(2.0 ** np.linspace(low, high, n)[:, None], 3, axis=1)


def khronos(color):
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


def hill(color):
    """The constants of BakingLab's ACES.hlsl."""
    into = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
    out = [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
    x = np.array(into) @ color
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    return np.clip(np.array(out) @ x, 0.0, 1.0)


def columns(*values):
    """A matrix as shading languages write it, column by column."""
    return np.array(values).reshape(3, 3).T


TO_2020 = columns(0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0113, 0.8956)
TO_709 = columns(1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187)
INSET = columns(
    *(0.856627153315983, 0.137318972929847, 0.11189821299995),
    *(0.0951212405381588, 0.761241990602591, 0.0767994186031903),
    *(0.0482516061458583, 0.101439036467562, 0.811302368396859),
)
OUTSET = np.linalg.inv(
    columns(
        *(0.899796955911611, 0.11142098895748, 0.11142098895748),
        *(0.0871996192028351, 0.875575586156966, 0.0871996192028349),
        *(0.013003424885555, 0.0130034248855548, 0.801379391839686),
    )
)


def filament(color):
    """AgX with the matrices of Filament, and the colour space around it as in three.js."""
    v = INSET @ (TO_2020 @ color)
    x = np.clip((np.log2(np.maximum(v, 1e-10)) + 12.47393) / (4.026069 + 12.47393), 0.0, 1.0)
    return np.clip(TO_709 @ np.maximum(OUTSET @ agx_contrast(x), 0.0) ** 2.2, 0.0, 1.0)


@pytest.mark.parametrize(
    ("name", "reference", "tolerance"),
    [("neutral", khronos, 1e-9), ("aces", hill, 1e-9), ("agx", filament, 0.01 * CODE)],
)
def test_curves_agree_with_their_references(name, reference, tolerance):
    expected = srgb_from_linear(np.array([reference(color) for color in COLORS]))
    np.testing.assert_allclose(srgb_from_linear(CURVES[name](COLORS, 1e3)), expected, atol=tolerance)


def test_agx_contrast_agrees_with_the_published_table():
    """Every 273rd of the 4096 values of AgX_Default_Contrast.spi1d (Sobotka, AgX, 2022)."""
    table = [0.0, 0.0048020, 0.0123199, 0.0245690, 0.0452821, 0.0810636, 0.1416173, 0.2347588]
    table += [0.3556387, 0.4878788, 0.6209258, 0.7481632, 0.8546235, 0.9289546, 0.9741125, 1.0]
    np.testing.assert_allclose(agx_contrast(np.arange(0, 4096, 273) / 4095.0), table, atol=1e-7)


def test_ocio_views_agree_with_known_values(tmp_path):
    """The un-tone-mapped view of the built-in configuration is the sRGB curve, so our own curve is its reference."""
    image = COLORS[None].clip(0.0, 1.0).astype(np.float32)
    view = wrt.develop_image(image, tone="ocio:ocio://default,sRGB - Display,Un-tone-mapped", exposure=0.0)
    plain = wrt.develop_image(image, tone="none", exposure=0.0)
    assert np.abs(view.astype(int) - plain.astype(int)).max() <= 1
    # Middle grey and white in ACES 2.0, as OpenColorIO 2.4 gives them for its configurations.
    grey = np.repeat(np.array([0.18, 1.0], np.float32), 3).reshape(1, 2, 3)
    aces = wrt.develop_image(grey, tone="ocio", exposure=0.0)[0, :, 0]
    np.testing.assert_allclose(aces / 255.0, [0.34919, 0.70668], atol=1.01 * CODE)
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


@pytest.mark.parametrize("name", TONES)
def test_a_curve_stays_on_the_display_and_ascends(name):
    for values in (COLORS, COLORS * 1e30, np.zeros((1, 3))):
        out = CURVES[name](values, 1e3)
        assert -1e-12 <= out.min() <= out.max() <= 1.0 + 1e-12
    assert (np.diff(CURVES[name](greys(-9.0, 5.0, 400), 1e3)[:, 0]) >= -1e-12).all()


def test_displayable_colors_are_exact_by_default():
    image = np.random.default_rng(1).random((32, 32, 3)).astype(np.float32)
    np.testing.assert_array_equal(wrt.develop_image(image), wrt.develop_image(image, tone="none", exposure=0.0))
    assert (wrt.develop_image(np.full((8, 8, 3), 1.0)) == 255).all()
    image[:4] *= 40.0  # a lamp
    codes, plain = wrt.develop_image(image), wrt.develop_image(image, tone="none", exposure=0.0)
    exact = image.max(axis=2) <= 0.8
    assert exact.mean() > 0.3
    np.testing.assert_array_equal(codes[exact], plain[exact])


@pytest.mark.parametrize("tone", [*TONES, "ocio"])
def test_infinite_and_nan_pixels_become_finite_codes(tone):
    codes = wrt.develop_image([[[math.nan, -1.0, 0.5], [math.inf, 1e38, 0.0]]], tone=tone, exposure=0.0)
    assert codes[0, 0, 0] <= codes[0, 0, 2]
    assert codes[0, 1, 0] > 200


def test_a_view_that_is_not_there_is_refused():
    with pytest.raises(wrt.InputError, match=r"view of 'sRGB - Display' must be one of"):
        wrt.develop_image(np.ones((2, 2, 3)), tone="ocio:,sRGB - Display,nothing")
