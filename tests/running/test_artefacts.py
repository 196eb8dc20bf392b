"""Compiled kernels run without Warp: the same bits, never a stale file, and Warp compiles what is missing."""

import importlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import ROOT
from support.caches import python, render_small, without_artefacts
from support.commands import CAMERA, QUAD
from support.wide_scenes import CAMERAS, SCENES, add_balls

import wrt
from wrt import backend
from wrt.backend import artefacts, current_backend, fingerprint
from wrt.backend.arrays import Layout
from wrt.backend.artefacts import Artefacts
from wrt.backend.cache_folders import read_checked, write_checked
from wrt.backend.describe import describe_struct
from wrt.backend.device import Device
from wrt.kernels.bsdf import BSDFS, model_of


@pytest.fixture
def environment(tmp_path):
    return without_artefacts(tmp_path)


def test_a_process_without_warp_gives_the_same_bits(tmp_path, environment):
    image = wrt.render("cornell-box", width=24, height=16, spp=2)
    for has_warp in (True, False):
        assert render_small(tmp_path, environment, "compiled.npy", "cornell-box") == (has_warp, "")
        np.testing.assert_array_equal(np.load(tmp_path / "compiled.npy"), image)


@pytest.mark.machinery
def test_the_second_start_is_without_warp_whatever_the_scene_has(tmp_path, environment):
    scene = SCENES["textures"][0]()
    scene.camera = CAMERAS["moving"]
    scene.lights += SCENES["models"][0]().lights
    add_balls(scene, wrt.Dielectric(1.34, interior=wrt.Medium(absorption=(0.5, 0.2, 1.5)), priority=1))
    wrt.save_scene(tmp_path / "scene.toml", scene)
    assert render_small(tmp_path, environment, "warp.npy", "scene.toml") == (True, "")
    assert render_small(tmp_path, environment, "compiled.npy", "scene.toml") == (False, "")
    assert (tmp_path / "compiled.npy").read_bytes() == (tmp_path / "warp.npy").read_bytes()


def read_table(path: Path) -> dict[str, dict[str, object]]:
    text = read_checked(path)
    assert text is not None
    return json.loads(text)


@pytest.mark.slow
def test_what_is_missing_is_compiled_and_no_message_comes_twice(tmp_path, environment):
    (tmp_path / "dark.toml").write_text(CAMERA + QUAD)
    has_warp, messages = render_small(tmp_path, environment, "a.npy", "dark.toml")
    assert (has_warp, messages.count("no light")) == (True, 1)
    (index,) = (tmp_path / "cache" / "wrt").glob("artefacts-*.json")
    table = read_table(index)
    # A file of another size than when it was noted, and one that is gone.
    changes = {"split": {"bytes": 1}, "top": {"file": "gone.o"}}
    files = {f"wrt.kernels.accel.build.{name}": change for name, change in changes.items()}
    changed = table["files"] | {name: table["files"][name] | change for name, change in files.items()}
    write_checked(index, json.dumps(table | {"files": changed}).encode())
    assert render_small(tmp_path, environment, "b.npy", "dark.toml") == (True, messages)
    assert read_table(index) == table
    assert render_small(tmp_path, environment, "c.npy", "dark.toml") == (False, messages)
    for damaged in (json.dumps(table).encode(), index.read_bytes()[:-9]):
        index.write_bytes(damaged)
        has_warp, repeated = render_small(tmp_path, environment, "b.npy", "dark.toml")
        warning = f"wrt: warning: {index}: the table of compiled kernels was damaged; it is replaced"
        assert (has_warp, sorted(repeated.splitlines())) == (True, sorted([warning, *messages.splitlines()]))
    assert read_table(index) == table
    assert len({(tmp_path / f"{name}.npy").read_bytes() for name in "abc"}) == 1


BEGIN = """
import json, sys
import numpy as np
import wrt
scene = wrt.load("cornell-box")

def has_warp():
    return "warp" in sys.modules

def renderer_with(spp, scene=scene):
    renderer = wrt.Renderer(scene, width=24, height=24)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer

def digest(*arrays):
    import hashlib
    return [hashlib.sha256(np.ascontiguousarray(array)).hexdigest() for array in arrays]
"""


WITHOUT_WARP = """
import tempfile
from pathlib import Path

renderer = renderer_with(1)
guides = renderer.denoising_guides()["albedo"]
list(renderer.passes(noise=0.2, adaptive=True, spp=8))
camera = wrt.PerspectiveCamera(origin=(0.3, 1.0, 3.9), target=(0.0, 1.0, 0.0), fov_degrees=39)
renderer.set_camera(camera)
list(renderer.passes(spp=2))
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "film"
    renderer.save_checkpoint(path)
    resumed = wrt.Renderer.resume(path, renderer.scene)
list(resumed.passes(spp=4))
numbers = digest(resumed.image(), resumed.variance(), renderer.part(1, 2, spp=2).arrays["total"])
moved = renderer_with(1)
moved.update_vertices(0, scene.shapes[0].mesh.vertices + np.float32(0.01))
list(moved.passes(spp=2))
views = [view.image for view in wrt.render_views(scene, [camera, scene.camera], width=24, height=24, spp=2)]
print(json.dumps([has_warp(), numbers + digest(guides, moved.image(), *views)]))
"""


def run(folder: Path, variables: dict[str, str], script: str, begin: str = BEGIN) -> tuple[bool, list[Any]]:
    """Run a script; return whether it has imported Warp, and what it found."""
    has_warp, found = json.loads(python(folder, variables, "-W", "error", "-c", begin + script))
    return has_warp, found


