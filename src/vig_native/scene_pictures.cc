// Pictures: colours and masks at the points of each layer's grid, blended across occlusion edges, averaged over samples; the
// surface at pixels' centres; and the way back from both.
#include <limits>

#include "scene_sampler.h"
#include "threads.h"

namespace vig {
namespace {

// How a crossing blends its two points: `amount` of their difference goes to the one in whose half it lies. The edge runs
// from (u0, v0) to (u1, v1), u along the pair of points; near0 and near1: within a pixel of an end, or over the whole edge
// where that is shorter, the mean steepness of the silhouettes that meet there takes over.
template <class R> struct Blend {
    int first, second, target;
    R u0, v0, u1, v1, at, share, length, near0, near1, own, joint0, joint1, weight, amount;

    Blend(const Scenes<R>& scenes, const Layer<R>& layer, const Crossing& crossing) {
        const Silhouette& edge = layer.silhouettes[crossing.edge];
        const R scale = (R)scenes.samples;
        first = edge.first - scenes.objects[layer.begin].first_vertex;
        second = edge.second - scenes.objects[layer.begin].first_vertex;
        const Vec3<R> a = on_grid(scenes.points + 3 * (size_t)edge.first, scale, scenes.near);
        const Vec3<R> b = on_grid(scenes.points + 3 * (size_t)edge.second, scale, scenes.near);
        const int axis = crossing.axis;
        u0 = a[axis];
        v0 = a[1 - axis];
        u1 = b[axis];
        v1 = b[1 - axis];
        at = (crossing.line + R(0.5) - v0) / (v1 - v0);
        share = u0 + at * (u1 - u0) - R(0.5) - crossing.low;
        const Slope<R> slope(a, b);
        length = std::max(std::sqrt(slope.square), R(1));
        near0 = std::max(1 - at * length, R(0));
        near1 = std::max(1 - (1 - at) * length, R(0));
        own = slope.steep;
        joint0 = layer.joints[2 * (size_t)first];
        joint1 = layer.joints[2 * (size_t)second];
        const R steep = own + near0 * (joint0 - own) + near1 * (joint1 - own);
        weight = axis ? 1 - steep : steep;
        amount = weight * (R(0.5) - share) / crossing.sharers;
        target = share < R(0.5) ? crossing.here : crossing.there;
    }
};

// A layer's numbers on the grid: colours (grid, 3), then a plane of each mask.
template <class R> struct Planes {
    const Scenes<R>& scenes;
    std::vector<R> numbers;
    size_t grid;
    int colours, columns;

    explicit Planes(const Scenes<R>& of)
        : scenes(of), numbers(of.grid() * of.channels()), grid(of.grid()), colours(of.colours()), columns(of.grid_columns()) {}
    R& at(size_t point, int channel) {
        return numbers[channel < colours ? 3 * point + channel : channel * grid + point];
    }
    // Colours (3 numbers a point) or mask m of the first sample of row y, margin left out.
    R* colour_row(int y) { return &numbers[3 * first(y)]; }
    R* mask_row(int y, int mask) { return &numbers[(colours + mask) * grid + first(y)]; }

    // Means of the samples of one row of pixels, `step` numbers each.
    void reduce(const R* from, int step, R* to) const {
        const int samples = scenes.samples, count = scenes.width * step;
        if (samples == 1)
            std::copy(from, from + count, to);
        const R part = 1 / ((R)samples * (R)samples);
        for (int n = 0; n < count && samples > 1; ++n) {
            const R* const at = from + ((size_t)(n / step) * samples * step + n % step);
            R sum = 0;
            for (int j = 0; j < samples; ++j)
                for (int i = 0; i < samples; ++i)
                    sum += at[((size_t)j * columns + i) * step];
            to[n] = sum * part;
        }
    }
    // Cotangents on one row of pixels, added to those on their samples.
    void spread(const R* from, int step, R* to) const {
        const int samples = scenes.samples;
        const R part = 1 / ((R)samples * (R)samples);
        for (int n = 0; n < scenes.width * step && samples == 1; ++n)
            to[n] += from[n];
        for (int j = 0; j < samples && samples > 1; ++j)
            for (int x = 0; x < scenes.width; ++x)
                for (int i = 0; i < samples; ++i)
                    for (int c = 0; c < step; ++c)
                        to[((size_t)j * columns + x * samples + i) * step + c] += from[x * step + c] * part;
    }

  private:
    size_t first(int y) const { return ((size_t)y * scenes.samples + MARGIN) * columns + MARGIN; }
};

// Where the background's colour, or its cotangent, at a point of the grid lies; its border goes on in the margin.
template <class R, class N> N* background_at(const Scenes<R>& scenes, int layer, int row, int column, N* background) {
    if (!scenes.background_is_image)
        return background + 3 * (size_t)layer;
    const int y = std::min(std::max(row - MARGIN, 0) / scenes.samples, scenes.height - 1);
    const int x = std::min(std::max(column - MARGIN, 0) / scenes.samples, scenes.width - 1);
    return background + 3 * (((size_t)layer * scenes.height + y) * scenes.width + x);
}

}  // namespace

template <class R> void Scenes<R>::paint(Images<R> to, int threads) {
    layers.assign(starts.size() - 1, {});
    share_out(layers.size(), threads_for(layers.size() * grid(), threads), [&](size_t number) {
        find_layer((int)number, true);
        paint_layer((int)number, to);
    });
}

template <class R> void Scenes<R>::paint_layer(int number, Images<R> to) {
    Layer<R>& layer = layers[number];
    const int columns = grid_columns(), rows = grid_rows();
    Planes<R> picture(*this);
    const R* const behind = background ? background + 3 * (size_t)number : nullptr;
    const bool is_black = behind && !background_is_image && behind[0] == 0 && behind[1] == 0 && behind[2] == 0;
    for (size_t place = 0; place < grid() && is_mask; ++place)
        picture.at(place, 0) = layer.face[place] >= 0;
    for (int row = 0; row < rows && !is_mask && !is_black; ++row)
        for (int column = 0; column < columns; ++column)
            if (const size_t place = (size_t)row * columns + column; layer.face[place] < 0)
                store3(&picture.numbers[3 * place], load3(background_at(*this, number, row, column, background)));
    Sampler<R> sampler(*this, number);
    sampler.each(0, [&](size_t) { return !is_mask; }, [&](const Samples<R>& seen) {
        const Vec3<Lanes<R>> colour =
            by_channel(by_channel(sampler.mix(seen, 3).value, sampler.light(seen).value), sampler.texture(seen));
        for (int k = 0; k < seen.count; ++k) {
            store3(&picture.numbers[3 * seen.place[k]], lane<R>(colour, k));
            picture.at(seen.place[k], 3 + objects[seen.object].place) = 1;
        }
    });
    const int count = channels();
    layer.steps.reserve(layer.crossings.size() * count);
    for (const Crossing& crossing : layer.crossings)
        for (int c = 0; c < count; ++c)
            layer.steps.push_back(picture.at(crossing.there, c) - picture.at(crossing.here, c));
    for (size_t n = 0; n < layer.crossings.size(); ++n) {
        const Blend<R> blend(*this, layer, layer.crossings[n]);
        for (int c = 0; c < count; ++c)
            picture.at(blend.target, c) += blend.amount * layer.steps[n * count + c];
    }
    for (int y = 0; y < height; ++y) {
        const size_t at = ((size_t)number * height + y) * width;
        if (to.rgb)
            picture.reduce(picture.colour_row(y), 3, to.rgb + 3 * at);
        if (to.coverage)
            std::fill(to.coverage + at, to.coverage + at + width, R(0));
        for (int m = 0; m < masks; ++m) {
            R* const mask = to.visible + (((size_t)number * masks + m) * height + y) * width;
            picture.reduce(picture.mask_row(y, m), 1, mask);
            for (int x = 0; x < width && to.coverage; ++x)
                to.coverage[at + x] += mask[x];
        }
    }
}

template <class R>
void Scenes<R>::paint_back(Images<const R> on, R* on_points, R* on_attributes, R* on_background,
                           std::vector<LightCotangent>& on_lights, std::vector<Cotangents<R>>& on_inputs,
                           int threads) const {
    share_out(layers.size(), threads_for(layers.size() * grid(), threads), [&](size_t number) {
        paint_layer_back((int)number, on, on_points, on_attributes, on_background, on_lights, on_inputs);
    });
}

template <class R>
void Scenes<R>::paint_layer_back(int number, Images<const R> on, R* on_points, R* on_attributes, R* on_background,
                                 std::vector<LightCotangent>& on_lights, std::vector<Cotangents<R>>& on_inputs) const {
    const Layer<R>& layer = layers[number];
    const int columns = grid_columns(), rows = grid_rows(), count = channels();
    if (layer.begin == layer.end && !on_background)
        return;
    Planes<R> pulled(*this);
    for (int y = 0; y < height; ++y) {
        const size_t at = ((size_t)number * height + y) * width;
        if (on.rgb)
            pulled.spread(on.rgb + 3 * at, 3, pulled.colour_row(y));
        for (int m = 0; m < masks; ++m) {
            if (on.coverage)
                pulled.spread(on.coverage + at, 1, pulled.mask_row(y, m));
            if (on.visible)
                pulled.spread(on.visible + (((size_t)number * masks + m) * height + y) * width, 1, pulled.mask_row(y, m));
        }
    }
    // Cotangents on vertices' places on the grid, on the joints' mean steepness, and on the edges'.
    const size_t vertices = layer.joints.size() / 2;
    std::vector<R> on_places(2 * vertices), on_joints(vertices), on_steep(layer.silhouettes.size());
    // Amounts from the two points of each crossing to its target; added when all have been read.
    std::vector<R> given(layer.steps.size());
    for (size_t n = 0; n < layer.crossings.size(); ++n) {
        const Crossing& crossing = layer.crossings[n];
        const Blend<R> b(*this, layer, crossing);
        R on_amount = 0;
        for (int c = 0; c < count; ++c) {
            const R g = pulled.at(b.target, c);
            given[n * count + c] = b.amount * g;
            on_amount += g * layer.steps[n * count + c];
        }
        if (on_amount == 0)
            continue;
        on_amount /= crossing.sharers;
        const int axis = crossing.axis;
        const R on_weight = on_amount * (R(0.5) - b.share) * (axis ? -1 : 1), on_share = -on_amount * b.weight;
        const R on_near0 = b.near0 > 0 ? on_weight * (b.joint0 - b.own) : 0;
        const R on_near1 = b.near1 > 0 ? on_weight * (b.joint1 - b.own) : 0;
        on_steep[crossing.edge] += on_weight * (1 - b.near0 - b.near1);
        on_joints[b.first] += on_weight * b.near0;
        on_joints[b.second] += on_weight * b.near1;
        const R on_at = on_share * (b.u1 - b.u0) + b.length * (on_near1 - on_near0);
        const R on_length = -b.at * on_near0 - (1 - b.at) * on_near1;
        const R across = on_at / (b.v1 - b.v0);
        // The length is that of the edge; 1 where it is shorter.
        const R along_u = b.length > 1 ? on_length * (b.u1 - b.u0) / b.length : 0;
        const R along_v = b.length > 1 ? on_length * (b.v1 - b.v0) / b.length : 0;
        R *const to_first = &on_places[2 * (size_t)b.first], *const to_second = &on_places[2 * (size_t)b.second];
        to_first[axis] += on_share * (1 - b.at) - along_u;
        to_second[axis] += on_share * b.at + along_u;
        to_first[1 - axis] += across * (b.at - 1) - along_v;
        to_second[1 - axis] += along_v - across * b.at;
    }
    for (size_t n = 0; n < layer.crossings.size(); ++n)
        for (int c = 0; c < count; ++c) {
            pulled.at(layer.crossings[n].there, c) += given[n * count + c];
            pulled.at(layer.crossings[n].here, c) -= given[n * count + c];
        }
    const auto on_colour = [&](size_t place) { return load3(&pulled.numbers[3 * place]); };
    double behind[3] = {};
    for (int row = 0; row < rows && !is_mask && on_background; ++row)
        for (int column = 0; column < columns; ++column) {
            const size_t place = (size_t)row * columns + column;
            if (layer.face[place] >= 0)
                continue;
            if (background_is_image)
                add3(background_at(*this, number, row, column, on_background), on_colour(place));
            for (int c = 0; c < 3; ++c)
                behind[c] += on_colour(place)[c];
        }
    Sampler<R> sampler(*this, number, on_points, on_attributes, &on_inputs);
    const auto wanted = [&](size_t place) {
        const Vec3<R> g = on_colour(place);
        return g.x != 0 || g.y != 0 || g.z != 0;
    };
    sampler.each(0, [&](size_t place) { return !is_mask && wanted(place); }, [&](const Samples<R>& seen) {
        Vec3<Lanes<R>> g;
        for (int k = 0; k < LANES; ++k)
            set_lane(g, k, k < seen.count ? on_colour(seen.place[k]) : Vec3<R>{});
        SampleCotangent<R> on_seen;
        const Mixed<R> albedo = sampler.mix(seen, 3);
        const Lit<R> light = sampler.light(seen);
        const Vec3<Lanes<R>> texture = sampler.texture(seen);
        const auto times = [](Vec3<Lanes<R>> a, Vec3<Lanes<R>> b, Vec3<Lanes<R>> c) { return by_channel(by_channel(a, b), c); };
        sampler.pull_mix(seen, albedo, times(g, light.value, texture), on_seen);
        sampler.pull_light(seen, light, times(g, albedo.value, texture), on_seen, on_lights[seen.object]);
        sampler.pull_texture(seen, times(g, albedo.value, light.value), on_seen);
        sampler.pull(seen, on_seen);
    });
    for (int c = 0; c < 3 && on_background && !background_is_image; ++c)
        on_background[3 * (size_t)number + c] += (R)behind[c];
    if (vertices == 0)
        return;
    const int first_vertex = objects[layer.begin].first_vertex;
    const R scale = (R)samples;
    const auto screen_point = [&](size_t v) { return on_grid(points + 3 * (first_vertex + v), scale, near); };
    for (size_t e = 0; e < layer.silhouettes.size(); ++e) {
        const size_t ends[2] = {(size_t)(layer.silhouettes[e].first - first_vertex),
                                (size_t)(layer.silhouettes[e].second - first_vertex)};
        R g = on_steep[e];
        for (const size_t end : ends)
            g += on_joints[end] / layer.joints[2 * end + 1];
        if (g == 0)
            continue;
        const Slope<R> s(screen_point(ends[0]), screen_point(ends[1]));
        // Steepness is y^2 / (x^2 + y^2), the square of the length held above a least one.
        const R on_square = s.square > R(1e-12) ? -g * s.steep / s.square : 0;
        const R gx = 2 * s.x * on_square, gy = 2 * s.y * (g / s.square + on_square);
        on_places[2 * ends[0]] -= gx;
        on_places[2 * ends[0] + 1] -= gy;
        on_places[2 * ends[1]] += gx;
        on_places[2 * ends[1] + 1] += gy;
    }
    for (size_t v = 0; v < vertices; ++v) {
        const R gx = on_places[2 * v], gy = on_places[2 * v + 1];
        if (gx == 0 && gy == 0)
            continue;
        const Vec3<R> at = screen_point(v);
        add3(on_points + 3 * (first_vertex + v),
             Vec3<R>{gx * scale, gy * scale, -gx * (at.x - MARGIN) - gy * (at.y - MARGIN)} * at.z);
    }
}

template <class R> void Scenes<R>::surface(R* depth, R* normals, int32_t* object, int32_t* triangle) const {
    const size_t pixels = layers.size() * height * width;
    std::fill_n(depth, pixels, std::numeric_limits<R>::infinity());
    std::fill_n(normals, 3 * pixels, R(0));
    std::fill_n(object, pixels, -1);
    std::fill_n(triangle, pixels, -1);
    for (size_t number = 0; number < layers.size(); ++number) {
        Sampler<R> sampler(*this, (int)number);
        sampler.each(MARGIN, [](size_t) { return true; }, [&](const Samples<R>& seen) {
            Lanes<R> inverse;
            const Lanes<R> far = seen.w[0] * seen.z[0] + seen.w[1] * seen.z[1] + seen.w[2] * seen.z[2];
            const Vec3<Lanes<R>> normal = unit(sampler.mix(seen, 0).value, inverse);
            for (int k = 0; k < seen.count; ++k) {
                const size_t at = pixel(number, seen.place[k]);
                store3(normals + 3 * at, lane<R>(normal, k));
                depth[at] = far[k];
                object[at] = objects[seen.object].place;
                triangle[at] = seen.face[k];
            }
        });
    }
}

template <class R>
void Scenes<R>::surface_back(const R* on_depth, const R* on_normals, R* on_points, R* on_attributes) const {
    for (size_t number = 0; number < layers.size(); ++number) {
        Sampler<R> sampler(*this, (int)number, on_points, on_attributes);
        sampler.each(MARGIN, [](size_t) { return true; }, [&](const Samples<R>& seen) {
            SampleCotangent<R> on_seen;
            Vec3<Lanes<R>> on_normal = {};
            Lanes<R> on_far = {}, inverse;
            for (int k = 0; k < seen.count; ++k) {
                const size_t at = pixel(number, seen.place[k]);
                if (on_normals)
                    set_lane(on_normal, k, load3(on_normals + 3 * at));
                on_far[k] = on_depth ? on_depth[at] : 0;
            }
            const Mixed<R> mixed = sampler.mix(seen, 0);
            const Vec3<Lanes<R>> normal = unit(mixed.value, inverse);
            if (on_normals)
                sampler.pull_mix(seen, mixed, pull_unit(normal, inverse, on_normal), on_seen);
            for (int i = 0; i < 3; ++i) {
                on_seen.w[i] += on_far * seen.z[i];
                on_seen.z[i] = on_far * seen.w[i];
            }
            sampler.pull(seen, on_seen);
        });
    }
}

template class Scenes<VIG_REAL>;

}  // namespace vig
