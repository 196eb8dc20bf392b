"""Cameras of transforms.json and of COLMAP's text files project points as the formulas of these formats do."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.cli import main

ANGLE = 0.7
TURN = np.array([[np.cos(ANGLE), 0, np.sin(ANGLE)], [0, 1, 0], [-np.sin(ANGLE), 0, np.cos(ANGLE)]])
"""About y: w is cos(ANGLE / 2) and y sin(ANGLE / 2) of its quaternion."""
SHIFT = np.array([0.3, -0.2, 4.0])
POINTS = np.random.default_rng(1).uniform(-1, 1, (20, 3))
POSE = np.block([[TURN.T, -(TURN.T @ SHIFT)[:, None]], [np.zeros((1, 3)), 1]]) @ np.diag([1, -1, -1, 1])
"""From the camera's axes in OpenGL's convention to the world."""
LENS = {"fl_x": 500.0, "fl_y": 510.0, "cx": 330.0, "cy": 235.0, "w": 640, "h": 480}


def transforms(path, frames=({},), **keys):
    frames = [{"file_path": "./images/a.png", "transform_matrix": POSE.tolist(), **frame} for frame in frames]
    path.write_text(json.dumps({**keys, "frames": frames}))
    return path


def colmap(path, lens, image="1 {w} 0 {y} 0 0.3 -0.2 4.0 7 images/a.jpg"):
    image = image.format(w=np.cos(ANGLE / 2), y=np.sin(ANGLE / 2))
    (path / "cameras.txt").write_text(f"# Cameras\n7 {lens}\n")
    (path / "images.txt").write_text(f"# Images\n{image}\n\n{image.replace('images/a', 'images/b')}\n1 2 3\n")
    return path


def pixels(distort=lambda x, y: (x, y), f=(500.0, 510.0), c=(330.0, 235.0)):
    """Return the pixels of POINTS from the corner of the picture."""
    x, y, z = (POINTS @ TURN.T + SHIFT).T
    x, y = distort(x / z, y / z)
    return np.stack([f[0] * x + c[0], f[1] * y + c[1]], axis=1)


def radial(*k):
    return lambda x, y: tuple(v * (1 + sum(a * (x * x + y * y) ** i for i, a in enumerate(k, 1))) for v in (x, y))


def opencv(k1, k2, p1, p2):
    def distort(x, y):
        s, (u, v) = x * x + y * y, radial(k1, k2)(x, y)
        return u + 2 * p1 * x * y + p2 * (s + 2 * x * x), v + p1 * (s + 2 * y * y) + 2 * p2 * x * y

    return distort


def fisheye(*k):
    def distort(x, y):
        radius = np.hypot(x, y)
        angle = np.arctan(radius)
        scale = angle * (1 + sum(a * angle ** (2 * i) for i, a in enumerate(k, 1))) / radius
        return x * scale, y * scale

    return distort


ONE = {"f": (500.0, 500.0)}
COLMAP = {
    "SIMPLE_PINHOLE 640 480 500 330 235": pixels(**ONE),
    "PINHOLE 640 480 500 510 330 235": pixels(),
    "SIMPLE_RADIAL 640 480 500 330 235 0.1": pixels(radial(0.1), **ONE),
    "RADIAL 640 480 500 330 235 0.1 -0.05": pixels(radial(0.1, -0.05), **ONE),
    "OPENCV 640 480 500 510 330 235 0.1 -0.05 0.01 0.02": pixels(opencv(0.1, -0.05, 0.01, 0.02)),
    "FULL_OPENCV 640 480 500 510 330 235 0.1 -0.05 0 0 0.02 0 0 0": pixels(radial(0.1, -0.05, 0.02)),
    "OPENCV_FISHEYE 640 480 500 510 330 235 0.1 -0.05 0.01 0.02": pixels(fisheye(0.1, -0.05, 0.01, 0.02)),
}
TRANSFORMS = {
    "intrinsics of the file": (LENS, {}, pixels()),
    "intrinsics of a frame": ({**LENS, "cx": 1.0}, {"cx": 330.0}, pixels()),
    "an angle": ({"camera_angle_x": 2 * np.arctan(0.64), "w": 640.0, "h": 480.0}, {}, pixels(c=(320, 240), **ONE)),
    "opencv": (
        {**LENS, "camera_model": "OPENCV", "k1": 0.1, "k2": -0.05, "p1": 0.01, "p2": 0.02, "k4": 0.0},
        {},
        pixels(opencv(0.1, -0.05, 0.01, 0.02)),
    ),
    "fisheye": ({**LENS, "camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k3": 0.01}, {}, pixels(fisheye(0.1, 0, 0.01))),
    "instant-ngp's fisheye": ({**LENS, "is_fisheye": True, "k1": 0.1}, {}, pixels(fisheye(0.1))),
}


@pytest.mark.parametrize("lens", COLMAP)
def test_cameras_of_colmap(lens, tmp_path):
    folder = colmap(tmp_path, lens)
    found = wrt.load_cameras(folder)
    assert list(found) == ["a", "b"]
    assert found == wrt.load_cameras(folder / "images.txt")
    assert (found["b"].width, found["b"].height) == (640, 480)
    np.testing.assert_allclose(found["b"].camera.project(POINTS, 640, 480), COLMAP[lens], atol=1e-6)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_cameras_of_transforms(name, tmp_path):
    keys, frame, expected = TRANSFORMS[name]
    found = wrt.load_cameras(transforms(tmp_path / "transforms.json", [frame], **keys))
    assert (found["a"].width, found["a"].height) == (640, 480)
    np.testing.assert_allclose(found["a"].camera.project(POINTS, 640, 480), expected, atol=1e-6)


def test_pictures_name_cameras_and_give_their_size(tmp_path):
    (tmp_path / "images").mkdir()
    wrt.save_image(tmp_path / "images" / "a.png", np.ones((3, 5, 3)))
    frames = [{"file_path": "images/a"}, {"file_path": "images/a.png"}, {"file_path": "./more/b", "w": 4, "h": 2}]
    found = wrt.load_cameras(transforms(tmp_path / "t.json", frames, camera_angle_x=1.0))
    assert {name: (each.width, each.height) for name, each in found.items()} == {
        **dict.fromkeys(("images_a", "images_a_1"), (5, 3)),
        "more_b": (4, 2),
    }


@pytest.mark.slow
def test_pictures_of_all_cameras_of_a_file(tmp_path, monkeypatch, capsys):
    """A triangle stays where its file has it, and each picture equals a render with its camera."""
    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text("v -0.5 -0.5 0.2\nv 0.5 -0.5 0\nv 0 0.5 0\nf 1 2 3\n")
    frames = [{"file_path": f"./images/{name}.png"} for name in ("left", "right")]
    frames[1] |= {"w": 32, "h": 16, "fl_x": 30.0, "k1": -0.1, "cx": 16, "cy": 8}
    lens = {"fl_x": 40.0, "w": 40, "h": 24}
    transforms(tmp_path / "transforms.json", frames, **lens)
    assert (
        main(["render", "a.obj", "--cameras", "transforms.json", "--spp", "2", "--quiet", "--layers", "position"]) == 0
    )
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["a-left.exr", "a-right.exr"]
    cameras = wrt.load_cameras("transforms.json")
    scene = wrt.load("a.obj", cameras="transforms.json", camera="right")
    assert (scene.camera, list(scene.cameras)) == (cameras["right"].camera, ["right", "left"])
    np.testing.assert_allclose(scene.shapes[0].mesh.vertices[2], (0, 0.5, 0))
    for name, found in cameras.items():
        size = {"width": found.width, "height": found.height}
        scene = wrt.load("a.obj", cameras="transforms.json", camera=name)
        np.testing.assert_array_equal(wrt.load_image(f"a-{name}.exr"), wrt.render(scene, spp=2, **size))
    command = ["render", "a.obj", "--cameras", "transforms.json", "--spp", "1", "--size", "8x4", "--quiet"]
    assert main([*command, "--camera", "1", "-o", "one.png"]) == 0
    assert wrt.load_image("one.png").shape == (4, 8, 3)
    assert main([*command, "-o", "all/"]) == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["left.png", "right.png"]
    capsys.readouterr()
    for arguments, message in (
        (["--camera", "top"], "transforms.json: there is no camera 'top'; it has 0 'left', 1 'right'"),
        (["--turntable", "9"], "--cameras and --turntable cannot be combined"),
        (["--checkpoint", "c"], "--checkpoint is for a single picture; choose a view by --camera"),
        (["b.obj"], "--cameras is for a single input"),
        (["--up", "z"], "an up axis would turn the source, but not a camera that is not its own"),
    ):
        assert main([*command, *arguments]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


@pytest.mark.filterwarnings("always")
def test_other_commands_take_a_camera_of_a_file(tmp_path, monkeypatch, capsys):
    """A scene that is converted renders as with the options; each model of camera is compiled; a view has its size."""
    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text("v -0.5 -0.5 0.2\nv 0.5 -0.5 0\nv 0 0.5 0\nf 1 2 3\n")
    far = [[1, 0, 0, 0.5], [0, 1, 0, 0.25], [0, 0, 1, 5], [0, 0, 0, 1]]
    frames = [
        {"file_path": "left.png", "transform_matrix": np.diag([1.0, 1.0, 1.0, 1.0]).tolist()},
        {"file_path": "right.png", "transform_matrix": far, "k1": -0.1},
    ]
    transforms(tmp_path / "t.json", frames, w=24, h=16, fl_x=30)
    chosen = ["--cameras", "t.json", "--camera", "right"]
    assert main(["convert", "a.obj", "b.toml", *chosen]) == 0
    assert main(["render", "b.toml", "--spp", "1", "--quiet", "-o", "b.npy"]) == 0
    assert main(["render", "a.obj", *chosen, "--spp", "1", "--quiet", "-o", "a.npy"]) == 0
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    assert np.load("a.npy").shape == (16, 24, 3)
    capsys.readouterr()
    assert main(["convert", "a.obj", "c.toml", "--cameras", "t.json"]) == 0
    assert "of its cameras, 0 'left', 1 'right', the first is taken" in capsys.readouterr().err
    compiled = []
    monkeypatch.setattr("wrt.precompiling.precompiled_by", lambda make: compiled.append(make.args[0].camera.model))
    assert main(["compile", "a.obj", "--cameras", "t.json"]) == 0
    assert sorted(compiled) == ["distorted_perspective", "perspective"]
    for command in ("view", "convert", "compile"):
        output = ["d.toml"] if command == "convert" else []
        capsys.readouterr()
        assert main([command, "a.obj", *output, "--cameras", "t.json", "--camera", "top"]) == 2
        error = capsys.readouterr().err
        assert "t.json: there is no camera 'top'; it has 0 'left', 1 'right'" in error
        assert error.count("\n") == 1
    assert main(["info", "a.obj", "--cameras", "t.json"]) == 2


@pytest.mark.parametrize(
    ("keys", "frame", "message"),
    [
        ({}, {}, "t.json: frame 0 (./images/a.png): has no w and h, and its picture "),
        ({"w": 9, "h": 9}, {}, "frame 0 (./images/a.png): has neither fl_x nor camera_angle_x"),
        ({**LENS, "fl_x": 0.0}, {}, "frame 0 (./images/a.png): K[0, 0], the focal length fx, must be greater than 0"),
        ({**LENS, "camera_model": "OPENVC"}, {}, "camera_model 'OPENVC' is unknown (did you mean 'OPENCV'?)"),
        ({**LENS, "k4": 0.1}, {}, "camera_model OPENCV has no k4, which is not 0"),
        ({**LENS, "fl_x": "wide"}, {}, "fl_x must be a number, not 'wide'"),
        ({"camera_angle_x": 4.0, "w": 9, "h": 9}, {}, "camera_angle_x must be between 0 and pi radians, not 4"),
        (LENS, {"transform_matrix": np.diag([2, 2, 2, 1]).tolist()}, "frame 0 (./images/a.png): the camera's matrix m"),
        (LENS, {"transform_matrix": None}, "frame 0 (./images/a.png): "),
        ({**LENS, "w": 10.5}, {}, "w must be a whole number, not 10.5"),
    ],
)
def test_what_transforms_lack_is_named(keys, frame, message, tmp_path):
    with pytest.raises(wrt.InputError, match=re.escape(message)):
        wrt.load_cameras(transforms(tmp_path / "t.json", [frame], **keys))


def test_files_without_cameras_are_named(tmp_path):
    for text, message in (
        ("{", "is not valid JSON"),
        ("[1]", "has no list of frames"),
        ('{"frames": []}', "has no cam"),
    ):
        (tmp_path / "t.json").write_text(text)
        with pytest.raises(wrt.InputError, match=rf"t\.json: {message}"):
            wrt.load_cameras(tmp_path / "t.json")
    (tmp_path / "t.json").write_text('{"frames": [1]}')
    with pytest.raises(wrt.InputError, match="frame 0 is no table"):
        wrt.load_cameras(tmp_path / "t.json")
    (tmp_path / "t.json").write_text('{"frames": [{"file_path": "a"}]}')
    with pytest.raises(wrt.InputError, match=r"frame 0 \(a\): has no transform_matrix"):
        wrt.load_cameras(tmp_path / "t.json")
    with pytest.raises(wrt.InputError, match=r"cameras are read from transforms\.json, or from COLMAP's"):
        wrt.load_cameras(tmp_path / "t.txt")
    for missing in (tmp_path, tmp_path / "none.json"):
        with pytest.raises(wrt.InputError, match=rf"^{re.escape(str(missing))}.*: no such file"):
            wrt.load_cameras(missing)


@pytest.mark.parametrize(
    ("lens", "image", "message"),
    [
        (
            "PINHOLE 640 480 500",
            "",
            "cameras.txt: line 2: PINHOLE needs width, height and fx, fy, cx, cy, not 3 numbers",
        ),
        ("FOV 640 480 500 500 1 1 1", "", "camera model 'FOV' is unknown; known are SIMPLE_PINHOLE"),
        ("PINHOLE 640 480 500 510 330 x", "", "cameras.txt: line 2: 'x' is no number"),
        ("PINHOLE 640 480 500 510 330 235", "1 1 0 0 0 0 0 0 8 a", "images.txt: a: camera 8 is not in cameras.txt"),
        ("PINHOLE 640 480 500 510 330 235", "1 1 0 0 0 0 0", "images.txt: line 2: an image needs IMAGE_ID"),
        ("PINHOLE 640 480 500 510 330 235", "1 0 0 0 0 0 0 0 7 a", "its quaternion must have the length 1, not 0"),
        (
            "PINHOLE 640 480 500 510 330 235",
            "1 0.8 0 0.6 0 1e200 0 0 7 a",
            "images.txt: a: camera origin and target must",
        ),
        ("PINHOLE", "", "cameras.txt: line 2: PINHOLE needs width, height and fx, fy, cx, cy, not 0 numbers"),
    ],
)
def test_what_files_of_colmap_lack_is_named(lens, image, message, tmp_path):
    with pytest.raises(wrt.InputError, match=re.escape(message)):
        wrt.load_cameras(colmap(tmp_path, lens, image))
    (tmp_path / "cameras.txt").rename(tmp_path / "cameras.bin")
    with pytest.raises(wrt.InputError, match=r"cameras\.txt: no such file; 'colmap model_converter --output_type TXT'"):
        wrt.load_cameras(tmp_path)


def test_cameras_that_are_written_are_read_again(tmp_path):
    moving = wrt.Motion((0.0, 1.0), [np.eye(4), [[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]])
    place = {"origin": (1.0, 2.0, 3.0), "target": (0.0, 0.5, 0.0)}
    plain = wrt.PerspectiveCamera(**place, fov_degrees=40)
    shifted = wrt.PerspectiveCamera(**place, fov_degrees=60, pixel_aspect=1.1, shift_x=0.2, shift_y=-0.1)
    distorted = wrt.PerspectiveCamera(**place, distortion=(0.1, -0.05, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06))
    round_lens = wrt.FisheyeCamera(**place, fov_degrees=170, distortion=(0.01, 0.02), circular=False)
    cameras = {"a.png": plain, "b.png": shifted, "c.png": distorted, "d.png": round_lens}
    cameras |= {"e.png": wrt.PerspectiveCamera(**place, motion=moving, shutter_open=0.5, shutter_close=0.5)}
    for count, some in enumerate((cameras, {"a.png": plain}, {"a.png": plain, "f.png": plain})):
        for _ in range(2):  # it replaces its own files
            wrt.save_cameras(tmp_path / f"t{count}.json", some, 64, 48)
        found = wrt.load_cameras(tmp_path / f"t{count}.json")
        assert list(found) == [name[0] for name in some]
        points = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
        for name, camera in some.items():
            again = found[name[0]]
            assert (again.width, again.height) == (64, 48)
            expected = camera.project(points, 64, 48)
            assert np.allclose(again.camera.project(points, 64, 48), expected, atol=1e-6, equal_nan=True)
    assert json.loads((tmp_path / "t2.json").read_text())["fl_x"] == pytest.approx(24.0 / np.tan(np.radians(20.0)))
    (tmp_path / "own.json").write_text("{}")
    for path, some, message in (
        ("own.json", {"a": plain}, "own.json: already exists and is not"),
        ("t.txt", {"a": plain}, "must end in .json"),
        ("t.json", {}, "no cameras to write"),
        ("t.json", {"a": wrt.PanoramaCamera((0, 0, 0), (0, 0, 1))}, "a PanoramaCamera has no focal lengths"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            wrt.save_cameras(tmp_path / path, some, 64, 48)
    assert (tmp_path / "own.json").read_text() == "{}"
