"""Measure the live view in headless Chromium: start, how fast the picture follows the mouse, and what watching costs.

    python scripts/view_latency.py [SCENE] [--size PIXELS] [--moves COUNT] [--seconds SECONDS]

Prints the seconds from the shell to the page's address and to the first picture; the share of mouse moves that are
shown within 100 ms, with median and 95th percentile; and the paths per second with a tab that watches, over those of
`wrt render`, each of a render of the given length. Run it twice, on an idle machine: the first time compiles kernels.
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from support import chromium  # noqa: E402

PROMPT = 100.0
"""Milliseconds in which a move should be shown."""

MOVES_PER_SECOND = 30


@contextmanager
def viewing(scene: str, size: int) -> Iterator[tuple[str, float, float]]:
    """Yield the address of a running `wrt view`, when it began, and the seconds that it took to print the address."""
    began = time.monotonic()
    command = [sys.executable, "-m", "wrt", "view", scene, "--no-browser", "--size", f"{size}x{size}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    address = chromium.address_in(process.stdout.readline())
    seconds = time.monotonic() - began
    assert address is not None
    try:
        yield address, began, seconds
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def latencies(tab: chromium.Tab, moves: int) -> list[float]:
    """Orbit by the mouse; return the milliseconds from each move to the frame that shows it."""
    tab.value("wrtView.state.latencies.length = 0")
    tab.drag((400, 300), (600, 360), steps=moves, pause=1.0 / MOVES_PER_SECOND)
    time.sleep(0.5)
    return json.loads(tab.value("JSON.stringify(wrtView.state.latencies)"))


def watched_rate(tab: chromium.Tab, size: int, seconds: float) -> float:
    """Return the paths per second of a picture that a tab watches, by its samples and the clock."""
    samples, times = [], []
    for pause in (10.0, seconds):
        time.sleep(pause)
        frame = tab.value("wrtView.state.frames")
        tab.wait(f"wrtView.state.frames > {frame}", seconds=60)  # counts from the end of a pass
        samples.append(float(tab.value("wrtView.state.header.spp")))
        times.append(time.monotonic())
    return (samples[1] - samples[0]) * size**2 / (times[1] - times[0])


def measure(scene: str, size: int, moves: int, seconds: float) -> None:
    """Print the figures of a scene."""
    with chromium.Browser() as browser:
        tab = browser.tab()
        tab.look(1100, 800)
        with viewing(scene, size) as (address, began, until_address):
            tab.open(address)
            tab.wait("globalThis.wrtView && wrtView.state.frames > 0", seconds=120)
            print(f"address after {until_address:.2f} s, first picture after {time.monotonic() - began:.2f} s")
            tab.wait("!wrtView.state.header.moving && wrtView.state.header.spp >= 4", seconds=120)
            shown = sorted(latencies(tab, moves))
            prompt = sum(each <= PROMPT for each in shown) / len(shown)
            late = shown[int(0.95 * (len(shown) - 1))]
            print(f"{len(shown)} frames for {moves} moves, {prompt:.0%} within {PROMPT:.0f} ms")
            print(f"median {statistics.median(shown):.0f} ms, 95th percentile {late:.0f} ms")
            watched = watched_rate(tab, size, seconds)
    command = [sys.executable, "-m", "wrt", "render", scene, "--size", f"{size}x{size}", "--time", f"{seconds:.0f}"]
    path = Path(f"{Path(scene).stem}-latency.png")
    ended = subprocess.run([*command, "--json", "-o", str(path)], capture_output=True, text=True, check=True)
    path.unlink()
    alone = float(json.loads(ended.stdout)["paths_per_second"])
    print(f"watched {watched / 1e6:.2f} M paths/s, rendered {alone / 1e6:.2f} M, ratio {watched / alone:.2f}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="still-life")
    parser.add_argument("--size", type=int, default=768, help="pixels a side (default: 768)")
    parser.add_argument("--moves", type=int, default=100, help="moves of the mouse (default: 100)")
    parser.add_argument("--seconds", type=float, default=20.0, help="of rendering to compare (default: 20)")
    options = parser.parse_args(arguments)
    measure(options.scene, options.size, options.moves, options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
