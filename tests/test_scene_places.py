"""Scene files put shapes in many places, let them move and change their form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.io.toml.reader import load_scene


def read(folder: Path, text: str) -> wrt.Scene:
    (folder / "scene.toml").write_text(text)
    return load_scene(folder / "scene.toml")


def test_places(tmp_path: Path) -> None:
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 0, 3] = 1.0, 2.0, 3.0
    np.save(tmp_path / "places.npy", matrices)
    scene = read(
        tmp_path,
        """
        [[shapes]]
        type = "box"
        translate = [0, 1, 0]
        instances = [
            { translate = [1, 0, 0], scale = 2.0 },
            { rotate = { axis = [0, 1, 0], degrees = 90 }, motion = { times = [0, 2], translate = [4, 0, 0] } },
        ]
        [[shapes]]
        type = "sphere"
        subdivisions = 0
        instances = "places.npy"
        [[shapes]]
        type = "box"
        motion = { times = [1, 3], rotate = { axis = [0, 0, 1], degrees = 720 }, center = [1, 0, 0] }
        [[shapes]]
        type = "box"
        motion = { keys = [{ time = 0.5 }, { time = 1.5, scale = 3.0, translate = [0, 2, 0] }] }
        """,
    )
    first, second, *rest = scene.shapes
    assert first.mesh is second.mesh
    assert rest[0].mesh is rest[1].mesh is rest[2].mesh
    assert first.mesh.bounds[0, 1] == 0.5  # the shape's own transform comes first
    np.testing.assert_allclose(first.bounds, [[0.0, 1.0, -1.0], [2.0, 3.0, 1.0]])
    turned = wrt.Motion.rotation((0, 1, 0), 90.0).transforms[-1]
    expected = wrt.Motion.translation((2.0, 0.0, 0.0)).transforms[-1] @ turned
    np.testing.assert_allclose(second.transform_at(1.0), expected, atol=1e-12)
    np.testing.assert_array_equal([shape.transform for shape in rest[:3]], matrices)
    quarter = wrt.Motion.rotation((0, 0, 1), 90.0, center=(1.0, 0.0, 0.0)).transforms[-1]
    np.testing.assert_allclose(rest[3].transform_at(1.25), quarter, atol=1e-12)
    half = np.diag([2.0, 2.0, 2.0, 1.0])
    half[1, 3] = 1.0
    np.testing.assert_allclose(rest[4].transform_at(1.0), half, atol=1e-12)


def test_a_deformation(tmp_path: Path) -> None:
    for name, height in (("low", 1.0), ("high", 3.0)):
        (tmp_path / f"{name}.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 {height} 0\nf 1 2 3\n")
    scene = read(
        tmp_path,
        """
        [[shapes]]
        type = "mesh"
        file = "low.obj"
        smooth = false
        scale = 2.0
        deformation = { files = ["low.obj", "high.obj"], times = [0.0, 1.0] }
        """,
    )
    (shape,) = scene.shapes
    np.testing.assert_allclose(shape.mesh_at(0.5).bounds[1], [2.0, 4.0, 0.0])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("instances = [{ translat = [1, 0, 0] }]", r"shapes\[0\].instances\[0\].translat: unknown key"),
        ("instances = []", "instances must not be empty"),
        ('instances = "none.npy"', "instances: .*none.npy"),
        ('instances = "bad.npy"', "instances: .*bad.npy: not a NumPy file"),
        ('instances = "flat.npy"', r"must be \(N, 4, 4\) matrices, not an array of \(3,\)"),
        ("motion = 3", "motion: must be a table"),
        ("motion = { times = [0] }", "times must be two"),
        ("motion = { keys = [{ time = 1.0 }, { time = 0.0 }] }", "motion: motion times must ascend"),
        ("motion = { times = [0, 1] }\ninstances = [{}]", "both motion and instances"),
        ('deformation = { files = ["bad.npy"], times = [0.0, 1.0] }', "two arrays of one length"),
    ],
)
def test_mistakes_in_places(tmp_path: Path, keys: str, message: str) -> None:
    (tmp_path / "bad.npy").write_text("no array")
    np.save(tmp_path / "flat.npy", np.zeros(3))
    with pytest.raises(wrt.InputError, match=message):
        read(tmp_path, f'[[shapes]]\ntype = "box"\n{keys}\n')
