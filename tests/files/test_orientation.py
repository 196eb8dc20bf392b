"""A mesh without a known up axis is stood on its base if it has one, and otherwise left as it is."""

import numpy as np
import pytest
import trimesh
from conftest import ROOT

import wrt
from wrt.io.load_mesh import load_shapes
from wrt.meshes.many_triangles import terrain
from wrt.studio.orientation import guess_up


def up_of(*meshes: wrt.Mesh, default: str = "y") -> str:
    return guess_up([wrt.Shape(mesh) for mesh in meshes], default)


def turned(mesh: wrt.Mesh, degrees: float = 90.0) -> wrt.Mesh:
    """Brings y to z."""
    return mesh.rotated((1.0, 0.0, 0.0), degrees)


def lathe(profile: list[tuple[float, float]], sides: int = 48) -> wrt.Mesh:
    """A closed solid of (radius, y), turned about the y axis."""
    closed = [(0.0, profile[0][1]), *profile, (0.0, profile[-1][1])]
    about_z = trimesh.creation.revolve(closed, sections=sides)
    return turned(wrt.Mesh(about_z.vertices, about_z.faces), -90.0)


CYLINDER = lathe([(0.5, 0.0), (0.5, 4.0)])
VASE = lathe([(0.4, 0.0), (1.0, 1.0), (0.3, 2.0), (0.6, 2.4)])
TABLE = [wrt.box((-1, 0.9, -0.6), (1, 1.0, 0.6))] + [
    wrt.box((x - 0.05, 0.0, z - 0.05), (x + 0.05, 0.9, z + 0.05)) for x in (-0.8, 0.8) for z in (-0.45, 0.45)
]
TEAPOT = wrt.load_mesh(ROOT / "meshes" / "teapot.ply")
SHEET = wrt.quad((0, 0, 0), (0, 0, 1), (1, 0, 0))


FILES = {"stanford-bunny.obj": "y", "igea.ply": "y", "Duck.glb": "y", "nefertiti.obj": "z", "fuze/fuze.obj": "z"}


@pytest.mark.parametrize(("name", "up"), FILES.items())
def test_real_files_stand_as_they_are_meant(name, up, assets):
    """And when they are turned to the other axis, all that stand on a base do there (igea is cut off slantwise)."""
    meshes = [shape.mesh for shape in load_shapes(assets / "meshes" / name, smooth_degrees=0.0)]
    assert up_of(*meshes) == up
    if name != "igea.ply":
        on_side = [turned(mesh, -90.0 if up == "z" else 90.0) for mesh in meshes]
        assert up_of(*on_side, default=up) == ("y" if up == "z" else "z")


@pytest.mark.parametrize("parts", [[CYLINDER], [VASE], TABLE, [TEAPOT]], ids=["cylinder", "vase", "table", "teapot"])
def test_what_stands_on_one_axis_alone_is_stood_there_whatever_the_default(parts):
    """The same far away, and of another size."""
    for default in ("y", "z"):
        assert up_of(*parts, default=default) == "y"
        assert up_of(*(turned(mesh).translated((-70.0, 30.0, 110.0)) for mesh in parts), default=default) == "z"
        assert up_of(*(turned(mesh).scaled(1e-3) for mesh in parts), default=default) == "z"


def test_land_lies_and_a_sheet_that_would_be_part_of_the_floor_is_stood_up():
    """Set on its edge it would stand well, and in one valley it has no more than a point on the ground."""
    land = terrain(2_000)
    assert up_of(land) == "y"
    assert up_of(turned(land), default="z") == "z"
    assert up_of(SHEET) == up_of(SHEET, SHEET) == "z"
    assert up_of(turned(SHEET), default="z") == up_of(turned(SHEET)) == "y"
    assert up_of(SHEET, SHEET.translated((0.0, 0.01, 0.0))) == "y"


def test_in_doubt_the_default_stays():
    boxes = [wrt.box((0, 0, 0), size) for size in ((1, 1, 1), (1, 1, 4), (1, 4, 1), (1, 0.01, 1))]
    for mesh in (*boxes, wrt.sphere(subdivisions=3), CYLINDER.rotated((0.0, 0.0, 1.0), 90.0)):
        for default in ("y", "z"):
            assert up_of(mesh, default=default) == default
    # Neither another axis nor a mesh without area is thought about.
    assert up_of(turned(VASE), default="-y") == "-y"
    assert up_of(wrt.Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])), default="z") == "z"


def test_many_small_faces_change_nothing():
    """A mesh so large that only a part of its faces is examined, in two parts."""
    fine = lathe([(0.5, 0.05 * k) for k in range(1001)], sides=256)
    assert len(fine.faces) > 500_000
    half = len(fine.faces) // 2
    parts = [wrt.Mesh(fine.vertices, fine.faces[:half]), wrt.Mesh(fine.vertices, fine.faces[half:])]
    assert up_of(*(turned(mesh.scaled(0.1)) for mesh in parts)) == "y"  # a needle: it would not stand
    assert up_of(*(turned(mesh.transformed(np.diag([1.0, 0.05, 1.0, 1.0]))) for mesh in parts)) == "z"


def test_files_that_do_not_say_are_guessed_and_gltf_is_y(tmp_path):
    lying = turned(VASE)
    tall = VASE.bounds[1, 1] - VASE.bounds[0, 1]
    for suffix, height in {"obj": tall, "ply": tall, "stl": tall, "off": tall, "glb": 2.0}.items():
        path = tmp_path / f"vase.{suffix}"
        trimesh.Trimesh(lying.vertices, lying.faces, process=False).export(path)
        for options, expected in (({}, height), ({"up": "y"}, 2.0)):
            low, high = wrt.load(str(path), **options).shapes[0].mesh.bounds
            assert high[1] - low[1] == pytest.approx(expected, rel=1e-3), suffix
