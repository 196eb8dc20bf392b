"""A scene owns its arrays: later changes to the arrays it was made from do not change pictures."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.rendering.fingerprint import scene_fingerprint

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2]], np.int32)
ROWS = np.full((3, 3), 0.5, np.float32)


def of_mesh(**arrays: Any) -> wrt.Scene:
    return wrt.Scene([wrt.Shape(wrt.Mesh(**{"vertices": TRIANGLE, "faces": FACES} | arrays))])


def of_shape(**fields: Any) -> wrt.Scene:
    return wrt.Scene([wrt.Shape(wrt.Mesh(TRIANGLE, FACES), **fields)])


PIXELS = np.full((2, 4, 3), 0.25, np.float32)

CASES: dict[str, tuple[np.ndarray, Callable[[Any], wrt.Scene]]] = {
    "vertices": (TRIANGLE, lambda given: of_mesh(vertices=given)),
    "vertices in double precision": (TRIANGLE.astype(float), lambda given: of_mesh(vertices=given)),
    "faces": (FACES, lambda given: of_mesh(faces=given)),
    "normals": (ROWS, lambda given: of_mesh(normals=given)),
    "uvs": (ROWS[:, :2].copy(), lambda given: of_mesh(uvs=given)),
    "colors": (ROWS, lambda given: of_mesh(colors=given)),
    "moved uvs": (
        ROWS[:, :2].copy(),
        lambda given: wrt.Scene([wrt.Shape(wrt.Mesh(TRIANGLE, FACES, uvs=given).scaled(2.0))]),
    ),
    "transform": (np.eye(4), lambda given: of_shape(transform=given)),
    "motion": (np.stack([np.eye(4)] * 2), lambda given: of_shape(transform=wrt.Motion((0.0, 1.0), given))),
    "motion times": (
        np.array([0.0, 1.0]),
        lambda given: of_shape(transform=wrt.Motion(given, np.stack([np.eye(4)] * 2))),
    ),
    "deformation": (np.stack([TRIANGLE] * 2), lambda given: of_shape(deformation=wrt.Deformation((0.0, 1.0), given))),
    "deformation normals": (
        np.stack([ROWS] * 2),
        lambda given: of_shape(deformation=wrt.Deformation((0.0, 1.0), np.stack([TRIANGLE] * 2), given)),
    ),
    "texture": (PIXELS, lambda given: of_shape(material=wrt.Diffuse(wrt.ImageTexture(given)))),
    "normal map": (PIXELS, lambda given: of_shape(material=wrt.Diffuse(normal_map=wrt.NormalMap(given)))),
    "environment": (PIXELS, lambda given: wrt.Scene(environment=wrt.ImageEnvironment(given))),
    "harmonics": (
        np.full((4, 3), 0.5),
        lambda given: wrt.Scene(environment=wrt.SphericalHarmonicsEnvironment(given)),
    ),
}


@pytest.mark.parametrize("view", [False, True], ids=["array", "read-only view"])
@pytest.mark.parametrize("case", CASES)
def test_writing_to_what_was_given_changes_nothing(case, view):
    array, build = CASES[case]
    source = array.copy()
    given = source.view()
    given.flags.writeable = not view
    scene = build(given)
    before = scene_fingerprint(scene)
    source *= 0
    source += 1
    assert not np.array_equal(source, array)
    assert scene_fingerprint(scene) == before
    assert before == scene_fingerprint(build(array.copy()))


def test_no_picture_changes_either():
    vertices, pixels = TRIANGLE.copy(), PIXELS.copy()
    scene = wrt.Scene(camera=wrt.OrthographicCamera(origin=(0.3, 0.3, 1.0), target=(0.3, 0.3, 0.0), view_height=1.0))
    scene.add(
        wrt.Mesh(vertices, FACES, uvs=TRIANGLE[:, :2]),
        material=wrt.Emissive(wrt.ImageTexture(pixels)),
    )
    before = wrt.render(scene, width=8, height=8, spp=2)
    assert before.any()
    vertices[:] = 7.0
    pixels[:] = 0.0
    np.testing.assert_array_equal(wrt.render(scene, width=8, height=8, spp=2), before)


def test_the_own_arrays_cannot_be_written_to():
    scene = of_mesh(normals=ROWS.copy(), uvs=ROWS[:, :2].copy(), colors=ROWS.copy())
    for name in ("vertices", "faces", "normals", "uvs", "colors"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(scene.shapes[0].mesh, name)[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        wrt.ImageTexture(PIXELS.copy()).pixels[0] = 0.0
    assert TRIANGLE.flags.writeable  # the caller's array stays writeable


def test_arrays_handed_over_are_not_copied():
    vertices, faces = TRIANGLE.copy(), FACES.copy()
    mesh = wrt.Mesh.taking(vertices, faces)
    assert np.shares_memory(mesh.vertices, vertices)
    assert np.shares_memory(mesh.faces, faces)
    assert not vertices.flags.writeable
    again = wrt.Mesh(mesh.vertices, mesh.faces)
    assert again.vertices is mesh.vertices
    texture = wrt.ImageTexture(PIXELS.copy())
    assert wrt.ImageTexture(texture.pixels, channel="g").pixels is texture.pixels


def scene_of_everything() -> wrt.Scene:
    scene = of_shape(
        material=wrt.Principled(wrt.ImageTexture(PIXELS), normal_map=wrt.NormalMap(np.full((2, 2, 3), 0.5))),
        transform=wrt.Motion.rotation((0, 1, 0), 200.0),
        deformation=wrt.Deformation((0.0, 1.0), np.stack([TRIANGLE, 2 * TRIANGLE])),
    )
    scene.add(wrt.sphere(), material=wrt.Mix(wrt.RoughConductor(), wrt.Dielectric(), weight=0.3), transform=np.eye(4))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0))
    scene.environment = wrt.SunSkyEnvironment()
    scene.lights.append(wrt.SphereLight((0.0, 3.0, 0.0), 0.1, 5.0))
    scene.medium = wrt.Medium.from_color((0.5, 0.6, 0.7), 3.0)
    return scene


@pytest.mark.parametrize("again", [lambda value: pickle.loads(pickle.dumps(value)), copy.copy, copy.deepcopy])
def test_scenes_meshes_and_materials_can_be_pickled_and_copied(again):
    scene = scene_of_everything()
    assert scene_fingerprint(again(scene)) == scene_fingerprint(scene)
    for shape in scene.shapes:
        for part in (shape.mesh, shape.material):
            of_part = {"mesh": shape.mesh, "material": shape.material}
            changed = {key: again(value) if value is part else value for key, value in of_part.items()}
            first, second = (scene_fingerprint(wrt.Scene([wrt.Shape(**each)])) for each in (of_part, changed))
            assert first == second


@pytest.mark.parametrize("again", [pickle.dumps, copy.copy, copy.deepcopy])
def test_renderers_say_that_they_cannot_be(again):
    renderer = wrt.Renderer(of_shape(emission=1.0), width=4, height=4)
    with pytest.raises(TypeError, match=r"^a Renderer cannot be copied or pickled.*Scene.*save_checkpoint[^\n]*$"):
        again(renderer)
