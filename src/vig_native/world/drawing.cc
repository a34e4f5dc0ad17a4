// From items to samples: clusters of faces outside the frame are skipped, faces that reach behind the camera are cut at
// the near plane, and all others are drawn together.
#include "drawing.h"

#include <algorithm>
#include <limits>

namespace vig::world {
namespace {

// Whether a sphere, turned and shifted into the camera's frame, is ahead of the near plane and not beyond a side.
bool in_frame(const Sphere& sphere, const Mat3<float>& turn, Vec3<float> shift, const Camera& camera) {
    const Vec3<float> p = turn * sphere.centre + shift;
    if (!(p.z + sphere.radius > (float)camera.near))
        return false;
    const float f = camera.focal, mid_x = camera.cx, mid_y = camera.cy;
    const float ends[4] = {mid_x, camera.width - mid_x, mid_y, camera.height - mid_y};
    for (int side = 0; side < 4; ++side) {
        const float along = side < 2 ? p.x : p.y;
        const float beyond = f * (side & 1 ? along : -along) - ends[side] * p.z;
        if (beyond > 0 && beyond * beyond > sphere.radius * sphere.radius * (f * f + ends[side] * ends[side]))
            return false;
    }
    return true;
}

Vertex vertex_of(const float* a, const float* screen) {
    return {{a[0], a[1], a[2], a[3], a[4]}, screen[0], screen[1], screen[2]};
}

}  // namespace

// Cut a face at the near plane: its triangles go to `cut_`, their corners to the end of the vertices.
void Drawing::clip(const Asset& asset, const int32_t* corner, bool shaded) {
    constexpr int N = 3 + ATTRIBUTES;
    const float near = camera_.near, f = camera_.focal, mid_x = camera_.cx, mid_y = camera_.cy;
    float in[3][N], out[4][N];
    int count = 0;
    for (int m = 0; m < 3; ++m) {
        const int v = corner[m], V = asset.vertices;
        const float* const p = asset.positions.data();
        store3(in[m], turn_ * Vec3<float>{p[v], p[V + v], p[2 * V + v]} + shift_);
        std::copy_n(&asset.attributes[ATTRIBUTES * (size_t)v], ATTRIBUTES, in[m] + 3);
    }
    for (int m = 0; m < 3; ++m) {
        const float* const here = in[m];
        const float* const next = in[(m + 1) % 3];
        const float ahead = here[2] - near, then = next[2] - near;
        if (ahead >= 0)
            std::copy_n(here, N, out[count++]);
        if ((ahead >= 0) != (then >= 0)) {
            for (int a = 0; a < N; ++a)
                out[count][a] = here[a] + ahead / (ahead - then) * (next[a] - here[a]);
            ++count;
        }
    }
    float* const screen = grow(screen_, 3 * (vertex_count_ + 4)) + 3 * vertex_count_;
    for (int m = 0; m < count; ++m) {
        const float q = 1 / out[m][2];
        store3(screen + 3 * m, {f * out[m][0] * q + mid_x, f * out[m][1] * q + mid_y, q});
        if (shaded)
            grow(vertices_, vertex_count_ + 4)[vertex_count_ + m] = vertex_of(out[m] + 3, screen + 3 * m);
    }
    for (int m = 1; m + 1 < count; ++m) {
        // From the farthest corner, as the near ones may lie far outside the image: small triangles stay exact.
        int order[3] = {0, m, m + 1};
        while (screen[3 * order[0] + 2] > std::min(screen[3 * order[1] + 2], screen[3 * order[2] + 2]))
            std::rotate(order, order + 1, order + 3);
        for (const int each : order)
            cut_.push_back(vertex_count_ + each);
    }
    vertex_count_ += count;
}

void Drawing::add_part(const Item& item, const Part& part, bool shaded) {
    const Asset& asset = *item.asset;
    const float near = camera_.near, f = camera_.focal, mid_x = camera_.cx, mid_y = camera_.cy;
    const Mat3<float> R = turn_;
    const Vec3<float> T = shift_;
    const int number = int(&item - items_.data());
    ranges_.push_back({corner_count_ / 3, number, &part});
    cut_.clear();
    for (int c = part.first_cluster; c < part.end_cluster; ++c) {
        const Cluster& cluster = asset.clusters[c];
        if (!in_frame(cluster.sphere, R, T, camera_))
            continue;
        const int count = cluster.end_vertex - cluster.first_vertex;
        const float* const px = asset.positions.data() + cluster.first_vertex;
        const float* const py = px + asset.vertices;
        const float* const pz = py + asset.vertices;
        float* const screen = grow(screen_, 3 * ((size_t)vertex_count_ + count)) + 3 * (size_t)vertex_count_;
        float nearest = std::numeric_limits<float>::max();
        for (int v = 0; v < count; ++v) {
            const float x = R.row[0].x * px[v] + R.row[0].y * py[v] + R.row[0].z * pz[v] + T.x;
            const float y = R.row[1].x * px[v] + R.row[1].y * py[v] + R.row[1].z * pz[v] + T.y;
            const float z = R.row[2].x * px[v] + R.row[2].y * py[v] + R.row[2].z * pz[v] + T.z;
            const float q = z > near ? 1 / z : 0;
            nearest = nearest < q ? nearest : q;  // 0 where a vertex is behind the near plane
            screen[3 * v] = f * x * q + mid_x;
            screen[3 * v + 1] = f * y * q + mid_y;
            screen[3 * v + 2] = q;
        }
        if (shaded) {
            Vertex* const vertices = grow(vertices_, (size_t)vertex_count_ + count) + vertex_count_;
            const float* const attributes = &asset.attributes[ATTRIBUTES * (size_t)cluster.first_vertex];
            for (int v = 0; v < count; ++v)
                vertices[v] = vertex_of(attributes + ATTRIBUTES * v, screen + 3 * v);
        }
        const int corners = 3 * (cluster.end_face - cluster.first_face), base = vertex_count_ - cluster.first_vertex;
        const int32_t* const from = &asset.corners[3 * (size_t)cluster.first_face];
        int32_t* const to = grow(corners_, (size_t)corner_count_ + corners) + corner_count_;
        for (int n = 0; n < corners; ++n)
            to[n] = from[n] + base;
        corner_count_ += corners;
        vertex_count_ += count;
        for (int n = 0; n < corners && !(nearest > 0); n += 3) {
            int ahead = 0;
            for (int m = 0; m < 3; ++m)
                ahead += screen_[3 * (size_t)to[n + m] + 2] > 0;
            if (ahead == 1 || ahead == 2)
                clip(asset, from + n, shaded);
        }
    }
    if (!cut_.empty()) {
        ranges_.push_back({corner_count_ / 3, number, &part});
        std::copy(cut_.begin(), cut_.end(), grow(corners_, corner_count_ + cut_.size()) + corner_count_);
        corner_count_ += (int)cut_.size();
    }
}

void Drawing::rasterise(const std::vector<Item>& items, const Camera& camera, int samples, bool shaded) {
    camera_ = camera.sampled(samples);
    items_ = items;
    ranges_.clear();
    vertex_count_ = corner_count_ = 0;
    for (const Item& item : items_) {
        Mat3<double> turn;
        for (int r = 0; r < 3; ++r)
            turn.row[r] = item.rotation.transposed(camera_.rotation.row[r]);
        turn_ = to_single(turn);
        const Vec3<double> shift = camera_.rotation * item.translation + camera_.translation;
        shift_ = {(float)shift.x, (float)shift.y, (float)shift.z};
        if (in_frame(item.asset->sphere, turn_, shift_, camera_))
            for (const Part& part : item.asset->parts)
                if (in_frame(part.sphere, turn_, shift_, camera_))
                    add_part(item, part, shaded);
    }
    const int faces = corner_count_ / 3;
    seen_.clear(camera_.width * camera_.height);
    draw_faces(screen_.data(), corners_.data(), faces, camera_.width, camera_.height, true, seen_, grow(facing_, faces));
}

// The range that holds a face; `last`: where it is looked for first.
int Drawing::range_of(int face, int last) const {
    const auto fits = [&](int n) {
        return ranges_[n].first <= face && (n + 1 == (int)ranges_.size() || face < ranges_[n + 1].first);
    };
    if (fits(last))
        return last;
    return int(std::upper_bound(ranges_.begin(), ranges_.end(), face, [](int f, const Range& r) { return f < r.first; })
               - ranges_.begin()) - 1;
}

void Drawing::depth(float* far, int32_t* owner) const {
    int range = 0;
    for (int n = 0; n < camera_.width * camera_.height; ++n) {
        far[n] = 1 / seen_.q[n];
        const int face = seen_.face[n];
        if (owner)
            owner[n] = face < 0 ? -1 : items_[ranges_[range = range_of(face, range)].item].owner;
    }
}

void Drawing::silhouette(const Item& target, const Camera& camera, bool* mask) {
    // The rows and columns that can show it: others cost nothing.
    const float* const p = target.asset->positions.data();
    const int V = target.asset->vertices;
    double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9};
    for (int v = 0; v < V; ++v) {
        const Vec3<double> at = camera.rotation * Vec3<double>{p[v], p[V + v], p[2 * V + v]} + camera.translation;
        for (int axis = 0; axis < 2; ++axis) {
            const double pixel = camera.focal * at[axis] / std::max(at.z, camera.near) + (axis ? camera.cy : camera.cx);
            low[axis] = std::min(low[axis], pixel);
            high[axis] = std::max(high[axis], pixel);
        }
    }
    std::fill_n(mask, (size_t)camera.width * camera.height, false);
    const int left = (int)std::clamp(low[0] - 1, 0.0, (double)camera.width);
    const int right = (int)std::clamp(high[0] + 2, 0.0, (double)camera.width);
    const int top = (int)std::clamp(low[1] - 1, 0.0, (double)camera.height);
    const int bottom = (int)std::clamp(high[1] + 2, 0.0, (double)camera.height);
    if (left >= right || top >= bottom)
        return;
    Camera window = camera;
    window.cx -= left;
    window.cy -= top;
    window.width = right - left;
    window.height = bottom - top;
    rasterise({target}, window, SAMPLES, false);
    const int W = camera_.width;
    for (int row = top; row < bottom; ++row)
        for (int column = left; column < right; ++column) {
            int count = 0;
            for (int n = 0; n < PIXEL_SAMPLES; ++n)
                count += seen_.face[((row - top) * SAMPLES + n / SAMPLES) * W + (column - left) * SAMPLES + n % SAMPLES] >= 0;
            mask[(size_t)row * camera.width + column] = 2 * count >= PIXEL_SAMPLES;
        }
}

double Drawing::hidden(const int64_t* samples, const float* own, const uint8_t* already, int count) const {
    int hidden = 0;
    for (int n = 0; n < count; ++n)
        hidden += already[n] | (1 / seen_.q[samples[n]] < own[n]);
    return (double)hidden / count;
}

}  // namespace vig::world
