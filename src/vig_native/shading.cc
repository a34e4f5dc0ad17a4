// Normals and irradiance of vertices under spherical harmonics with self-shadow (Ramamoorthi and Hanrahan 2001; Sloan et
// al. 2002), their derivatives, and the backward pass.
#include <algorithm>

#include "likelihood.h"

namespace vig {
namespace {

// The ring of a vertex: rows (neighbour, next, previous) and places (V, 3) in the world.
template <class R> struct Ring {
    const int32_t *first, *end;
    const R* places;

    Ring(const Geometry<R>& geometry, const R* world, int vertex)
        : first(geometry.ring.data() + 3 * (size_t)geometry.ring_start[vertex]),
          end(geometry.ring.data() + 3 * (size_t)geometry.ring_start[vertex + 1]),
          places(world) {}

    // The area-weighted normal: the sum of cross(neighbour - vertex, next - vertex).
    Vec3<R> normal(int vertex) const {
        const Vec3<R> here = load3(places + 3 * (size_t)vertex);
        Vec3<R> sum = {0, 0, 0};
        for (const int32_t* row = first; row < end; row += 3)
            sum = sum + cross(load3(places + 3 * (size_t)row[0]) - here, load3(places + 3 * (size_t)row[1]) - here);
        return sum;
    }

    // Pull a cotangent on the normal back to a row's neighbour.
    Vec3<R> arm(const int32_t* row, Vec3<R> tangent) const {
        return cross(load3(places + 3 * (size_t)row[1]) - load3(places + 3 * (size_t)row[2]), tangent);
    }
};

// Change of a vertex's lobes c_l = T_0l + sum_k T_kl shape_k, and, where there are rates (W,), the irradiance's
// derivatives sum_l T_kl light_l by shape.
template <class R> void shadow(const Task<R>& task, int vertex, R* change, R* rates) {
    const Geometry<R>& geometry = task.geometry;
    const int width = geometry.width;
    const R* const by_shape = geometry.transfer_by_shape.data() + (size_t)vertex * LOBES * width;
    const R* const shape = task.work.coefficients.data();
    if (rates)
        std::fill(rates, rates + width, R(0));
    for (int lobe = 0; lobe < LOBES; ++lobe) {
        const R *const row = by_shape + lobe * width, light = task.light[lobe];
        Lanes<R> parts = {};
        for (int n = 0; n < width; n += LANES) {
            parts += lanes_at(row + n) * lanes_at(shape + n);
            if (rates)
                lanes_at(rates + n) += lanes_at(row + n) * light;
        }
        change[lobe] = geometry.transfer_mean[(size_t)vertex * LOBES + lobe] + sum_lanes<R>(parts);
    }
}

// A vertex's row of derivatives, whose light columns are given and whose irradiance is `total`.
template <class R> void write_rows(Task<R>& task, const Ring<R>& ring, int vertex, const R* row, R total) {
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const int width = geometry.width;
    R* const rest = work.rest_rows.data() + (size_t)vertex * REST;
    R* const shape = work.shape_rows.data() + (size_t)vertex * width;
    std::fill(rest, rest + REST, R(0));
    std::fill(shape, shape + width, R(0));
    // Irradiance is max(0, .): a vertex in the dark has no derivative.
    if (!(total > 0))
        return;
    const R reflectance = geometry.reflectance[vertex];
    const Vec3<R> normal = load3(&work.normals[3 * (size_t)vertex]);
    const Vec3<R> slope = light_slope(task.light, normal) * reflectance;
    // d (n / |n|) = (1 - n n^T) dn / |n|.
    const Vec3<R> tangent = (slope - normal * dot(slope, normal)) * work.inverse_lengths[vertex];
    for (int lobe = 0; lobe < LOBES; ++lobe)
        rest[LIGHT + lobe] = row[lobe];
    rest[IRRADIANCE] = total;
    Vec3<R> own = {0, 0, 0};
    for (const int32_t* at = ring.first; at < ring.end; at += 3) {
        const Vec3<R> arm = ring.arm(at, tangent);
        // The normal does not change when all its ring moves together: the vertex's own part is minus the sum.
        own = own - arm;
        add_basis(geometry, at[0], arm, shape);
    }
    add_basis(geometry, vertex, own, shape);
    if (geometry.shadowed) {
        const R* const rates = work.shadow_rates.data() + (size_t)vertex * width;
        for (int n = 0; n < width; n += LANES)
            lanes_at(shape + n) += lanes_at(rates + n) * reflectance;
    }
}

}  // namespace

template <class R> void shade(Task<R>& task) {
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    for (const int vertex : work.seen_vertices) {
        const Ring<R> ring(geometry, work.world.data(), vertex);
        const Vec3<R> sum = ring.normal(vertex);
        const R length = std::sqrt(dot(sum, sum)), inverse = length > 0 ? 1 / length : 0;
        const Vec3<R> normal = sum * inverse;
        R row[LOBES];
        lobes(normal, row);
        if (geometry.shadowed) {
            R* const change = &work.lobe_changes[(size_t)vertex * LOBES];
            shadow(task, vertex, change, task.order ? &work.shadow_rates[(size_t)vertex * geometry.width] : nullptr);
            for (int lobe = 0; lobe < LOBES; ++lobe)
                row[lobe] += change[lobe];
        }
        R total = 0;
        for (int lobe = 0; lobe < LOBES; ++lobe) {
            row[lobe] *= geometry.reflectance[vertex];
            total += row[lobe] * task.light[lobe];
        }
        store3(&work.normals[3 * (size_t)vertex], normal);
        work.inverse_lengths[vertex] = inverse;
        store3(&work.points[4 * (size_t)vertex], load3(&work.screen[3 * (size_t)vertex]));
        work.points[4 * (size_t)vertex + 3] = total > 0 ? total : 0;
        if (task.order > 1 && work.used[vertex] == 2)
            write_rows(task, ring, vertex, row, total);
    }
}

template <class R> void unshade(Task<R>& task, R* shape, R* rest) {
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const Eye<R>& eye = task.eye;
    const int width = geometry.width;
    for (const int vertex : work.seen_vertices) {
        const Vec3<R> spot = load3(&work.screen[3 * (size_t)vertex]);
        const R* const on_corner = &work.on_corner[4 * (size_t)vertex];
        const Vec3<R> pull = {on_corner[0], on_corner[1], on_corner[2]};
        add_motion(eye, pull, spot, rest);
        const Vec3<R> in_world = eye.rotation.transposed(camera_cotangent(eye, spot, pull));
        const Vec3<R> normal = load3(&work.normals[3 * (size_t)vertex]);
        Vec3<R> by_normal = {0, 0, 0};
        if (work.points[4 * (size_t)vertex + 3] > 0) {
            const R strength = on_corner[3] * geometry.reflectance[vertex];
            R row[LOBES];
            lobes(normal, row);
            if (geometry.shadowed) {
                const R* const change = &work.lobe_changes[(size_t)vertex * LOBES];
                const R* const rates = &work.shadow_rates[(size_t)vertex * width];
                for (int lobe = 0; lobe < LOBES; ++lobe)
                    row[lobe] += change[lobe];
                for (int n = 0; n < width; n += LANES)
                    lanes_at(shape + n) += lanes_at(rates + n) * strength;
            }
            for (int lobe = 0; lobe < LOBES; ++lobe)
                rest[LIGHT + lobe] += row[lobe] * strength;
            by_normal = light_slope(task.light, normal) * strength;
        }
        const Vec3<R> turning = load3(&work.on_normal[3 * (size_t)vertex]);
        if (turning.x != 0 || turning.y != 0) {
            const Vec3<R> pose = rotation_cotangent(eye, turning, eye.rotation * normal);
            rest[AZIMUTH] += pose.x;
            rest[ELEVATION] += pose.y;
            rest[FRAMING + 3] += pose.z;
            by_normal = by_normal + eye.rotation.transposed(turning);
        }
        const Vec3<R> tangent = (by_normal - normal * dot(by_normal, normal)) * work.inverse_lengths[vertex];
        const Ring<R> ring(geometry, work.world.data(), vertex);
        Vec3<R> own = in_world;
        for (const int32_t* at = ring.first; at < ring.end; at += 3) {
            const Vec3<R> arm = ring.arm(at, tangent);
            own = own - arm;
            add3(&work.on_world[3 * (size_t)at[0]], arm);
        }
        add3(&work.on_world[3 * (size_t)vertex], own);
    }
}

template void shade(Task<float>&);
template void shade(Task<double>&);
template void unshade(Task<float>&, float*, float*);
template void unshade(Task<double>&, double*, double*);

}  // namespace vig
