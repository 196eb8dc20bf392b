"""`wrt view` in a browser: the picture converges, follows the mouse, and is saved as `wrt render` writes it."""

import contextlib
import http.client
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image
from support.caches import copy_of_warm_cache
from tests.support import chromium
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

SIZE = ["--size", "64x64"]
needs_chromium = pytest.mark.skipif(chromium.PROGRAM is None, reason="there is no Chromium here")


class View:
    """A running `wrt view`."""

    def __init__(self, *arguments, environment=None):
        command = [sys.executable, "-m", "wrt", "view", "--no-browser", *map(str, arguments)]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment)
        self.address = chromium.address_in(self.process.stdout.readline())
        assert self.address, self.process.communicate()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def socket(self, **options):
        host = urlsplit(self.address).netloc
        given = {"origin": f"http://{host}", "max_size": None, **options}
        return connect(self.address.replace("http:", "ws:").replace("/?", "/live?"), **given)

    def get(self, path, **headers):
        connection = http.client.HTTPConnection(urlsplit(self.address).netloc, timeout=60)
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        _, said = self.process.communicate(timeout=30)
        return self.process.returncode, said


def received(socket, wanted, seconds=60):
    """Acknowledge frames until a message is wanted; return it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        message = socket.recv(timeout=seconds)
        if isinstance(message, bytes):
            size = int.from_bytes(message[:4], "little")
            values = {"type": "frame", **json.loads(message[4 : 4 + size]), "bytes": message[4 + size :]}
            socket.send(json.dumps({"type": "ack", "frame": values["frame"]}))
        else:
            values = json.loads(message)
        if wanted(values):
            return values
    raise AssertionError("no such message")


@pytest.fixture(scope="module")
def view():
    with View("cornell-box", *SIZE, "--spp", 4) as running:
        yield running


def test_only_the_page_itself_with_its_token_sees_the_picture(view):
    token = urlsplit(view.address).query
    assert view.get("/")[0] == 200
    assert view.get("/picture.png")[0] == 403
    assert view.get("/picture.png?token=wrong")[0] == 403
    assert view.get("/../server.py")[0] == 404
    assert view.get(f"/picture.png?{token}", Host="example.org")[0] == 403
    for origin in ("http://example.org", None):
        with pytest.raises(InvalidStatus, match="403"):
            view.socket(origin=origin)


def test_a_client_that_acknowledges_nothing_gets_two_frames(view):
    with view.socket() as socket:
        while not json.loads(socket.recv(timeout=60))["camera"]:  # there is no scene yet
            pass
        for serial in range(10):
            camera = {"origin": [0.278, 0.3 + 0.01 * serial, -0.8]}
            socket.send(json.dumps({"type": "camera", "camera": camera, "serial": serial}))
            time.sleep(0.05)
        frames = []
        with contextlib.suppress(TimeoutError):
            while True:
                message = socket.recv(timeout=2)
                frames += [message] if isinstance(message, bytes) else []
        assert len(frames) == 2
        size = int.from_bytes(frames[0][:4], "little")
        socket.send(json.dumps({"type": "ack", "frame": json.loads(frames[0][4 : 4 + size])["frame"] + 1}))
        assert received(socket, lambda m: m["type"] == "frame")["serial"] == 9  # the newest, not the next


def test_bad_messages_are_answered_and_do_no_harm(view):
    with view.socket() as socket:
        for message in (
            "no json",
            "[]",
            '{"type": "camera", "camera": {"origin": ["nan", 0, 0]}}',
            '{"type": "camera", "camera": {"origin": [0, 0, 0], "target": [0, 0, 0]}}',
            '{"type": "set", "layer": "secret"}',
            '{"type": "set", "max_depth": -1}',
            '{"type": "set", "exposure": 1e999}',
            '{"type": "pick", "x": "left"}',
        ):
            socket.send(message)
            assert received(socket, lambda m: m["type"] == "error")["text"]
    assert view.get(f"/picture.png?{urlsplit(view.address).query}")[0] == 200


def test_a_saved_picture_is_the_file_that_render_writes(tmp_path):
    """All bytes but the seconds of rendering, which differ from run to run."""
    with View("cornell-box", *SIZE, "--spp", 4) as view:
        with view.socket() as socket:
            received(socket, lambda m: m["type"] == "frame" and m["spp"] == 4)
        for suffix in ("png", "exr"):
            saved = view.get(f"/picture.{suffix}?{urlsplit(view.address).query}")[1]
            path = tmp_path / f"rendered.{suffix}"
            command = [sys.executable, "-m", "wrt", "render", "cornell-box", *SIZE, "--spp", "4", "-o", str(path)]
            subprocess.run(command, check=True, capture_output=True)
            assert without_seconds(saved) == without_seconds(path.read_bytes()), suffix


def test_a_view_is_denoised_as_a_render_is(tmp_path):
    pytest.importorskip("mitsuba_oidn")
    with View("cornell-box", *SIZE, "--spp", 4) as view, view.socket() as socket:
        noisy = received(socket, lambda m: m["type"] == "frame" and m["spp"] == 4)
        socket.send('{"type": "set", "denoise": "yes"}')
        assert "true or false" in received(socket, lambda m: m["type"] == "error")["text"]
        socket.send('{"type": "set", "denoise": true}')
        clean = received(socket, lambda m: m["type"] == "frame" and m.get("denoised"))
        assert pixels(clean["bytes"]).std() < pixels(noisy["bytes"]).std()
        saved = view.get(f"/picture.exr?{urlsplit(view.address).query}")[1]
        path = tmp_path / "rendered.exr"
        command = [sys.executable, "-m", "wrt", "render", "cornell-box", *SIZE, "--spp", "4", "--denoise", "-o", path]
        subprocess.run(command, check=True, capture_output=True)
        assert without_seconds(saved) == without_seconds(path.read_bytes())
        # A picture that moves is shown at once, and denoised again when it rests.
        socket.send(json.dumps({"type": "camera", "camera": {"origin": [0.2, 0.3, -0.8]}, "serial": 1}))
        received(socket, lambda m: m["type"] == "frame" and m["serial"] == 1 and m["moving"])
        received(socket, lambda m: m["type"] == "frame" and m["serial"] == 1 and m.get("denoised") and m["spp"] == 4)
        socket.send('{"type": "set", "denoise": false}')
        again = received(socket, lambda m: m["type"] == "frame" and not m.get("denoised"))
        assert again["spp"] == 4


def pixels(content):
    return np.asarray(Image.open(io.BytesIO(content)).convert("L"), np.float64)[:32, :32]


def without_seconds(content):
    # In a PNG a checksum follows the text of each chunk.
    content = re.sub(rb"(Render seconds\0\0\0\0\0)[\d.]+.{4}", rb"\1", content, flags=re.DOTALL)
    return re.sub(rb"(Render seconds\0string\0.{4})[\d.]+", rb"\1", content, flags=re.DOTALL)


def test_control_c_ends_it_in_one_line():
    with View("cornell-box", *SIZE) as view, view.socket() as socket:
        received(socket, lambda m: m["type"] == "frame")
        status, said = view.stop()
    assert status == 130
    assert said.splitlines() == ["wrt: stopped: the view has ended"]


def test_a_port_in_use_is_named_and_without_port_the_next_is_taken(view):
    port = urlsplit(view.address).port
    command = [sys.executable, "-m", "wrt", "view", "cornell-box", "--no-browser", "--port", str(port)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2
    assert f"port {port} is in use" in ended.stderr


def test_a_missing_scene_is_an_error_at_once():
    command = [sys.executable, "-m", "wrt", "view", "missing.toml", "--no-browser"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2
    assert "missing.toml: no such file" in ended.stderr


@pytest.mark.slow
def test_a_layer_that_was_never_compiled_appears(tmp_path):
    """The view has begun without Warp, and goes over to it; camera and exposure stay."""
    copy_of_warm_cache(tmp_path)
    cached = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "WARP_CACHE_PATH": ""}
    command = [sys.executable, "-m", "wrt", "render", "cornell-box", *SIZE, "--spp", "1", "-o", tmp_path / "box.png"]
    subprocess.run(command, check=True, capture_output=True, env=cached)
    with View("cornell-box", *SIZE, "--spp", 4, environment=cached) as view, view.socket() as socket:
        received(socket, lambda m: m["type"] == "frame" and m["spp"] == 4)
        socket.send(json.dumps({"type": "set", "exposure": 2.0}))
        socket.send(json.dumps({"type": "camera", "camera": {"origin": [0.2, 0.3, -0.8]}, "serial": 1}))
        received(socket, lambda m: m["type"] == "frame" and m["serial"] == 1 and not m["moving"])
        socket.send(json.dumps({"type": "set", "layer": "albedo"}))
        received(socket, lambda m: m["type"] == "frame" and m["spp"] == 16, seconds=120)
        socket.send(json.dumps({"type": "pick", "x": 0.5, "y": 0.9, "action": "focus"}))
        assert received(socket, lambda m: m["type"] == "picked", seconds=120)["picked"]["name"]
        socket.send(json.dumps({"type": "set", "layer": ""}))
        state = received(socket, lambda m: m["type"] == "state")
        assert (state["camera"]["origin"], state["exposure"], state["error"]) == ([0.2, 0.3, -0.8], 2.0, "")


GOOD = """
[settings]
width = 32
height = 32
[[lights]]
type = "point"
position = [0, 3, 3]
intensity = 20.0
[[shapes]]
type = "sphere"
"""


def test_a_watched_scene_shows_its_error_and_recovers(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(GOOD)
    with View(scene, "--watch", "--spp", 2) as view, view.socket() as socket:
        received(socket, lambda m: m["type"] == "frame")
        scene.write_text(GOOD.replace('"sphere"', '"spere"'))
        assert "spere" in received(socket, lambda m: m["type"] == "state" and m["error"])["error"]
        replacement = tmp_path / "new.toml"
        replacement.write_text(GOOD.replace("width = 32", "width = 48"))
        os.replace(replacement, scene)
        assert not received(socket, lambda m: m["type"] == "state" and not m["error"])["error"]
        assert received(socket, lambda m: m["type"] == "frame" and m["width"] == 48)["spp"] >= 1


@needs_chromium
@pytest.mark.slow
def test_the_page_in_a_browser():
    with View("cornell-box", *SIZE, "--spp", 4) as view, chromium.Browser() as browser:
        tab, other = browser.tab(), browser.tab()
        for each in (tab, other):
            each.look(1000, 700)
            each.open(view.address)
            each.wait("globalThis.wrtView && wrtView.state.header?.spp == 4 && !wrtView.state.header.moving")
        pixels = "(() => wrtView.view.querySelector('canvas').toDataURL())()"
        before, camera = tab.value(pixels), tab.value("wrtView.state.camera.origin")

        # Drag: this tab and the other follow, and the picture converges again.
        tab.call("Page.bringToFront")
        tab.drag((300, 300), (400, 320))
        tab.wait("wrtView.state.latencies.length > 0 && wrtView.state.header.spp == 4 && !wrtView.state.header.moving")
        assert tab.value(pixels) != before
        assert tab.value("wrtView.state.camera.origin") != camera
        other.wait(f"wrtView.state.header.serial == {json.dumps(tab.value('wrtView.state.header.serial'))}")

        # The keyboard: the scene's own camera again, and the picture of before.
        tab.key("r")
        tab.wait(f"wrtView.state.header.spp == 4 && !wrtView.state.header.moving && {pixels} == {json.dumps(before)}")

        # A broken connection is opened again; so is a page that is loaded again.
        frames = tab.value("wrtView.state.frames")
        tab.value("wrtView.close()")
        tab.wait(f"wrtView.state.frames > {frames}")
        tab.call("Page.reload")
        tab.wait("globalThis.wrtView?.state.frames > 0")

        host = urlsplit(view.address).netloc
        assert {urlsplit(each).netloc for each in tab.requests} == {host}
        assert not tab.problems
