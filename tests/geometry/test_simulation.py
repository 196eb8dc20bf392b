"""Frames of a simulation: vertices on the device that move between pictures."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import ROOT
from support.covering_kernels import MATT_AND_METAL, rendering_with
from support.kernels import upload
from support.small_scenes import image_of

import wrt
from wrt.scene.normals import vertex_normals, with_normals

one_kernel = rendering_with(MATT_AND_METAL)


def hilly(height: float, *, smooth: bool = False) -> wrt.Mesh:
    """Return a sheet of 20 x 20 vertices with hills."""
    x, z = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20), indexing="ij")
    y = height * np.sin(4 * x) * np.cos(3 * z)
    i = np.arange(19)[:, None] * 20 + np.arange(19)
    faces = np.concatenate([np.stack([i, i + 1, i + 21], -1), np.stack([i, i + 21, i + 20], -1)]).reshape(-1, 3)
    mesh = wrt.Mesh(np.stack([x, y, z], -1).reshape(-1, 3), faces)
    return dataclasses.replace(mesh, normals=vertex_normals(mesh)) if smooth else mesh


def scene_of(mesh: wrt.Mesh) -> wrt.Scene:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 2, 3), (0, 0, 0)), environment=wrt.ConstantEnvironment(0.3))
    scene.add(wrt.box((-0.3, 0.3, -0.3), (0.3, 0.8, 0.3)), name="block")
    scene.add(mesh, material=wrt.Diffuse(0.8), name="sheet")
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=5.0, name="lamp")
    return scene


def renderer_of(mesh: wrt.Mesh, device: str) -> wrt.Renderer:
    return wrt.Renderer(scene_of(mesh), width=48, height=36, device=device, sampler="independent")


def fresh(mesh: wrt.Mesh, device: str) -> np.ndarray:
    return image_of(renderer_of(mesh, device), 4)


@pytest.mark.slow
@pytest.mark.parametrize(("smooth", "kind"), [(False, "numpy"), (True, "warp")])
def test_a_frame_is_the_picture_of_a_new_scene(smooth: bool, kind: str, device: str) -> None:
    start, end = hilly(0.1, smooth=smooth), hilly(0.25, smooth=smooth)
    renderer = renderer_of(start, device)
    first = image_of(renderer, 4)
    mesh = wrt.Mesh(upload(end.vertices, wp.vec3, device), upload(end.faces, wp.vec3i, device))
    np.testing.assert_array_equal(mesh.vertices, end.vertices)
    np.testing.assert_array_equal(mesh.faces, end.faces)
    renderer.update_vertices(1, end.vertices if kind == "numpy" else upload(end.vertices, wp.vec3, device))
    assert renderer.spp == 0
    moved = image_of(renderer, 4)
    assert np.abs(moved - first).max() > 0.1
    # Normals are computed in float32 here, and in float64 there; a few paths go other ways.
    same = np.isclose(moved, fresh(end, device), rtol=1e-3, atol=1e-4).all(axis=2)
    assert same.mean() > (0.99 if smooth else 0.999)
    renderer.update_vertices(renderer.scene.shapes[1], start.vertices)
    np.testing.assert_allclose(image_of(renderer, 4).mean(), first.mean(), rtol=1e-4)


def test_given_normals_are_taken(device: str) -> None:
    """Also for a flat mesh."""
    smooth, up = hilly(0.2, smooth=True), np.tile(np.float32([0, 1, 0]), (400, 1))
    renderer = renderer_of(hilly(0.2), device)
    flat = image_of(renderer, 4)
    renderer.update_vertices(1, smooth.vertices, smooth.normals)
    expected = fresh(smooth, device)
    assert np.abs(flat - expected).max() > 0.1
    np.testing.assert_array_equal(image_of(renderer, 4), expected)
    renderer.update_vertices(1, smooth.vertices, normals=up)
    np.testing.assert_array_equal(image_of(renderer, 4), fresh(dataclasses.replace(smooth, normals=up), device))


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_normals_follow_with_the_creases_that_there_were(device: str) -> None:
    # A cube with creases has each corner three times, with a normal for each side.
    cube = with_normals(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), 30.0)
    renderer = renderer_of(cube, device)
    turned = cube.rotated((1, 2, 3), 50.0)
    renderer.update_vertices(1, turned.vertices)
    first = len(renderer.scene.shapes[0].mesh.vertices)
    normals = renderer._built.data.normals.numpy()[first : first + len(cube.vertices)]
    np.testing.assert_allclose(normals, turned.normals, atol=1e-5)


def test_the_film_on_the_device_is_the_film(device: str) -> None:
    renderer = renderer_of(hilly(0.1), device)
    film = renderer.device_film()
    image = image_of(renderer, 4)
    on_device = renderer.device_image()
    assert on_device.device == wp.get_device(device)
    np.testing.assert_array_equal(on_device.numpy(), image)
    assert film["total"].dtype == wp.vec3d
    assert {array.shape for array in film.values()} == {(36, 48)}
    # The arrays were asked for before the pass: they are the film's own memory.
    assert all(array.ptr == getattr(renderer.film.data, name).ptr for name, array in film.items())
    mean = film["total"].numpy() / film["count"].numpy()[..., None]
    np.testing.assert_array_equal(mean.astype(np.float32), image)
    assert film["rays"].numpy().sum() == renderer.rays
    renderer.update_vertices(1, hilly(0.2).vertices)
    assert not film["count"].numpy().any()


@pytest.mark.parametrize("library", ["numpy", "array interface", "jax", "torch"])
def test_others_share_film_and_image_without_a_copy(library: str) -> None:
    renderer = renderer_of(hilly(0.1), "cpu")
    image = image_of(renderer, 4)
    on_device, total = renderer.device_image(), renderer.device_film()["total"]
    # The function that takes an array of Warp, and the one that returns the address of what it made of it.
    if library == "jax":
        jax = pytest.importorskip("jax")
        jax.config.update("jax_enable_x64", True)
        take, address = jax.dlpack.from_dlpack, lambda array: array.unsafe_buffer_pointer()
    elif library == "torch":
        take, address = pytest.importorskip("torch").from_dlpack, lambda array: array.data_ptr()
    else:
        take, address = np.from_dlpack if library == "numpy" else np.asarray, lambda array: array.ctypes.data
    for array, expected in ((on_device, image), (total, renderer.film.fetch("total").reshape(36, 48, 3))):
        shared = take(array)
        assert address(shared) == array.ptr
        assert shared.shape == (36, 48, 3)
        np.testing.assert_array_equal(np.asarray(shared), expected)


MESH = hilly(0.1)
NAN = np.where(np.arange(400)[:, None] == 7, np.float32(np.nan), MESH.vertices)


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize(
    ("shape", "vertices", "message"),
    [
        (1, MESH.vertices[:-1], "sheet: vertices are 399, but the mesh has 400"),
        (1, NAN, "sheet: vertex 7 is not finite"),
        (1, MESH.vertices + np.float32(2e12), r"sheet: vertex 0 is at 2e\+12 .*; rays reach to 1e\+12; scale it down"),
        ("sheet", MESH.vertices, "shape must be one of the scene's shapes, .* or its number, not str"),
        (1, "much", "sheet: vertices must be numbers"),
        (2, np.zeros((4, 3)), "lamp: vertices of an emitting shape cannot be updated.*"),
        (3, MESH.vertices, "shape must be between 0 and 2.*"),
        (wrt.Shape(MESH, name="other"), MESH.vertices, "other: not one of the scene's shapes.*"),
    ],
)
def test_mistakes_end_in_one_line(shape: Any, vertices: Any, message: str) -> None:
    with pytest.raises(wrt.InputError, match=f"^{message}$"):
        renderer_of(MESH, "cpu").update_vertices(shape, vertices)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_what_cannot_be_updated_or_saved(tmp_path: Path) -> None:
    renderer = renderer_of(MESH, "cpu")
    before = renderer._built.data.points.numpy()
    with pytest.raises(wrt.InputError, match="sheet: normal 7 is not finite"):
        renderer.update_vertices(1, 2.0 * MESH.vertices, normals=NAN)
    np.testing.assert_array_equal(renderer._built.data.points.numpy(), before)
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    renderer.update_vertices(1, MESH.vertices)
    with pytest.raises(wrt.InputError, match="no checkpoint of a picture whose vertices were updated"):
        renderer.save_checkpoint(tmp_path / "b.ckpt")
    scene = scene_of(MESH)
    scene.add(MESH, transform=wrt.Motion.translation((0, 1, 0)), name="moving")
    scene.camera = dataclasses.replace(scene.camera, shutter_close=1.0)
    with pytest.raises(wrt.InputError, match="can be updated in scenes without instances"):
        wrt.Renderer(scene, width=8, height=8).update_vertices(1, MESH.vertices)


@pytest.mark.slow
def test_the_example_renders_a_falling_cloth(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "cloth.py"), str(tmp_path), "--frames", "10", "--spp", "1"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([*command, "--size", "48x36"], check=True, env=environment, capture_output=True, timeout=300)
    first, last = (wrt.load_image(tmp_path / f"cloth-{frame:03d}.png") for frame in (0, 9))
    # The cloth is red, and has come down.
    heights = [np.nonzero(image[:, :, 0] > 2.0 * image[:, :, 1] + 0.02)[0].mean() for image in (first, last)]
    assert heights[1] > heights[0] + 2.0
