#pragma once
// Masks of lanes, in the form that suits the processor's registers.
//
// AVX-512 has registers of one bit per lane. Elsewhere a comparison sets all bits of each lane's number or none, and a
// selection asks for the highest bit: such a vector stays a mask without any conversion.
#include "lanes/width.h"

#if LANES_WIDTH == 16 && defined(__AVX512F__)
#define LANES_BIT_MASKS 1
#else
#define LANES_BIT_MASKS 0
#endif

namespace lanes {
#if LANES_BIT_MASKS
typedef bools flags;
#else
typedef ints flags;
#endif

// A mask of lanes, or a bool of each.
struct Mask {
    flags v;
    Mask() {}
#if LANES_BIT_MASKS
    Mask(bool b) : v(b) {}
    explicit Mask(bools x) : v(x) {}
#else
    Mask(bool b) : v(-(int)b) {}
#endif
    explicit Mask(ints comparison) : v(__builtin_convertvector(comparison, flags)) {}
    // The result of a comparison of any numbers.
    template<class V> static __attribute__((always_inline)) Mask of(V comparison) {
        return Mask(__builtin_convertvector(comparison, flags));
    }
};

#if LANES_BIT_MASKS
LANES_INLINE unsigned bits(Mask m) { return __builtin_bit_cast(unsigned short, m.v); }
LANES_INLINE Mask of_bits(unsigned m) { return Mask(__builtin_bit_cast(bools, (unsigned short)m)); }
template<class V> LANES_INLINE V choose(Mask m, V a, V b) { return m.v ? a : b; }
#else
template<int N> struct BitsOf {
    typedef unsigned char type;
};
template<> struct BitsOf<16> {
    typedef unsigned short type;
};
LANES_INLINE unsigned bits(Mask m) {
    return __builtin_bit_cast(BitsOf<WIDTH>::type, __builtin_convertvector(m.v < 0, bools)) & ALL;
}
LANES_INLINE Mask of_bits(unsigned m) {
    const ints own = {LANES_FIRST_OF(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)};
    return Mask(((ints)(int)m & own) == own);
}
template<class V> LANES_INLINE V choose(Mask m, V a, V b) {
    if constexpr (sizeof(V) == sizeof(ints)) return m.v < 0 ? a : b;
    else return __builtin_convertvector(m.v, longs) < 0 ? a : b;
}
#endif

LANES_INLINE bool any(Mask m) { return bits(m) != 0; }
LANES_INLINE Mask operator&(Mask a, Mask b) { return Mask(a.v & b.v); }
LANES_INLINE Mask operator|(Mask a, Mask b) { return Mask(a.v | b.v); }
LANES_INLINE Mask operator~(Mask a) { return Mask(~a.v); }
LANES_INLINE Mask unot(Mask a) { return ~a; }
LANES_INLINE Mask operator==(Mask a, Mask b) { return Mask(~(a.v ^ b.v)); }
LANES_INLINE Mask operator!=(Mask a, Mask b) { return Mask(a.v ^ b.v); }
LANES_INLINE Mask blend(Mask m, Mask a, Mask b) { return Mask((m.v & a.v) | (~m.v & b.v)); }
LANES_INLINE void clear(Mask& x) { x = false; }
} // namespace lanes
