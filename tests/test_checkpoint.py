"""Checkpoints: whole or not there, and only for the scene they belong to."""

from __future__ import annotations

import dataclasses
import gc
import json
import re
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wrt
from wrt.rendering.checkpoint import FORMAT, identity_of, read_checkpoint, require_same, write_checkpoint
from wrt.scene.layers import LAYERS

HEADER = {"width": 2, "scene": {"geometry": "abc"}, "text": "größer", "none": None, "float": 0.1}
ARRAYS = {
    "total": np.random.default_rng(0).random((4, 3)),
    "count": np.arange(4, dtype=np.int32),
    "empty": np.zeros((0, 3), np.float32),
}


def scene(**changes: object) -> wrt.Scene:
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0)))
    result.environment = wrt.ImageEnvironment(np.random.default_rng(1).random((4, 8, 3)).astype(np.float32))
    result.add(wrt.box(), material=wrt.Diffuse(0.5), emission=0.25)
    result.add_light(wrt.PointLight((1.0, 2.0, 3.0), intensity=4.0))
    return dataclasses.replace(result, **changes)


def renderer_of(**options: Any) -> wrt.Renderer:
    """Return a renderer with a layer, so that one kernel serves all tests here."""
    return wrt.Renderer(scene(), **{"width": 6, "height": 4, "max_depth": 3, "layers": ("depth",), **options})


