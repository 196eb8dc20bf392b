"""The gallery shows every material, all by one kernel; the plots draw what the models are known to do."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT

import wrt
from wrt.build.layout import lay_out
from wrt.build.materials import describe_materials
from wrt.camera import CAMERAS
from wrt.materials import MATERIALS
from wrt.scene import INTEGRATORS


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    return script("gallery")


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


def test_pictures_of_motion() -> None:
    motion = script("motion")
    shown = re.findall(r"\(pictures/(motion-[\w-]+)\.jpg\)", (ROOT / "docs" / "motion.md").read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(motion.PICTURES)
    kinds = [lay_out(make()).kind for make, _, _ in motion.PICTURES.values()]
    assert kinds == ["still", "deforming"]


def test_every_camera_has_its_pictures_in_the_docs() -> None:
    cameras = script("cameras")
    shown = re.findall(r"\(pictures/(camera-[\w-]+)\.jpg\)", (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(cameras.PICTURES)
    assert {type(picture.camera) for picture in cameras.PICTURES.values()} == set(CAMERAS.values())
    scenes = [cameras.make_scene(picture.camera) for picture in cameras.PICTURES.values()]
    assert len({describe_materials([shape.material for shape in scene.shapes]).models for scene in scenes}) == 1


# --- Gallery ---------------------------------------------------------------------------------------


def test_every_material_has_a_tile(gallery: ModuleType) -> None:
    built_in = {name for name, cls in MATERIALS.items() if cls.__module__.startswith("wrt.")}
    assert built_in == {tile.material.type_name for tile in gallery.tiles()}


def test_tiles_can_be_told_apart(gallery: ModuleType) -> None:
    names = [tile.name for tile in gallery.tiles()]
    labels = [(tile.material.type_name, tile.caption) for tile in gallery.tiles()]
    assert len(set(names)) == len(names)
    assert len(set(labels)) == len(labels)
    assert all(caption.isascii() for _, caption in labels)
    assert len(names) % gallery.COLUMNS == 0


def test_all_tiles_share_one_kernel_and_show_their_own_material(gallery: ModuleType) -> None:
    found = set()
    for tile in gallery.tiles():
        scene = gallery.make_scene(tile)
        table = describe_materials([shape.material for shape in scene.shapes])
        found.add((table.models, table.textured, table.layered, table.tangents))
        (shown,) = (s for s in scene.shapes if s.mesh.bounds[1, 1] > 0.5 and s.material is tile.material)
        low, high = shown.mesh.bounds
        assert low[1] == pytest.approx(0.0, abs=1e-5)
        assert high[1] > 1.0
        # What the others are on is under the floor.
        specks = [s for s in scene.shapes if s.mesh.bounds[1, 1] < -1.0]
        assert len(specks) >= len(gallery.tiles()) - 1
    (features,) = found
    expected = {part.model for tile in gallery.tiles() for part in with_parts(tile.material) if not part.parts}
    assert set(features[0]) == expected


def test_ball_and_stone_are_closed_and_face_outwards(gallery: ModuleType) -> None:
    """The signed volume is that of the body, and each edge is run through once either way."""
    for mesh, volume in ((gallery.ball(), 4.0 / 3.0 * np.pi), (gallery.brilliant(1.0), None)):
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


def test_a_stone_is_convex(gallery: ModuleType) -> None:
    stone = gallery.brilliant()
    corners = stone.vertices[stone.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outside = np.einsum("fk,fvk->fv", normals, stone.vertices.astype(np.float64)[None] - corners[:, :1])
    assert outside.max() < 1e-5


def test_sheet_has_a_place_for_every_tile(gallery: ModuleType) -> None:
    pictures = {tile.name: np.full((64, 64, 3), 40 + 7 * i, np.uint8) for i, tile in enumerate(gallery.tiles())}
    sheet = np.asarray(gallery.contact_sheet(pictures))
    levels = {int(picture[0, 0, 0]) for picture in pictures.values()}
    flat = {int(v) for v in levels if (sheet == v).all(axis=2).sum() >= 64 * 64}
    assert flat == levels


# --- Integrators -----------------------------------------------------------------------------------


def test_integrators_and_layers_are_shown() -> None:
    integrators = script("integrators")
    text = (ROOT / "docs" / "integrators.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"\(pictures/([\w-]+)\.jpg\)", text)) == sorted([*integrators.PICTURES, "layers"])
    assert {given["integrator"] for given in integrators.PICTURES.values()} <= set(INTEGRATORS) - {"aov"}
    scene = integrators.make_scene()
    assert not any(shape.transform for shape in scene.shapes)
    assert len({id(shape.material) for shape in scene.shapes}) < len(scene.shapes)


# --- Plots -----------------------------------------------------------------------------------------


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
    (parameters,) = (mark.args[1] for mark in test_curves_are_finite_and_told_apart.pytestmark)
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
