"""Errors of the live view end with the change that fixes them, Ctrl-C ends the view, and its token stays private."""

import asyncio
import contextlib
import queue
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from support.commands import ENVIRONMENT, start
from websockets.asyncio.client import connect
from websockets.typing import Origin

import wrt
from wrt.errors import InputError
from wrt.view.pictures import Pictures
from wrt.view.server import bound_socket, run_server
from wrt.view.session import Session


@contextlib.contextmanager
def session_of(open: Callable[[], wrt.Renderer]) -> Iterator[Session]:
    session = Session(open, name="a", spp=4)
    try:
        yield session
    finally:
        session.close()


@pytest.mark.parametrize("error", [InputError("cannot be rendered"), RuntimeError("CUDA error")])
def test_the_error_of_a_render_ends_with_the_change_that_mends_it(error, monkeypatch):
    get, messages = Pictures.get, queue.Queue[Any]()

    def fail_for_whitted(self, settings):
        if settings.integrator == "whitted":
            raise error
        return get(self, settings)

    def wait_for(matches):
        while not matches(messages.get(timeout=60)):
            pass

    def is_state(text):
        return lambda what: isinstance(what, dict) and text in what["error"] and bool(what["error"]) == bool(text)

    monkeypatch.setattr(Pictures, "get", fail_for_whitted)
    with session_of(lambda: wrt.Renderer(wrt.load("cornell-box"), width=32, height=32)) as session:
        session.listen(messages.put)
        wait_for(lambda what: not isinstance(what, dict) and not what.header["moving"])
        session.change({"integrator": "whitted"})
        wait_for(is_state(str(error)))
        session.change({"integrator": "path"})
        wait_for(is_state(""))
        assert session.state()["error"] == ""
        session.change({"integrator": "whitted"})
        wait_for(is_state(str(error)))


def test_who_asks_gets_the_error_and_the_next_one_an_answer(monkeypatch):
    def fail(*_):
        raise RuntimeError("CUDA error")

    with session_of(lambda: wrt.Renderer(wrt.load("cornell-box"), width=32, height=32)) as session:
        assert session.save(".png").result(timeout=60)
        with monkeypatch.context() as patch:
            patch.setattr(Pictures, "pick", fail)
            with pytest.raises(OSError, match="RuntimeError: CUDA error"):
                session.pick(0.5, 0.5).result(timeout=60)
        assert session.pick(0.5, 0.5).result(timeout=60)


def test_a_tab_that_waits_for_an_answer_does_not_keep_the_server_open():
    ready, begun = threading.Event(), threading.Event()

    def open_late():
        begun.set()
        assert ready.wait(timeout=60)
        raise InputError("never")

    bound, addresses = bound_socket(None), queue.Queue[str]()

    async def serve():
        serving = asyncio.create_task(run_server(session, bound, "a-token", addresses.put))
        address = urlsplit(await asyncio.to_thread(addresses.get))
        live = f"ws://{address.netloc}/live?{address.query}"
        async with connect(live, origin=Origin(f"http://{address.netloc}"), close_timeout=0.1) as tab:
            await tab.send('{"type": "pick", "x": 0.5, "y": 0.5}')
            while not session._requests:
                await asyncio.sleep(0.01)
            serving.cancel()
            ended, _ = await asyncio.wait([serving], timeout=30)
        assert ended

    with session_of(open_late) as session:
        assert begun.wait(timeout=60)
        try:
            asyncio.run(serve())
        finally:
            ready.set()
            bound.close()


def test_the_token_is_not_in_the_command_line_of_the_browser(tmp_path):
    browser = tmp_path / "browser"
    browser.write_text('#!/bin/sh\nprintf %s "$*" > arguments.part\nmv arguments.part arguments\n')
    browser.chmod(0o700)
    environment = {**ENVIRONMENT, "BROWSER": f"{browser} %s"}
    process = start(tmp_path, "view", "cornell-box", "--size", "16x16", env=environment)
    try:
        address = process.stdout.readline().split()[-1]
        deadline = time.monotonic() + 60
        while not (tmp_path / "arguments").exists():
            assert time.monotonic() < deadline, "no browser was opened"
            time.sleep(0.01)
        arguments = (tmp_path / "arguments").read_text()
        token = urlsplit(address).query.removeprefix("token=")
        assert len(token) > 16
        assert token not in arguments
        page = Path(unquote(urlsplit(arguments).path))
        assert f"url={address}" in page.read_text()
        assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert error == "wrt: stopped: the view has ended\n"
    assert not page.exists()
