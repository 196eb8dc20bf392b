"""`wrt view`: shows a scene in the browser while it converges."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrt.cli.exit_status import complain, warn

if TYPE_CHECKING:
    from wrt.cli.signals import Interrupts
    from wrt.rendering.renderer import Renderer

WATCH_SECONDS = 0.3
"""Interval at which --watch looks at the scene file."""


def view(
    interrupts: Interrupts,
    *,
    source: str,
    watch: bool,
    no_browser: bool,
    port: int | None,
    spp: int | None,
    size: tuple[int, int] | None,
    device: str,
    threads: int | None,
    seed: int,
    **arguments: Any,
) -> int:
    """Serve the page of a scene until Ctrl-C."""
    from wrt.api import is_builtin, load
    from wrt.cli.options import loading_options
    from wrt.cli.views import chosen_cameras, load_seen
    from wrt.progress.bar import once, short_warnings
    from wrt.view.server import bound_socket, run_server
    from wrt.view.session import Session

    loading = loading_options(arguments)
    if not watch and not is_builtin(source) and not os.path.lexists(source):
        load(source)  # raises InputError at once: without --watch a missing file stays missing
    if loading["cameras"] is not None:
        chosen_cameras(loading)  # likewise
    bound = bound_socket(port)

    def open_scene() -> Renderer:
        from wrt.rendering.renderer import Renderer

        return Renderer(load_seen(source, loading, size), device=device, seed=seed, threads=threads)

    def ready(address: str) -> None:
        print(f"{source}: {address}\nCtrl-C ends it.", flush=True)
        if not no_browser:
            threading.Thread(target=_browse, args=(address,), daemon=True).start()

    with contextlib.closing(bound), short_warnings(once(warn)):
        session = Session(open_scene, name=Path(source).stem, spp=spp)
        try:
            with _watching(source, session.reload) if watch else contextlib.nullcontext():
                asyncio.run(run_server(session, bound, secrets.token_urlsafe(16), ready))
        except KeyboardInterrupt:
            interrupts.disarm()
        finally:
            session.close()
        complain("stopped", "the view has ended")
    return interrupts.exit_status


def _browse(address: str) -> None:
    """Open the browser on a private file that leads to the address: other users can read command lines."""
    import webbrowser

    from wrt.backend.cache_folders import work_folder

    with contextlib.suppress(webbrowser.Error, OSError):
        page = work_folder() / "view.html"
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">', encoding="ascii")
        webbrowser.open(page.as_uri())


@contextlib.contextmanager
def _watching(source: str, changed: Callable[[], None]) -> Iterator[None]:
    """Within the context, call `changed` whenever the scene file has changed and is completely written."""
    end = threading.Event()

    def watch() -> None:
        before = _stamp(source)
        while not end.wait(WATCH_SECONDS):
            now = _stamp(source)
            if now != before and now is not None:
                while not end.wait(0.05) and (later := _stamp(source)) != now:  # it is still being written
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
    """Return numbers that change when a file is written or replaced, or None if there is no file."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