def rendered(spp: int = 3, **options: Any) -> wrt.Renderer:
    renderer = renderer_of(**options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def refusal(call: Callable[[], object], path: Path) -> str:
    with pytest.raises(wrt.InputError) as caught:
        call()
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text


def same(a: dict[str, NDArray], b: dict[str, NDArray]) -> bool:
    return a.keys() == b.keys() and all(
        x.dtype == b[k].dtype and x.shape == b[k].shape and (x == b[k]).all() for k, x in a.items()
    )


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "film.wrt"
    write_checkpoint(path, HEADER, ARRAYS)
    header, arrays = read_checkpoint(path)
    assert header == {"format": FORMAT, **HEADER}
    assert same(arrays, ARRAYS)
    # The name is taken as it is, and nothing is left beside it.
    assert [p.name for p in tmp_path.iterdir()] == ["film.wrt"]


def test_a_film_goes_on_where_it_was(tmp_path: Path, device: str) -> None:
    path = tmp_path / "film"
    renderer = rendered(spp=3, device=device, seed=5, filter="tent")
    renderer.save_checkpoint(path)
    resumed = wrt.Renderer.resume(path, scene(), device=device)
    assert resumed.spp == 3
    assert (resumed.width, resumed.height, resumed.seed) == (6, 4, 5)
    assert resumed.settings.filter == "tent"
    np.testing.assert_array_equal(resumed.image(), renderer.image())
    np.testing.assert_array_equal(resumed.variance(), renderer.variance())
    for other in (renderer, resumed):
        for _ in other.passes(spp=7):
            pass
    np.testing.assert_array_equal(resumed.image(), renderer.image())


@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (OSError(28, "No space left on device"), wrt.InputError),
        (MemoryError(), wrt.InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
    ids=["disk full", "memory full", "interrupt"],
)
def test_a_failed_write_leaves_the_old_file(
    failure: BaseException, raised: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "film.wrt"
    write_checkpoint(path, HEADER, ARRAYS)
    before = path.read_bytes()

    def fail(file: Any, **_: object) -> None:
        file.write(b"half a file")
        raise failure

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(raised) as caught:
        write_checkpoint(path, {**HEADER, "width": 3}, ARRAYS)
    if raised is wrt.InputError:
        assert str(caught.value).startswith(f"{path}: cannot be written")
        assert "\n" not in str(caught.value)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["film.wrt"]


def test_a_failed_rename_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "film.wrt"
    write_checkpoint(path, HEADER, ARRAYS)
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise PermissionError("not allowed")

    monkeypatch.setattr("os.replace", fail)
    assert "not allowed" in refusal(lambda: write_checkpoint(path, {**HEADER, "width": 3}, ARRAYS), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["film.wrt"]


def test_paths_that_cannot_be_written(tmp_path: Path) -> None:
    assert "directory" in refusal(lambda: write_checkpoint(tmp_path, HEADER, ARRAYS), tmp_path)
    missing = tmp_path / "nowhere" / "film"
    assert "does not exist" in refusal(lambda: write_checkpoint(missing, HEADER, ARRAYS), missing)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    for path in (tmp_path / "missing", tmp_path):
        assert "no such checkpoint file" in refusal(lambda path=path: read_checkpoint(path), path)


def foreign_files() -> dict[str, Callable[[Path], None]]:
    def archive(**arrays: object) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            with path.open("wb") as file:
                np.savez(file, **arrays)  # type: ignore[arg-type]

        return write

    def array(path: Path) -> None:
        with path.open("wb") as file:
            np.save(file, np.zeros(3))

    def zipped(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("hello.txt", "hello")

    return {
        "empty": lambda path: path.write_bytes(b""),
        "text": lambda path: path.write_text("[camera]\norigin = [0, 1, 2]\n"),
        "picture": lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100)),
        "zip": zipped,
        "array": array,
        "pickle": archive(header=np.array([{"format": FORMAT}], dtype=object)),
        "no header": archive(total=np.zeros(3)),
        "header no JSON": archive(header=np.array("{")),
        "header a list": archive(header=np.array("[1]")),
        "header a number": archive(header=np.array(3.0)),
        "header bytes": archive(header=np.array(b"\xff\xfe")),
        "another format": archive(header=np.array(json.dumps({"format": FORMAT + 1}))),
        "no format": archive(header=np.array("{}")),
        "picture of objects": archive(header=np.array(json.dumps({"format": FORMAT})), total=np.array([None])),
    }


@pytest.mark.parametrize("name", foreign_files())
def test_foreign_files(name: str, tmp_path: Path) -> None:
    path = tmp_path / "film"
    foreign_files()[name](path)
    refusal(lambda: read_checkpoint(path), path)


def test_truncated_files(tmp_path: Path) -> None:
    path = tmp_path / "film"
    write_checkpoint(path, HEADER, ARRAYS)
    data = path.read_bytes()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for length in [*range(0, len(data), 13), len(data) - 1]:
            path.write_bytes(data[:length])
            refusal(lambda: read_checkpoint(path), path)
        gc.collect()
    # A file left open is a ResourceWarning as soon as it is collected.
    assert [str(w.message) for w in caught] == []


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("flip", [0xFF, *(pytest.param(bit, marks=pytest.mark.slow) for bit in (0x01, 0x80))])
def test_damaged_files(flip: int, tmp_path: Path) -> None:
    """With any one byte changed, a checkpoint is refused, or read right where the byte does not count."""
    path = tmp_path / "film"
    write_checkpoint(path, HEADER, ARRAYS)
    data = path.read_bytes()
    messages, others = [], []
    for i in range(len(data)):
        path.write_bytes(data[:i] + bytes([data[i] ^ flip]) + data[i + 1 :])
        try:
            header, arrays = read_checkpoint(path)
        except wrt.InputError as error:
            messages.append(str(error))
        except RuntimeError as error:
            others.append(f"byte {i} of {len(data)}: {error!r}")
        else:
            # What may change unseen is a name in the archive: then an array is missing, which the film refuses.
            for name in set(arrays) & set(ARRAYS):
                np.testing.assert_array_equal(arrays[name], ARRAYS[name])
            assert header == {"format": FORMAT, **HEADER}
    gc.collect()
    assert others == []
    assert len(messages) > len(data) / 3
    assert all(text.startswith(f"{path}: ") and "\n" not in text for text in messages)


CHANGES: dict[str, dict[str, object]] = {
    "geometry": {"shapes": [wrt.Shape(wrt.box((0, 0, 0), (1, 1, 1)), wrt.Diffuse(0.5), 0.25)]},
    "materials": {"shapes": [wrt.Shape(wrt.box(), wrt.Diffuse(0.25), 0.25)]},
    "emission": {"shapes": [wrt.Shape(wrt.box(), wrt.Diffuse(0.5), 0.5)]},
    "lights": {"lights": [wrt.PointLight((1.0, 2.0, 3.0), intensity=5.0)]},
    "environment": {"environment": wrt.ImageEnvironment(np.ones((4, 8, 3), np.float32))},
    "camera": {"camera": wrt.PerspectiveCamera((0.0, 1.0, 4.5), (0.0, 0.0, 0.0))},
}


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize("part", CHANGES)
def test_a_scene_that_differs_is_refused_by_its_part(part: str, tmp_path: Path) -> None:
    path = tmp_path / "film"
    rendered().save_checkpoint(path)
    text = refusal(lambda: wrt.Renderer.resume(path, scene(**CHANGES[part])), path)
    assert text == f"{path}: cannot resume, these differ: the scene's {part}"


def test_all_differing_parts_are_named(tmp_path: Path) -> None:
    path = tmp_path / "film"
    rendered().save_checkpoint(path)
    changed = scene(**CHANGES["lights"], **CHANGES["camera"])
    text = refusal(lambda: wrt.Renderer.resume(path, changed), path)
    assert text.endswith("these differ: the scene's lights, the scene's camera")


@pytest.mark.usefixtures("render_kernels_when_launched")
@pytest.mark.parametrize(
    ("key", "there", "here"),
    [
        ("width", 6, 8),
        ("height", 4, 5),
        ("seed", 0, 1),
        ("max_depth", 3, 4),
        ("filter", "blackman-harris", "box"),
        ("sampler", "sobol", "stratified"),
        ("strategy", "mis", "bsdf"),
        ("crop", None, [1, 0, 6, 3]),
    ],
)
def test_settings_that_differ_are_named(key: str, there: object, here: object, tmp_path: Path) -> None:
    path = tmp_path / "film"
    rendered().save_checkpoint(path)
    other = renderer_of(**{key: here})
    before = other.film.state()
    text = refusal(lambda: other.load_checkpoint(path), path)
    assert text == f"{path}: cannot resume, these differ: {key} ({there} there, {here} here)"
    assert same(other.film.state(), before)


@pytest.mark.parametrize("key", ["wrt", "warp"])
def test_another_version_is_refused(key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another version may round otherwise, and then a resumed picture is not the picture."""
    path = tmp_path / "film"
    renderer = rendered()
    monkeypatch.setattr(
        "wrt.rendering.checkpoint.identity_of", lambda renderer: {**identity_of(renderer), key: "0.0.1"}
    )
    renderer.save_checkpoint(path)
    monkeypatch.undo()
    text = refusal(lambda: wrt.Renderer.resume(path, scene()), path)
    assert f"these differ: {key} (0.0.1 there, " in text


@pytest.mark.parametrize(
    "damage",
    [
        {"width": "six"},
        {"height": -1},
        {"width": 1e9},
        {"seed": None},
        {"filter": 7},
        {"sampler": "random"},
        {"filter": []},
        {"max_depth": "deep"},
        {"strategy": ["mis"]},
        {"scene": None},
        {"scene": {}},
    ],
    ids=str,
)
def test_nonsense_in_the_header_is_refused(damage: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "film"
    renderer = rendered(seed=3)
    write_checkpoint(path, {**identity_of(renderer), **damage}, renderer.film.state())
    refusal(lambda: wrt.Renderer.resume(path, scene()), path)


@pytest.mark.parametrize("name", ["total", "total_of_squares", "count", "rejected"])
@pytest.mark.parametrize("change", ["missing", "shape", "type"])
def test_wrong_arrays_are_refused(name: str, change: str, tmp_path: Path) -> None:
    path = tmp_path / "film"
    renderer = rendered()
    state = renderer.film.state()
    if change == "missing":
        del state[name]
    else:
        state[name] = state[name][:-1] if change == "shape" else state[name].astype(np.float32)
    write_checkpoint(path, identity_of(renderer), state)
    text = refusal(lambda: wrt.Renderer.resume(path, scene()), path)
    assert repr(name) in text


def test_require_same_tells_missing_from_different() -> None:
    require_same("x", {"a": 1, "b": {"c": 2}, "more": 3}, {"a": 1, "b": {"c": 2}})
    for stored in ({}, {"a": 2, "b": {"c": 2}}, {"a": 1, "b": {}}, {"a": 1, "b": 5}):
        with pytest.raises(wrt.InputError, match="cannot resume"):
            require_same("x", stored, {"a": 1, "b": {"c": 2}})


IMPOSSIBLE = {
    "count": [(-1, "'count' is -1 samples"), (2, "do not match their squares")],
    "rejected": [(-1, "'rejected' is below 0 or above"), (4, "'rejected' is below 0 or above")],
    "total": [(np.nan, "not finite"), (-np.inf, "not finite"), (1e30, "do not match their squares")],
    "total_of_squares": [(np.inf, "not finite"), (-1.0, "negative"), (1e-9, "do not match their squares")],
    "layer_sums": [(np.nan, "not finite"), (1e6, "the layer '(normal|alpha)' has impossible values")],
    "layer_nearest": [(np.nan, "has values that are not numbers")],
    "layer_object_number": [(-1, "not one of the scene's 1"), (2, "not one of the scene's 1")],
    "layer_off_middle": [(np.nan, "'off_middle'"), (-1.0, "'off_middle'")],
}


@pytest.mark.parametrize(("name", "value", "reason"), [(n, *each) for n, pairs in IMPOSSIBLE.items() for each in pairs])
def test_impossible_numbers_are_refused(name: str, value: float, reason: str, tmp_path: Path) -> None:
    """Like an edited archive: its checksums are right, its numbers are wrong."""
    path = tmp_path / "film"
    renderer = rendered(layers=("normal", "alpha", "depth", "uv", "object"))
    renderer.save_checkpoint(path)
    before = renderer.film.state()
    header, arrays = read_checkpoint(path)
    arrays[name][len(arrays[name]) // 2] = value
    write_checkpoint(path, header, arrays)
    for call in (lambda: renderer.load_checkpoint(path), lambda: wrt.Renderer.resume(path, scene())):
        assert re.search(rf"{path}: damaged, .*{reason}", refusal(call, path))
    assert all(np.array_equal(before[key], now) for key, now in renderer.film.state().items())


@pytest.mark.parametrize("filter", ["box", "blackman-harris"])
def test_what_a_renderer_has_seen_is_always_possible(filter: str, tmp_path: Path) -> None:
    """Radiance of 1e18 next to 1e-18, whose sums round most, and of 0."""
    lit = scene(environment=wrt.ImageEnvironment(np.float32([[[1e18] * 3, [1e-18] * 3], [[0.0] * 3, [1.0] * 3]])))
    renderer = wrt.Renderer(lit, width=16, height=12, max_depth=3, filter=filter, layers=tuple(LAYERS))
    for _ in renderer.passes(spp=64):
        renderer.save_checkpoint(tmp_path / "film")
        renderer.load_checkpoint(tmp_path / "film")
