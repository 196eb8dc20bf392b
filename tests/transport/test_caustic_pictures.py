"""Pictures with caustics by photons: their bits, changes of the scene, hints, and what is refused."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.caustic_scenes import SCENES, ball, block, floor, lamp, moving, scene_of
from support.small_scenes import finish, image_of

import wrt
from wrt.cli import main
from wrt.errors import Hint
from wrt.rendering.part import Part

Array = NDArray[np.floating[Any]]

SPP = 10
"""More samples than gather the same photons, where bits are compared."""


def renderer(**options: Any) -> wrt.Renderer:
    options = {"width": 24, "height": 16, "seed": 3, "caustics": True, "max_depth": 10, **options}
    return wrt.Renderer(SCENES["block"](), **options)


@pytest.fixture(scope="module")
def expected() -> Array:
    image: Array = image_of(renderer(), SPP)
    return image


def test_threads_slices_passes_and_seeds(expected: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    np.testing.assert_array_equal(image_of(renderer(threads=3), SPP), expected)
    np.testing.assert_array_equal(image_of(renderer(), 1, 2, 5, SPP), expected)
    assert (image_of(renderer(seed=4), SPP) != expected).any()
    monkeypatch.setattr("wrt.slices.SLICES_PER_THREAD", 97)
    np.testing.assert_array_equal(image_of(renderer(), SPP), expected)


def test_crops_parts_and_resumed_pictures(expected: Array, tmp_path: Path) -> None:
    cropped = image_of(renderer(crop=(5, 3, 17, 12)), SPP)
    np.testing.assert_array_equal(cropped, expected[3:12, 5:17])
    finish(renderer(), 4).save_checkpoint(tmp_path / "a.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "a.ckpt", SCENES["block"]())
    assert resumed.settings.caustics
    np.testing.assert_array_equal(image_of(resumed, SPP), expected)
    parts: list[Part] = [renderer().part(number, 2, spp=SPP) for number in (1, 2)]
    np.testing.assert_array_equal(wrt.merge(parts).image(), expected)
    with pytest.raises(wrt.InputError, match="caustics"):
        renderer(caustics=False).load_checkpoint(tmp_path / "a.ckpt")


def test_an_interrupted_pass_goes_on_where_it_was(expected: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    half = renderer(threads=2)
    backend = half.device.backend
    launch, launches = backend.launch, itertools.count()

    def interrupted(*args: Any, **kwargs: Any) -> None:
        if next(launches) == 40:
            raise KeyboardInterrupt
        launch(*args, **kwargs)

    monkeypatch.setattr(backend, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        finish(half, SPP)
    monkeypatch.setattr(backend, "launch", launch)
    assert half.film.counts.min() < SPP
    np.testing.assert_array_equal(image_of(half, SPP), expected)


def test_pixels_that_stop_before_others(expected: Array) -> None:
    """Those of an adaptive render have the samples of their counts."""
    adaptive = renderer(width=64, height=32)
    finish(adaptive, noise=0.25, adaptive=True)
    counts = adaptive.film.counts
    for count in np.unique(counts):
        whole = image_of(renderer(width=64, height=32), int(count))
        np.testing.assert_array_equal(adaptive.image()[counts == count], whole[counts == count])


def test_another_camera_and_a_shared_scene(expected: Array) -> None:
    moved = finish(renderer(), 2)
    moved.set_camera(wrt.PerspectiveCamera((0.0, 5.0, 4.0), (0.0, 0.3, 0.0)))
    moved.set_camera(SCENES["block"]().camera)
    np.testing.assert_array_equal(image_of(moved, SPP), expected)
    np.testing.assert_array_equal(image_of(moved.sharing(), SPP), expected)
    plain = moved.sharing(caustics=False)
    np.testing.assert_array_equal(image_of(plain, SPP), image_of(renderer(caustics=False), SPP))
    with pytest.raises(wrt.InputError, match="make a new Renderer"):
        plain.sharing(caustics=True).sharing(caustics=True)
    assert image_of(moved.sharing(integrator="aov", layers=("object",)), 1).shape == expected.shape  # as views do


def test_vertices_that_move_take_the_photons_along() -> None:
    """Also beyond the box of the scene that was built, and what throws a shadow there."""

    def make(lift: float) -> wrt.Renderer:
        scene = scene_of(floor(), block(wrt.Dielectric(), 0.4 + lift), wrt.DirectionalLight((0.2, -1.0, 0.1), 3.0))
        scene.add(wrt.box((-0.5, 2.0 + 3.0 * lift, -0.5), (0.0, 2.1 + 3.0 * lift, 0.5)), material=wrt.Diffuse(0.5))
        return wrt.Renderer(scene, width=24, height=16, caustics=True, max_depth=10)

    updated, fresh = make(0.0), make(0.7)
    for shape in (1, 2):
        updated.update_vertices(shape, fresh.scene.shapes[shape].mesh.vertices)
    image = image_of(fresh, 8)
    np.testing.assert_allclose(image_of(updated, 8).mean(), image.mean(), rtol=1e-3)
    assert abs(image_of(make(0.0), 8).mean() / image.mean() - 1.0) > 0.01


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_caustics_that_no_path_finds_are_told(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    def hints(*parts: wrt.Shape | wrt.Light, **options: Any) -> int:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            wrt.Renderer(scene_of(floor(), lamp(), *parts), **{"width": 8, "height": 6, **options})
        return sum(issubclass(each.category, Hint) for each in caught)

    point, glass = wrt.PointLight((0.0, 3.0, 0.0), power=1.0), ball()
    assert hints(glass, point) == hints(ball(wrt.Mirror()), wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0)) == 1
    for silent in ((glass,), (point,), (ball(wrt.ThinDielectric()), point), (ball(wrt.RoughDielectric()), point)):
        assert hints(*silent) == 0
    assert hints(glass, wrt.DirectionalLight((0.0, -1.0, 0.0), 1.0, angle_degrees=5.0)) == 0
    for option in ({"caustics": True}, {"integrator": "direct"}):
        assert hints(glass, point, **option) == 0
    wrt.save_scene(tmp_path / "a.toml", scene_of(floor(), glass, point))
    command = f"render {tmp_path}/a.toml --size 8x6 --spp 1 -o {tmp_path}"
    for more, count in (("a.png", 1), ("b.png --quiet", 0), ("c.gif --turntable 2", 1)):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            assert main(f"{command}/{more}".split()) == 0
        assert capfd.readouterr().err.count("wrt: hint: lights without a size") == count


# --- What it refuses -------------------------------------------------------------------------------


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_what_cannot_be_rendered_is_said_before() -> None:
    for name in ("direct", "whitted", "ao", "aov"):
        with pytest.raises(wrt.InputError, match=f"integrator '{name}' cannot render caustics by photons"):
            renderer(integrator=name)
    with pytest.raises(wrt.InputError, match="have no derivatives"):
        renderer().gradients(np.ones((16, 24, 3)))
    caught = moving()
    caught.shapes[0] = dataclasses.replace(caught.shapes[0], shadow_catcher=True)
    with pytest.raises(wrt.InputError, match="on shadow catchers have no motion blur"):
        wrt.Renderer(caught, caustics=True)
    sunk = block(wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 0.2, 0.1))))
    for height in (0.9, 2.5):
        bulb = wrt.Shape(wrt.sphere((0.0, height, 0.0), 0.1), wrt.Diffuse(0.0), emission=1.0)
        for light in (wrt.PointLight((0.0, height, 0.0), power=1.0), bulb):
            refused = pytest.raises(wrt.InputError, match="lies inside another body")
            with refused if height < 2.0 else contextlib.nullcontext():
                wrt.Renderer(scene_of(floor(), sunk, light), width=4, height=4, caustics=True)
    with pytest.warns(UserWarning, match="no surface is a mirror"):
        without = wrt.Renderer(scene_of(floor(), lamp()), width=4, height=4, caustics=True)
    assert without._photons is None
