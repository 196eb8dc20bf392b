"""The memory of a picture on a device is predicted, that which is left found, and what does not fit refused."""

import contextlib
import dataclasses
import os
import re
import resource

import numpy as np
import pytest
import warp as wp
from support.commands import run
from support.device_memory import allocations
from support.emulated_cuda.backend import emulated_cuda
from support.ray_trees import mesh_of, slivers

import wrt
from wrt.backend import current_backend
from wrt.backend.cuda.gpus import CudaVersions
from wrt.backend.device import Device
from wrt.backend.memory import memory_left
from wrt.cli import main
from wrt.errors import NotEnoughMemory
from wrt.gradients.backward import Backward
from wrt.memory_needed import DeviceMemory, device_memory, memory_text

GPU = "cuda:0"
RNG = np.random.default_rng(3)
BALL = wrt.sphere(subdivisions=5)


def scene_of(*shapes, **settings):
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 2, 6)), environment=wrt.ConstantEnvironment(1.0))
    scene.shapes += shapes
    return dataclasses.replace(scene, settings=wrt.RenderSettings(width=64, height=48, **settings))


def textured():
    coarse = RNG.integers(0, 256, (512, 512, 3)).astype(np.float32) / np.float32(255.0)
    fine = RNG.random((300, 200, 3)).astype(np.float32)
    paint = wrt.Principled(base_color=wrt.ImageTexture(coarse), roughness=wrt.ImageTexture(fine, channel="g"))
    return scene_of(wrt.Shape(dataclasses.replace(BALL, uvs=BALL.vertices[:, :2]), paint))


def forest():
    tree, floor = wrt.sphere(subdivisions=4), wrt.quad((-9, -1, -9), (18, 0, 0), (0, 0, 18))
    places = [np.eye(4) + np.pad([[x], [0], [z]], ((0, 1), (3, 0))) for x in range(-9, 9) for z in range(-9, 9)]
    return scene_of(wrt.Shape(floor), *(wrt.Shape(tree, transform=place) for place in places))


def deforming():
    keys = np.stack([BALL.vertices, BALL.vertices * 1.2, BALL.vertices * (1.0, 1.5, 1.0)])
    scene = scene_of(wrt.Shape(BALL, deformation=wrt.Deformation((0.0, 0.5, 1.0), keys)))
    scene.camera = wrt.PerspectiveCamera((0, 2, 6), shutter_close=1.0)
    return scene


def cloudy():
    cloud = wrt.DensityGrid(RNG.random((60, 50, 70)).astype(np.float32), albedo=RNG.random((20, 20, 20, 3)))
    scene = scene_of(wrt.Shape(wrt.box(), wrt.Null(interior=wrt.Medium(scattering=1.0, density=cloud))))
    scene.environment = wrt.ImageEnvironment(RNG.random((256, 512, 3)).astype(np.float32))
    return scene


SCENES = {
    "a ball": lambda: scene_of(wrt.Shape(BALL)),
    "textures": textured,
    "lights": lambda: scene_of(wrt.Shape(BALL, emission=1.0), wrt.Shape(wrt.box())),
    "instances": forest,
    "deforming": deforming,
    "a cloud and an image": cloudy,
    "layers": lambda: scene_of(wrt.Shape(wrt.box()), layers=("albedo", "normal", "depth", "uv", "crypto_object")),
    "a shadow catcher": lambda: scene_of(
        wrt.Shape(BALL), wrt.Shape(wrt.quad((-9, -1, 9), (18, 0, 0), (0, 0, -18)), shadow_catcher=True)
    ),
}
QUICK = ("a ball", "a cloud and an image")


@pytest.fixture
def gpu():
    with emulated_cuda(optimization=0) as backend:
        yield backend


