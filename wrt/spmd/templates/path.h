namespace {
// A path: the variables that outlive a part of a round.
struct ${STEPS} {
${SHARED}
${VARYING}
${CONSTANTS}
${KEPT}
    lanes::Mask waiting = false;  // for an answer
${ANSWERS}
    ${STEPS}(${SHARED_IN}) : ${SHARED_GIVEN} {}
    void begin(${VARYING_IN}, const lanes::Mask exec_in) {
        lanes::Mask exec = exec_in, returned_ = false;
        ${VARYING_GIVEN}
${BEGIN}
    }
    // The parts of a round: each returns the lanes that go on.
${PARTS}
    ${RESULT_TYPE} end(const lanes::Mask exec_in) {
        lanes::Mask exec = exec_in, returned_ = false;
${SAME}
${END}
        return ${RESULT};
    }
};
LANES_INLINE void move(${STEPS}& to, const ${STEPS}& from, lanes::Move m) {
    using lanes::move; ${MOVES} }
${QUERIES}
} // namespace
