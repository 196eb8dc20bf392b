"""The docs show the gallery's pictures, all materials and cameras among them; plots draw what models are to do."""

from __future__ import annotations

import functools
import re

import gallery
import numpy as np
import pictures
import pictures.bodies
import pictures.materials
import pictures.tutorial
import plot_figures
import pytest
import viewer_pairs
from conftest import ROOT
from PIL import Image

from wrt.scene.camera import CAMERAS
from wrt.scene.materials import MATERIALS, presets
from wrt.scene.scene import INTEGRATORS
from wrt.upload.accel.instancing import lay_out
from wrt.upload.materials import describe_materials

PICTURES = {name: drawing for group in pictures.GROUPS.values() for name, drawing in group.items()}
OWN_SCRIPT = ("benchmark", "cloth")
"""Pictures of examples, whose scripts render them."""

SCREENSHOTS = ("view-dark", "view-light", "view-narrow", "view-notebook")
"""Pictures of the live view in a browser: `scripts/view_pictures.py`, and a notebook in JupyterLab."""


def test_docs_show_what_the_gallery_makes() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {name for page in pages for name in re.findall(r"pictures/([\w-]+)\.jpg", page.read_text(encoding="utf-8"))}
    files = [path.stem for path in (ROOT / "docs" / "pictures").glob("*.jpg")]
    assert sorted(shown) == sorted(files) == sorted([*PICTURES, *OWN_SCRIPT, *SCREENSHOTS])


@pytest.mark.slow
def test_scenes_of_pictures_are_built() -> None:
    moving = {"motion-toys": "deforming", "layers": "moving", "motion-forest": "still"}
    for name in PICTURES.keys() - {"materials"}:
        drawing = PICTURES[name]
        tiles = getattr(drawing, "tiles", dict)()
        scene = next((picture for picture, _ in tiles.values()), getattr(drawing, "picture", drawing)).make()
        assert lay_out(scene).kind == moving.get(name, "none"), name
        assert describe_materials([shape.material for shape in scene.shapes]).models, name


@pytest.mark.slow
def test_a_picture_renders_as_the_docs_show_it(tmp_path) -> None:
    """16 pixels wide, against the picture of the docs made as small; noise and JPEG leave a difference of 6 levels."""
    assert gallery.main(["light-spots", "--spp", "256", "--size", "16", "--out", str(tmp_path)]) == 0
    with Image.open(tmp_path / "light-spots.jpg") as picture:
        found = np.asarray(picture.convert("RGB"), np.float64)
        size = picture.size
    with Image.open(ROOT / "docs" / "pictures" / "light-spots.jpg") as picture:
        shown = np.asarray(picture.convert("RGB").resize(size, Image.Resampling.BOX), np.float64)
    assert np.abs(found - shown).mean() < 8.0
    assert np.corrcoef(found.ravel(), shown.ravel())[0, 1] > 0.97


def test_every_camera_integrator_material_and_preset_has_its_picture() -> None:
    cameras = [PICTURES[name].make() for name in PICTURES if name.startswith("camera-")]
    assert {type(scene.camera) for scene in cameras} == set(CAMERAS.values())
    given = [PICTURES[name].given["integrator"] for name in PICTURES if name.startswith("integrator-")]
    assert set(given) == set(INTEGRATORS) - {"aov", "volpath"}
    # What is measured needs a file, which the project does not have.
    built_in = {name for name, cls in MATERIALS.items() if cls.__module__.startswith("wrt.")} - {"measured"}
    tiles = pictures.materials.tiles()
    assert built_in == {tile.material.type_name for tile in tiles}
    assert len({(tile.material.type_name, tile.caption) for tile in tiles}) == len(tiles)
    names = {
        "metal": presets.METAL_IOR,
        "f0": presets.METAL_F0 | presets.SEMICONDUCTOR_F0,
        "ior": presets.DIELECTRIC_IOR,
    }
    swatches = {f"{key}-{name.replace(' ', '-')}" for key, table in names.items() for name in table}
    assert swatches <= set(PICTURES["presets"].tiles())
    kinds = [[shape.material.type_name for shape in pictures.tutorial.make_scene(step).shapes] for step in range(3)]
    assert kinds == [["diffuse", "diffuse"], ["plastic", "oren-nayar"], ["plastic", "oren-nayar"]]


@pytest.mark.slow
def test_tiles_show_their_own_material() -> None:
    for tile in pictures.materials.tiles():
        scene = pictures.materials.make_scene(tile)
        (shown,) = (s for s in scene.shapes if s.mesh.bounds[1, 1] > 0.5 and s.material is tile.material)
        assert shown.mesh.bounds[0, 1] == pytest.approx(0.0, abs=1e-5)
        assert shown.mesh.bounds[1, 1] > 1.0


