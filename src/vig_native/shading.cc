// Normals and irradiance of vertices under spherical harmonics with self-shadow (Ramamoorthi and Hanrahan 2001; Sloan et
// al. 2002), their derivatives, and the backward pass.
#include <algorithm>

#include "likelihood.h"

namespace vig {
namespace {

// Vertices in use, side by side; the last is repeated where fewer are left.
template <int SIZE> struct Batch {
    int vertex[SIZE], count;
    Batch(const std::vector<int32_t>& all, size_t first) : count((int)std::min<size_t>(SIZE, all.size() - first)) {
        for (int lane = 0; lane < SIZE; ++lane)
            vertex[lane] = all[first + std::min(lane, count - 1)];
    }
};

// The ring of a vertex: rows (neighbour, next, previous) and places (V, 4) in the world.
template <class R> struct Ring {
    const int32_t *first, *end;
    const std::vector<R>& places;

    Ring(const Geometry<R>& geometry, const std::vector<R>& world, int vertex)
        : first(geometry.ring.data() + 3 * (size_t)geometry.ring_start[vertex]),
          end(geometry.ring.data() + 3 * (size_t)geometry.ring_start[vertex + 1]),
          places(world) {}

    // The area-weighted normal: the sum of cross(neighbour - vertex, next - vertex).
    Four<R> normal(int vertex) const {
        const Four<R> here = four_at(places, vertex);
        Four<R> sum = {};
        for (const int32_t* row = first; row < end; row += 3)
            sum += cross_fours<R>(four_at(places, row[0]) - here, four_at(places, row[1]) - here);
        return sum;
    }

    // Pull a cotangent on the normal back: add(neighbour, its part); the vertex's own part is returned. The normal does
    // not change when all its ring moves together: that part is minus the sum.
    template <class F> Four<R> pull(Four<R> tangent, F&& add) const {
        Four<R> own = {};
        for (const int32_t* row = first; row < end; row += 3) {
            const Four<R> arm = cross_fours<R>(four_at(places, row[1]) - four_at(places, row[2]), tangent);
            own -= arm;
            add(row[0], arm);
        }
        return own;
    }
};

// Self-shadow changes a vertex's lobes by T_0l + sum_k T_kl shape_k: `change`, in a row's light columns. rates (W,): the
// irradiance's derivatives sum_l T_kl light_l by shape. The change of the irradiance is returned; all without reflectance.
template <class R> R shadow(const Task<R>& task, int vertex, const Lanes<R>& light, Lanes<R>& change, R* rates) {
    typedef Lanes<R> Row;
    const int width = task.geometry.width;
    const R* const by_shape = task.geometry.transfer_by_shape.data() + (size_t)vertex * LOBES * width;
    const Row mean = lanes_at(&task.geometry.transfer_mean[(size_t)vertex * REST]);
    Row total, parts[LOBES];
    for (int part = 0; part < LANES; part += REGISTER) {
        Register<R> sum = register_at((const R*)&mean + part) * register_at((const R*)&light + part), lobes[LOBES] = {};
        for (int n = part; n < width; n += LANES) {
            const Register<R> shape = register_at(&task.work.coefficients[n]);
            Register<R> rate = {};
            for (int lobe = 0; lobe < LOBES; ++lobe) {
                const Register<R> row = register_at(by_shape + lobe * width + n);
                rate += row * task.light[lobe];
                lobes[lobe] += row * shape;
            }
            sum += rate * shape;
            register_at(rates + n) = rate;
        }
        register_at((R*)&total + part) = sum;
        for (int lobe = 0; lobe < LOBES; ++lobe)
            register_at((R*)&parts[lobe] + part) = lobes[lobe];
    }
    Row sums = {};
    if (task.order)
        sum_rows<LOBES, R>(parts, (R*)&sums + LIGHT);
    change = mean + sums;
    return sum_lanes<R>(total);
}

// A vertex's row of derivatives by shape: through its normal, and through self-shadow.
template <class R> void write_shape_row(Task<R>& task, int vertex, Four<R> tangent) {
    const Geometry<R>& geometry = task.geometry;
    const size_t width = geometry.width;
    const Ring<R> ring(geometry, task.work.world, vertex);
    int count = 0;
    const Four<R> own = ring.pull(tangent, [&](int, Four<R> arm) { four_at(task.work.arms, count++) = arm; });
    for (size_t n = 0; n < width; n += REGISTER) {
        Register<R> sum = {};
        if (geometry.shadowed)
            sum = register_at(&task.work.shadow_rates[vertex * width + n]);
        const auto add = [&](int at, const R* arm) {
            const R* const b = &geometry.basis[at * 3 * width + n];
            sum += arm[0] * register_at(b) + arm[1] * register_at(b + width) + arm[2] * register_at(b + 2 * width);
        };
        add(vertex, (const R*)&own);
        for (int i = 0; i < count; ++i)
            add(ring.first[3 * i], &task.work.arms[4 * i]);
        register_at(&task.work.shape_rows[vertex * width + n]) = sum;
    }
}

}  // namespace

template <class R> void shade(Task<R>& task) {
    typedef Register<R> Row;
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const size_t width = geometry.width;
    const Row none = {};
    Lanes<R> light = {};
    std::copy_n(task.light, LOBES, (R*)&light + LIGHT);
    for (size_t first = 0; first < work.seen_vertices.size(); first += REGISTER) {
        const Batch<REGISTER> batch(work.seen_vertices, first);
        Lanes<R> changes[REGISTER] = {};
        Row normals[4], row[LOBES], total = none, reflectance;
        for (int lane = 0; lane < REGISTER; ++lane) {
            const int vertex = batch.vertex[lane];
            ((R*)&reflectance)[lane] = geometry.reflectance[vertex];
            four_at(work.normals, vertex) = Ring<R>(geometry, work.world, vertex).normal(vertex);
            if (geometry.shadowed)
                ((R*)&total)[lane] = shadow(task, vertex, light, changes[lane], &work.shadow_rates[vertex * width]);
        }
        gather_four(work.normals.data(), batch.vertex, normals);
        const Vec3<Row> sum = {normals[0], normals[1], normals[2]};
        Row length = dot(sum, sum);
        for (int lane = 0; lane < REGISTER; ++lane)
            ((R*)&length)[lane] = std::sqrt(((const R*)&length)[lane]);
        const Row inverse = length > 0 ? 1 / length : none;
        const Vec3<Row> normal = sum * inverse;
        lobes<R>(normal, row);
        for (int lobe = 0; lobe < LOBES; ++lobe)
            total += row[lobe] * task.light[lobe];
        // Irradiance is max(0, .): a vertex in the dark has no derivative.
        const auto lit = total > 0;
        const Row strength = lit ? reflectance : none;
        total = lit ? total * reflectance : none;
        Row unit[4] = {normal.x, normal.y, normal.z, inverse};
        scatter_four<R>(unit, [&](int lane, Four<R> numbers) { four_at(work.normals, batch.vertex[lane]) = numbers; });
        for (int lane = 0; lane < REGISTER; ++lane)
            work.points[4 * (size_t)batch.vertex[lane] + 3] = total[lane];
        if (!task.order)
            continue;
        Row rest[REST] = {};
        for (int lobe = 0; lobe < LOBES; ++lobe)
            rest[LIGHT + lobe] = row[lobe] * strength;
        rest[IRRADIANCE] = total;
        for (int n = 0; n < REST; n += 4)
            scatter_four<R>(rest + n, [&](int lane, Four<R> numbers) {
                four_at(&work.rest_rows[(size_t)batch.vertex[lane] * REST + n]) =
                    numbers + four_at((const R*)&changes[lane] + n) * strength[lane];
            });
        for (int lane = 0; lane < batch.count && geometry.shadowed; ++lane)
            for (size_t n = 0; n < width; n += REGISTER)
                register_at(&work.shadow_rates[batch.vertex[lane] * width + n]) *= strength[lane];
    }
}

template <class R> void write_shape_rows(Task<R>& task) {
    typedef Register<R> Row;
    Workspace<R>& work = task.work;
    for (size_t first = 0; first < work.row_vertices.size(); first += REGISTER) {
        const Batch<REGISTER> batch(work.row_vertices, first);
        Row at[4], normals[4], reflectance;
        gather_four(work.points.data(), batch.vertex, at);
        gather_four(work.normals.data(), batch.vertex, normals);
        for (int lane = 0; lane < REGISTER; ++lane)
            ((R*)&reflectance)[lane] = task.geometry.reflectance[batch.vertex[lane]];
        const Vec3<Row> normal = {normals[0], normals[1], normals[2]};
        const Vec3<Row> slope = light_slope(task.light, normal) * (at[3] > 0 ? reflectance : Row{});
        // d (n / |n|) = (1 - n n^T) dn / |n|.
        const Vec3<Row> tangent = (slope - normal * dot(slope, normal)) * normals[3];
        Row tangents[4] = {tangent.x, tangent.y, tangent.z, Row{}};
        scatter_four<R>(tangents, [&](int lane, Four<R> numbers) {
            if (lane < batch.count)
                write_shape_row(task, batch.vertex[lane], numbers);
        });
    }
}

template <class R> void unshade(Task<R>& task, R* shape, R* rest) {
    typedef Register<R> Row;
    const Geometry<R>& geometry = task.geometry;
    Workspace<R>& work = task.work;
    const Eye<R>& eye = task.eye;
    const size_t width = geometry.width;
    const Row none = {};
    Lanes<R> motion[LIGHT] = {};
    for (size_t first = 0; first < work.seen_vertices.size(); first += LANES) {
        const Batch<LANES> batch(work.seen_vertices, first);
        R lit[LANES], places[LANES][4], tangents[LANES][4];
        for (int part = 0; part < LANES; part += REGISTER) {
            const int* const vertices = batch.vertex + part;
            Row at[4], on[4], normals[4], turns[4], reflectance, left, moved[LIGHT];
            gather_four(work.points.data(), vertices, at);
            gather_four(work.on_corner.data(), vertices, on);
            gather_four(work.normals.data(), vertices, normals);
            gather_four(work.on_normal.data(), vertices, turns);
            for (int lane = 0; lane < REGISTER; ++lane) {
                ((R*)&left)[lane] = part + lane < batch.count;
                ((R*)&reflectance)[lane] = geometry.reflectance[vertices[lane]];
            }
            for (int n = 0; n < 4; ++n) {
                on[n] = left > 0 ? on[n] : none;
                turns[n] = left > 0 ? turns[n] : none;
            }
            for (int n = 0; n < LIGHT; ++n)
                moved[n] = register_at((const R*)&motion[n] + part);
            // A vertex at or behind the camera has no cotangent.
            const Vec3<Row> spot = {at[0], at[1], at[2] > 0 ? at[2] : none + 1}, pull = {on[0], on[1], on[2]};
            add_motion(eye, pull, spot, moved);
            const Vec3<Row> in_world = eye.rotation.transposed(camera_cotangent(eye, spot, pull));
            const Vec3<Row> normal = {normals[0], normals[1], normals[2]}, turning = {turns[0], turns[1], turns[2]};
            const Vec3<Row> pose = rotation_cotangent(eye, turning, eye.rotation * normal);
            moved[AZIMUTH] += pose.x;
            moved[ELEVATION] += pose.y;
            moved[FRAMING + 3] += pose.z;
            for (int n = 0; n < LIGHT; ++n)
                register_at((R*)&motion[n] + part) = moved[n];
            on[3] = at[3] > 0 ? on[3] : none;
            register_at(lit + part) = on[3];
            const Vec3<Row> by_normal =
                light_slope(task.light, normal) * (on[3] * reflectance) + eye.rotation.transposed(turning);
            const Vec3<Row> tangent = (by_normal - normal * dot(by_normal, normal)) * normals[3];
            Row world[4] = {in_world.x, in_world.y, in_world.z, none}, turned[4] = {tangent.x, tangent.y, tangent.z, none};
            scatter_four<R>(world, [&](int lane, Four<R> four) { four_at(places[part + lane]) = four; });
            scatter_four<R>(turned, [&](int lane, Four<R> four) { four_at(tangents[part + lane]) = four; });
        }
        for (int lane = 0; lane < batch.count; ++lane)
            four_at(work.on_world, batch.vertex[lane]) += four_at(places[lane]);
        for (int lane = 0; lane < batch.count; ++lane) {
            const size_t vertex = batch.vertex[lane];
            four_at(work.on_world, (int)vertex) += Ring<R>(geometry, work.world, (int)vertex)
                .pull(four_at(tangents[lane]), [&](int other, Four<R> arm) { four_at(work.on_world, other) += arm; });
            for (int n = 0; n < REST; n += REGISTER)
                register_at(rest + n) += register_at(&work.rest_rows[vertex * REST + n]) * lit[lane];
            for (size_t n = 0; n < width && geometry.shadowed; n += REGISTER)
                register_at(shape + n) += register_at(&work.shadow_rates[vertex * width + n]) * lit[lane];
        }
    }
    for (int n = 0; n < LIGHT; ++n)
        rest[n] += sum_lanes<R>(motion[n]);
    for (int vertex = 0; vertex < geometry.vertices; ++vertex) {
        const Vec3<R> on = load3(&work.on_world[4 * (size_t)vertex]);
        if ((on.x != 0) | (on.y != 0) | (on.z != 0))
            add_basis(geometry, vertex, on, shape);
    }
}

template void shade(Task<VIG_REAL>&);
template void write_shape_rows(Task<VIG_REAL>&);
template void unshade(Task<VIG_REAL>&, VIG_REAL*, VIG_REAL*);

}  // namespace vig
