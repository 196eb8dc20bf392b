"""The emulator of CUDA (`support/emulated_cuda`) computes what the PTX manual says, and its threads vote and wait.

Each row is compiled as a kernel whose thread i takes the operands of its i-th case. Whatever else it does, as in calls,
branches and atomic operations, is in the kernels whose films and trees are compared with those of the CPU.
"""

from __future__ import annotations

import ctypes
import math
import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.emulated_cuda.libraries import Library, compiled
from support.emulated_cuda.ptx import NotTranslated, parse
from support.emulated_cuda.translation import to_cpp

from wrt.backend.warp_start import initialize_warp

pytestmark = pytest.mark.machinery

Row = tuple[str, str, list[tuple[Any, ...]]]
"""An opcode, the types of its operands and of its result, and cases: operands, then the result."""

NAN, INF, TINY = math.nan, math.inf, 2.0**-149
LOW, HIGH = -(2**31), 2**31 - 1

HEAD = ".version 9.0\n.target sm_90\n.address_size 64\n"
REGISTERS = {"pred": "pred", "16": "b16", "32": "b32", "64": "b64", "f32": "f32", "f64": "f64"}

ROWS: list[Row] = [
    # Shifts by the width and more; bit fields beyond the end; counting bits.
    ("shl.b32", "b32 u32 -> u32", [(1, 31, 1 << 31), (1, 32, 0), (3, 31, 1 << 31), (1, 2**32 - 1, 0)]),
    ("shr.u32", "u32 u32 -> u32", [(1 << 31, 31, 1), (1 << 31, 32, 0), (1 << 31, 255, 0)]),
    ("shr.s32", "s32 u32 -> s32", [(LOW, 31, -1), (LOW, 32, -1), (LOW, 1000, -1), (HIGH, 40, 0)]),
    ("brev.b32", "b32 -> u32", [(1, 1 << 31), (0x12345678, 0x1E6A2C48), (0, 0)]),
    ("clz.b32", "b32 -> u32", [(0, 32), (1, 31), (2**32 - 1, 0)]),
    ("bfind.u32", "u32 -> u32", [(0, 2**32 - 1), (1, 0), (1 << 31, 31)]),
    # Whole numbers.
    ("mul.hi.u32", "u32 u32 -> u32", [(2**32 - 1, 2**32 - 1, 2**32 - 2)]),
    ("mul.hi.s32", "s32 s32 -> s32", [(-1, 1, -1), (LOW, LOW, 1 << 30)]),
    ("div.s32", "s32 s32 -> s32", [(-7, 2, -3), (7, -2, -3), (LOW, -1, LOW)]),
    ("rem.s32", "s32 s32 -> s32", [(-7, 2, -1), (7, -2, 1), (LOW, -1, 0)]),
    ("abs.s32", "s32 -> s32", [(-5, 5), (LOW, LOW), (7, 7)]),
    # Numbers: signs of zero, NaN, infinity, flushing.
    ("min.f32", "f32 f32 -> f32", [(NAN, 1.0, 1.0), (1.0, NAN, 1.0), (0.0, -0.0, -0.0), (-0.0, 0.0, -0.0)]),
    ("max.f32", "f32 f32 -> f32", [(NAN, 1.0, 1.0), (1.0, NAN, 1.0), (0.0, -0.0, 0.0), (-0.0, 0.0, 0.0)]),
    ("min.f64", "f64 f64 -> f64", [(NAN, NAN, NAN), (-0.0, 0.0, -0.0), (3.0, 2.0, 2.0)]),
    ("max.f64", "f64 f64 -> f64", [(NAN, -1.0, -1.0), (-0.0, 0.0, 0.0)]),
    ("mul.ftz.f32", "f32 f32 -> f32", [(2.0**-126, 0.5, 0.0), (-TINY, 2.0**100, -0.0), (3.0, 2.0, 6.0)]),
    ("mul.f32", "f32 f32 -> f32", [(2.0**-126, 0.5, 2.0**-127), (INF, 0.0, NAN)]),
    ("fma.rn.f32", "f32 f32 f32 -> f32", [(1 + 2.0**-12, 1 - 2.0**-12, -1.0, -(2.0**-24)), (INF, 0.0, 1.0, NAN)]),
    ("mad.rn.f64", "f64 f64 f64 -> f64", [(1 + 2.0**-27, 1 - 2.0**-27, -1.0, -(2.0**-54))]),
    ("div.rn.f32", "f32 f32 -> f32", [(1.0, 0.0, INF), (-1.0, 0.0, -INF), (0.0, 0.0, NAN), (1.0, -INF, -0.0)]),
    ("sqrt.rn.f32", "f32 -> f32", [(-1.0, NAN), (-0.0, -0.0), (2.0, float(np.sqrt(np.float32(2.0))))]),
    ("rcp.rn.f32", "f32 -> f32", [(3.0, float(np.float32(1) / np.float32(3))), (-0.0, -INF)]),
    # Conversions.
    ("cvt.rzi.s32.f32", "f32 -> s32", [(-1.9, -1), (3e9, HIGH), (-3e9, LOW), (NAN, 0), (INF, HIGH)]),
    ("cvt.rni.s32.f32", "f32 -> s32", [(0.5, 0), (1.5, 2), (2.5, 2), (-1.5, -2)]),
    ("cvt.rmi.s32.f32", "f32 -> s32", [(-0.5, -1), (0.5, 0)]),
    ("cvt.rmi.ftz.s32.f32", "f32 -> s32", [(-TINY, 0), (-0.5, -1)]),
    ("cvt.rn.ftz.f32.f64", "f64 -> f32", [(2.0**-130, 0.0), (0.5, 0.5)]),
    ("cvt.ftz.f64.f32", "f32 -> f64", [(TINY, 0.0), (0.5, 0.5)]),
    ("cvt.rpi.s32.f32", "f32 -> s32", [(-0.5, 0), (0.5, 1)]),
    ("cvt.rzi.u32.f32", "f32 -> u32", [(-1.0, 0), (5e9, 2**32 - 1), (NAN, 0), (3e9, 3000000000)]),
    ("cvt.rzi.s64.f32", "f32 -> s64", [(NAN, -(2**63)), (1e30, 2**63 - 1), (-1e30, -(2**63)), (-7.5, -7)]),
    ("cvt.rzi.u64.f64", "f64 -> u64", [(NAN, 1 << 63), (1e30, 2**64 - 1), (-1.0, 0), (2.0**63, 1 << 63)]),
    ("cvt.rzi.s32.f64", "f64 -> s32", [(NAN, LOW), (-1e10, LOW), (1e10, HIGH)]),
    ("cvt.rzi.u16.f32", "f32 -> u16", [(70000.0, 65535), (-3.0, 0), (12.7, 12)]),
    ("cvt.rzi.s8.f32", "f32 -> s16", [(300.0, 127), (-300.0, -128)]),
    ("cvt.rn.f32.f64", "f64 -> f32", [(1 + 2.0**-24, 1.0), (1 + 3 * 2.0**-25, 1 + 2.0**-23), (1e300, INF)]),
    ("cvt.rn.f32.s32", "s32 -> f32", [(2**24 + 1, 2.0**24), (2**24 + 3, 2.0**24 + 4), (-1, -1.0)]),
    ("cvt.rn.f32.u32", "u32 -> f32", [(2**32 - 1, 2.0**32)]),
]  # fmt: skip


