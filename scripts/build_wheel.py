"""Build wrt's wheels into dist/: one with compiled kernels for Linux on x86-64, and one without for all other systems.

    python scripts/build_wheel.py

The kernels are for processors with AVX-512 and with AVX2, and those of the first can only be made on one. They are kept
in wrt/prebuilt/ until the code of kernels changes.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from wrt.backend import prebuilt

ROOT = Path(__file__).resolve().parent.parent
PLATFORM = "manylinux_2_28_x86_64"
"""Where the compiled kernels run: where Warp does. They are data, which no linker sees."""


def run(*command: str) -> None:
    """Run a module of Python in the checkout; it must succeed."""
    subprocess.run([sys.executable, "-m", *command], cwd=ROOT, check=True)


def build(tree: Path, folder: Path) -> Path:
    """Build a wheel of a tree into a folder, and return its path."""
    quiet = ["--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    run("pip", "wheel", *quiet, "--wheel-dir", str(folder), str(tree))
    (wheel,) = folder.glob("*-any.whl")
    return wheel


def main() -> None:
    """Make the kernels and the wheels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    for level in prebuilt.NEEDED:
        run("wrt.prebuilding", level)
    dist = ROOT / "dist"
    dist.mkdir(exist_ok=True)
    for has_kernels in (False, True):
        with tempfile.TemporaryDirectory() as folder:  # a build litters the tree
            tree = Path(folder, "tree")
            for source in ("wrt", "kernels", "meshes"):
                unused = shutil.ignore_patterns("__pycache__", *(() if has_kernels else ("prebuilt",)))
                shutil.copytree(ROOT / source, tree / source, ignore=unused, symlinks=True)
            for name in ("pyproject.toml", "README.md", "LICENSE"):
                shutil.copy(ROOT / name, tree)
            wheel = build(tree, Path(folder))
            if has_kernels:
                run("wheel", "tags", "--remove", "--platform-tag", PLATFORM, str(wheel))
                (wheel,) = Path(folder).glob("*.whl")
            shutil.move(wheel, dist / wheel.name)
        print(f"{dist / wheel.name}: {(dist / wheel.name).stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
