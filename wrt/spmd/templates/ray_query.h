// The ray query ${FUNCTION}.
struct ${NAME} : lanes::${KIND} {
    typedef ${STEPS} Steps;
    typedef ${RAY_TYPE} Ray;
    typedef ${ANSWER_TYPE} Answer;
    static const auto& scene(const Steps& steps) { return steps.${SCENE}; }
    static const Ray& ray(const Steps& steps) { return steps.${RAY}; }
    static lanes::Floats reach(const Steps& steps) { return ${REACH}; }
    static Answer& answer(Steps& steps) { return steps.${ANSWER}; }
    ${MEMBER}
};
