"""Parts of a render merge to the picture of one machine, to the bit; parts that do not fit are refused by name."""

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.small_scenes import assert_same_arrays, block_scene, finish, image_of

import wrt
from wrt.cli import main
from wrt.rendering.part import render_part
from wrt.rendering.windows import pixels_of, read_windows, windows_of_part, write_windows

SIZE = {"width": 24, "height": 37, "max_depth": 3}
LAYERS = ("albedo", "depth", "object", "material", "crypto_object", "crypto_material")


@pytest.fixture(scope="module")
def renderer():
    return wrt.Renderer(block_scene(), layers=LAYERS, transparent=True, **SIZE)


@pytest.fixture(scope="module")
def single(renderer):
    return finish(renderer.sharing(), 5)


@pytest.mark.parametrize("crop", [(0, 0, 24, 37), (3, 5, 20, 6), (0, 0, 1, 100)])
def test_windows_cover_a_picture_once_and_evenly(crop):
    x0, y0, x1, y1 = crop
    for of in (1, 2, 3, 7, 16):
        counts = np.zeros((y1 - y0) * (x1 - x0), np.int32)
        windows = [windows_of_part(crop, number, of) for number in range(1, of + 1)]
        for number, each in enumerate(windows, start=1):
            write_windows(counts, crop, each, read_windows(counts, crop, each) + number)
        sizes = [pixels_of(each) for each in windows]
        assert sorted(np.unique(counts)) == list(range(1, of + 1))
        assert sum(sizes) == counts.size
        assert 0 < min(sizes) <= max(sizes) <= min(sizes) + max(4 * (x1 - x0), 2)
    tops = [y for _, y, _, _ in windows_of_part((0, 0, 64, 1024), 16, 16)]  # bands of the whole height
    assert len(tops) == 4
    assert np.ptp(tops) >= 512


@pytest.mark.parametrize("of", [1, 3, 50])
def test_merged_parts_are_the_film_of_one_machine(renderer, single, of):
    """In any order, also of a crop window; 50 parts of 37 rows are pieces of rows."""
    merged = wrt.merge(reversed([renderer.part(number, of, spp=5) for number in range(1, of + 1)]))
    assert_same_arrays(merged.film.arrays(), single.film.arrays())
    np.testing.assert_array_equal(merged.image(), single.image())
    np.testing.assert_array_equal(merged.alpha(), single.alpha())
    assert_same_arrays(merged.layers(), single.layers())
    window = renderer.sharing(crop=(2, 3, 20, 31))
    merged = wrt.merge([window.part(number, of, spp=5) for number in range(1, of + 1)])
    np.testing.assert_array_equal(merged.image(), single.image()[3:31, 2:20])


def test_a_part_goes_on_where_it_ended(renderer, tmp_path):
    """Ranges of samples are chained: the sums of the second begin with those of the first."""
    path = tmp_path / "a.wrt"
    renderer.part(2, 50, spp=2).save(path)
    begun = wrt.Part.load(path)
    further = render_part(renderer, 2, 50, spp=5, begun=begun)
    assert_same_arrays(further.arrays, renderer.part(2, 50, spp=5).arrays)
    with pytest.raises(wrt.InputError, match=r"a\.wrt: cannot resume, it is part 2 of 50"):
        render_part(renderer, 1, 50, spp=5, begun=begun)
    with pytest.raises(wrt.InputError, match=r"a\.wrt: cannot resume, it has 2 samples per pixel, more than 1"):
        render_part(renderer, 2, 50, spp=1, begun=begun)


