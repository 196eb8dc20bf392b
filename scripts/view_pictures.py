"""Take the screenshots of the live view that the documentation shows, in headless Chromium.

    python scripts/view_pictures.py

Writes docs/pictures/view-light.jpg, view-dark.jpg and view-narrow.jpg. Needs Chromium and the extra wrt[denoise].
"""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from support import chromium  # noqa: E402

DENOISED = "wrtView.state.header.denoised && wrtView.state.header.spp >= 12"


def take_screenshots(tab: chromium.Tab) -> None:
    """Write the screenshots of a tab that shows the live view."""

    def save(name: str) -> None:
        tab.wait(DENOISED, seconds=60)
        picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
        picture.save(ROOT / "docs" / "pictures" / f"{name}.jpg", quality=88, optimize=True)

    tab.wait("globalThis.wrtView && wrtView.state.frames > 0", seconds=120)
    tab.value("wrtView.view.querySelector('[name=denoise]').click()")
    save("view-light")
    tab.look(420, 860)
    save("view-narrow")
    tab.look(1180, 740, dark=True)
    tab.drag((400, 300), (560, 330))
    tab.wait("!wrtView.state.header.moving && !wrtView.state.header.denoised", seconds=60)
    save("view-dark")


def main() -> None:
    """Start `wrt view`, open it in a browser and take the screenshots."""
    command = [sys.executable, "-m", "wrt", "view", "still-life", "--no-browser", "--size", "480x480"]
    view = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert view.stdout is not None
        address = chromium.address_in(view.stdout.readline())
        with chromium.Browser() as browser:
            tab = browser.tab()
            tab.look(1180, 740)
            tab.open(address)
            take_screenshots(tab)
    finally:
        view.send_signal(signal.SIGINT)
        view.wait()


if __name__ == "__main__":
    main()
