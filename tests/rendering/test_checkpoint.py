"""Checkpoints: complete or absent, and only for their own scene and settings."""

import gc
import json
import os
import re

import numpy as np
import pytest
from support.small_scenes import assert_same_arrays, block_scene, finish

import wrt
from wrt.rendering.checkpoint import FORMAT, identity_of, read_checkpoint, write_checkpoint
from wrt.scene.layers import LAYERS

HEADER = {"width": 2, "scene": {"geometry": "abc"}, "text": "größer", "none": None, "float": 0.1}
ARRAYS = {
    "total": np.random.default_rng(0).random((4, 3)),
    "count": np.arange(4, dtype=np.int32),
    "empty": np.zeros((0, 3), np.float32),
}


def renderer_of(scene=None, **options):
    """Return a renderer with layers, so that one kernel serves all tests here."""
    layers = ("normal", "alpha", "depth", "uv", "object", "crypto_object")
    return wrt.Renderer(
        scene or block_scene(), **{"width": 6, "height": 4, "max_depth": 3, "layers": layers, **options}
    )


@pytest.fixture(scope="module")
def film():
    return finish(renderer_of(), 3)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "film"


def refusal(call, *arguments):
    """Return the message of a refusal in one line, which begins with the last argument that is a path."""
    with pytest.raises(wrt.InputError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    (path,) = (str(argument) for argument in arguments if isinstance(argument, os.PathLike))
    assert text.startswith(f"{path}: ")
    return text


def test_round_trip_and_paths_that_cannot_be_written_or_read(path, tmp_path):
    write_checkpoint(path, HEADER, ARRAYS)
    header, arrays = read_checkpoint(path)
    assert header == {"format": FORMAT, **HEADER}
    assert_same_arrays(arrays, ARRAYS)
    assert [array.dtype for array in arrays.values()] == [array.dtype for array in ARRAYS.values()]
    assert os.listdir(path.parent) == ["film"]  # the name is taken as it is, and nothing is left beside it
    assert "directory" in refusal(write_checkpoint, tmp_path, HEADER, ARRAYS)
    assert "does not exist" in refusal(write_checkpoint, tmp_path / "nowhere" / "film", HEADER, ARRAYS)
    for path in (tmp_path / "missing", tmp_path):
        assert "no such checkpoint file" in refusal(read_checkpoint, path)


@pytest.mark.parametrize("failure", [OSError(28, "No space left"), MemoryError(), KeyboardInterrupt()], ids=repr)
@pytest.mark.parametrize("place", ["np.savez", "os.replace"])
def test_a_failed_write_leaves_the_old_file(failure, place, path, monkeypatch):
    write_checkpoint(path, HEADER, ARRAYS)
    before = path.read_bytes()

    def fail(file, *_, **__):
        if place == "np.savez":
            file.write(b"half a file")
        raise failure

    monkeypatch.setattr(np if place == "np.savez" else os, place[3:], fail)
    is_interrupt = isinstance(failure, KeyboardInterrupt)
    with pytest.raises(
        KeyboardInterrupt if is_interrupt else wrt.InputError, match=None if is_interrupt else "written"
    ):
        write_checkpoint(path, {**HEADER, "width": 3}, ARRAYS)
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == ["film"]


FOREIGN = {
    "empty": b"",
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "pickle": {"header": np.array([{"format": FORMAT}], dtype=object)},
    "no header": {"total": np.zeros(3)},
    "header no JSON": {"header": np.array("{")},
    "header bytes": {"header": np.array(b"\xff\xfe")},
    "another format": {"header": np.array(json.dumps({"format": FORMAT + 1}))},
    "picture of objects": {"header": np.array(json.dumps({"format": FORMAT})), "total": np.array([None])},
}


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_files_are_refused(name, path):
    with path.open("wb") as file:
        content = FOREIGN[name]
        file.write(content) if isinstance(content, bytes) else np.savez(file, **content)
    refusal(read_checkpoint, path)


@pytest.mark.parametrize("flip", [0xFF, pytest.param(0x01, marks=pytest.mark.slow)])
def test_damaged_and_truncated_files(flip, path, recwarn):
    """A checkpoint with any one byte changed is refused, or read right if the byte does not matter."""
    write_checkpoint(path, HEADER, ARRAYS)
    data = path.read_bytes()
    for length in [*range(0, len(data), 13), len(data) - 1]:
        path.write_bytes(data[:length])
        refusal(read_checkpoint, path)
    gc.collect()
    assert [str(w.message) for w in recwarn] == []  # a file left open is a ResourceWarning as soon as it is collected
    refusals = []
    for i in range(len(data)):
        path.write_bytes(data[:i] + bytes([data[i] ^ flip]) + data[i + 1 :])
        try:
            header, arrays = read_checkpoint(path)
        except wrt.InputError as error:
            refusals.append(str(error))
        else:
            # What may change unseen is a name in the archive: then an array is missing, which the film refuses.
            for name in set(arrays) & set(ARRAYS):
                np.testing.assert_array_equal(arrays[name], ARRAYS[name])
            assert header == {"format": FORMAT, **HEADER}
    assert len(refusals) > len(data) / 3
    assert all(re.fullmatch(rf"{re.escape(str(path))}: [^\n]+", text) for text in refusals)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_scenes_and_settings_that_differ_are_named(film, path):
    """tests/files/test_fingerprint.py has the parts that each change shows in."""
    film.save_checkpoint(path)
    changed = block_scene(lights=[], camera=wrt.PerspectiveCamera((0.0, 1.0, 4.5), (0.0, 0.0, 0.0)))
    text = refusal(wrt.Renderer.resume, path, changed)
    assert text == f"{path}: cannot resume, these differ: the scene's lights, the scene's camera"
    film.save_checkpoint(path)
    for key, stored, value in (
        ("width", 6, 8),
        ("seed", 0, 1),
        ("sampler", "sobol", "stratified"),
        ("strategy", "mis", "bsdf"),
        ("crop", None, [1, 0, 6, 3]),
    ):
        renderer = renderer_of(**{key: value})
        before = renderer.film.state()
        text = refusal(renderer.load_checkpoint, path)
        assert text == f"{path}: cannot resume, these differ: {key} ({stored} there, {value} here)"
        assert_same_arrays(renderer.film.state(), before)


def test_other_versions_nonsense_in_the_header_and_wrong_arrays_are_refused(film, path):
    # Another version may round otherwise, and then a resumed picture is not the picture.
    for damage in (
        *({"wrt": "0.0.1"}, {"warp": "0.0.1"}, {"width": "six"}, {"height": -1}, {"width": 1e9}, {"seed": None}),
        *({"filter": []}, {"sampler": "random"}, {"max_depth": "deep"}, {"scene": None}, {"scene": {}}),
    ):
        write_checkpoint(path, {**identity_of(film), **damage}, film.film.state())
        text = refusal(wrt.Renderer.resume, path, block_scene())
        assert "0.0.1" not in str(damage) or f"these differ: {next(iter(damage))} (0.0.1 there, " in text
    for name in ("total", "count"):
        for change in (lambda array: None, lambda array: array[:-1], lambda array: array.astype(np.float32)):
            state = film.film.state()
            state[name] = change(state[name])
            write_checkpoint(path, identity_of(film), {k: array for k, array in state.items() if array is not None})
            assert repr(name) in refusal(wrt.Renderer.resume, path, block_scene())


def test_impossible_numbers_are_refused(film, path):
    """As in an edited archive, whose checksums are right and whose numbers are wrong."""
    for name, value, reason in (
        ("count", -1, "'count' is -1 samples"),
        ("rejected", 4, "'rejected' is below 0 or above"),
        ("total", np.nan, "not finite"),
        ("total_of_squares", -1.0, "negative"),
        ("total_of_squares", 1e-9, "do not match their squares"),
        ("layer_sums", 1e6, "the layer '(normal|alpha)' has impossible values"),
        ("layer_object_number", 3, "not one of the scene's 2"),
        ("layer_coverage", 3, "coverage by objects has impossible values"),
        ("layer_coverage", 2, "more samples of its objects than samples"),
    ):
        film.save_checkpoint(path)
        before = film.film.state()
        header, arrays = read_checkpoint(path)
        arrays[name][len(arrays[name]) // 2] = value
        write_checkpoint(path, header, arrays)
        for call in (lambda path: film.load_checkpoint(path), lambda path: wrt.Renderer.resume(path, block_scene())):
            assert re.search(rf"{path}: damaged, .*{reason}", refusal(call, path))
        assert_same_arrays(film.film.state(), before)


@pytest.mark.parametrize("filter", ["box", "blackman-harris"])
def test_what_a_renderer_has_seen_is_always_possible(filter, path):
    """Radiance of 1e18 next to 1e-18, whose sums round most, and of 0."""
    sky = wrt.ImageEnvironment(np.float32([[[1e18] * 3, [1e-18] * 3], [[0.0] * 3, [1.0] * 3]]))
    lit = block_scene(environment=sky)
    renderer = renderer_of(lit, width=16, height=12, filter=filter, layers=tuple(LAYERS))
    for _ in renderer.passes(spp=64):
        renderer.save_checkpoint(path)
        renderer.load_checkpoint(path)