# Comparisons: a NaN is neither less nor equal nor greater; the forms that end in u are true of it.
for _how, _less, _same, _more, _not_a_number in (
    *(("eq", 0, 1, 0, 0), ("ne", 1, 0, 1, 0), ("lt", 1, 0, 0, 0), ("le", 1, 1, 0, 0), ("gt", 0, 0, 1, 0)),
    *(("ge", 0, 1, 1, 0), ("equ", 0, 1, 0, 1), ("neu", 1, 0, 1, 1), ("ltu", 1, 0, 0, 1), ("leu", 1, 1, 0, 1)),
    *(("gtu", 0, 0, 1, 1), ("geu", 0, 1, 1, 1), ("num", 1, 1, 1, 0), ("nan", 0, 0, 0, 1)),
):
    _cases = [(1.0, 2.0, _less), (-0.0, 0.0, _same), (INF, INF, _same), (3.0, 2.0, _more)]
    _cases += [(NAN, 2.0, _not_a_number), (2.0, NAN, _not_a_number)]
    ROWS += [(f"setp.{_how}.{kind}", f"{kind} {kind} -> pred", _cases) for kind in ("f32", "f64")]
ROWS += [
    ("setp.gt.ftz.f32", "f32 f32 -> pred", [(TINY, 0.0, False), (0.5, 0.0, True)]),
    ("setp.lt.s32", "s32 s32 -> pred", [(-1, 1, True), (1, -1, False)]),
    ("setp.lt.u32", "u32 u32 -> pred", [(2**32 - 1, 1, False), (1, 2**32 - 1, True)]),
    ("selp.f32", "f32 f32 pred -> f32", [(NAN, 2.0, True, NAN), (1.0, -0.0, False, -0.0)]),
]  # fmt: skip


