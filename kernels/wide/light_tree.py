"""The walk down the tree over lights, sixteen at once.

All lanes go down together, each at a node of its own. The eight children of a node fill half a register of the
processor's, so those of two lanes are weighed at once, two after two: none waits for the last, as it would walking down
alone. Then all choose at once. The answers are those of `kernels/light_tree.py`, bit for bit.
"""

from wrt.kernels.light_tree import WEIGHTS_OF_TWO, light_tree_code

_SAMPLE_TREE = (
    """
    using lanes::f16; using lanes::i16; using lanes::d16; using lanes::f4;
    const float* const nodes = (const float*)tree.nodes.data;
    alignas(64) float all_weights[16][8], nearests[16];
    alignas(64) int places[16];
    #define IN_DOUBLE(a) __builtin_convertvector(a, d16)
    #define MASK_OF(a) lanes::Mask(__builtin_convertvector(a, lanes::b16))
    #define CHOOSE(mask, a, b) ((mask).v ? (a) : (b))
    d16 probability = 1.0, place = IN_DOUBLE(u.c[0].v) + IN_DOUBLE(u.c[1].v) * 5.9604644775390625e-8;
    i16 current = 0;
    lanes::Mask going = exec, far = false;
    bool root = true;
    while (lanes::any(going)) {
        *(i16*)places = current;
        for (unsigned rest = lanes::bits(going); rest;) {
            const int a = __builtin_ctz(rest);
            rest &= rest - 1;
            const int b = rest ? __builtin_ctz(rest) : a;
            rest &= rest - 1;
            const float *const one = nodes + (size_t)places[a] * 128, *const two = nodes + (size_t)places[b] * 128;
            const i16 both = lanes::of_bits(0xff).v ? (i16)a : (i16)b;
            #define OF_TWO(of_all) lanes::permuted(of_all, both)
            const f16 position[3] = {OF_TWO(position_.c[0].v), OF_TWO(position_.c[1].v), OF_TWO(position_.c[2].v)};
            const f16 normal[3] = {OF_TWO(normal_.c[0].v), OF_TWO(normal_.c[1].v), OF_TWO(normal_.c[2].v)};
            const i16 receives = (i16)OF_TWO((f16)receives_.v);
"""
    + WEIGHTS_OF_TWO
    + """
            *(f8*)all_weights[a] = __builtin_shufflevector(result, result, 0, 1, 2, 3, 4, 5, 6, 7);
            *(f8*)all_weights[b] = __builtin_shufflevector(result, result, 8, 9, 10, 11, 12, 13, 14, 15);
            nearests[a] = least[0];
            nearests[b] = least[8];
        }
        d16 sums[9];
        f16 weights[8];
        sums[0] = 0.0;
        for (int half = 0; half < 2; ++half) {
            const lanes::FourRows four = lanes::transposed([&](int l) __attribute__((always_inline)) {
                return *(const f4*)(all_weights[l] + 4 * half);
            });
            for (int k = 0; k < 4; ++k) weights[4 * half + k] = four.r[k];
        }
        for (int k = 0; k < 8; ++k) sums[k + 1] = sums[k] + IN_DOUBLE(weights[k]);
        if (root && tree.far > 0.0f) {
            const d16 irradiance = sums[8] * (double)tree.scale / IN_DOUBLE(*(const f16*)nearests);
            d16 share = 1.0 / (1.0 + (double)tree.far / irradiance);
            const d16 most = 1.0 - LEAST_SHARE;
            share = share < LEAST_SHARE ? (d16)LEAST_SHARE : (share < most ? share : most);
            share = sums[8] > 0.0 ? share : (d16)0.0;
            far = going & MASK_OF(place >= share);
            place = CHOOSE(far, (place - share) / (1.0 - share), place / share);
            probability = CHOOSE(far, 1.0 - share, share);
            going = going & ~far;
        }
        root = false;
        const lanes::Mask dark = going & ~MASK_OF(sums[8] > 0.0);
        probability = CHOOSE(dark, (d16)0.0, probability);
        going = going & ~dark;
        const d16 target = (place < BELOW_ONE ? place : (d16)BELOW_ONE) * sums[8];
        d16 before = 0.0, own = 1.0;
        i16 chosen = 0;
        for (int k = 0; k < 8; ++k) {
            const lanes::Mask here = MASK_OF(target >= sums[k]) & lanes::Mask(weights[k] > 0.0f);
            before = CHOOSE(here, sums[k], before);
            own = CHOOSE(here, IN_DOUBLE(weights[k]), own);
            chosen = CHOOSE(here, (i16)k, chosen);
        }
        place = CHOOSE(going, (target - before) / own, place);
        probability = CHOOSE(going, probability * (own / sums[8]), probability);
        alignas(64) int children[16];
        *(i16*)children = chosen;
        LANES_EACH(l, going) places[l] = ((const int*)(nodes + (size_t)places[l] * 128 + 120))[children[l]];
        current = *(const i16*)places;
        going = going & lanes::Mask(current >= 0);
    }
    const lanes::Mask found = MASK_OF(probability > 0.0);
    const i16 light = CHOOSE(far, (i16)-2, CHOOSE(found, -1 - current, (i16)-1));
    place = (place < BELOW_ONE ? place : (d16)BELOW_ONE) * 16777216.0;
    const i16 rest = __builtin_convertvector(place, i16);
    const i16 more = __builtin_convertvector((place - IN_DOUBLE(rest)) * 16777216.0, i16);
    const float digit = 5.9604644775390625e-8f;
    const d16 least = 1e-37;
    const d16 known = CHOOSE(found & MASK_OF(probability < least), least, probability);
    lanes::Vector<4, lanes::Floats> r;
    r.c[0].v = __builtin_bit_cast(f16, light);
    r.c[1].v = __builtin_convertvector(known, f16);
    r.c[2].v = __builtin_convertvector(rest, f16) * digit;
    r.c[3].v = __builtin_convertvector(more, f16) * digit;
    return r;
    #undef IN_DOUBLE
    #undef MASK_OF
    #undef CHOOSE
    #undef OF_TWO
"""
)

# C++ at file level: `NAME` is that of the function, `TREE_TYPE` of the tree's struct.
SAMPLE_TREE = f"""
LANES_CALLED lanes::Vector<4, lanes::Floats> NAME(
    const TREE_TYPE& tree, const lanes::Vector<3, lanes::Floats>& position_,
    const lanes::Vector<3, lanes::Floats>& normal_, const lanes::Ints& receives_,
    const lanes::Vector<2, lanes::Floats>& u, const lanes::Mask exec) {{
{light_tree_code(_SAMPLE_TREE)}
}}
"""
