// The surface at a point of the grid: weights of the seen face's corners, attributes, light, texture; and the way back.
#pragma once
#include "scenes.h"

namespace vig {

// The surfaces at LANES points of the grid, faces of one object; the last is repeated where there are fewer. Corners lie
// from there (x and y still times the depth z), barycentric weights are w = e / sum of e, e being twice the areas opposite
// each corner times two depths; inverse = 1 / sum of e.
template <class R> struct Samples {
    typedef Lanes<R> Row;
    int count = 0, object, face[LANES], vertex[3][LANES];  // faces of the object; vertices numbered through
    size_t place[LANES];                                   // on the grid
    Row column, row;                                       // from the point to the grid's origin
    Row x[3], y[3], z[3], e[3], w[3], inverse;
};
// Cotangents on these, and up to two times three on attributes of the corners, from column `first` on.
template <class R> struct SampleCotangent {
    Lanes<R> w[3], e[3], x[3], y[3], z[3];
    int groups = 0, first[2];
    Vec3<Lanes<R>> attributes[2][3];
    SampleCotangent() {
        for (int i = 0; i < 3; ++i)
            w[i] = e[i] = x[i] = y[i] = z[i] = Lanes<R>{};
    }
};
// Three attributes from column `first` on: at the corners and, interpolated, at the points.
template <class R> struct Mixed {
    int first;
    Vec3<Lanes<R>> corner[3], value;
};
// Light that a white surface reflects; by the mixed normal, before it is of length one, or mixed itself.
template <class R> struct Lit {
    Mixed<R> mixed;
    Vec3<Lanes<R>> normal, value;
    Lanes<R> inverse;
};

// Texture look-up: bilinear in `levels` levels of the pyramid, linear between them (Williams 1983); derivatives of the
// weights along the screen, wx and wy, are quotients of those of e, ex and ey.
template <class R> struct Lookup {
    R ex[3], ey[3], wx[3], wy[3], sum_x, sum_y, share, rate[4], fx[2], fy[2], width[2], height[2];
    int levels, corner[3];
    size_t texel[2][4];
    R bilinear(int n, const R* texels, int c) const {
        const size_t* const at = texel[n];
        const R upper = texels[at[0] + c] * (1 - fx[n]) + texels[at[1] + c] * fx[n];
        const R lower = texels[at[2] + c] * (1 - fx[n]) + texels[at[3] + c] * fx[n];
        return upper * (1 - fy[n]) + lower * fy[n];
    }
};

// Samples of one layer. On the way back cotangents are added to `on_points`, `on_attributes` and the textures' of `on_inputs`.
template <class R> class Sampler {
    typedef Lanes<R> Row;

  public:
    Sampler(const Scenes<R>& scenes, int layer, R* on_points = nullptr, R* on_attributes = nullptr,
            std::vector<Cotangents<R>>* on_inputs = nullptr)
        : scenes_(scenes), layer_(scenes.layers[layer]), scale_((R)scenes.samples), on_points_(on_points),
          on_attributes_(on_attributes), on_inputs_(on_inputs) {}

    // Call use(samples) for the points of the grid without its margin, or with, at which a surface is seen and that are
    // wanted(place), in their order.
    template <class Wanted, class Use> void each(int margin, Wanted&& wanted, Use&& use) {
        Samples<R> seen;
        seen.object = layer_.begin;
        int first = 0, end = 0;  // faces of that object
        const auto flush = [&] {
            if (seen.count == 0)
                return;
            locate(seen);
            use(seen);
            seen.count = 0;
        };
        const int columns = scenes_.grid_columns();
        for (int row = margin; row < scenes_.grid_rows() - margin; ++row)
            for (int column = margin; column < columns - margin; ++column) {
                const size_t place = (size_t)row * columns + column;
                const int face = layer_.face[place];
                if (face < 0 || !wanted(place))
                    continue;
                const bool other = face < first || face >= end;
                if (seen.count == LANES || other)
                    flush();
                if (other) {
                    seen.object = find_object(face, seen.object);
                    first = scenes_.objects[seen.object].first_face;
                    end = first + scenes_.objects[seen.object].mesh->faces();
                }
                seen.face[seen.count] = face - first;
                seen.place[seen.count] = place;
                ((R*)&seen.column)[seen.count] = MARGIN - column - R(0.5);
                ((R*)&seen.row)[seen.count++] = MARGIN - row - R(0.5);
            }
        flush();
    }
    // Add cotangents on samples to those on points and attributes.
    void pull(const Samples<R>& seen, const SampleCotangent<R>& on) {
        const Row mean = seen.w[0] * on.w[0] + seen.w[1] * on.w[1] + seen.w[2] * on.w[2];
        Row e[3];
        Vec3<Row> to[3];
        for (int i = 0; i < 3; ++i)
            e[i] = (on.w[i] - mean) * seen.inverse + on.e[i];
        for (int i = 0; i < 3; ++i) {
            const int n = (i + 1) % 3, m = (i + 2) % 3;
            const Row gx = e[m] * seen.y[n] - e[n] * seen.y[m] + on.x[i];
            const Row gy = e[n] * seen.x[m] - e[m] * seen.x[n] + on.y[i];
            to[i] = {gx * scale_, gy * scale_, gx * seen.column + gy * seen.row + on.z[i]};
        }
        // All at once: neighbours mostly share corners, and additions to one number wait for each other.
        for (int k = 0; k < seen.count; ++k)
            for (int i = 0; i < 3; ++i) {
                const size_t vertex = seen.vertex[i][k];
                add3(on_points_ + 3 * vertex, lane<R>(to[i], k));
                for (int n = 0; n < on.groups; ++n)
                    add3(on_attributes_ + scenes_.columns * vertex + on.first[n], lane<R>(on.attributes[n][i], k));
            }
    }

    Mixed<R> mix(const Samples<R>& seen, int first) const {
        Mixed<R> mixed;
        mixed.first = first;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k)
                set_lane(mixed.corner[i], k, load3(scenes_.attributes + scenes_.columns * (size_t)seen.vertex[i][k] + first));
        mixed.value = mixed.corner[0] * seen.w[0] + mixed.corner[1] * seen.w[1] + mixed.corner[2] * seen.w[2];
        return mixed;
    }
    void pull_mix(const Samples<R>& seen, const Mixed<R>& mixed, Vec3<Row> on, SampleCotangent<R>& on_seen) {
        const int group = on_seen.groups++;
        on_seen.first[group] = mixed.first;
        for (int i = 0; i < 3; ++i) {
            on_seen.w[i] += dot(mixed.corner[i], on);
            on_seen.attributes[group][i] = on * seen.w[i];
        }
    }

