"""What a warp issues for the blocks that its threads run: those that part run one after the other until they meet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from support.emulated_cuda.flow import Flow

WARP = 32


class Issued(NamedTuple):
    """How often each block of a kernel was issued to warps, and how often threads ran it."""

    warps: NDArray[np.int64]
    threads: NDArray[np.int64]

    def efficiency(self, weights: NDArray[np.int64]) -> float:
        """Return the share of lanes that work, each block with a weight."""
        return float((self.threads @ weights) / (WARP * (self.warps @ weights)))


def issued(flow: Flow, traces: Sequence[NDArray[np.uint32]]) -> Issued:
    """Return what a warp issues whose threads run these blocks, in order.

    Threads that take different ways out of a block run one after the other, and go on together from the block that all
    ways lead to: a stack of such places, as in GPUs before Volta (Fung and others 2007). Later ones may let threads
    meet elsewhere, but compilers place the meeting points there too.
    """
    warps, threads = np.zeros(flow.end, np.int64), np.zeros(flow.end, np.int64)
    ways = [[*trace.tolist(), flow.end] for trace in traces]
    at = [0] * len(ways)
    for trace in traces:
        threads += np.bincount(trace, minlength=flow.end)
    count = [0] * flow.end
    # Where a group is, where it meets others, and its lanes.
    stack = [(0, flow.end, list(range(len(ways))))]
    while stack:
        block, meeting, lanes = stack.pop()
        if len(lanes) == 1:
            (lane,) = lanes
            way, i = ways[lane], at[lane]
            while way[i] != meeting:
                count[way[i]] += 1
                i += 1
            at[lane] = i
            continue
        while block != meeting:
            count[block] += 1
            parted: dict[int, list[int]] = {}
            for lane in lanes:
                at[lane] += 1
                parted.setdefault(ways[lane][at[lane]], []).append(lane)
            if len(parted) == 1:
                (block,) = parted
                continue
            place = flow.meeting[block]
            if place != meeting:
                stack.append((place, meeting, lanes))
            stack += [(go, place, group) for go, group in parted.items() if go != place]
            break
    warps += np.array(count)
    return Issued(warps, threads)
