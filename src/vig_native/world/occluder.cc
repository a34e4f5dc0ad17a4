// Where a prop may hide the object: standing before it, or held in mid-air.
#include <algorithm>
#include <cmath>

#include "layout.h"

namespace vig::world {
namespace {

typedef Vec3<double> Vector;
typedef Mat3<double> Turn;
constexpr double TWO_PI = 6.283185307179586;
constexpr Vector UP = {0, 0, 1};

Turn product(const Turn& a, const Turn& b) {
    return {{b.transposed(a.row[0]), b.transposed(a.row[1]), b.transposed(a.row[2])}};
}
Turn about_z(double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
}
Turn about_x(double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {{{1, 0, 0}, {0, c, -s}, {0, s, c}}};
}
// Takes +X to a unit vector, and +Y across it and another.
Turn along(Vector x, Vector other) {
    Vector y = cross(other, x);
    y = y * (1 / std::sqrt(dot(y, y)));
    const Vector z = cross(x, y);
    return {{{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}}};
}

struct Ends {
    double low, high;
    void add(double at) {
        low = std::min(low, at);
        high = std::max(high, at);
    }
};

// Least and greatest coordinates of a prop's turned points along an axis of the world.
Ends extent(Cloud cloud, const Turn& turn, Vector axis) {
    const Vector own = turn.transposed(axis);
    Ends ends = {1e300, -1e300};
    for (int n = 0; n < cloud.count; ++n)
        ends.add(dot(load3(cloud.points + 3 * n), own));
    return ends;
}

// The window of the picture that can show turned props.
struct Window {
    const Stage& stage;
    Ends rows = {1e9, -1e9}, columns = {1e9, -1e9};
    void add(Cloud cloud, const Turn& turn, Vector position) {
        const Camera& camera = stage.camera;
        const Turn to_camera = product(camera.rotation, turn);
        const Vector shift = camera.rotation * position + camera.translation;
        for (int n = 0; n < cloud.count; ++n) {
            const Vector seen = to_camera * load3(cloud.points + 3 * n) + shift;
            const double scale = camera.focal / seen.z;
            rows.add(scale * seen.y + camera.cy);
            columns.add(scale * seen.x + camera.cx);
        }
    }
    // The share of the object's pixels that lie in it.
    double share() const {
        // 0, too, where it is not a number.
        const auto cell = [](double at, int size) { return at > 0 ? (int)(at < size ? at : size) : 0; };
        const int H = stage.camera.height, W = stage.camera.width;
        const int64_t* const top = &stage.sums[(size_t)cell(rows.low, H) * (W + 1)];
        const int64_t* const bottom = &stage.sums[(size_t)cell(rows.high + 1, H) * (W + 1)];
        const int left = cell(columns.low, W), right = cell(columns.high + 1, W);
        return (double)(bottom[right] - top[right] - bottom[left] + top[left]) / stage.pixel_count;
    }
};

// A prop on the object's support, before it by a gap, that moves to one side.
bool stand(const Stage& stage, const OccluderRequest& request, Cloud prop, const double* u, Occluder& to) {
    const Vector forward = stage.camera.rotation.row[2];
    to.turn = about_z(TWO_PI * u[0]);
    const double gap = stage.margin + stage.gap + u[1] * stage.widest_gap;
    to.position = stage.ahead * -(stage.body_front + extent(prop, to.turn, stage.ahead).high + gap);
    to.motion = stage.aside * (u[2] < 0.5 ? -1.0 : 1.0);
    // Within these offsets it lies inside the support's edges and below things above it.
    to.least = 0;
    to.most = 0.5 * stage.scale;
    for (int axis = 0; axis < 3; ++axis) {
        const Vector own = stage.support.row[axis];
        const Ends ends = extent(prop, to.turn, own);
        const double start = dot(to.position, own) - stage.support_origin[axis];
        const double low = ends.low + start, high = ends.high + start;
        if (axis == 2) {
            if (high > stage.clearance - stage.margin)
                return false;
            continue;
        }
        const double half = stage.half[axis] - stage.margin;
        double way = dot(to.motion, own);
        way = std::abs(way) < 1e-9 ? 1e-9 : way;
        if (high - low > 2 * half)
            return false;
        const double first = (-half - low) / way, last = (half - high) / way;
        to.least = std::max(to.least, way > 0 ? first : last);
        to.most = std::min(to.most, way > 0 ? last : first);
    }
    to.front = extent(prop, to.turn, forward).low + dot(to.position, forward);
    if (!(to.least < to.most) || to.front < dot(forward, stage.camera.eye()) + stage.nearest)
        return false;
    Window window{stage};
    window.add(prop, to.turn, to.position + to.motion * to.least);
    to.bound = request.hidden + window.share();
    return to.bound >= request.level;
}

// A prop in mid-air before the object, in a hand or alone, that moves away along `motion`.
bool hang(const Stage& stage, const OccluderRequest& request, Cloud prop, Cloud hand, const double* u, const double* normal,
          Occluder& to) {
    const Camera& camera = stage.camera;
    const Vector* const view = camera.rotation.row;  // to the right, down and ahead in the picture
    const Vector forward = view[2], eye = camera.eye();
    const double eye_depth = dot(forward, eye);
    // A direction in the picture's plane.
    const auto across = [&](double share) {
        return view[0] * std::cos(TWO_PI * share) + view[1] * std::sin(TWO_PI * share);
    };
    Vector outward = across(u[0]);
    to.least = request.first;
    to.most = request.last;
    to.hand_turn = {};
    if (request.kind == IN_HAND) {  // tilted, or its broad side to the camera
        if (u[1] < 0.3 + 0.7 * request.level) {
            const Turn axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
            Turn to_x;
            for (int r = 0; r < 3; ++r)
                to_x.row[r] = axes.row[(request.thin + r) % 3];
            const Turn tilt = product(about_z(0.25 * normal[2]), about_x(TWO_PI * u[3]));
            to.turn = product(along(forward, across(u[2])), product(tilt, to_x));
        } else
            to.turn = product(about_z(6.3 * u[2]), product(about_x(1.2 * u[3]), about_z(6.3 * u[4])));
        to.hand_turn = product(along(outward, forward), about_x(6.3 * u[5]));
    } else if (request.kind == BOARD && u[1] < 0.5) {  // level
        const double angle = -0.3 + u[2] * (TWO_PI / 2 + 0.6);
        outward = stage.aside * std::cos(angle) + stage.ahead * std::sin(angle);
        to.turn = about_z(std::atan2(outward.y, outward.x));
    } else
        to.turn = product(along(outward, forward),
                          about_x(request.kind == ARM ? 6.3 * u[3] : (request.kind == TWIG ? 0.3 : 0.2) * normal[2]));

    Vector middle = {0, 0, 0};
    if (request.kind == IN_HAND) {
        const auto centre = [&](Vector axis) {
            const Ends ends = extent(prop, to.turn, axis);
            return (ends.low + ends.high) / 2;
        };
        middle = {centre({1, 0, 0}), centre({0, 1, 0}), centre(UP)};
    }
    const double below = extent(prop, to.turn, UP).low - middle.z;
    Ends deep = extent(prop, to.turn, forward);
    deep = {deep.low - dot(middle, forward), deep.high - dot(middle, forward)};
    if (hand.count) {
        const Ends ends = extent(hand, to.hand_turn, forward);
        deep.add(ends.low);
        deep.add(ends.high);
    }
    // On a ray to the object's middle, so that all is before the object.
    const double nearest = stage.nearest - deep.low;
    const double farthest = stage.body_depth - eye_depth - deep.high - 2 * stage.margin;
    if (nearest > farthest)
        return false;
    const double depth = stage.closer ? nearest * std::pow(farthest / nearest, u[6]) : nearest + u[6] * (farthest - nearest);
    const Vector ray = {(stage.middle[1] + 2 * normal[0] - camera.cx) / camera.focal,
                        (stage.middle[0] + 2 * normal[1] - camera.cy) / camera.focal, 1};
    const Vector aim = eye + camera.rotation.transposed(ray) * depth;
    Vector tips = aim;
    double lowest = aim.z + below;
    if (hand.count) {
        tips = tips + outward * (0.75 * (extent(prop, to.turn, outward).high - dot(middle, outward)));
        lowest = std::min(lowest, tips.z + extent(hand, to.hand_turn, UP).low);
        // Its fingertips stay in the frame.
        const Vector seen = camera.rotation * tips + camera.translation, moving = camera.rotation * outward;
        const double scale = camera.focal / seen.z;
        for (int axis = 0; axis < 2; ++axis) {
            const double size = axis ? camera.height : camera.width, inside = stage.hand_inside;
            const double pixel = scale * seen[axis] + (axis ? camera.cy : camera.cx), speed = scale * moving[axis];
            if (!(pixel >= inside && pixel <= size - inside))
                return false;
            const double room = speed > 0 ? size - inside - pixel : pixel - inside;
            to.most = std::min(to.most, room / std::max(std::abs(speed), 1e-9));
        }
    }
    const double above = lowest - stage.margin, rise = outward.z;
    if (rise < 0)
        to.most = std::min(to.most, -above / rise);
    else if (rise > 0)
        to.least = std::max(to.least, -above / rise);
    if (!(to.least < to.most) || (rise == 0 && above < 0))
        return false;
    to.position = aim - middle;
    to.hand_position = tips;
    to.motion = outward;
    Window window{stage};
    window.add(prop, to.turn, to.position + outward * to.least);
    window.add(hand, to.hand_turn, tips + outward * to.least);
    to.bound = request.hidden + window.share();
    to.front = eye_depth + depth + deep.low;
    return true;
}

}  // namespace

bool draw_occluder(const Stage& stage, const OccluderRequest& request, Cloud prop, Cloud hand, const double* uniform,
                   const double* normal, Occluder& to) {
    return request.kind == STANDING ? stand(stage, request, prop, uniform, to)
                                    : hang(stage, request, prop, hand, uniform, normal, to);
}

}  // namespace vig::world