@pytest.mark.machinery
@pytest.mark.usefixtures("render_kernels_when_launched")
def test_a_scene_is_refused_before_anything_is_taken_if_a_byte_is_missing(gpu, monkeypatch):
    scene = SCENES["a ball"]()
    memory = device_memory(scene)
    to_build = memory.peak - memory.film
    monkeypatch.setattr(type(gpu), "memory_of", lambda *_: to_build - 1)
    with allocations() as counted, pytest.raises(NotEnoughMemory) as caught:
        wrt.Renderer(scene, device=GPU)
    assert counted.peak <= memory.film
    assert str(caught.value) == (
        f"building a scene of {len(BALL.faces):,} triangles needs {to_build / 1e9:.1f} GB, more than the "
        f"{to_build / 1e9:.1f} GB that {GPU} has left; 'wrt info --memory SCENE' says what takes it"
    )
    monkeypatch.setattr(type(gpu), "memory_of", lambda *_: to_build)
    assert wrt.Renderer(scene, device=GPU).spp == 0


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_changing_values_takes_what_is_foretold_or_is_refused(monkeypatch):
    """Codes of texels become numbers, and equal images no longer share them."""
    codes = RNG.integers(0, 256, (100, 80, 3)).astype(np.float32) / np.float32(255.0)
    paints = [wrt.Diffuse(wrt.ImageTexture(codes.copy(), filter="trilinear")) for _ in range(3)]
    bumps = wrt.Diffuse(normal_map=wrt.NormalMap(np.full((40, 40, 3), (0.5, 0.5, 1.0), np.float32)))
    quad = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    scene = scene_of(*(wrt.Shape(quad, material) for material in (*paints, bumps)))
    scene.environment = wrt.ImageEnvironment(RNG.random((16, 32, 3)).astype(np.float32))
    memory = device_memory(scene, device="cpu")
    renderer = wrt.Renderer(scene)
    monkeypatch.setattr("wrt.backend.device.memory_left", lambda: memory.editing - 1)
    with pytest.raises(NotEnoughMemory, match="storing each texel of the images as a value that can change needs"):
        renderer.set_parameters({})
    monkeypatch.setattr("wrt.backend.device.memory_left", lambda: memory.editing)
    renderer.set_parameters({})
    assert renderer._built.data.texels.rows.nbytes == memory.editing
    backward = Backward(renderer)
    counted = 24 * sum(backward._counts().values()) + 12 * 64 * 48
    assert memory.gradients == pytest.approx(counted, rel=0.01)
    monkeypatch.setattr("wrt.backend.device.memory_left", lambda: counted - 1)
    with pytest.raises(NotEnoughMemory, match="adding up derivatives needs"):
        backward.run(np.ones((48, 64, 3)), 1, 0)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_the_builder_on_the_cpu_is_counted(monkeypatch):
    monkeypatch.setattr("wrt.upload.scene_data.WORTH_ASKING", 0)
    monkeypatch.setattr("wrt.backend.device.memory_left", lambda: 1_000_000)
    with pytest.raises(NotEnoughMemory, match=r"building a scene of 20,480 triangles needs 0\.0 GB"):
        wrt.Renderer(SCENES["a ball"](), width=8, height=8)


def test_memory_that_runs_out_on_the_way_is_one_line(monkeypatch, tmp_path, capsys):
    def fail(*_, **__):
        raise MemoryError

    monkeypatch.setattr("wrt.backend.arrays.LARGE", 2000)
    monkeypatch.setattr("wrt.backend.arrays.zeros", fail)
    assert main(["render", "cornell-box", "--size", "8x8", "--spp", "1", "-o", str(tmp_path / "a.png")]) == 1
    assert capsys.readouterr().err.startswith("wrt: error: memory ran out on cpu: 0.00 GB more were needed;")


