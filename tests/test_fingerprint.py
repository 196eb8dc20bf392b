"""A scene's digests: the same for the same scene, and another for the one part that differs."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.rendering.fingerprint import scene_fingerprint

PARTS = {"geometry", "materials", "emission", "lights", "environment", "camera", "medium"}


def triangle(**changes: object) -> wrt.Mesh:
    fields = {
        "vertices": np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32),
        "faces": np.array([(0, 1, 2)], np.int32),
        "normals": np.tile(np.float32([0, 0, 1]), (3, 1)),
        "uvs": np.float32([(0, 0), (1, 0), (0, 1)]),
        "colors": np.ones((3, 3), np.float32),
    }
    return wrt.Mesh(**{**fields, **changes})  # type: ignore[arg-type]


def texture(value: float = 0.5) -> wrt.ImageTexture:
    return wrt.ImageTexture(np.full((2, 3, 3), value, np.float32))


def scene() -> wrt.Scene:
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 5.0), (0.0, 0.0, 0.0)))
    result.environment = wrt.ImageEnvironment(np.ones((2, 4, 3), np.float32))
    result.add(triangle(), material=wrt.Diffuse(texture()), emission=(1.0, 0.0, 0.0), name="one")
    result.add(wrt.box(), material=wrt.Mirror(0.5), name="two")
    result.add_light(wrt.PointLight((0, 2, 0), intensity=3.0))
    return result


def with_shape(index: int, **changes: object) -> Callable[[wrt.Scene], None]:
    def change(target: wrt.Scene) -> None:
        target.shapes[index] = dataclasses.replace(target.shapes[index], **changes)

    return change


def with_field(name: str, value: object) -> Callable[[wrt.Scene], None]:
    return lambda target: setattr(target, name, value)


def camera(**changes: object) -> wrt.PerspectiveCamera:
    return dataclasses.replace(scene().camera, **changes)  # type: ignore[type-var]


def environment(**changes: object) -> wrt.ImageEnvironment:
    return dataclasses.replace(scene().environment, **changes)  # type: ignore[type-var]


def moved(**changes: object) -> Callable[[wrt.Scene], None]:
    return with_shape(0, mesh=triangle(**changes))


nudged = np.array([(0, 0, 0), (np.nextafter(np.float32(1), np.float32(2)), 0, 0), (0, 1, 0)], np.float32)
CHANGES: dict[str, tuple[Callable[[wrt.Scene], None], str]] = {
    "a vertex by one bit": (moved(vertices=nudged), "geometry"),
    "winding": (moved(faces=np.array([(0, 2, 1)], np.int32)), "geometry"),
    "a normal": (moved(normals=np.tile(np.float32([0, 1, 0]), (3, 1))), "geometry"),
    "no normals": (moved(normals=None), "geometry"),
    "texture coordinates": (moved(uvs=np.float32([(0, 0), (1, 0), (1, 1)])), "geometry"),
    "a vertex colour": (moved(colors=np.float32([(1, 1, 1), (1, 1, 1), (1, 1, 0)])), "geometry"),
    "one texel": (with_shape(0, material=wrt.Diffuse(texture(0.25))), "materials"),
    "the model, of the same number": (with_shape(1, material=wrt.Diffuse(0.5)), "materials"),
    "reflectance": (with_shape(1, material=wrt.Mirror(0.6)), "materials"),
    "one channel": (with_shape(1, material=wrt.Mirror((0.5, 0.5, 0.4))), "materials"),
    "emission": (with_shape(0, emission=(1.0, 0.5, 0.0)), "emission"),
    "two-sided": (with_shape(0, two_sided_emission=True), "emission"),
    "emission of another shape": (with_shape(1, emission=1.0), "emission"),
    "a light's place": (with_field("lights", [wrt.PointLight((0, 2, 1), intensity=3.0)]), "lights"),
    "a light's colour": (with_field("lights", [wrt.PointLight((0, 2, 0), intensity=(3, 3, 2))]), "lights"),
    "a light's kind": (with_field("lights", [wrt.DirectionalLight((0, 2, 0), 3.0)]), "lights"),
    "one light more": (lambda s: s.lights.append(wrt.DirectionalLight((0, -1, 0))), "lights"),
    "no environment": (with_field("environment", None), "environment"),
    "constant environment": (with_field("environment", wrt.ConstantEnvironment(1.0)), "environment"),
    "environment's pixels": (with_field("environment", environment(pixels=np.zeros((2, 4, 3)))), "environment"),
    "environment's shape": (with_field("environment", environment(pixels=np.ones((4, 2, 3)))), "environment"),
    "environment's rotation": (with_field("environment", environment(rotation_degrees=1.0)), "environment"),
    "environment's scale": (with_field("environment", environment(scale=2.0)), "environment"),
    "camera's place": (with_field("camera", camera(origin=(0, 1, 5.5))), "camera"),
    "camera's lens": (with_field("camera", camera(aperture_radius=0.1)), "camera"),
    "camera's shutter": (with_field("camera", camera(shutter_close=0.1)), "camera"),
    "camera's motion": (with_field("camera", camera(motion=wrt.Motion.translation((1, 0, 0)))), "camera"),
    "camera's kind": (with_field("camera", wrt.FisheyeCamera((0.0, 1.0, 5.0), fov_degrees=40.0)), "camera"),
    "field of view": (with_field("camera", camera(fov_degrees=41.5)), "camera"),
    "fog": (with_field("medium", wrt.Medium(0.1)), "medium"),
    "an interior": (with_shape(1, material=wrt.Dielectric(interior=wrt.Medium(0.1))), "materials"),
}


def test_equal_scenes_have_equal_digests() -> None:
    first = scene_fingerprint(scene())
    assert set(first) == PARTS
    assert scene_fingerprint(scene()) == first
    assert len(set(first.values())) == len(PARTS)


@pytest.mark.parametrize("name", CHANGES)
def test_one_change_shows_in_its_part_alone(name: str) -> None:
    change, part = CHANGES[name]
    changed = scene()
    change(changed)
    before, after = scene_fingerprint(scene()), scene_fingerprint(changed)
    assert {key for key in PARTS if before[key] != after[key]} == {part}


def test_every_part_is_tried() -> None:
    assert {part for _, part in CHANGES.values()} == PARTS


def test_order_of_shapes_counts() -> None:
    """Triangles are numbered in order, and ties go to the lowest number."""
    swapped = scene()
    swapped.shapes.reverse()
    assert scene_fingerprint(swapped)["geometry"] != scene_fingerprint(scene())["geometry"]


def test_moving_a_material_between_shapes_counts() -> None:
    swapped = scene()
    a, b = swapped.shapes
    swapped.shapes = [dataclasses.replace(a, material=b.material), dataclasses.replace(b, material=a.material)]
    before, after = scene_fingerprint(scene()), scene_fingerprint(swapped)
    assert {key for key in PARTS if before[key] != after[key]} == {"materials"}


def test_how_a_value_was_typed_does_not_count() -> None:
    typed = scene()
    typed.camera = wrt.PerspectiveCamera([0, np.float32(1), 5], np.zeros(3))  # type: ignore[arg-type]
    typed.lights = [wrt.PointLight(np.array([0.0, 2.0, 0.0]), intensity=[3, 3, 3])]  # type: ignore[arg-type]
    typed.shapes[1] = dataclasses.replace(typed.shapes[1], material=wrt.Mirror(np.float64(0.5)))
    assert scene_fingerprint(typed) == scene_fingerprint(scene())


def test_names_and_settings_do_not_count() -> None:
    renamed = scene()
    renamed.shapes[0] = dataclasses.replace(renamed.shapes[0], name="another")
    renamed.environment = environment(name="another")
    renamed.shapes[0] = dataclasses.replace(
        renamed.shapes[0], material=wrt.Diffuse(wrt.ImageTexture(texture().pixels, name="another"))
    )
    renamed.settings = wrt.RenderSettings(width=3, spp=7)
    assert scene_fingerprint(renamed) == scene_fingerprint(scene())


def test_digests_are_the_same_in_another_process() -> None:
    """A checkpoint outlives the process; Python's own hashes would not do."""
    root = Path(__file__).resolve().parent.parent
    code = (
        "import sys, json; sys.path[:0] = ['tests', '.']; from test_fingerprint import scene, scene_fingerprint; "
        "print(json.dumps(scene_fingerprint(scene())))"
    )
    environ = {**os.environ, "PYTHONHASHSEED": "12345"}
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=environ, capture_output=True, text=True, check=True
    )
    assert json.loads(run.stdout) == scene_fingerprint(scene())
