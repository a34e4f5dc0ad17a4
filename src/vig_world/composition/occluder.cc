// Draws where a prop may hide the object: standing before it, or held in mid-air.
//
// The body of a function of `Occluder* const task`; `native.py` puts the declarations before it. Of several
// draws the first is kept that has room between camera and object; `task->drawn` is its number, -1 for none.

struct Turn {
    double m[3][3];
};
const Stage& stage = *(const Stage*)task->stage;
const double two_pi = 6.283185307179586;
auto dot = [](const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
auto product = [](const Turn& a, const Turn& b) {
    Turn result;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            result.m[r][c] = a.m[r][0] * b.m[0][c] + a.m[r][1] * b.m[1][c] + a.m[r][2] * b.m[2][c];
    return result;
};
auto about_z = [](double angle) {
    const double c = cos(angle), s = sin(angle);
    return Turn{{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
};
auto about_x = [](double angle) {
    const double c = cos(angle), s = sin(angle);
    return Turn{{{1, 0, 0}, {0, c, -s}, {0, s, c}}};
};
// To the right, down and ahead in the picture.
const double* const view[3] = {stage.rotation[0], stage.rotation[1], stage.rotation[2]};
const double* const forward = view[2];
const double eye_depth = dot(forward, stage.eye);
// Takes +X to a unit vector, and +Y across it and another.
auto along = [&](const double* x, const double* other) {
    double y[3] = {other[1] * x[2] - other[2] * x[1], other[2] * x[0] - other[0] * x[2],
                   other[0] * x[1] - other[1] * x[0]};
    const double length = sqrt(dot(y, y));
    for (int r = 0; r < 3; ++r)
        y[r] /= length;
    return Turn{{{x[0], y[0], x[1] * y[2] - x[2] * y[1]},
                 {x[1], y[1], x[2] * y[0] - x[0] * y[2]},
                 {x[2], y[2], x[0] * y[1] - x[1] * y[0]}}};
};
// A direction in the picture's plane.
auto across = [&](double share, double* direction) {
    const double c = cos(two_pi * share), s = sin(two_pi * share);
    for (int r = 0; r < 3; ++r)
        direction[r] = c * view[0][r] + s * view[1][r];
};
// Least and greatest coordinates of a prop's turned points along an axis of the world.
auto extent = [&](const double* points, int count, const Turn& turn, const double* axis, double* ends) {
    double own[3];
    for (int c = 0; c < 3; ++c)
        own[c] = axis[0] * turn.m[0][c] + axis[1] * turn.m[1][c] + axis[2] * turn.m[2][c];
    ends[0] = ends[1] = dot(points, own);
    for (int n = 1; n < count; ++n) {
        const double at = dot(points + 3 * n, own);
        ends[0] = wp::min(ends[0], at);
        ends[1] = wp::max(ends[1], at);
    }
};
// The window of the picture that can show a turned prop; it widens `window`: top, bottom, left, right.
auto widen = [&](const double* points, int count, const Turn& turn, const double* position, double* window) {
    for (int n = 0; n < count; ++n) {
        double place[3], seen[3];
        for (int r = 0; r < 3; ++r)
            place[r] = dot(turn.m[r], points + 3 * n) + position[r];
        for (int r = 0; r < 3; ++r)
            seen[r] = dot(view[r], place) + stage.translation[r];
        const double scale = stage.focal / seen[2];
        const double row = scale * seen[1] + stage.cy, column = scale * seen[0] + stage.cx;
        window[0] = wp::min(window[0], row);
        window[1] = wp::max(window[1], row);
        window[2] = wp::min(window[2], column);
        window[3] = wp::max(window[3], column);
    }
};
// The share of the object that a window and what is there already hide at most.
auto bound = [&](const double* window) {
    int ends[4];
    for (int n = 0; n < 4; ++n) {
        const double end = window[n] + n % 2, size = n < 2 ? stage.height : stage.width;
        ends[n] = end > 0 ? (int)(end < size ? end : size) : 0;  // 0, too, where it is not a number
    }
    const wp::int64* const sums = (const wp::int64*)stage.sums;
    const wp::int64* const top = sums + ends[0] * (stage.width + 1);
    const wp::int64* const bottom = sums + ends[1] * (stage.width + 1);
    const wp::int64 inside = bottom[ends[3]] - top[ends[3]] - bottom[ends[2]] + top[ends[2]];
    return task->hidden + (double)inside / stage.pixel_count;
};
const double nothing[4] = {1e9, -1e9, 1e9, -1e9};
const double up[3] = {0, 0, 1};
const double margin = stage.margin;

// A prop on the object's support, before it by a gap, that moves to one side.
auto stands = [&](int number) {
    const double* const u = (const double*)task->uniform + 3 * number;
    const double* const points = (const double*)task->points + 3 * task->point_count * (number % task->props);
    const int count = task->point_count;
    const Turn turn = about_z(two_pi * u[0]);
    double ends[2], position[3], moved[3], window[4];
    extent(points, count, turn, stage.ahead, ends);
    const double gap = margin + stage.gap + u[1] * stage.widest_gap;
    const double distance = stage.body_front + ends[1] + gap, side = u[2] < 0.5 ? -1 : 1;
    for (int r = 0; r < 3; ++r) {
        position[r] = -distance * stage.ahead[r];
        task->motion[r] = side * stage.aside[r];
    }
    // Within these offsets it lies inside the support's edges and below what is above it.
    double least = 0, most = 0.5 * stage.scale;
    for (int axis = 0; axis < 3; ++axis) {
        const double* const own = stage.support[axis];
        extent(points, count, turn, own, ends);
        const double start = dot(position, own) - stage.support_origin[axis];
        const double low = ends[0] + start, high = ends[1] + start;
        if (axis == 2) {
            if (high > stage.clearance - margin)
                return false;
            continue;
        }
        const double half = stage.half[axis] - margin;
        double way = dot(task->motion, own);
        way = way > -1e-9 && way < 1e-9 ? 1e-9 : way;
        if (high - low > 2 * half)
            return false;
        const double first = (-half - low) / way, last = (half - high) / way;
        least = wp::max(least, way > 0 ? first : last);
        most = wp::min(most, way > 0 ? last : first);
    }
    extent(points, count, turn, forward, ends);
    task->front = ends[0] + dot(position, forward);
    if (!(least < most) || task->front < eye_depth + stage.nearest)
        return false;
    for (int r = 0; r < 3; ++r) {
        task->position[r] = position[r];
        moved[r] = position[r] + least * task->motion[r];
    }
    for (int n = 0; n < 4; ++n)
        window[n] = nothing[n];
    widen(points, count, turn, moved, window);
    task->bound = bound(window);
    task->least = least;
    task->most = most;
    for (int n = 0; n < 9; ++n)
        task->turn[n / 3][n % 3] = turn.m[n / 3][n % 3];
    return task->bound >= task->level;
};

// A prop in mid-air before the object, in a hand or alone, that moves away along `motion`.
auto hangs = [&](int number) {
    const double* const u = (const double*)task->uniform + 7 * number;
    const double* const normal = (const double*)task->normal + 3 * number;
    const double* const points = (const double*)task->points;
    const double* const hands = (const double*)task->hands;
    const double* const hand = hands ? hands + 3 * task->hand_count * number : nullptr;
    const int count = task->point_count;
    double outward[3], sideways[3];
    across(u[0], outward);
    Turn turn, grip = {};
    double least = task->first, most = task->last;
    if (task->kind == IN_HAND) {  // tilted, or its broad side to the camera
        if (u[1] < 0.3 + 0.7 * task->level) {
            Turn to_x = {};
            for (int r = 0; r < 3; ++r)
                to_x.m[r][(task->thin + r) % 3] = 1;
            across(u[2], sideways);
            const Turn tilt = product(about_z(0.25 * normal[2]), about_x(two_pi * u[3]));
            turn = product(along(forward, sideways), product(tilt, to_x));
        } else
            turn = product(about_z(6.3 * u[2]), product(about_x(1.2 * u[3]), about_z(6.3 * u[4])));
        grip = product(along(outward, forward), about_x(6.3 * u[5]));
    } else if (task->kind == BOARD && u[1] < 0.5) {  // level
        const double angle = -0.3 + u[2] * (two_pi / 2 + 0.6), c = cos(angle), s = sin(angle);
        for (int r = 0; r < 3; ++r)
            outward[r] = c * stage.aside[r] + s * stage.ahead[r];
        turn = about_z(atan2(outward[1], outward[0]));
    } else
        turn = product(along(outward, forward),
                       about_x(task->kind == ARM ? 6.3 * u[3] : (task->kind == TWIG ? 0.3 : 0.2) * normal[2]));

    double ends[2], deep[2], middle[3] = {0, 0, 0};
    if (task->kind == IN_HAND)
        for (int r = 0; r < 3; ++r) {
            double axis[3] = {0, 0, 0};
            axis[r] = 1;
            extent(points, count, turn, axis, ends);
            middle[r] = (ends[0] + ends[1]) / 2;
        }
    extent(points, count, turn, up, ends);
    const double below = ends[0] - middle[2];
    extent(points, count, turn, forward, deep);
    deep[0] -= dot(middle, forward);
    deep[1] -= dot(middle, forward);
    if (hand) {
        extent(hand, task->hand_count, grip, forward, ends);
        deep[0] = wp::min(deep[0], ends[0]);
        deep[1] = wp::max(deep[1], ends[1]);
    }
    // On a ray to the object's middle, so that all is before the object.
    const double nearest = stage.nearest - deep[0];
    const double farthest = stage.body_depth - eye_depth - deep[1] - 2 * margin;
    if (nearest > farthest)
        return false;
    const double share = u[6];
    const double depth = stage.closer ? nearest * pow(farthest / nearest, share)
                                      : nearest + share * (farthest - nearest);
    const double x = (stage.middle[1] + 2 * normal[0] - stage.cx) / stage.focal;
    const double y = (stage.middle[0] + 2 * normal[1] - stage.cy) / stage.focal;
    double aim[3], tips[3];
    for (int r = 0; r < 3; ++r)
        tips[r] = aim[r] = stage.eye[r] + depth * (x * view[0][r] + y * view[1][r] + view[2][r]);
    double lowest = aim[2] + below;
    if (hand) {
        extent(points, count, turn, outward, ends);
        const double out = 0.75 * (ends[1] - dot(middle, outward));
        for (int r = 0; r < 3; ++r)
            tips[r] += out * outward[r];
        extent(hand, task->hand_count, grip, up, ends);
        lowest = wp::min(lowest, tips[2] + ends[0]);
        // As long as its fingertips are in the frame.
        const double z = dot(view[2], tips) + stage.translation[2];
        for (int axis = 0; axis < 2; ++axis) {
            const double size = axis ? stage.height : stage.width, scale = stage.focal / z;
            const double pixel = scale * (dot(view[axis], tips) + stage.translation[axis])
                + (axis ? stage.cy : stage.cx);
            const double speed = scale * dot(view[axis], outward), inside = stage.hand_inside;
            if (!(pixel >= inside && pixel <= size - inside))
                return false;
            const double room = speed > 0 ? size - inside - pixel : pixel - inside;
            most = wp::min(most, room / wp::max(speed < 0 ? -speed : speed, 1e-9));
        }
    }
    const double above = lowest - margin, rise = outward[2];
    if (rise < 0)
        most = wp::min(most, -above / rise);
    else if (rise > 0)
        least = wp::max(least, -above / rise);
    if (!(least < most) || (rise == 0 && above < 0))
        return false;
    double window[4];
    for (int n = 0; n < 4; ++n)
        window[n] = nothing[n];
    double moved[3], moved_tips[3];
    for (int r = 0; r < 3; ++r) {
        task->position[r] = aim[r] - middle[r];
        task->hand_position[r] = tips[r];
        task->motion[r] = outward[r];
        moved[r] = task->position[r] + least * outward[r];
        moved_tips[r] = tips[r] + least * outward[r];
    }
    widen(points, count, turn, moved, window);
    if (hand)
        widen(hand, task->hand_count, grip, moved_tips, window);
    task->bound = bound(window);
    task->front = eye_depth + depth + deep[0];
    task->least = least;
    task->most = most;
    for (int n = 0; n < 9; ++n) {
        task->turn[n / 3][n % 3] = turn.m[n / 3][n % 3];
        task->hand_turn[n / 3][n % 3] = grip.m[n / 3][n % 3];
    }
    return true;
};

task->drawn = -1;
for (int number = 0; number < task->draws && task->drawn < 0; ++number)
    if (task->kind == STANDING ? stands(number) : hangs(number))
        task->drawn = number;
