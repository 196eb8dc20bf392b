#pragma once
// A pool of a thousand paths: the order in which they begin, are traced, are compacted and end.
//
// A group has as many paths as there are lanes. If a pass takes as many samples of a pixel or more, a group begins with
// samples of one pixel: their rays stay coherent for longer, and all data that the pool reads are close together. With
// half as many samples a group begins with two pixels, and so on, down to one sample of a square of sixteen by sixteen
// pixels.
//
// Each round traces the rays of all paths. A group of rays of one octant descends the tree as it is; the rays of the
// other groups are sorted by octant first, since testing boxes takes fewer instructions for rays of one octant (Wald
// 2001, "Interactive rendering with coherent ray tracing"). Once paths that hit nothing have ended, and after each
// round, the others are compacted if less than seven eighths of the lanes are in use. The grouping of paths changes no
// bit of the film.
//
// The translator (`wrt/spmd`) puts the types `Pixels`, `Path`, `Steps`, `Given` and `Result` before this text, and
// replaces ROUND by the statements of a round; ARGUMENTS_IN and ARGUMENTS by the kernel's arguments as parameters and as
// passed on; TARGET by the name of the argument that counts samples; and FIXED by the arguments that all paths share.
#include "constants.h"
#include "lanes/memory.h"

struct Here {};
inline void* operator new(decltype(sizeof(0)), Here, void* p) { return p; }

namespace {
constexpr int TILE = wrt::TILE;
constexpr int BLOCKS = TILE * TILE / lanes::WIDTH;  // of as many pixels as there are lanes, in a tile
constexpr int GROUPS = wrt::PATHS / lanes::WIDTH;

// Copy one lane of a struct that consists of four-byte numbers.
template<class T> LANES_INLINE void copy_lane(T& to, int lane, const T& from, int lane_from) {
    static_assert(sizeof(T) % (4 * lanes::WIDTH) == 0, "numbers of other sizes");
    _Pragma("clang loop unroll(full)") for (unsigned row = 0; row < sizeof(T) / (4 * lanes::WIDTH); ++row)
        ((int*)&to)[lanes::WIDTH * row + lane] = ((const int*)&from)[lanes::WIDTH * row + lane_from];
}

// Groups of paths, with their pixels and results.
struct Pool {
    alignas(64) char pixel_memory[sizeof(Pixels) * GROUPS], path_memory[sizeof(Path) * GROUPS];
    alignas(64) Result results[GROUPS];
    lanes::Mask live[GROUPS];
    int count;
    static constexpr int GIVEN_ROWS = sizeof(Given) / (4 * lanes::WIDTH);
    static_assert(sizeof(Given) % (4 * lanes::WIDTH) == 0, "what is given is not of numbers of four bytes alone");
    Pixels& pixels(int g) { return ((Pixels*)pixel_memory)[g]; }
    Path& path(int g) { return ((Path*)path_memory)[g]; }

    // Begin a path for each sample that has begun: those of one pixel, or of a few neighbours, form a group.
    void begin_paths(const int among) {
        const int neighbours = lanes::WIDTH / among;
        const lanes::ints numbers = lanes::lane_numbers().v;
        alignas(64) Given given[4];
        for (int first = 0; first < count; first += among) {
            unsigned all = ~0u;  // bits of the block's pixels with all samples begun
            for (int n = 0; n < among; ++n) all &= lanes::bits(pixels(first + n).begun_);
            for (int g = first; g < first + among; ++g) {
                const int pixel = (g - first) * neighbours;  // the group's first pixel
                if (among < lanes::WIDTH)
                    collect(given[g % 4], first, among, pixel);
                else if (g % 4 == 0)
                    collect_four(given, first, pixel);
                unsigned lives = all;
                if (all != lanes::ALL) {
                    lives = 0;
                    for (int n = 0; n < among; ++n) {
                        const unsigned begun = lanes::bits(pixels(first + n).begun_) >> pixel;
                        for (int k = 0; k < neighbours; ++k) lives |= (begun >> k & 1) << (among * k + n);
                    }
                }
                begin(path(g), given[g % 4], live[g] = lanes::of_bits(lives));
                path(g).home = lanes::Ints(lanes::WIDTH * (first + (numbers & (among - 1))) + pixel + numbers / among);
            }
        }
    }

