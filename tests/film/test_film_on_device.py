"""Passes count samples on the device: the host fetches the film only for a picture."""

import gc
import weakref

import numpy as np
import pytest
import warp as wp
from support.device_memory import allocations, memory_of
from support.emulated_cuda.backend import emulated_cuda

import wrt
from wrt.backend.device import Device
from wrt.rendering.film import Film

GPU = "cuda:0"
WIDTH, HEIGHT = 96, 64
RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def gpu():
    with emulated_cuda(optimization=0) as backend:
        yield backend


@pytest.fixture
def fetched(gpu, monkeypatch):
    """Return a list that gets the size of each array that the host reads, and whether `fetch` reads it."""
    reads, numpy, fetch, inside = [], wp.array.numpy, type(gpu).fetch, []

    def by_fetch(self, array, **how):
        inside.append(True)
        try:
            return fetch(self, array, **how)
        finally:
            inside.pop()

    monkeypatch.setattr(type(gpu), "fetch", by_fetch)
    monkeypatch.setattr(wp.array, "numpy", lambda array: reads.append((array.capacity, bool(inside))) or numpy(array))
    return reads


def renderer_of(width=WIDTH, height=HEIGHT):
    """Return a renderer of a floor under a lamp: most of the picture is dark, and little of it is noisy."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 2, 5), (0, 0, 0)))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)))
    scene.add(wrt.sphere((0, 1, 0), 0.5, subdivisions=2))
    scene.add_light(wrt.RectangleLight((-0.5, 3, -0.5), (1, 0, 0), (0, 0, 1), radiance=8.0))
    return wrt.Renderer(scene, width=width, height=height, device=GPU)


@pytest.mark.machinery
def test_passes_fetch_no_film_and_wait_for_no_other_stream(fetched):
    """`wp.array.numpy` waits for all streams of a GPU; a frame reads numbers only by `fetch`, which waits for one."""
    renderer = renderer_of()
    vertices = renderer.scene.shapes[1].mesh.vertices
    fetched.clear()
    renderer.update_vertices(1, vertices)
    done = list(renderer.passes(spp=6))
    renderer.film.snapshot()
    renderer.device_image()
    assert done[-1].spp == renderer.spp == 6
    assert done[-1].noise is not None
    assert done[-1].rays_per_second > 0.0
    assert all(by_fetch for _, by_fetch in fetched)
    # A number for each row, and four for every 256 pixels.
    assert max(fetched)[0] <= 8 * 4 * (WIDTH * HEIGHT // 256) + 8 * HEIGHT < 4 * WIDTH * HEIGHT
    fetched.clear()
    renderer.image()
    tally = 8 * 4 * (WIDTH * HEIGHT // 256)
    assert sorted(size for size, _ in fetched) == [tally, 4 * WIDTH * HEIGHT, 24 * WIDTH * HEIGHT]


@pytest.mark.machinery
def test_later_passes_take_no_memory_of_a_gpu(gpu):
    """They release none either: a GPU would finish all work of all streams first."""
    renderer = renderer_of(24, 16)
    passes = renderer.passes(spp=40, pass_seconds=1e-9)
    for _ in range(3):
        next(passes)
        renderer.film.snapshot()()
    with allocations() as counted:
        for progress in passes:
            image = renderer.film.snapshot()()
            assert renderer.film.tally().samples == progress.spp * renderer.film.pixels
            assert progress.noise == renderer.film.noise()
    assert counted.peak == 0
    assert progress.pass_index > 10
    np.testing.assert_array_equal(image, renderer.image())


def test_snapshots_that_are_still_needed_keep_their_picture(gpu):
    film = Film(20, 10, Device(GPU))
    film.data.count.numpy()[:] = 1  # the emulated GPU's memory
    snapshots = []
    for value in (1.0, 2.0, 3.0):
        film.data.total.numpy()[:] = value
        snapshots.append(film.snapshot())
    assert [float(each().mean()) for each in snapshots] == [1.0, 2.0, 3.0]
    first = snapshots[0]()
    with allocations() as counted:
        for freed, value in ((0, 4.0), (1, 5.0)):
            snapshots[freed] = None  # frees the image of one
            film.data.total.numpy()[:] = value
            snapshots[freed] = film.snapshot()
    assert counted.peak == 0
    assert [float(each().mean()) for each in snapshots] == [4.0, 5.0, 3.0]
    assert (first == 1.0).all()


@pytest.mark.parametrize("place", ["cpu", GPU])
def test_the_film_on_the_device_outlives_its_renderer(place, gpu):
    film = Film(20, 10, Device(place))
    counts = film.data.count
    owner = weakref.ref(memory_of(counts.rows) if place == "cpu" else counts)
    del counts
    shared = film.on_device()
    del film
    gc.collect()
    assert owner() is not None
    del shared
    gc.collect()
    assert owner() is None


@pytest.mark.parametrize("size", [(1, 1), (257, 1), (40, 33)])
@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_counts_are_those_of_the_host(size, share, gpu):
    film, pixels = Film(*size, Device(GPU)), size[0] * size[1]
    count = RNG.integers(0, 2**31 - 1, pixels, dtype=np.int32)
    rays = RNG.integers(0, 2**40, pixels, dtype=np.int64)
    film.data.count.numpy()[:] = count
    film.data.rays.numpy()[:] = rays
    chosen = RNG.random(pixels) < share
    chosen[RNG.integers(pixels)] = True
    for some in (chosen, None):
        of = slice(None) if some is None else some
        expected = (count[of].sum(dtype=np.int64), rays[of].sum(), count[of].min(), count[of].max())
        tally = film.tally(some)
        assert (tally.samples, tally.rays, tally.least, tally.most) == expected


@pytest.mark.parametrize("place", ["cpu", GPU])
def test_hidden_pixels_take_no_samples_and_keep_their_own(place, gpu):
    film = Film(20, 10, Device(place))
    counts = RNG.integers(0, 9, 200, dtype=np.int32)
    film.data.count.numpy()[:] = counts
    first, second = RNG.random((2, 200)) < 0.4
    for hidden in (first, second, second, first):
        with film.leaving_out(hidden, 50):
            np.testing.assert_array_equal(film.fetch("count"), np.where(hidden, 50, counts))
        np.testing.assert_array_equal(film.fetch("count"), counts)
    with pytest.raises(KeyboardInterrupt), film.leaving_out(first, 50):
        raise KeyboardInterrupt
    np.testing.assert_array_equal(film.fetch("count"), counts)
