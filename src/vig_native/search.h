// Levenberg-Marquardt searches within bounds, with damping as by Nielsen (1999).
#pragma once
#include <cstdint>
#include <functional>
#include <vector>

#include "mesh.h"

namespace vig {

// log p(z) of a point up to a constant: a Gaussian, one of the light in the heading frame, which turns along as the
// azimuth changes, and views that an azimuth is drawn to the nearest of. Either of the last two may be empty.
template <class R> struct Prior {
    int size, azimuth, light;
    std::vector<R> mean, precision;                  // (P',), (P', P')
    std::vector<R> heading_mean, heading_precision;  // (LOBES,)
    std::vector<R> azimuths;                         // (J,) radians
    R azimuth_precision, fold;                       // fold: turns by which the object looks the same, 0 for any

    // Add its value and, where they are given, gradient (P',) and negative Hessian (P', P').
    double add_to(const R* point, R* gradient, R* normal) const;
};

// Value of a point (P',), with gradient (P',) and normal matrix (P', P') where these are not null and the value, which
// is asked once, is worth them.
using Worth = std::function<bool(double)>;
template <class R> using Function = std::function<double(const R* point, R* gradient, R* normal, const Worth& worth)>;

struct SearchSettings {
    int iterations;      // without any, starts are only valued
    double tolerance;    // nats: a search has converged when a step that was taken gains less
    double damping;      // the first
    double give_up;      // damping at which a search ends
};

// Where a search ended: points are in `path` (iterations + 1, n), the start and the best after each step.
struct SearchEnd {
    double value;
    int evaluations;
    bool converged;
};

// Maximise a function from a start (n,) within bounds. normal (n, n): the matrix at the end, or null.
template <class R>
SearchEnd search(int n, const Function<R>& function, const R* start, const R* lower, const R* upper,
                 const SearchSettings& settings, R* path, size_t path_stride, R* normal);

}  // namespace vig
