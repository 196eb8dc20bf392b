"""Rendering without importing Warp: the same bits, never a stale build, and Warp itself where anything is missing."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import ROOT

from wrt import backend
from wrt.backend import builds, fingerprint, recording
from wrt.backend.builds import Builds, NotCompiled
from wrt.backend.compiled_backend import CompiledBackend
from wrt.backend.kernel_cache import digest
from wrt.backend.warp_backend import WarpBackend

FILM = "wrt.kernels.film.film"
EVERYTHING = """
[camera]
origin = [0, 1, 6]
aperture_radius = 0.01
shutter_close = 0.02
[environment]
type = "sun-sky"
[media.wine]
type = "color"
color = [0.5, 0.02, 0.05]
distance = 0.04
[materials.wine]
type = "dielectric"
ior = 1.34
interior = "wine"
priority = 1
[materials.metal]
type = "rough-conductor"
metal = "gold"
alpha = 0.3
multiple_bounces = true
[[lights]]
type = "sphere"
center = [2, 3, 1]
radiance = 9
[[lights]]
type = "spot"
position = [-2, 3, 1]
direction = [1, -1, 0]
intensity = 9
[[shapes]]
type = "sphere"
material = "wine"
[[shapes]]
type = "box"
material = "metal"
motion = { times = [0.0, 0.02], rotate = { axis = [0, 1, 0], degrees = 40 } }
[[shapes]]
type = "mesh"
file = "teapot.ply"
scale = 0.1
instances = [{ translate = [1, 0, 0] }, { translate = [-1, 0, 0] }]
"""
"""A scene with most of what a scene can have."""


def without_notes(folder: Path) -> dict[str, str]:
    """Return variables by which nothing is known to be compiled, though it may well be."""
    wp.init()
    # Warp puts a folder of its version there itself.
    kernels = Path(wp.config.kernel_cache_dir).parent
    own = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache"), "WARP_CACHE_PATH": str(kernels)}
    return {**os.environ, **own}


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    return without_notes(tmp_path)


def render(folder: Path, environment: dict[str, str], output: str, *arguments: str) -> tuple[bool, str]:
    """Render; return whether Warp was imported, and what was said."""
    command = ["-m", "wrt", "render", *arguments, "--size", "24x16", "--spp", "2", "--quiet", "-o", output]
    process = subprocess.run(
        [sys.executable, "-X", "importtime", *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    lines = process.stderr.splitlines()
    said = [line for line in lines if not line.startswith("import time:")]
    return any(line.endswith(" warp._src.context") for line in lines), "\n".join(said)


@pytest.mark.parametrize(
    "arguments",
    [
        ["cornell-box"],
        pytest.param(["still-life"], marks=pytest.mark.slow),
        pytest.param(["many-triangles", "--triangles", "3000"], marks=pytest.mark.slow),
    ],
)
def test_the_second_start_is_without_warp_and_gives_the_same_bits(
    arguments: list[str], tmp_path: Path, environment: dict[str, str]
) -> None:
    assert render(tmp_path, environment, "warp.npy", *arguments) == (True, "")
    assert render(tmp_path, environment, "compiled.npy", *arguments) == (False, "")
    assert (tmp_path / "compiled.npy").read_bytes() == (tmp_path / "warp.npy").read_bytes()


@pytest.mark.slow
def test_whatever_a_scene_has_needs_no_warp_the_second_time(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "everything.toml").write_text(EVERYTHING)
    shutil.copy(ROOT / "meshes" / "teapot.ply", tmp_path)
    assert render(tmp_path, environment, "warp.npy", "everything.toml") == (True, "")
    assert render(tmp_path, environment, "compiled.npy", "everything.toml") == (False, "")
    assert (tmp_path / "compiled.npy").read_bytes() == (tmp_path / "warp.npy").read_bytes()


DARK = """
[camera]
origin = [0, 0, 3]
[[shapes]]
type = "quad"
origin = [-1, -1, 0]
edge_u = [2, 0, 0]
edge_v = [0, 2, 0]
"""


def read_notes(path: Path) -> dict[str, dict[str, object]]:
    said, _, text = path.read_bytes().partition(b"\n")
    assert said == digest(text)
    return json.loads(text)


@pytest.mark.slow
def test_what_is_missing_is_compiled_and_nothing_is_said_twice(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "dark.toml").write_text(DARK)
    whole, said = render(tmp_path, environment, "a.npy", "dark.toml")
    assert whole
    assert said.count("no light") == 1
    (index,) = (tmp_path / "cache" / "wrt").glob("builds-*.json")
    known = read_notes(index)
    # A file of another size than when it was noted, and one that is gone.
    for name, change in (
        ("wrt.kernels.accel.build.split", {"bytes": 1}),
        ("wrt.kernels.accel.build.top", {"file": "gone.o"}),
    ):
        files = known["files"] | {name: known["files"][name] | change}
        text = json.dumps(known | {"files": files}).encode()
        index.write_bytes(digest(text) + b"\n" + text)
        assert render(tmp_path, environment, "b.npy", "dark.toml") == (True, said)
        assert read_notes(index) == known
        assert render(tmp_path, environment, "c.npy", "dark.toml") == (False, said)
    for damaged in (b"", b"[1]", json.dumps(known).encode(), index.read_bytes()[:-9]):
        index.write_bytes(damaged)
        whole, told = render(tmp_path, environment, "b.npy", "dark.toml")
        assert whole
        warned, rest = told.split("\n", 1)
        assert warned == f"wrt: warning: {index}: notes on compiled kernels were damaged; they are replaced"
        assert rest == said
    assert read_notes(index) == known
    images = {(tmp_path / f"{name}.npy").read_bytes() for name in "abc"}
    assert len(images) == 1


def structs_of_kernels() -> list[Any]:
    """Return all structs of `kernels/`."""
    found = {}
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        name = ".".join(["wrt", "kernels", *path.relative_to(ROOT / "kernels").with_suffix("").parts])
        for value in vars(importlib.import_module(name.removesuffix(".__init__"))).values():
            if type(value).__name__ == "Struct":
                found[value] = None
    return list(found)


def compiled_backend(notes: dict[str, Any]) -> CompiledBackend:
    """Return a backend to which what a process may have noted is known."""
    known = Builds(Path("none"), Path("none"), "1.19.0")
    known.notes |= json.loads(json.dumps(notes))
    return CompiledBackend(known)


def test_structs_lie_in_memory_as_warp_lays_them() -> None:
    structs: dict[str, Any] = {}
    names = {recording._struct(struct, structs): struct for struct in structs_of_kernels()}
    assert len(names) > 30
    noted = compiled_backend({"structs": structs})
    for name, struct in names.items():
        layout, expected = noted.struct(name).numpy, np.dtype(struct.numpy_dtype())
        assert layout.itemsize == expected.itemsize
        assert layout == expected, name


def test_a_struct_holds_what_warps_would() -> None:
    from wrt.kernels.camera.camera import Camera

    structs: dict[str, Any] = {}
    noted = compiled_backend(
        {"structs": structs, "modules": {"c": {"Camera": {"struct": recording._struct(Camera, structs)}}}}
    )
    ours, warps = noted.kernels("c").Camera(), Camera()
    keys = np.zeros((2, 3), np.float32)
    for camera, array in ((ours, noted.array(keys, "vec3")), (warps, None)):
        camera.kind, camera.pixel, camera.origin = 3, (0.1, 0.2), np.array([1.0, 2.0, 3.0])
        camera.motion.center = (4, 5, 6)
        camera.motion.keys = 7
        if array is not None:
            camera.motion_keys = array
    before = ours.motion_keys
    assert ours._memory["motion_keys"]["data"] == before.ptr
    ours.motion_keys = noted.array(keys[:0], "vec3")
    expected = np.frombuffer(bytes(warps.__ctype__()), Camera.numpy_dtype())[0]
    for name in ("kind", "pixel", "origin", "motion", "width"):
        assert ours._memory[name].tobytes() == expected[name].tobytes(), name
    whole = noted.kernels("c").Camera()
    whole.motion = ours.motion  # a copy, in which later changes of the other are not seen
    ours.motion.keys = 8
    assert (whole.motion.keys, ours.motion.keys) == (7, 8)
    with pytest.raises(AttributeError, match="nothing"):
        ours.nothing = 1


def test_a_change_of_anything_that_a_build_depends_on_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    warp = tmp_path / "warp"
    (warp / "bin").mkdir(parents=True)
    for name in ("config.py", "bin/warp.so", "bin/warp-clang.so"):
        (warp / name).write_text('version: str = "1.19.0"\n')
    kernels = tmp_path / "kernels"
    shutil.copytree(ROOT / "kernels", kernels, ignore=shutil.ignore_patterns("__pycache__"))
    folder_of = fingerprint.folder_of
    monkeypatch.setattr(fingerprint, "folder_of", lambda name: kernels if name == "wrt.kernels" else folder_of(name))
    seen = {fingerprint.fingerprint(warp)}
    assert {fingerprint.fingerprint(warp)} == seen

    def changed() -> None:
        after = fingerprint.fingerprint(warp)
        assert after not in seen
        seen.add(after)

    source = kernels / "bsdf" / "diffuse.py"
    source.write_text(source.read_text() + "# \n")
    changed()
    source.rename(source.with_name("another.py"))
    changed()
    (warp / "bin" / "warp-clang.so").write_text("longer than it was before")
    changed()
    (warp / "config.py").write_text('version: str = "1.20.0"\n')
    changed()
    monkeypatch.setenv("WARP_CACHE_PATH", "elsewhere")
    changed()


def test_another_warp_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Builds.known() is not None
    assert wp.config.version in builds.TESTED
    monkeypatch.setattr(builds, "TESTED", ("0.0.0",))
    assert Builds.known() is None


def test_many_may_note_at_once(tmp_path: Path) -> None:
    path = tmp_path / "new" / "builds.json"

    def note(number: int) -> None:
        known = Builds(path, tmp_path, "")
        for k in range(20):
            known.note({"files": {f"m{number}.{k}": {"file": "f" * 1000, "bytes": k, "kernels": {}}}})

    note(0)
    threads = [threading.Thread(target=note, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert len(read_notes(path)["files"]) in range(20, 81)  # whole at any time
    assert len(read_notes(path)["files"]) in range(20, 81)  # those of the last to write, and what that one had read
    assert [found.name for found in path.parent.iterdir()] == ["builds.json"]


def test_what_is_not_noted_is_not_compiled() -> None:
    noted = compiled_backend({"modules": {"known": {"ROWS": {"value": 3}, "kernel": {"kernel": ["nobody", "kernel"]}}}})
    assert noted.kernels("known").ROWS == 3
    for ask in (
        lambda: noted.kernels("unknown"),
        lambda: noted.kernels("known").COLUMNS,
        lambda: noted.call("known", "make", 1),
        lambda: noted.load(noted.kernels("known").kernel, "cpu"),
        noted.gpus,
        noted.cuda_versions,
        lambda: noted.gpu("cuda:0"),
    ):
        with pytest.raises(NotCompiled):
            ask()


def test_what_is_not_compiled_is_prepared_again_with_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "_backend", compiled_backend({}))
    seen = []

    def build(error: type[Exception] = NotCompiled) -> str:
        seen.append(type(backend.current_backend()))
        if seen[-1] is CompiledBackend:
            raise error
        return "built"

    with pytest.raises(ZeroDivisionError):  # whatever else goes wrong, goes wrong once
        backend.prepare(lambda: build(ZeroDivisionError))
    assert backend.prepare(build) == "built"
    assert seen == [CompiledBackend, CompiledBackend, WarpBackend]


def test_a_process_that_has_warp_keeps_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "_backend", None)
    backend.prefer_compiled()
    assert isinstance(backend.current_backend(), WarpBackend)


def test_models_of_a_persons_own_are_left_to_warp() -> None:
    from wrt.kernels.bsdf import model_of

    model = model_of("diffuse")
    described = recording._described(model, {})
    assert described["fields"]["slots"] == model.slots

    @wp.func
    def evaluate(bsdf: int) -> int:
        return bsdf

    assert recording._described(model._replace(evaluate=evaluate), {}) is None


def files_of_warp() -> dict[str, Any]:
    """Return the notes of what Warp has loaded in this process."""
    return recording.compiled_by_warp(WarpBackend())["files"]


def test_kernels_whose_threads_wait_for_one_another_are_left_to_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.backend.device import Device
    from wrt.kernels.film.film import film_noise

    Device("cpu").compile(film_noise)
    found = files_of_warp()
    assert set(found[FILM]["kernels"]) == {"film_mean", "film_noise", "film_tally", "hide_pixels", "show_pixels"}
    # A name that all of them have, in place of one that such kernels have.
    monkeypatch.setattr(recording, "_COOPERATIVE", b"film_mean")
    assert FILM not in files_of_warp()


def test_kernels_that_their_names_do_not_tell_apart_are_left_to_warp() -> None:
    def make(factor: int) -> wp.Kernel:
        @wp.kernel(module=wp.get_module("wrt.test_compiled"), enable_backward=False)
        def times(first: int, values_out: wp.array(dtype=int)):  # type: ignore[valid-type]
            values_out[first + wp.tid()] = wp.static(factor)

        return times

    one = make(2)
    wp.load_module("wrt.test_compiled", device="cpu")
    assert len(files_of_warp()["wrt.test_compiled"]["kernels"]) == 1
    both = [one, make(3)]
    wp.load_module("wrt.test_compiled", device="cpu")
    assert len(both) == 2
    assert "wrt.test_compiled" not in files_of_warp()
