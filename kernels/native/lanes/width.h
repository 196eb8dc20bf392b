#pragma once
// How many lanes there are, and vectors of as many numbers.
//
// The translator (`wrt/spmd`) defines LANES_WIDTH. Vectors are those of clang, which makes several registers of one that
// is too wide for the processor.

#if !defined(LANES_WIDTH)
#define LANES_WIDTH 16
#endif

// No function of vectors is called from code that another compiler has made.
#pragma clang diagnostic ignored "-Wpsabi"

namespace lanes {
#define LANES_INLINE static inline __attribute__((always_inline))
#define LANES_CALLED static __attribute__((noinline))
#define LANES_UNROLL _Pragma("clang loop unroll(full)")

constexpr int WIDTH = LANES_WIDTH;
constexpr unsigned ALL = (1u << WIDTH) - 1;  // bits of all lanes
typedef float floats __attribute__((ext_vector_type(WIDTH)));
typedef int ints __attribute__((ext_vector_type(WIDTH)));
typedef unsigned uints __attribute__((ext_vector_type(WIDTH)));
typedef long long longs __attribute__((ext_vector_type(WIDTH)));
typedef double doubles __attribute__((ext_vector_type(WIDTH)));
typedef bool bools __attribute__((ext_vector_type(WIDTH)));
typedef float f4 __attribute__((ext_vector_type(4)));

// Numbers of fewer lanes, from one of 16.
#if LANES_WIDTH == 16
#define LANES_FIRST_OF(a, b, c, d, ...) a, b, c, d, __VA_ARGS__
#elif LANES_WIDTH == 8
#define LANES_FIRST_OF(a, b, c, d, e, f, g, h, ...) a, b, c, d, e, f, g, h
#else
#define LANES_FIRST_OF(a, b, c, d, ...) a, b, c, d
#endif
} // namespace lanes
