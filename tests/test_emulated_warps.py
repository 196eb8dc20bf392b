"""The emulator of CUDA: control flow, the blocks that threads run, and what warps issue for them."""

from __future__ import annotations

import numpy as np
import pytest
from support.emulated_cuda.flow import flow_of
from support.emulated_cuda.libraries import Library, compiled
from support.emulated_cuda.ptx import parse
from support.emulated_cuda.translation import COUNTED, tally
from support.emulated_cuda.warps import WARP, Issued, issued

from wrt.backend.warp_backend import initialize_warp


def kernel(body: str) -> str:
    """Return PTX of a kernel `parts`, whose register %r0 is the number of the thread."""
    return f""".version 9.0\n.target sm_90\n.address_size 64
.visible .entry parts()
{{
    .reg .b32 %r<8>;
    .reg .pred %p<8>;
    mov.u32 %r0, %tid.x;
    {body}
}}
"""


def run(ptx: str, threads: int) -> Issued:
    initialize_warp()
    module = parse(ptx)
    flow = flow_of(module.entries[0], {function.name: function for function in module.functions})
    library = Library(compiled(ptx, optimization=0, traces=True))
    return issued(flow, library.trace_warp("parts", threads, [], 0))


DIAMOND_AND_LOOP = kernel("""
    and.b32 %r1, %r0, 1;
    setp.eq.s32 %p0, %r1, 0;
    @%p0 bra $even;
    add.s32 %r2, %r0, 1;
    bra $both;
$even:
    add.s32 %r2, %r0, 2;
$both:
    // begin inline asm
    // mark: here
    // end inline asm
    mov.u32 %r3, %r0;
$loop:
    setp.eq.s32 %p1, %r3, 0;
    @%p1 bra $out;
    add.s32 %r3, %r3, -1;
    bra $loop;
$out:
    ret;
""")


def test_threads_meet_after_branches_and_loops() -> None:
    flow = flow_of(parse(DIAMOND_AND_LOOP).entries[0])
    assert flow.following == ((2, 1), (3,), (3,), (4,), (6, 5), (4,), (7,))
    assert flow.meeting == (3, 3, 3, 4, 6, 4, 7)
    assert flow.marks == {"here": {3}}
    found = run(DIAMOND_AND_LOOP, 8)
    # The loop lasts as long as that of thread 7.
    assert found.warps.tolist() == [1, 1, 1, 1, 8, 7, 1]
    assert found.threads.tolist() == [8, 4, 4, 8, 36, 28, 8]
    assert found.efficiency(np.eye(7, dtype=np.int64)[5]) == pytest.approx(28 / (WARP * 7))


ROUNDS = """
    add.s32 %r1, %r0, 1;
    mov.u32 %r2, 0;
    mov.u32 %r3, 0;
$round:
    add.s32 %r3, %r3, 1;
    setp.lt.s32 %p0, %r3, %r1;
    @%p0 bra $next;
    mov.u32 %r3, 0;
    add.s32 %r2, %r2, 1;
    {inside}
$next:
    setp.lt.s32 %p1, %r2, 4;
    @%p1 bra $round;
$out:
    ret;
"""
"""Four paths of t + 1 rounds each, in thread t."""


@pytest.mark.parametrize(("inside", "rounds"), [("", 8), ("setp.ge.s32 %p2, %r2, 4; \n @%p2 bra $out;", 11)])
def test_a_way_out_of_a_block_keeps_threads_apart(inside: str, rounds: int) -> None:
    """Thread 0 has 4 rounds, thread 1 has 8. With the way out they part in the first, and meet at the end."""
    found = run(kernel(ROUNDS.replace("{inside}", inside)), 2)
    assert (found.warps[1], found.threads[1]) == (rounds, 12)


TABLE = kernel("""
    rem.u32 %r1, %r0, 3;
$table: .branchtargets $zero, $one, $zero;
    brx.idx %r1, $table;
$zero: add.s32 %r2, %r0, 1;
    @%p0 bra $one;
    ret;
$one: mov.u32 %r2, 1;
    ret;
""")


def test_tables_and_ends() -> None:
    flow = flow_of(parse(TABLE).entries[0])
    assert flow.following == ((1, 3), (3, 2), (4,), (4,))
    assert flow.meeting == (4, 4, 4, 4)


CALLS = """.version 9.0\n.target sm_90\n.address_size 64
.func halved(.param .b32 halved_param_0)
{
    .reg .b32 %r<3>;
    .reg .pred %p<2>;
    ld.param.b32 %r1, [halved_param_0];
    setp.eq.s32 %p1, %r1, 0;
    @%p1 ret;
    shr.u32 %r2, %r1, 1;
    ret;
}
.visible .entry parts()
{
    .reg .b32 %r<3>;
    .reg .pred %p<2>;
    .param .b32 number;
    mov.u32 %r0, %tid.x;
    st.param.b32 [number], %r0;
    setp.lt.u32 %p1, %r0, 2;
    @%p1 bra $few;
    call.uni halved, (number);
    bra $both;
$few:
    call.uni halved, (number);
$both:
    ret;
}
"""


def test_functions_are_copies_where_they_are_called() -> None:
    """Blocks 5 and 6 are the first call, 7 and 8 the second; threads that part in a function meet where it returns."""
    module = parse(CALLS)
    flow = flow_of(module.entries[0], {f.name: f for f in module.functions})
    assert flow.following == ((3, 1), (5,), (4,), (7,), (9,), (2, 6), (2,), (4, 8), (4,))
    assert flow.meeting == (4, 5, 4, 7, 9, 2, 2, 4, 4)
    found = run(CALLS, 5)
    assert found.threads.tolist() == [5, 3, 3, 2, 5, 3, 3, 2, 1]
    assert found.warps.tolist() == [1, 1, 1, 1, 1, 1, 1, 1, 1]


def test_instructions_are_counted() -> None:
    flow = flow_of(parse(DIAMOND_AND_LOOP).entries[0])
    counts = dict(zip(COUNTED, run(DIAMOND_AND_LOOP, 3).threads @ tally(flow), strict=True))
    # Four before the branch; then two or one, and one; two in each round, and two on; the end.
    assert counts["instructions"] == 3 * 4 + (1 + 2 + 1) + 3 * 1 + 2 * 6 + 2 * 3 + 3
    assert (counts["ld global"], counts["other"]) == (0, counts["instructions"])
