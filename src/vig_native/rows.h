// Rows: the derivative of one number with respect to every latent but albedo.
// A row has a shape part of W columns and a rest of REST columns, whose irradiance stands in place of albedo: a colour
// is albedo times irradiance.
#pragma once
#include "mesh.h"

namespace vig {

enum RestColumn { AZIMUTH = 0, ELEVATION = 1, FRAMING = 2, LIGHT = 6, IRRADIANCE = 15, REST = 16 };

// A_l times the constants of the real spherical harmonics of order 0, 1 and 2, A = (1, 2/3, 1/4).
constexpr double FLAT = 0.28209479177387814, LINEAR = 2.0 / 3.0 * 0.4886025119029199;
constexpr double PRODUCT = 0.25 * 1.0925484305920792, POLAR = 0.25 * 0.31539156525252005;

// A_l Y_lm(n) in the order (0,0), (1,-1), (1,0), (1,1), (2,-2) ... (2,2): docs/conventions.md.
template <class R, class T> void lobes(Vec3<T> n, T* to) {
    const R linear = R(LINEAR), product = R(PRODUCT), polar = R(POLAR);
    to[0] = T{} + R(FLAT);
    to[1] = linear * n.y;
    to[2] = linear * n.z;
    to[3] = linear * n.x;
    to[4] = product * n.x * n.y;
    to[5] = product * n.y * n.z;
    to[6] = polar * (3 * n.z * n.z - 1);
    to[7] = product * n.x * n.z;
    to[8] = R(0.5) * product * (n.x * n.x - n.y * n.y);
}

// d irradiance / d normal, the normal unconstrained.
template <class R, class T> Vec3<T> light_slope(const R* light, Vec3<T> n) {
    const R linear = R(LINEAR), product = R(PRODUCT), polar = R(POLAR);
    return {
        linear * light[3] + product * (light[4] * n.y + light[7] * n.z + light[8] * n.x),
        linear * light[1] + product * (light[4] * n.x + light[5] * n.z - light[8] * n.y),
        linear * light[2] + product * (light[5] * n.y + light[7] * n.x) + 6 * polar * light[6] * n.z,
    };
}

// Add a cotangent on a vertex's place in the world, pulled back to the shape coefficients, to a row's shape part.
template <class R> void add_basis(const Geometry<R>& geometry, int vertex, Vec3<R> cotangent, R* shape) {
    const int width = geometry.width;
    const R* const b = geometry.basis.data() + (size_t)vertex * 3 * width;
    for (int n = 0; n < width; n += REGISTER)
        register_at(shape + n) += cotangent.x * register_at(b + n) + cotangent.y * register_at(b + width + n)
            + cotangent.z * register_at(b + 2 * width + n);
}

// Add a cotangent on a screen point, pulled back to pose and framing, to a row's rest.
template <class R, class T> void add_motion(const Eye<R>& eye, Vec3<T> on_screen, Vec3<T> screen, T* rest) {
    const Vec3<T> point = camera_point(eye, screen);
    // The camera turns about the target, not about its own centre.
    const Vec3<T> arm = {point.x, point.y, point.z - eye.distance};
    const Vec3<T> pose = rotation_cotangent(eye, camera_cotangent(eye, screen, on_screen), arm);
    rest[AZIMUTH] += pose.x;
    rest[ELEVATION] += pose.y;
    rest[FRAMING] += on_screen.x * R(eye.width);
    rest[FRAMING + 1] += on_screen.y * R(eye.width);
    // exp(log magnification) scales about the principal point.
    rest[FRAMING + 2] += on_screen.x * (screen.x - eye.cx) + on_screen.y * (screen.y - eye.cy);
    rest[FRAMING + 3] += pose.z;
}

}  // namespace vig
