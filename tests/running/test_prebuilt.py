"""Kernels that come with the package: found by processor and digest, as trusted as code, and no compiler starts."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from support.caches import python, without_artefacts
from support.wide_scenes import LANES, needs_lanes

import wrt
from wrt import backend, prebuilding
from wrt.backend import artefacts, current_backend, fingerprint, prebuilt, processor
from wrt.backend.artefacts import Artefacts
from wrt.backend.backend import Backend
from wrt.backend.kernel_cache import DIGEST
from wrt.backend.processor import lanes_of
from wrt.compiling import later

FILM = "wrt.kernels.film.film"


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a folder with the prebuilt film kernel, which a process with an empty cache uses."""
    compiler = Backend()
    compiler.flags = wp.config.cpu_compiler_flags  # with those of tests as well, it is put into the table
    compiler.load(compiler.kernels(FILM).film_noise, "cpu")
    found = compiler.artefacts
    file = Path(found.table["files"][FILM]["file"])
    folder = tmp_path / "prebuilt" / "v3"
    folder.mkdir(parents=True)
    for path in (file, Path(f"{file}{DIGEST}")):
        shutil.copy(path, folder)
    monkeypatch.setattr(prebuilt, "FOLDER", folder.parent)
    prebuilt.write_prebuilt("v3", found.code, {**found.table, "files": {FILM: found.table["files"][FILM]}})
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv(prebuilt.SWITCH, "v3")
    return folder


def kernel_of_film() -> object:
    return Artefacts().kernel(FILM, "film_noise")


def test_what_came_with_the_package_is_found_by_level_and_digest(package, monkeypatch):
    assert kernel_of_film() is not None
    assert Artefacts().has("wrt.kernels.film.film.film_noise")
    package.chmod(0o777)  # whoever can write there can change the code, too
    assert kernel_of_film() is not None
    for switch in ("0", "v4", "v9"):
        monkeypatch.setenv(prebuilt.SWITCH, switch)
        assert kernel_of_film() is None
    monkeypatch.setenv(prebuilt.SWITCH, "v3")
    monkeypatch.setattr(artefacts, "digest_of_code", lambda _: "of other code")
    assert kernel_of_film() is None


def test_nothing_of_it_goes_into_the_cache_and_the_cache_comes_first(package):
    found = Artefacts()
    found.add("values", "a", {"value": 1})
    found.save()
    assert found.path is not None
    saved = json.loads(found.path.read_bytes().partition(b"\n")[2])
    assert saved == {"files": {}, "structs": {}, "values": {"a": {"value": 1}}}
    assert found.get("values", "wrt.kernels.film.film.film_noise") == {"kernel": [FILM, "film_noise"]}
    found.table["files"][FILM] = {**found.prebuilt["files"][FILM], "kernels": {}}
    assert found.kernel(FILM, "film_noise") is not None, "a build of the cache that lacks a kernel hides no other"


def test_damaged_files_are_not_loaded(package):
    (file,) = package.glob("*.o")
    whole = file.read_bytes()
    file.write_bytes(whole[:-1] + b"?")
    assert kernel_of_film() is None
    file.write_bytes(whole[:-1])
    assert kernel_of_film() is None
    (table,) = package.glob("*.json")
    table.write_bytes(table.read_bytes()[:-1])
    with pytest.warns(UserWarning, match="is damaged; install wrt again"):
        assert Artefacts().prebuilt == {"files": {}, "structs": {}, "values": {}}


def test_levels_of_processors(monkeypatch):
    v4, v3 = prebuilt.NEEDED["v4"], prebuilt.NEEDED["v3"]
    assert [prebuilt.level_of(frozenset(flags)) for flags in (v4, v3, v4 - {"avx512vl"}, v3 - {"fma"}, {"asimd"})] == [
        *("v4", "v3", "v3", "", "")
    ]
    assert prebuilding.flags_of("v3").startswith("-target-cpu x86-64-v3 -mllvm")
    monkeypatch.setenv(prebuilt.SWITCH, "")
    monkeypatch.setattr(prebuilt, "processor_flags", lambda: frozenset({"asimd", "sve"}))
    assert Artefacts().prebuilt["values"] == {}
    monkeypatch.setattr(processor, "processor_flags", lambda: frozenset({"asimd", "sve"}))
    assert lanes_of(processor.processor_flags()) == 0
    assert prebuilding.main(["prebuild"]) == 0
    with pytest.raises(SystemExit, match="2"):
        prebuilding.main(["prebuild", "v3"])


