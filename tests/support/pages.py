"""The pages of the documentation, and what stands in them."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

from conftest import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        *sorted(ROOT.glob("docs/**/*.md")),
    )
}
"""By path from the repository: README, CHANGELOG, CONTRIBUTING and docs/."""


def parsed(toml: str) -> dict[str, Any]:
    return tomllib.loads(toml)


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def inline_code(text: str) -> list[str]:
    return re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL))


def without_code(text: str) -> str:
    return re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)


def slug(heading: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def program_of(page: str, name: str) -> str:
    """Return the Python program of a page in docs/ that begins with its name."""
    (code,) = (code for code in blocks(PAGES[f"docs/{page}.md"], "python") if code.startswith(f"# {name}\n"))
    return code


def definitions(code: str, path: Path) -> dict[str, Any]:
    """Return what code defines that runs as a module from a file, since Warp reads it."""
    path.write_text(code, "utf-8")
    return runpy.run_path(str(path), run_name=path.stem)


def run_program(code: str, path: Path) -> None:
    """Run code from a file in the file's folder; it must print nothing."""
    path.write_text(code, "utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, path.name]
    done = subprocess.run(command, cwd=path.parent, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