    // Reflection of a white surface: interpolated from the vertices, or reflected here.
    Lit<R> light(const Samples<R>& seen) const {
        Lit<R> lit = {mix(seen, scenes_.columns == 9 ? 6 : 0), {}, {}, {}};
        lit.value = lit.mixed.value;
        if (scenes_.columns < 9) {
            lit.normal = unit(lit.mixed.value, lit.inverse);
            lit.value = reflect<R>(scenes_.lights_[seen.object], lit.normal);
        }
        return lit;
    }
    void pull_light(const Samples<R>& seen, const Lit<R>& lit, Vec3<Row> on, SampleCotangent<R>& on_seen,
                    LightCotangent& on_light) {
        if (scenes_.columns < 9) {
            on = pull_reflect<R>(scenes_.lights_[seen.object], lit.normal, on, on_light);
            on = pull_unit(lit.normal, lit.inverse, on);
        }
        pull_mix(seen, lit.mixed, on, on_seen);
    }

    Vec3<Row> texture(const Samples<R>& seen) const {
        const Row one = Row{} + R(1);
        Vec3<Row> out = {one, one, one};
        const R* const texels = scenes_.objects[seen.object].in[TEXELS];
        for (int n = 0; n < seen.count && texels; ++n) {
            const Lookup<R> k = look_up(seen, n);
            R colour[3];
            for (int c = 0; c < 3; ++c) {
                colour[c] = k.bilinear(0, texels, c);
                if (k.share > 0)
                    colour[c] += k.share * (k.bilinear(1, texels, c) - colour[c]);
            }
            set_lane(out, n, load3(colour));
        }
        return out;
    }
    void pull_texture(const Samples<R>& seen, Vec3<Row> on, SampleCotangent<R>& on_seen);

  private:
    const Scenes<R>& scenes_;
    const Layer<R>& layer_;
    R scale_;
    R *on_points_, *on_attributes_;
    std::vector<Cotangents<R>>* on_inputs_;

    void locate(Samples<R>& seen) const;
    Lookup<R> look_up(const Samples<R>& seen, int lane) const;
    void pull_look_up(const Samples<R>& seen, int lane, Vec3<R> on, SampleCotangent<R>& on_seen);
    // The object of a face, mostly that of the point before.
    int find_object(int face, int object) const {
        while (face < scenes_.objects[object].first_face)
            --object;
        while (face >= scenes_.objects[object].first_face + scenes_.objects[object].mesh->faces())
            ++object;
        return object;
    }
};

