"""`wrt view` in a browser: the picture converges, follows the mouse, and is saved as `wrt render` writes it."""

import contextlib
import http.client
import json
import os
import re
import signal
import socket
import time
from urllib.parse import urlsplit

import pytest
from conftest import ROOT
from support import chromium
from support.commands import CAMERA, LAMP, QUAD, run, start
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from wrt.cli import main

SIZE = ("--size", "64x64")


class Page:
    """Requests for the page of an address."""

    def __init__(self, address):
        self.address = address
        self.host, self.token = urlsplit(address).netloc, urlsplit(address).query

    def socket(self, **options):
        options = {"origin": f"http://{self.host}", "max_size": None, **options}
        return connect(self.address.replace("http:", "ws:").replace("/?", "/live?"), **options)

    def get(self, path, **headers):
        connection = http.client.HTTPConnection(self.host, timeout=60)
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()


@contextlib.contextmanager
def program(folder, *arguments, **options):
    """Run `wrt view`; return the process and its page."""
    process = start(folder, "view", "--no-browser", *arguments, **options)
    try:
        address = chromium.address_in(process.stdout.readline())
        assert address, process.communicate()
        yield process, Page(address)
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Serve a view of the Cornell box."""
    with program(tmp_path_factory.mktemp("view"), "cornell-box", *SIZE, "--spp", "4") as (_, page):
        yield page


def received(socket, matches, seconds=60):
    """Acknowledge frames until a message matches; return it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        message = socket.recv(timeout=seconds)
        values = header_of(message) if isinstance(message, bytes) else json.loads(message)
        if values["type"] == "frame":
            send(socket, type="ack", frame=values["frame"])
        if matches(values):
            return values
    raise AssertionError("no such message")


def header_of(message):
    size = int.from_bytes(message[:4], "little")
    return {**json.loads(message[4 : 4 + size]), "bytes": message[4 + size :]}


def send(socket, **message):
    socket.send(json.dumps(message))


def is_frame(**expected):
    return lambda m: m["type"] == "frame" and all(m.get(key) == value for key, value in expected.items())


def test_only_the_page_itself_with_its_token_sees_the_picture_and_odd_requests_are_answered(page):
    assert page.get("/")[0] == 200
    assert page.get("/live?token=wrong")[0] == 403
    assert page.get("/../server.py")[0] == 404
    assert page.get(f"/live?{page.token}", Host="example.org")[0] == 403
    for origin in ("http://example.org", None):
        with pytest.raises(InvalidStatus, match="403"):
            page.socket(origin=origin)
    name, port = page.host.split(":")
    host = f"Host: {page.host}\r\n"
    for request, status in (
        (f"GET / HTTP/1.1\r\n{host}{host}", b"403"),
        ("GET / HTTP/1.1\r\n", b"403"),
        (f"GET //[ HTTP/1.1\r\n{host}", b"400"),
    ):
        with socket.create_connection((name, int(port)), timeout=60) as connection:
            connection.sendall(f"{request}\r\n".encode())
            assert connection.recv(1 << 12).split()[1] == status


def test_a_client_that_acknowledges_nothing_gets_two_frames(page):
    with page.socket() as socket:
        while not json.loads(socket.recv(timeout=60))["camera"]:  # there is no scene yet
            pass
        for serial in range(10):
            send(socket, type="camera", camera={"origin": [0.278, 0.3 + 0.01 * serial, -0.8]}, serial=serial)
            time.sleep(0.05)
        frames = []
        with contextlib.suppress(TimeoutError):
            while True:
                message = socket.recv(timeout=1.5)
                frames += [message] if isinstance(message, bytes) else []
        assert len(frames) == 2
        send(socket, type="ack", frame=header_of(frames[0])["frame"] + 1)
        assert received(socket, is_frame())["serial"] == 9  # the newest, not the next


BAD = (
    "no json",
    "[]",
    '{"type": "camera", "camera": {"origin": ["nan", 0, 0]}}',
    '{"type": "camera", "camera": {"origin": [0, 0, 0], "target": [0, 0, 0]}}',
    '{"type": "set", "layer": "secret"}',
    '{"type": "set", "exposure": 1e999}',
    '{"type": "pick", "x": NaN, "y": 0}',
    '{"type": "pick", "x": 2, "y": 0}',
    '{"type": "save", "suffix": "/../x.png"}',
)


def test_bad_messages_are_answered_and_do_no_harm(page):
    with page.socket() as socket:
        for message in BAD:
            socket.send(message)
            assert received(socket, lambda m: m["type"] == "error")["text"]
        send(socket, type="pick", x=0.5, y=0.9, action="focus")
        assert received(socket, lambda m: m["type"] == "picked")["picked"]["name"] == "floor"


def without_seconds(content):
    # In a PNG a checksum follows the text of each chunk.
    content = re.sub(rb"(Render seconds\0\0\0\0\0)[\d.]+.{4}", rb"\1", content, flags=re.DOTALL)
    return re.sub(rb"(Render seconds\0string\0.{4})[\d.]+", rb"\1", content, flags=re.DOTALL)


