"""`wrt develop` and the options --tone and --exposure make the PNG that Python makes of the same radiance."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.outputs import SMALL, run
from support.small_scenes import finish

import wrt


def codes(path):
    with Image.open(path) as image:
        return np.asarray(image)


def tone_of(path):
    with Image.open(path) as image:
        return image.text["Tone"]


@pytest.fixture(autouse=True)
def radiance(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    image = np.random.default_rng(6).gamma(0.5, 1.0, (48, 64, 3)).astype(np.float32)
    wrt.save_image("room.exr", image)
    return image


def test_a_picture_is_developed_as_from_python(radiance, capsys):
    for options, settings in (
        ((), {}),
        (("--tone", "none", "--exposure", "-1.5"), {"tone": "none", "exposure": -1.5}),
        (("--tone", "aces", "--exposure", "auto"), {"tone": "aces", "exposure": "auto"}),
        (("--tone", "ocio"), {"tone": "ocio"}),
    ):
        assert run("develop", "room.exr", "-o", "room.png", *options) == 0
        np.testing.assert_array_equal(codes("room.png"), wrt.develop_image(radiance, **settings))
        assert f"tone {settings.get('tone', 'soft')}" in capsys.readouterr().err
        assert tone_of("room.png") == settings.get("tone", "soft")


def test_the_default_name_follows_the_source_and_replaces_no_foreign_file(capsys):
    assert run("develop", "room.exr") == 0
    assert sorted(os.listdir()) == ["room.exr", "room.png"]
    Path("room.png").write_bytes(b"notes")
    assert run("develop", "room.exr", "-o", "room.png") == 2
    assert "already exists" in capsys.readouterr().err
    assert run("develop", "room.exr") == 0
    assert sorted(os.listdir()) == ["room-render.png", "room.exr", "room.png"]
    assert run("develop", "room.exr", "-o", "room.png", "--force") == 0
    assert codes("room.png").shape == (48, 64, 3)


def test_a_render_is_developed_with_its_options(capsys):
    """Which its checkpoint does not depend on."""
    assert run("render", "cornell-box", "-o", "a.exr", *SMALL) == 0
    state = ("--checkpoint", "a.ckpt", "--resume")
    assert run("render", "cornell-box", "-o", "a.png", *SMALL, *state, "--tone", "aces", "--exposure", "auto") == 0
    expected = wrt.develop_image(wrt.load_image("a.exr"), tone="aces", exposure="auto")
    np.testing.assert_array_equal(codes("a.png"), expected)
    assert run("render", "cornell-box", "-o", "b.png", *SMALL, *state, "--exposure", "9", "--tone", "none") == 0
    assert tone_of("b.png") == "none"
    assert "too bright and clipped; darken it by --exposure 8" in capsys.readouterr().err


def test_unsupported_outputs_are_refused_before_rendering_and_others_leave_nothing(capsys):
    for options, message in (
        (("--tone", "ocio:none.ocio"), "none.ocio: no such OpenColorIO configuration"),
        (("--transparent",), "c.jpg: a JPEG has no alpha; give it a name that ends in .png or .exr"),
        (("--layers", "albedo"), "c.jpg: layers go into OpenEXR files"),
        (("--layers", "nomal"), "there is no layer 'nomal' (did you mean 'normal'?)"),
        (("--integrator", "aov"), "integrator aov renders only layers; name some"),
        (("--size", "65536x1"), "c.jpg: a JPEG has 65535 pixels a side at most, not 65536x1"),
    ):
        assert run("render", "cornell-box", "-o", "c.jpg", *SMALL, *options) == 2
        assert message in capsys.readouterr().err
        assert not os.path.exists("c.jpg")
    for arguments, message in (
        (("room.exr", "-o", "room.png", "--tone", "agxx"), "did you mean 'agx'"),
        (("damaged.exr",), "damaged.exr: cannot be read as an image"),
    ):
        Path("damaged.exr").write_bytes(b"v/1\x01damaged")
        before = sorted(os.listdir())
        assert run("develop", *arguments) == 2
        printed = capsys.readouterr().err
        assert message in printed
        assert printed.count("\n") == 1
        assert sorted(os.listdir()) == before


def test_scene_files_have_tone_and_exposure():
    scene = wrt.load("cornell-box")
    scene.settings = wrt.RenderSettings(tone="agx", exposure="auto", width=16, height=16)
    wrt.save_scene("a.toml", scene)
    found = wrt.load("a.toml").settings
    assert (found.tone, found.exposure) == ("agx", "auto")
    renderer = finish(wrt.Renderer(scene), 1)
    assert renderer.save("a.png").tone == "agx"
    developed = renderer.save("a.png", tone="none", exposure=2.0)
    assert (developed.tone, developed.stops) == ("none", 2.0)
    np.testing.assert_array_equal(codes("a.png"), developed.codes)
