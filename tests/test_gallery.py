"""The docs show the gallery's pictures, all materials and cameras among them; plots draw what models are to do."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

import wrt
from wrt.scene.camera import CAMERAS
from wrt.scene.materials import MATERIALS, presets
from wrt.scene.scene import INTEGRATORS
from wrt.upload.accel.instancing import lay_out
from wrt.upload.materials import describe_materials


@pytest.fixture(scope="module")
def materials() -> ModuleType:
    return script("pictures.materials")


@pytest.fixture(scope="module")
def bodies() -> ModuleType:
    return script("pictures.bodies")


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    return script("plot_figures")


def script(name: str) -> ModuleType:
    """Return a module of scripts/, where it finds its neighbours."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        return importlib.import_module(name)


def with_parts(material: wrt.Material) -> Iterator[wrt.Material]:
    yield material
    for part in material.parts:
        yield from with_parts(part)


# --- All pictures ----------------------------------------------------------------------------------

PICTURES = {name: drawing for group in script("pictures").GROUPS.values() for name, drawing in group.items()}
OWN_SCRIPT = ("benchmark", "cloth")
"""Pictures of examples, whose scripts render them."""

SCREENSHOTS = ("view-dark", "view-light", "view-narrow", "view-notebook")
"""Pictures of the live view in a browser: `scripts/view_pictures.py`, and a notebook in JupyterLab."""

SHEETS = ("tutorial-noise", "layers")
"""A sheet of pictures and one of layers; tests/test_digests.py renders the scenes of all pictures."""


def shown_in(page: Path) -> list[str]:
    """Return the names of the JPEG pictures of a page, in their order."""
    return re.findall(r"pictures/([\w-]+)\.jpg", page.read_text(encoding="utf-8"))


def test_docs_show_what_the_gallery_makes() -> None:
    shown = {name for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")] for name in shown_in(page)}
    files = [path.stem for path in (ROOT / "docs" / "pictures").glob("*.jpg")]
    assert sorted(shown) == sorted(files) == sorted([*PICTURES, *OWN_SCRIPT, *SCREENSHOTS])
    assert all((ROOT / "scripts" / f"{name}.py").is_file() for name in OWN_SCRIPT)


def test_a_name_is_a_group_a_picture_or_a_tile() -> None:
    gallery = script("gallery")
    assert list(gallery.drawings("all")) == list(PICTURES)
    assert set(gallery.drawings("cameras")) == {name for name in PICTURES if name.startswith("camera-")}
    assert gallery.drawings("light-spots") == {"light-spots": PICTURES["light-spots"]}
    assert (
        gallery.drawings("materials/gold")["materials-gold"].width
        == gallery.drawings("materials/mix")["materials-mix"].width
    )
    for name in ("light", "materials/lead", "layers/depth"):
        with pytest.raises(wrt.InputError, match=f"{name}: no such group or picture"):
            gallery.drawings(name)


def test_gallery_lists_its_pictures(capsys: pytest.CaptureFixture[str]) -> None:
    assert script("gallery").main([]) == 0
    listed = re.findall(r"^  ([\w-]+): .* spp$", capsys.readouterr().out, re.MULTILINE)
    assert listed == list(PICTURES)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in ("city", "motion-forest") else name
        for name in PICTURES
        if name != "materials"
    ],
)
def test_scenes_of_pictures_are_built(name: str) -> None:
    drawing = PICTURES[name]
    tiles = getattr(drawing, "tiles", dict)()
    picture = next((picture for picture, _ in tiles.values()), getattr(drawing, "picture", drawing))
    scene = picture.make()
    assert lay_out(scene).kind == {"motion-toys": "deforming", "layers": "moving", "motion-forest": "still"}.get(
        name, "none"
    )
    assert describe_materials([shape.material for shape in scene.shapes]).models


@pytest.mark.slow
def test_a_picture_renders_as_the_docs_show_it(tmp_path: Path) -> None:
    """16 pixels wide, against the picture of the docs made as small; noise and JPEG leave a difference of 6 levels."""
    assert script("gallery").main(["light-spots", "--spp", "256", "--size", "16", "--out", str(tmp_path)]) == 0
    with Image.open(tmp_path / "light-spots.jpg") as picture:
        found = np.asarray(picture.convert("RGB"), np.float64)
        size = picture.size
    with Image.open(ROOT / "docs" / "pictures" / "light-spots.jpg") as picture:
        shown = np.asarray(picture.convert("RGB").resize(size, Image.Resampling.BOX), np.float64)
    assert np.abs(found - shown).mean() < 8.0
    assert np.corrcoef(found.ravel(), shown.ravel())[0, 1] > 0.97