// Find corners and weights of samples of which place and face are set.
template <class R> void Sampler<R>::locate(Samples<R>& seen) const {
    const Object<R>& object = scenes_.objects[seen.object];
    for (int k = seen.count; k < LANES; ++k) {
        seen.face[k] = seen.face[k - 1];
        ((R*)&seen.column)[k] = ((R*)&seen.column)[k - 1];
        ((R*)&seen.row)[k] = ((R*)&seen.row)[k - 1];
    }
    const int32_t* const corners = object.mesh->corners.data();
    for (int k = 0; k < LANES; ++k)
        for (int i = 0; i < 3; ++i)
            seen.vertex[i][k] = object.first_vertex + corners[3 * (size_t)seen.face[k] + i];
    for (int i = 0; i < 3; ++i) {
        Vec3<Row> point;
        for (int k = 0; k < LANES; ++k)
            set_lane(point, k, load3(scenes_.points + 3 * (size_t)seen.vertex[i][k]));
        seen.x[i] = point.x * scale_ + seen.column * point.z;
        seen.y[i] = point.y * scale_ + seen.row * point.z;
        seen.z[i] = point.z;
    }
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        seen.e[i] = seen.x[n] * seen.y[m] - seen.x[m] * seen.y[n];
    }
    seen.inverse = 1 / (seen.e[0] + seen.e[1] + seen.e[2]);
    for (int i = 0; i < 3; ++i)
        seen.w[i] = seen.e[i] * seen.inverse;
}

constexpr double PER_OCTAVE = 0.72134752044448170368;  // 0.5 / log(2)

template <class R> Lookup<R> Sampler<R>::look_up(const Samples<R>& seen, int lane) const {
    const auto wrapped = [](int i, int count) { return (i % count + count) % count; };
    const Object<R>& object = scenes_.objects[seen.object];
    const R inverse = seen.inverse[lane];
    Lookup<R> k;
    R uv[2] = {}, foot[4] = {};
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        // A step of one pixel moves a corner by its depth.
        k.ex[i] = seen.z[m][lane] * seen.y[n][lane] - seen.z[n][lane] * seen.y[m][lane];
        k.ey[i] = seen.x[m][lane] * seen.z[n][lane] - seen.x[n][lane] * seen.z[m][lane];
    }
    k.sum_x = k.ex[0] + k.ex[1] + k.ex[2];
    k.sum_y = k.ey[0] + k.ey[1] + k.ey[2];
    for (int i = 0; i < 3; ++i) {
        k.corner[i] = object.mesh->texture_corners[3 * (size_t)seen.face[lane] + i];
        k.wx[i] = (k.ex[i] - seen.w[i][lane] * k.sum_x) * inverse;
        k.wy[i] = (k.ey[i] - seen.w[i][lane] * k.sum_y) * inverse;
        const R* const at = object.in[COORDINATES] + 2 * (size_t)k.corner[i];
        for (int c = 0; c < 2; ++c) {
            uv[c] += seen.w[i][lane] * at[c];
            foot[c] += k.wx[i] * at[c];
            foot[2 + c] += k.wy[i] * at[c];
        }
    }
    // Mean square size of the pixel in texels; half its logarithm is the level.
    const R size[2] = {(R)object.levels[2], (R)object.levels[1]};
    R square = 0;
    for (int i = 0; i < 4; ++i) {
        k.rate[i] = size[i % 2] * size[i % 2] * foot[i];
        square += k.rate[i] * foot[i] / 2;
    }
    const R level = R(PER_OCTAVE) * std::log(std::max(square, R(1e-12)));
    const int last = (int)(object.levels.size() / 3) - 1;
    k.levels = level > 0 && level < last ? 2 : 1;
    const int fine = level > 0 ? (level < last ? (int)level : last) : 0;
    k.share = k.levels == 2 ? level - fine : 0;
    for (int i = 0; i < 4; ++i)
        k.rate[i] *= R(PER_OCTAVE) / square;
    for (int n = 0; n < k.levels; ++n) {
        const int32_t* const row = &object.levels[3 * (size_t)(fine + n)];
        const int height = row[1], width = row[2];
        k.height[n] = height;
        k.width[n] = width;
        // Whole turns of the texture are dropped first: large uv must not overflow.
        const R x = (uv[0] - std::floor(uv[0])) * width - R(0.5);
        const R y = (1 - (uv[1] - std::floor(uv[1]))) * height - R(0.5);
        const int left = (int)std::floor(x), top = (int)std::floor(y);
        k.fx[n] = x - left;
        k.fy[n] = y - top;
        for (int i = 0; i < 4; ++i)
            k.texel[n][i] = 3 * (row[0] + (size_t)wrapped(top + i / 2, height) * width + wrapped(left + i % 2, width));
    }
    return k;
}

