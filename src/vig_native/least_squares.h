// Small systems of linear equations.
#pragma once

namespace vig {

// Solve N equations with a symmetric positive definite matrix; each row ends with its right side. The rows are destroyed.
template <int N> void solve(double (&rows)[N][N + 1], double (&result)[N]) {
    for (int i = 0; i < N; ++i)
        for (int j = i + 1; j < N; ++j) {
            const double share = rows[j][i] / rows[i][i];
            for (int k = i; k <= N; ++k)
                rows[j][k] -= share * rows[i][k];
        }
    for (int i = N - 1; i >= 0; --i) {
        result[i] = rows[i][N];
        for (int j = i + 1; j < N; ++j)
            result[i] -= rows[i][j] * result[j];
        result[i] /= rows[i][i];
    }
}

}  // namespace vig