ROWS += [
    # Bit fields, bytes, funnel shifts, tables of bits.
    ("bfe.u32", "u32 u32 u32 -> u32", [(0xABCD1234, 8, 8, 0x12), (2**32 - 1, 31, 8, 1), (7, 0, 0, 0)]),
    ("bfe.s32", "u32 u32 u32 -> u32", [(1 << 31, 31, 1, 2**32 - 1), (1 << 31, 28, 8, 2**32 - 8), (0x70, 4, 4, 7)]),
    ("bfi.b32", "u32 u32 u32 u32 -> u32", [(255, 0, 28, 8, 0xF0000000), (5, 2**32 - 1, 4, 4, 0xFFFFFF5F)]),
    ("prmt.b32", "u32 u32 u32 -> u32", [(0x33221100, 0x77665544, 0x7531, 0x77553311), (0x80, 0, 8, 0x808080FF)]),
    ("shf.l.wrap.b32", "u32 u32 u32 -> u32", [(1 << 31, 1, 1, 3), (1 << 31, 1, 33, 3)]),
    ("shf.l.clamp.b32", "u32 u32 u32 -> u32", [(1 << 31, 1, 33, 1 << 31)]),
    ("shf.r.wrap.b32", "u32 u32 u32 -> u32", [(0, 1, 1, 1 << 31), (0, 1, 33, 1 << 31)]),
    ("shf.r.clamp.b32", "u32 u32 u32 -> u32", [(0, 1, 40, 1)]),
    ("lop3.b32", "u32 u32 u32 u32 -> u32", [(0xF0, 0xCC, 0xAA, 0xE8, 0xE8), (0xF0, 0xCC, 0xAA, 0x96, 0x96)]),
]  # fmt: skip

_CODES = {"s": {16: "h", 32: "i", 64: "q"}, "u": {16: "H", 32: "I", 64: "Q"}, "b": {16: "H", 32: "I", 64: "Q"}}


def _register(kind: str) -> str:
    return kind if kind in REGISTERS else REGISTERS[kind[1:]]


def _packed(value: Any, kind: str) -> bytes:
    """Return a value in 8 bytes."""
    if kind == "pred":
        return struct.pack("<Q", int(value))
    code = {"f32": "f", "f64": "d"}.get(kind) or _CODES[kind[0]][int(kind[1:])]
    return struct.pack(f"<{code}", value).ljust(8, b"\0")


