// The surface at a point of the grid: weights of the seen face's corners, attributes, light, texture; and the way back.
#pragma once
#include "scenes.h"

namespace vig {

// A seen face at a point: its vertices, numbered through, from there (x and y still times the depth z), barycentric weights
// w = e / sum of e, e being twice the areas opposite each corner times two depths; inverse = 1 / sum of e.
template <class R> struct Sample {
    int object, face;
    int vertex[3];
    R x[3], y[3], z[3], e[3], w[3], inverse;
};
// Cotangents on these.
template <class R> struct SampleCotangent {
    R w[3], e[3], x[3], y[3], z[3];
};

// LANES samples side by side, of surfaces whose light was found at the vertices, without textures.
template <class R> struct SampleBlock {
    static constexpr int COLOURS = 6;  // albedo and light, columns 3 to 8 of attributes
    int vertex[3][LANES], object[LANES];
    R column[LANES], row[LANES], x[3][LANES], y[3][LANES], z[3][LANES], w[3][LANES], inverse[LANES];
    R corner[3][COLOURS][LANES], mixed[COLOURS][LANES];
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
  public:
    Sampler(const Scenes<R>& scenes, int layer, R* on_points = nullptr, R* on_attributes = nullptr,
            std::vector<Cotangents<R>>* on_inputs = nullptr)
        : scenes_(scenes), layer_(layer), scale_((R)scenes.samples), object_(scenes.starts[layer]), on_points_(on_points),
          on_attributes_(on_attributes), on_inputs_(on_inputs) {}

    // Face `face`, numbered through, at a point of the grid.
    Sample<R> at(int face, int column, int row) {
        const Object<R>& object = scenes_.objects[find_object(face)];
        Sample<R> seen;
        seen.object = object_;
        seen.face = face - object.first_face;
        column_ = MARGIN - column - R(0.5);
        row_ = MARGIN - row - R(0.5);
        for (int i = 0; i < 3; ++i) {
            seen.vertex[i] = object.first_vertex + object.mesh->corners[3 * (size_t)seen.face + i];
            const R* const point = scenes_.points + 3 * (size_t)seen.vertex[i];
            seen.x[i] = point[0] * scale_ + column_ * point[2];
            seen.y[i] = point[1] * scale_ + row_ * point[2];
            seen.z[i] = point[2];
        }
        for (int i = 0; i < 3; ++i) {
            const int n = (i + 1) % 3, m = (i + 2) % 3;
            seen.e[i] = seen.x[n] * seen.y[m] - seen.x[m] * seen.y[n];
        }
        seen.inverse = 1 / (seen.e[0] + seen.e[1] + seen.e[2]);
        for (int i = 0; i < 3; ++i)
            seen.w[i] = seen.e[i] * seen.inverse;
        return seen;
    }
    // Add cotangents on the last sample to those on points.
    void pull(const Sample<R>& seen, const SampleCotangent<R>& on) {
        const R mean = seen.w[0] * on.w[0] + seen.w[1] * on.w[1] + seen.w[2] * on.w[2];
        R e[3];
        for (int i = 0; i < 3; ++i)
            e[i] = (on.w[i] - mean) * seen.inverse + on.e[i];
        for (int i = 0; i < 3; ++i) {
            const int n = (i + 1) % 3, m = (i + 2) % 3;
            const R gx = e[m] * seen.y[n] - e[n] * seen.y[m] + on.x[i];
            const R gy = e[n] * seen.x[m] - e[m] * seen.x[n] + on.y[i];
            add3(on_points_ + 3 * (size_t)seen.vertex[i], Vec3<R>{gx * scale_, gy * scale_, gx * column_ + gy * row_ + on.z[i]});
        }
    }

    // Whether `block` serves this layer.
    bool has_blocks() const {
        const Layer<R>& layer = scenes_.layers[layer_];
        return scenes_.columns == 9 && std::none_of(scenes_.objects.begin() + layer.begin, scenes_.objects.begin() + layer.end,
                                                    [](const Object<R>& object) { return object.in[TEXELS] != nullptr; });
    }
    // Faces at LANES points of a row of the grid.
    void block(const int32_t* face, const int* columns, int row, SampleBlock<R>& b) {
        for (int k = 0; k < LANES; ++k) {
            const Object<R>& object = scenes_.objects[find_object(face[columns[k]])];
            b.object[k] = object_;
            b.column[k] = MARGIN - columns[k] - R(0.5);
            b.row[k] = MARGIN - row - R(0.5);
            const int32_t* const corners = &object.mesh->corners[3 * (size_t)(face[columns[k]] - object.first_face)];
            for (int i = 0; i < 3; ++i)
                b.vertex[i][k] = object.first_vertex + corners[i];
        }
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k) {
                const R* const point = scenes_.points + 3 * (size_t)b.vertex[i][k];
                b.x[i][k] = point[0] * scale_ + b.column[k] * point[2];
                b.y[i][k] = point[1] * scale_ + b.row[k] * point[2];
                b.z[i][k] = point[2];
            }
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k) {
                const int n = (i + 1) % 3, m = (i + 2) % 3;
                b.w[i][k] = b.x[n][k] * b.y[m][k] - b.x[m][k] * b.y[n][k];
            }
        for (int k = 0; k < LANES; ++k)
            b.inverse[k] = 1 / (b.w[0][k] + b.w[1][k] + b.w[2][k]);
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k)
                b.w[i][k] *= b.inverse[k];
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k)
                for (int c = 0; c < b.COLOURS; ++c)
                    b.corner[i][c][k] = scenes_.attributes[9 * (size_t)b.vertex[i][k] + 3 + c];
        for (int c = 0; c < b.COLOURS; ++c)
            for (int k = 0; k < LANES; ++k)
                b.mixed[c][k] = b.corner[0][c][k] * b.w[0][k] + b.corner[1][c][k] * b.w[1][k] + b.corner[2][c][k] * b.w[2][k];
    }
    // Add cotangents (3, LANES) on the colours of the first `count` samples to those on points and attributes.
    void pull_block(const SampleBlock<R>& b, const R (&on)[3][LANES], int count) {
        R on_mixed[b.COLOURS][LANES], on_w[3][LANES], gx[3][LANES], gy[3][LANES], gz[3][LANES], mean[LANES];
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < LANES; ++k) {
                on_mixed[c][k] = on[c][k] * b.mixed[3 + c][k];
                on_mixed[3 + c][k] = on[c][k] * b.mixed[c][k];
            }
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k) {
                on_w[i][k] = 0;
                for (int c = 0; c < b.COLOURS; ++c)
                    on_w[i][k] += b.corner[i][c][k] * on_mixed[c][k];
            }
        for (int k = 0; k < LANES; ++k)
            mean[k] = b.w[0][k] * on_w[0][k] + b.w[1][k] * on_w[1][k] + b.w[2][k] * on_w[2][k];
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k)
                on_w[i][k] = (on_w[i][k] - mean[k]) * b.inverse[k];
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < LANES; ++k) {
                const int n = (i + 1) % 3, m = (i + 2) % 3;
                const R x = on_w[m][k] * b.y[n][k] - on_w[n][k] * b.y[m][k];
                const R y = on_w[n][k] * b.x[m][k] - on_w[m][k] * b.x[n][k];
                gx[i][k] = x * scale_;
                gy[i][k] = y * scale_;
                gz[i][k] = x * b.column[k] + y * b.row[k];
            }
        for (int k = 0; k < count; ++k)
            for (int i = 0; i < 3; ++i) {
                const size_t vertex = b.vertex[i][k];
                add3(on_points_ + 3 * vertex, Vec3<R>{gx[i][k], gy[i][k], gz[i][k]});
                for (int c = 0; c < b.COLOURS; ++c)
                    on_attributes_[9 * vertex + 3 + c] += b.w[i][k] * on_mixed[c][k];
            }
    }

    // Attributes from column `first` on, interpolated.
    Vec3<R> mix(const Sample<R>& seen, int first) const {
        return load3(row(scenes_.attributes, seen, 0, first)) * seen.w[0] +
               load3(row(scenes_.attributes, seen, 1, first)) * seen.w[1] +
               load3(row(scenes_.attributes, seen, 2, first)) * seen.w[2];
    }
    void pull_mix(const Sample<R>& seen, int first, Vec3<R> on, SampleCotangent<R>& on_seen) {
        for (int i = 0; i < 3; ++i) {
            on_seen.w[i] += dot(load3(row(scenes_.attributes, seen, i, first)), on);
            add3(row(on_attributes_, seen, i, first), on * seen.w[i]);
        }
    }

    // What a white surface reflects: interpolated from the vertices, or reflected here.
    Vec3<R> light(const Sample<R>& seen) const {
        R inverse;
        return scenes_.columns == 9 ? mix(seen, 6) : reflect(scenes_.lights_[seen.object], unit(mix(seen, 0), inverse));
    }
    void pull_light(const Sample<R>& seen, Vec3<R> on, SampleCotangent<R>& on_seen, LightCotangent& on_light) {
        if (scenes_.columns == 9)
            return pull_mix(seen, 6, on, on_seen);
        R inverse;
        const Vec3<R> normal = unit(mix(seen, 0), inverse);
        const Vec3<R> on_normal = pull_reflect(scenes_.lights_[seen.object], normal, on, on_light);
        pull_mix(seen, 0, pull_unit(normal, inverse, on_normal), on_seen);
    }

    Vec3<R> texture(const Sample<R>& seen) const {
        const R* const texels = scenes_.objects[seen.object].in[TEXELS];
        if (!texels)
            return {1, 1, 1};
        const Lookup<R> k = look_up(seen);
        R out[3];
        for (int c = 0; c < 3; ++c) {
            out[c] = k.bilinear(0, texels, c);
            if (k.share > 0)
                out[c] += k.share * (k.bilinear(1, texels, c) - out[c]);
        }
        return load3(out);
    }
    void pull_texture(const Sample<R>& seen, Vec3<R> on, SampleCotangent<R>& on_seen);

  private:
    const Scenes<R>& scenes_;
    int layer_;
    R scale_, column_ = 0, row_ = 0;
    int object_;
    R *on_points_, *on_attributes_;
    std::vector<Cotangents<R>>* on_inputs_;

    template <class N> N* row(N* table, const Sample<R>& seen, int corner, int first) const {
        return table + scenes_.columns * (size_t)seen.vertex[corner] + first;
    }
    Lookup<R> look_up(const Sample<R>& seen) const;
    // The object of a face, mostly that of the point before.
    int find_object(int face) {
        while (face < scenes_.objects[object_].first_face)
            --object_;
        while (face >= scenes_.objects[object_].first_face + scenes_.objects[object_].mesh->faces())
            ++object_;
        return object_;
    }
};

