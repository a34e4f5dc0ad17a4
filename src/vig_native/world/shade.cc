// Shades fragments: textures, light, gloss. They come sorted by the part of an asset that they belong to, so that LANES with
// the same material go side by side through vector registers.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "drawing.h"

namespace vig::world {
namespace {

constexpr float MIN_LIGHT = 0.1f;  // share of the irradiance that no shadow takes away
constexpr float MAX_LIGHT = 1.25f;  // largest ratio of a place's light to the object's, which may be in a dim corner
constexpr float EVEN = 0.6f;         // far from the object, this share of the irradiance is the mean of all directions; half at 1 m

#pragma GCC diagnostic ignored "-Wpsabi"  // vectors are returned by functions of this file alone, which are inlined
typedef float Eight __attribute__((vector_size(32)));
typedef int16_t EightStored __attribute__((vector_size(16), aligned(2), may_alias));

struct Rows {
    float x[LANES], y[LANES], z[LANES];
    Vec3<float> operator[](int n) const { return {x[n], y[n], z[n]}; }
    void set(int n, Vec3<float> v) {
        x[n] = v.x;
        y[n] = v.y;
        z[n] = v.z;
    }
};

// Irradiance lost at places in the grid's frame, for surfaces' normals.
void look_up(const Grid& grid, const Rows& places, const Rows& normals, float* lost) {
    const int X = grid.size[0], plane = X * grid.size[1];
    const float last_x = X - 1.001f, last_y = grid.size[1] - 1.001f, last_z = grid.size[2] - 1.001f;
    const float inverse = 1 / grid.cell;
    int cell[LANES];
    Rows share;
    for (int n = 0; n < LANES; ++n) {
        float x = (places.x[n] - grid.origin.x) * inverse, y = (places.y[n] - grid.origin.y) * inverse;
        float z = grid.plane_of(places.z[n] - grid.origin.z);
        x = x > 0 ? x : 0;
        y = y > 0 ? y : 0;
        x = x < last_x ? x : last_x;
        y = y < last_y ? y : last_y;
        z = z < last_z ? z : last_z;
        const int ix = (int)x, iy = (int)y, iz = (int)z;
        share.set(n, {x - ix, y - iy, z - iz});
        cell[n] = iz * plane + iy * X + ix;
    }
    // Values of two neighbours along x at a time.
    const auto mix = [](Eight a, Eight b, float share) { return a + share * (b - a); };
    Eight pairs[LANES];
    for (int n = 0; n < LANES; ++n) {
        const int16_t* const here = grid.values.data() + 4 * (size_t)cell[n];
        const auto pair = [&](int cells) { return __builtin_convertvector(*(const EightStored*)(here + 4 * cells), Eight); };
        pairs[n] = mix(mix(pair(0), pair(X), share.y[n]), mix(pair(plane), pair(plane + X), share.y[n]), share.z[n]);
    }
    const float(*const pair)[8] = (const float(*)[8])pairs;
    for (int n = 0; n < LANES; ++n) {
        const auto value = [&](int c) { return pair[n][c] + share.x[n] * (pair[n][4 + c] - pair[n][c]); };
        lost[n] = grid.scale * (value(0) + value(1) * normals.x[n] + value(2) * normals.y[n] + value(3) * normals.z[n]);
    }
}

// A texture's levels, and linear RGB of it: two taps along the longer axis of the pixel's footprint, bilinear, in the level
// in which half the longer axis or the shorter one is nearest to a texel.
struct Sampler {
    const Texture& texture;
    int deepest, starts[MAX_LEVELS];
    explicit Sampler(const Texture& t) : texture(t), deepest(std::min(t.log_width, t.log_height)) {
        for (int level = 0, at = 0; level <= deepest; ++level) {
            starts[level] = at;
            at += 1 << (t.log_width + t.log_height - 2 * level);
        }
    }
    // Texture coordinates, and how they change along a pixel's sides, in texels of the finest level.
    void sample(const float* u, const float* v, const float (*slopes)[LANES], Rows& colour) const {
        int index[8][LANES];
        float weight[8][LANES];
        for (int n = 0; n < LANES; ++n) {
            const float ux = slopes[0][n], uy = slopes[1][n], vx = slopes[2][n], vy = slopes[3][n];
            const float along_x = ux * ux + vx * vx, along_y = uy * uy + vy * vy;
            const bool x_longer = along_x > along_y;
            const float longer = x_longer ? along_x : along_y, shorter = x_longer ? along_y : along_x;
            // Two taps cover an anisotropy of up to 4 in area.
            const float doubled = 2 * (shorter > 0.25f * longer ? shorter : 0.25f * longer);
            int level;
            std::memcpy(&level, &doubled, sizeof level);
            level = ((level >> 23) - 127) >> 1;  // round(log2(sqrt(footprint)))
            level = level > 0 ? level : 0;
            level = level < deepest ? level : deepest;
            const int width = 1 << (texture.log_width - level), height = 1 << (texture.log_height - level);
            // Row 0 is the texture's upper edge, where v = 1.
            const float x = u[n] * texture.repeats * width, y = texture.repeats * (1 - v[n]) * height;
            const float half = 0.25f / (1 << level), dx = half * (x_longer ? ux : uy), dy = -half * (x_longer ? vx : vy);
            const int first = starts[level];
#pragma GCC unroll 2
            for (int tap = 0; tap < 2; ++tap) {
                const float at_x = (tap ? x + dx : x - dx) - 0.5f, at_y = (tap ? y + dy : y - dy) - 0.5f;
                const float left = std::floor(at_x), top = std::floor(at_y), fx = at_x - left, fy = at_y - top;
                const int x0 = (int)left & (width - 1), x1 = ((int)left + 1) & (width - 1);
                const int y0 = ((int)top & (height - 1)) * width, y1 = (((int)top + 1) & (height - 1)) * width;
                index[4 * tap][n] = first + y0 + x0;
                index[4 * tap + 1][n] = first + y0 + x1;
                index[4 * tap + 2][n] = first + y1 + x0;
                index[4 * tap + 3][n] = first + y1 + x1;
                const float share = 0.5f / (255 * 255);
                weight[4 * tap][n] = share * (1 - fx) * (1 - fy);
                weight[4 * tap + 1][n] = share * fx * (1 - fy);
                weight[4 * tap + 2][n] = share * (1 - fx) * fy;
                weight[4 * tap + 3][n] = share * fx * fy;
            }
        }
        for (int n = 0; n < LANES; ++n)
            colour.set(n, {0, 0, 0});
        for (int corner = 0; corner < 8; ++corner)
            for (int n = 0; n < LANES; ++n) {
                const uint32_t texel = texture.texels[index[corner][n]];
                const float r = (int)(texel & 255), g = (int)(texel >> 8 & 255), b = (int)(texel >> 16 & 255);
                colour.x[n] += weight[corner][n] * r * r;
                colour.y[n] += weight[corner][n] * g * g;
                colour.z[n] += weight[corner][n] * b * b;
            }
    }
};

}  // namespace

void Drawing::shade(const Light& light, const Grid& shadow) {
    for (int range = 0, start = 0; range < (int)ranges_.size(); start = ends_[range++])
        if (ends_[range] > start)
            shade_range(range, sorted_.data() + start, ends_[range] - start, light, shadow);
}

void Drawing::shade_range(int number, const int* sorted, int total, const Light& light, const Grid& shadow) {
    const Part& part = *ranges_[number].part;
    const Item& item = items_[ranges_[number].item];
    const Asset& asset = *item.asset;
    const Mat3<float> R = to_single(item.rotation), camera = to_single(camera_.rotation);
    const Vec3<double> from = camera_.eye();
    const Vec3<float> eye = {(float)from.x, (float)from.y, (float)from.z};
    const Vec3<float> origin = {(float)item.translation.x, (float)item.translation.y, (float)item.translation.z};
    const float inverse_focal = 1 / (float)camera_.focal, mid_x = camera_.cx, mid_y = camera_.cy;
    const bool finished = part.slot >= 0 && part.slot < (int)item.finishes.size() && item.finishes[part.slot].texels;
    const Sampler sampler(finished ? item.finishes[part.slot] : part.texture);
    const float texture_width = sampler.texture.repeats * (1 << sampler.texture.log_width);
    const float texture_height = sampler.texture.repeats * (1 << sampler.texture.log_height);
    const Grid& ambient = asset.ambient;
    const bool occluded = ambient.size[0] > 0;
    float reference = 1;
    if (occluded) {
        // The light is that at the object, its own ambient occlusion included: occlusion elsewhere is relative to
        // that. At least 0.3 of the light is assumed to be left there, which bounds the ratio.
        Rows place, normal;
        float lost[LANES];
        for (int n = 0; n < LANES; ++n) {
            place.set(n, R.transposed(Vec3<float>{0, 0, 1.25f * ambient.cell} - origin));
            normal.set(n, R.row[2]);
        }
        look_up(ambient, place, normal, lost);
        reference = lost[0] < 0 ? 1 : 1 / std::max(1 - lost[0], 0.3f);
    }
    // A highlight's exponent 2^sharpness, of a Blinn-Phong lobe as wide as the roughness, from 8 to 128.
    int sharpness = 3;
    const float lobe_width = part.roughness * part.roughness;
    while (sharpness < 7 && lobe_width * lobe_width * (1 << sharpness) < 1)
        ++sharpness;
    const float glint = light.highlight * ((1 << sharpness) + 1);
    const float smooth = (1 - part.roughness) * (1 - part.roughness);

    for (int base = 0; base < total; base += LANES) {
        const int count = std::min(total - base, LANES);
        int pixel[LANES];
        float share[LANES], px[LANES], py[LANES], z[LANES], slopes[4][LANES];
        float at[ATTRIBUTES][LANES];
        Vertex corners[3][LANES];
        for (int n = 0; n < LANES; ++n) {
            const Fragment& fragment = fragments_[sorted[base + (n < count ? n : 0)]];
            pixel[n] = fragment.pixel;
            share[n] = fragment.share;
            px[n] = fragment.x;
            py[n] = fragment.y;
            for (int m = 0; m < 3; ++m)
                corners[m][n] = vertices_[corners_[3 * (size_t)fragment.face + m]];
        }
        for (int n = 0; n < LANES; ++n) {
            const Vertex &a = corners[0][n], &b = corners[1][n], &c = corners[2][n];
            const float bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
            const float inverse = 1 / (bx * cy - by * cx), off_x = px[n] - a.x, off_y = py[n] - a.y;
            const float bdx = cy * inverse, bdy = -cx * inverse, cdx = -by * inverse, cdy = bx * inverse;
            const float to_b = bdx * off_x + bdy * off_y, to_c = cdx * off_x + cdy * off_y;
            const float b_more = b.q - a.q, c_more = c.q - a.q, depth = 1 / (a.q + to_b * b_more + to_c * c_more);
            const float wb = to_b * b.q * depth, wc = to_c * c.q * depth;
#pragma GCC unroll 5
            for (int r = 0; r < ATTRIBUTES; ++r)
                at[r][n] = a.attributes[r] + wb * (b.attributes[r] - a.attributes[r]) + wc * (c.attributes[r] - a.attributes[r]);
            // How the weights change over the screen, and with them the place in the texture, in texels.
            const float qdx = bdx * b_more + cdx * c_more, qdy = bdy * b_more + cdy * c_more, scale = depth * SAMPLES;
            const float wbdx = scale * (bdx * b.q - wb * qdx), wbdy = scale * (bdy * b.q - wb * qdy);
            const float wcdx = scale * (cdx * c.q - wc * qdx), wcdy = scale * (cdy * c.q - wc * qdy);
            const float ub = b.attributes[3] - a.attributes[3], uc = c.attributes[3] - a.attributes[3];
            const float vb = b.attributes[4] - a.attributes[4], vc = c.attributes[4] - a.attributes[4];
            z[n] = depth;
            slopes[0][n] = (wbdx * ub + wcdx * uc) * texture_width;
            slopes[1][n] = (wbdy * ub + wcdy * uc) * texture_width;
            slopes[2][n] = (wbdx * vb + wcdx * vc) * texture_height;
            slopes[3][n] = (wbdy * vb + wcdy * vc) * texture_height;
        }
        Rows colour;
        if (item.is_target)
            for (int n = 0; n < LANES; ++n)
                colour.set(n, light.albedo * at[3][n]);
        else {
            sampler.sample(at[3], at[4], slopes, colour);
            // Where the fragment is and how its surface is turned, in the world, and the direction that it mirrors.
            Rows place, normal, mirrored, from;
            float facing[LANES], full[LANES], left[LANES], lost[LANES], lobe[LANES];
            for (int n = 0; n < LANES; ++n) {
                const Vec3<float> ray = camera.transposed(
                    Vec3<float>{(px[n] - mid_x) * inverse_focal, (py[n] - mid_y) * inverse_focal, 1});
                const Vec3<float> here = eye + ray * z[n], own = {at[0][n], at[1][n], at[2][n]};
                // 1e-12: a degenerate normal stays finite.
                const Vec3<float> up = (R * own) * (1 / std::sqrt(dot(own, own) + 1e-12f));
                place.set(n, here);
                normal.set(n, up);
                const float length = 1 / std::sqrt(dot(ray, ray)), away = dot(up, ray) * length;
                facing[n] = away < 0 ? -away : 0;
                mirrored.set(n, ray * length - up * (2 * away));
                const float irradiance = polynomial(light.irradiance, up), square = dot(here, here);
                // Further away the light differs from the object's, and is taken to be more even.
                full[n] = irradiance > 0 ? irradiance : 0;
                full[n] += EVEN * square / (square + 1) * (light.irradiance[0] - full[n]);
                left[n] = 1;
            }
            if (occluded) {
                // In the asset's frame, far enough off the surface not to look up the surface's own cells.
                Rows turned;
                for (int n = 0; n < LANES; ++n) {
                    turned.set(n, R.transposed(normal[n]));
                    from.set(n, R.transposed(place[n] - origin) + turned[n] * (1.25f * ambient.cell));
                }
                look_up(ambient, from, turned, lost);
                for (int n = 0; n < LANES; ++n)
                    left[n] = reference * (1 - (lost[n] > 0 ? lost[n] : 0));
            }
            // Props cast shadows: start outside the cells that they fill themselves.
            const float ahead = item.is_support ? 0 : 1.2f * shadow.cell, reach = shadow.origin.x * shadow.origin.x;
            int within = 0;
            for (int n = 0; n < LANES; ++n) {
                from.set(n, place[n] + normal[n] * ahead);
                within |= (place.z[n] > -GROUND_DEPTH) & (from.x[n] * from.x[n] < reach) & (from.y[n] * from.y[n] < reach);
            }
            if (within) {
                look_up(shadow, from, normal, lost);
                for (int n = 0; n < LANES; ++n) {
                    const float taken = (place.z[n] > -GROUND_DEPTH) & (lost[n] > 0) ? lost[n] : 0;
                    left[n] *= 1 - taken / (full[n] + 1e-6f);  // 1e-6: a dark side loses nothing of 0
                }
            }
            for (int n = 0; n < LANES; ++n) {
                const float towards = dot(mirrored[n], light.sun);
                lobe[n] = towards > 0 ? towards : 0;
            }
            for (int doubling = 0; doubling < sharpness; ++doubling)
                for (int n = 0; n < LANES; ++n)
                    lobe[n] *= lobe[n];
            for (int n = 0; n < LANES; ++n) {
                const float least = left[n] > MIN_LIGHT ? left[n] : MIN_LIGHT, open = least < MAX_LIGHT ? least : MAX_LIGHT;
                const float arriving = polynomial(light.radiance, mirrored[n]);
                const float graze = 1 - facing[n], graze2 = graze * graze;
                const float fresnel = part.mirror + (1 - part.mirror) * smooth * graze2 * graze2 * graze;
                const float gloss = open * ((arriving > 0 ? arriving : 0) + glint * lobe[n]);
                const float diffuse = (1 - part.metal) * open * full[n] + part.emission + part.metal * gloss;
                colour.x[n] = colour.x[n] * diffuse + fresnel * gloss;
                colour.y[n] = colour.y[n] * diffuse + fresnel * gloss;
                colour.z[n] = colour.z[n] * diffuse + fresnel * gloss;
            }
        }
        for (int n = 0; n < count; ++n) {
            const auto shown = [&](float value) { return share[n] * std::min(std::max(value, 0.0f), 1.0f); };
            add3(&linear_[3 * pixel[n]], {shown(colour.x[n]), shown(colour.y[n]), shown(colour.z[n])});
        }
    }
}

}  // namespace vig::world
