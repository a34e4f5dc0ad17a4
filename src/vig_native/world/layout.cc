#include "layout.h"

#include <algorithm>
#include <cmath>

namespace vig::world {

constexpr int STEPS = 12;  // offsets that a search tries between two ends
constexpr double HALF_TURN = 3.14159265358979323846;

// Regula falsi with every other step a bisection, as the hidden share falls with the offset, but not smoothly.
const char* settle(Drawing& drawing, const std::vector<Item>& items, const Camera& camera, Vec3<double> motion, double least,
                   double most, const ObjectPixels& pixels, double level, double tolerance, double& offset) {
    std::vector<Item> moved = items;
    // The share hidden at an offset, less the one wanted.
    const auto excess = [&](double at) {
        for (size_t n = 0; n < items.size(); ++n)
            moved[n].translation = items[n].translation + motion * at;
        drawing.rasterise(moved, camera, 1, false);
        offset = at;
        return drawing.hidden(pixels.indices, pixels.depths, pixels.hidden, pixels.count) - level;
    };
    const auto fits = [&](double over) { return over <= tolerance && -over <= tolerance; };
    double low = least, high = most, below = excess(high);
    if (fits(below))
        return "";
    if (below > 0)
        return "not out of the way";
    double above = excess(low);
    if (fits(above))
        return "";
    if (above < 0)
        return "too small";
    for (int step = 0; step < STEPS; ++step) {
        const double share = step % 2 == 0 ? std::clamp(above / (above - below), 0.05, 0.95) : 0.5;
        const double at = low + share * (high - low), over = excess(at);
        if (fits(over))
            return "";
        (over > 0 ? low : high) = at;
        (over > 0 ? above : below) = over;
    }
    return "no offset";
}

// Height of a point over one of the four sides of a piece of furniture that is grown by a margin, metres.
static double over(const double* side, const double* point, double margin) {
    return side[0] * point[0] + side[1] * point[1] - side[2] - margin;
}

// Inside the room and outside its furniture, with some space.
bool PlaceSearch::is_free(const double* eye) const {
    if (!(eye[2] > lowest && eye[2] < highest))
        return false;
    bool inside = false;
    for (int n = 0; n < corner_count; ++n) {
        const double* const start = outline + 2 * n;
        const double* const end = outline + 2 * ((n + 1) % corner_count);
        const double way_x = end[0] - start[0], way_y = end[1] - start[1], x = eye[0] - start[0], y = eye[1] - start[1];
        const double t = std::min(std::max((x * way_x + y * way_y) / (way_x * way_x + way_y * way_y), 0.0), 1.0);
        const double off_x = x - t * way_x, off_y = y - t * way_y;
        if (off_x * off_x + off_y * off_y <= clearance * clearance)
            return false;
        if ((start[1] > eye[1]) != (end[1] > eye[1]) && start[0] + way_x * y / way_y > eye[0])
            inside = !inside;
    }
    return inside && std::none_of(solids, solids + solid_count, [&](const Solid& solid) {
        return eye[2] > solid.low - clearance && eye[2] < solid.high + clearance
            && std::all_of(solid.sides, solid.sides + 4, [&](const double* side) { return over(side, eye, clearance) <= 0; });
    });
}

// Whether the line from the camera to the object's middle passes furniture.
bool PlaceSearch::is_crossed(const double* eye, const double* middle) const {
    const double way[3] = {middle[0] - eye[0], middle[1] - eye[1], middle[2] - eye[2]};
    return std::any_of(solids, solids + solid_count, [&](const Solid& solid) {
        double enters = -1e9, leaves = 1e9;  // in lengths of the line
        // height: the camera's over a side; rise: from there to the object's.
        const auto cut = [&](double height, double rise) {
            if (rise < 0)
                enters = std::max(enters, -height / rise);
            else if (rise > 0)
                leaves = std::min(leaves, -height / rise);
            else if (height > 0)
                leaves = -1e9;
        };
        for (const double* const side : solid.sides)
            cut(over(side, eye, near_ray), side[0] * way[0] + side[1] * way[1]);
        cut(solid.low - eye[2] - near_ray, -way[2]);
        cut(eye[2] - solid.high - near_ray, way[2]);
        return enters < leaves && leaves > 0.1 && leaves < 0.95 && enters < 0.9;
    });
}

Place PlaceSearch::propose(const Support& support, const double* u) const {
    const bool anywhere = !(support.behind < 1e9) || u[0] > wall_share || hiding;
    // The camera is where people stand: at -y of the support's axes.
    const double facing = ahead - HALF_TURN / 2 + (anywhere ? HALF_TURN : 1.25) * (2 * u[1] - 1);
    const double c = std::cos(facing), s = std::sin(facing);
    double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9};
    for (int p = 0; p < body_count; ++p) {
        const double x = body[2 * p], y = body[2 * p + 1], own[2] = {c * x + s * y, c * y - s * x};
        for (int axis = 0; axis < 2; ++axis) {
            low[axis] = std::min(low[axis], own[axis]);
            high[axis] = std::max(high[axis], own[axis]);
        }
    }
    double least[2], reach[2];  // least value and range of the object's origin
    for (int axis = 0; axis < 2; ++axis) {
        least[axis] = edge - support.half[axis] - low[axis];
        reach[axis] = support.half[axis] - edge - high[axis] - least[axis];
    }
    // Near the people on deep supports, anywhere along them.
    const double near = u[2] < 0.7 ? std::min(1.0, 0.5 / std::max(reach[1], 0.01)) : 1.0;
    const double x = least[0] + reach[0] * u[3], y = least[1] + reach[1] * u[4] * near;
    const double a = std::cos(support.turn), b = std::sin(support.turn), to_edge = least[1] - y;
    const double turn = facing - support.turn, turned_c = std::cos(turn), turned_s = std::sin(turn);
    const double* const centre = support.centre;
    Place place = {turn, {centre[0] + a * x - b * y, centre[1] + b * x + a * y, centre[2]},
                   {-b * to_edge, a * to_edge, 0}, PLACE_GOOD};
    const double at[3] = {place.spot[0] + slid * place.slide[0] + turned_c * eye.x + turned_s * eye.y,
                          place.spot[1] + slid * place.slide[1] - turned_s * eye.x + turned_c * eye.y,
                          place.spot[2] + eye.z};
    const double middle[3] = {place.spot[0], place.spot[1], place.spot[2] + body_height / 2};
    if (reach[0] < 0 || reach[1] < 0 || body_height > support.clearance - edge)
        place.state = PLACE_TOO_SMALL;
    else if (!is_free(at))
        place.state = PLACE_EYE;
    else if (hiding && !(at[2] > place.spot[2] + support.clearance) && !is_crossed(at, middle))
        place.state = PLACE_OPEN;  // nor does the camera look down past a board
    return place;
}

}  // namespace vig::world
