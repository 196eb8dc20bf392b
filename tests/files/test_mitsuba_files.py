"""Scene files of Mitsuba look as Mitsuba renders them: the same XML, by both, compared by `image_z_test`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
from conftest import Report

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.covering_kernels import covering, render_with
from support.meshes import write
from support.mitsuba_files import compare, render_by_mitsuba, write_files
from support.mitsuba_scene import VARIANT
from support.statistics import ImageTest, sidak


class Case(NamedTuple):
    """What a scene is of, by the words of docs/mitsuba.md, and a text of its file that is changed to be seen."""

    covers: str
    change: tuple[str, str] | None = None
    spp: int = 512
    alone: bool = True
    """Filters that reach beyond a pixel tie neighbours in Mitsuba, so that sums over pixels cannot be judged."""
    variant: str = VARIANT


FLAT = '<boolean name="face_normals" value="true"/>'

CASES = {
    "transforms": Case(
        "scale, rotate, translate, matrix, lookat, default, include, alias, ref; cube, rectangle; diffuse, twosided",
        ('value="25"', 'value="28"'),
    ),
    "balls": Case("spheres: rough, glass, textured, turned, shining", ('value="2, 3, 4"', 'value="2, 3.4, 4"')),
    "curved": Case("sphere, cylinder, disk; conductor by eta and k, and none", ('value="0.4"/>', 'value="0.38"/>')),
    "tubes": Case(
        "cylinder, disk: textured, brushed, an ellipse, flip_normals, shining with an image",
        ('"0.1"/><float name="alpha_v" value="0.5"', '"0.5"/><float name="alpha_v" value="0.1"'),
        1024,
    ),
    "lens": Case("thinlens: fov_axis, aperture_radius, focus_distance", ('"3"/>', '"3.2"/>'), 1024),
    "orthographic": Case("orthographic; a shape without bsdf", ('x="1.1" y="1.1"', 'x="1.13" y="1.13"')),
    "shifted": Case("perspective: fov_axis diagonal, principal_point_offset, crop", ('value="0.1"', 'value="0.09"')),
    "filter-tent": Case("focal_length, tent", ('"tent"', '"box"'), 1024, alone=False),
    "filter-gaussian": Case("gaussian", ('"gaussian"', '"box"'), 1024, alone=False),
    "lights": Case("point, spot, directional", ('"24"', '"26"')),
    "constant": Case("constant", ('"0.5, 0.6, 0.7"', '"0.52, 0.6, 0.7"')),
    "envmap": Case("envmap: scale, to_world", ('angle="37"', 'angle="35"')),
    "sunsky": Case(
        "sunsky: sun_direction, turbidity, albedo, sun_aperture, sun_scale, sky_scale, to_world",
        ('"turbidity" value="4.3"', '"turbidity" value="4.6"'),
    ),
    "afternoon": Case("sunsky: date and place, z upwards", ('"minute" value="30"', '"minute" value="38"')),
    "glowing": Case("area on sphere, disk, cube; flip_normals; null", ('"0.5, 1, 3"', '"0.53, 1, 3"')),
    "metals": Case(
        "roughconductor: distribution, alpha, alpha_u, alpha_v, sample_visible, specular_reflectance; conductor: "
        "specular_reflectance",
        ('"alpha" value="0.3"', '"alpha" value="0.36"'),
    ),
    "measured": Case("measured, twosided", ('"brushed_rgb.bsdf"', '"metal_rgb.bsdf"')),
    "named": Case("conductors by name; merge", ('value="Au"', 'value="Cu"')),
    "spectra": Case(
        "uniform, d65, wavelength:value pairs, a file of them",
        ("480:0.2, 560:0.3", "480:0.2, 560:0.36"),
    ),
    "blackbody": Case(
        "blackbody, regular, irregular; area on cylinder",
        ('"temperature" value="2000"', '"temperature" value="2020"'),
        variant="scalar_spectral",
    ),
    "clouds": Case(
        "heterogeneous: sigma_t, albedo; gridvolume: filename, to_world, use_grid_bbox; constvolume",
        ('"scale" value="6"', '"scale" value="6.6"'),
        1024,
    ),
    "milk": Case(
        "interior of roughdielectric, isotropic; dielectric: specular_reflectance, specular_transmittance; plastic: "
        "specular_reflectance; ldsampler",
        ('"0.95, 0.9, 0.8"', '"0.9, 0.9, 0.8"'),
        1024,
    ),
    "glass": Case("dielectric, roughdielectric; indices by name", ('"diamond"', '"bk7"')),
    "pane": Case("thindielectric: specular_transmittance", ('"0.9, 0.7, 0.8"', '"0.9, 0.75, 0.8"')),
    "plastics": Case("plastic: nonlinear, int_ior; roughplastic", ('"true"', '"false"')),
    "coats": Case(
        "roughplastic: diffuse_reflectance, specular_reflectance, nonlinear, alpha, distribution, int_ior",
        ('"nonlinear" value="true"', '"nonlinear" value="false"'),
    ),
    "principled": Case("principled: base_color, metallic, roughness", ('"0.4"', '"0.5"')),
    "mixtures": Case("blendbsdf, mask, bitmap where a number is wanted", ('"0.3"', '"0.35"')),
    "textures": Case(
        "bitmap: raw, wrap_mode, filter_type, to_uv; checkerboard; area: texture", ('x="5" y="3"', 'x="5" y="3.3"')
    ),
    "meshes": Case(
        "obj, ply: face_normals, flip_tex_coords, flip_normals, mirrored; mesh_attribute",
        ('"flip_tex_coords" value="true"', '"flip_tex_coords" value="false"'),
    ),
    "smooth": Case("obj without normals", ('"ball.obj"/>', '"ball.obj"/>' + FLAT)),
    "instances": Case("shapegroup, instance", ('x="1" y="1.6"', 'x="1" y="1.7"')),
    "normals": Case("normalmap", ('"flip_tex_coords" value="true"', '"flip_tex_coords" value="false"')),
    "bumps": Case("bumpmap: scale", ('"0.15"', '"0.13"')),
    "sides": Case("twosided of two; one side of diffuse", ('"0.8, 0.2, 0.1"', '"0.1, 0.4, 0.8"')),
    "direct": Case("direct; fov_axis smaller", ('"direct"', '"path"')),
    "media": Case("volpath, homogeneous, hg, null around a medium", ('"g" value="0.5"', '"g" value="0.2"'), 1024),
    "fog": Case("the medium of a sensor, exterior", ('"0.15, 0.2, 0.25"', '"0.2, 0.2, 0.25"'), 1024),
    "nested": Case(
        "an exterior that is the interior of another shape, by ref and written out; media within media",
        ('"0.9, 0.8, 0.6"', '"0.7, 0.8, 0.6"'),
        1024,
    ),
    "within": Case(
        "a sensor in a body, which is of the sensor's medium", ('"0.12, 0.2, 0.3"', '"0.2, 0.2, 0.3"'), 1024
    ),
    "old": Case("names in camel case", ('name="intIOR" value="1.5"', 'name="intIOR" value="1.4"')),
}
SIGNIFICANCE = sidak(0.01, len(CASES))
ROUGH_METALS = (
    "rough_conductor:beckmann:walter:conductor",
    "rough_conductor:ggx:smith-separable:conductor",
    "rough_conductor:ggx:smith:conductor",
)
COATS = "plastic", "rough_plastic:beckmann:walter", "rough_plastic:ggx:smith-separable"
KERNELS = (
    covering("diffuse"),
    covering(
        *("burley", "conductor", "dielectric", "diffuse", "measured", "mirror", "thin_dielectric"),
        *("rough_dielectric:ggx:smith-separable", *ROUGH_METALS, *COATS),
    ),
    covering("conductor", "dielectric", "diffuse", "mirror", ROUGH_METALS[0], exact="spheres"),
    covering("conductor", "diffuse", "mirror", "rough_conductor:beckmann:walter:schlick", exact="quadrics"),
    covering("dielectric", "diffuse", "null", "plastic", "rough_dielectric:beckmann:walter", media="scattering"),
)
"""They render most of the scenes, whose own kernels would be thirty."""


@pytest.fixture(autouse=True)
def few_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with(KERNELS, monkeypatch)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = tmp_path_factory.mktemp("scenes")
    write_files(result)
    return result


def agrees(case: Case, result: ImageTest) -> bool:
    if case.alone:
        return result.agrees(significance=SIGNIFICANCE)
    return result.pass_fraction >= 0.995 and result.p_min > SIGNIFICANCE


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_file_looks_as_in_mitsuba_and_a_changed_one_does_not(name: str, folder: Path, report: Report) -> None:
    case, path = CASES[name], folder / f"{name}.xml"
    expected = render_by_mitsuba(path, spp=case.spp, variant=case.variant)
    result = compare(path, expected, spp=case.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert agrees(case, result), result.message
    if case.change:
        text = path.read_text()
        assert case.change[0] in text
        changed = write(folder, f"{name}-changed.xml", text.replace(*case.change))
        result = compare(changed, expected, spp=case.spp)
        report(" for ".join(reversed(case.change)), result.message)
        assert not agrees(case, result), result.message
