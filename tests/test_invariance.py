"""An image depends on scene, size, seed and sample count: bit for bit on nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wrt

OPTIONS = {"width": 40, "height": 24, "seed": 7}


@pytest.fixture
def scene() -> wrt.Scene:
    """Every material and light of the library in one small scene, with depth of field."""
    rng = np.random.default_rng(0)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(rng.uniform(0, 1, (8, 16, 3)).astype(np.float32)))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.5, 5.0), (0.0, 0.5, 0.0), aperture_radius=0.05)
    texture = wrt.ImageTexture(rng.uniform(0, 1, (4, 4, 3)).astype(np.float32))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(texture))
    scene.add(wrt.sphere((-1.2, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Dielectric())
    scene.add(wrt.sphere((0.0, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Conductor())
    scene.add(wrt.sphere((1.2, 0.5, 0.0), 0.5, subdivisions=3), material=wrt.Mirror(0.9))
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=5.0)
    scene.add_light(wrt.PointLight((2.0, 2.0, 2.0), intensity=1.0))
    scene.add_light(wrt.DirectionalLight((-1.0, -1.0, -1.0)))
    return scene


def image_of(renderer: wrt.Renderer, *targets: int) -> NDArray[np.float32]:
    for target in targets:
        for _ in renderer.passes(spp=target):
            pass
    return renderer.image()


def test_threads_do_not_matter(scene: wrt.Scene) -> None:
    one, two, seven = (image_of(wrt.Renderer(scene, threads=n, **OPTIONS), 16) for n in (1, 2, 7))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, seven)


def test_passes_do_not_matter(scene: wrt.Scene, device: str) -> None:
    at_once = wrt.Renderer(scene, device=device, **OPTIONS)
    at_once.device.launch(at_once._kernel.scalar, 40 * 24, [64, *at_once._inputs])
    singly = image_of(wrt.Renderer(scene, device=device, **OPTIONS), *range(1, 65))
    np.testing.assert_array_equal(at_once.image(), singly)


def test_slices_do_not_matter(scene: wrt.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = image_of(wrt.Renderer(scene, **OPTIONS), 4)
    monkeypatch.setattr("wrt.backend.slices.SLICES_PER_THREAD", 97)
    np.testing.assert_array_equal(whole, image_of(wrt.Renderer(scene, **OPTIONS), 4))


def test_stop_and_resume_do_not_matter(scene: wrt.Scene, device: str, tmp_path: Path) -> None:
    whole = image_of(wrt.Renderer(scene, device=device, **OPTIONS), 32)
    first = wrt.Renderer(scene, device=device, **OPTIONS)
    image_of(first, 5)
    first.save_checkpoint(tmp_path / "a.ckpt")
    second = wrt.Renderer.resume(tmp_path / "a.ckpt", scene, device=device)
    assert second.spp == 5
    image_of(second, 11)
    second.save_checkpoint(tmp_path / "a.ckpt")
    np.testing.assert_array_equal(
        whole, image_of(wrt.Renderer.resume(tmp_path / "a.ckpt", scene, device=device, threads=1), 32)
    )


def test_an_interrupted_pass_goes_on_where_it_was(scene: wrt.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some pixels then have more samples than others; each continues from its own count."""
    import warp as wp

    whole = image_of(wrt.Renderer(scene, **OPTIONS), 8)
    renderer = wrt.Renderer(scene, threads=2, **OPTIONS)
    image_of(renderer, 3)
    launch, launches = wp.launch, []

    def interrupted(*args: object, **kwargs: object) -> None:
        launches.append(1)
        if len(launches) == 5:
            raise KeyboardInterrupt
        launch(*args, **kwargs)

    monkeypatch.setattr(wp, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        image_of(renderer, 8)
    monkeypatch.setattr(wp, "launch", launch)
    assert renderer.spp == 3
    assert renderer.film.counts.max() > 3
    np.testing.assert_array_equal(whole, image_of(renderer, 8))


def test_seeds_matter(scene: wrt.Scene, device: str) -> None:
    options = {**OPTIONS, "seed": 8}
    assert (image_of(wrt.Renderer(scene, device=device, **OPTIONS), 2)
            != image_of(wrt.Renderer(scene, device=device, **options), 2)).any()  # fmt: skip
