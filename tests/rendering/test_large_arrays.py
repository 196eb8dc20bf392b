"""Kernels read the last elements of arrays of many gigabytes, whose pages stay mostly unused; larger ones are refused.

The arrays have as many elements as 32 bits can number. What is stored at their ends is looked up, and must be the same
as from small arrays, bit for bit.
"""

import contextlib
import mmap
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from support.emulated_cuda.backend import emulated_cuda

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.ray_batch import RayBatch, trace_interleaved, trace_packets, trace_rays
from wrt.kernels.core.ray_tree import Bvh
from wrt.kernels.core.scene_data import ImageRecord, SceneData
from wrt.kernels.native.constants import LEAF_FLOATS, NODE_FLOATS, PACKET, RAYS_PER_THREAD
from wrt.kernels.textures.textures import image_color
from wrt.upload.accel.geometry import upload_triangles
from wrt.upload.arrays import MOST_ELEMENTS, require_countable
from wrt.upload.textures.texels import Texels

GPU = "cuda:0"
RNG = np.random.default_rng(4)


@pytest.fixture(
    scope="module",
    params=[pytest.param("cpu", marks=pytest.mark.slow), pytest.param("emulated", marks=pytest.mark.machinery)],
)
def place(request):
    """The CPU, and an emulated GPU, whose memory is the CPU's."""
    with emulated_cuda(optimization=0) if request.param == "emulated" else contextlib.nullcontext():
        yield Device("cpu" if request.param == "cpu" else GPU)


def sparse(count, kind, device):
    """Return an array of zeros that takes memory only where it is written to, in NumPy and in Warp."""
    number = wp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind))
    width = getattr(kind, "_length_", 1)
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | getattr(mmap, "MAP_NORESERVE", 0x4000)  # since Python 3.13
    try:
        memory = mmap.mmap(-1, count * width * np.dtype(number).itemsize, flags=flags)
    except OSError:
        pytest.skip("the system gives no such address space")
    rows = np.frombuffer(memory, number).reshape((count, width) if width > 1 else count)
    return rows, wp.array(rows, dtype=kind, device=device.name, copy=False)


def moved_to_the_end(tree, device):
    """Return the same tree in the largest arrays, whose root is the first node and all others are the last ones."""
    nodes = tree.nodes.numpy().reshape(-1, NODE_FLOATS).copy()
    leaves = tree.leaves.numpy().reshape(-1, LEAF_FLOATS)
    most = MOST_ELEMENTS // NODE_FLOATS, MOST_ELEMENTS // LEAF_FLOATS
    offsets = [count - len(rows) for count, rows in zip(most, (nodes, leaves), strict=True)]
    children = nodes[:, 48:].view(np.int32)
    children[...] = np.where(
        children > 0, children + offsets[0], np.where(children < 0, children - offsets[1], children)
    )
    end, moved = Bvh(), []
    for count, rows, first in zip(most, (nodes, leaves), offsets, strict=True):
        numbers, array = sparse(count * rows.shape[1], wp.float32, device)
        numbers[: rows.size] = rows.ravel()  # the root, and others that nothing leads to
        numbers[rows.shape[1] * first :] = rows.ravel()
        moved.append(array)
    end.nodes, end.leaves = moved
    return end


