"""The control flow of a kernel: its blocks, and where threads of a warp that have parted meet again."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from support.emulated_cuda.ptx import Entry, Instruction, Label, Mark

_JUMPS = ("bra", "brx", "ret", "trap")

_NONE: Mapping[str, Entry] = MappingProxyType({})


class Flow(NamedTuple):
    """The blocks of a kernel, by number, in the order of its text; threads that have ended are at `end`."""

    first: dict[int, int]  # the block that begins with a statement, by its place in the body
    blocks: tuple[tuple[Instruction, ...], ...]
    following: tuple[tuple[int, ...], ...]
    meeting: tuple[int, ...]  # the first block that all ways from each lead to: its immediate post-dominator
    marks: dict[str, frozenset[int]]  # the blocks that hold each mark

    @property
    def end(self) -> int:
        return len(self.blocks)


class Placed(NamedTuple):
    """The blocks of a kernel or function alone, and where copies of those that it calls come after them."""

    first: dict[int, int]
    blocks: list[list[Instruction]]
    labels: dict[str, int]
    marks: dict[str, set[int]]
    calls: dict[int, int]  # the first block of what is called, by the place of the call
    called: dict[int, str]  # its name, by the number of the block that ends with the call
    size: int  # with the copies


def placed(entry: Entry, functions: Mapping[str, Entry]) -> Placed:
    """Return the blocks of a kernel or function, each call of one of the `functions` at the end of one."""
    first: dict[int, int] = {}
    blocks: list[list[Instruction]] = []
    labels: dict[str, int] = {}
    marks: dict[str, set[int]] = {}
    calls: list[tuple[int, int, str]] = []
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
            if s.opcode[0] == "call" and (name := called_by(s)) in functions:
                calls.append((place, len(blocks) - 1, name))
                begins = True
    size, at = len(blocks), {}
    for place, _, name in calls:
        at[place] = size
        size += placed(functions[name], functions).size
    return Placed(first, blocks, labels, marks, at, {block: name for _, block, name in calls}, size)


def called_by(call: Instruction) -> str:
    return call.operands[1 if call.operands[0].startswith("(") else 0]


def flow_of(entry: Entry, functions: Mapping[str, Entry] = _NONE) -> Flow:
    """Return the control flow of a kernel with a copy of each of the `functions` where it is called.

    A kernel's own blocks come first, then those of each copy, in the order of the calls, and theirs in the same way.
    Calls of other functions are instructions like all others.
    """
    first = placed(entry, functions)
    blocks: list[list[Instruction]] = [[] for _ in range(first.size)]
    following: list[tuple[int, ...]] = [()] * first.size
    marks: dict[str, set[int]] = {}

    def place(entry: Entry, base: int, after: int) -> None:
        own = placed(entry, functions)
        tables = {s.name: s.targets for s in entry.body if isinstance(s, Label)}
        labels = {name: base + i for name, i in own.labels.items()}
        starts = dict(zip(own.called, own.calls.values(), strict=True))
        for i, block in enumerate(own.blocks):
            blocks[base + i] = block
            ways = _following(base + i, block, labels, tables, after, len(blocks))
            if i in own.called:
                place(functions[own.called[i]], base + starts[i], base + i + 1)
                ways = (base + starts[i], *(ways if block[-1].guard else ()))
            following[base + i] = ways
        for name, found in own.marks.items():
            marks.setdefault(name, set()).update(base + i for i in found)

    place(entry, 0, len(blocks))
    return Flow(
        first.first,
        tuple(map(tuple, blocks)),
        tuple(following),
        _meeting(following),
        {name: frozenset(found) for name, found in marks.items()},
    )


def _following(
    i: int, block: list[Instruction], labels: dict[str, int], tables: dict[str, tuple[str, ...]], after: int, end: int
) -> tuple[int, ...]:
    """Return the blocks that may follow block i; `after` is where its function returns to."""
    last = block[-1]
    name = last.opcode[0]
    if name == "brx":
        return tuple(dict.fromkeys(labels.get(target, after) for target in tables[last.operands[1]]))
    jumps = {"bra": lambda: labels.get(last.operands[0], after), "ret": lambda: after, "trap": lambda: end}
    went = (jumps[name](),) if name in jumps else ()
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
    # The nearest is the one that all others come after; where threads never end, the end.
    nearest = {bits: j for j, bits in enumerate(after)}
    return tuple(nearest.get(after[i] & ~(1 << i), end) for i in range(end))