@pytest.mark.slow
def test_whatever_a_renderer_does_needs_no_warp_the_second_time(tmp_path, environment):
    first = run(tmp_path, environment, WITHOUT_WARP)
    assert first[0]
    assert run(tmp_path, environment, WITHOUT_WARP) == (False, first[1])
    assert run(tmp_path, environment, WITHOUT_WARP, "import warp\n" + BEGIN) == (True, first[1])


def structs_of_kernels() -> list[Any]:
    found = {}
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        name = ".".join(["wrt", "kernels", *path.relative_to(ROOT / "kernels").with_suffix("").parts])
        for value in vars(importlib.import_module(name.removesuffix(".__init__"))).values():
            if type(value).__name__ == "Struct":
                found[value] = None
    return list(found)


def test_structs_lie_in_memory_as_warp_lays_them():
    table = {}
    names = {describe_struct(struct, table.__setitem__): struct for struct in structs_of_kernels()}
    assert len(names) > 30

    def layout_of(name):
        size, fields = json.loads(json.dumps(table[name]))
        return Layout(name, size, fields, layout_of)

    for name, struct in names.items():
        layout, expected = layout_of(name).numpy, np.dtype(struct.numpy_dtype())
        assert layout.itemsize == expected.itemsize
        assert layout == expected, name


def test_a_change_of_anything_that_a_build_depends_on_is_seen(tmp_path, monkeypatch):
    warp = tmp_path / "warp"
    (warp / "bin").mkdir(parents=True)
    for name in ("config.py", "bin/warp.so", "bin/warp-clang.so"):
        (warp / name).write_text('version: str = "1.19.0"\n')
    kernels = tmp_path / "kernels"
    shutil.copytree(ROOT / "kernels", kernels, ignore=shutil.ignore_patterns("__pycache__"))
    folder_of = fingerprint.folder_of
    monkeypatch.setattr(fingerprint, "folder_of", lambda name: kernels if name == "wrt.kernels" else folder_of(name))
    source = kernels / "bsdf" / "diffuse.py"
    changes = [
        lambda: None,
        lambda: source.write_text(source.read_text() + "# \n"),
        lambda: source.rename(source.with_name("diffuse_.py")),
        lambda: (warp / "bin" / "warp-clang.so").write_text("longer than it was before"),
        lambda: (warp / "config.py").write_text('version: str = "1.20.0"\n'),
        lambda: monkeypatch.setenv("WARP_CACHE_PATH", "elsewhere"),
    ]
    found = []
    for change in changes:
        change()
        for _ in range(2):
            code = fingerprint.digest_of_code(fingerprint.version_of(warp))
            found.append(fingerprint.fingerprint(warp, code))
        assert found.pop() == found[-1]
    assert len(set(found)) == len(changes)


def test_another_version_of_warp_launches_its_kernels_itself(monkeypatch):
    """Only the versions that were tested lay out arguments as wrt does."""
    assert Artefacts().can_launch
    assert wp.config.version in artefacts.TESTED
    options = {"width": 24, "height": 16, "spp": 2}
    image = wrt.render("cornell-box", **options)
    monkeypatch.setattr(artefacts, "TESTED", ("0.0.0",))
    assert not Artefacts().can_launch
    monkeypatch.setattr(backend, "_backend", None)
    np.testing.assert_array_equal(wrt.render("cornell-box", **options), image)
    ball, ray = wrt.sphere(subdivisions=1), ([[0.1, 0.2, 5.0]], [[0.0, 0.0, -1.0]])
    hits = [wrt.Intersector(ball).closest_hit(*ray)]
    monkeypatch.undo()
    hits.append(wrt.Intersector(ball).closest_hit(*ray))
    assert hits[0] == hits[1]


def table_of(path: Path) -> Artefacts:
    """Return the table in a file."""
    found = Artefacts()
    found.path, found.folders = path, [path.parent]
    for part in found.table.values():
        part.clear()
    found.refresh()
    return found


def test_what_another_render_saves_is_kept(tmp_path):
    """Else the render after it would import Warp."""
    tables = [table_of(tmp_path / "artefacts.json") for _ in range(2)]
    for table, name in zip(tables, ("scalar", "wide"), strict=True):
        table.add("values", name, {"value": 1})
        table.save()
    assert set(table_of(tmp_path / "artefacts.json").table["values"]) == {"scalar", "wide"}


def test_models_of_users_are_kept_by_a_digest_of_their_code():
    """Another process may register other functions under the name."""
    call = current_backend().call
    model = model_of("mirror")
    call("wrt.kernels.bsdf", "model_of", "mirror")
    names = []
    try:
        for each in (model, model._replace(matt=True), model._replace(sample=model_of("conductor").sample), model):
            BSDFS.register("mirror_of_a_user", each)
            names.append(call("wrt.kernels.bsdf", "current_name", "mirror_of_a_user"))
            assert call("wrt.kernels.bsdf", "model_of", names[-1]).matt == each.matt
        assert len(set(names)) == 3
        assert names[0] == names[3]
        calls = current_backend().artefacts.table["values"]
        assert {f"wrt.kernels.bsdf.model_of('{name}')" for name in (*names, "mirror")} <= set(calls)
        assert not [call for call in calls if "'mirror_of_a_user'" in call]
    finally:
        BSDFS.forget("mirror_of_a_user")


def test_kernels_of_one_name_are_told_apart():
    def make(factor):
        @wp.kernel(module=wp.get_module("wrt.test_artefacts"), enable_backward=False)
        def times(first: int, values_out: wp.array(dtype=int)):
            values_out[first + wp.tid()] = wp.static(factor)

        return times

    device = Device("cpu")
    values = device.backend.zeros(1, int)
    for kernel, factor in [(make(factor), factor) for factor in (2, 3)]:
        device.launch(kernel, 1, [values])
        assert values.numpy().tolist() == [factor]
    assert "wrt.test_artefacts" not in device.backend.artefacts.table["files"]
