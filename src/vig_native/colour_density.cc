#include <algorithm>
#include <vector>

#include "images.h"

namespace vig {

void colour_density(int pixels, const double* colours, const double* shares, double* density) {
    constexpr int CELLS = 24;  // along each channel: about the robust model's noise, 0.03, each
    constexpr int steps[3] = {CELLS * CELLS, CELLS, 1}, nodes = CELLS * CELLS * CELLS;
    std::vector<double> cube(nodes), other(nodes);
    const auto each_edge = [&](int p, auto&& visit) {
        int base = 0;
        double part[3];
        for (int channel = 0; channel < 3; ++channel) {
            const double colour = colours[3 * (size_t)p + channel];
            const double at = (colour > 0 ? colour < 1 ? colour : 1 : 0) * (CELLS - 1);  // NaN is 0
            const int low = std::min((int)at, CELLS - 2);
            part[channel] = at - low;
            base += low * steps[channel];
        }
        const double r = part[0], g = part[1];
        const double weights[4] = {(1 - r) * (1 - g), (1 - r) * g, r * (1 - g), r * g};
        for (int edge = 0; edge < 4; ++edge)
            visit(&cube[base + (edge >> 1) * steps[0] + (edge & 1) * steps[1]], weights[edge], part[2]);
    };
    for (int p = 0; p < pixels; ++p)
        each_edge(p, [&](double* node, double weight, double b) {
            node[0] += shares[p] * weight * (1 - b);
            node[1] += shares[p] * weight * b;
        });
    // Along each channel: mass over the length that a node stands for, half as long at an end; then (1, 2, 1) / 4.
    for (const int step : steps) {
        constexpr int last = CELLS - 1;
        for (int line = 0; line < CELLS * CELLS; ++line) {
            const int start = line / step * step * CELLS + line % step;
            double *const first = &cube[start], *const smoothed = &other[start];
            first[0] *= 2;
            first[last * step] *= 2;
            double below = first[step];
            for (int at = 0; at < CELLS; ++at) {
                const double here = first[at * step], above = first[(at < last ? at + 1 : last - 1) * step];
                smoothed[at * step] = last * (0.5 * here + 0.25 * (below + above));
                below = here;
            }
        }
        std::swap(cube, other);
    }
    for (int p = 0; p < pixels; ++p) {
        double sum = 0;
        each_edge(p, [&](double* node, double weight, double b) { sum += weight * (node[0] * (1 - b) + node[1] * b); });
        density[p] = sum;
    }
}

}  // namespace vig
