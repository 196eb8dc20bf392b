"""Take the screenshots of the live view that the documentation shows, in headless Chromium.

    python scripts/view_pictures.py

Writes docs/pictures/view-light.jpg, view-dark.jpg and view-narrow.jpg. Needs Chromium and the extra wrt[denoise].
"""

from __future__ import annotations

import io
import sys

from PIL import Image
from view_latency import ROOT, chromium, viewing

PICTURES = ROOT / "docs" / "pictures"
QUALITY = 88
DENOISED = "wrtView.state.header.denoised && wrtView.state.header.spp >= 12"


def shoot(tab: chromium.Tab, name: str) -> None:
    """Write what a tab shows."""
    picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
    picture.save(PICTURES / f"{name}.jpg", quality=QUALITY, optimize=True)


def main() -> int:
    """Take all of them."""
    with chromium.Browser() as browser, viewing("still-life", 480) as (address, *_):
        tab = browser.tab()
        tab.look(1180, 740)
        tab.open(address)
        tab.wait("globalThis.wrtView && wrtView.state.frames > 0", seconds=120)
        tab.value("wrtView.view.querySelector('[name=denoise]').click()")
        tab.wait(DENOISED, seconds=60)
        shoot(tab, "view-light")
        tab.look(420, 860)
        tab.wait(DENOISED, seconds=60)
        shoot(tab, "view-narrow")
        tab.look(1180, 740, dark=True)
        tab.drag((400, 300), (560, 330))
        tab.wait("!wrtView.state.header.moving && !wrtView.state.header.denoised", seconds=60)
        tab.wait(DENOISED, seconds=60)
        shoot(tab, "view-dark")
    return 0


if __name__ == "__main__":
    sys.exit(main())
