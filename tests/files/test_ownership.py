"""A scene owns its arrays: later changes to the arrays it was made from do not change pictures."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.rendering.checkpoint import scene_fingerprint

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2]], np.int32)
ROWS = np.full((3, 3), 0.5, np.float32)
UVS = ROWS[:, :2].copy()
PIXELS = np.full((2, 4, 3), 0.25, np.float32)
PLACES = np.stack([np.eye(4)] * 2)
FORMS = np.stack([TRIANGLE] * 2)
TIMES = (0.0, 1.0)


def of_mesh(**arrays: Any) -> wrt.Scene:
    return wrt.Scene([wrt.Shape(wrt.Mesh(**{"vertices": TRIANGLE, "faces": FACES} | arrays))])


def of_shape(**fields: Any) -> wrt.Scene:
    return wrt.Scene([wrt.Shape(wrt.Mesh(TRIANGLE, FACES), **fields)])


CASES: dict[str, tuple[np.ndarray, Callable[[Any], wrt.Scene]]] = {
    "vertices": (TRIANGLE, lambda array: of_mesh(vertices=array)),
    "faces": (FACES, lambda array: of_mesh(faces=array)),
    "normals": (ROWS, lambda array: of_mesh(normals=array)),
    "uvs": (UVS, lambda array: of_mesh(uvs=array)),
    "colors": (ROWS, lambda array: of_mesh(colors=array)),
    "transform": (np.eye(4), lambda array: of_shape(transform=array)),
    "motion": (PLACES, lambda array: of_shape(transform=wrt.Motion(TIMES, array))),
    "deformation": (FORMS, lambda array: of_shape(deformation=wrt.Deformation(TIMES, array))),
    "deformation normals": (FORMS, lambda array: of_shape(deformation=wrt.Deformation(TIMES, FORMS, array))),
    "texture": (PIXELS, lambda array: of_shape(material=wrt.Diffuse(wrt.ImageTexture(array)))),
    "normal map": (PIXELS, lambda array: of_shape(material=wrt.Diffuse(normal_map=wrt.NormalMap(array)))),
    "environment": (PIXELS, lambda array: wrt.Scene(environment=wrt.ImageEnvironment(array))),
    "harmonics": (
        np.full((4, 3), 0.5),
        lambda array: wrt.Scene(environment=wrt.SphericalHarmonicsEnvironment(array)),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_writing_to_what_was_given_changes_nothing(case):
    array, build = CASES[case]
    for writeable in (True, False):
        source = array.copy()
        passed = source.view()
        passed.flags.writeable = writeable
        scene = build(passed)
        before = scene_fingerprint(scene)
        source[...] = 1
        assert scene_fingerprint(scene) == before


def test_scenes_can_be_pickled_and_copied_and_renderers_say_that_they_cannot(render_kernels_when_launched):
    scene = of_shape(
        material=wrt.Mix(wrt.Principled(wrt.ImageTexture(PIXELS)), wrt.Dielectric(), weight=0.3),
        transform=wrt.Motion.rotation((0, 1, 0), 200.0),
        deformation=wrt.Deformation(TIMES, np.stack([TRIANGLE, 2 * TRIANGLE])),
    )
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0))
    scene.environment = wrt.SunSkyEnvironment()
    scene.lights.append(wrt.SphereLight((0.0, 3.0, 0.0), 0.1, 5.0))
    scene.medium = wrt.Medium.from_color((0.5, 0.6, 0.7), 3.0)
    renderer = wrt.Renderer(of_shape(emission=1.0), width=4, height=4)
    for duplicate in (lambda value: pickle.loads(pickle.dumps(value)), copy.copy, copy.deepcopy):
        assert scene_fingerprint(duplicate(scene)) == scene_fingerprint(scene)
        with pytest.raises(TypeError, match=r"^a Renderer cannot be copied or pickled.*Scene.*save_checkpoint[^\n]*$"):
            duplicate(renderer)
