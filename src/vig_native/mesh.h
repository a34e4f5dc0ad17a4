// A shape model made ready for evaluation, and the camera and layout of points that go with it.
#pragma once
#include <vector>

#include "vectors.h"

namespace vig {

constexpr int LOBES = 9;  // coefficients of the light's spherical harmonics

// Places of a point's blocks, latents and framing, in a vector of `size` numbers.
struct PointLayout {
    int size, shape, modes, azimuth, elevation, albedo, light, framing;
};

// Mesh, shape components and surface of a class. V vertices, F faces, E edges, K modes, W = K padded to LANES.
template <class R> struct Geometry {
    int vertices, faces, edges, modes, width;
    PointLayout layout;
    std::vector<R> positions;          // (V / LANES, K + 1, 3, LANES) mean and components, vertices side by side
    std::vector<R> basis;              // (V, 3, W) the components again, a row for each vertex and axis
    std::vector<int32_t> corners;      // (F, 3)
    std::vector<int32_t> edge_table;   // (E, 5) vertex a, vertex b, face, face beyond, corner beyond
    std::vector<int32_t> ring_start;   // (V + 1,)
    std::vector<int32_t> ring;         // (R, 3) neighbour, next, previous
    int largest_ring;
    std::vector<R> reflectance;        // (V,)
    bool shadowed;                     // whether there is a transfer
    std::vector<R> transfer_mean;      // (V, REST) in a row's columns: change of the lobes A_l Y_lm by self-shadowing, mean
    std::vector<R> transfer_by_shape;  // (V, LOBES, W) and for each component
};

// A camera before the framing of a point: focal length and principal point in pixels, metres.
struct Camera {
    double focal, cx, cy, target_height, distance;
    int width, height;
};

// The camera of one point: camera_from_world rotation, cosine and sine of the roll, intrinsics in pixels.
template <class R> struct Eye {
    Mat3<R> rotation;
    Vec2<R> level;
    R focal, cx, cy, distance, target_height;
    int width, height;
};

template <class R> Eye<R> eye_of(const R* point, const PointLayout& layout, const Camera& camera);

// Points on the screen are (x, y, q): pixel coordinates and one over the depth; T is R, or LANES of them side by side.

// Where a point on the screen is in the camera's frame, metres.
template <class R, class T> Vec3<T> camera_point(const Eye<R>& eye, Vec3<T> screen) {
    const T depth = 1 / screen.z, scale = depth / eye.focal;
    return {(screen.x - eye.cx) * scale, (screen.y - eye.cy) * scale, depth};
}

// Pull a cotangent on (x, y, q) back to the camera's frame.
template <class R, class T> Vec3<T> camera_cotangent(const Eye<R>& eye, Vec3<T> screen, Vec3<T> on_screen) {
    const T scale = eye.focal * screen.z;
    // x = f X / Z + cx and q = 1 / Z: dx/dZ = -q (x - cx), dq/dZ = -q^2.
    const T along = on_screen.x * (screen.x - eye.cx) + on_screen.y * (screen.y - eye.cy);
    return {scale * on_screen.x, scale * on_screen.y, -screen.z * (along + screen.z * on_screen.z)};
}

// Pull a cotangent on a vector that rotates with the camera back to azimuth, elevation and roll.
template <class R, class T> Vec3<T> rotation_cotangent(const Eye<R>& eye, Vec3<T> cotangent, Vec3<T> arm) {
    const Vec3<R> up = {eye.rotation.row[0].z, eye.rotation.row[1].z, eye.rotation.row[2].z};
    // A small turn w moves a vector v by w x v: its derivative is w . (v x cotangent).
    const Vec3<T> torque = cross(arm, cotangent);
    return {-dot(up, torque), eye.level.x * torque.x + eye.level.y * torque.y, torque.z};
}

}  // namespace vig