def test_a_merged_checkpoint_goes_on_with_the_scene(renderer, single, tmp_path):
    wrt.merge([renderer.part(number, 2, spp=2) for number in (1, 2)]).save_checkpoint(tmp_path / "film.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "film.ckpt", block_scene())
    assert resumed.spp == 2
    np.testing.assert_array_equal(image_of(resumed, 5), single.image())


def changed(part, group, /, **values):
    """Return a part with other values in its header, or in a table of it."""
    header = {**part.header, **({group: {**part.header[group], **values}} if group else values)}
    return dataclasses.replace(part, header=header, name="b.wrt")


def test_parts_that_do_not_fit_are_refused_by_name(renderer):
    first, second = (renderer.part(number, 2, spp=2) for number in (1, 2))
    broken = {**second.arrays, "total": second.arrays["total"] * np.nan}
    for part, message in (
        (changed(second, "identity", seed=9), r"does not fit .*, these differ: seed \(9, not 0\)"),
        (changed(second, "identity", scene={"camera": "0"}), r".* the scene's camera"),
        (changed(second, "arithmetic", device="cuda 90"), r".* device \(cuda 90, not cpu\)"),
        (changed(second, None, spp=3), r".* samples per pixel \(3, not 2\)"),
        (changed(second, None, part=[2, 3]), r".* number of parts \(3, not 2\)"),
        (dataclasses.replace(second, arrays=broken, name="b.wrt"), "damaged, sums of samples are not finite"),
    ):
        with pytest.raises(wrt.InputError, match=rf"b\.wrt: {message}"):
            wrt.merge([first, part])


def test_missing_repeated_and_foreign_parts_are_refused(renderer, tmp_path):
    first = renderer.part(1, 9, spp=1)
    path, checkpoint = tmp_path / "a.wrt", tmp_path / "b.wrt"
    first.save(path)
    renderer.sharing().save_checkpoint(checkpoint)
    damaged = tmp_path / "c.wrt"
    content = bytearray(path.read_bytes())
    content[content.index(b"total.npy") + 1000] ^= 1  # the local header of an array has no checksum
    damaged.write_bytes(content)
    old = tmp_path / "d.wrt"
    changed(first, None, wrt="0.0.1").save(old)
    for parts, message in (
        ([first, first], r"^part 1 of 9 and part 1 of 9 are the same part, 1 of 9; leave one out$"),
        ([path], r"^parts 2, 3, 4 and 5 more of 9 are missing$"),
        ([], "there are no parts"),
        ([checkpoint], "not a part"),
        ([damaged], r"c\.wrt: not a wrt part, or damaged"),
        ([old], r"a part of wrt 0\.0\.1; this is wrt"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            wrt.merge(parts)
    with pytest.raises(wrt.InputError, match="exists"):
        first.save(checkpoint)


def test_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    wrt.save_scene("room.toml", block_scene())
    options = ["--size", "12x10", "--spp", "2", "--quiet"]
    assert main(["render", "room.toml", "-o", "one.exr", *options]) == 0
    for number in (1, 2):
        assert main(["render", "room.toml", "--part", f"{number}/2", *options]) == 0
    assert main(["merge", "room-1-of-2.wrt", "room-2-of-2.wrt", "-o", "merged.exr", "--quiet"]) == 0
    np.testing.assert_array_equal(wrt.load_image("merged.exr"), wrt.load_image("one.exr"))
    assert capsys.readouterr().err == ""
    for command, message in (
        (["merge", "room-2-of-2.wrt", "-o", "half.exr"], "part 1 of 2 is missing\n"),
        (
            ["render", "room.toml", "--part", "2/2", "--resume", *options, "--seed", "4"],
            "room-2-of-2.wrt: cannot resume, these differ: seed (0 there, 4 here)",
        ),
        (["render", "room.toml", "--part", "1/2", "--noise", "1%"], "--noise"),
    ):
        assert main(command) == 2
        assert message in capsys.readouterr().err
    assert not os.path.exists("half.exr")


@pytest.fixture
def stored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wrt.Renderer(block_scene(), transparent=True, **SIZE).part(1, 1, spp=1).save("part.wrt")
    return Path("part.wrt")


def with_header(part: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Return a part whose header is changed."""
    with np.load(part) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    change(header)
    if header["part"] == [1, 1_600_000_000]:
        arrays = {name: array[:1] if array.shape[:1] == (24 * 37,) else array for name, array in arrays.items()}
    path = Path("changed.wrt")
    with path.open("wb") as file:
        np.savez(file, **{**arrays, "header": np.array(json.dumps(header))})
    return path


def claim_many_parts(header: dict[str, Any]) -> None:
    header["identity"] |= {"width": 40_000, "height": 40_000}
    header["part"] = [1, 1_600_000_000]


def test_impossible_headers_are_refused(stored):
    assert wrt.merge([stored]).spp == 1
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
            wrt.merge([with_header(stored, change)])
        assert "\n" not in str(found.value)


def test_a_part_cannot_name_a_file_of_tone_curves(stored, tmp_path, monkeypatch, capsys):
    Path("config.ocio").write_text("ocio_profile_version: 2\n")
    with_header(stored, lambda header: header["developing"].update(tone="ocio:config.ocio,display,view"))
    opened = []
    monkeypatch.setattr("wrt.develop.picture.find_view", opened.append)
    with pytest.raises(wrt.InputError, match="a file, which is opened only where a tone is given here"):
        wrt.merge(["changed.wrt"]).save("a.png")
    assert main(["merge", "changed.wrt", "-o", "a.png", "--checkpoint", "a.ckpt"]) == 2
    assert capsys.readouterr().err.startswith("wrt: error: the parts were rendered with tone 'ocio:")
    assert not opened
    assert sorted(path.name for path in tmp_path.iterdir()) == ["changed.wrt", "config.ocio", "part.wrt"]
    assert main(["merge", "changed.wrt", "-o", "a.png", "--tone", "soft", "--quiet"]) == 0
    assert main(["merge", "changed.wrt", "-o", "a.exr", "--quiet"]) == 0
    assert not opened
