// From samples to fragments, and the contents of pixels besides light.
#include <algorithm>
#include <cmath>

#include "drawing.h"

namespace vig::world {

SurfacePoint Drawing::interpolate(int face, float x, float y) const {
    const int32_t* const corner = &corners_[3 * (size_t)face];
    const Vertex &a = vertices_[corner[0]], &b = vertices_[corner[1]], &c = vertices_[corner[2]];
    const float bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
    const float inverse = 1 / (bx * cy - by * cx), off_x = x - a.x, off_y = y - a.y;
    const float to_b = (cy * off_x - cx * off_y) * inverse, to_c = (bx * off_y - by * off_x) * inverse;
    const float z = 1 / (a.q + to_b * (b.q - a.q) + to_c * (c.q - a.q));
    return {z, to_b * b.q * z, to_c * c.q * z};
}

void Drawing::collect(float* depth, uint8_t* seen, uint8_t* support) {
    const int W = camera_.width, columns = W / SAMPLES, rows = camera_.height / SAMPLES;
    const int32_t* const face_image = seen_.face.data();
    const float* const q_image = seen_.q.data();
    Fragment* const fragments = grow(fragments_, (size_t)W * camera_.height);
    ends_.assign(ranges_.size() + 1, 0);
    linear_.assign(3 * (size_t)columns * rows, 0);
    int count = 0, range = 0;
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            const int pixel = row * columns + column, corner = (row * W + column) * SAMPLES;
            int faces[PIXEL_SAMPLES];
            float nearest = 0;
            for (int n = 0; n < PIXEL_SAMPLES; ++n) {
                const int at = corner + n / SAMPLES * W + n % SAMPLES;
                faces[n] = face_image[at];
                nearest = std::max(nearest, q_image[at]);
            }
            depth[pixel] = 1 / nearest;
            seen[pixel] = support[pixel] = 0;
            const auto add = [&](int face, int same, float x, float y) {
                range = range_of(face, range);
                ++ends_[range + 1];
                const Item& item = items_[ranges_[range].item];
                seen[pixel] += item.is_target ? same : 0;
                support[pixel] += item.is_support ? same : 0;
                fragments[count++] = {face, pixel, range, column * SAMPLES + x, row * SAMPLES + y,
                                      (float)same / PIXEL_SAMPLES};
            };
            if (std::all_of(faces + 1, faces + PIXEL_SAMPLES, [&](int face) { return face == faces[0]; })) {
                if (faces[0] >= 0)  // one face, as in most pixels
                    add(faces[0], PIXEL_SAMPLES, 0.5f * SAMPLES, 0.5f * SAMPLES);
                continue;
            }
            for (int a = 0; a < PIXEL_SAMPLES; ++a) {
                const int face = faces[a];
                if (face < 0)
                    continue;
                int same = 0, sum_x = 0, sum_y = 0;
                for (int b = a; b < PIXEL_SAMPLES; ++b)
                    if (faces[b] == face) {
                        ++same;
                        sum_x += b % SAMPLES;
                        sum_y += b / SAMPLES;
                        faces[b] = NO_FACE;
                    }
                const float less = 1.0f / same;
                add(face, same, 0.5f + sum_x * less, 0.5f + sum_y * less);
            }
        }
    // A counting sort by range.
    for (size_t n = 1; n < ends_.size(); ++n)
        ends_[n] += ends_[n - 1];
    int* const sorted = grow(sorted_, count);
    for (int n = 0; n < count; ++n)
        sorted[ends_[fragments[n].range]++] = n;
}

void Drawing::surface(const uint8_t* seen, Surface& to) const {
    const int W = camera_.width, columns = W / SAMPLES;
    const Vec3<double> eye = camera_.eye();
    int range = 0;
    for (int pixel = 0; pixel < columns * (camera_.height / SAMPLES); ++pixel)
        for (int n = 0; n < PIXEL_SAMPLES && seen[pixel]; ++n) {
            const int x = pixel % columns * SAMPLES + n % SAMPLES, y = pixel / columns * SAMPLES + n / SAMPLES;
            const int face = seen_.face[y * W + x];
            if (face < 0 || !items_[ranges_[range = range_of(face, range)].item].is_target)
                continue;
            const SurfacePoint at = interpolate(face, x + 0.5f, y + 0.5f);
            const Vec3<double> ray = {(x + 0.5 - camera_.cx) / camera_.focal, (y + 0.5 - camera_.cy) / camera_.focal, 1};
            const Vec3<double> place = eye + camera_.rotation.transposed(ray) * (double)at.z;
            const int32_t* const corner = &corners_[3 * (size_t)face];
            float mixed[4];
            for (int a = 0; a < 4; ++a)
                mixed[a] = (1 - at.b - at.c) * vertices_[corner[0]].attributes[a] + at.b * vertices_[corner[1]].attributes[a]
                    + at.c * vertices_[corner[2]].attributes[a];
            to.points.insert(to.points.end(), {(float)place.x, (float)place.y, (float)place.z});
            to.normals.insert(to.normals.end(), mixed, mixed + 3);
            to.irradiance.push_back(mixed[3]);
            to.vertices.push_back((int32_t)vertices_[corner[0]].attributes[4]);
            to.pixels.push_back(pixel);
        }
}

