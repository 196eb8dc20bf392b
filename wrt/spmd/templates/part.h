    lanes::Mask part_${NUMBER}(const lanes::Mask live) {
        lanes::Mask exec = ${ENTERING}, returned_ = false;
        lanes::Mask broken_${LOOP} = false, continued_${LOOP} = false;
        if (!lanes::any(exec)) return live;
        ${ANSWER}
${LOCAL}
${SAME}
        do {
${CODE}
        } while (false);
        waiting = exec;
        return live & ~broken_${LOOP};
    }
