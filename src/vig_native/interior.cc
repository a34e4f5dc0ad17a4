// Eq. 4 inside the silhouette: value and cotangents of covered pixels, and rows of the normal matrix.
#include <algorithm>
#include <cstring>

#include "surface.h"

namespace vig {
namespace {

// Posterior of being visible below which a pixel has no gradient: most hidden pixels.
constexpr double NEGLIGIBLE = 1e-9;

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
        const float p = 1 + f * (1 + f * (0.5f + f * (0.16666667f + f * (0.04166666f + f * (0.00833333f + f * 0.00138889f)))));
        r[n] = p * power[n];
        // log(1 + r) = 2 artanh(r / (2 + r)).
        const float s = r[n] / (2 + r[n]), s2 = s * s;
        log_1_r[n] = 2 * s * (1 + s2 * (0.33333333f + s2 * (0.2f + s2 * (0.14285714f + s2 * (0.11111111f
            + s2 * (0.09090909f + s2 * 0.07692308f))))));
    }
}

inline void softplus(const double* t, double* r, double* log_1_r) {
    for (int n = 0; n < LANES; ++n) {
        r[n] = std::exp(-t[n]);
        log_1_r[n] = std::log(1 + r[n]);
    }
}

// LANES covered pixels are taken at a time, side by side in vector registers; only the sums at the corners are formed
// one by one. `explain_pixel` and `pull_pixel` are the same for one pixel.
template <class D, class R> Gain<R> explain_lanes(Task<R>& task, const Noise<R>& noise) {
    const int width = task.eye.width, size = width * task.eye.height;
    const R* const points = task.work.screen.data();
    const R* const lights = task.work.irradiances.data();
    const int32_t* const corners = task.geometry.corners.data();
    const int32_t* const faces = task.work.visible.face.data();
    const R red = task.albedo.x, green = task.albedo.y, blue = task.albedo.z;
    const R half_precision = noise.half_precision, normaliser = noise.log_normaliser;
    R* const pulled = task.work.on_corner.data();
    Gain<R> gain;
    // Sums in the pixels' precision are added up in double precision after so many pixels: nats of an image reach 1e5.
    const int block = std::max(width, 1024);
    for (int begin = 0; begin < size; begin += block) {
        R total[LANES] = {}, painted_r[LANES] = {}, painted_g[LANES] = {}, painted_b[LANES] = {};
        const int end = std::min(begin + block, size);
        int next = begin;
        while (true) {
            int pixel[LANES], face[LANES];
            int count = 0;
            // Compaction: only covered pixels take part, so that no lane computes background.
            for (; next < end && count < LANES; ++next) {
                pixel[count] = next;
                face[count] = faces[next];
                count += faces[next] != NO_FACE;
            }
            if (count == 0)
                break;
            // Lanes that are left over repeat the first pixel, and are not counted below.
            for (int lane = count; lane < LANES; ++lane) {
                pixel[lane] = pixel[0];
                face[lane] = face[0];
            }
            int i[LANES], j[LANES], k[LANES];
            R ax[LANES], ay[LANES], aq[LANES], bx[LANES], by[LANES], bq[LANES], cx[LANES], cy[LANES], cq[LANES];
            R light_a[LANES], light_b[LANES], light_c[LANES];
            R c_r[LANES], c_g[LANES], c_b[LANES], log_seen[LANES], log_hidden[LANES], log_else[LANES];
            for (int lane = 0; lane < LANES; ++lane) {
                i[lane] = corners[3 * face[lane]];
                j[lane] = corners[3 * face[lane] + 1];
                k[lane] = corners[3 * face[lane] + 2];
            }
            for (int lane = 0; lane < LANES; ++lane) {
                ax[lane] = points[3 * i[lane]];
                ay[lane] = points[3 * i[lane] + 1];
                aq[lane] = points[3 * i[lane] + 2];
                bx[lane] = points[3 * j[lane]];
                by[lane] = points[3 * j[lane] + 1];
                bq[lane] = points[3 * j[lane] + 2];
                cx[lane] = points[3 * k[lane]];
                cy[lane] = points[3 * k[lane] + 1];
                cq[lane] = points[3 * k[lane] + 2];
                light_a[lane] = lights[i[lane]];
                light_b[lane] = lights[j[lane]];
                light_c[lane] = lights[k[lane]];
            }
            for (int lane = 0; lane < LANES; ++lane) {
                c_r[lane] = task.observed[3 * pixel[lane]];
                c_g[lane] = task.observed[3 * pixel[lane] + 1];
                c_b[lane] = task.observed[3 * pixel[lane] + 2];
                log_seen[lane] = task.log_prior[3 * pixel[lane]];
                log_hidden[lane] = task.log_prior[3 * pixel[lane] + 1];
                log_else[lane] = task.log_prior[3 * pixel[lane] + 2];
            }
            R weight_b[LANES], weight_c[LANES], pull_x[LANES], pull_y[LANES], lit[LANES], depth[LANES];
            R visible[LANES], seen[LANES], inlier[LANES], gap[LANES], t[LANES], r[LANES], log_1_r[LANES];
            R inverse[LANES], per_q[LANES], error_r[LANES], error_g[LANES], error_b[LANES], scaled[LANES];
            for (int lane = 0; lane < LANES; ++lane) {
                const int y = pixel[lane] / width;
                const R off_x = pixel[lane] - y * width + R(0.5) - ax[lane], off_y = y + R(0.5) - ay[lane];
                const R b_x = bx[lane] - ax[lane], b_y = by[lane] - ay[lane];
                const R c_x = cx[lane] - ax[lane], c_y = cy[lane] - ay[lane];
                // Barycentric weights b and c of the second and third corner at the pixel's centre.
                inverse[lane] = 1 / (b_x * c_y - b_y * c_x);
                const R b = (c_y * off_x - c_x * off_y) * inverse[lane], c = (b_x * off_y - b_y * off_x) * inverse[lane];
                // Perspective-correct irradiance: (q times irradiance) / q.
                const R lit_a = aq[lane] * light_a[lane];
                const R lit_b = bq[lane] * light_b[lane] - lit_a, lit_c = cq[lane] * light_c[lane] - lit_a;
                per_q[lane] = 1 / (aq[lane] + b * (bq[lane] - aq[lane]) + c * (cq[lane] - aq[lane]));
                seen[lane] = (lit_a + b * lit_b + c * lit_c) * per_q[lane];
                error_r[lane] = c_r[lane] - red * seen[lane];
                error_g[lane] = c_g[lane] - green * seen[lane];
                error_b[lane] = c_b[lane] - blue * seen[lane];
                scaled[lane] = (error_r[lane] * error_r[lane] + error_g[lane] * error_g[lane]
                                + error_b[lane] * error_b[lane]) * half_precision;
                // Eq. 3: log(p(visible) N(error) + p(hidden) u), as log odds `gap` and the larger term.
                inlier[lane] = log_seen[lane] + normaliser + D::log_density(scaled[lane]);
                gap[lane] = inlier[lane] - log_hidden[lane];
                const R far = gap[lane] < 0 ? -gap[lane] : gap[lane];
                t[lane] = far < 80 ? far : R(80);  // nats beyond which exp(-gap) is as good as 0
                weight_b[lane] = b;
                weight_c[lane] = c;
            }
            softplus(t, r, log_1_r);
            for (int lane = 0; lane < LANES; ++lane) {
                const R most = 1 / (1 + r[lane]), share = gap[lane] < 0 ? r[lane] * most : most;
                // The value is the gain over background, whose sum over all pixels is a constant of the photo.
                const R larger = gap[lane] < 0 ? log_hidden[lane] : inlier[lane];
                const R counted = larger + log_1_r[lane] - log_else[lane];
                total[lane] += lane < count ? counted : 0;
                const bool weighs = (lane < count) & (share > R(NEGLIGIBLE));
                // d log-likelihood / d colour = weight times error.
                const R slope = 2 * half_precision * share * D::pull(scaled[lane]), weight = weighs ? slope : 0;
                painted_r[lane] += weight * error_r[lane] * seen[lane];
                painted_g[lane] += weight * error_g[lane] * seen[lane];
                painted_b[lane] += weight * error_b[lane] * seen[lane];
                lit[lane] = weight * (red * error_r[lane] + green * error_g[lane] + blue * error_b[lane]) * per_q[lane];
                depth[lane] = -lit[lane] * seen[lane];
                // Corners' places enter through the weights b and c alone.
                const R b_x = bx[lane] - ax[lane], b_y = by[lane] - ay[lane];
                const R c_x = cx[lane] - ax[lane], c_y = cy[lane] - ay[lane], lit_a = aq[lane] * light_a[lane];
                const R along_b = lit[lane] * (bq[lane] * light_b[lane] - lit_a) + depth[lane] * (bq[lane] - aq[lane]);
                const R along_c = lit[lane] * (cq[lane] * light_c[lane] - lit_a) + depth[lane] * (cq[lane] - aq[lane]);
                pull_x[lane] = (b_y * along_c - c_y * along_b) * inverse[lane];
                pull_y[lane] = (c_x * along_b - b_x * along_c) * inverse[lane];
                visible[lane] = share;
            }
            for (int lane = 0; lane < count && task.order; ++lane) {
                task.work.posterior[pixel[lane]] = visible[lane];
                if (lit[lane] == 0)
                    continue;
                const int corner[3] = {i[lane], j[lane], k[lane]};
                const R share[3] = {1 - weight_b[lane] - weight_c[lane], weight_b[lane], weight_c[lane]};
                const R light[3] = {light_a[lane], light_b[lane], light_c[lane]};
                const R q[3] = {aq[lane], bq[lane], cq[lane]};
                for (int n = 0; n < 3; ++n) {
                    R* const on = pulled + 4 * (size_t)corner[n];
                    on[0] += share[n] * pull_x[lane];
                    on[1] += share[n] * pull_y[lane];
                    on[2] += share[n] * (light[n] * lit[lane] + depth[lane]);
                    on[3] += share[n] * q[n] * lit[lane];
                }
            }
            for (int lane = 0; lane < count && task.images; ++lane) {
                task.work.posterior[pixel[lane]] = visible[lane];
                task.work.coverage[pixel[lane]] = 1;
                task.work.irradiance[pixel[lane]] = seen[lane];
            }
        }
        gain.value += sum_lanes<R>(total);
        gain.albedo[0] += sum_lanes<R>(painted_r);
        gain.albedo[1] += sum_lanes<R>(painted_g);
        gain.albedo[2] += sum_lanes<R>(painted_b);
    }
    return gain;
}

}  // namespace

