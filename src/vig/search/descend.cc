// Levenberg-Marquardt searches one after the other: every `stride`-th start from the `first` on. A valuation is a list of
// steps, `STEP_NUMBERS` numbers each, that value the point at a fixed address; see `Valuation`. Without iterations
// starts are only valued, without derivatives.
#ifndef __CUDACC__  // searches on a GPU are batches
typedef void (*Launch)(void*, void*);
typedef real Lanes __attribute__((vector_size(LANES * sizeof(real)), aligned(sizeof(real))));
const wp::int64* const given = (const wp::int64*)table.data;
const wp::int64* const steps = (const wp::int64*)given[AT_STEPS];
real* const trial = (real*)given[AT_TRIAL];
const double* const tried_value = (const double*)given[AT_TRIED_VALUE];
const real* const tried_gradient = (const real*)given[AT_TRIED_GRADIENT];
const real* const tried_normal = (const real*)given[AT_TRIED_NORMAL];
real* const point = (real*)given[AT_POINT];
double* const value = (double*)given[AT_VALUE];
real *const gradient = (real*)given[AT_GRADIENT], *const normal = (real*)given[AT_NORMAL];
real *const damping = (real*)given[AT_DAMPING], *const growth = (real*)given[AT_GROWTH];
const real* const step = (const real*)given[AT_STEP];
const bool* const done = (const bool*)given[AT_DONE];
const real* const starts = (const real*)given[AT_STARTS];
real* const path = (real*)given[AT_PATH];
double* const end_value = (double*)given[AT_END_VALUE];
real* const end_normal = (real*)given[AT_END_NORMAL];
wp::int64* const evaluations = (wp::int64*)given[AT_EVALUATIONS];
bool* const converged = (bool*)given[AT_CONVERGED];
const wp::int64 *const damped = given + AT_DAMPED_FUNCTION, *const accept = given + AT_ACCEPT_FUNCTION;
const wp::int64 searches = given[AT_SEARCHES], n = given[AT_SIZE], iterations = given[AT_ITERATIONS];

auto launch = [](const wp::int64* of) { ((Launch)of[0])((void*)of[1], (void*)of[2]); };
auto evaluate = [&]() {
    for (wp::int64 number = 0; number < given[AT_STEP_COUNT]; ++number) {
        const wp::int64* const of = steps + number * STEP_NUMBERS + 1;
        const wp::int64 kind = of[-1];
        if (kind == LAUNCH) {
            launch(of);
        } else if (kind == FILL) {
            wp::int64* const to = (wp::int64*)of[0];
            for (wp::int64 i = 0; i < of[1]; ++i)
                to[i] = of[2];
        } else if (kind == CLEAR) {
            __builtin_memset((void*)of[0], 0, of[1]);
        } else if (kind == COPY) {
            real* const to = (real*)of[0];
            for (wp::int64 i = 0; i < of[2]; ++i)
                to[i] = ((const real*)of[1])[i];
        } else if (kind == COMBINE) {
            // to (N,) = weights (K,) times rows (K, N), four rows at a time.
            real* const to = (real*)of[0];
            const real *const weights = (const real*)of[1], *const rows = (const real*)of[2];
            const wp::int64 lines = of[3], across = of[4];
            for (wp::int64 i = 0; i < across; ++i)
                to[i] = 0;
            for (wp::int64 k = 0; k < lines; k += 4) {
                const wp::int64 last = lines - 1;
                const real* row[4];
                real weight[4];
                for (int j = 0; j < 4; ++j) {
                    row[j] = rows + (k + j < last ? k + j : last) * across;
                    weight[j] = k + j <= last ? weights[k + j] : real(0);
                }
                for (wp::int64 i = 0; i < across; ++i)
                    to[i] += weight[0] * row[0][i] + weight[1] * row[1][i] + weight[2] * row[2][i] + weight[3] * row[3][i];
            }
        } else if (kind == PROJECT) {
            // to (K,) = rows (K, N) times from (N,).
            real* const to = (real*)of[0];
            const real *const from = (const real*)of[1], *const rows = (const real*)of[2];
            const wp::int64 lines = of[3], across = of[4], whole = across - across % (4 * LANES);
            for (wp::int64 k = 0; k < lines; ++k) {
                const real* const row = rows + k * across;
                Lanes sums[4] = {};
                for (wp::int64 i = 0; i < whole; i += 4 * LANES)
                    for (int j = 0; j < 4; ++j)
                        sums[j] += *(const Lanes*)(row + i + j * LANES) * *(const Lanes*)(from + i + j * LANES);
                Lanes parts = (sums[0] + sums[1]) + (sums[2] + sums[3]);
                for (wp::int64 i = whole; i < across; ++i)
                    parts[0] += row[i] * from[i];
                for (int half = LANES / 2; half; half /= 2)
                    for (int lane = 0; lane < half; ++lane)
                        parts[lane] += parts[lane + half];
                to[k] = parts[0];
            }
        } else if (kind == SQUARE) {
            // to (W, W) = rows^T rows, of those that are filled; W is a multiple of LANES. The upper blocks are mirrored.
            real* const to = (real*)of[0];
            const real* const rows = (const real*)of[1];
            const wp::int64 filled = *(const int*)of[2], most = of[3], width = of[4];
            const wp::int64 lines = filled < most ? filled : most;
            for (wp::int64 column = 0; column < width; column += LANES)
                for (wp::int64 i = 0; i < column + LANES; i += TILE) {
                    Lanes sums[TILE] = {};
                    for (wp::int64 line = 0; line < lines; ++line) {
                        const real* const row = rows + line * width;
                        const Lanes lanes = *(const Lanes*)(row + column);
                        for (int j = 0; j < TILE; ++j)
                            sums[j] += row[i + j] * lanes;
                    }
                    for (int j = 0; j < TILE; ++j)
                        *(Lanes*)(to + (i + j) * width + column) = sums[j];
                }
            for (wp::int64 i = 0; i < width; ++i)
                for (wp::int64 j = 0; j < i; ++j)
                    to[i * width + j] = to[j * width + i];
        }
    }
};

for (wp::int64 search = given[AT_FIRST]; search < searches; search += given[AT_STRIDE]) {
    for (wp::int64 i = 0; i < n; ++i)
        point[i] = trial[i] = path[search * n + i] = starts[search * n + i];
    evaluate();
    *value = *tried_value;
    bool going = *value - *value == 0;
    for (wp::int64 i = 0; iterations && i < n; ++i) {
        gradient[i] = tried_gradient[i];
        going &= gradient[i] - gradient[i] == 0;
    }
    for (wp::int64 i = 0; iterations && i < n * n; ++i)
        normal[i] = tried_normal[i];
    *damping = real(first_damping);
    *growth = 3;
    evaluations[search] = 1;
    bool ended = false;
    for (wp::int64 t = 1; t <= iterations; ++t) {
        if (going & !ended) {
            launch(damped);
            for (wp::int64 i = 0; i < n; ++i) {
                trial[i] = point[i] + step[i];
                going &= trial[i] - trial[i] == 0;
            }
        }
        if (going & !ended) {
            evaluate();
            launch(accept);
            ++evaluations[search];
            ended = *done;
        }
        for (wp::int64 i = 0; i < n; ++i)
            path[(t * searches + search) * n + i] = point[i];
    }
    converged[search] = going & ended;
    end_value[search] = *value;
    for (wp::int64 i = 0; iterations && i < n * n; ++i)
        end_normal[search * n * n + i] = normal[i];
}
#endif
