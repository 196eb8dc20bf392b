"""Notebooks show pictures of scenes, meshes and renderers, and `view` is a widget that converges and orbits."""

import asyncio
import base64
import io
from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import numpy as np
import pytest
from PIL import Image

import wrt
from wrt.develop.tones import CURVES
from wrt.view.controls import Look
from wrt.view.picture import develop
from wrt.view.session import Session


def cornell_box():
    scene = wrt.load("cornell-box")
    scene.settings.width = scene.settings.height = 32
    scene.settings.spp = 4
    return scene


def pixels(content):
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), np.float64)


@pytest.mark.parametrize("tone", CURVES)
def test_a_frame_has_the_codes_of_the_file_but_for_dither(tone):
    radiance = np.random.default_rng(1).exponential(0.6, (48, 64, 3)).astype(np.float32)
    radiance[:4] *= 1e3
    radiance[0, :4] = np.array([np.nan, np.inf, 3e38, 1e9])[:, None]
    for exposure in (-1.5, 0.0):
        file = wrt.develop_image(radiance, tone=tone, exposure=exposure).astype(int)
        assert np.abs(develop(radiance, Look(exposure, tone)).astype(int) - file).max() <= 1


def test_reprs_are_one_line_and_scenes_show_their_pictures():
    scene = cornell_box()
    assert repr(scene) == f"<wrt.Scene: {len(scene.shapes)} shapes, 0 lights, 32x32>"
    mesh = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    assert repr(mesh).startswith("<wrt.Mesh quad: 2 triangles, 4 vertices")
    renderer = wrt.Renderer(scene)
    assert repr(renderer) == "<wrt.Renderer 32x32 path on cpu, 0 spp>"
    shown = pixels(scene._repr_png_())
    assert shown.shape == (32, 32, 3)
    assert shown[16, 2, 0] > 2.0 * shown[16, 2, 1]  # the red wall
    assert renderer._repr_png_() is None  # no sample yet
    for _ in renderer.passes(spp=16):  # as many as a shown scene takes at most
        pass
    assert np.abs(pixels(renderer._repr_png_()) - shown).mean() < 12.0
    assert wrt.Scene()._repr_png_() is None


def test_a_view_that_still_renders_ends_quietly_with_the_program():
    def refused():  # thread pools refuse work as soon as the interpreter begins to end
        pool = ThreadPoolExecutor(1)
        pool.shutdown()
        pool.submit(print)

    def bug():
        raise RuntimeError("a bug")

    for opened, error in ((refused, ""), (bug, "RuntimeError: a bug")):
        heard = []
        with mock.patch("threading.excepthook", heard.append):
            session = Session(opened)
            while opened is bug and not session.error:
                session._thread.join(0.01)
            session.close()
        assert not session._thread.is_alive()
        assert session.error == error
        assert not heard


def test_a_view_converges_orbits_and_keeps_its_last_picture():
    pytest.importorskip("anywidget")
    for spp in (0, 2.5, "many"):
        with pytest.raises(wrt.InputError, match=r"^spp must be "):
            cornell_box().view(spp=spp)
    asyncio.run(drive(wrt.Renderer(cornell_box())))


async def drive(renderer):
    widget = renderer.view(spp=4)
    viewer, sent = widget.viewer, []
    widget.send = lambda message, buffers=None: sent.append((message, buffers))

    async def until(matches):
        for _ in range(600):
            for message, buffers in sent:
                if (found := matches(message, buffers)) is not None:
                    return found
            await asyncio.sleep(0.05)
        raise AssertionError("nothing came")

    def resting(message, buffers, serial=None):
        if message["type"] != "frame":
            return None
        viewer.receive({"type": "ack", "frame": message["frame"]})
        return message if message["spp"] == 4 and not message["moving"] and message["serial"] == serial else None

    try:
        viewer.receive({"type": "open"})
        await until(resting)
        snapshot = pixels(base64.b64decode(widget.snapshot))
        viewer.receive({"type": "camera", "camera": {"origin": [0.4, 0.4, -0.8]}, "serial": "a"})
        await until(lambda message, buffers: resting(message, buffers, "a"))
        turned = pixels(base64.b64decode(widget.snapshot))
        assert np.abs(turned - snapshot).mean() > 5.0
        bundle = widget._repr_mimebundle_()[0]
        assert (pixels(base64.b64decode(bundle["image/png"])) == turned).all()
        viewer.receive({"type": "save", "suffix": ".png"})
        content = await until(lambda message, buffers: buffers[0] if message["type"] == "file" else None)
        assert np.abs(pixels(content) - turned).mean() < 2.0  # the file is dithered
    finally:
        widget.close()