template <class R>
void Sampler<R>::pull_look_up(const Samples<R>& seen, int lane, Vec3<R> g, SampleCotangent<R>& on_seen) {
    const Object<R>& object = scenes_.objects[seen.object];
    const R* const texels = object.in[TEXELS];
    const Cotangents<R>& on = (*on_inputs_)[seen.object];
    const Lookup<R> k = look_up(seen, lane);
    const R inverse = seen.inverse[lane];
    R on_uv[2] = {}, on_share = 0;
    for (int n = 0; n < k.levels; ++n) {
        const R part = n ? k.share : 1 - k.share, fx = k.fx[n], fy = k.fy[n];
        const R shares[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
        const size_t* const at = k.texel[n];
        for (int c = 0; c < 3; ++c) {
            for (int i = 0; i < 4 && on[TEXELS]; ++i)
                on[TEXELS][at[i] + c] += part * g[c] * shares[i];
            const R* const t = texels + c;
            const R right = (t[at[1]] - t[at[0]]) * (1 - fy) + (t[at[3]] - t[at[2]]) * fy;
            const R down = (t[at[2]] - t[at[0]]) * (1 - fx) + (t[at[3]] - t[at[1]]) * fx;
            on_uv[0] += part * g[c] * right * k.width[n];
            on_uv[1] -= part * g[c] * down * k.height[n];  // v runs up, rows run down
            if (k.levels == 2)
                on_share += (n ? g[c] : -g[c]) * k.bilinear(n, texels, c);
        }
    }
    R on_foot[4] = {}, on_wx[3], on_wy[3], mean_x = 0, mean_y = 0, by_inverse = 0;
    for (int i = 0; i < 4 && k.levels == 2; ++i)
        on_foot[i] = k.rate[i] * on_share;
    for (int i = 0; i < 3; ++i) {
        const size_t corner = 2 * (size_t)k.corner[i];
        const R* const at = object.in[COORDINATES] + corner;
        for (int c = 0; c < 2 && on[COORDINATES]; ++c)
            on[COORDINATES][corner + c] += on_uv[c] * seen.w[i][lane] + on_foot[c] * k.wx[i] + on_foot[2 + c] * k.wy[i];
        on_wx[i] = on_foot[0] * at[0] + on_foot[1] * at[1];
        on_wy[i] = on_foot[2] * at[0] + on_foot[3] * at[1];
        mean_x += on_wx[i] * seen.w[i][lane];
        mean_y += on_wy[i] * seen.w[i][lane];
        by_inverse += on_wx[i] * k.wx[i] + on_wy[i] * k.wy[i];
        on_seen.w[i][lane] += on_uv[0] * at[0] + on_uv[1] * at[1];
        on_seen.w[i][lane] -= (on_wx[i] * k.sum_x + on_wy[i] * k.sum_y) * inverse;
    }
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        const R gx = (on_wx[i] - mean_x) * inverse, gy = (on_wy[i] - mean_y) * inverse;
        on_seen.e[i][lane] -= by_inverse * inverse;
        on_seen.z[m][lane] += gx * seen.y[n][lane] - gy * seen.x[n][lane];
        on_seen.z[n][lane] += gy * seen.x[m][lane] - gx * seen.y[m][lane];
        on_seen.y[n][lane] += gx * seen.z[m][lane];
        on_seen.y[m][lane] -= gx * seen.z[n][lane];
        on_seen.x[m][lane] += gy * seen.z[n][lane];
        on_seen.x[n][lane] -= gy * seen.z[m][lane];
    }
}

template <class R> void Sampler<R>::pull_texture(const Samples<R>& seen, Vec3<Row> on, SampleCotangent<R>& on_seen) {
    for (int n = 0; n < seen.count && scenes_.objects[seen.object].in[TEXELS]; ++n)
        pull_look_up(seen, n, lane<R>(on, n), on_seen);
}

}  // namespace vig
