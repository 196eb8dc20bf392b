"""The emulator of CUDA: threads of a warp that vote, and wait for one another (PTX ISA, sections 9.7.13 and 9.7.14)."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from numpy.typing import NDArray
from support.emulated_cuda.flow import flow_of
from support.emulated_cuda.libraries import Library, compiled
from support.emulated_cuda.ptx import NotTranslated, parse
from support.emulated_cuda.translation import to_cpp
from support.emulated_cuda.warps import issued

from wrt.backend.warp_backend import initialize_warp

WORDS = 8


def kernel(body: str) -> str:
    """Return PTX of a kernel `votes`: %r0 is the number of the thread in its block, and %rd1 the address of WORDS."""
    return f""".version 9.0\n.target sm_90\n.address_size 64
.visible .entry votes(.param .u64 votes_param_0)
{{
    .local .align 8 .b8 __local_depot0[8];
    .reg .b64 %rd<8>;
    .reg .b32 %r<16>;
    .reg .pred %p<8>;
    ld.param.u64 %rd1, [votes_param_0];
    mov.u32 %r0, %tid.x;
    mul.wide.u32 %rd2, %r0, {4 * WORDS};
    add.s64 %rd1, %rd1, %rd2;
    {body}
    ret;
}}
"""


def run(body: str, threads: int, *, optimization: int = 0, apart: bool = False) -> NDArray[np.uint32]:
    """Return the words that each of the threads of a block writes."""
    initialize_warp()
    library = Library(compiled(kernel(body), optimization=optimization))
    library.set_apart(apart)
    block = -(-threads // 32) * 32
    out = np.zeros((block, WORDS), np.uint32)
    library.run("votes", threads, [ctypes.c_uint64(out.ctypes.data)], block=block, threads=range(threads))
    return out[:threads]


VOTES = """
    and.b32 %r1, %r0, 3;
    setp.eq.u32 %p0, %r1, 3;
    setp.lt.u32 %p1, %r0, 64;
    vote.sync.ballot.b32 %r2, %p0, -1;
    st.global.u32 [%rd1], %r2;
    vote.sync.ballot.b32 %r2, !%p0, 0xffffffff;
    st.global.u32 [%rd1+4], %r2;
    vote.sync.any.pred %p2, %p0, -1;
    vote.sync.all.pred %p3, %p0, -1;
    vote.sync.uni.pred %p4, %p0, -1;
    vote.sync.all.pred %p5, %p1, -1;
    vote.sync.uni.pred %p6, !%p1, -1;
    selp.u32 %r3, 1, 0, %p2;
    selp.u32 %r4, 2, 0, %p3;
    selp.u32 %r5, 4, 0, %p4;
    selp.u32 %r6, 8, 0, %p5;
    selp.u32 %r7, 16, 0, %p6;
    or.b32 %r3, %r3, %r4;
    or.b32 %r3, %r3, %r5;
    or.b32 %r3, %r3, %r6;
    or.b32 %r3, %r3, %r7;
    st.global.u32 [%rd1+8], %r3;
"""


@pytest.mark.parametrize("optimization", [0, 1])
def test_votes(optimization: int) -> None:
    """Of two warps; the second has six threads, and the others are not waited for."""
    said = run(VOTES, 38, optimization=optimization)
    assert (said[:32, 0] == 0x88888888).all()
    assert (said[:32, 1] == 0x77777777).all()
    assert (said[32:, 0] == 0b001000).all()
    assert (said[32:, 1] == 0b110111).all()
    # Any, all, none alike; all of them are below 64.
    assert (said[:, 2] == 1 + 8 + 16).all()


LOOP = """
    mov.u64 %rd3, __local_depot0;
    st.local.u32 [%rd3], %r0;
    mov.u32 %r1, 0;
$round:
    add.s32 %r1, %r1, 1;
    setp.lt.u32 %p0, %r1, %r0;
    vote.sync.ballot.b32 %r2, %p0, -1;
    popc.b32 %r3, %r2;
    add.s32 %r4, %r4, %r3;
    setp.ne.u32 %p1, %r2, 0;
    @%p1 bra $round;
    ld.local.u32 %r5, [%rd3];
    st.global.u32 [%rd1], %r1;
    st.global.u32 [%rd1+4], %r4;
    st.global.u32 [%rd1+8], %r5;
