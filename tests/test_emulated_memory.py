"""The emulator of CUDA: memory, branches, grids, atomic operations, and what it refuses."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
import warp as wp
from support.emulated_cuda.backend import GPU, emulated_cuda
from support.emulated_cuda.libraries import Library, compiled
from support.emulated_cuda.ptx import NotTranslated, parse
from support.emulated_cuda.translation import to_cpp

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_backend import initialize_warp

HEAD = ".version 9.0\n.target sm_90\n.address_size 64\n"

MEMORY = HEAD + """
.const .align 4 .b8 bytes[8] = {1, 2, 3, 255};
.global .align 4 .f32 half = 0f3F000000;
.visible .entry memory(
    .param .u64 memory_param_0,
    .param .align 8 .b8 memory_param_1[16]
)
{
    .local .align 16 .b8 __local_depot0[64];
    .shared .align 4 .b8 pool[16];
    .shared .align 8 .b8 second[8];
    .reg .b64 %rd<8>;
    .reg .b32 %r<16>;
    .reg .b16 %rs<3>;
    .reg .f32 %f<6>;
    .reg .pred %p<4>;
    mov.u64 %rd1, __local_depot0;
    ld.param.u64 %rd2, [memory_param_0];
    ld.param.v2.u32 {%r1, %r2}, [memory_param_1+8];
    mov.u32 %r3, %tid.x;
    mul.wide.u32 %rd3, %r3, 64;
    add.s64 %rd2, %rd2, %rd3;
    // Local memory, a vector at a time; a target may be part of the address.
    mov.f32 %f1, 0f3F800000;
    mov.f32 %f2, 0f40000000;
    st.local.v4.f32 [%rd1+16], {%f1, %f2, %f1, %f2};
    ld.local.v2.f32 {%f3, %f4}, [%rd1+20];
    add.f32 %f3, %f3, %f4;
    st.global.f32 [%rd2], %f3;
    st.local.u64 [%rd1], %rd2;
    ld.local.u64 %rd1, [%rd1];
    st.global.u32 [%rd1+4], %r2;
    // Shared memory has its own addresses, and lasts from thread to thread of a block.
    mov.u32 %r4, second;
    ld.shared.u32 %r5, [%r4];
    st.global.u32 [%rd2+8], %r5;
    st.shared.u32 [%r4], %r3;
    st.shared.u8 [pool+1], %r2;
    ld.shared.s8 %r6, [pool+1];
    st.global.u32 [%rd2+12], %r6;
    // Constants, and a variable.
    ld.const.u8 %rs1, [bytes+3];
    cvt.u32.u16 %r7, %rs1;
    st.global.u32 [%rd2+16], %r7;
    mov.u64 %rd4, bytes;
    ld.const.u8 %r8, [%rd4+4];
    st.global.u32 [%rd2+20], %r8;
    ld.global.f32 %f5, [half];
    st.global.f32 [%rd2+24], %f5;
    // Registers taken apart and joined.
    mov.b32 {%rs1, %rs2}, 305419896;
    mov.b32 %r9, {%rs2, %rs1};
    st.global.u32 [%rd2+28], %r9;
    ret;
}
"""  # fmt: skip


@pytest.mark.parametrize("optimization", [0, 1])
def test_memory(optimization: int) -> None:
    initialize_warp()
    library = Library(compiled(MEMORY, optimization=optimization))
    out, given = np.zeros((3, 16), np.uint32), (ctypes.c_uint32 * 4)(7, 8, 9, 200)
    library.run("memory", 3, [ctypes.c_uint64(out.ctypes.data), given], block=3)
    assert (out[:, 0].view(np.float32) == 3.0).all()
    assert (out[:, 1] == 200).all()
    assert out[1:, 2].tolist() == [0, 1]
    assert (out[:, 3] == 2**32 - 56).all()
    assert (out[:, 4] == 255).all()
    assert (out[:, 5] == 0).all()
    assert (out[:, 6].view(np.float32) == 0.5).all()
    assert (out[:, 7] == 0x56781234).all()


JUMPS = HEAD + """
.visible .entry jumps(.param .u64 jumps_param_0)
{
    .reg .b64 %rd<3>;
    .reg .b32 %r<8>;
    .reg .pred %p<6>;
    ld.param.u64 %rd0, [jumps_param_0];
    mov.u32 %r0, %ctaid.x;
    mov.u32 %r1, %ntid.x;
    mov.u32 %r2, %tid.x;
    mad.lo.s32 %r0, %r0, %r1, %r2;
    mul.wide.u32 %rd1, %r0, 4;
    add.s64 %rd0, %rd0, %rd1;
    mov.u32 %r3, 0;
    mov.u32 %r4, %r0;
$sum:
    setp.eq.s32 %p1|%p2, %r4, 0;
    @%p1 bra $after;
    add.s32 %r3, %r3, %r4;
    add.s32 %r4, %r4, -1;
    @%p2 bra.uni $sum;
$after:
    {
    .reg .b32 %r4;
    mov.u32 %r4, 1000;
    setp.gt.s32 %p3, %r0, 2;
    @!%p3 add.s32 %r3, %r3, %r4;
    }
$table: .branchtargets $zero, $one, $two;
    rem.u32 %r5, %r0, 3;
    brx.idx %r5, $table;
$zero: add.s32 %r3, %r3, 10000;
    bra $end;
$one: add.s32 %r3, %r3, 20000;
    bra $end;
$two: add.s32 %r3, %r3, 30000;
$end:
    add.s32 %r3, %r3, %r4;
    st.global.u32 [%rd0], %r3;
    ret;
}
"""  # fmt: skip


def test_branches() -> None:
    """Loops, predicates, both results of a comparison, a table of branches, a block with its own registers; a grid."""
    initialize_warp()
    out = np.zeros(12, np.uint32)
    Library(compiled(JUMPS, optimization=0)).run("jumps", 10, [ctypes.c_uint64(out.ctypes.data)], block=4)
    expected = [n * (n + 1) // 2 + (1000 if n <= 2 else 0) + 10000 * (n % 3 + 1) for n in range(12)]
    assert out.tolist() == expected


ATOMS: list[tuple[str, str, list[int], list[int], list[int]]] = [
    # instruction, type, the place and one value a thread, what each gets, and the place afterwards
    ("atom.global.add.u32", "u32", [5, 1, 2, 3], [5, 6, 8], [11]),
    ("atom.global.min.s32", "s32", [5, 7, -2, 3], [5, 5, -2], [-2]),
    ("atom.global.max.u32", "u32", [5, 7, 2**32 - 1, 3], [5, 7, 2**32 - 1], [2**32 - 1]),
    ("atom.global.and.b32", "u32", [7, 6, 5, 4], [7, 6, 4], [4]),
    ("atom.global.or.b32", "u32", [0, 1, 2, 4], [0, 1, 3], [7]),
    ("atom.global.xor.b32", "u32", [1, 1, 3, 2], [1, 0, 3], [1]),
    ("atom.global.exch.b32", "u32", [1, 2, 3, 4], [1, 2, 3], [4]),
    ("atom.global.inc.u32", "u32", [1, 2, 2, 2], [1, 2, 0], [1]),
    ("atom.global.dec.u32", "u32", [1, 5, 5, 5], [1, 0, 5], [4]),
    ("atom.global.cas.b32", "u32", [1, 1, 1, 9], [1, 9, 9], [9]),  # 1 becomes 9; so do 1 and 9
]


@pytest.fixture(scope="module")
def atoms() -> Library:
    text = HEAD
    for i, (opcode, *_) in enumerate(ATOMS):
        further = ", 9" if ".cas." in opcode else ""
        reduction = opcode.replace("atom", "red")
        text += f"""
