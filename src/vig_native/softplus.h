// exp and log of LANES numbers side by side.
#pragma once
#include <cstring>

#include "vectors.h"

namespace vig {

// a polynomial in x by its coefficients, the constant first; fused explicitly, alike on every processor
inline float polynomial(float, float constant) { return constant; }
template <class... C> float polynomial(float x, float constant, C... others) {
    return std::fma(polynomial(x, others...), x, constant);
}

// exp(-t) for 0 <= t <= 80 nats and log(1 + exp(-t)); in single precision by polynomials, whose loops become vector
// instructions and which round alike on every processor.
inline void softplus(const float* t, float* r, float* log_1_r) {
    float power[LANES], fraction[LANES];
    int32_t bits[LANES];
    for (int n = 0; n < LANES; ++n) {
        // exp(-t) = 2^whole 2^f: 2^f by its Taylor series, 2^whole by the exponent's bits.
        const float e = t[n] * -1.44269504088896341f;
        const int whole = (int)(e - 0.5f);
        fraction[n] = (e - (float)whole) * 0.693147180559945309f;
        bits[n] = (whole + 127) << 23;
    }
    std::memcpy(power, bits, sizeof power);
    for (int n = 0; n < LANES; ++n) {
        const float f = fraction[n];
        r[n] = power[n] * polynomial(f, 1.0f, 1.0f, 0.5f, 0.16666667f, 0.04166666f, 0.00833333f, 0.00138889f);
        // log(1 + r) = 2 artanh(r / (2 + r)).
        const float s = r[n] / (2 + r[n]), s2 = s * s;
        log_1_r[n] = 2 * s * polynomial(s2, 1.0f, 0.33333333f, 0.2f, 0.14285714f, 0.11111111f, 0.09090909f, 0.07692308f);
    }
}

inline void softplus(const double* t, double* r, double* log_1_r) {
    for (int n = 0; n < LANES; ++n) {
        r[n] = std::exp(-t[n]);
        log_1_r[n] = std::log(1 + r[n]);
    }
}

}  // namespace vig
