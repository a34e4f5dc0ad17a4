// Eq. 3 at a pixel: the density of its noise, the log-likelihood of a covered pixel, the posterior of being visible.
// A density is p(error) = exp(log_density(s)) / normaliser with s = |error|^2 / (2 sigma^2) over the three channels of
// linear RGB; pull(s) = - d log_density / d s, 1 for a Gaussian, less for one that forgives large errors: it weighs a pixel in the
// gradient and in the Gauss-Newton matrix. LOG_UNIT is the log of the normaliser for sigma = 1; for another sigma 3 log sigma is
// added. Each is a header of its own in densities/.
#pragma once
#include <limits>

#include "density_list.h"
#include "vectors.h"

namespace vig {

// Call `use` with the density of a number, in the order of the module's DENSITIES.
template <class F> void with_density(int number, F&& use) {
    int next = 0;
#define VIG_USE(NAME)          \
    if (number == next++) {    \
        use(density::NAME{});  \
        return;                \
    }
    VIG_DENSITIES(VIG_USE)
#undef VIG_USE
}

// The noise of a visible pixel: one over twice its variance, and its log normaliser.
template <class R> struct Noise {
    R half_precision, log_normaliser;
    Noise(double sigma, double log_unit)
        : half_precision(R(0.5 / (sigma * sigma))), log_normaliser(R(-3 * std::log(sigma) - log_unit)) {}
};

// Log-likelihood of a covered pixel, and its posterior of being visible.
template <class R> struct Explained {
    R log_likelihood, visible;
};

// log_prior: log probabilities of visible, and of hidden and of background with their colours' densities.
template <class D, class R>
Explained<R> explain_pixel(Vec3<R> observed, Vec3<R> rendered, Vec3<R> log_prior, const Noise<R>& noise) {
    // Beyond it the less likely of the two components is lost in rounding.
    const R clear = -std::log(std::numeric_limits<R>::epsilon());
    const Vec3<R> error = observed - rendered;
    const R inlier = log_prior.x + noise.log_normaliser + D::log_density(dot(error, error) * noise.half_precision);
    const R gap = inlier - log_prior.y;  // log odds of visible against hidden
    if (gap > clear)
        return {inlier, 1};
    if (gap < -clear)
        return {log_prior.y, 0};
    // log(exp(a) + exp(b)) = max + log(1 + exp(-|a - b|)), so that nothing overflows.
    const R ratio = std::exp(-std::abs(gap)), share = 1 / (1 + ratio);
    return {(gap < 0 ? log_prior.y : inlier) + std::log(1 + ratio), gap < 0 ? ratio * share : share};
}

}  // namespace vig
