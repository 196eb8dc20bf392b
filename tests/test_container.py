"""What the Dockerfile installs, sets and names exists. Nothing is built here."""

from __future__ import annotations

import importlib
import json
import re
import shlex
from importlib.metadata import EntryPoint, entry_points, requires
from pathlib import Path

import pytest
from conftest import ROOT

from wrt.backend import cache_folders
from wrt.cli.arguments.options import make_parser

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib  # type: ignore[import-not-found,no-redef]

TEXT = (ROOT / "Dockerfile").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def value_of(instruction: str) -> str:
    (value,) = re.findall(rf"^{instruction} (.*)$", TEXT, re.MULTILINE)
    return str(value)


def commands() -> list[list[str]]:
    """Return the commands of its comment, each after the options of docker and the image's name."""
    return [shlex.split(line) for line in re.findall(r"^# +docker run .*? wrt (.*)$", TEXT, re.MULTILINE)]


def test_it_installs_an_extra_that_there_is_and_leaves_nothing_out() -> None:
    (target,) = re.findall(r"'(/src\S*)'", value_of("RUN pip install"))
    folder, extras = re.fullmatch(r"(/\w+)\[(.+)\]", target).groups()  # type: ignore[union-attr]
    assert value_of("COPY") == f". {folder}"
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    # What is not copied must not be needed: the sources, and the files that pyproject.toml names.
    left_out = (ROOT / ".dockerignore").read_text().split()
    for name in ("wrt", "kernels", "meshes", "pyproject.toml", PROJECT["readme"]):
        assert (ROOT / name).exists()
        assert name not in left_out


def test_its_python_is_one_that_wrt_supports() -> None:
    minor = int(re.fullmatch(r"python:3\.(\d+)-slim", value_of("FROM"))[1])  # type: ignore[index]
    assert minor >= int(PROJECT["requires-python"].removeprefix(">=3."))


def test_kernels_are_kept_where_it_makes_a_folder_for_all_users(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = dict(pair.split("=") for pair in value_of("ENV").split())
    (made,) = re.findall(r"^RUN mkdir -m 1777 (\S+)$", TEXT, re.MULTILINE)
    for name in ("HOME", "XDG_CACHE_HOME", "WARP_CACHE_PATH"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert cache_folders.user_folder() == Path(made)
    assert Path(made) in cache_folders.warp_folder().parents
    assert Path(made) in cache_folders.wrt_folder().parents


def test_its_commands_are_commands() -> None:
    """Those of wrt have options that there are, and those of Dask belong to what the extra installs."""
    pytest.importorskip("distributed")
    given = [*commands(), json.loads(value_of("CMD"))]
    assert [command[0] for command in given] == ["wrt", "dask", "wrt"]
    part, worker, usage = given
    module, function = PROJECT["scripts"]["wrt"].split(":")
    assert callable(getattr(importlib.import_module(module), function))
    assert make_parser().parse_args(part[1:]).part is not None
    assert usage == ["wrt", "--help"]
    assert [script.name for script in entry_points(group="console_scripts") if script.name == "dask"] == ["dask"]
    found: list[EntryPoint] = [each for each in entry_points(group="dask_cli") if each.name == worker[1]]
    assert [each.value.split(".")[0] for each in found] == ["distributed"]
    options = {name for option in found[0].load().params for name in option.opts}
    assert {word for word in worker if word.startswith("--")} <= options
    extra = [text for text in requires("distributed") or () if re.match(r"dask\b", text)]
    assert extra  # distributed, which the extra names, brings the program dask
