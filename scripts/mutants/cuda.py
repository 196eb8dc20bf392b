"""Faults of what runs on CUDA alone, or for small scenes only there."""

from __future__ import annotations

from .mutant import Mutant

FAULTS: tuple[Mutant, ...] = (
    Mutant(
        "cuda-digit",
        "cuda",
        "kernels/native/low_discrepancy.h",
        "columns[dimension - 2][__ffs(rest) - 1]",
        "columns[dimension - 2][__ffs(rest) & 31]",
        "tests/test_emulated_cuda.py -k 'films_agree and moving'",
    ),
    Mutant(
        "cuda-reversed-bits",
        "cuda",
        "kernels/native/low_discrepancy.h",
        "return __brev(bits);",
        "return __brev(bits) | 1u << 31;",
        "tests/test_emulated_cuda.py -k 'films_agree and cornell'",
    ),
    Mutant(
        "cuda-contraction",
        "cuda",
        "kernels/native/vectors.h",
        "return __fmul_rn(a, b);",
        "return a * b;",
        "tests/test_emulated_cuda.py -k edges",
    ),
    Mutant(
        "cuda-lowest-bit",
        "cuda",
        "kernels/native/vectors.h",
        "return __ffs(m) - 1;",
        "return 31 - __clz(m);",
        "tests/test_emulated_cuda.py -k difficult",
    ),
    Mutant(
        "cuda-near-side",
        "cuda",
        "kernels/native/boxes.h",
        "ray.near_shift[k] = slab.shift + slab.error;",
        "ray.near_shift[k] = slab.shift - 2.0f * slab.error;",
        "tests/test_emulated_cuda.py -k sides",
    ),
    Mutant(
        "cuda-leaves-surface",
        "cuda",
        "kernels/native/gpu.h",
        "&& exceeds_error(s, d, ray.shear))",
        ")",
        "tests/test_emulated_cuda.py -k edges",
    ),
    Mutant(
        "cuda-equal-distance",
        "cuda",
        "kernels/native/gpu.h",
        "d.t <= nearest.t && exceeds",
        "d.t < nearest.t && exceeds",
        "tests/test_emulated_cuda.py -k coincident_triangles",
    ),
    Mutant(
        "cuda-barycentric",
        "cuda",
        "kernels/native/gpu.h",
        "s.v * d.inverse_det, s.w * d.inverse_det",
        "s.v * d.inverse_det, s.u * d.inverse_det",
        "tests/test_emulated_cuda.py -k 'hits_agree and single'",
    ),
    Mutant(
        "cuda-packets",
        "cuda",
        "wrt/rendering/intersector.py",
        "elif self.device.is_cpu and n >= SMALL_BATCH",
        "elif n >= SMALL_BATCH",
        "tests/test_emulated_cuda.py -k 'hits_agree and packets'",
    ),
    Mutant(
        "cuda-subtrees",
        "cuda",
        "wrt/upload/accel/gpu_tree.py",
        "-(-2 * count // levels.SUBTREE)",
        "-(-count // levels.SUBTREE // 4)",
        "tests/test_emulated_cuda.py -k 'trees and soup'",
    ),
    Mutant(
        "cuda-last-sample",
        "cuda",
        "kernels/regeneration.py",
        "film.rejected[pixel] = film.rejected[pixel] + 1\n",
        "film.rejected[pixel] = film.rejected[pixel] + 1\n"
        "                if index >= target_count:\n"
        "                    break\n",
        "tests/test_gpu_model.py -k counts_of_a_scene",
    ),
    Mutant(
        "cuda-next-sample",
        "cuda",
        "kernels/regeneration.py",
        "sampler.index = wp.uint32(index)",
        "sampler.index = wp.uint32(film.count[pixel])",
        "tests/test_emulated_cuda.py -k 'regenerated and cornell'",
    ),
    Mutant(
        "cuda-invisible",
        "cuda",
        "kernels/regeneration.py",
        "path.depth = settings.max_depth",
        "path.depth = 0",
        "tests/test_emulated_cuda.py -k 'regenerated and fisheye'",
    ),
)