    // Gather the arguments of the samples of a few neighbours.
    void collect(Given& given, const int first, const int among, const int pixel) {
        typedef lanes::ints anywhere __attribute__((aligned(4)));
        for (int n = 0; n < among; ++n) {
            const unsigned own = lanes::bits(lanes::Mask((lanes::lane_numbers().v & (among - 1)) == n));
            const int* const from = (const int*)&pixels(first + n).given_ + pixel;
            _Pragma("clang loop unroll(disable)") for (int row = 0; row < GIVEN_ROWS; ++row) {
                lanes::ints& to = ((lanes::ints*)&given)[row];
                to = lanes::spread(*(const anywhere*)(from + lanes::WIDTH * row), to, own);
            }
        }
    }

    // Gather the arguments of as many samples as there are lanes, of each of four pixels.
    void collect_four(Given* given, const int first, const int pixel) {
        _Pragma("clang loop unroll(disable)") for (int row = 0; row < GIVEN_ROWS; ++row) {
            const lanes::FourRows rows = lanes::transposed([&](int l) __attribute__((always_inline)) {
                const float* const from = (const float*)&pixels(first + l).given_ + lanes::WIDTH * row;
                return (lanes::f4) * (const lanes::f4_anywhere*)(from + pixel);
            });
            for (int k = 0; k < 4; ++k) ((lanes::floats*)&given[k])[row] = rows.r[k];
        }
    }

    // Begin the next samples of all pixels, and return whether there are any.
    bool start() {
        bool more = false;
        _Pragma("clang loop unroll(disable)") for (int g = 0; g < count; ++g) {
            pixels(g).start();
            more |= lanes::any(pixels(g).sampled_);
        }
        return more;
    }

    // Add the results of paths to their pixels, in the order of samples.
    void finish(const int among) {
        for (int g = 0; g < count; ++g) {
            pixels(g).carry(pixels(g % among == 0 ? g + among - 1 : g - 1));
            pixels(g).finish(results[g]);
        }
    }

    // Follow all paths to their ends.
    void follow() {
        int groups = count;  // groups that may have paths left
        while (close_up_where_sparse(groups)) {
            ROUND
        }
    }

    // Return whether any path is left.
    bool close_up_where_sparse(int& groups) {
        int left = 0;
        for (int g = 0; g < groups; ++g) left += __builtin_popcount(lanes::bits(live[g]));
        if (8 * left <= 7 * lanes::WIDTH * groups) close_up(groups);
        return left > 0;
    }

    // Run a part of a round for all paths.
    template<lanes::Mask (Steps::*part)(lanes::Mask)> void run(int groups) {
        _Pragma("clang loop unroll(disable)") for (int g = 0; g < groups; ++g)
            if (lanes::any(live[g])) leave(g, (path(g).steps.*part)(live[g]));
    }

