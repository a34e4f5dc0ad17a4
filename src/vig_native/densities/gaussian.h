// The paper's density: a Gaussian of three channels with one standard deviation.
#pragma once

namespace vig::density {

struct gaussian {
    static constexpr double LOG_UNIT = 2.756815599614018;  // 3 log sqrt(2 pi)
    template <class R> static R log_density(R s) { return -s; }
    template <class R> static R pull(R) { return 1; }
};

}  // namespace vig::density