@pytest.mark.slow
def test_ball_and_stone_are_closed_and_face_outwards() -> None:
    """Each edge is run through once either way. Crown and pavilion of the stone lie between cones within and around."""
    stone = (np.pi * 0.86 / 3.0, np.pi * (0.86 / 3.0 + 0.33))
    ball = 4.0 / 3.0 * np.pi
    for mesh, low, high in (
        (pictures.bodies.ball(), ball * 0.998, ball),
        (pictures.bodies.brilliant(1.0), *stone),
    ):
        _, where = np.unique(np.round(mesh.vertices, 5), axis=0, return_inverse=True)
        faces = where.reshape(-1)[mesh.faces]
        edges = {(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
        assert len(edges) == 3 * len(faces)
        assert {(b, a) for a, b in edges} == edges
        volume = np.linalg.det(mesh.vertices[mesh.faces].astype(np.float64)).sum() / 6.0
        assert low < volume < high


# --- Plots -----------------------------------------------------------------------------------------


@functools.cache
def figure_of(name: str) -> plot_figures.Figure:
    return plot_figures.FIGURES[name]()


COSTLY = "albedos"
"""A figure for which kernels are compiled, with all materials' energy in it, which tests of materials prove."""


@pytest.mark.machinery
@pytest.mark.parametrize(
    "names", [[name for name in plot_figures.FIGURES if name != COSTLY], [COSTLY]], ids=["most", COSTLY]
)
def test_curves_are_finite_and_told_apart(names: list[str]) -> None:
    shown = (ROOT / "docs" / "shading.md").read_text(encoding="utf-8")
    for name in names:
        assert f"pictures/plots/{name}.png" in shown
        assert (ROOT / "docs" / "pictures" / "plots" / f"{name}.png").is_file()
        figure = figure_of(name)
        most = 1.01 if figure.y_label.startswith(("reflectance", "share", "G")) else np.inf
        for panel in figure.panels:
            labels = [curve.label for curve in panel.curves if curve.label]
            assert len(set(labels)) == len(labels) > 0
            # Two curves of one panel that are the same would be a mistake in what is asked for.
            assert len({curve.y.tobytes() for curve in panel.curves}) == len(panel.curves), panel.title
            for curve in panel.curves:
                assert np.isfinite(curve.y).all(), (panel.title, curve.label)
                assert curve.y.shape == curve.x.shape
                assert curve.y.min() >= 0.0
                assert 0.0 < curve.y.max() < most


@pytest.mark.slow
def test_plotted_distributions_have_the_peaks_of_their_formulas() -> None:
    for panel in figure_of("distributions").panels[:3]:
        for curve in panel.curves:
            alpha = float(curve.label.removeprefix("α "))
            assert curve.y[0] == pytest.approx(1.0 / (np.pi * alpha**2), rel=1e-5), panel.title


@pytest.mark.machinery
def test_plotted_albedos_add_up() -> None:
    """All bounces lose nothing, and one bounce of white GGX of roughness 1 reflects 1 − ln 2 straight on.

    Its f is 1 / (2π (cosθi + cosθo)), by Smith's height-correlated masking.
    """
    panels = figure_of(COSTLY).panels
    for curve in (curve for panel in panels for curve in panel.curves):
        if curve.style == "--":
            np.testing.assert_allclose(curve.y, 1.0, atol=0.01)
        else:
            assert curve.y.min() < 0.95
    (rough,) = (curve for curve in panels[0].curves if curve.label == "α 1")
    assert rough.y[0] == pytest.approx(1.0 - np.log(2.0), abs=2e-3)


# --- Comparisons with other viewers ----------------------------------------------------------------


def test_colours_of_viewers_are_compared_in_cielab() -> None:
    """sRGB white, black, grey, red and blue in CIELAB under D65, as printed by every colour calculator."""
    codes = np.array([[255, 255, 255], [0, 0, 0], [119, 119, 119], [255, 0, 0], [0, 0, 255]], np.uint8)
    expected = [[100, 0, 0], [0, 0, 0], [50.03, 0, 0], [53.24, 80.09, 67.20], [32.30, 79.19, -107.86]]
    assert viewer_pairs.cielab(codes) == pytest.approx(np.array(expected), abs=0.1)


def test_orbits_of_viewers_are_cameras() -> None:
    for theta, phi, origin in ((0.0, 90.0, (1, 2, 7)), (90.0, 90.0, (5, 2, 3)), (-90.0, 30.0, (-1, 2 + 12**0.5, 3))):
        camera = viewer_pairs.Orbit(theta, phi, 4.0, (1.0, 2.0, 3.0), 45.0).camera(0.5)
        assert camera.origin == pytest.approx(0.5 * np.array(origin))
        assert camera.target == pytest.approx((0.5, 1.0, 1.5))
        assert camera.fov_degrees == 45.0
