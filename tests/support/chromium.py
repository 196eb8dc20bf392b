"""A headless Chromium, driven by its DevTools protocol."""

import itertools
import json
import re
import shlex
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from websockets.sync.client import connect

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

OPTIONS = (
    "--headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --disable-background-networking "
    "--disable-component-update --disable-default-apps --disable-sync --no-first-run --no-default-browser-check "
    "--mute-audio --hide-scrollbars --remote-debugging-port=0"
)


class Tab:
    """A tab of a browser."""

    def __init__(self, address):
        self._socket = connect(address, max_size=None, open_timeout=20)
        self._numbers = itertools.count(1)
        self.requests = []  # addresses that the tab has asked for
        self.problems = []  # messages of the console that are errors, and exceptions
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=60))
            self._note(message)
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]

    def _note(self, message):
        method, values = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(values["url"])
        elif method == "Runtime.exceptionThrown":
            self.problems.append(json.dumps(values["exceptionDetails"]))
        elif method == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.problems.append(values["entry"]["text"])

    def open(self, address):
        self.call("Page.navigate", url=address)

    def value(self, expression):
        """Return the value of an expression of JavaScript; promises are awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, expression, seconds=20):
        """Return the value of an expression once it is true."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if value := self.value(expression):
                return value
            time.sleep(0.05)
        raise AssertionError(f"still not true after {seconds} s: {expression}; {self.problems}")

    def mouse(self, kind, x, y, **button):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    def drag(self, start, end, steps=10, pause=0.03):
        button = {"button": "left", "buttons": 1, "clickCount": 1}
        self.mouse("mousePressed", *start, **button)
        for step in range(1, steps + 1):
            share = step / steps
            self.mouse("mouseMoved", *(a + share * (b - a) for a, b in zip(start, end, strict=True)), **button)
            time.sleep(pause)
        self.mouse("mouseReleased", *end, **button)

    def key(self, name):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, **({"text": name} if len(name) == 1 else {}))

    def look(self, width, height, *, dark=False):
        """Set the size of the window and whether it is dark."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])


class Browser:
    """A browser with a profile of its own; a context manager."""

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="wrt-chromium-", ignore_cleanup_errors=True)
        command = [PROGRAM, *shlex.split(OPTIONS), f"--user-data-dir={self._folder.name}", "about:blank"]
        null = subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdin=null, stdout=null, stderr=null)
        place = Path(self._folder.name) / "DevToolsActivePort"
        end = time.monotonic() + 60
        while not (place.exists() and "\n" in place.read_text()):
            assert self._process.poll() is None, "Chromium has ended"
            assert time.monotonic() < end, "Chromium does not start"
            time.sleep(0.05)
        port, path = place.read_text().split()
        self._port = port
        self._socket = connect(f"ws://127.0.0.1:{port}{path}", max_size=None)
        self._numbers = itertools.count(1)
        return self

    def __exit__(self, *_):
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def tab(self):
        number = next(self._numbers)
        message = {"id": number, "method": "Target.createTarget", "params": {"url": "about:blank"}}
        self._socket.send(json.dumps(message))
        while (answer := json.loads(self._socket.recv(timeout=30))).get("id") != number:
            pass
        return Tab(f"ws://127.0.0.1:{self._port}/devtools/page/{answer['result']['targetId']}")


def address_in(text):
    """Return the address that `wrt view` has printed, or None."""
    found = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", text)
    return found and found.group()