@pytest.mark.slow
def test_a_saved_picture_is_the_file_that_render_writes(tmp_path):
    """All bytes but the seconds of rendering, which differ from run to run; also of a denoised picture."""
    pytest.importorskip("mitsuba_oidn")

    def assert_saved(suffix, *options):
        send(socket, type="save", suffix=f".{suffix}")
        saved = received(socket, lambda m: m["type"] == "file" and m["name"] == f"cornell-box.{suffix}")["bytes"]
        path = tmp_path / f"rendered.{suffix}"
        assert run(tmp_path, "render", "cornell-box", *SIZE, "--spp", "4", *options, "-o", str(path)).returncode == 0
        assert without_seconds(saved) == without_seconds(path.read_bytes()), suffix

    with program(tmp_path, "cornell-box", *SIZE, "--spp", "4") as (_, page), page.socket() as socket:
        received(socket, is_frame(spp=4))
        assert_saved("png")
        send(socket, type="set", denoise=True)
        received(socket, is_frame(denoised=True))
        assert_saved("exr", "--denoise")
        # A picture that moves is shown at once, and denoised again when it rests.
        send(socket, type="camera", camera={"origin": [0.2, 0.3, -0.8]}, serial=1)
        received(socket, is_frame(serial=1, moving=True))
        received(socket, is_frame(serial=1, denoised=True, spp=4))


def test_a_port_in_use_is_an_error_at_once(page, capsys):
    port = urlsplit(page.address).port
    assert main(["view", "cornell-box", "--no-browser", "--port", str(port)]) == 2
    assert f"port {port} is in use" in capsys.readouterr().err


@pytest.mark.slow
def test_a_watched_scene_shows_its_error_and_recovers_and_control_c_ends_it_in_one_line(tmp_path):
    good = "[settings]\nwidth = 32\nheight = 32\n" + CAMERA + QUAD + LAMP
    scene = tmp_path / "scene.toml"
    scene.write_text(good)
    with program(tmp_path, "scene.toml", "--watch", "--spp", "2") as (process, page), page.socket() as socket:
        received(socket, is_frame())
        scene.write_text(good.replace('"quad"', '"squad"'))
        assert "squad" in received(socket, lambda m: m["type"] == "state" and m["error"])["error"]
        (tmp_path / "new.toml").write_text(good.replace("width = 32", "width = 48"))
        os.replace(tmp_path / "new.toml", scene)
        received(socket, lambda m: m["type"] == "state" and not m["error"])
        received(socket, is_frame(width=48))
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error.splitlines() == ["wrt: stopped: the view has ended"]


@pytest.mark.slow
def test_integrators_of_a_file_are_listed_and_can_be_chosen(tmp_path):
    sketches = str(ROOT / "scripts" / "sketches.py")
    with (
        program(tmp_path, "cornell-box", *SIZE, "--spp", "1", "--with", sketches) as (_, page),
        page.socket() as socket,
    ):
        listed = received(socket, lambda m: m["type"] == "state")["own_integrators"]
        assert listed == ["heat-map", "depth-cue", "toon"]
        before = received(socket, is_frame(moving=False))
        send(socket, type="set", integrator="toon")
        received(socket, lambda m: m["type"] == "state" and m["settings"]["integrator"] == "toon" and not m["error"])
        assert received(socket, is_frame(moving=False))["bytes"] != before["bytes"]


@pytest.mark.skipif(chromium.PROGRAM is None, reason="there is no Chromium here")
@pytest.mark.slow
def test_the_page_in_a_browser(tmp_path):
    more = ("--spp", "4", "--with", str(ROOT / "scripts" / "sketches.py"))
    with program(tmp_path, "cornell-box", *SIZE, *more) as (_, page), chromium.Browser() as browser:
        tab, second = browser.tab(), browser.tab()
        for each in (tab, second):
            each.look(1000, 700)
            each.open(page.address)
            each.wait("globalThis.wrtView && wrtView.state.header?.spp == 4 && !wrtView.state.header.moving")
        pixels = "(() => wrtView.view.querySelector('canvas').toDataURL())()"
        before, camera = tab.value(pixels), tab.value("wrtView.state.camera.origin")

        # Both tabs follow, and the picture converges again.
        tab.call("Page.bringToFront")
        tab.drag((300, 300), (400, 320))
        tab.wait("wrtView.state.header.serial && wrtView.state.header.spp == 4 && !wrtView.state.header.moving")
        assert tab.value(pixels) != before
        assert tab.value("wrtView.state.camera.origin") != camera
        second.wait(f"wrtView.state.header.serial == {json.dumps(tab.value('wrtView.state.header.serial'))}")

        tab.key("r")  # the scene's own camera again, and the picture of before
        tab.wait(f"wrtView.state.header.spp == 4 && !wrtView.state.header.moving && {pixels} == {json.dumps(before)}")

        names = "[...wrtView.view.querySelector('select[name=integrator]').options].map((each) => each.value)"
        assert tab.value(names)[-4:] == ["ao", "heat-map", "depth-cue", "toon"]

        # A broken connection is opened again; so is a page that is loaded again.
        frames = tab.value("wrtView.state.frames")
        tab.value("wrtView.close()")
        tab.wait(f"wrtView.state.frames > {frames}")
        tab.call("Page.reload")
        tab.wait("globalThis.wrtView?.state.frames > 0")
        assert {urlsplit(each).netloc for each in tab.requests} == {page.host}
        assert not tab.problems