@pytest.mark.slow
@pytest.mark.parametrize("name", SHEETS)
def test_sheets_render(name: str, tmp_path: Path) -> None:
    """A sample per pixel, tiles of 16 pixels: as many levels as a picture has, where a sheet of flat tiles has few."""
    assert script("gallery").main([name, "--spp", "1", "--size", "16", "--out", str(tmp_path)]) == 0
    with Image.open(tmp_path / f"{name}.jpg") as picture:
        assert np.asarray(picture).std() > 30.0


def test_every_camera_has_its_picture() -> None:
    scenes = [PICTURES[name].make() for name in PICTURES if name.startswith("camera-")]
    assert {type(scene.camera) for scene in scenes} == set(CAMERAS.values())
    assert len({describe_materials([shape.material for shape in scene.shapes]).models for scene in scenes}) == 1


def test_layers_move_and_integrators_do_not() -> None:
    given = {name: PICTURES[name].given for name in PICTURES if name.startswith("integrator-")}
    assert {options["integrator"] for options in given.values()} == set(INTEGRATORS) - {"aov", "volpath"}
    assert not any(shape.transform for name in given for shape in PICTURES[name].make().shapes)
    assert any(shape.transform for shape in PICTURES["layers"].picture.make().shapes)


def test_the_tutorial_shows_its_own_scene_files() -> None:
    tutorial = script("pictures.tutorial")
    assert len(tutorial.scene_files()) == 3
    kinds = [[shape.material.type_name for shape in tutorial.make_scene(step).shapes] for step in range(3)]
    assert kinds == [["diffuse", "diffuse"], ["plastic", "oren-nayar"], ["plastic", "oren-nayar"]]


# --- Materials -------------------------------------------------------------------------------------


def test_every_material_has_a_tile(materials: ModuleType) -> None:
    # What is measured needs a file, which the project does not have.
    built_in = {name for name, cls in MATERIALS.items() if cls.__module__.startswith("wrt.")} - {"measured"}
    assert built_in == {tile.material.type_name for tile in materials.tiles()}


def test_every_preset_has_a_swatch() -> None:
    names = list(PICTURES["presets"].tiles())
    for key, tables in {
        "metal": [presets.METAL_IOR],
        "f0": [presets.METAL_F0, presets.SEMICONDUCTOR_F0],
        "ior": [presets.DIELECTRIC_IOR],
    }.items():
        for name in (name for table in tables for name in table):
            assert f"{key}-{name.replace(' ', '-')}" in names


def test_tiles_can_be_told_apart(materials: ModuleType) -> None:
    names = [tile.name for tile in materials.tiles()]
    labels = [(tile.material.type_name, tile.caption) for tile in materials.tiles()]
    assert len(set(names)) == len(names)
    assert len(set(labels)) == len(labels)
    assert all(caption.isascii() for _, caption in labels)
    assert len(names) % PICTURES["materials"].columns == 0


def test_all_tiles_share_one_kernel_and_show_their_own_material(materials: ModuleType) -> None:
    found = set()
    for tile in materials.tiles():
        scene = materials.make_scene(tile)
        table = describe_materials([shape.material for shape in scene.shapes])
        found.add((table.models, table.textured, table.opacity, table.tangents))
        (shown,) = (s for s in scene.shapes if s.mesh.bounds[1, 1] > 0.5 and s.material is tile.material)
        low, high = shown.mesh.bounds
        assert low[1] == pytest.approx(0.0, abs=1e-5)
        assert high[1] > 1.0
        # What the others are on is under the floor.
        specks = [s for s in scene.shapes if s.mesh.bounds[1, 1] < -1.0]
        assert len(specks) >= len(materials.tiles()) - 1
    (features,) = found
    expected = {part.model for tile in materials.tiles() for part in with_parts(tile.material) if not part.parts}
    assert set(features[0]) == expected