def test_the_command_lists_the_parts_and_whether_they_fit(monkeypatch, capsys):
    assert main(["info", "still-life", "--memory", "--size", "1000x500"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "memory of a picture of 1000x500 on a GPU"
    assert ["film", "32.0", "MB"] in [line.split() for line in lines]
    assert any(line.startswith("  at most") and "while the ray tree is built" in line for line in lines)
    memory = DeviceMemory(1, 2, 0, 4, 10**9, 6, 3 * 10**9, 4 * 10**9, 5 * 10**9, 0, 0)
    with emulated_cuda() as gpu:
        for free, verdict in ((4 * 10**9, "4.00 GB free: enough"), (4 * 10**9 - 1, "4.00 GB free: not enough")):
            monkeypatch.setattr(type(gpu), "memory_of", lambda *_, free=free: free)
            assert memory_text(memory, 3, 4).splitlines()[-1] == f"  cuda:0    {verdict}"
    assert "materials" not in memory_text(memory, 3, 4)


@pytest.fixture
def have(monkeypatch):
    """Return a function that sets the CUDA version of the driver and the number of GPUs."""
    Device("cpu")
    backend = type(current_backend())

    def have(driver, count):
        monkeypatch.setattr(backend, "cuda_versions", lambda _: CudaVersions((13, 4), driver, (13, 0)))
        monkeypatch.setattr(backend, "gpus", lambda _: count)

    return have


NONE = "no NVIDIA driver was found"
OLD = "the NVIDIA driver is too old, for CUDA 12.8 instead of 13.0"


def test_a_gpu_that_cannot_be_had_is_one_line(have, capsys):
    for driver, count, name, message in (
        (None, 0, "cuda", f"{NONE}; use cpu"),
        ((12, 8), 0, "cuda:0", f"{OLD}; update it, or use cpu"),
        ((13, 0), 0, "cuda:1", "no CUDA GPU was found; use cpu"),
        ((13, 1), 3, "cuda:3", "there are only cuda:0 to cuda:2"),
    ):
        have(driver, count)
        assert main(["render", "cornell-box", "--device", name, "--spp", "1"]) == 2
        assert capsys.readouterr().err == f"wrt: error: device {name!r}: {message}\n"


def test_the_system_lists_gpus_or_says_why_there_are_none(have, monkeypatch, capsys):
    class Card:
        name, arch, total_memory, free_memory = "NVIDIA H100", 90, 85_000_000_000, 79_500_000_000

    def rows():
        assert main(["info", "--system"]) == 0
        return [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]

    for driver, reason in ((None, NONE), ((12, 8), OLD), ((13, 0), "none was found")):
        have(driver, 0)
        assert ["GPUs", reason] in rows()
    have((13, 1), 2)
    monkeypatch.setattr(wp, "get_device", lambda name: Card)
    assert ["CUDA", "13.4 compiles kernels, 13.0 is needed, the driver supports 13.1"] in rows()
    for device in ("cuda:0", "cuda:1"):
        assert [device, "NVIDIA H100, sm_90, 85.0 GB of memory, 79.5 GB free"] in rows()


MACHINE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
RESIDENT = 1000 * os.sysconf("SC_PAGE_SIZE")


def test_limits_of_control_groups(tmp_path):
    for number, (cgroup, files, limit) in enumerate(
        (
            ("", {}, MACHINE),
            ("0::/a/b\n", {"a/b/memory.max": "50000000\n", "a/memory.max": "40000000\n"}, 40_000_000),
            ("0::/a/b\n", {"a/b/memory.max": "max\n", "other/memory.max": "1\n"}, MACHINE),
            ("0::/\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container with its own cgroup namespace
            ("0::/machine/c1\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container without one
            ("1:name=systemd:/x\n4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
            ("4:memory:/docker/c\n", {"memory/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
            ("4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "9223372036854771712\n"}, MACHINE),
            ("nonsense\n0::/a\n", {"a/memory.max": "none of these\n"}, MACHINE),
            ("0::/a\n", {"a/memory.max": "1000\n"}, RESIDENT),  # less than the process has already
        )
    ):
        proc, groups = tmp_path / f"{number}" / "proc", tmp_path / f"{number}" / "groups"
        files = {groups / name: text for name, text in files.items()}
        files |= {proc / "statm": "3000 1000 10 1 0 2000 0\n", proc / "cgroup": cgroup}
        for path, text in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        assert memory_left(proc, groups) == limit - RESIDENT, cgroup
    assert memory_left(tmp_path / "none", tmp_path / "none") == MACHINE  # without limits


@pytest.mark.parametrize("kind", [resource.RLIMIT_AS, pytest.param(resource.RLIMIT_DATA, marks=pytest.mark.slow)])
def test_limits_of_the_process_are_known(kind, tmp_path):
    command = ("render", "cornell-box", "--size", "8000x8000", "--spp", "1", "-o", "x.png", "--quiet")
    result = run(tmp_path, *command, before=lambda: resource.setrlimit(kind, (2 << 30, 2 << 30)))
    assert result.returncode == 1, result.stderr
    message = r"wrt: error: a picture of 8000x8000 needs 7\.7 GB, more than the [0-2]\.\d GB that cpu has left\n"
    assert re.fullmatch(message, result.stderr)


# Last, for an emulated GPU stays until the module ends.
@pytest.fixture(scope="module", params=["cpu", pytest.param("emulated", marks=pytest.mark.machinery)])
def place(request):
    """The CPU, and an emulated GPU, for which the builder works in smaller pieces."""
    with emulated_cuda(optimization=0) if request.param == "emulated" else contextlib.nullcontext():
        yield "cpu" if request.param == "cpu" else GPU


def measured(scene, place):
    """Return the bytes of arrays of a built renderer, and their peak while it was built."""
    wrt.Renderer(scene, device=place)  # tables that are made once
    with allocations() as counted:
        renderer = wrt.Renderer(scene, device=place)
    assert renderer.spp == 0
    return counted.alive, counted.peak


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in SCENES])
def test_what_is_foretold_is_taken(name, place, report):
    scene = SCENES[name]()
    memory = device_memory(scene, device=place)
    alive, peak = measured(scene, place)
    report(f"{name} on {place}: peak bytes", peak, expected=memory.peak)
    report(f"{name} on {place}: bytes kept", alive, expected=memory.kept)
    assert peak == pytest.approx(memory.peak, rel=0.05)
    assert alive == pytest.approx(memory.kept, rel=0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("render_kernels_when_launched")
def test_cut_triangles_need_a_second_tree(place):
    """Slivers askew are cut before the tree is built."""
    corners = np.concatenate([BALL.vertices[BALL.faces], slivers(400, 2.5, 0.02)])
    scene = scene_of(wrt.Shape(mesh_of(corners)))
    memory = device_memory(scene, device=place)
    _, peak = measured(scene, place)
    assert 1.05 * memory.peak < peak
    assert 0.9 * memory.peak_if_cut < peak <= memory.peak_if_cut
