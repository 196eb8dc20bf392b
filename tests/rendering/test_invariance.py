"""An image depends on scene, size, seed and sample count: bit for bit on nothing else."""

import numpy as np
import pytest
from support.small_scenes import block_scene, finish, image_of

import wrt


@pytest.fixture(scope="module", params=["block", pytest.param("everything", marks=pytest.mark.slow)])
def make(request):
    """Return a function that makes renderers of a block, or of every kind of material and light, out of focus."""
    scene = block_scene() if request.param == "block" else everything()
    scene.camera = wrt.PerspectiveCamera((0.0, 1.5, 5.0), (0.0, 0.5, 0.0), aperture_radius=0.05)

    def renderer(**options):
        return wrt.Renderer(scene, **{"width": 40, "height": 24, "seed": 7, "filter": "tent", **options})

    return renderer


def everything():
    rng = np.random.default_rng(0)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(rng.uniform(0, 1, (8, 16, 3)).astype(np.float32)))
    texture = wrt.ImageTexture(rng.uniform(0, 1, (4, 4, 3)).astype(np.float32))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(texture))
    for x, material in ((-1.2, wrt.Dielectric()), (0.0, wrt.Conductor()), (1.2, wrt.Mirror(0.9))):
        scene.add(wrt.sphere((x, 0.5, 0.0), 0.5, subdivisions=3), material=material)
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=5.0)
    scene.add_light(wrt.PointLight((2.0, 2.0, 2.0), intensity=1.0))
    scene.add_light(wrt.DirectionalLight((-1.0, -1.0, -1.0)))
    return scene


@pytest.fixture(scope="module")
def expected(make):
    return image_of(make(), 16)


def test_threads_slices_and_seeds(make, expected, monkeypatch):
    for threads in (1, 2, 7):
        np.testing.assert_array_equal(image_of(make(threads=threads), 16), expected)
    assert (image_of(make(seed=8), 16) != expected).any()
    monkeypatch.setattr("wrt.slices.SLICES_PER_THREAD", 97)
    np.testing.assert_array_equal(image_of(make(), 16), expected)


def test_passes_do_not_matter(make, device):
    at_once = make(device=device)
    at_once.device.launch(at_once._kernel.scalar, 40 * 24, [64, *at_once._inputs])
    np.testing.assert_array_equal(at_once.image(), image_of(make(device=device), *range(1, 65)))


def test_stop_and_resume_do_not_matter(make, device, tmp_path):
    first = make(device=device)
    for spp, options in ((5, {}), (11, {"threads": 1})):
        finish(first, spp).save_checkpoint(tmp_path / "a.ckpt")
        first = wrt.Renderer.resume(tmp_path / "a.ckpt", first.scene, device=device, **options)
        assert (first.spp, first.settings.filter) == (spp, "tent")
    np.testing.assert_array_equal(image_of(first, 16), image_of(make(device=device), 16))


def test_an_interrupted_pass_goes_on_where_it_was(make, expected, monkeypatch):
    """Some pixels then have more samples than others; each continues from its own count."""
    renderer = finish(make(threads=2), 3)
    backend = renderer.device.backend
    launch, launches = backend.launch, []

    def interrupted(*args, **kwargs):
        launches.append(1)
        if len(launches) == 5:
            raise KeyboardInterrupt
        launch(*args, **kwargs)

    monkeypatch.setattr(backend, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        finish(renderer, 16)
    monkeypatch.setattr(backend, "launch", launch)
    assert renderer.spp == 3
    assert renderer.film.counts.max() > 3
    np.testing.assert_array_equal(image_of(renderer, 16), expected)
