"""A thousand paths at a time: in which order they are begun, traced, moved together and ended.

A pool holds up to 64 groups of sixteen paths. Where a pass takes sixteen samples of a pixel or more, they are those of
four squares of four by four pixels, and a group begins with sixteen samples of one pixel: their rays stay side by side
for longer, and all that the pool reads lies near together. Of eight samples a group begins with two pixels, and so on,
up to one sample of a square of sixteen by sixteen pixels, which are sixteen groups.

Each round traces the rays of all paths. A group whose rays are of one octant goes down the tree as it is, the others'
rays are sorted by octant first, as the boxes of the tree are tested in less instructions for rays of one (Wald 2001,
"Interactive rendering with coherent ray tracing"). Once paths that met nothing have ended, and after each round, the
others close up if less than seven eighths of the lanes are in use. Which paths go together changes no bit of the film.
"""

from wrt.kernels.wide.render import TILE

# C++: `Pixels`, `Path`, `Given`, `Result` and what is traced are those of `kernels/wide/paths.py`.
DRIVER = """
struct Here {};
inline void* operator new(decltype(sizeof(0)), Here, void* p) { return p; }

namespace {
constexpr int BLOCKS = TILE * TILE / lanes::WIDTH;  // of four by four pixels in a square
// Measured: what they all hold, 13 KB a group in simple scenes, fits into the second cache.
constexpr int GROUPS = 64;

// One lane of what is of numbers of four bytes alone.
template<class T> LANES_INLINE void copy_lane(T& to, int lane, const T& from, int lane_from) {
    static_assert(sizeof(T) % (4 * lanes::WIDTH) == 0, "numbers of other sizes");
    _Pragma("clang loop unroll(full)") for (unsigned row = 0; row < sizeof(T) / (4 * lanes::WIDTH); ++row)
        ((int*)&to)[lanes::WIDTH * row + lane] = ((const int*)&from)[lanes::WIDTH * row + lane_from];
}

// Groups of paths, and what becomes of them.
struct Pool {
    alignas(64) char pixel_memory[sizeof(Pixels) * GROUPS], path_memory[sizeof(Path) * GROUPS];
    alignas(64) Result results[GROUPS];
    lanes::Mask live[GROUPS];
    int count;
    static constexpr int GIVEN_ROWS = sizeof(Given) / (4 * lanes::WIDTH);
    static_assert(sizeof(Given) % (4 * lanes::WIDTH) == 0, "what is given is not of numbers of four bytes alone");
    Pixels& pixels(int g) { return ((Pixels*)pixel_memory)[g]; }
    Path& path(int g) { return ((Path*)path_memory)[g]; }

    // Begin a path of each sample that has begun: those of one pixel, or of a few that are neighbours, in one group.
    void begin_paths(const int among) {
        const int neighbours = lanes::WIDTH / among;
        const lanes::i16 numbers = lanes::lane_numbers().v;
        alignas(64) Given given[4];
        for (int first = 0; first < count; first += among) {
            unsigned all = ~0u;  // bits of the block's pixels of which each sample has begun
            for (int n = 0; n < among; ++n) all &= lanes::bits(pixels(first + n).begun_);
            for (int g = first; g < first + among; ++g) {
                const int pixel = (g - first) * neighbours;  // the group's first one
                if (among < lanes::WIDTH)
                    collect(given[g % 4], first, among, pixel);
                else if (g % 4 == 0)
                    collect_four(given, first, pixel);
                unsigned lives = all;
                if (all != 0xffff) {
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

    // What samples of a few neighbours are given.
    void collect(Given& given, const int first, const int among, const int pixel) {
        typedef lanes::i16 anywhere __attribute__((aligned(4)));
        for (int n = 0; n < among; ++n) {
            const unsigned own = lanes::bits(lanes::Mask((lanes::lane_numbers().v & (among - 1)) == n));
            const int* const from = (const int*)&pixels(first + n).given_ + pixel;
            _Pragma("clang loop unroll(disable)") for (int row = 0; row < GIVEN_ROWS; ++row) {
                lanes::i16& to = ((lanes::i16*)&given)[row];
                to = lanes::spread(*(const anywhere*)(from + lanes::WIDTH * row), to, own);
            }
        }
    }

    // What sixteen samples of each of four pixels are given.
    void collect_four(Given* given, const int first, const int pixel) {
        _Pragma("clang loop unroll(disable)") for (int row = 0; row < GIVEN_ROWS; ++row) {
            const lanes::FourRows rows = lanes::transposed([&](int l) __attribute__((always_inline)) {
                const float* const from = (const float*)&pixels(first + l).given_ + lanes::WIDTH * row;
                return (lanes::f4) * (const lanes::f4_anywhere*)(from + pixel);
            });
            for (int k = 0; k < 4; ++k) ((lanes::f16*)&given[k])[row] = rows.r[k];
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

    // Add what paths have found to their pixels, in the order of samples.
    void finish(const int among) {
        for (int g = 0; g < count; ++g) {
            pixels(g).carry(pixels(g % among == 0 ? g + among - 1 : g - 1));
            pixels(g).finish(results[g]);
        }
    }

    // Follow all paths to their ends.
    void follow() {
        int groups = count;  // of which paths may go on
        while (close_up_where_sparse(groups)) {
ROUND
        }
    }

    // Return whether any path goes on.
    bool close_up_where_sparse(int& groups) {
        int left = 0;
        for (int g = 0; g < groups; ++g) left += __builtin_popcount(lanes::bits(live[g]));
        if (8 * left <= 7 * lanes::WIDTH * groups) close_up(groups);
        return left > 0;
    }

    // A part of a round, of all paths.
    template<lanes::Mask (Steps::*part)(lanes::Mask)> void run(int groups) {
        _Pragma("clang loop unroll(disable)") for (int g = 0; g < groups; ++g)
            if (lanes::any(live[g])) leave(g, (path(g).steps.*part)(live[g]));
    }

    // Answer a question of all paths: rays of groups of one octant go as they are, others with such of their octant.
    template<class Question> void trace(int groups) {
        typedef typename Question::Ray Ray;
        typedef typename Question::Answer Answer;
        typedef typename Question::Traced Traced;
        typedef lanes::i16 anywhere __attribute__((aligned(4)));
        constexpr int RAY_ROWS = sizeof(Ray) / sizeof(lanes::i16), ANSWER_ROWS = sizeof(Answer) / sizeof(lanes::i16);
        static_assert(sizeof(Ray) + sizeof(Answer) == sizeof(lanes::i16) * (RAY_ROWS + ANSWER_ROWS), "other sizes");
        constexpr int ROOM = lanes::WIDTH * (GROUPS + 2 * 8);
        struct Batch {
            int group, first;  // the group that the rays are of, or where they are among those that are sorted
            lanes::Mask exec;
            lanes::Floats reach;
        };
        struct Mixed {
            int group;
            unsigned lanes[8];  // by octant, bits
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
            const Ray& ray = Question::ray(path(g).steps);
            const lanes::Floats reach = Question::reach(path(g).steps);
            const lanes::Mask exec = live[g] & path(g).steps.waiting & lanes::Mask(reach.v >= 0.0f);
            const unsigned runs = lanes::bits(exec);
            if (runs == 0) continue;
            lanes::i16 octants = 0;
            for (int k = 0; k < 3; ++k) octants += (ray.direction.c[k].v < 0.0f) & (1 << k);
            if (!(runs & ~lanes::bits(lanes::Mask(octants == octants[__builtin_ctz(runs)])))) {
                batches[count].group = g;
                batches[count].exec = exec;
                batches[count].reach = reach;
                Question::set_out(steps, traced[count++], ray, reach, exec);
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
        // Sort them. After each octant is room for what is written of lanes that are not in use.
        int starts[8], ends[8];
        for (int k = 0, end = 0; k < 8; ++k) {
            starts[k] = ends[k] = end;
            end += (counts[k] + 2 * lanes::WIDTH - 1) / lanes::WIDTH * lanes::WIDTH;
        }
        _Pragma("clang loop unroll(disable)") for (int i = 0; i < mixed_count; ++i) {
            const Steps& asking = path(mixed[i].group).steps;
            const lanes::i16* const rows = (const lanes::i16*)&Question::ray(asking);
            const lanes::i16 reach = __builtin_bit_cast(lanes::i16, Question::reach(asking).v);
            _Pragma("clang loop unroll(disable)") for (int k = 0; k < 8; ++k) {
                const unsigned some = mixed[i].lanes[k];
                for (int row = 0; row <= RAY_ROWS; ++row)
                    *(anywhere*)(sorted[row] + ends[k]) = lanes::packed(row < RAY_ROWS ? rows[row] : reach, some);
                ends[k] += __builtin_popcount(some);
            }
        }
        for (int k = 0; k < 8; ++k) {
            for (int first = starts[k]; first < ends[k]; first += lanes::WIDTH) {
                alignas(64) Ray ray;
                for (int row = 0; row < RAY_ROWS; ++row)
                    ((lanes::i16*)&ray)[row] = *(const lanes::i16*)(sorted[row] + first);
                Batch& batch = batches[count];
                batch.group = -1;
                batch.first = first;
                const int left = ends[k] - first;
                batch.exec = lanes::of_bits(left < lanes::WIDTH ? (1u << left) - 1 : 0xffff);
                batch.reach.v = *(const lanes::f16*)(sorted[RAY_ROWS] + first);
                Question::set_out(steps, traced[count++], ray, batch.reach, batch.exec);
            }
        }
        Question::follow(steps, traced, count);
        for (int i = 0; i < count; ++i) {
            const Batch& batch = batches[i];
            const Answer answer = Question::found(steps, traced[i], batch.reach, batch.exec);
            if (batch.group >= 0) {
                Question::answer(path(batch.group).steps) = answer;
                continue;
            }
            for (int row = 0; row < ANSWER_ROWS; ++row)
                *(lanes::i16*)(answers[row] + batch.first) = ((const lanes::i16*)&answer)[row];
        }
        for (int i = 0; i < mixed_count; ++i) {
            lanes::i16* const rows = (lanes::i16*)&Question::answer(path(mixed[i].group).steps);
            for (int k = 0; k < 8; ++k) {
                const unsigned some = mixed[i].lanes[k];
                for (int row = 0; row < ANSWER_ROWS; ++row)
                    rows[row] = lanes::spread(*(const anywhere*)(answers[row] + starts[k]), rows[row], some);
                starts[k] += __builtin_popcount(some);
            }
        }
        for (int g = 0; g < groups; ++g) Question::prepare(path(g).steps, live[g]);
    }

    void leave(const int g, const lanes::Mask going) {
        const lanes::Mask done = live[g] & ~going;
        live[g] = going;
        if (lanes::any(done)) arrive(path(g), done);
    }

    void arrive(Path& path, lanes::Mask done) {
        const Result result = path.steps.end(done);
        alignas(64) int homes[lanes::WIDTH];
        *(lanes::i16*)homes = path.home.v;
        LANES_EACH(l, done) copy_lane(results[homes[l] / lanes::WIDTH], homes[l] % lanes::WIDTH, result, l);
    }

    // Move paths that go on together, into as few groups as hold them.
    void close_up(int& groups) {
        int to = 0;
        for (int g = 0; g < groups; ++g) {
            while (lanes::any(live[g]) && to < g) {
                const unsigned from = lanes::bits(live[g]), room = ~lanes::bits(live[to]) & 0xffff;
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

// One coordinate of place n of a square of four by four, in Morton's order: four places that follow are a square, too.
LANES_INLINE lanes::i16 across(const lanes::i16 n) { return (n & 1) | (n >> 1 & 2); }

// A square of four by four pixels, of which some may be outside the picture.
struct Block {
    lanes::Ints threads;
    lanes::Mask inside;
    Block(const int tile, const int place, const int width, const int height) {
        const lanes::i16 numbers = lanes::lane_numbers().v, here = (lanes::i16)0 + place;
        const int tiles = (width + TILE - 1) / TILE;
        const lanes::i16 x = TILE * (tile % tiles) + 4 * across(here) + across(numbers);
        const lanes::i16 y = TILE * (tile / tiles) + 4 * across(here >> 1) + across(numbers >> 1);
        threads = lanes::Ints(y * width + x);
        inside = lanes::Mask((x < width) & (y < height));
    }
};
} // namespace

// Begin a block `among` times, to take as many samples of each pixel at a time.
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

// As many samples at a time as a power of two, so that nearly all lanes are in use.
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
""".replace("TILE", str(TILE))