.visible .entry atom_{i}(.param .u64 p_{i}_0)
{{
    .reg .b64 %rd<4>;
    .reg .b32 %r<8>;
    .reg .f32 %f<2>;
    ld.param.u64 %rd0, [p_{i}_0];
    mov.u32 %r0, %tid.x;
    mad.wide.u32 %rd1, %r0, 4, %rd0;
    ld.global.u32 %r1, [%rd1+4];
    {opcode} %r2, [%rd0], %r1{further};
    st.global.u32 [%rd1+16], %r2;
    {"" if further else f"{reduction} [%rd0+32], %r1;"}
    mov.f32 %f1, 0f3F800000;
    red.global.add.f32 [%rd0+36], %f1;
    ret;
}}
"""
    initialize_warp()
    return Library(compiled(text, optimization=0))


@pytest.mark.parametrize("i", range(len(ATOMS)), ids=[row[0] for row in ATOMS])
def test_atomics(i: int, atoms: Library) -> None:
    opcode, kind, start, got, after = ATOMS[i]
    memory = np.zeros(10, np.int32 if kind == "s32" else np.uint32)
    memory[:4], memory[8] = start, start[0]
    atoms.run(f"atom_{i}", 3, [ctypes.c_uint64(memory.ctypes.data)], block=3)
    assert memory[4:7].tolist() == got
    assert memory[:1].tolist() == after
    assert ".cas." in opcode or memory[8] == after[0]
    assert memory[9:].view(np.float32)[0] == 3.0


@pytest.mark.parametrize(
    "text",
    [
        "bar.sync 0;",
        "shfl.sync.idx.b32 %r1, %r2, 0, 31, -1;",
        "cvt.rn.f16.f32 %rs1, %f1;",
        "add.cc.u32 %r1, %r1, %r2;",
        "min.NaN.f32 %f1, %f1, %f2;",
        "mov.u32 %r1, %clock;",
        "call.uni some, ();",
    ],
)
def test_what_is_unknown_is_refused(text: str) -> None:
    """Before anything runs: a barrier, for one, has no meaning where threads run one after another."""
    ptx = HEAD + f".visible .entry k()\n{{\n.reg .b32 %r<3>;\n.reg .b16 %rs<3>;\n.reg .f32 %f<3>;\n{text}\nret;\n}}\n"
    with pytest.raises(NotTranslated):
        to_cpp(parse(ptx))


def test_functions_of_other_modules_are_refused() -> None:
    with pytest.raises(NotTranslated):
        parse(HEAD + ".extern .func (.param .b32 func_retval0) vprintf (\n.param .b64 vprintf_param_0\n)\n;\n")


FUNCTIONS = HEAD + """
.func (.param .align 4 .b8 func_retval0[8]) both(
    .param .align 4 .b8 both_param_0[8],
    .param .b32 both_param_1
)
;
.func (.param .align 4 .b8 func_retval0[8]) both(
    .param .align 4 .b8 both_param_0[8],
    .param .b32 both_param_1
)
{
    .reg .b32 %r<6>;
    ld.param.u32 %r1, [both_param_0];
    ld.param.u32 %r2, [both_param_0+4];
    ld.param.u32 %r3, [both_param_1];
    mad.lo.s32 %r4, %r1, %r3, %r2;
    st.param.b32 [func_retval0+0], %r4;
    mov.u32 %r5, %tid.x;
    st.param.b32 [func_retval0+4], %r5;
    ret;
}
.func write(
    .param .b64 write_param_0
)
{
    .reg .b64 %rd<2>;
    ld.param.u64 %rd1, [write_param_0];
    st.u32 [%rd1], 7;
    ret;
}
.visible .entry calls(.param .u64 calls_param_0)
{
    .reg .b64 %rd<3>;
    .reg .b32 %r<6>;
    ld.param.u64 %rd1, [calls_param_0];
    mov.u32 %r1, %tid.x;
    mad.wide.u32 %rd1, %r1, 12, %rd1;
    { // callseq 0, 0
    .reg .b32 temp_param_reg;
    .param .align 4 .b8 param0[8];
    st.param.b32 [param0+0], 5;
    st.param.b32 [param0+4], %r1;
    .param .b32 param1;
    st.param.b32 [param1+0], 100;
    .param .align 4 .b8 retval0[8];
    call.uni (retval0),
    both,
    (
    param0,
    param1
    );
    ld.param.b32 %r2, [retval0+0];
    ld.param.b32 %r3, [retval0+4];
    } // callseq 0
    st.global.u32 [%rd1], %r2;
    st.global.u32 [%rd1+4], %r3;
    add.s64 %rd2, %rd1, 8;
    {
    .param .b64 param0;
    st.param.b64 [param0+0], %rd2;
    call.uni write, (param0);
    }
    ret;
}
"""  # fmt: skip


@pytest.mark.parametrize("optimization", [0, 1])
def test_functions_are_called(optimization: int) -> None:
    initialize_warp()
    out = np.zeros((3, 3), np.uint32)
    library = Library(compiled(FUNCTIONS, optimization=optimization))
    library.run("calls", 3, [ctypes.c_uint64(out.ctypes.data)], block=3)
    assert out.tolist() == [[500 + i, i, 7] for i in range(3)]


def test_the_gpu_is_gone_afterwards() -> None:
    """Without the context, a device is what the machine has."""
    if wp.get_cuda_device_count() == 0:
        with pytest.raises(wrt.InputError, match="was found; use cpu"):
            Device("cuda")
    with emulated_cuda():
        assert (Device("cuda").name, Device("cuda").is_cpu) == (GPU, False)
