"""Parts of a render with impossible headers are refused in one line, whatever they claim."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrt
from wrt.cli import main
from wrt.rendering.merge import merge


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.add(wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), material=wrt.Diffuse(0.5))
    path = tmp_path_factory.mktemp("parts") / "part.wrt"
    wrt.Renderer(scene, width=4, height=4, sampler="independent").part(1, 1, spp=1).save(path)
    return path


def changed(part: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Return a part whose header is changed."""
    with np.load(part) as stored:
        arrays = dict(stored)
    header = json.loads(str(arrays["header"]))
    change(header)
    if header["part"] == [1, 1_600_000_000]:
        arrays = {name: array[:1] if array.shape[:1] == (16,) else array for name, array in arrays.items()}
    path = Path("changed.wrt")
    with path.open("wb") as file:
        np.savez(file, **{**arrays, "header": np.array(json.dumps(header))})
    return path


def claim_many_parts(header: dict[str, Any]) -> None:
    header["identity"] |= {"width": 40_000, "height": 40_000}
    header["part"] = [1, 1_600_000_000]


def test_impossible_headers_are_refused(part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert merge([part]).spp == 1
    for change, message in (
        (claim_many_parts, "parts 2, 3, 4 and 1599999996 more of 1600000000 are missing"),
        (lambda header: header.update(part=[float("inf"), 2]), "Infinity in its header"),
        (lambda header: header.update(part=[1, 2, 3]), "'part' is not a pair"),
        (lambda header: header.update(identity=[]), "'identity' is no table"),
        (lambda header: header.pop("arithmetic"), r"damaged \(it has no 'arithmetic'\)"),
        (lambda header: header.update(seconds=10**400), "seconds is too large"),
        (lambda header: header["identity"].update(integrator="../../x\n"), "integrator must be one of"),
    ):
        with pytest.raises(wrt.InputError, match=message) as found:
            merge([changed(part, change)])
        assert "\n" not in str(found.value)


def test_a_part_cannot_name_a_file_of_tone_curves(part, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("config.ocio").write_text("ocio_profile_version: 2\n")
    changed(part, lambda header: header["developing"].update(tone="ocio:config.ocio,display,view"))
    opened = []
    monkeypatch.setattr("wrt.develop.picture.find_view", opened.append)
    with pytest.raises(wrt.InputError, match="a file, which is opened only where a tone is given here"):
        merge(["changed.wrt"]).save("a.png")
    assert main(["merge", "changed.wrt", "-o", "a.png", "--checkpoint", "a.ckpt"]) == 2
    assert capsys.readouterr().err.startswith("wrt: error: the parts were rendered with tone 'ocio:")
    assert not opened
    assert sorted(path.name for path in tmp_path.iterdir()) == ["changed.wrt", "config.ocio"]
    assert main(["merge", "changed.wrt", "-o", "a.png", "--tone", "soft", "--quiet"]) == 0
    assert main(["merge", "changed.wrt", "-o", "a.exr", "--quiet"]) == 0
    assert not opened
