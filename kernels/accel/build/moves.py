"""Reinsertion on a GPU: locks decide between moves that exclude one another; the others happen at once.

Meister and Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization" (2018), section 3.3. The rules
are those of `kernels/accel/build/reinsert.py`, where one thread takes the moves by their gain. A move locks five nodes;
where two need the same node, the one with more gain wins. Repeated for the moves that are neither chosen nor excluded,
this makes the choice of one thread.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import half_area
from wrt.kernels.accel.build.reinsert import replace_child, sibling_of
from wrt.kernels.accel.build.split import BinaryNode

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

UNDECIDED, CHOSEN, EXCLUDED = 0, 1, 2
"""States of a move."""

LONGEST_WAY = 64
"""Moves that are followed from a node's new place up to the root, at most."""

NOT_RATED = 3.0e38
"""Key of places without a node, behind all areas."""

_five_nodes = wp.types.vector(length=5, dtype=int)


@wp.struct
class Moves:
    """The moves of a round.

    `node` and `place` are the node that moves and its new sibling, −1 for none; `gain` is the area saved and `state`
    one of the above. For each node of the tree `locks` has the best key of a move that needs it, `touched` the last
    round in which a chosen move did, and `mover` the key of its own move. Keys of later turns are larger. `found`
    counts the nodes that have a better place, and the keys that are out of order after sorting.
    """

    node: wp.array(dtype=int)
    place: wp.array(dtype=int)
    gain: wp.array(dtype=float)
    state: wp.array(dtype=int)
    locks: wp.array(dtype=wp.int64)
    touched: wp.array(dtype=int)
    mover: wp.array(dtype=wp.int64)
    found: wp.array(dtype=int)


@wp.kernel(enable_backward=False)
def rate_nodes(
    first: int,
    nodes: wp.array(dtype=BinaryNode),
    moves: Moves,
    keys_out: wp.array(dtype=float),
    numbers_out: wp.array(dtype=int),
):
    """Write the negated area and the number of each node, to sort them by."""
    i = first + wp.tid()
    if i < 2:
        moves.found[i] = 0
    key = float(NOT_RATED)
    if nodes[i].count > 0:
        area = half_area(nodes[i].upper - nodes[i].lower)
        if wp.isfinite(area):
            key = -area
        elif area > 0.0:
            key = -NOT_RATED
    keys_out[i] = key
    numbers_out[i] = i


@wp.kernel(enable_backward=False)
def pick_largest(first: int, keys: wp.array(dtype=float), numbers: wp.array(dtype=int), least: int, moves: Moves):
    """Write the nodes with the largest area, and the root, which never moves, where there are fewer.

    A tree of fewer than `least` nodes is left alone. Counts what is out of order: a sort that found no memory.
    """
    i = first + wp.tid()
    if i > 0:
        if keys[i - 1] > keys[i]:
            wp.atomic_add(moves.found, 1, 1)
    if i >= moves.node.shape[0]:
        return
    node = int(0)
    if keys[i] < NOT_RATED and keys[least - 1] < NOT_RATED:
        node = numbers[i]
    moves.node[i] = node


@wp.func
def key_of(moves: Moves, i: int, turn: int) -> wp.int64:
    """Return the priority of move i, the larger wins: by turn (or round), then by gain, then the lower index."""
    gain = wp.int64(wp.cast(moves.gain[i], wp.int32))
    return (wp.int64(turn) << wp.int64(48)) | (gain << wp.int64(16)) | wp.int64(moves.node.shape[0] - i)


@wp.func
def locked_nodes(moves: Moves, nodes: wp.array(dtype=BinaryNode), parents: wp.array(dtype=int), i: int) -> _five_nodes:
    """Return the nodes that a move changes or relies on: itself, its place, the parents of both, and its sibling."""
    node = moves.node[i]
    place = moves.place[i]
    parent = parents[node]
    return _five_nodes(node, place, parent, parents[place], sibling_of(nodes, parent, node))


@wp.kernel(enable_backward=False)
def lock_nodes(
    first: int,
    moves: Moves,
    nodes: wp.array(dtype=BinaryNode),
    parents: wp.array(dtype=int),
    round: int,
    turn: int,
    is_first: int,
):
    """Exclude moves that need a node which a chosen move needs; let each of the rest lock its own."""
    i = first + wp.tid()
    if is_first != 0:
        moves.state[i] = wp.where(moves.place[i] >= 0, UNDECIDED, EXCLUDED)
        if moves.place[i] >= 0:
            wp.atomic_add(moves.found, 0, 1)
    if moves.state[i] != UNDECIDED:
        return
    lock_set = locked_nodes(moves, nodes, parents, i)
    for k in range(5):
        if moves.touched[lock_set[k]] == round:
            moves.state[i] = EXCLUDED
            return
    for k in range(5):
        wp.atomic_max(moves.locks, lock_set[k], key_of(moves, i, turn))


@wp.kernel(enable_backward=False)
def choose_moves(
    first: int,
    moves: Moves,
    nodes: wp.array(dtype=BinaryNode),
    parents: wp.array(dtype=int),
    round: int,
    turn: int,
):
    """Choose the moves that hold all their locks."""
    i = first + wp.tid()
    if moves.state[i] != UNDECIDED:
        return
    lock_set = locked_nodes(moves, nodes, parents, i)
    for k in range(5):
        if moves.locks[lock_set[k]] != key_of(moves, i, turn):
            return
    moves.state[i] = CHOSEN
    moves.mover[lock_set[0]] = key_of(moves, i, round)
    for k in range(5):
        moves.touched[lock_set[k]] = round


@wp.kernel(enable_backward=False)
def exclude_cycles(first: int, moves: Moves, parents: wp.array(dtype=int), round: int):
    """Exclude moves that together would make a cycle, as when two nodes each move below the other.

    Follows each moved node's way to the root as it would be after all moves. If it returns to the node, the move of
    least gain on it is excluded. So is a move whose way meets LONGEST_WAY others.
    """
    i = first + wp.tid()
    if moves.state[i] != CHOSEN:
        return
    key = key_of(moves, i, round)
    least = key
    node = moves.node[i]
    at = moves.place[i]
    jumps = int(0)
    while at >= 0 and at != node and jumps < wp.static(LONGEST_WAY):
        mover = moves.mover[at]
        if (mover >> wp.int64(48)) == wp.int64(round):
            least = wp.min(least, mover)
            at = moves.place[moves.node.shape[0] - int(mover & wp.int64(65535))]
            jumps += 1
        else:
            at = parents[at]
    if jumps == wp.static(LONGEST_WAY) or (at == node and least == key):
        moves.state[i] = EXCLUDED


@wp.kernel(enable_backward=False)
def make_moves(first: int, moves: Moves, nodes: wp.array(dtype=BinaryNode), parents: wp.array(dtype=int)):
    """Make the chosen moves. Two may change the same node that is not locked, but not the same child of it."""
    i = first + wp.tid()
    if moves.state[i] != CHOSEN:
        return
    lock_set = locked_nodes(moves, nodes, parents, i)
    place = lock_set[1]
    parent = lock_set[2]
    # The parent moves along and joins both.
    replace_child(nodes, parents, parents[parent], parent, lock_set[4])
    # The place may be above: its parent is then what it was.
    replace_child(nodes, parents, lock_set[3], place, parent)
    nodes[parent].left = place
    nodes[parent].right = lock_set[0]
    parents[place] = parent