constexpr double PER_OCTAVE = 0.72134752044448170368;  // 0.5 / log(2)

template <class R> Lookup<R> Sampler<R>::look_up(const Sample<R>& seen) const {
    const auto wrapped = [](int i, int count) { return (i % count + count) % count; };
    const Object<R>& object = scenes_.objects[seen.object];
    Lookup<R> k;
    R uv[2] = {}, foot[4] = {};
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        // A step of one pixel moves a corner by its depth.
        k.ex[i] = seen.z[m] * seen.y[n] - seen.z[n] * seen.y[m];
        k.ey[i] = seen.x[m] * seen.z[n] - seen.x[n] * seen.z[m];
    }
    k.sum_x = k.ex[0] + k.ex[1] + k.ex[2];
    k.sum_y = k.ey[0] + k.ey[1] + k.ey[2];
    for (int i = 0; i < 3; ++i) {
        k.corner[i] = object.mesh->texture_corners[3 * (size_t)seen.face + i];
        k.wx[i] = (k.ex[i] - seen.w[i] * k.sum_x) * seen.inverse;
        k.wy[i] = (k.ey[i] - seen.w[i] * k.sum_y) * seen.inverse;
        const R* const at = object.in[COORDINATES] + 2 * (size_t)k.corner[i];
        for (int c = 0; c < 2; ++c) {
            uv[c] += seen.w[i] * at[c];
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
void Sampler<R>::pull_texture(const Sample<R>& seen, Vec3<R> g, SampleCotangent<R>& on_seen) {
    const Object<R>& object = scenes_.objects[seen.object];
    const R* const texels = object.in[TEXELS];
    if (!texels)
        return;
    const Cotangents<R>& on = (*on_inputs_)[seen.object];
    const Lookup<R> k = look_up(seen);
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
            on[COORDINATES][corner + c] += on_uv[c] * seen.w[i] + on_foot[c] * k.wx[i] + on_foot[2 + c] * k.wy[i];
        on_wx[i] = on_foot[0] * at[0] + on_foot[1] * at[1];
        on_wy[i] = on_foot[2] * at[0] + on_foot[3] * at[1];
        mean_x += on_wx[i] * seen.w[i];
        mean_y += on_wy[i] * seen.w[i];
        by_inverse += on_wx[i] * k.wx[i] + on_wy[i] * k.wy[i];
        on_seen.w[i] += on_uv[0] * at[0] + on_uv[1] * at[1];
        on_seen.w[i] -= (on_wx[i] * k.sum_x + on_wy[i] * k.sum_y) * seen.inverse;
    }
    for (int i = 0; i < 3; ++i) {
        const int n = (i + 1) % 3, m = (i + 2) % 3;
        const R gx = (on_wx[i] - mean_x) * seen.inverse, gy = (on_wy[i] - mean_y) * seen.inverse;
        on_seen.e[i] -= by_inverse * seen.inverse;
        on_seen.z[m] += gx * seen.y[n] - gy * seen.x[n];
        on_seen.z[n] += gy * seen.x[m] - gx * seen.y[m];
        on_seen.y[n] += gx * seen.z[m];
        on_seen.y[m] -= gx * seen.z[n];
        on_seen.x[m] += gy * seen.z[n];
        on_seen.x[n] -= gy * seen.z[m];
    }
}

}  // namespace vig
