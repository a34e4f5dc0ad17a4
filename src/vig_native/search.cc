#include "search.h"

#include <algorithm>
#include <cmath>

namespace vig {

template <class R> double Prior<R>::add_to(const R* x, R* gradient, R* normal) const {
    const int n = size;
    R total = 0;
    for (int i = 0; i < n; ++i) {
        R force = 0;
        for (int j = 0; j < n; ++j)
            force += precision[(size_t)i * n + j] * (mean[j] - x[j]);
        total += force * (mean[i] - x[i]);
        if (gradient)
            gradient[i] += force;
    }
    for (size_t i = 0; normal && i < (size_t)n * n; ++i)
        normal[i] += precision[i];
    if (!heading_mean.empty()) {
        // The light's Gaussian bends with azimuth: `rate` is the change with it of light turned by minus the azimuth.
        const double angle = x[azimuth];
        const R c1 = R(std::cos(angle)), s1 = -R(std::sin(angle)), c2 = R(std::cos(2 * angle)), s2 = -R(std::sin(2 * angle));
        // Line m of the turn: it keeps c of m and takes s of its partner.
        const int partner[LOBES] = {0, 3, 2, 1, 8, 7, 6, 5, 4};
        const R keep[LOBES] = {1, c1, 1, c1, c2, c1, 1, c1, c2};
        const R take[LOBES] = {0, s1, 0, -s1, s2, s1, 0, -s1, -s2};
        const R order[LOBES] = {0, -1, 0, 1, -2, -1, 0, 1, 2};
        R turned[LOBES];
        for (int m = 0; m < LOBES; ++m)
            turned[m] = keep[m] * x[light + m] + take[m] * x[light + partner[m]];
        for (int m = 0; m < LOBES; ++m) {
            const R rate = order[m] * turned[partner[m]], force = heading_precision[m] * (heading_mean[m] - turned[m]);
            total += force * (heading_mean[m] - turned[m]);
            const int at[3] = {azimuth, light + m, light + partner[m]};
            const R gain[3] = {rate, keep[m], take[m]};
            for (int i = 0; i < 3; ++i) {
                if (gradient)
                    gradient[at[i]] += gain[i] * force;
                for (int j = 0; normal && j < 3; ++j)
                    normal[(size_t)at[i] * n + at[j]] += gain[i] * heading_precision[m] * gain[j];
            }
        }
    }
    if (!azimuths.empty()) {
        const R around = R(6.283185307179586);
        R nearest = around;
        for (const R peak : azimuths) {
            const R off = fold * (peak - x[azimuth]);
            const R turn = (off - around * std::floor(off / around + R(0.5))) / (fold > 0 ? fold : R(1));
            if (std::abs(turn) < std::abs(nearest))
                nearest = turn;
        }
        total += azimuth_precision * nearest * nearest;
        if (gradient)
            gradient[azimuth] += azimuth_precision * nearest;
        if (normal)
            normal[(size_t)azimuth * n + azimuth] += azimuth_precision;
    }
    return -0.5 * double(total);
}

namespace {

// The damped Gauss-Newton step (n,) within bounds, and the gain that the quadratic model promises. Numbers that would
// pass a bound are held on it and the others solved again. damping: the multiple of the normal matrix's diagonal that is
// added to it. Where the matrix is not positive a short scaled gradient step stands in.
template <class R>
double damped_step(int n, const R* x, const R* slope, const R* curved, R damping, const R* low, const R* high, R* step) {
    constexpr int ROUNDS = 3;  // how often a step is solved, numbers at a bound held
    std::vector<R> factor((size_t)n * n), right(n), solved(n);
    std::vector<uint8_t> held(n);
    R most = 0;
    for (int i = 0; i < n; ++i) {
        most = std::max(curved[(size_t)i * n + i], most);
        // A number at a bound whose gradient points outwards is held (active set).
        held[i] = ((x[i] <= low[i]) & (slope[i] <= 0)) | ((x[i] >= high[i]) & (slope[i] >= 0)) | (low[i] == high[i]);
        step[i] = 0;
    }
    const R floor = R(1e-6) * most;
    for (int round = 0; round < ROUNDS; ++round) {
        for (int i = 0; i < n; ++i) {
            right[i] = held[i] ? 0 : slope[i];
            for (int j = 0; j < n; ++j) {
                // The effect of held numbers is known: it goes to the right side.
                if (held[j] & !held[i])
                    right[i] -= curved[(size_t)i * n + j] * step[j];
                factor[(size_t)i * n + j] = held[i] | held[j] ? 0 : curved[(size_t)i * n + j];
            }
            const R own = curved[(size_t)i * n + i];
            // Marquardt 1963: damping in proportion to the diagonal, so that units do not matter; a floor for flat ones.
            factor[(size_t)i * n + i] = held[i] ? 1 : own + damping * (own + floor) + R(1e-9) * floor;
        }
        bool positive = true;
        for (int k = 0; k < n; ++k) {
            R* const line = &factor[(size_t)k * n];
            // Cholesky factorisation, with forward substitution in the same pass.
            positive &= line[k] > 0;
            const R root = std::sqrt(positive ? line[k] : R(1)), inverse = 1 / root;
            line[k] = root;
            for (int j = k + 1; j < n; ++j)
                line[j] *= inverse;
            right[k] *= inverse;
            for (int i = k + 1; i < n; ++i) {
                const R share = line[i];
                R* const below = &factor[(size_t)i * n];
                for (int j = i; j < n; ++j)
                    below[j] -= share * line[j];
                right[i] -= share * right[k];
            }
        }
        for (int i = n - 1; i >= 0; --i) {
            R left = right[i];
            for (int j = i + 1; j < n; ++j)
                left -= factor[(size_t)i * n + j] * solved[j];
            solved[i] = left / factor[(size_t)i * n + i];
        }
        bool over = false;
        for (int i = 0; i < n; ++i) {
            if (held[i])
                continue;
            const bool usable = positive && std::isfinite(solved[i]);
            const R whole = usable ? solved[i] : slope[i] / (curved[(size_t)i * n + i] + floor) * R(0.1);
            const R reached = x[i] + whole;
            step[i] = (reached < low[i] ? low[i] : reached > high[i] ? high[i] : reached) - x[i];
            const bool beyond = (reached < low[i]) | (reached > high[i]);
            held[i] |= beyond;
            over |= beyond;
        }
        if (!over)
            break;
    }
    // The quadratic model's gain: g . s - s . N s / 2.
    double gain = 0;
    for (int i = 0; i < n; ++i) {
        R bent = slope[i];
        for (int j = 0; j < n; ++j)
            bent -= R(0.5) * curved[(size_t)i * n + j] * step[j];
        gain += double(bent * step[i]);
    }
    return gain;
}

}  // namespace

template <class R>
SearchEnd search(int n, const Function<R>& function, const R* start, const R* lower, const R* upper,
                 const SearchSettings& settings, R* path, size_t path_stride, R* normal) {
    std::vector<R> point(start, start + n), trial(n), step(n), gradient(n), tried_gradient(n), curved((size_t)n * n),
        tried_curved((size_t)n * n);
    const auto finite = [n](const std::vector<R>& numbers) {
        return std::all_of(numbers.begin(), numbers.begin() + n, [](R number) { return std::isfinite(number); });
    };
    std::copy(start, start + n, path);
    if (!settings.iterations)
        return {function(start, nullptr, nullptr, nullptr), 1, false};
    SearchEnd end = {function(start, gradient.data(), curved.data(), [](double) { return true; }), 1, false};
    R damping = R(settings.damping), growth = 3;
    bool active = std::isfinite(end.value) && finite(gradient);
    for (int t = 1; t <= settings.iterations; ++t) {
        if (active && !end.converged) {
            const double promised =
                damped_step(n, point.data(), gradient.data(), curved.data(), damping, lower, upper, step.data());
            for (int i = 0; i < n; ++i)
                trial[i] = point[i] + step[i];
            if ((active = finite(trial))) {
                // Derivatives are for the next step, of which there is none after the last, and for the matrix.
                const bool last = t == settings.iterations || promised < 0.1 * settings.tolerance;
                bool derived = false;
                const double value = function(trial.data(), tried_gradient.data(), tried_curved.data(), [&](double tried) {
                    const double gained = tried - end.value;
                    return derived = gained > 0 && (normal || !(last || gained < settings.tolerance));
                });
                const double gain = value - end.value;
                const bool better = gain > 0 && (!derived || finite(tried_gradient));
                ++end.evaluations;
                if (better) {
                    end.value = value;
                    point = trial;
                    gradient = tried_gradient;
                    curved = tried_curved;
                }
                // Damping shrinks smoothly with the ratio of gain to promise, and grows ever faster while steps fail.
                // off: how far the quadratic model held, 1 where the objective is quadratic.
                const R off = 2 * R(gain / std::max(promised, 1e-9)) - 1, shrink = 1 - off * off * off;
                damping *= better ? (shrink < R(1.0 / 3) ? R(1.0 / 3) : shrink > 2 ? R(2) : shrink) : growth;
                damping = damping > R(1e-7) ? damping : R(1e-7);
                growth = better ? 3 : 2 * growth;
                // A step that promises almost nothing need not be tried.
                end.converged = (better && gain < settings.tolerance) || damping > R(settings.give_up)
                    || promised < 0.1 * settings.tolerance;
            }
        }
        std::copy(point.begin(), point.end(), path + t * path_stride);
    }
    end.converged &= active;
    if (normal)
        std::copy(curved.begin(), curved.end(), normal);
    return end;
}

template struct Prior<VIG_REAL>;
template SearchEnd search(int, const Function<VIG_REAL>&, const VIG_REAL*, const VIG_REAL*, const VIG_REAL*, const SearchSettings&,
                          VIG_REAL*, size_t, VIG_REAL*);

}  // namespace vig
