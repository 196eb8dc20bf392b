"""A scene's digests: the same for the same scene, and another for the one part that differs."""

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import wrt
from wrt.rendering.checkpoint import scene_fingerprint


def triangle(**changes: object) -> wrt.Mesh:
    fields = {
        "vertices": np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32),
        "faces": np.array([(0, 1, 2)], np.int32),
        "normals": np.tile(np.float32([0, 0, 1]), (3, 1)),
        "uvs": np.float32([(0, 0), (1, 0), (0, 1)]),
        "colors": np.ones((3, 3), np.float32),
    }
    return wrt.Mesh(**{**fields, **changes})


def texture(value: float = 0.5) -> wrt.ImageTexture:
    return wrt.ImageTexture(np.full((2, 3, 3), value, np.float32))


def scene() -> wrt.Scene:
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 5.0), (0.0, 0.0, 0.0)))
    result.environment = wrt.ImageEnvironment(np.ones((2, 4, 3), np.float32))
    result.add(triangle(), material=wrt.Diffuse(texture()), emission=(1.0, 0.0, 0.0), name="one")
    result.add(wrt.box(), material=wrt.Mirror(0.5), name="two")
    result.add_light(wrt.PointLight((0, 2, 0), intensity=3.0))
    return result


Change = Callable[[wrt.Scene], None]


def of_shape(index: int, **changes: object) -> Change:
    def change(target: wrt.Scene) -> None:
        target.shapes[index] = dataclasses.replace(target.shapes[index], **changes)

    return change


def of_mesh(**changes: object) -> Change:
    return of_shape(0, mesh=triangle(**changes))


def of_field(name: str, /, **changes: object) -> Change:
    return lambda target: setattr(target, name, dataclasses.replace(getattr(target, name), **changes))


def with_field(name: str, value: object) -> Change:
    return lambda target: setattr(target, name, value)


NUDGED = np.array([(0, 0, 0), (np.nextafter(np.float32(1), np.float32(2)), 0, 0), (0, 1, 0)], np.float32)
CHANGES: dict[str, dict[str, Change]] = {
    "geometry": {
        "a vertex by one bit": of_mesh(vertices=NUDGED),
        "winding": of_mesh(faces=np.array([(0, 2, 1)], np.int32)),
        "a normal": of_mesh(normals=np.tile(np.float32([0, 1, 0]), (3, 1))),
        "no normals": of_mesh(normals=None),
        "texture coordinates": of_mesh(uvs=np.float32([(0, 0), (1, 0), (1, 1)])),
        "a vertex colour": of_mesh(colors=np.float32([(1, 1, 1), (1, 1, 1), (1, 1, 0)])),
    },
    "materials": {
        "one texel": of_shape(0, material=wrt.Diffuse(texture(0.25))),
        "the model, of the same number": of_shape(1, material=wrt.Diffuse(0.5)),
    },
    "emission": {
        "emission": of_shape(0, emission=(1.0, 0.5, 0.0)),
        "two-sided": of_shape(0, two_sided_emission=True),
        "emission of another shape": of_shape(1, emission=1.0),
    },
    "sides and edges": {"single-sided": of_shape(0, double_sided=False), "no lines": of_shape(0, edges=False)},
    "shadow catchers": {"one": of_shape(0, shadow_catcher=True)},
    "lights": {
        "kind": with_field("lights", [wrt.DirectionalLight((0, 2, 0), 3.0)]),
        "one more": lambda s: s.lights.append(wrt.DirectionalLight((0, -1, 0))),
    },
    "environment": {
        "none": with_field("environment", None),
        "constant": with_field("environment", wrt.ConstantEnvironment(1.0)),
        "pixels": of_field("environment", pixels=np.zeros((2, 4, 3))),
        "pixels in another order": of_field("environment", pixels=np.ones((4, 2, 3))),
        "scale": of_field("environment", scale=2.0),
    },
    "camera": {
        "shutter": of_field("camera", shutter_close=0.1),
        "motion": of_field("camera", motion=wrt.Motion.translation((1, 0, 0))),
        "kind": with_field("camera", wrt.FisheyeCamera((0.0, 1.0, 5.0), fov_degrees=40.0)),
    },
    "medium": {"fog": with_field("medium", wrt.Medium(0.1))},
}


@pytest.mark.parametrize("part", CHANGES)
def test_one_change_shows_in_its_part_alone(part):
    before = scene_fingerprint(scene())
    assert set(before) == set(CHANGES)
    assert len(set(before.values())) == len(CHANGES)
    for name, change in CHANGES[part].items():
        changed = scene()
        change(changed)
        digests = scene_fingerprint(changed)
        assert {key for key in before if before[key] != digests[key]} == {part}, name


def test_names_settings_and_how_a_value_was_typed_do_not_count_but_order_does():
    typed = scene()
    typed.camera = wrt.PerspectiveCamera([0, np.float32(1), 5], np.zeros(3))
    typed.lights = [wrt.PointLight(np.array([0.0, 2.0, 0.0]), intensity=[3, 3, 3])]
    of_field("environment", name="another")(typed)
    image = wrt.ImageTexture(texture().pixels, name="another")
    of_shape(0, name="another", material=wrt.Diffuse(image))(typed)
    of_shape(1, material=wrt.Mirror(np.float64(0.5)))(typed)
    typed.settings = wrt.RenderSettings(width=3, spp=7)
    assert scene_fingerprint(typed) == scene_fingerprint(scene())
    # Triangles are numbered in order, and ties go to the lowest number
    swapped = scene()
    swapped.shapes.reverse()
    assert scene_fingerprint(swapped)["geometry"] != scene_fingerprint(scene())["geometry"]


def test_digests_are_the_same_in_another_process():
    """A checkpoint outlives the process; Python's own hashes would not do."""
    program = "import json, test_fingerprint as t; print(json.dumps(t.scene_fingerprint(t.scene())))"
    path = os.pathsep.join([str(ROOT / "tests"), str(ROOT), str(Path(__file__).parent)])
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "PYTHONPATH": path}
    printed = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=True).stdout
    assert json.loads(printed) == scene_fingerprint(scene())