void Drawing::add_colours(const Surface& samples, const float* colours, const uint8_t* seen) {
    const size_t count = samples.pixels.size();
    for (size_t start = 0, end = 0; start < count; start = end) {
        const int pixel = samples.pixels[start];
        float sums[3] = {0, 0, 0};
        for (; end < count && samples.pixels[end] == pixel; ++end)
            add3(sums, load3(colours + 3 * end));
        for (int channel = 0; channel < 3; ++channel)
            linear_[3 * pixel + channel] += std::clamp(sums[channel], 0.0f, (float)seen[pixel]) / PIXEL_SAMPLES;
    }
}

// They are interpolated between vertices, as for shading; where that is nothing, or turned away from the face's own side,
// the face's own.
void Drawing::normals(float* to) const {
    const int W = camera_.width, columns = W / SAMPLES;
    const float f = camera_.focal;
    int range = 0;
    for (int pixel = 0; pixel < columns * (camera_.height / SAMPLES); ++pixel, to += 3) {
        to[0] = to[1] = to[2] = 0;
        int best = 0;
        float nearest = 0;
        for (int n = 0; n < PIXEL_SAMPLES; ++n) {
            const int at = (pixel / columns * SAMPLES + n / SAMPLES) * W + pixel % columns * SAMPLES + n % SAMPLES;
            best = seen_.q[at] > nearest ? at : best;
            nearest = std::max(nearest, seen_.q[at]);
        }
        if (!(nearest > 0))
            continue;
        const int face = seen_.face[best];
        const int32_t* const corner = &corners_[3 * (size_t)face];
        const SurfacePoint at = interpolate(face, best % W + 0.5f, best / W + 0.5f);
        // The face's own: across two of its edges, in the camera's frame.
        Vec3<float> ends[3], normal[3];
        for (int m = 0; m < 3; ++m) {
            const Vertex& v = vertices_[corner[m]];
            ends[m] = Vec3<float>{(v.x - (float)camera_.cx) / f, (v.y - (float)camera_.cy) / f, 1} * (1 / v.q);
            normal[m] = load3(v.attributes);
        }
        const Vec3<float> flat = cross(ends[1] - ends[0], ends[2] - ends[0]);
        const Vec3<float> mixed = normal[0] + (normal[1] - normal[0]) * at.b + (normal[2] - normal[0]) * at.c;
        const Item& item = items_[ranges_[range = range_of(face, range)].item];
        const Vec3<float> seen = to_single(camera_.rotation) * (to_single(item.rotation) * mixed);
        const bool interpolated = dot(seen, seen) > 1e-12f && dot(seen, flat) > 0;
        const Vec3<float> chosen = interpolated ? seen : flat;
        store3(to, chosen * (1 / std::sqrt(dot(chosen, chosen))));
    }
}

// The lower bound of each level of 8-bit sRGB, and the level of the lower edge of each bin of linear light, narrower than one.
static const struct Levels {
    static constexpr int BINS = 4096;
    float bounds[257];
    uint8_t levels[BINS + 1];
    Levels() {
        for (int level = 0; level < 257; ++level) {
            const double encoded = (level - 0.5) / 255;
            bounds[level] = encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
        }
        bounds[0] = 0;
        bounds[256] = INFINITY;
        for (int bin = 0; bin <= BINS; ++bin)
            levels[bin] = uint8_t(std::upper_bound(bounds, bounds + 257, (float)bin / BINS) - bounds - 1);
    }
} LEVELS;

uint8_t encode_srgb(float linear) {
    const float value = linear < 1 ? linear > 0 ? linear : 0 : 1;
    const int level = LEVELS.levels[(int)(value * Levels::BINS)];
    return uint8_t(level + (value >= LEVELS.bounds[level + 1]));
}

void Drawing::encode(uint8_t* image) const {
    for (size_t n = 0; n < linear_.size(); ++n)
        image[n] = encode_srgb(linear_[n]);
}

}  // namespace vig::world
