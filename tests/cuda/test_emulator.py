"""Threads of the emulator of CUDA (`support/emulated_cuda`) vote and wait for one another.

Films and trees compare its results with the CPU (test_cuda_films.py, test_cuda_hits.py).
"""

import ctypes

import numpy as np
import pytest
from numpy.typing import NDArray
from support.emulated_cuda.libraries import Library, compiled

from wrt.backend.warp_start import initialize_warp

pytestmark = pytest.mark.machinery

HEAD = ".version 9.0\n.target sm_90\n.address_size 64\n"


WORDS = 8


def kernel(body: str) -> str:
    """Return PTX of a kernel `votes`: %r0 is the number of the thread in its block, and %rd1 the address of WORDS."""
    return f"""{HEAD}.visible .entry votes(.param .u64 votes_param_0)
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


def run(body: str, threads: int, *, divides: bool = False) -> NDArray[np.uint32]:
    """Return the words that each of the threads of a block writes."""
    initialize_warp()
    library = Library(compiled(kernel(body), optimization=0))
    library.divide_warps(divides)
    block = -(-threads // 32) * 32
    out = np.zeros((block, WORDS), np.uint32)
    library.run("votes", threads, [ctypes.c_uint64(out.ctypes.data)], block=block, threads=range(threads))
    return out[:threads]


def test_threads_that_have_ended_are_not_waited_for():
    """Odd ones leave before the vote."""
    words = run(
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
    assert (words[::2, 0] == 0b01010101).all()
    assert (words[1::2, 0] == 0).all()


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


@pytest.mark.parametrize("divides", [False, True])
def test_threads_that_are_active_together(divides):
    """Those of a branch; with divided warps only the odd or the even ones, as the manual allows."""
    words = run(BRANCHES, 12, divides=divides)
    for thread in range(12):
        active = [t for t in range(12) if not divides or (t - thread) % 2 == 0]
        branch = [t for t in active if t & 4 == thread & 4]
        assert words[thread, 0] == sum(1 << t for t in branch)
        assert words[thread, 1] == sum(1 << t for t in branch if t < 6)
        assert words[thread, 2] == sum(1 << t for t in active)


def test_conversions_that_saturate():
    """To 0 to 1, and of NaN to 0."""
    numbers = np.array([-2.0, 0.25, 3.0, np.nan], np.float32)
    lines = [
        f"mov.b32 %f0, 0f{bits:08x}; \n cvt.sat.f32.f32 %f1, %f0; \n st.global.f32 [%rd1+{4 * k}], %f1;"
        for k, bits in enumerate(numbers.view(np.uint32))
    ]
    words = run(".reg .f32 %f<2>; \n" + "\n".join(lines), 1)
    np.testing.assert_array_equal(words[0, :4].view(np.float32), [0.0, 0.25, 1.0, 0.0])


def test_threads_that_wait_for_ever_are_noticed():
    for body in (
        # Thread 0 names other threads than they do.
        "setp.eq.u32 %p0, %r0, 0; \n selp.b32 %r1, -1, 0x7fffffff, %p0; \n vote.sync.ballot.b32 %r2, %p0, %r1;",
        # Without itself.
        "shl.b32 %r1, 2, %r0; \n setp.eq.u32 %p0, %r0, 0; \n vote.sync.ballot.b32 %r2, %p0, %r1;",
        # One waits at a vote, the others at a barrier.
        "setp.eq.u32 %p0, %r0, 0; \n @%p0 vote.sync.ballot.b32 %r2, %p0, -1; \n @!%p0 bar.warp.sync -1;",
    ):
        with pytest.raises(RuntimeError, match="votes: threads of a warp wait for others that never come"):
            run(body, 4)
