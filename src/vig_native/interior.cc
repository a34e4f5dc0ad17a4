// Eq. 4 inside the silhouette: value and cotangents of covered pixels, and rows of the normal matrix.
#include <algorithm>

#include "likelihood.h"
#include "softplus.h"

namespace vig {
namespace {

// Posterior of being visible below which a pixel has no gradient: most hidden pixels.
constexpr double NEGLIGIBLE = 1e-9;

// Pixels of a line, side by side in vector registers, and the face's surface at each.
template <class R> struct Pixels {
    typedef Register<R> Row;
    int corner[3][REGISTER];
    Row q[3], light[3];              // at the corners
    Row b_x, b_y, c_x, c_y;          // the second and third corner on the screen, from the first
    Row inverse, b, c;               // 1 / (b_x c_y - b_y c_x); their barycentric weights at the centre
    Row per_q, irradiance, error[3]; // depth; irradiance; observed less rendered colour

    // x, y: where the centres are; observed: their colours.
    void see(const Task<R>& task, const int* face, Row x, Row y, const Row* observed) {
        for (int lane = 0; lane < REGISTER; ++lane)
            for (int n = 0; n < 3; ++n)
                corner[n][lane] = task.geometry.corners[3 * (size_t)face[lane] + n];
        Row at[3][4];
        for (int n = 0; n < 3; ++n) {
            gather_four(task.work.points.data(), corner[n], at[n]);
            q[n] = at[n][2];
            light[n] = at[n][3];
        }
        const Row off_x = x - at[0][0], off_y = y - at[0][1];
        b_x = at[1][0] - at[0][0];
        b_y = at[1][1] - at[0][1];
        c_x = at[2][0] - at[0][0];
        c_y = at[2][1] - at[0][1];
        inverse = 1 / (b_x * c_y - b_y * c_x);
        b = (c_y * off_x - c_x * off_y) * inverse;
        c = (b_x * off_y - b_y * off_x) * inverse;
        // Perspective-correct irradiance: (q times irradiance) / q.
        const Row lit = q[0] * light[0];
        per_q = 1 / (q[0] + b * (q[1] - q[0]) + c * (q[2] - q[0]));
        irradiance = (lit + b * (q[1] * light[1] - lit) + c * (q[2] * light[2] - lit)) * per_q;
        for (int n = 0; n < 3; ++n)
            error[n] = observed[n] - task.albedo[n] * irradiance;
    }

    Row square_error() const { return error[0] * error[0] + error[1] * error[1] + error[2] * error[2]; }
};

// LANES pixels are taken at a time; only the sums at the corners are formed one by one. `explain_pixel` and `pull_pixel`
// are the same for one pixel.
template <class D, class R> Gain<R> explain_lanes(Task<R>& task) {
    typedef Register<R> Row;
    Workspace<R>& work = task.work;
    const int width = task.eye.width, height = task.eye.height;
    const R half_precision = task.noise.half_precision;
    const size_t plane = task.photos.pixels();
    const Row none = {};
    Gain<R> gain;
    // Sums in the pixels' precision are added up in double precision after so many lines: nats of an image reach 1e5.
    const int block = std::max(1, 1024 / width);
    for (int begin = 0; begin < height; begin += block) {
        Lanes<R> total = {}, painted[3] = {};
        for (int place = begin * width, end = std::min(begin + block, height) * width; place < end;) {
            const int y = place / width, left = (y + 1) * width - place;
            const size_t at = place;
            place += std::min(left, LANES);
            int face[LANES], some = NO_FACE;
            R present[LANES], column[LANES], scaled[LANES], log_density[LANES], pull[LANES], gaps[LANES], t[LANES], r[LANES],
                log_1_r[LANES], on_corner[3][LANES][4];
            Pixels<R> all[LANES / REGISTER];
            for (int lane = 0; lane < LANES; ++lane) {
                const int shown = work.visible.face[at + lane];
                face[lane] = lane < left ? shown : NO_FACE;
                some = std::max(some, face[lane]);
            }
            if (some == NO_FACE)
                continue;
            // Where there is none one of the other faces stands in, and is not counted below.
            for (int lane = 0; lane < LANES; ++lane) {
                present[lane] = face[lane] != NO_FACE;
                face[lane] = face[lane] != NO_FACE ? face[lane] : some;
                column[lane] = width - left + lane + R(0.5);
            }
            for (int part = 0; part < LANES; part += REGISTER) {
                Row observed[3];
                for (size_t n = 0; n < 3; ++n)
                    observed[n] = register_at(task.observed + n * plane + at + part);
                Pixels<R>& pixels = all[part / REGISTER];
                pixels.see(task, face + part, register_at(column + part), none + (y + R(0.5)), observed);
                register_at(scaled + part) = pixels.square_error() * half_precision;
            }
            for (int lane = 0; lane < LANES; ++lane) {
                log_density[lane] = D::log_density(scaled[lane]);
                pull[lane] = D::pull(scaled[lane]);
            }
            // Eq. 3: log(p(visible) N(error) + p(hidden) u), as log odds `gap` and the larger term.
            const auto inlier_of = [&](int part) -> Row {
                return register_at(task.log_prior + at + part) + task.noise.log_normaliser + register_at(log_density + part);
            };
            for (int part = 0; part < LANES; part += REGISTER) {
                const Row gap = inlier_of(part) - register_at(task.log_prior + plane + at + part), far = gap < 0 ? -gap : gap;
                register_at(gaps + part) = gap;
                register_at(t + part) = far < 80 ? far : none + 80;  // nats beyond which exp(-gap) is as good as 0
            }
            softplus(t, r, log_1_r);
            for (int part = 0; part < LANES; part += REGISTER) {
                const Pixels<R>& pixels = all[part / REGISTER];
                const Row gap = register_at(gaps + part), ratio = register_at(r + part), seen = pixels.irradiance;
                const Row most = 1 / (1 + ratio);
                const auto covered = register_at(present + part) > 0;
                const Row share = covered ? (gap < 0 ? ratio * most : most) : none;
                // The value is the gain over background, whose sum over all pixels is a constant of the photo.
                const Row hidden = register_at(task.log_prior + plane + at + part);
                const Row counted = (gap < 0 ? hidden : inlier_of(part)) + register_at(log_1_r + part)
                    - register_at(task.log_prior + 2 * plane + at + part);
                register_at((R*)&total + part) += covered ? counted : none;
                if (task.order || task.images)
                    register_at(&work.posterior[at + part]) = share;
                if (task.images) {
                    register_at(&work.coverage[at + part]) = register_at(present + part);
                    register_at(&work.irradiance[at + part]) = covered ? seen : none;
                }
                if (!task.order)
                    continue;
                // d log-likelihood / d colour = weight times error.
                const Row weight = share > R(NEGLIGIBLE) ? 2 * half_precision * share * register_at(pull + part) : none;
                Row on_colour = none;
                for (int n = 0; n < 3; ++n) {
                    register_at((R*)&painted[n] + part) += covered ? weight * pixels.error[n] * seen : none;
                    on_colour += task.albedo[n] * pixels.error[n];
                }
                const Row lit = weight > 0 ? weight * on_colour * pixels.per_q : none, depth = weight > 0 ? -lit * seen : none;
                // Corners' places enter through the weights b and c alone.
                const Row *const q = pixels.q, *const light = pixels.light, lit_a = q[0] * light[0];
                const Row along_b = lit * (q[1] * light[1] - lit_a) + depth * (q[1] - q[0]);
                const Row along_c = lit * (q[2] * light[2] - lit_a) + depth * (q[2] - q[0]);
                const Row pull_x = (pixels.b_y * along_c - pixels.c_y * along_b) * pixels.inverse;
                const Row pull_y = (pixels.c_x * along_b - pixels.b_x * along_c) * pixels.inverse;
                const Row parts[3] = {1 - pixels.b - pixels.c, pixels.b, pixels.c};
                for (int n = 0; n < 3; ++n) {
                    Row on[4] = {parts[n] * pull_x, parts[n] * pull_y, parts[n] * (light[n] * lit + depth),
                                 parts[n] * q[n] * lit};
                    scatter_four<R>(on, [&](int lane, Four<R> four) { four_at(on_corner[n][part + lane]) = four; });
                }
            }
            for (int n = 0; n < 3 && task.order; ++n)
                for (int lane = 0; lane < LANES; ++lane)
                    four_at(work.on_corner, all[lane / REGISTER].corner[n][lane % REGISTER]) += four_at(on_corner[n][lane]);
        }
        gain.value += sum_lanes<R>(total);
        for (int n = 0; n < 3; ++n)
            gain.albedo[n] += sum_lanes<R>(painted[n]);
    }
    return gain;
}

// Rows of the normal matrix of a register of pixels, of which `count` are wanted: x, y and places in the image.
template <class D, class R>
void add_rows(Task<R>& task, const int* at, const R* column, const R* line, int count) {
    typedef Register<R> Row;
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const Eye<R>& eye = task.eye;
    const size_t width = geometry.width, plane = task.photos.pixels();
    const Row x = register_at(column), y = register_at(line);
    int face[REGISTER];
    R root[REGISTER], motions[REGISTER][REST];
    Row observed[3];
    for (int lane = 0; lane < REGISTER; ++lane) {
        face[lane] = work.visible.face[at[lane]];
        for (size_t n = 0; n < 3; ++n)
            ((R*)&observed[n])[lane] = task.observed[n * plane + at[lane]];
    }
    Pixels<R> p;
    p.see(task, face, x, y, observed);
    const Row scaled = p.square_error() * task.noise.half_precision;
    // Iteratively reweighted least squares: the inlier's posterior times the density's slope. One row stands for stride^2
    // pixels, so its root weight is multiplied by stride.
    for (int lane = 0; lane < REGISTER; ++lane)
        root[lane] = task.photos.stride
            * std::sqrt(2 * task.noise.half_precision * work.posterior[at[lane]] * D::pull(R(scaled[lane])));
    // Perspective-correct weights of the corners.
    const Row second = p.b * p.q[1] * p.per_q, third = p.c * p.q[2] * p.per_q;
    const Row weight[3] = {1 - second - third, second, third};
    // - d irradiance / d (x, y): the surface moves under a fixed pixel.
    const Row lit = p.q[0] * p.light[0];
    const Row along_b = p.irradiance * (p.q[1] - p.q[0]) - (p.q[1] * p.light[1] - lit);
    const Row along_c = p.irradiance * (p.q[2] - p.q[0]) - (p.q[2] * p.light[2] - lit);
    const Row scale = p.inverse * p.per_q;
    const Vec3<Row> on_spot = {(p.c_y * along_b - p.b_y * along_c) * scale,
                               (p.b_x * along_c - p.c_x * along_b) * scale, Row{}};
    const Vec3<Row> spot = {x, y, 1 / p.per_q};
    const Vec3<Row> cotangent = eye.rotation.transposed(camera_cotangent(eye, spot, on_spot));
    Row motion[REST] = {};
    add_motion(eye, on_spot, spot, motion);
    for (int n = 0; n < REST; n += 4)
        scatter_four<R>(motion + n, [&](int lane, Four<R> four) { four_at(motions[lane] + n) = four; });
    R* to = work.add_rows(width + REST, count);
    for (int lane = 0; lane < count; ++lane, to += width + REST) {
        const R share[3] = {R(weight[0][lane]), R(weight[1][lane]), R(weight[2][lane])};
        const R axis[3] = {R(cotangent.x[lane]), R(cotangent.y[lane]), R(cotangent.z[lane])};
        const size_t corner[3] = {(size_t)p.corner[0][lane], (size_t)p.corner[1][lane], (size_t)p.corner[2][lane]};
        for (size_t m = 0; m < width; m += REGISTER) {
            Register<R> sum = {};
            for (int n = 0; n < 3; ++n) {
                const R* const b = &geometry.basis[corner[n] * 3 * width + m];
                sum += share[n] * (register_at(&work.shape_rows[corner[n] * width + m]) + axis[0] * register_at(b)
                                   + axis[1] * register_at(b + width) + axis[2] * register_at(b + 2 * width));
            }
            register_at(to + m) = sum * root[lane];
        }
        for (int m = 0; m < REST; m += REGISTER) {
            Row rest = register_at(motions[lane] + m);
            for (int n = 0; n < 3; ++n)
                rest += share[n] * register_at(&work.rest_rows[corner[n] * REST + m]);
            register_at(to + width + m) = rest * root[lane];
        }
    }
}

}  // namespace

template <class R> Gain<R> explain_interior(Task<R>& task) {
    Gain<R> gain;
    with_density(task.photos.density, [&](auto density) { gain = explain_lanes<decltype(density)>(task); });
    return gain;
}

template <class R> void add_interior_rows(Task<R>& task) {
    Workspace<R>& work = task.work;
    const int width = task.eye.width, height = task.eye.height, stride = task.photos.stride;
    work.row_pixels.clear();
    work.row_vertices.clear();
    for (int y = 0; y < height; y += stride)
        for (int x = 0; x < width; x += stride) {
            const int pixel = y * width + x, face = work.visible.face[pixel];
            if (face == NO_FACE || !(work.posterior[pixel] > R(NEGLIGIBLE)))
                continue;
            work.row_pixels.push_back(pixel);
            for (int n = 0; n < 3; ++n) {
                const int corner = task.geometry.corners[3 * (size_t)face + n];
                if (work.used[corner] != 2)
                    work.row_vertices.push_back(corner);
                work.used[corner] = 2;
            }
        }
    write_shape_rows(task);
    for (size_t first = 0; first < work.row_pixels.size(); first += REGISTER) {
        int at[REGISTER];
        R column[REGISTER], line[REGISTER];
        const int count = (int)std::min<size_t>(REGISTER, work.row_pixels.size() - first);
        for (int lane = 0; lane < REGISTER; ++lane) {
            at[lane] = work.row_pixels[first + std::min(lane, count - 1)];
            column[lane] = at[lane] % width + R(0.5);
            line[lane] = at[lane] / width + R(0.5);
        }
        with_density(task.photos.density,
                     [&](auto density) { add_rows<decltype(density)>(task, at, column, line, count); });
    }
}

template Gain<VIG_REAL> explain_interior(Task<VIG_REAL>&);
template void add_interior_rows(Task<VIG_REAL>&);

}  // namespace vig
