#pragma once
// What sixteen lanes do in one instruction of AVX-512; `portable.h` describes each function.
#include "lanes/masks.h"

#if LANES_BIT_MASKS
namespace lanes {
LANES_INLINE floats gathered(const char* base, ints offsets, Mask exec) {
    return __builtin_ia32_gathersiv16sf((floats)0.0f, base, offsets, bits(exec), 1);
}
LANES_INLINE floats permuted(floats x, ints lanes) { return __builtin_ia32_permvarsf512(x, lanes); }
LANES_INLINE ints packed(ints x, unsigned lanes) {
    return __builtin_ia32_compresssi512_mask(x, (ints)0, (unsigned short)lanes);
}
LANES_INLINE ints spread(ints packed, ints to, unsigned lanes) {
    return __builtin_ia32_expandsi512_mask(packed, to, (unsigned short)lanes);
}
LANES_INLINE ints moved(ints x, unsigned from, ints to, unsigned lanes) { return spread(packed(x, from), to, lanes); }
LANES_INLINE f4 three(const char* p) { return __builtin_ia32_loadups128_mask((const f4*)p, (f4)0.0f, 7); }
} // namespace lanes
#endif
