"""Turntables and videos: frames are pictures of turned scenes, an interrupted animation goes on, mistakes are named."""

import os

import numpy as np
import pytest
from PIL import Image, ImageSequence

import wrt
from wrt.animation.timeline import at_frame, moves
from wrt.cli import main

SMALL = ["--size", "24x18", "--spp", "1", "--quiet"]


@pytest.fixture
def mesh(tmp_path, monkeypatch):
    """A box in the current folder."""
    monkeypatch.chdir(tmp_path)
    box = wrt.box((0, 0, 0), (1, 1, 3))
    np.savez("box.npz", vertices=box.vertices, faces=box.faces)
    return tmp_path / "box.npz"


def test_a_mesh_turns_once_in_its_studio_or_the_camera_around_a_scene(mesh):
    scene = wrt.load(mesh)
    frames = list(wrt.turntable(scene, 4))
    assert len(frames) == 4
    assert len({frame.camera for frame in frames}) == 1
    assert all(a is b for frame in frames for a, b in zip(frame.shapes[1:], frames[0].shapes[1:], strict=True))
    extents = [np.ptp(frame.shapes[0].bounds, axis=0) for frame in frames]
    np.testing.assert_allclose(extents[1], extents[0][[2, 1, 0]], atol=1e-5)  # a quarter swaps width and depth
    np.testing.assert_allclose(extents[2], extents[0], atol=1e-5)
    scene = wrt.load("cornell-box")
    frames = list(wrt.turntable(scene, 3))
    assert frames[0].camera == scene.camera
    away = np.array([np.subtract(frame.camera.origin, frame.camera.target) for frame in frames])
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), np.linalg.norm(away[0]), rtol=1e-6)
    np.testing.assert_allclose(away[:, 1], away[0, 1], atol=1e-6)


def test_resuming_renders_only_missing_frames(mesh, capsys):
    command = ["render", "box.npz", "--turntable", "3", "-o", "box_%02d.exr", *SMALL]
    assert main(command) == 0
    paths = [mesh.parent / f"box_{number:02d}.exr" for number in range(3)]
    paths[1].unlink()
    times = [paths[k].stat().st_mtime_ns for k in (0, 2)]
    assert main([*command, "--resume"]) == 0
    assert [paths[k].stat().st_mtime_ns for k in (0, 2)] == times
    for path, scene in zip(paths, wrt.turntable(wrt.load(mesh, aspect=24 / 18), 3), strict=True):
        np.testing.assert_array_equal(wrt.load_image(path), wrt.render(scene, width=24, height=18, spp=1))
    capsys.readouterr()
    assert main([*command, "--resume", "--seed", "7"]) == 2
    assert "seed" in capsys.readouterr().err


def test_a_transparent_frame_is_exposed_as_a_picture_is(mesh):
    command = ["render", "box.npz", "--transparent", "--material", "diffuse:0.02", *SMALL, "--size", "48x36"]
    assert main([*command, "--turntable", "2", "-o", "box_%d.png"]) == 0
    scene = wrt.load(mesh, transparent=True, material=wrt.Diffuse((0.02, 0.02, 0.02)), aspect=48 / 36)
    renderer = wrt.Renderer(next(iter(wrt.turntable(scene, 2))), width=48, height=36)
    renderer.render(spp=1)
    renderer.save("one.png")
    np.testing.assert_array_equal(*(np.asarray(Image.open(name)) for name in ("box_0.png", "one.png")))


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_videos_have_all_frames(mesh, suffix):
    assert main(["render", "box.npz", "--turntable", "3", "--fps", "10", "-o", f"box{suffix}", *SMALL]) == 0
    with Image.open(f"box{suffix}") as video:
        assert video.size == (24, 18)
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(video)]
        assert video.info.get("duration") == 100
    assert len(frames) == 3
    assert not np.array_equal(frames[0], frames[1])
    assert set(os.listdir()) == {f"box{suffix}", "box.npz"}


def test_keyframes_move_from_frame_to_frame():
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    far = np.eye(4)
    far[0, 3] = 2.0
    scene.add(wrt.sphere(subdivisions=2), transform=wrt.Motion([0.0, 1.0], [np.eye(4), far]))
    assert moves(scene)
    assert at_frame(scene, 12, 24.0).camera.shutter_open == pytest.approx(0.5)
    assert not moves(wrt.load("cornell-box"))


def test_mistakes_are_reported_in_one_message(mesh, capsys):
    for options, words in (
        (["--turntable", "1"], "at least 2"),
        (["--frames", "0-2", "-o", "a.gif"], "nothing in it moves"),
        (["--turntable", "3", "-o", "a.png"], "with a place for their numbers"),
        (["--turntable", "3", "--checkpoint", "c"], "--checkpoint is for a single picture"),
        (["--turntable", "2", "-o", "mine.gif", *SMALL], "mine.gif"),  # no other file is replaced
    ):
        (mesh.parent / "mine.gif").write_bytes(b"GIF89a of somebody else")
        assert main(["render", "box.npz", *options]) in (1, 2)
        printed = capsys.readouterr().err
        assert words in printed
        assert "Traceback" not in printed
        assert sorted(os.listdir()) == ["box.npz", "mine.gif"]
        assert (mesh.parent / "mine.gif").read_bytes() == b"GIF89a of somebody else"


def test_errors_of_the_frame_generator_reach_the_caller(tmp_path):
    failure = RuntimeError("the solver diverged")

    def frames():
        yield np.zeros((2, 2, 3), np.float32)
        raise failure

    with pytest.raises(RuntimeError) as raised:
        wrt.save_video(tmp_path / "a.gif", frames())
    assert raised.value is failure
    assert not list(tmp_path.iterdir())