def test_other_systems_read_no_prebuilt_kernels(package, monkeypatch):
    """Warp then compiles and launches, as with versions that were not tested (test_artefacts.py)."""
    monkeypatch.setattr(sys, "platform", "darwin")
    found = Artefacts()
    assert (found.can_launch, found.path, found.code, found.prebuilt["files"]) == (False, None, "", {})


def test_the_digest_does_not_depend_on_where_the_code_lies(tmp_path, monkeypatch):
    before = fingerprint.digest_of_code("1.19.0")
    folders = {}
    for package in ("wrt.kernels", "wrt.spmd", "wrt.backend"):
        folders[package] = tmp_path / package
        shutil.copytree(fingerprint.folder_of(package), folders[package])
    monkeypatch.setattr(fingerprint, "folder_of", folders.__getitem__)
    assert fingerprint.digest_of_code("1.19.0") == before
    assert fingerprint.digest_of_code("1.19.1") != before
    (tmp_path / "wrt.spmd" / "added.py").touch()
    assert fingerprint.digest_of_code("1.19.0") != before


def test_what_is_there_is_kept_and_code_that_changes_meanwhile_is_not_published(package, monkeypatch):
    for name in (prebuilt.SWITCH, later.SWITCH, processor.SWITCH, "XDG_CACHE_HOME", "WARP_CACHE_PATH"):
        monkeypatch.setenv(name, "v3" if name == prebuilt.SWITCH else "0")  # `main` changes them
    monkeypatch.setattr(backend, "_backend", None)
    monkeypatch.setattr(processor, "processor_flags", lambda: prebuilt.NEEDED["v3"])
    monkeypatch.setattr(prebuilding, "variants", lambda lanes: [("features", lanes)])
    monkeypatch.setattr(prebuilding, "is_compiled", lambda features, lanes: False)
    monkeypatch.setattr(prebuilding, "build", lambda *_: current_backend().artefacts.add("values", "new", {"value": 1}))
    (package / "stale.o").touch()
    assert prebuilding.main(["prebuild", "v3", "--beside"]) == 0, "as the environment forbids it"
    assert (package / "stale.o").exists()
    assert prebuilding.main(["prebuild", "v3"]) == 0
    assert not (package / "stale.o").exists()
    assert Artefacts().get("values", "new") == {"value": 1}
    assert kernel_of_film() is not None
    monkeypatch.setattr(prebuilding, "digest_of_code", lambda _: "of other code")
    with pytest.raises(wrt.InputError, match="has changed while they were compiled"):
        prebuilding.main(["prebuild", "v3"])


IN_FOLDER = """
import sys
from pathlib import Path
from wrt.backend import prebuilt
prebuilt.FOLDER = Path("prebuilt").resolve()
"""

BUILD = """
from wrt import prebuilding
of_level = prebuilding.variants
prebuilding.variants = lambda lanes: of_level(lanes)[:1]
sys.exit(prebuilding.main(sys.argv))
"""

RENDER = """
from wrt.cli import main
assert main(["render", *sys.argv[1:], "--size", "24x16", "--spp", "3", "--quiet", "-o", "film.npy"]) == 0
print("warp" in sys.modules)
"""


@needs_lanes
@pytest.mark.machinery
def test_the_first_picture_starts_no_compiler_and_has_the_bits_of_native_code(tmp_path):
    """Of one kernel in place of all: `scripts/build_wheel.py` takes minutes."""
    level = {16: "v4", 8: "v3"}[LANES]
    variables = {**without_artefacts(tmp_path), "WRT_WIDE": "", prebuilt.SWITCH: ""}
    printed = python(tmp_path, variables, "-c", IN_FOLDER + BUILD, level)
    assert f"MB of kernels for x86-64-{level}" in printed
    assert python(tmp_path, variables, "-c", IN_FOLDER + BUILD, level) == "", "it is there"
    for scene, *options in (("teapot", "--environment", "sky"), ("cornell-box",)):
        variables["XDG_CACHE_HOME"] = str(tmp_path / scene)
        assert python(tmp_path, variables, "-c", IN_FOLDER + RENDER, scene, *options) == "False\n"
        film = np.load(tmp_path / "film.npy")
        native = wrt.load(scene, **({"environment": "sky"} if scene == "teapot" else {}))
        expected = wrt.render(native, width=24, height=16, spp=3)
        np.testing.assert_array_equal(film, expected)
    assert not list(tmp_path.glob("*/warp/**/*.o"))