    // Answer a ray query of all paths: groups of one octant are traced as they are, other rays sorted by octant.
    template<class RayQuery> void trace(int groups) {
        typedef typename RayQuery::Ray Ray;
        typedef typename RayQuery::Answer Answer;
        typedef typename RayQuery::Traced Traced;
        typedef lanes::ints anywhere __attribute__((aligned(4)));
        constexpr int RAY_ROWS = sizeof(Ray) / sizeof(lanes::ints), ANSWER_ROWS = sizeof(Answer) / sizeof(lanes::ints);
        static_assert(sizeof(Ray) + sizeof(Answer) == sizeof(lanes::ints) * (RAY_ROWS + ANSWER_ROWS), "other sizes");
        constexpr int ROOM = lanes::WIDTH * (GROUPS + 2 * 8);
        struct Batch {
            int group, first;  // the rays' group, or their place among the sorted rays
            lanes::Mask exec;
            lanes::Floats reach;
        };
        struct Mixed {
            int group;
            unsigned lanes[8];  // bits, by octant
        };
        alignas(64) char traced_memory[sizeof(Traced) * (GROUPS + 8)];
        Traced* const traced = (Traced*)traced_memory;
        Batch batches[GROUPS + 8];
        Mixed mixed[GROUPS];
        alignas(64) int sorted[RAY_ROWS + 1][ROOM], answers[ANSWER_ROWS][ROOM];
        int counts[8] = {}, count = 0, mixed_count = 0;
        const Steps& steps = path(0).steps;
        _Pragma("clang loop unroll(disable)") for (int g = 0; g < groups; ++g) {
            if (!lanes::any(live[g])) continue;
            const Ray& ray = RayQuery::ray(path(g).steps);
            const lanes::Floats reach = RayQuery::reach(path(g).steps);
            const lanes::Mask exec = live[g] & path(g).steps.waiting & lanes::Mask(reach.v >= 0.0f);
            const unsigned runs = lanes::bits(exec);
            if (runs == 0) continue;
            lanes::ints octants = 0;
            for (int k = 0; k < 3; ++k) octants += (ray.direction.c[k].v < 0.0f) & (1 << k);
            if (!(runs & ~lanes::bits(lanes::Mask(octants == octants[__builtin_ctz(runs)])))) {
                batches[count].group = g;
                batches[count].exec = exec;
                batches[count].reach = reach;
                RayQuery::set_out(steps, traced[count++], ray, reach, exec);
                continue;
            }
            mixed[mixed_count].group = g;
            for (int k = 0; k < 8; ++k) {
                const unsigned some = lanes::bits(lanes::Mask(octants == k)) & runs;
                mixed[mixed_count].lanes[k] = some;
                counts[k] += __builtin_popcount(some);
            }
            ++mixed_count;
        }
        // Sort the rays. Each octant is followed by room for lanes that are written but not in use.
        int starts[8], ends[8];
        for (int k = 0, end = 0; k < 8; ++k) {
            starts[k] = ends[k] = end;
            end += (counts[k] + 2 * lanes::WIDTH - 1) / lanes::WIDTH * lanes::WIDTH;
        }
        _Pragma("clang loop unroll(disable)") for (int i = 0; i < mixed_count; ++i) {
            const Steps& asking = path(mixed[i].group).steps;
            const lanes::ints* const rows = (const lanes::ints*)&RayQuery::ray(asking);
            const lanes::ints reach = __builtin_bit_cast(lanes::ints, RayQuery::reach(asking).v);
            _Pragma("clang loop unroll(disable)") for (int k = 0; k < 8; ++k) {
                const unsigned some = mixed[i].lanes[k];
                for (int row = 0; row <= RAY_ROWS; ++row)
                    *(anywhere*)(sorted[row] + ends[k]) = lanes::packed(row < RAY_ROWS ? rows[row] : reach, some);
                ends[k] += __builtin_popcount(some);
            }
        }
        const auto sorted_ray = [&](const int first) __attribute__((always_inline)) {
            alignas(64) Ray ray;
            for (int row = 0; row < RAY_ROWS; ++row)
                ((lanes::ints*)&ray)[row] = *(const lanes::ints*)(sorted[row] + first);
            return ray;
        };
        for (int k = 0; k < 8; ++k) {
            for (int first = starts[k]; first < ends[k]; first += lanes::WIDTH) {
                const Ray ray = sorted_ray(first);
                Batch& batch = batches[count];
                batch.group = -1;
                batch.first = first;
                const int left = ends[k] - first;
                batch.exec = lanes::of_bits(left < lanes::WIDTH ? (1u << left) - 1 : lanes::ALL);
                batch.reach.v = *(const lanes::floats*)(sorted[RAY_ROWS] + first);
                RayQuery::set_out(steps, traced[count++], ray, batch.reach, batch.exec);
            }
        }
        RayQuery::follow(steps, traced, count);
        for (int i = 0; i < count; ++i) {
            const Batch& batch = batches[i];
            const auto ray_of = [&]() __attribute__((always_inline)) {
                return batch.group >= 0 ? RayQuery::ray(path(batch.group).steps) : sorted_ray(batch.first);
            };
            const Answer answer = RayQuery::found(steps, traced[i], ray_of, batch.reach, batch.exec);
            if (batch.group >= 0) {
                RayQuery::answer(path(batch.group).steps) = answer;
                continue;
            }
            for (int row = 0; row < ANSWER_ROWS; ++row)
                *(lanes::ints*)(answers[row] + batch.first) = ((const lanes::ints*)&answer)[row];
        }
        for (int i = 0; i < mixed_count; ++i) {
            lanes::ints* const rows = (lanes::ints*)&RayQuery::answer(path(mixed[i].group).steps);
            for (int k = 0; k < 8; ++k) {
                const unsigned some = mixed[i].lanes[k];
                for (int row = 0; row < ANSWER_ROWS; ++row)
                    rows[row] = lanes::spread(*(const anywhere*)(answers[row] + starts[k]), rows[row], some);
                starts[k] += __builtin_popcount(some);
            }
        }
        for (int g = 0; g < groups; ++g) RayQuery::prepare(path(g).steps, live[g]);
    }

    void leave(const int g, const lanes::Mask going) {
        const lanes::Mask done = live[g] & ~going;
        live[g] = going;
        if (lanes::any(done)) arrive(path(g), done);
    }