def _row_kernel(name: str, row: Row) -> str:
    opcode, kinds, _ = row
    given, _, result = kinds.partition("->")
    kinds_in, kind_out = given.split(), result.strip()
    text = [f".visible .entry {name}(.param .u64 {name}_param_0, .param .u64 {name}_param_1)", "{"]
    text += [f".reg .{_register(kind)} %x{i};" for i, kind in enumerate([kind_out, *kinds_in])]
    text += [".reg .b32 %r<3>;", ".reg .b64 %rd<5>;", ".reg .pred %p<2>;", "mov.u32 %r0, %tid.x;"]
    text += [f"ld.param.u64 %rd0, [{name}_param_0];", f"ld.param.u64 %rd1, [{name}_param_1];"]
    text += [f"mad.wide.u32 %rd2, %r0, {8 * len(kinds_in)}, %rd0;", "mad.wide.u32 %rd3, %r0, 8, %rd1;"]
    for i, kind in enumerate(kinds_in):
        if kind == "pred":
            text += [f"ld.global.u32 %r1, [%rd2+{8 * i}];", f"setp.ne.u32 %x{i + 1}, %r1, 0;"]
        else:
            text.append(f"ld.global.{kind} %x{i + 1}, [%rd2+{8 * i}];")
    text.append(f"{opcode} {', '.join(f'%x{i}' for i in range(len(kinds_in) + 1))};")
    if kind_out == "pred":
        text += ["selp.u32 %r2, 1, 0, %x0;", "st.global.u32 [%rd3], %r2;"]
    else:
        text.append(f"st.global.{kind_out} [%rd3], %x0;")
    return "\n".join([*text, "ret;", "}"])


@pytest.fixture(scope="module", params=[0, 1], ids=["O0", "O1"])
def rows(request: pytest.FixtureRequest) -> Library:
    initialize_warp()
    text = HEAD + "\n".join(_row_kernel(f"row_{i}", row) for i, row in enumerate(ROWS))
    return Library(compiled(text, optimization=request.param))


def test_instructions(rows: Library) -> None:
    for i, row in enumerate(ROWS):
        assert_computed(i, row, rows)


def assert_computed(i: int, row: Row, rows: Library) -> None:
    opcode, kinds, cases = row
    given, _, result = kinds.partition("->")
    kinds_in, kind_out = given.split(), result.strip()
    data = ctypes.create_string_buffer(
        b"".join(_packed(value, kind) for case in cases for value, kind in zip(case, kinds_in, strict=False))
    )
    out = ctypes.create_string_buffer(8 * len(cases))
    rows.run(f"row_{i}", len(cases), [ctypes.c_uint64(ctypes.addressof(x)) for x in (data, out)], block=len(cases))
    for k, case in enumerate(cases):
        found, expected = out.raw[8 * k : 8 * k + 8], _packed(case[-1], kind_out)
        if isinstance(case[-1], float) and math.isnan(case[-1]):
            number = struct.unpack("<f" if kind_out == "f32" else "<d", found[: 4 if kind_out == "f32" else 8])[0]
            assert math.isnan(number), (opcode, case)
        else:
            assert found == expected, (opcode, case, found.hex())


@pytest.mark.parametrize(
    "text",
    [
        "bar.sync 0;",
        "shfl.sync.idx.b32 %r1, %r2, 0, 31, -1;",
        "cvt.rn.f16.f32 %rs1, %f1;",
        "mov.u32 %r1, %clock;",
        "call.uni some, ();",
        "vote.ballot.b32 %r1, %p0;",
    ],
)
def test_what_is_unknown_is_refused(text: str) -> None:
    """Before anything runs: a barrier, for one, has no meaning where threads run one after another."""
    registers = ".reg .b32 %r<3>;\n.reg .b16 %rs<3>;\n.reg .f32 %f<3>;\n.reg .pred %p<2>;"
    ptx = f"{HEAD}.visible .entry k()\n{{\n{registers}\n{text}\nret;\n}}\n"
    with pytest.raises(NotTranslated):
        to_cpp(parse(ptx))
    with pytest.raises(NotTranslated):  # functions of other modules
        parse(HEAD + ".extern .func (.param .b32 func_retval0) vprintf (\n.param .b64 vprintf_param_0\n)\n;\n")


# --- Threads of a warp that vote and wait for one another (PTX ISA, sections 9.7.13 and 9.7.14) --------

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