def hits(tree, kernel, each, rays, device):
    batch, n, name = RayBatch(), len(rays), device.name
    batch.origins, batch.directions = (wp.array(rays[:, k], dtype=wp.vec3, device=name) for k in (0, 1))
    batch.t_max = wp.array([np.inf], dtype=float, device=name)
    batch.triangle_out, batch.t_out = (wp.zeros(n, dtype=kind, device=name) for kind in (int, float))
    batch.uv_out = wp.zeros(n, dtype=wp.vec2, device=name)
    device.launch(kernel, -(-n // each), [tree, batch])
    return [array.numpy() for array in (batch.triangle_out, batch.t_out, batch.uv_out)]


def test_rays_through_the_largest_tree(place):
    kernels = [(trace_rays, 1), (trace_packets, PACKET), (trace_interleaved, RAYS_PER_THREAD)]
    small = wrt.Intersector(wrt.sphere(subdivisions=3), device=place.name)._built.data
    large = moved_to_the_end(small, place)
    assert min(large.nodes.size, large.leaves.size) * 4 > 8_580_000_000
    targets = RNG.uniform(-1.2, 1.2, (512, 3))
    origins = targets + 3.0 * RNG.normal(size=3)
    rays = np.stack([origins, targets - origins], axis=1).astype(np.float32)
    for kernel, each in kernels if place.is_cpu else kernels[:1]:
        expected, found = (hits(tree, kernel, each, rays, place) for tree in (small, large))
        assert 100 < (expected[0] >= 0).sum() < 500
        for a, b in zip(expected, found, strict=True):
            np.testing.assert_array_equal(a, b)


@wp.kernel(enable_backward=False)
def look_up(
    first: int, scene: SceneData, image: ImageRecord, places: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec3)
):
    """Read an image at some places."""
    i = first + wp.tid()
    out[i] = image_color(scene, image, places[i])


@pytest.mark.parametrize("coded", [False, True])
def test_the_last_texels_of_the_largest_textures(coded, place):
    width, height = 30, 20
    pixels = RNG.random((width * height, 3)).astype(np.float32)
    codes = RNG.integers(0, 2**24, width * height, dtype=np.uint32)
    places = RNG.uniform(-1.0, 2.0, (256, 2)).astype(np.float32)
    found = []
    for count in (width * height, MOST_ELEMENTS):
        scene, image = SceneData(), ImageRecord()
        rows, texels = sparse(count, wp.uint32 if coded else wp.vec3, place)
        rows[-width * height :] = codes if coded else pixels
        if coded:
            scene.texel_codes = texels
            scene.palettes = wp.array(np.linspace(0, 1, 768, dtype=np.float32), dtype=float, device=place.name)
        else:
            scene.texels = texels
        image.first, image.width, image.height, image.palette = count - width * height, width, height, coded - 1
        image.to_u, image.to_v = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        out = wp.zeros(len(places), dtype=wp.vec3, device=place.name)
        inputs = [scene, image, wp.array(places, dtype=wp.vec2, device=place.name), out]
        place.launch(look_up, len(places), inputs)
        found.append(out.numpy())
    assert np.ptp(found[0]) > 0.2
    np.testing.assert_array_equal(*found)


MESH = SimpleNamespace(vertices=range(2**30), faces=range(2**20))
FACES = SimpleNamespace(vertices=range(3), faces=range(2**29))
TEXTURE = np.broadcast_to(np.zeros(3, np.float32), (2**15, 2**15, 3))
ROOM = wrt.Scene([wrt.Shape(wrt.box())], environment=wrt.ConstantEnvironment(1.0))


def test_larger_arrays_are_refused():
    """By their shapes alone: the arrays hold one element, or none."""
    for make, message in (
        (lambda: Texels([TEXTURE, TEXTURE]), r"^2,147,483,648 texels of the scene's textures are more than the"),
        (
            lambda: upload_triangles([MESH, MESH], [MESH], np.zeros(1, np.int64), "cpu"),
            "^2,147,483,648 vertices of the scene are more than",
        ),
        (
            lambda: upload_triangles([FACES], [FACES, FACES], np.zeros(2, np.int64), "cpu"),
            "^3,221,225,472 corners of the scene's triangles are more than",
        ),
        (lambda: wrt.Renderer(ROOM, width=65_536, height=32_768), r"more than the 2\^31 pixels"),
        (
            lambda: require_countable(MOST_ELEMENTS + 1, "things"),
            "^2,147,483,648 things are more than the 2,147,483,647 that kernels",
        ),
    ):
        require_countable(MOST_ELEMENTS, "things")
        with pytest.raises(wrt.InputError, match=message):
            make()