    void arrive(Path& path, lanes::Mask done) {
        const Result result = path.steps.end(done);
        alignas(64) int homes[lanes::WIDTH];
        *(lanes::ints*)homes = path.home.v;
        LANES_EACH(l, done) copy_lane(results[homes[l] / lanes::WIDTH], homes[l] % lanes::WIDTH, result, l);
    }

    // Compact the paths that are left into as few groups as hold them. Each group makes room for the next; or the last
    // groups fill up the first ones: neighbours part, but far fewer paths move, which pays where a move takes many
    // instructions.
    void close_up(int& groups) {
        int to = 0;
#if LANES_WIDTH == 16
        for (int g = 0; g < groups; ++g)
#else
        for (int g = groups - 1; g > to; --g)
#endif
        {
            while (lanes::any(live[g]) && to < g) {
                const unsigned from = lanes::bits(live[g]), room = ~lanes::bits(live[to]) & lanes::ALL;
                if (room == 0) {
                    ++to;
                    continue;
                }
                const unsigned leave = lanes::first_of(from, __builtin_popcount(room));
                const unsigned enter = lanes::first_of(room, __builtin_popcount(from));
                move(path(to), path(g), lanes::Move{(unsigned short)leave, (unsigned short)enter});
                live[g] = lanes::of_bits(from & ~leave);
                live[to] = live[to] | lanes::of_bits(enter);
            }
        }
        while (groups > 0 && !lanes::any(live[groups - 1])) --groups;
    }
};

// One coordinate of place n in a square of four by four, in Morton order: four consecutive places are a square, too.
LANES_INLINE lanes::ints across(const lanes::ints n) { return (n & 1) | (n >> 1 & 2); }

// Neighbouring pixels, some perhaps outside the picture: two rows of two, or of four, or four rows of four.
struct Block {
    lanes::Ints threads;
    lanes::Mask inside;
    Block(const int tile, const int place, const int width, const int height) {
        const int first = lanes::WIDTH * place;
        const lanes::ints here = (lanes::ints)0 + (first >> 4), numbers = lanes::lane_numbers().v + (first & 15);
        const int tiles = (width + TILE - 1) / TILE;
        const lanes::ints x = TILE * (tile % tiles) + 4 * across(here) + across(numbers);
        const lanes::ints y = TILE * (tile / tiles) + 4 * across(here >> 1) + across(numbers >> 1);
        threads = lanes::Ints(y * width + x);
        inside = lanes::Mask((x < width) & (y < height));
    }
};
} // namespace

// Begin a block `among` times, to take that many samples of each pixel at a time.
LANES_CALLED void add(Pool& pool, const Block& block, const int among, ARGUMENTS_IN) {
    for (int n = 0; n < among; ++n) {
        const int g = pool.count++;
        new (Here(), &pool.pixels(g)) Pixels(ARGUMENTS);
        pool.pixels(g).begin(block.threads, block.inside);
        pool.pixels(g).share(n, among);
        new (Here(), &pool.path(g)) Path(FIXED);
    }
}

// Render a square of TILE x TILE pixels, `among` samples of a pixel at a time.
static void render_samples(
    Pool& pool, const int tile, const int width, const int height, const int among, ARGUMENTS_IN
) {
    for (int place = 0; place < BLOCKS;) {
        pool.count = 0;
        for (; place < BLOCKS && pool.count + among <= GROUPS; ++place) {
            const Block block(tile, place, width, height);
            if (lanes::any(block.inside)) add(pool, block, among, ARGUMENTS);
        }
        while (pool.start()) {
            pool.begin_paths(among);
            pool.follow();
            pool.finish(among);
        }
        for (int g = among - 1; g < pool.count; g += among) pool.pixels(g).after();
    }
}

// Take a power of two of samples at a time that keeps nearly all lanes in use.
static void render_tile(const int tile, const int width, const int height, ARGUMENTS_IN) {
    Pool pool;
    int left = 0;
    for (int place = 0; place < BLOCKS; ++place) {
        const Block block(tile, place, width, height);
        if (!lanes::any(block.inside)) continue;
        pool.count = 0;
        add(pool, block, 1, ARGUMENTS);
        const lanes::Ints more = pool.pixels(0).left();
        LANES_EACH(l, block.inside) if (more.v[l] > left) left = more.v[l];
    }
    int among = lanes::WIDTH;
    while (left > 0) {
        if (4 * left <= 3 * among) {
            among /= 2;
            continue;
        }
        left = left > among ? left % among : 0;
        const auto all = TARGET_in;
        const decltype(all) TARGET_in = all - left;
        render_samples(pool, tile, width, height, among, ARGUMENTS);
    }
}
