"""What is installed is whole, and `import wrt` works wherever it is started."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SOURCES = ("wrt", "kernels", "meshes")


def setuptools_options() -> dict[str, Any]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        options = tomllib.load(file)["tool"]["setuptools"]
    assert isinstance(options, dict)
    return options


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
    assert sorted(names) == sorted(setuptools_options()["packages"])


def test_package_map_leads_to_the_folders() -> None:
    mapped = setuptools_options()["package-dir"]
    assert mapped == {"wrt": "wrt", "wrt.kernels": "kernels", "wrt.meshes": "meshes"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from a copy of the source tree, which the build would litter."""
    folder = tmp_path_factory.mktemp("wheel")
    for source in SOURCES:
        shutil.copytree(ROOT / source, folder / "tree" / source, ignore=shutil.ignore_patterns("__pycache__"))
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
    assert {"wrt/py.typed", "wrt/kernels/bsdf/diffuse.py", "wrt/meshes/cornell-box.toml"} <= held
    assert any(name.endswith(".ply") for name in held)
    assert {"wrt/data/hosek_wilkie.npz", "wrt/data/hosek_wilkie.LICENSE"} <= held
    for file in ("LICENSE", "wrt/data/hosek_wilkie.LICENSE"):
        assert any(name.endswith(f".dist-info/licenses/{file}") for name in names)
    assert "License-Expression: Apache-2.0 AND BSD-3-Clause" in metadata
    assert "Requires-Python: >=3.10" in metadata


# Says where the three packages were found, in a Python that knows of no editable installation.
WHERE = """
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in getattr(finder, "__module__", "")]
import wrt, wrt.kernels, wrt.kernels.film, wrt.meshes
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
    found = [Path(line) for line in result.stdout.splitlines()]
    assert all(path.is_file() for path in found)
    return found


IN_TREE = ["wrt/__init__.py", "kernels/__init__.py", "meshes/cornell-box.toml"]
IN_PACKAGE = ["wrt/__init__.py", "wrt/kernels/__init__.py", "wrt/meshes/cornell-box.toml"]


def test_source_tree_works_without_installation() -> None:
    assert packages_found(cwd=ROOT, python_path=None) == [ROOT / name for name in IN_TREE]


@pytest.mark.slow
def test_source_tree_works_beside_an_installed_copy(installed: Path) -> None:
    # The tree's wrt/ hides the installed one from a Python started in it, and has no kernels inside.
    assert packages_found(cwd=ROOT, python_path=installed) == [ROOT / name for name in IN_TREE]


@pytest.mark.slow
def test_installed_copy_works_alone(installed: Path, tmp_path: Path) -> None:
    assert packages_found(cwd=tmp_path, python_path=installed) == [installed / name for name in IN_PACKAGE]


def test_import_is_light() -> None:
    code = "import sys, wrt; print(*sorted(name.partition('.')[0] for name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"numpy", "warp", "trimesh", "PIL", "tqdm", "OpenEXR", "OpenImageIO"} & set(result.stdout.split())


def test_every_public_name_can_be_had() -> None:
    import wrt

    assert set(wrt.__all__) == set(wrt._EXPORTS) | {"__version__"}
    missing = [name for name in wrt.__all__ if not hasattr(wrt, name)]
    assert missing == []
