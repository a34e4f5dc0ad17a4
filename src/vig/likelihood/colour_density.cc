// Densities of an image's colours by a trilinear histogram of the colour cube, smoothed by one cell, relative to uniform.
const wp::uint64* const place = (const wp::uint64*)places;  // of colours, shares, densities and two cubes for work
const int size = height * width, steps[3] = {CELLS * CELLS, CELLS, 1}, nodes = CELLS * CELLS * CELLS;
const real* const colours = (const real*)place[0];
const real* const share = (const real*)place[1] + (size_t)image * size;
real* const density = (real*)place[2] + (size_t)image * size;
real *cube = (real*)place[3] + (size_t)image * 2 * nodes, *other = cube + nodes;
for (int node = 0; node < nodes; ++node)
    cube[node] = 0;
for (int pass = 0; pass < 2; ++pass) {
    const bool counting = pass == 0;
    for (int p = 0; p < size; ++p) {
        int base = 0;
        real part[3], sum = 0;
        for (int channel = 0; channel < 3; ++channel) {
            const real at = wp::clamp(colours[3 * p + channel], real(0), real(1)) * (CELLS - 1);
            const int low = wp::min((int)at, CELLS - 2);
            part[channel] = at - low;
            base += low * steps[channel];
        }
        const real r = part[0], g = part[1], b = part[2];
        const real weights[4] = {(1 - r) * (1 - g), (1 - r) * g, r * (1 - g), r * g};
        for (int edge = 0; edge < 4; ++edge) {
            real* const node = cube + base + (edge >> 1) * steps[0] + (edge & 1) * steps[1];
            if (counting) {
                node[0] += share[p] * weights[edge] * (1 - b);
                node[1] += share[p] * weights[edge] * b;
            } else {
                sum += weights[edge] * (node[0] * (1 - b) + node[1] * b);
            }
        }
        if (!counting)
            density[p] = sum;
    }
    if (!counting)
        break;
    // Along each channel: mass over the length that a node stands for, half as long at an end; then (1, 2, 1) / 4.
    for (int channel = 0; channel < 3; ++channel) {
        const int step = steps[channel], last = CELLS - 1;
        for (int line = 0; line < CELLS * CELLS; ++line) {
            const int start = line / step * step * CELLS + line % step;
            real *const first = cube + start, *const smoothed = other + start;
            first[0] *= 2;
            first[last * step] *= 2;
            real below = first[step];
            for (int at = 0; at < CELLS; ++at) {
                const real here = first[at * step], above = first[(at < last ? at + 1 : last - 1) * step];
                smoothed[at * step] = last * (real(0.5) * here + real(0.25) * (below + above));
                below = here;
            }
        }
        real* const next = other;
        other = cube;
        cube = next;
    }
}
