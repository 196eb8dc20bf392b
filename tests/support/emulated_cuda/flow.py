"""The control flow of a kernel: its blocks, and where threads of a warp that have parted meet again."""

from __future__ import annotations

from typing import NamedTuple

from support.emulated_cuda.ptx import Entry, Instruction, Label, Mark

_JUMPS = ("bra", "brx", "ret", "trap")


class Flow(NamedTuple):
    """The blocks of a kernel, by number, in the order of its text; `end` is the number after the last.

    Attributes:
        first: the block that begins with a statement, by its place in the body.
        blocks: their instructions.
        following: the blocks that may come after each; `end` where threads end.
        meeting: for each block, the first one that all ways from it lead to: its immediate post-dominator.
        marks: the blocks that hold each mark.
    """

    first: dict[int, int]
    blocks: tuple[tuple[Instruction, ...], ...]
    following: tuple[tuple[int, ...], ...]
    meeting: tuple[int, ...]
    marks: dict[str, frozenset[int]]

    @property
    def end(self) -> int:
        """Where threads are that have ended."""
        return len(self.blocks)


def flow_of(entry: Entry) -> Flow:
    """Return the control flow of a kernel; functions that it calls belong to the block that calls."""
    first: dict[int, int] = {}
    blocks: list[list[Instruction]] = []
    labels: dict[str, int] = {}
    marks: dict[str, set[int]] = {}
    tables = {s.name: s.targets for s in entry.body if isinstance(s, Label)}
    begins, waiting, marked = True, [], []
    for place, s in enumerate(entry.body):
        if isinstance(s, Label) and not s.targets:
            begins = True
            waiting.append(s.name)
        elif isinstance(s, Mark):
            marked.append(s.name)
        elif isinstance(s, Instruction):
            if begins:
                first[place] = len(blocks)
                blocks.append([])
                labels |= dict.fromkeys(waiting, len(blocks) - 1)
                begins, waiting = False, []
            for name in marked:
                marks.setdefault(name, set()).add(len(blocks) - 1)
            marked = []
            blocks[-1].append(s)
            begins = s.opcode[0] in _JUMPS
    following = [_following(i, block, labels, tables, len(blocks)) for i, block in enumerate(blocks)]
    return Flow(
        first,
        tuple(map(tuple, blocks)),
        tuple(following),
        _meeting(following),
        {name: frozenset(found) for name, found in marks.items()},
    )


def _following(
    i: int, block: list[Instruction], labels: dict[str, int], tables: dict[str, tuple[str, ...]], end: int
) -> tuple[int, ...]:
    last = block[-1]
    name = last.opcode[0]
    if name == "brx":
        return tuple(dict.fromkeys(labels.get(target, end) for target in tables[last.operands[1]]))
    went = () if name not in _JUMPS else (labels.get(last.operands[0], end) if name == "bra" else end,)
    stays = (i + 1,) if name not in _JUMPS or last.guard else ()
    return tuple(dict.fromkeys((*went, *stays)))


def _meeting(following: list[tuple[int, ...]]) -> tuple[int, ...]:
    """Return immediate post-dominators, from sets as bits of numbers (Aho, Sethi and Ullman 1986, section 10.9)."""
    end = len(following)
    after = [(1 << end + 1) - 1] * end + [1 << end]
    changed = True
    while changed:
        changed = False
        for i in reversed(range(end)):
            common = -1
            for j in following[i]:
                common &= after[j]
            common |= 1 << i
            changed |= common != after[i]
            after[i] = common
    found = []
    for i in range(end):
        others = after[i] & ~(1 << i)
        # The nearest is the one that all others come after.
        found.append(next(j for j in range(end, -1, -1) if others >> j & 1 and after[j] & others == others))
    return tuple(found)
