"""Rendering without importing Warp: the same bits, never a stale build, and Warp itself where anything is missing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import pytest
import warp as wp
from conftest import ROOT

from wrt import lean
from wrt.kernel_cache import digest
from wrt.lean import builds
from wrt.lean.builds import Builds, Missing

LAYOUTS = """
import importlib, json, pathlib, sys
if sys.argv[1] == "lean":
    from wrt.lean.builds import Builds
    from wrt.lean.stand_in import StandIn
    sys.modules["warp"] = StandIn(Builds(pathlib.Path("none"), pathlib.Path("none"), "1.19.0", {}))
import numpy as np
import wrt.kernels
root = pathlib.Path(wrt.kernels.__file__).parent
found = {}
for path in sorted(root.rglob("*.py")):
    if path.parent.name == "wide":
        continue  # declares no records, and reads what Warp writes
    name = ".".join(["wrt", "kernels", *path.relative_to(root).with_suffix("").parts]).removesuffix(".__init__")
    for key, value in vars(importlib.import_module(name)).items():
        if type(value).__name__ in ("Struct", "Record"):
            layout = value.numpy_dtype()
            found[f"{name}.{key}"] = [layout["itemsize"], layout["names"], layout["offsets"], np.dtype(layout).itemsize]
print(json.dumps(found))
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return variables by which nothing is known to be compiled, though it may well be."""
    wp.init()
    # Warp puts a folder of its version there itself.
    kernels = Path(wp.config.kernel_cache_dir).parent
    own = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache"), "WARP_CACHE_PATH": str(kernels)}
    return {**os.environ, **own}


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


@pytest.mark.parametrize("arguments", [["cornell-box"], ["still-life"], ["many-triangles", "--triangles", "3000"]])
def test_the_second_start_is_without_warp_and_gives_the_same_bits(
    arguments: list[str], tmp_path: Path, environment: dict[str, str]
) -> None:
    assert render(tmp_path, environment, "warp.npy", *arguments) == (True, "")
    assert render(tmp_path, environment, "lean.npy", *arguments) == (False, "")
    assert (tmp_path / "lean.npy").read_bytes() == (tmp_path / "warp.npy").read_bytes()


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
    for name, change in (("wrt.kernels.bvh_split", {"bytes": 1}), ("wrt.kernels.bvh_top", {"file": "gone.o"})):
        text = json.dumps(known | {name: known[name] | change}).encode()
        index.write_bytes(digest(text) + b"\n" + text)
        assert render(tmp_path, environment, "b.npy", "dark.toml") == (True, said)
        assert read_notes(index) == known
        assert render(tmp_path, environment, "c.npy", "dark.toml") == (False, said)
    for damaged in (b"", b"[1]", json.dumps(known).encode(), index.read_bytes()[:-9]):
        index.write_bytes(damaged)
        whole, told = render(tmp_path, environment, "b.npy", "dark.toml")
        assert whole
        warned, rest = told.split("\n", 1)
        assert warned == f"wrt: warning: {index}: notes of compiled kernels were damaged, and are written anew"
        assert rest == said
    assert read_notes(index) == known
    images = {(tmp_path / f"{name}.npy").read_bytes() for name in "abc"}
    assert len(images) == 1


def test_records_lie_in_memory_as_warp_lays_them() -> None:
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    found = {}
    for how in ("lean", "warp"):
        command = [sys.executable, "-c", LAYOUTS, how]
        process = subprocess.run(command, env=variables, capture_output=True, text=True, check=True)
        found[how] = json.loads(process.stdout.splitlines()[-1])
    assert len(found["warp"]) > 30
    assert found["lean"] == found["warp"]


def test_a_change_of_anything_that_a_build_depends_on_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    warp = tmp_path / "warp"
    (warp / "bin").mkdir(parents=True)
    for name in ("config.py", "bin/warp.so", "bin/warp-clang.so"):
        (warp / name).write_text('version: str = "1.19.0"\n')
    kernels = tmp_path / "kernels"
    shutil.copytree(ROOT / "kernels", kernels, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(builds, "_kernels", lambda: kernels)
    seen = {builds.fingerprint(warp)}
    assert {builds.fingerprint(warp)} == seen

    def changed() -> None:
        after = builds.fingerprint(warp)
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
        known = Builds(path, tmp_path, "", {})
        for k in range(20):
            known.note([(f"m{number}.{k}", {"file": "f" * 1000, "bytes": k, "kernels": {}})])

    note(0)
    threads = [threading.Thread(target=note, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert len(read_notes(path)) in range(1, 21)  # whole at any time
    assert len(read_notes(path)) == 20
    assert [found.name for found in path.parent.iterdir()] == ["builds.json"]


def test_what_the_stand_in_does_not_know_is_missing() -> None:
    from wrt.lean.stand_in import StandIn

    stand_in = StandIn(Builds(Path("none"), Path("none"), "1.19.0", {}))
    with pytest.raises(Missing, match=r"warp\.Mesh"):
        stand_in.Mesh  # noqa: B018
    with pytest.raises(Missing, match="nobody"):
        stand_in.load_module(stand_in.get_module("nobody"), "cpu")


class Unexpected(Exception):
    pass


@pytest.mark.parametrize(
    ("rendered", "error", "calls"), [(False, Unexpected, 2), (True, Unexpected, 1), (True, Missing, 2)]
)
def test_what_goes_wrong_is_tried_again_with_warp_but_not_after_hours(
    rendered: bool, error: type[Exception], calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = Builds(Path("none"), Path("none"), "1.19.0", {builds.FILM: {}})
    monkeypatch.setattr(Builds, "known", lambda: known)
    monkeypatch.delitem(sys.modules, "warp")
    monkeypatch.setattr(lean, "_forget", lambda: sys.modules.update(warp=ModuleType("warp")))
    seen = []

    def run() -> None:
        warp = sys.modules["warp"]
        warp.rendered = rendered  # type: ignore[attr-defined]
        seen.append(type(warp).__name__)
        raise error

    with pytest.raises(error):
        lean.run_lean(run)
    assert seen == ["StandIn", "module"][:calls]


def test_kernels_whose_threads_wait_for_one_another_are_left_to_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.device import Device
    from wrt.kernels.film import film_noise

    Device("cpu").compile(film_noise)
    found = dict(builds.loaded_by_warp())
    assert set(found[builds.FILM]["kernels"]) == {"film_mean", "film_noise"}
    # A name that all of them have, in place of one that such kernels have.
    monkeypatch.setattr(builds, "_COOPERATIVE", b"film_mean")
    assert builds.FILM not in dict(builds.loaded_by_warp())


def test_kernels_that_their_names_do_not_tell_apart_are_left_to_warp() -> None:
    def make(factor: int) -> wp.Kernel:
        @wp.kernel(module=wp.get_module("wrt.test_lean"), enable_backward=False)
        def times(first: int, values_out: wp.array(dtype=int)):  # type: ignore[valid-type]
            values_out[first + wp.tid()] = wp.static(factor)

        return times

    one = make(2)
    wp.load_module("wrt.test_lean", device="cpu")
    assert len(dict(builds.loaded_by_warp())["wrt.test_lean"]["kernels"]) == 1
    both = [one, make(3)]
    wp.load_module("wrt.test_lean", device="cpu")
    assert len(both) == 2
    assert "wrt.test_lean" not in dict(builds.loaded_by_warp())
