"""`wrt view`: shows a scene in the browser while it converges."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import secrets
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from wrt.backend import current_backend
from wrt.cli.exit_status import complain, warn
from wrt.cli.signals import SIGNALS
from wrt.threads import start_if_possible

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

WATCH_SECONDS = 0.3
"""Time between two looks at the scene file with --watch."""


def view(options: argparse.Namespace) -> int:
    """Serve the page of a scene until Ctrl-C."""
    from wrt.progress.bar import once, short_warnings
    from wrt.view.server import bound_socket, run_server
    from wrt.view.session import Session

    if not options.watch:
        _require_readable(options)
    bound = bound_socket(options.port)
    said: set[str] = set()
    with contextlib.closing(bound), short_warnings(once(warn, said)):
        session = Session(lambda: _open(options), name=Path(options.source).stem, spp=options.spp)

        def ready(address: str) -> None:
            print(f"{options.source}: {address}\nCtrl-C ends it.", flush=True)
            if not options.no_browser:
                start_if_possible(threading.Thread(target=_browse, args=(address,), daemon=True))

        signals: list[int] = []

        async def serve() -> None:
            serving = asyncio.current_task()
            assert serving is not None

            def end(number: int) -> None:
                signals.append(number)
                serving.cancel()

            if options.own_process:  # elsewhere asyncio.run turns Ctrl-C into KeyboardInterrupt
                for number in SIGNALS:
                    if signal.getsignal(number) is not signal.SIG_IGN:
                        asyncio.get_running_loop().add_signal_handler(number, end, number)
            with contextlib.suppress(asyncio.CancelledError):
                await run_server(session, bound, secrets.token_urlsafe(16), ready)

        try:
            with _watching(options, session.reload):
                asyncio.run(serve())
        except KeyboardInterrupt:
            signals.append(signal.SIGINT)
        finally:
            session.close()
            current_backend().finish()
        complain("stopped", "the view has ended")
    return 128 + signals[0]


def _require_readable(options: argparse.Namespace) -> None:
    """Raise InputError at once if the scene cannot be found, as nobody would mend it."""
    from wrt.api import _is_builtin

    if not _is_builtin(options.source) and not os.path.lexists(options.source):
        from wrt.api import load

        load(options.source)


def _open(options: argparse.Namespace) -> Renderer:
    from wrt.api import load
    from wrt.rendering.renderer import Renderer

    width, height = options.size or (None, None)
    scene = load(options.source, up=options.up, confined=options.confined)
    return Renderer(
        scene, width=width, height=height, device=options.device, seed=options.seed, threads=options.threads
    )


def _browse(address: str) -> None:
    """Open the browser on a private file that leads to the address: other users read command lines, and the token."""
    import webbrowser

    from wrt.backend.cache_folders import work_folder

    with contextlib.suppress(webbrowser.Error, OSError):
        page = work_folder() / "view.html"
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">', encoding="ascii")
        webbrowser.open(page.as_uri())


@contextlib.contextmanager
def _watching(options: argparse.Namespace, changed: Callable[[], None]) -> Iterator[None]:
    """Within the context, call `changed` whenever the scene file has changed and is written no more."""
    if not options.watch:
        yield
        return
    end = threading.Event()

    def watch() -> None:
        before = _stamp(options.source)
        while not end.wait(WATCH_SECONDS):
            now = _stamp(options.source)
            if now != before and now is not None:
                while not end.wait(0.05) and (later := _stamp(options.source)) != now:  # it is still being written
                    now = later
                before = now
                changed()

    thread = threading.Thread(target=watch, name="wrt-watch", daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def _stamp(path: str) -> tuple[int, int, int] | None:
    """Return what changes when a file is written or replaced; None if there is none."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
