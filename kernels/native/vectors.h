#pragma once
// Arithmetic for the tests of boxes and triangles. With clang on the CPU a value is a vector with an element for each
// box, triangle or ray; on CUDA it is one number in a loop. Both compute the same.
#include "constants.h"

#if !defined(WRT_VECTORS)
#if defined(__clang__) && !defined(__CUDA_ARCH__)
#define WRT_VECTORS 1
#else
#define WRT_VECTORS 0
#endif
#endif

#if defined(__CUDA_ARCH__)
#define WRT_MEMBER CUDA_CALLABLE __forceinline__
#else
#define WRT_MEMBER inline __attribute__((always_inline))
#endif
#define WRT_INLINE static WRT_MEMBER

#if WRT_VECTORS
#define WRT_INLINE_LAMBDA __attribute__((always_inline))
#define WRT_NO_UNROLLING _Pragma("clang loop unroll(disable)")
#define WRT_UNROLL _Pragma("clang loop unroll(full)")
#else
#define WRT_INLINE_LAMBDA
#define WRT_NO_UNROLLING _Pragma("unroll 1")
#define WRT_UNROLL _Pragma("unroll")
#endif

// Rounds each product before the addition, as `product` does on CUDA.
#if WRT_VECTORS
#define WRT_NO_CONTRACTION _Pragma("clang fp contract(off)")
#else
#define WRT_NO_CONTRACTION
#endif

namespace wrt {
#if WRT_VECTORS
typedef float f4 __attribute__((ext_vector_type(4), aligned(4)));
typedef int i4 __attribute__((ext_vector_type(4), aligned(4)));
typedef bool b4 __attribute__((ext_vector_type(4)));
typedef float f8 __attribute__((ext_vector_type(8), aligned(4)));
typedef int i8 __attribute__((ext_vector_type(8), aligned(4)));
typedef bool b8 __attribute__((ext_vector_type(8)));
typedef float f16 __attribute__((ext_vector_type(16)));
typedef int i16 __attribute__((ext_vector_type(16)));
typedef bool b16 __attribute__((ext_vector_type(16)));

// One instruction each; clang's own functions take three, as they handle NaN, which does not matter here.
template<class V> WRT_INLINE V least(V a, V b) { return a < b ? a : b; }
template<class V> WRT_INLINE V most(V a, V b) { return a > b ? a : b; }
template<class V> WRT_INLINE V size(V a) { return __builtin_elementwise_abs(a); }
template<class V> WRT_INLINE V product(V a, V b) {
    WRT_NO_CONTRACTION
    return a * b;
}
// a * b - c and a - b * c, rounded once if the processor has an instruction for it.
template<class V, class B> WRT_INLINE V product_less(V a, B b, B c) {
#if defined(__FMA__)
    return __builtin_elementwise_fma(a, (V)b, -(V)c);
#else
    return a * b - c;
#endif
}
template<class V, class B> WRT_INLINE V less_product(V a, B b, V c) {
#if defined(__FMA__)
    return __builtin_elementwise_fma(-(V)b, c, a);
#else
    return a - b * c;
#endif
}
WRT_INLINE unsigned mask_of(i4 m) { return __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b4)) & 15u; }
WRT_INLINE unsigned mask_of(i8 m) { return __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b8)); }
WRT_INLINE unsigned mask_of(i16 m) { return __builtin_bit_cast(unsigned short, __builtin_convertvector(m, b16)); }
WRT_INLINE int lowest_bit(unsigned m) { return __builtin_ctz(m); }

#if defined(__AVX2__)
WRT_INLINE i8 permuted(i8 a, i8 places) { return __builtin_ia32_permvarsi256(a, places); }
// The elements at the set bits of m, packed.
WRT_INLINE i8 compressed(i8 a, unsigned char m) {
#if defined(__AVX512VL__)
    return __builtin_ia32_compresssi256_mask(a, (i8)0, m);
#else
    typedef unsigned char u8 __attribute__((ext_vector_type(8), aligned(1)));
    static const unsigned char set_bits[256][8] = {WRT_SET_BITS};
    return permuted(a, __builtin_convertvector(*(const u8*)set_bits[m], i8));
#endif
}
#endif
#else
WRT_INLINE float least(float a, float b) { return fminf(a, b); }
WRT_INLINE float most(float a, float b) { return fmaxf(a, b); }
WRT_INLINE float size(float a) { return fabsf(a); }
WRT_INLINE float product(float a, float b) { return __fmul_rn(a, b); }
WRT_INLINE double product(double a, double b) { return __dmul_rn(a, b); }
WRT_INLINE float product_less(float a, float b, float c) { return fmaf(a, b, -c); }
WRT_INLINE float less_product(float a, float b, float c) { return fmaf(-b, c, a); }
WRT_INLINE int lowest_bit(unsigned m) { return __ffs(m) - 1; }
#endif

// Element k of three. An array that is indexed at run time would lie in memory on CUDA, not in registers.
template<class Vector> WRT_INLINE float element(const Vector& v, const int k) {
#if WRT_VECTORS
    return v[k];
#else
    return k == 0 ? v[0] : k == 1 ? v[1] : v[2];
#endif
}

WRT_INLINE int bits_of(float a) {
    int bits;
    memcpy(&bits, &a, 4);
    return bits;
}
WRT_INLINE float float_of(int bits) {
    float a;
    memcpy(&a, &bits, 4);
    return a;
}
} // namespace wrt
