"""The memory that a picture takes on a device is known before it is taken, and what does not fit is refused."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import warp as wp
from conftest import ROOT, Report
from support.device_memory import allocations
from support.emulated_cuda.backend import EmulatedBackend, emulated_cuda
from test_presplit import slivers

import wrt
from wrt.backend import current_backend
from wrt.backend.cuda.gpus import CudaVersions
from wrt.backend.device import Device
from wrt.cli import main
from wrt.errors import NotEnoughMemory
from wrt.memory_needed import DeviceMemory, device_memory, memory_text

OLD_DRIVER = """
import sys
from warp._src.context import Runtime
load = Runtime.load_dll

def loaded(self, path):
    library = load(self, path)
    if str(path).endswith("warp.so"):
        library.wp_cuda_driver_is_initialized = lambda: 1
        library.wp_cuda_driver_version = lambda: 12080
    return library

Runtime.load_dll = loaded
from wrt.cli import main
sys.exit(main(sys.argv[1:]))
"""

GPU = "cuda:0"
RNG = np.random.default_rng(3)
BALL = wrt.sphere(subdivisions=5)


def scene_of(*shapes: wrt.Shape, **settings: object) -> wrt.Scene:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 2, 6)), environment=wrt.ConstantEnvironment(1.0))
    scene.shapes += shapes
    return dataclasses.replace(scene, settings=wrt.RenderSettings(width=64, height=48, **settings))


def soup() -> wrt.Mesh:
    corners = RNG.uniform(-1, 1, (30_000, 1, 3)) + RNG.normal(0, 0.02, (30_000, 3, 3))
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(90_000).reshape(-1, 3))


def textured() -> wrt.Scene:
    coarse = RNG.integers(0, 256, (512, 512, 3)).astype(np.float32) / np.float32(255.0)
    fine = RNG.random((300, 200, 3)).astype(np.float32)
    uvs = BALL.vertices[:, :2]
    ball = dataclasses.replace(BALL, uvs=uvs)
    paint = wrt.Principled(base_color=wrt.ImageTexture(coarse), roughness=wrt.ImageTexture(fine, channel="g"))
    return scene_of(wrt.Shape(ball, paint))


def forest() -> wrt.Scene:
    tree, floor = wrt.sphere(subdivisions=4), wrt.quad((-9, -1, -9), (18, 0, 0), (0, 0, 18))
    places = [np.eye(4) + np.pad([[x], [0], [z]], ((0, 1), (3, 0))) for x in range(-9, 9) for z in range(-9, 9)]
    return scene_of(wrt.Shape(floor), *(wrt.Shape(tree, transform=place) for place in places))


def deforming() -> wrt.Scene:
    keys = np.stack([BALL.vertices, BALL.vertices * 1.2, BALL.vertices * (1.0, 1.5, 1.0)])
    scene = scene_of(wrt.Shape(BALL, deformation=wrt.Deformation((0.0, 0.5, 1.0), keys)))
    scene.camera = wrt.PerspectiveCamera((0, 2, 6), shutter_close=1.0)
    return scene


def cloudy() -> wrt.Scene:
    cloud = wrt.DensityGrid(RNG.random((60, 50, 70)).astype(np.float32), albedo=RNG.random((20, 20, 20, 3)))
    medium = wrt.Medium(scattering=1.0, density=cloud)
    scene = scene_of(wrt.Shape(wrt.box(), wrt.Null(interior=medium)))
    scene.environment = wrt.ImageEnvironment(RNG.random((256, 512, 3)).astype(np.float32))
    return scene


SCENES: dict[str, Callable[[], wrt.Scene]] = {
    "a ball": lambda: scene_of(wrt.Shape(BALL)),
    "soup": lambda: scene_of(wrt.Shape(soup())),
    "textures": textured,
    "lights": lambda: scene_of(wrt.Shape(BALL, emission=1.0), wrt.Shape(wrt.box())),
    "instances": forest,
    "deforming": deforming,
    "a cloud and an image": cloudy,
    "layers": lambda: scene_of(wrt.Shape(wrt.box()), layers=("albedo", "normal", "depth", "uv", "object")),
}


@pytest.fixture(scope="class", params=["cpu", "emulated"])
def place(request: pytest.FixtureRequest) -> Iterator[str]:
    """The CPU, and an emulated GPU, for which the builder works in smaller pieces."""
    with emulated_cuda(optimization=0) if request.param == "emulated" else contextlib.nullcontext():
        yield "cpu" if request.param == "cpu" else GPU


def measured(scene: wrt.Scene, place: str) -> tuple[int, int]:
    """Return the bytes of arrays of a renderer once it is built, and the most there were."""
    wrt.Renderer(scene, device=place)  # tables that are made once
    with allocations() as counted:
        renderer = wrt.Renderer(scene, device=place)
    assert renderer.spp == 0
    return counted.alive, counted.peak


@pytest.mark.usefixtures("render_kernels_when_launched")
class TestForetold:
    @pytest.mark.parametrize(
        "name",
        [
            name
            if name in ("a ball", "instances", "a cloud and an image")
            else pytest.param(name, marks=pytest.mark.slow)
            for name in SCENES
        ],
    )
    def test_what_is_foretold_is_taken(self, name: str, place: str, report: Report) -> None:
        scene = SCENES[name]()
        memory = device_memory(scene, device=place)
        alive, peak = measured(scene, place)
        report(f"{name} on {place}: peak bytes", peak, expected=memory.peak)
        report(f"{name} on {place}: bytes kept", alive, expected=memory.kept)
        assert peak == pytest.approx(memory.peak, rel=0.05)
        assert alive == pytest.approx(memory.kept, rel=0.05)

    @pytest.mark.slow
    def test_cut_triangles_need_a_second_tree(self, place: str) -> None:
        corners = np.concatenate([BALL.vertices[BALL.faces], slivers(400, 2.5, 0.02)])
        scene = scene_of(wrt.Shape(wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))))
        memory = device_memory(scene, device=place)
        _, peak = measured(scene, place)
        assert 1.05 * memory.peak < peak
        assert 0.9 * memory.peak_if_cut < peak <= memory.peak_if_cut


def test_parts_grow_with_what_they_are_of() -> None:
    plain = device_memory(SCENES["layers"](), layers=())
    larger = device_memory(SCENES["layers"](), width=128, height=96)
    assert larger.film == 4 * plain.film == 4 * 64 * 64 * 48
    assert plain.layers == 0
    assert larger.layers == 128 * 96 * (8 * 6 + 4 * 3 + 8)
    denoised = device_memory(SCENES["layers"](), layers=(), denoise=True)
    assert denoised.film == 2 * plain.film
    assert denoised.layers == 64 * 48 * (8 * 6 + 8)
    cropped = dataclasses.replace(SCENES["a ball"]().settings, crop=(0, 0, 32, 48), adaptive="unbiased", noise=0.1)
    scene = dataclasses.replace(SCENES["a ball"](), settings=cropped)
    assert device_memory(scene).film == plain.film  # half the pixels, twice
    assert device_memory(SCENES["lights"]()).lights > 100 * len(BALL.faces)


class TestWhatDoesNotFit:
    @pytest.fixture
    def gpu(self) -> Iterator[EmulatedBackend]:
        with emulated_cuda(optimization=0) as backend:
            yield backend

    @pytest.fixture
    def small(self, gpu: EmulatedBackend, monkeypatch: pytest.MonkeyPatch) -> DeviceMemory:
        """Leave a GPU a byte less than a ball needs, after its film."""
        memory = device_memory(SCENES["a ball"]())
        monkeypatch.setattr(type(gpu), "memory_of", lambda *_: memory.peak - memory.film - 1)
        return memory

    def test_a_scene_is_refused_before_anything_is_taken(self, small: DeviceMemory) -> None:
        scene = SCENES["a ball"]()
        with allocations() as counted, pytest.raises(NotEnoughMemory) as caught:
            wrt.Renderer(scene, device=GPU)
        assert counted.peak <= small.film
        needs, left = (small.peak - small.film) / 1e9, (small.peak - small.film - 1) / 1e9
        assert str(caught.value) == (
            f"building a scene of {len(BALL.faces):,} triangles needs {needs:.1f} GB, more than the {left:.1f} GB that "
            f"{GPU} has left; 'wrt info --memory SCENE' says what takes it"
        )

    def test_what_just_fits_is_built(self, gpu: EmulatedBackend, monkeypatch: pytest.MonkeyPatch) -> None:
        memory = device_memory(SCENES["a ball"]())
        monkeypatch.setattr(type(gpu), "memory_of", lambda *_: memory.peak - memory.film)
        assert wrt.Renderer(SCENES["a ball"](), device=GPU).spp == 0

    def test_the_command_ends_with_status_1(
        self, gpu: EmulatedBackend, monkeypatch: pytest.MonkeyPatch, tmp_path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr(type(gpu), "memory_of", lambda *_: 70_000_000)
        picture = tmp_path / "picture.png"
        options = ["--device", GPU, "--size", "64x64", "--spp", "1", "--quiet", "-o", str(picture)]
        assert main(["render", "many-triangles", *options]) == 1
        said = capsys.readouterr().err
        assert re.fullmatch(
            r"wrt: error: building a scene of 1,000,000 triangles needs 0\.3 GB, more than the 0\.1 GB that cuda:0 has "
            r"left; 'wrt info --memory SCENE' says what takes it\n",
            said,
        )
        assert not picture.exists()

    def test_the_builder_on_the_cpu_is_counted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("wrt.upload.scene_data.WORTH_ASKING", 0)
        monkeypatch.setattr("wrt.backend.device.memory_left", lambda: 1_000_000)
        with pytest.raises(NotEnoughMemory, match=r"building a scene of 20,480 triangles needs 0\.0 GB"):
            wrt.Renderer(SCENES["a ball"](), width=8, height=8)

    def test_memory_that_runs_out_on_the_way_is_one_line(
        self, gpu: EmulatedBackend, monkeypatch: pytest.MonkeyPatch, tmp_path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        def fail(*_: object, **__: object) -> None:
            raise RuntimeError("Failed to allocate 2147483648 bytes on device 'cuda:0'")

        monkeypatch.setattr(wp, "zeros", fail)
        monkeypatch.setattr(wp, "empty", fail)
        for make in (gpu.empty, gpu.zeros):
            with pytest.raises(NotEnoughMemory, match=r"memory ran out on cuda:0: 2\.15 GB more were needed;"):
                make(4, float, GPU)
        assert main(["render", "cornell-box", "--size", "8x8", "--spp", "1", "-o", str(tmp_path / "a.png")]) == 1
        assert capsys.readouterr().err.startswith("wrt: error: memory ran out on cpu: 2.15 GB more were needed;")

    def test_other_faults_of_an_allocation_are_not_hidden(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail(*_: object, **__: object) -> None:
            raise RuntimeError("an illegal memory access")

        Device("cpu")
        monkeypatch.setattr(wp, "empty", fail)
        with pytest.raises(RuntimeError, match="illegal"):
            current_backend().empty(4)


class TestInWords:
    def test_the_command_lists_the_parts(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["info", "still-life", "--memory", "--size", "1000x500"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == "memory of a picture of 1000x500 on a GPU"
        assert ["film", "32.0", "MB"] in [line.split() for line in lines]
        assert any(line.startswith("  at most") and "while the ray tree is built" in line for line in lines)
        assert main(["info", "still-life", "--size", "10x10"]) == 2
        assert "--size is for --memory" in capsys.readouterr().err

    def test_gpus_say_whether_it_fits(self, monkeypatch: pytest.MonkeyPatch) -> None:
        memory = DeviceMemory(1, 2, 0, 4, 10**9, 6, 3 * 10**9, 4 * 10**9, 5 * 10**9)
        with emulated_cuda() as gpu:
            for free, said in ((4 * 10**9, "4.00 GB free: enough"), (4 * 10**9 - 1, "4.00 GB free: not enough")):
                monkeypatch.setattr(type(gpu), "memory_of", lambda *_, free=free: free)
                assert memory_text(memory, 3, 4).splitlines()[-1] == f"  cuda:0    {said}"
        assert "materials" not in memory_text(memory, 3, 4)


class TestGpus:
    @pytest.fixture
    def versions(self, monkeypatch: pytest.MonkeyPatch) -> Callable[[CudaVersions, int], None]:
        """Return a function that sets the versions of CUDA and the number of GPUs."""
        Device("cpu")
        backend = type(current_backend())

        def have(found: CudaVersions, count: int) -> None:
            monkeypatch.setattr(backend, "cuda_versions", lambda _: found)
            monkeypatch.setattr(backend, "gpus", lambda _: count)

        return have

    @pytest.mark.parametrize(
        ("found", "count", "name", "said"),
        [
            (CudaVersions((13, 4), None, (13, 0)), 0, "cuda", "no NVIDIA driver was found; use cpu"),
            (
                CudaVersions((13, 4), (12, 8), (13, 0)),
                0,
                "cuda:0",
                "the NVIDIA driver is too old, for CUDA 12.8 instead of 13.0; update it, or use cpu",
            ),
            (CudaVersions((13, 4), (13, 0), (13, 0)), 0, "cuda:1", "no CUDA GPU was found; use cpu"),
            (CudaVersions((13, 4), (13, 1), (13, 0)), 1, "cuda:7", "there is only cuda:0"),
            (CudaVersions((13, 4), (13, 1), (13, 0)), 3, "cuda:3", "there are only cuda:0 to cuda:2"),
            (CudaVersions((13, 4), (13, 1), (13, 0)), 3, "cuda:0,4", "there are only cuda:0 to cuda:2"),
            (CudaVersions((13, 4), None, (13, 0)), 0, "cuda:all", "no NVIDIA driver was found; use cpu"),
        ],
    )
    def test_a_gpu_that_cannot_be_had_is_one_line(
        self,
        found: CudaVersions,
        count: int,
        name: str,
        said: str,
        versions: Callable[[CudaVersions, int], None],
        tmp_path,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        versions(found, count)
        picture = tmp_path / "picture.png"
        assert main(["render", "cornell-box", "--device", name, "--spp", "1", "-o", str(picture)]) == 2
        assert capsys.readouterr().err == f"wrt: error: device {name!r}: {said}\n"
        assert not picture.exists()

    def test_the_system_lists_them(
        self,
        versions: Callable[[CudaVersions, int], None],
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        class Card:
            name, arch, total_memory, free_memory = "NVIDIA H100", 90, 85_000_000_000, 79_500_000_000

        versions(CudaVersions((13, 4), (13, 1), (13, 0)), 2)
        monkeypatch.setattr(wp, "get_device", lambda name: Card)
        assert main(["info", "--system"]) == 0
        rows = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
        assert ["CUDA", "13.4 compiles kernels, 13.0 is needed, the driver supports 13.1"] in rows
        for device in ("cuda:0", "cuda:1"):
            assert [device, "NVIDIA H100, sm_90, 85.0 GB of memory, 79.5 GB free"] in rows

    def test_the_system_says_why_there_is_none(
        self, versions: Callable[[CudaVersions, int], None], capsys: pytest.CaptureFixture[str]
    ) -> None:
        for found, said in (
            (CudaVersions((13, 4), None, (13, 0)), "no NVIDIA driver was found"),
            (CudaVersions((13, 4), (12, 8), (13, 0)), "the NVIDIA driver is too old, for CUDA 12.8 instead of 13.0"),
            (CudaVersions((13, 4), (13, 0), (13, 0)), "none was found"),
        ):
            versions(found, 0)
            assert main(["info", "--system"]) == 0
            rows = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
            assert ["GPUs", said] in rows

    def test_a_driver_that_is_too_old_is_one_line(self, tmp_path) -> None:
        """The whole command, in a process whose Warp finds a driver of CUDA 12.8 when it starts."""
        command = [sys.executable, "-c", OLD_DRIVER, "render", "cornell-box", "--device", "cuda", "-o", "picture.png"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert re.fullmatch(
            r"wrt: error: device 'cuda': the NVIDIA driver is too old, for CUDA 12\.8 instead of \d+\.\d; "
            r"update it, or use cpu\n",
            done.stderr,
        )
        assert done.stdout == ""
        assert list(tmp_path.iterdir()) == []
