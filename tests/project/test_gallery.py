"""The docs show the gallery's pictures, all materials and cameras among them."""

import re

import gallery
import numpy as np
import pictures
import pictures.bodies
import pictures.inverse
import pictures.materials
import pictures.tutorial
import pytest
from conftest import ROOT
from PIL import Image
from support.covering_kernels import OF_PICTURES, render_with

import wrt
from wrt.scene.camera import CAMERAS
from wrt.scene.integrators import INTEGRATORS
from wrt.scene.materials import MATERIALS
from wrt.upload.accel.instancing import lay_out
from wrt.upload.materials import MaterialTable

PICTURES = {name: drawing for group in pictures.GROUPS.values() for name, drawing in group.items()}
OWN_SCRIPT = ("benchmark", "cloth")
"""Pictures of examples, whose scripts render them."""

SCREENSHOTS = ("view-dark", "view-light", "view-narrow", "view-notebook")
"""Pictures of the live view in a browser and in JupyterLab, which a person takes."""


def test_docs_show_what_the_gallery_makes():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {name for page in pages for name in re.findall(r"pictures/([\w-]+)\.jpg", page.read_text(encoding="utf-8"))}
    files = [path.stem for path in (ROOT / "docs" / "pictures").glob("*.jpg")]
    assert sorted(shown) == sorted(files) == sorted([*PICTURES, *OWN_SCRIPT, *SCREENSHOTS])


def test_steps_of_the_tutorial_replace_tables_of_its_file():
    scenes = [pictures.tutorial.make_scene(step) for step in range(3)]
    assert [(len(scene.shapes), len(scene.lights)) for scene in scenes] == [(2, 0), (2, 0), (2, 2)]
    assert [type(scene.shapes[0].material) for scene in scenes] == [wrt.Diffuse, wrt.Plastic, wrt.Plastic]


@pytest.mark.slow
def test_scenes_of_pictures_are_built():
    moving = {"motion-toys": "deforming", "layers": "moving", "motion-forest": "still"}
    for name in PICTURES.keys() - {"materials", "own", "own-integrators", *pictures.inverse.PICTURES}:
        drawing = PICTURES[name]
        tiles = getattr(drawing, "tiles", dict)()
        scene = next((picture for picture, _ in tiles.values()), getattr(drawing, "picture", drawing)).make()
        assert lay_out(scene).kind == moving.get(name, "none"), name
        assert MaterialTable([shape.material for shape in scene.shapes]).models, name


@pytest.mark.slow
def test_a_picture_renders_as_the_docs_show_it(tmp_path, monkeypatch):
    """16 pixels wide, against the picture of the docs made as small; noise and JPEG leave a difference of 6 levels."""
    render_with([OF_PICTURES], monkeypatch)
    assert gallery.main(["light-spots", "--spp", "256", "--size", "16", "--out", str(tmp_path)]) == 0
    with Image.open(tmp_path / "light-spots.jpg") as picture:
        found = np.asarray(picture.convert("RGB"), np.float64)
        size = picture.size
    with Image.open(ROOT / "docs" / "pictures" / "light-spots.jpg") as picture:
        shown = np.asarray(picture.convert("RGB").resize(size, Image.Resampling.BOX), np.float64)
    assert np.abs(found - shown).mean() < 8.0
    assert np.corrcoef(found.ravel(), shown.ravel())[0, 1] > 0.97


def test_every_camera_integrator_and_material_has_its_picture():
    cameras = [PICTURES[name].make() for name in PICTURES if name.startswith("camera-")]
    assert {type(scene.camera) for scene in cameras} == set(CAMERAS.values())
    shown = [PICTURES[name].options["integrator"] for name in PICTURES if name.startswith("integrator-")]
    assert set(shown) == set(INTEGRATORS) - {"aov", "volpath"}
    # What is measured needs a file, which the project does not have; what is unlit has one colour.
    built_in = {name for name, cls in MATERIALS.items() if cls.__module__.startswith("wrt.")} - {"measured", "unlit"}
    assert built_in == {tile.material.type_name for tile in pictures.materials.tiles()}