def test_ball_and_stone_are_closed_and_face_outwards(bodies: ModuleType) -> None:
    """The signed volume is that of the body, and each edge is run through once either way."""
    for mesh, volume in ((bodies.ball(), 4.0 / 3.0 * np.pi), (bodies.brilliant(1.0), None)):
        _, where = np.unique(np.round(mesh.vertices, 5), axis=0, return_inverse=True)
        faces = where.reshape(-1)[mesh.faces]
        edges = {(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
        assert len(edges) == 3 * len(faces)
        assert {(b, a) for a, b in edges} == edges
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        found = float(np.linalg.det(corners).sum() / 6.0)
        # Crown and pavilion lie between the cones within the ring of girdle and those around it.
        low, high = (volume * 0.998, volume) if volume else (np.pi * 0.86 / 3.0, np.pi * (0.86 / 3.0 + 0.33))
        assert low < found < high


def test_a_stone_is_convex(bodies: ModuleType) -> None:
    stone = bodies.brilliant()
    corners = stone.vertices[stone.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outside = np.einsum("fk,fvk->fv", normals, stone.vertices.astype(np.float64)[None] - corners[:, :1])
    assert outside.max() < 1e-5


def test_sheet_has_a_place_for_every_tile() -> None:
    tiles = [(np.full((64, 64, 3), 40 + 7 * i, np.uint8), (f"tile {i}", "caption")) for i in range(13)]
    sheet = np.asarray(script("pictures.picture").contact_sheet(tiles, 5))
    levels = {int(pixels[0, 0, 0]) for pixels, _ in tiles}
    flat = {v for v in levels if (sheet == v).all(axis=2).sum() >= 64 * 64}
    assert flat == levels


# --- Plots -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["fresnel-glass", "fresnel-metals", "distributions", "maskings", "lobes", "lobes-of-glass", "albedos"]
)
def test_curves_are_finite_and_told_apart(figures: ModuleType, name: str) -> None:
    figure = figures.FIGURES[name]()
    for panel in figure.panels:
        labels = [curve.label for curve in panel.curves if curve.label]
        assert labels
        assert len(set(labels)) == len(labels)
        for curve in panel.curves:
            assert np.isfinite(curve.y).all(), (panel.title, curve.label)
            assert curve.y.shape == curve.x.shape
            assert curve.y.min() >= 0.0
            assert curve.y.max() > 0.0
            if figure.y_label.startswith(("reflectance", "share", "G")):
                assert curve.y.max() < 1.01
        # Two curves of one panel that are the same would be a mistake in what is asked for.
        different = {curve.y.tobytes() for curve in panel.curves}
        assert len(different) == len(panel.curves), panel.title


def test_every_figure_is_tested_and_shown(figures: ModuleType) -> None:
    (parameters,) = (mark.args[1] for mark in test_curves_are_finite_and_told_apart.pytestmark if mark.args)
    assert set(parameters) == set(figures.FIGURES)
    shown = (ROOT / "docs" / "shading.md").read_text(encoding="utf-8")
    for name in figures.FIGURES:
        assert f"pictures/plots/{name}.png" in shown
        assert (ROOT / "docs" / "pictures" / "plots" / f"{name}.png").is_file()


def test_plotted_distributions_are_those_of_their_formulas(figures: ModuleType) -> None:
    """Peaks: 1 / (π α²) for the three that have a roughness."""
    for panel in figures.distributions().panels[:3]:
        for curve in panel.curves:
            alpha = float(curve.label.removeprefix("α "))
            assert curve.y[0] == pytest.approx(1.0 / (np.pi * alpha**2), rel=1e-5), panel.title


@pytest.mark.slow
def test_plotted_albedos_add_up(figures: ModuleType) -> None:
    """All bounces together lose nothing, and one bounce of white GGX of roughness 1 reflects 1 − ln 2 straight on.

    Its f is 1 / (2π (cosθi + cosθo)), by Smith's height-correlated masking.
    """
    for panel in figures.albedos().panels:
        for curve in panel.curves:
            if curve.style == "--":
                np.testing.assert_allclose(curve.y, 1.0, atol=0.01)
            else:
                assert curve.y.min() < 0.95
    (rough,) = (curve for curve in figures.albedos().panels[0].curves if curve.label == "α 1")
    assert rough.y[0] == pytest.approx(1.0 - np.log(2.0), abs=2e-3)
