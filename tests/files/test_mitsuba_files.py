"""Scene files of Mitsuba look as Mitsuba renders them: the same XML, by both, compared by `image_z_test`."""

from typing import NamedTuple

import pytest

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.covering_kernels import covering, render_with
from support.meshes import write
from support.mitsuba_files import compare, render_by_mitsuba, write_files
from support.mitsuba_scene import VARIANT
from support.statistics import ImageTest, sidak


class Case(NamedTuple):
    """A text of a scene file that is changed, so that the picture differs; and how the file is rendered."""

    change: tuple[str, str]
    spp: int = 512
    judges_sums: bool = True
    """Filters that reach beyond a pixel tie neighbours in Mitsuba, so that sums over pixels cannot be judged."""
    variant: str = VARIANT


BRUSHED = '"0.1"/><float name="alpha_v" value="0.5"', '"0.5"/><float name="alpha_v" value="0.1"'
NONLINEAR = '"nonlinear" value="true"/><float name="alpha"', '"nonlinear" value="false"/><float name="alpha"'
FLIP_UVS = '"flip_tex_coords" value="true"', '"flip_tex_coords" value="false"'
CASES = {
    "transforms": Case(('value="25"', 'value="28"')),
    "balls": Case(('value="2, 3, 4"', 'value="2, 3.4, 4"')),
    "tubes": Case(BRUSHED, 1024),
    "lens": Case(('"3"/>', '"3.2"/>'), 1024),
    "orthographic": Case(('x="1.1" y="1.1"', 'x="1.13" y="1.13"')),
    "shifted": Case(('value="0.1"', 'value="0.09"')),
    "filter-tent": Case(('"tent"', '"box"'), 1024, judges_sums=False),
    "filter-gaussian": Case(('"gaussian"', '"box"'), 1024, judges_sums=False),
    "lights": Case(('"24"', '"26"')),
    "envmap": Case(('angle="37"', 'angle="35"')),
    "sunsky": Case(('"turbidity" value="4.3"', '"turbidity" value="4.6"')),
    "afternoon": Case(('"minute" value="30"', '"minute" value="38"')),
    "glowing": Case(('"0.5, 1, 3"', '"0.53, 1, 3"')),
    "metals": Case(('"alpha" value="0.3"', '"alpha" value="0.4"')),
    "measured": Case(('"brushed_rgb.bsdf"', '"metal_rgb.bsdf"')),
    "named": Case(('value="Au"', 'value="Cu"')),
    "spectra": Case(("480:0.2, 560:0.3", "480:0.2, 560:0.36")),
    "blackbody": Case(('"temperature" value="2000"', '"temperature" value="2020"'), variant="scalar_spectral"),
    "clouds": Case(('"scale" value="6"', '"scale" value="6.6"'), 1024),
    "milk": Case(('"0.95, 0.9, 0.8"', '"0.9, 0.9, 0.8"'), 1024),
    "glass": Case(('"diamond"', '"bk7"')),
    "coats": Case(NONLINEAR),
    "principled": Case(('"0.4"', '"0.5"')),
    "mixtures": Case(('"0.3"', '"0.35"')),
    "textures": Case(('x="5" y="3"', 'x="5" y="3.3"')),
    "meshes": Case(FLIP_UVS),
    "smooth": Case(('"ball.obj"/>', '"ball.obj"/><boolean name="face_normals" value="true"/>'), 768),
    "instances": Case(('x="1" y="1.6"', 'x="1" y="1.7"')),
    "normals": Case(FLIP_UVS),
    "bumps": Case(('"0.15"', '"0.13"')),
    "sides": Case(('"0.8, 0.2, 0.1"', '"0.1, 0.4, 0.8"')),
    "media": Case(('"g" value="0.5"', '"g" value="0.2"'), 1024),
    "fog": Case(('"0.15, 0.2, 0.25"', '"0.2, 0.2, 0.25"'), 1024),
    "nested": Case(('"0.9, 0.8, 0.6"', '"0.7, 0.8, 0.6"'), 1024),
}
"""Scenes of tests/scenes/mitsuba, described by their first lines."""

SIGNIFICANCE = sidak(0.01, len(CASES))
ROUGH_METALS = (
    "rough_conductor:beckmann:walter:conductor",
    "rough_conductor:ggx:smith-separable:conductor",
    "rough_conductor:ggx:smith:conductor",
)
COATS = "plastic", "rough_plastic:beckmann:walter", "rough_plastic:ggx:smith-separable"
KERNELS = (
    covering("diffuse", composite="holes"),
    covering(
        *("burley", "conductor", "dielectric", "diffuse", "measured", "mirror", "thin_dielectric"),
        *("rough_dielectric:ggx:smith-separable", *ROUGH_METALS, *COATS),
    ),
    covering(
        *("conductor", "dielectric", "diffuse", "mirror", ROUGH_METALS[0]),
        "rough_conductor:beckmann:walter:schlick",
        exact="quadrics",
    ),
    covering("dielectric", "diffuse", "null", "plastic", "rough_dielectric:beckmann:walter", media="scattering"),
)
"""They render most of the scenes, whose own kernels would be thirty."""


@pytest.fixture(autouse=True)
def few_kernels(monkeypatch):
    render_with(KERNELS, monkeypatch)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    result = tmp_path_factory.mktemp("scenes")
    write_files(result)
    return result


def agrees(case: Case, result: ImageTest) -> bool:
    if case.judges_sums:
        return result.agrees(significance=SIGNIFICANCE)
    return result.pass_fraction >= 0.995 and result.p_min > SIGNIFICANCE


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_pictures_agree_with_mitsuba_and_notice_a_change(name, folder, report):
    case, path = CASES[name], folder / f"{name}.xml"
    expected = render_by_mitsuba(path, spp=case.spp, variant=case.variant)
    result = compare(path, expected, spp=case.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert agrees(case, result), result.message
    text = path.read_text()
    assert case.change[0] in text
    changed = write(folder, f"{name}-changed.xml", text.replace(*case.change))
    result = compare(changed, expected, spp=case.spp // 2)  # fewer samples notice less, and this is enough
    report(" for ".join(reversed(case.change)), result.message)
    assert not agrees(case, result), result.message
