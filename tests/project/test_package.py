"""What is installed is whole, `import wrt` works wherever it is started, and the Dockerfile names what there is."""

import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import setuptools
from conftest import ROOT

import wrt
from wrt.backend import cache_folders

SOURCES = ("wrt", "kernels", "meshes")


def source_files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]


def installed_name(path: Path) -> str:
    """Return where a file of the source tree belongs in an installed package."""
    relative = path.relative_to(ROOT)
    return relative.as_posix() if relative.parts[0] == "wrt" else f"wrt/{relative.as_posix()}"


def test_every_folder_with_python_files_is_a_package_and_others_are_none():
    folders = {path.parent for source in SOURCES for path in source_files(ROOT / source) if path.suffix == ".py"}
    assert all((folder / "__init__.py").is_file() for folder in folders)
    names = [installed_name(folder).replace("/", ".") for folder in folders]
    assert sorted(names) == sorted(setuptools.find_packages(str(ROOT), include=["wrt*"]))
    for name in ("kernels", "meshes"):
        assert (ROOT / "wrt" / name).readlink() == Path("..", name)
    for name in ("wrt.wrt", "wrt.tests", "wrt.scripts", "wrt.docs"):
        assert importlib.util.find_spec(name) is None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return a wheel built from a copy of the source tree, which the build would litter."""
    folder = tmp_path_factory.mktemp("wheel")
    for source in SOURCES:
        unused = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / source, folder / "tree" / source, ignore=unused, symlinks=True)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "tree")
    build = ["pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    command = [sys.executable, "-m", *build, "--wheel-dir", str(folder), str(folder / "tree")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    (built,) = folder.glob("wrt-*.whl")
    return built


@pytest.mark.slow
def test_the_wheel_holds_every_source_file_and_no_other(wheel):
    expected = {installed_name(path) for source in SOURCES for path in source_files(ROOT / source)}
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = archive.read(next(name for name in names if name.endswith(".dist-info/METADATA"))).decode()
    assert {name for name in names if not name.split("/")[0].endswith(".dist-info")} == expected
    sky = "wrt/scene/skies/data/hosek_wilkie"
    assert {"wrt/py.typed", "wrt/__init__.pyi", "wrt/meshes/cornell-box.toml", f"{sky}.npz"} <= set(names)
    for file in ("LICENSE", f"{sky}.LICENSE"):
        assert any(name.endswith(f".dist-info/licenses/{file}") for name in names)
    assert "License-Expression: Apache-2.0 AND BSD-3-Clause" in metadata
    assert "Requires-Python: >=3.10" in metadata


# Says where wrt, its kernels and its meshes were found, in a Python that knows of no editable installation.
WHERE = """
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in getattr(finder, "__module__", "")]
import wrt
heavy = {"numpy", "warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO"} & set(sys.modules)
assert not heavy, heavy
import wrt.kernels, wrt.kernels.film.film, wrt.meshes
assert wrt.Mesh.__module__ == "wrt.scene.mesh"
print(wrt.__file__, wrt.kernels.__file__, wrt.meshes.scene_path("cornell-box"), sep="\\n")
"""
FOUND = ["wrt/__init__.py", "wrt/kernels/__init__.py", "wrt/meshes/cornell-box.toml"]


def packages_found(*, cwd: Path, python_path: Path | None) -> list[Path]:
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    if python_path is not None:
        environment["PYTHONPATH"] = str(python_path)
    command = [sys.executable, "-c", WHERE]
    result = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return [Path(line).resolve() for line in result.stdout.splitlines()]


def test_the_source_tree_works_without_installation_and_import_is_light():
    assert packages_found(cwd=ROOT, python_path=None) == [(ROOT / name).resolve() for name in FOUND]


@pytest.mark.slow
def test_an_installed_copy_works_alone_and_beside_the_source_tree(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")  # as `pip install --target` leaves it
    installed = tmp_path / "installed"
    assert packages_found(cwd=tmp_path, python_path=installed) == [installed / name for name in FOUND]
    # The tree's wrt/ hides the installed one from a Python started in it.
    assert packages_found(cwd=ROOT, python_path=installed) == [(ROOT / name).resolve() for name in FOUND]


def test_every_public_name_can_be_imported_and_no_other():
    """Importing a submodule sets the attribute of its name, so a public name that is a module would be hidden."""
    names = {}
    exec("from wrt import *", names)
    assert set(names) - {"__builtins__"} == set(wrt.__all__) == set(dir(wrt))
    assert {"Renderer", "Scene", "__version__", "register_material", "render"} <= set(names)
    assert not {path.stem for path in (ROOT / "wrt").iterdir() if path.suffix == ".py" or path.is_dir()} & set(names)
    with pytest.raises(AttributeError, match="module 'wrt' has no attribute 'rendr'"):
        wrt.rendr  # noqa: B018


def test_the_dockerfile_keeps_kernels_in_a_folder_for_all_users(monkeypatch):
    text = (ROOT / "Dockerfile").read_text()
    (made,) = re.findall(r"^RUN mkdir -m 1777 (\S+)$", text, re.MULTILINE)
    (variables,) = re.findall(r"^ENV (.*)$", text, re.MULTILINE)
    for name in ("HOME", "XDG_CACHE_HOME", "WARP_CACHE_PATH"):
        monkeypatch.delenv(name, raising=False)
    for pair in variables.split():
        monkeypatch.setenv(*pair.split("="))
    assert cache_folders.user_folder() == Path(made)
    for folder in (cache_folders.warp_folder(), cache_folders.wrt_folder()):
        assert Path(made) in folder.parents
