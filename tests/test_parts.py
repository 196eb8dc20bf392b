"""Parts of a render merge to the picture of one machine, bit for bit; what does not fit together is refused by name."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_checkpoint import scene

import wrt
from wrt.cli import main
from wrt.parts.cut import pixels_of, put, take, windows_of_part
from wrt.rendering.sharing import sharing

SIZE = {"width": 24, "height": 37, "max_depth": 3}
OPTIONS = ["--size", "12x10", "--spp", "2", "--quiet"]


@pytest.fixture(scope="module")
def renderer() -> wrt.Renderer:
    return wrt.Renderer(scene(), layers=("albedo", "depth", "object", "material"), transparent=True, **SIZE)


@pytest.fixture(scope="module")
def whole(renderer: wrt.Renderer) -> wrt.Renderer:
    other = sharing(renderer)
    for _ in other.passes(spp=5):
        pass
    return other


@pytest.mark.parametrize("crop", [(0, 0, 24, 37), (3, 5, 20, 6), (0, 0, 1, 100)])
@pytest.mark.parametrize("of", [1, 2, 3, 7, 16])
def test_windows_cover_a_picture_once_and_evenly(crop: tuple[int, int, int, int], of: int) -> None:
    x0, y0, x1, y1 = crop
    seen = np.zeros((y1 - y0) * (x1 - x0), np.int32)
    counts = []
    for number in range(1, of + 1):
        windows = windows_of_part(crop, number, of)
        counts.append(pixels_of(windows))
        assert counts[-1] > 0
        before = take(seen, crop, windows)
        put(seen, crop, windows, before + number)
    assert sorted(np.unique(seen)) == list(range(1, of + 1))
    assert sum(counts) == seen.size
    assert max(counts) - min(counts) <= max(4 * (x1 - x0), 2)


def test_parts_have_bands_of_the_whole_height() -> None:
    for number in (1, 16):
        tops = [y0 for _, y0, _, _ in windows_of_part((0, 0, 64, 1024), number, 16)]
        assert len(tops) == 4
        assert np.ptp(tops) >= 512


@pytest.mark.parametrize("of", [1, 3, 50])
def test_merged_parts_are_the_film_of_one_machine(renderer: wrt.Renderer, whole: wrt.Renderer, of: int) -> None:
    """In any order; 50 parts of 37 rows are pieces of rows."""
    parts = [renderer.part(number, of, spp=5) for number in range(1, of + 1)]
    merged = wrt.merge(reversed(parts))
    for name, array in whole.film.arrays().items():
        np.testing.assert_array_equal(merged.film.arrays()[name], array, err_msg=name)
    np.testing.assert_array_equal(merged.image(), whole.image())
    np.testing.assert_array_equal(merged.alpha(), whole.alpha())
    assert merged.layers().keys() == whole.layers().keys()
    for name, layer in whole.layers().items():
        np.testing.assert_array_equal(merged.layers()[name], layer, err_msg=name)
    assert renderer.spp == 0


def test_a_crop_window_is_cut_and_merged(whole: wrt.Renderer, renderer: wrt.Renderer) -> None:
    window = sharing(renderer, crop=(2, 3, 20, 31))
    merged = wrt.merge([window.part(number, 2, spp=5) for number in (1, 2)])
    np.testing.assert_array_equal(merged.image(), whole.image()[3:31, 2:20])


def test_a_part_goes_on_where_it_ended(renderer: wrt.Renderer, tmp_path: Path) -> None:
    """Ranges of samples are chained: the sums of the second begin with those of the first."""
    from wrt.parts.render import render_part

    path = tmp_path / "a.wrt"
    renderer.part(2, 50, spp=2).save(path)
    begun = wrt.Part.load(path)
    assert len(begun.windows) == 2
    further = render_part(renderer, 2, 50, spp=5, begun=begun)
    at_once = renderer.part(2, 50, spp=5)
    for name, array in at_once.arrays.items():
        np.testing.assert_array_equal(further.arrays[name], array, err_msg=name)
    with pytest.raises(wrt.InputError, match=r"a\.wrt: cannot resume, it is part 2 of 50"):
        render_part(renderer, 1, 50, spp=5, begun=begun)
    with pytest.raises(wrt.InputError, match=r"a\.wrt: cannot resume, it has 2 samples per pixel, more than 1"):
        render_part(renderer, 2, 50, spp=1, begun=begun)


def test_a_merged_checkpoint_goes_on_with_the_scene(
    renderer: wrt.Renderer, whole: wrt.Renderer, tmp_path: Path
) -> None:
    merged = wrt.merge([renderer.part(number, 2, spp=2) for number in (1, 2)])
    merged.save_checkpoint(tmp_path / "film.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "film.ckpt", scene())
    assert resumed.spp == 2
    for _ in resumed.passes(spp=5):
        pass
    np.testing.assert_array_equal(resumed.image(), whole.image())


def _with(part: wrt.Part, group: str, key: str, value: Any) -> wrt.Part:
    header = {**part.header, group: {**part.header[group], key: value}}
    return dataclasses.replace(part, header=header, name="b.wrt")


def _other_scene(part: wrt.Part) -> wrt.Part:
    digests = {**part.header["identity"]["scene"], "camera": "0"}
    return _with(part, "identity", "scene", digests)


def _damaged(part: wrt.Part) -> wrt.Part:
    arrays = {**part.arrays, "total": part.arrays["total"] * np.nan}
    return dataclasses.replace(part, arrays=arrays, name="b.wrt")


REFUSED: dict[str, tuple[Callable[[wrt.Part], wrt.Part], str]] = {
    "seed": (
        lambda part: _with(part, "identity", "seed", 9),
        r"b\.wrt: does not fit .*, these differ: seed \(9, not 0\)",
    ),
    "scene": (_other_scene, r"b\.wrt: .* the scene's camera$"),
    "warp": (lambda part: _with(part, "identity", "warp", "0.1"), r"b\.wrt: .* warp \(0\.1, not "),
    "device": (lambda part: _with(part, "arithmetic", "device", "cuda 90"), r"b\.wrt: .* device \(cuda 90, not cpu\)"),
    "processor": (lambda part: _with(part, "arithmetic", "processor", "x"), r"b\.wrt: .* processor \(x, not "),
    "spp": (
        lambda part: dataclasses.replace(part, header={**part.header, "spp": 3}, name="b.wrt"),
        r"b\.wrt: .* samples per pixel \(3, not 2\)",
    ),
    "cut": (
        lambda part: dataclasses.replace(part, header={**part.header, "part": [2, 3]}, name="b.wrt"),
        r"b\.wrt: .* number of parts \(3, not 2\)",
    ),
    "values": (_damaged, r"b\.wrt: damaged, sums of samples are not finite"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_parts_that_do_not_fit_are_refused_by_name(renderer: wrt.Renderer, what: str) -> None:
    change, message = REFUSED[what]
    parts = [renderer.part(1, 2, spp=2), change(renderer.part(2, 2, spp=2))]
    with pytest.raises(wrt.InputError, match=message):
        wrt.merge(parts)


def test_missing_and_repeated_parts_are_refused(renderer: wrt.Renderer) -> None:
    first = renderer.part(1, 9, spp=1)
    with pytest.raises(wrt.InputError, match=r"^part 1 of 9 and part 1 of 9 are the same part, 1 of 9; leave one out$"):
        wrt.merge([first, first])
    with pytest.raises(wrt.InputError, match=r"^parts 2, 3, 4 and 5 more of 9 are missing$"):
        wrt.merge([first])
    with pytest.raises(wrt.InputError, match="there are no parts"):
        wrt.merge([])


def test_files_that_are_no_parts_are_refused(renderer: wrt.Renderer, tmp_path: Path) -> None:
    path, other = tmp_path / "a.wrt", tmp_path / "film.ckpt"
    part = renderer.part(1, 2, spp=1)
    part.save(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(wrt.InputError, match=rf"^{re.escape(str(path))}: not a wrt part, or damaged"):
        wrt.merge([path])
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 1
    path.write_bytes(flipped)
    with pytest.raises(wrt.InputError, match=rf"^{re.escape(str(path))}: not a wrt part, or damaged"):
        wrt.merge([path])
    sharing(renderer).save_checkpoint(other)
    with pytest.raises(wrt.InputError, match="not a part"):
        wrt.merge([other])
    with pytest.raises(wrt.InputError, match="exists"):
        part.save(other)
    old = dataclasses.replace(part, header={**part.header, "wrt": "0.0.1"})
    path.unlink()
    old.save(path)
    with pytest.raises(wrt.InputError, match=r"a part of wrt 0\.0\.1; this is wrt"):
        wrt.merge([path])


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    wrt.save_scene("room.toml", scene())
    assert main(["render", "room.toml", "-o", "one.exr", *OPTIONS]) == 0
    for number in (1, 2):
        assert main(["render", "room.toml", "--part", f"{number}/2", *OPTIONS]) == 0
    assert main(["merge", "room-1-of-2.wrt", "room-2-of-2.wrt", "-o", "merged.exr", "--quiet"]) == 0
    assert wrt.load_image("merged.exr").tobytes() == wrt.load_image("one.exr").tobytes()
    assert capsys.readouterr().err == ""
    assert main(["merge", "room-2-of-2.wrt", "-o", "half.exr"]) == 2
    assert capsys.readouterr().err == "wrt: error: part 1 of 2 is missing\n"
    assert not Path("half.exr").exists()
    assert main(["render", "room.toml", "--part", "2/2", "--resume", *OPTIONS, "--seed", "4"]) == 2
    assert "room-2-of-2.wrt: cannot resume, these differ: seed (0 there, 4 here)" in capsys.readouterr().err
    for options, message in ((["--part", "3/2"], "from 1/2 to 2/2"), (["--part", "1/2", "--noise", "1%"], "--noise")):
        assert main(["render", "room.toml", *options]) == 2
        assert message in capsys.readouterr().err
