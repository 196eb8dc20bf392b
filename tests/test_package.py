"""What is installed is whole, and `import wrt` works wherever it is started."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import setuptools
from conftest import ROOT

import wrt

SOURCES = ("wrt", "kernels", "meshes")


def source_files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]


def installed_name(path: Path) -> str:
    """Return where a file of the source tree belongs in an installed package."""
    relative = path.relative_to(ROOT)
    return relative.as_posix() if relative.parts[0] == "wrt" else f"wrt/{relative.as_posix()}"


def test_every_folder_with_python_files_is_a_package() -> None:
    folders = {path.parent for source in SOURCES for path in source_files(ROOT / source) if path.suffix == ".py"}
    assert all((folder / "__init__.py").is_file() for folder in folders)
    names = [installed_name(folder).replace("/", ".") for folder in folders]
    assert sorted(names) == sorted(setuptools.find_packages(str(ROOT), include=["wrt*"]))


@pytest.mark.parametrize("name", ["kernels", "meshes"])
def test_links_lead_to_the_folders_at_the_top(name: str) -> None:
    assert (ROOT / "wrt" / name).readlink() == Path("..", name)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from a copy of the source tree, which the build would litter."""
    folder = tmp_path_factory.mktemp("wheel")
    for source in SOURCES:
        unused = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / source, folder / "tree" / source, ignore=unused, symlinks=True)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "tree")
    build = ["pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    result = subprocess.run(
        [sys.executable, "-m", *build, "--wheel-dir", str(folder), str(folder / "tree")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    (built,) = folder.glob("wrt-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """Return a folder with the content of the wheel, as `pip install --target` leaves it."""
    target = wheel.parent / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


@pytest.mark.slow
def test_wheel_holds_every_source_file_and_no_other(wheel: Path) -> None:
    expected = {installed_name(path) for source in SOURCES for path in source_files(ROOT / source)}
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        held = {name for name in names if not name.split("/")[0].endswith(".dist-info")}
        metadata = archive.read(next(name for name in names if name.endswith(".dist-info/METADATA"))).decode()
    assert held == expected
    assert {"wrt/py.typed", "wrt/__init__.pyi", "wrt/kernels/bsdf/diffuse.py", "wrt/meshes/cornell-box.toml"} <= held
    assert any(name.endswith(".ply") for name in held)
    assert {"wrt/scene/skies/data/hosek_wilkie.npz", "wrt/scene/skies/data/hosek_wilkie.LICENSE"} <= held
    for file in ("LICENSE", "wrt/scene/skies/data/hosek_wilkie.LICENSE"):
        assert any(name.endswith(f".dist-info/licenses/{file}") for name in names)
    assert "License-Expression: Apache-2.0 AND BSD-3-Clause" in metadata
    assert "Requires-Python: >=3.10" in metadata


def test_no_public_name_is_a_module_too() -> None:
    """Importing a submodule sets the attribute of the same name of the package, and so would hide the public name."""
    modules = {path.stem for path in (ROOT / "wrt").iterdir() if path.suffix == ".py" or path.is_dir()}
    assert not modules & set(wrt.__all__)


# Says where wrt, its kernels and its meshes were found, in a Python that knows of no editable installation.
WHERE = """
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in getattr(finder, "__module__", "")]
import wrt, wrt.kernels, wrt.kernels.film.film, wrt.meshes
assert wrt.Mesh.__module__ == "wrt.scene.mesh"
print(wrt.__file__, wrt.kernels.__file__, wrt.meshes.scene_path("cornell-box"), sep="\\n")
"""


def packages_found(*, cwd: Path, python_path: Path | None) -> list[Path]:
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    if python_path is not None:
        environment["PYTHONPATH"] = str(python_path)
    result = subprocess.run(
        [sys.executable, "-c", WHERE], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    found = [Path(line).resolve() for line in result.stdout.splitlines()]
    assert all(path.is_file() for path in found)
    return found


FOUND = ["wrt/__init__.py", "wrt/kernels/__init__.py", "wrt/meshes/cornell-box.toml"]


def test_source_tree_works_without_installation() -> None:
    assert packages_found(cwd=ROOT, python_path=None) == [(ROOT / name).resolve() for name in FOUND]


@pytest.mark.slow
def test_source_tree_works_beside_an_installed_copy(installed: Path) -> None:
    # The tree's wrt/ hides the installed one from a Python started in it.
    assert packages_found(cwd=ROOT, python_path=installed) == [(ROOT / name).resolve() for name in FOUND]


@pytest.mark.slow
def test_installed_copy_works_alone(installed: Path, tmp_path: Path) -> None:
    assert packages_found(cwd=tmp_path, python_path=installed) == [installed / name for name in FOUND]


def test_import_is_light() -> None:
    code = "import sys, wrt; print(*sorted(name.partition('.')[0] for name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"numpy", "warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO"} & set(result.stdout.split())


def test_every_public_name_can_be_imported() -> None:
    names: dict[str, object] = {}
    exec("from wrt import *", names)
    assert set(names) - {"__builtins__"} == set(wrt.__all__) == set(dir(wrt))
    assert {"Renderer", "Scene", "__version__", "register_material", "render"} <= set(names)


def test_a_name_that_wrt_lacks_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'wrt' has no attribute 'rendr'"):
        wrt.rendr  # noqa: B018


@pytest.mark.slow
def test_type_checkers_see_the_public_names(tmp_path: Path) -> None:
    script = tmp_path / "uses.py"
    script.write_text("from wrt import Scene\nreveal_type(Scene().shapes)\nimport wrt\nwrt.rendr\n")
    cache = f"--cache-dir={tmp_path / 'cache'}"
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", cache, str(script)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert 'note: Revealed type is "list[wrt.scene.scene.Shape]"' in result.stdout, result.stdout
    assert 'error: Module has no attribute "rendr"' in result.stdout
    assert "Found 1 error" in result.stdout


@pytest.mark.parametrize("name", ["wrt.wrt", "wrt.tests", "wrt.scripts", "wrt.docs"])
def test_other_folders_of_the_checkout_are_no_part_of_the_package(name: str) -> None:
    assert importlib.util.find_spec(name) is None
