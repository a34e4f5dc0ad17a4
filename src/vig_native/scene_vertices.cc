// Objects before their cameras: homogeneous screen points and attributes of vertices, lights; and the way back.
#include "scenes.h"
#include "threads.h"

namespace vig {
namespace {

template <class R> bool is_finite(const R* numbers, int64_t count) {
    R sums[LANES] = {};
    for (int64_t i = 0; i < count; ++i)
        sums[i % LANES] += numbers[i] * 0;
    R sum = 0;
    for (const R each : sums)
        sum += each;
    return sum == 0;
}

template <class R> Mat3<R> matrix(const R* numbers) {
    return numbers ? Mat3<R>{{load3(numbers), load3(numbers + 3), load3(numbers + 6)}}
                   : Mat3<R>{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
}

// Sums of outer products a b^T and of vectors, in double precision.
struct Sums {
    double outer[9] = {}, sum[3] = {};
    template <class R> void add(Vec3<R> a, Vec3<R> b) {
        for (int i = 0; i < 3; ++i) {
            sum[i] += a[i];
            for (int j = 0; j < 3; ++j)
                outer[3 * i + j] += a[i] * b[j];
        }
    }
};

template <class R> void add_to(R* to, const double* values, int count) {
    for (int i = 0; i < count && to; ++i)
        to[i] += (R)values[i];
}

template <class R> Light<R> light_of(const Object<R>& object) {
    Light<R> light;
    light.is_on = object.in[SKY] || object.in[LAMP];
    light.is_grey = !object.has_rgb_light();
    if (const R* const sky = object.in[SKY])
        for (int l = 0; l < LOBES; ++l)
            for (int c = 0; c < 3; ++c)
                light.sky[c][l] = object.has_rgb_light() ? sky[3 * l + c] : sky[l];
    R inverse;
    if (object.in[LAMP]) {
        light.lamp = unit(load3(object.in[LAMP]), inverse);
        light.radiance = load3(object.in[RADIANCE]);
    }
    return light;
}

// `count` rows of three numbers side by side, the last repeated.
template <class R> Vec3<Lanes<R>> load_rows(const R* rows, int count, size_t stride = 3) {
    Vec3<Lanes<R>> to;
    for (int k = 0; k < LANES; ++k)
        set_lane(to, k, load3(rows + stride * std::min(k, count - 1)));
    return to;
}

// Sums of the adjacent faces' cross products: normals weighted by area, twice.
template <class R> void sum_normals(const Mesh& mesh, const R* world, R* raw) {
    std::fill(raw, raw + 3 * (size_t)mesh.vertices, R(0));
    for (size_t f = 0; f < mesh.corners.size(); f += 3) {
        const int32_t* const corner = &mesh.corners[f];
        const Vec3<R> a = load3(world + 3 * (size_t)corner[0]);
        const Vec3<R> normal = cross(load3(world + 3 * (size_t)corner[1]) - a, load3(world + 3 * (size_t)corner[2]) - a);
        for (int k = 0; k < 3; ++k)
            add3(raw + 3 * (size_t)corner[k], normal);
    }
}

}  // namespace

template <class R> int Scenes<R>::vertex_count() const {
    return objects.empty() ? 0 : objects.back().first_vertex + objects.back().mesh->vertices;
}

template <class R> bool Scenes<R>::place(R* to_points, R* to_attributes, int threads) {
    points = to_points;
    attributes = to_attributes;
    world_.resize(3 * (size_t)vertex_count());
    raw_.resize(world_.size());
    lights_.resize(objects.size());
    std::vector<uint8_t> finite(objects.size(), 1);
    const auto place_object = [&](size_t number) {
        const Object<R>& object = objects[number];
        const Mesh& mesh = *object.mesh;
        for (int i = 0; i < COORDINATES + 2; ++i)
            finite[number] &= !object.in[i] || is_finite(object.in[i], object.count[i]);
        const Vec2<R> focal = {object.in[FOCAL][0], object.in[FOCAL][1]};
        const Vec2<R> centre = {object.in[CENTRE][0], object.in[CENTRE][1]};
        finite[number] &= focal.x > 0 && focal.y > 0;
        const Light<R> light = lights_[number] = light_of(object);
        const Mat3<R> turn = matrix(object.in[ROTATION]), camera = matrix(object.in[CAMERA_ROTATION]);
        const Vec3<R> shift = object.in[TRANSLATION] ? load3(object.in[TRANSLATION]) : Vec3<R>{0, 0, 0};
        const Vec3<R> camera_shift = load3(object.in[CAMERA_TRANSLATION]);
        R* const world = &world_[3 * (size_t)object.first_vertex];
        R* const raw = &raw_[3 * (size_t)object.first_vertex];
        for (int v = 0; v < mesh.vertices; ++v)
            store3(world + 3 * (size_t)v, turn * load3(object.in[VERTICES] + 3 * (size_t)v) + shift);
        if (object.in[NORMALS])
            for (int v = 0; v < mesh.vertices; ++v)
                store3(raw + 3 * (size_t)v, turn * load3(object.in[NORMALS] + 3 * (size_t)v));
        else
            sum_normals(mesh, world, raw);
        for (int base = 0; base < mesh.vertices; base += LANES) {
            Lanes<R> inverse;
            const int size = std::min(LANES, mesh.vertices - base);
            const Vec3<Lanes<R>> normal = unit(load_rows(raw + 3 * (size_t)base, size), inverse);
            const Vec3<Lanes<R>> reflected = reflect<R>(light, normal);
            for (int k = 0; k < size; ++k) {
                const size_t v = (size_t)base + k;
                R* const row = to_attributes + columns * (object.first_vertex + v);
                store3(row, lane<R>(normal, k));
                store3(row + 3, load3(object.in[ALBEDO] + (object.has_colours() ? 3 * v : 0)));
                if (columns == 9)
                    store3(row + 6, lane<R>(reflected, k));
                // Homogeneous: x and y times depth, divided only where a point is known to be beyond the near plane.
                const Vec3<R> seen = camera * load3(world + 3 * v) + camera_shift;
                store3(to_points + 3 * (object.first_vertex + v),
                       Vec3<R>{seen.x * focal.x + centre.x * seen.z, seen.y * focal.y + centre.y * seen.z, seen.z});
            }
        }
    };
    share_out(objects.size(), threads_for(vertex_count(), threads), place_object);
    return std::all_of(finite.begin(), finite.end(), [](uint8_t each) { return each; });
}

template <class R>
void Scenes<R>::place_back(const R* on_points, const R* on_attributes, const std::vector<LightCotangent>& on_lights,
                           std::vector<Cotangents<R>>& on_inputs, int threads) const {
    share_out(objects.size(), threads_for(vertex_count(), threads), [&](size_t number) {
        const Object<R>& object = objects[number];
        const Mesh& mesh = *object.mesh;
        const Cotangents<R>& on = on_inputs[number];
        const size_t first = object.first_vertex, count = mesh.vertices;
        const R *const world = &world_[3 * first], *const raw = &raw_[3 * first];
        LightCotangent on_light = on_lights[number];
        const Mat3<R> turn = matrix(object.in[ROTATION]), camera = matrix(object.in[CAMERA_ROTATION]);
        double on_albedo[3] = {}, on_focal[2] = {}, on_centre[2] = {};
        Sums on_camera, on_turn, on_normal_turn;
        std::vector<R> on_raw(3 * count), on_world(3 * count);
        for (size_t base = 0; base < count; base += LANES) {
            const int size = (int)std::min<size_t>(LANES, count - base);
            const R* const rows = on_attributes + columns * (first + base);
            for (int k = 0; k < size; ++k)
                for (int c = 0; c < 3; ++c) {
                    const R g = rows[(size_t)columns * k + 3 + c];
                    if (on[ALBEDO] && object.has_colours())
                        on[ALBEDO][3 * (base + k) + c] += g;
                    on_albedo[c] += g;
                }
            Lanes<R> inverse;
            const Vec3<Lanes<R>> normal = unit(load_rows(raw + 3 * base, size), inverse);
            Vec3<Lanes<R>> on_normal = load_rows(rows, size, columns);
            if (columns == 9) {
                Vec3<Lanes<R>> on = load_rows(rows + 6, size, columns);
                for (int k = size; k < LANES; ++k)
                    on.x[k] = on.y[k] = on.z[k] = 0;
                on_normal = on_normal + pull_reflect<R>(lights_[number], normal, on, on_light);
            }
            const Vec3<Lanes<R>> pulled = pull_unit(normal, inverse, on_normal);
            for (int k = 0; k < size; ++k)
                if (on_normal.x[k] != 0 || on_normal.y[k] != 0 || on_normal.z[k] != 0)
                    store3(&on_raw[3 * (base + k)], lane<R>(pulled, k));
        }
        const Vec3<R> camera_shift = load3(object.in[CAMERA_TRANSLATION]);
        for (size_t v = 0; v < count; ++v) {
            const Vec3<R> g = load3(on_points + 3 * (first + v));
            if (g.x == 0 && g.y == 0 && g.z == 0)
                continue;
            const R *const focal = object.in[FOCAL], *const centre = object.in[CENTRE];
            const Vec3<R> place = load3(world + 3 * v), seen = camera * place + camera_shift;
            const Vec3<R> on_seen = {g.x * focal[0], g.y * focal[1], g.x * centre[0] + g.y * centre[1] + g.z};
            for (int i = 0; i < 2; ++i) {
                on_focal[i] += g[i] * seen[i];
                on_centre[i] += g[i] * seen.z;
            }
            on_camera.add(on_seen, place);
            store3(&on_world[3 * v], camera.transposed(on_seen));
        }
        if (object.in[NORMALS]) {
            for (size_t v = 0; v < count; ++v) {
                const Vec3<R> g = load3(&on_raw[3 * v]);
                on_normal_turn.add(g, load3(object.in[NORMALS] + 3 * v));
                if (on[NORMALS])
                    add3(on[NORMALS] + 3 * v, turn.transposed(g));
            }
        } else {
            for (size_t f = 0; f < mesh.corners.size(); f += 3) {
                const size_t a = 3 * (size_t)mesh.corners[f], b = 3 * (size_t)mesh.corners[f + 1];
                const size_t c = 3 * (size_t)mesh.corners[f + 2];
                const Vec3<R> g = load3(&on_raw[a]) + load3(&on_raw[b]) + load3(&on_raw[c]);
                if (g.x == 0 && g.y == 0 && g.z == 0)
                    continue;
                // The normal is the cross product of the two sides at a.
                const Vec3<R> on_b = cross(load3(world + c) - load3(world + a), g);
                const Vec3<R> on_c = cross(g, load3(world + b) - load3(world + a));
                add3(&on_world[a], (on_b + on_c) * R(-1));
                add3(&on_world[b], on_b);
                add3(&on_world[c], on_c);
            }
        }
        for (size_t v = 0; v < count; ++v) {
            const Vec3<R> g = load3(&on_world[3 * v]);
            on_turn.add(g, load3(object.in[VERTICES] + 3 * v));
            if (on[VERTICES])
                add3(on[VERTICES] + 3 * v, turn.transposed(g));
        }
        add_to(on[ROTATION], on_turn.outer, 9);
        add_to(on[ROTATION], on_normal_turn.outer, 9);
        add_to(on[TRANSLATION], on_turn.sum, 3);
        add_to(on[CAMERA_ROTATION], on_camera.outer, 9);
        add_to(on[CAMERA_TRANSLATION], on_camera.sum, 3);
        add_to(on[FOCAL], on_focal, 2);
        add_to(on[CENTRE], on_centre, 2);
        if (!object.has_colours())
            add_to(on[ALBEDO], on_albedo, 3);
        for (int l = 0; l < LOBES && on[SKY]; ++l)
            for (int c = 0; c < 3; ++c)
                on[SKY][object.has_rgb_light() ? 3 * l + c : l] += (R)on_light.sky[c][l];
        if (on[LAMP]) {
            R inverse;
            const Vec3<R> lamp = unit(load3(object.in[LAMP]), inverse);
            add3(on[LAMP], pull_unit(lamp, inverse, {(R)on_light.lamp[0], (R)on_light.lamp[1], (R)on_light.lamp[2]}));
        }
        add_to(on[RADIANCE], on_light.radiance, 3);
    });
}

template class Scenes<VIG_REAL>;

}  // namespace vig
