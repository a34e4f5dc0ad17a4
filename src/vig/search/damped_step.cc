// One search's damped Gauss-Newton step within the bounds: numbers that would pass a bound are held on it and the
// others solved again, ROUNDS times at most. The matrix's upper triangle is factored in `scratch`, whose last two
// lines are the right side and the solution; where it is not positive, a short scaled gradient step stands in.
const int n = points.shape.dims[1];
const real* const x = (const real*)points.data + (size_t)search * n;
const real* const slope = (const real*)gradient.data + (size_t)search * n;
const real* const curved = (const real*)normal.data + (size_t)search * n * n;
const real *const low = (const real*)lower.data, *const high = (const real*)upper.data;
real* const factor = (real*)scratch.data + (size_t)search * (n + 2) * n;
real *const right = factor + n * n, *const solved = right + n, *const moved = (real*)step.data + (size_t)search * n;
wp::uint8* const still = (wp::uint8*)held.data + (size_t)search * n;
const real damp = ((const real*)damping.data)[search];
real most = 0;
for (int i = 0; i < n; ++i) {
    most = curved[i * n + i] > most ? curved[i * n + i] : most;
    // A number at a bound whose gradient points outwards is held (active set).
    still[i] = ((x[i] <= low[i]) & (slope[i] <= 0)) | ((x[i] >= high[i]) & (slope[i] >= 0)) | (low[i] == high[i]);
    moved[i] = 0;
}
const real floor = real(1e-6) * most;
for (int round = 0; round < ROUNDS; ++round) {
    for (int i = 0; i < n; ++i) {
        right[i] = still[i] ? 0 : slope[i];
        for (int j = 0; j < n; ++j) {
            // What the held numbers moved is known: it goes to the right side.
            if (still[j] & !still[i])
                right[i] -= curved[i * n + j] * moved[j];
            factor[i * n + j] = still[i] | still[j] ? 0 : curved[i * n + j];
        }
        const real own = curved[i * n + i];
        // Marquardt 1963: damping in proportion to the diagonal, so that units do not matter; a floor for flat ones.
        factor[i * n + i] = still[i] ? 1 : own + damp * (own + floor) + real(1e-9) * floor;
    }
    bool positive = true;
    for (int k = 0; k < n; ++k) {
        real* const line = factor + k * n;
        // Cholesky factorisation, with forward substitution in the same pass.
        positive &= line[k] > 0;
        const real root = wp::sqrt(positive ? line[k] : real(1)), inverse = 1 / root;
        line[k] = root;
        for (int j = k + 1; j < n; ++j)
            line[j] *= inverse;
        right[k] *= inverse;
        for (int i = k + 1; i < n; ++i) {
            const real share = line[i];
            real* const below = factor + i * n;
            for (int j = i; j < n; ++j)
                below[j] -= share * line[j];
            right[i] -= share * right[k];
        }
    }
    for (int i = n - 1; i >= 0; --i) {
        real left = right[i];
        for (int j = i + 1; j < n; ++j)
            left -= factor[i * n + j] * solved[j];
        solved[i] = left / factor[i * n + i];
    }
    bool over = false;
    for (int i = 0; i < n; ++i) {
        if (still[i])
            continue;
        const bool usable = positive & (solved[i] - solved[i] == 0);
        const real whole = usable ? solved[i] : slope[i] / (curved[i * n + i] + floor) * real(0.1);
        const real reached = x[i] + whole;
        moved[i] = (reached < low[i] ? low[i] : reached > high[i] ? high[i] : reached) - x[i];
        const bool beyond = (reached < low[i]) | (reached > high[i]);
        still[i] |= beyond;
        over |= beyond;
    }
    if (!over)
        break;
}
// The quadratic model's gain: g . s - s . N s / 2.
double gain = 0;
for (int i = 0; i < n; ++i) {
    real bent = slope[i];
    for (int j = 0; j < n; ++j)
        bent -= real(0.5) * curved[i * n + j] * moved[j];
    gain += double(bent * moved[i]);
}
((double*)promised.data)[search] = gain;