"""


def test_threads_keep_what_they_have_while_they_wait() -> None:
    """All stay until the last has enough: registers and local memory are those of each."""
    said = run(LOOP.replace("$round:", "mov.u32 %r4, 0;\n$round:"), 20)
    assert (said[:, 0] == 19).all()
    # In round i those with numbers greater than i vote for another.
    assert (said[:, 1] == sum(19 - i for i in range(1, 20))).all()
    assert said[:, 2].tolist() == list(range(20))


def test_a_warp_issues_a_loop_with_votes_once_for_all() -> None:
    initialize_warp()
    ptx = kernel(LOOP.replace("$round:", "mov.u32 %r4, 0;\n$round:"))
    flow, out = flow_of(parse(ptx).entries[0]), np.zeros((32, WORDS), np.uint32)
    library = Library(compiled(ptx, optimization=0, traces=True))
    traces = library.trace_warp("votes", 20, [ctypes.c_uint64(out.ctypes.data)], 0)
    assert [trace.tolist() for trace in traces] == [[0, *[1] * 19, 2]] * 20
    found = issued(flow, traces)
    assert (found.warps.tolist(), found.threads.tolist()) == ([1, 19, 1], [20, 380, 20])


def test_threads_that_have_ended_are_not_waited_for() -> None:
    """Odd ones leave before the vote."""
    said = run(
        """
    and.b32 %r1, %r0, 1;
    setp.ne.u32 %p0, %r1, 0;
    @%p0 bra $end;
    setp.lt.u32 %p1, %r0, 8;
    vote.sync.ballot.b32 %r2, %p1, -1;
    st.global.u32 [%rd1], %r2;
$end:
    """,
        32,
    )
    assert (said[::2, 0] == 0b01010101).all()
    assert (said[1::2, 0] == 0).all()


BRANCHES = """
    and.b32 %r1, %r0, 4;
    setp.ne.u32 %p0, %r1, 0;
    setp.lt.u32 %p1, %r0, 6;
    @%p0 bra $other;
    activemask.b32 %r2;
    vote.sync.ballot.b32 %r3, %p1, %r2;
    bra $met;
$other:
    activemask.b32 %r2;
    vote.sync.ballot.b32 %r3, %p1, %r2;
$met:
    bar.warp.sync -1;
    activemask.b32 %r4;
    st.global.u32 [%rd1], %r2;
    st.global.u32 [%rd1+4], %r3;
    st.global.u32 [%rd1+8], %r4;
"""


@pytest.mark.parametrize("apart", [False, True])
def test_threads_that_are_active_together(apart: bool) -> None:
    """Those of a branch; where that is asked for, odd and even ones apart, as the manual allows."""
    said = run(BRANCHES, 12, apart=apart)
    for thread in range(12):
        active = [t for t in range(12) if not apart or (t - thread) % 2 == 0]
        branch = [t for t in active if t & 4 == thread & 4]
        assert said[thread, 0] == sum(1 << t for t in branch)
        assert said[thread, 1] == sum(1 << t for t in branch if t < 6)
        assert said[thread, 2] == sum(1 << t for t in active)


@pytest.mark.parametrize(
    "body",
    [
        # Thread 0 names other threads than they do.
        "setp.eq.u32 %p0, %r0, 0; \n selp.b32 %r1, -1, 0x7fffffff, %p0; \n vote.sync.ballot.b32 %r2, %p0, %r1;",
        # Without itself.
        "shl.b32 %r1, 2, %r0; \n setp.eq.u32 %p0, %r0, 0; \n vote.sync.ballot.b32 %r2, %p0, %r1;",
        # One waits at a vote, the others at a barrier.
        "setp.eq.u32 %p0, %r0, 0; \n @%p0 vote.sync.ballot.b32 %r2, %p0, -1; \n @!%p0 bar.warp.sync -1;",
    ],
)
def test_threads_that_wait_for_ever_are_noticed(body: str) -> None:
    with pytest.raises(RuntimeError, match="votes: threads of a warp wait for others that never come"):
        run(body, 4)


@pytest.mark.parametrize("text", ["vote.ballot.b32 %r1, %p0;", "vote.sync.ballot.b64 %rd2, %p0, -1;", "bar.sync 0;"])
def test_what_is_unknown_is_refused(text: str) -> None:
    with pytest.raises(NotTranslated, match=text.split()[0].replace(".", r"\.")):
        to_cpp(parse(kernel(text)))
