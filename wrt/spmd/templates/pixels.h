typedef ${RESULT_TYPE} Result;
namespace {
typedef ${STEPS} Steps;
// The arguments that each path begins with.
struct Given {
${GIVEN}};
struct Path {
    ${STEPS} steps;
    lanes::Ints home;  // the place where it began
    Path(${SHARED_IN})
        : steps(${SHARED}) {}
};
LANES_INLINE void begin(Path& path, const Given& given, const lanes::Mask exec) {
    path.steps.begin(${GIVEN_VALUES}, exec);
}
LANES_INLINE void move(Path& to, const Path& from, lanes::Move m) {
    move(to.steps, from.steps, m);
    lanes::move(to.home, from.home, m);
}
// A pixel for each lane, each with its current sample.
struct ${PIXELS} {
${MEMBERS}
    Given given_;
    lanes::Mask owned_, sampled_, begun_;
    lanes::Ints thread_;
    ${PIXELS}(${ARGUMENTS_IN}) : ${ARGUMENTS_GIVEN} {}
    void begin(const lanes::Ints& threads, const lanes::Mask exec_in) {
        lanes::Mask exec = exec_in;
        ${MASKS}
        owned_ = exec;
        thread_ = threads;
${BEFORE}
    }
    lanes::Ints left() const { return lanes::sub(${SAMPLES}.end, ${SAMPLES}.i); }
    // Skip the samples of other shares: this is number `n` of `among`.
    void share(int n, int among) {
        ${SAMPLES}.i = lanes::add(${SAMPLES}.i, lanes::mul(${SAMPLES}.step, lanes::Ints(n)));
        ${SAMPLES}.step = lanes::mul(${SAMPLES}.step, lanes::Ints(among));
    }
    // Take over the sums of the previous sample.
    void carry(const ${PIXELS}& from) {
${CARRIED}    }
    // Begin the next sample of each pixel that has more: set `given_`, and the mask of paths that begin.
    void start() {
        lanes::Mask exec = owned_ & lanes::more(${SAMPLES});
        ${MASKS}
        sampled_ = exec;
        begun_ = false;
        if (lanes::any(exec)) {
${START}
        }
    }
    void finish(const Result& result_) {
        lanes::Mask exec = sampled_;
        ${MASKS}
        if (!lanes::any(exec)) return;
        lanes::set(${RESULT}, result_, begun_);
${FINISH}
    }
    void after() {
        lanes::Mask exec = owned_;
        ${MASKS}
${AFTER}
    }
};
typedef ${PIXELS} Pixels;
} // namespace