template <class R> Gain<R> explain_interior(Task<R>& task) {
    Gain<R> gain;
    with_density(task.photos.density, [&](auto density) { gain = explain_lanes<decltype(density)>(task, task.noise); });
    return gain;
}

template <class R> void add_interior_rows(Task<R>& task) {
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const Eye<R>& eye = task.eye;
    const int stride = task.photos.stride, shape_width = geometry.width, row_width = shape_width + REST;
    // One row stands for stride^2 pixels, so its root weight is multiplied by stride.
    const R per_row = stride * std::sqrt(2 * task.noise.half_precision);
    for (int y = 0; y < eye.height; y += stride)
        for (int x = 0; x < eye.width; x += stride) {
            const int at = y * eye.width + x;
            const int face = work.visible.face[at];
            if (face == NO_FACE || !(work.posterior[at] > R(NEGLIGIBLE)))
                continue;
            const Surface<R> surface = surface_of(task, face);
            const Vec2<R> pixel = {x + R(0.5), y + R(0.5)};
            const Seen<R> seen = seen_at(surface, pixel);
            const R off_x = pixel.x - surface.origin_x, off_y = pixel.y - surface.origin_y;
            const Vec3<R> error = load3(task.observed + 3 * (size_t)at) - task.albedo * seen.irradiance;
            // Iteratively reweighted least squares: the inlier's posterior times the density's slope.
            R slope = 0;
            with_density(task.photos.density, [&](auto density) {
                slope = decltype(density)::pull(dot(error, error) * task.noise.half_precision);
            });
            const R size = per_row * std::sqrt(work.posterior[at] * slope), inverse = size / seen.q;
            // u, v, w: perspective-correct weights of the corners, times the root weight.
            const R q_j = work.screen[3 * (size_t)surface.j + 2], q_k = work.screen[3 * (size_t)surface.k + 2];
            const R v = (surface.by_second.x * off_x + surface.by_second.y * off_y) * q_j * inverse;
            const R w = (surface.by_third.x * off_x + surface.by_third.y * off_y) * q_k * inverse;
            const R u = size - v - w;
            // - d irradiance / d (x, y): the surface moves under a fixed pixel.
            const Vec3<R> on_spot = {(surface.slope.x * seen.irradiance - surface.lit_slope.x) * inverse,
                                     (surface.slope.y * seen.irradiance - surface.lit_slope.y) * inverse, 0};
            const Vec3<R> spot = {pixel.x, pixel.y, seen.q};
            const Vec3<R> cotangent = eye.rotation.transposed(camera_cotangent(eye, spot, on_spot)) * (1 / size);
            R* const shape = work.add_row(row_width);
            R* const rest = shape + shape_width;
            const int corner[3] = {surface.i, surface.j, surface.k};
            const R weight[3] = {u, v, w};
            for (int n = 0; n < 3; ++n) {
                const R* const own = &work.shape_rows[(size_t)corner[n] * shape_width];
                for (int m = 0; m < shape_width; m += LANES)
                    lanes_at(shape + m) += lanes_at(own + m) * weight[n];
                lanes_at(rest) += lanes_at(&work.rest_rows[(size_t)corner[n] * REST]) * weight[n];
                add_basis(geometry, corner[n], cotangent * weight[n], shape);
            }
            add_motion(eye, on_spot, spot, rest);
        }
}

template Gain<float> explain_interior(Task<float>&);
template Gain<double> explain_interior(Task<double>&);
template void add_interior_rows(Task<float>&);
template void add_interior_rows(Task<double>&);

}  // namespace vig
