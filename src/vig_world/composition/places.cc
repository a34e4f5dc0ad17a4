// Proposes places of an object in a room, and looks whether object and camera are free there.
//
// The body of a function of `Places* const task`; `native.py` puts the declarations before it.

const Support* const supports = (const Support*)task->supports;
const wp::int64* const chosen = (const wp::int64*)task->chosen;
const double* const draws = (const double*)task->draws;
const double* const body = (const double*)task->body;
const double* const outline = (const double*)task->outline;
const Solid* const solids = (const Solid*)task->solids;
Place* const places = (Place*)task->places;
const double half_turn = 3.14159265358979323846;

// Height of a point over one of the four sides of a piece of furniture that is grown by a margin, metres.
auto over = [](const double* side, const double* point, double margin) {
    return side[0] * point[0] + side[1] * point[1] - side[2] - margin;
};
// Inside the room and outside its furniture, with some space.
auto is_free = [&](const double* eye) {
    if (!(eye[2] > task->lowest && eye[2] < task->highest))
        return false;
    const double space = task->clearance;
    bool inside = false;
    for (int n = 0; n < task->corner_count; ++n) {
        const double* const start = outline + 2 * n;
        const double* const end = outline + 2 * ((n + 1) % task->corner_count);
        const double way_x = end[0] - start[0], way_y = end[1] - start[1];
        const double x = eye[0] - start[0], y = eye[1] - start[1];
        const double t = wp::min(wp::max((x * way_x + y * way_y) / (way_x * way_x + way_y * way_y), 0.0), 1.0);
        const double off_x = x - t * way_x, off_y = y - t * way_y;
        if (off_x * off_x + off_y * off_y <= space * space)
            return false;
        if ((start[1] > eye[1]) != (end[1] > eye[1]) && start[0] + way_x * y / way_y > eye[0])
            inside = !inside;
    }
    if (!inside)
        return false;
    for (int n = 0; n < task->solid_count; ++n) {
        const Solid& solid = solids[n];
        bool within = eye[2] > solid.low - space && eye[2] < solid.high + space;
        for (int side = 0; side < 4 && within; ++side)
            within = over(solid.sides[side], eye, space) <= 0;
        if (within)
            return false;
    }
    return true;
};
// Whether the line from the camera to the object's middle passes furniture.
auto is_crossed = [&](const double* eye, const double* middle) {
    const double way[3] = {middle[0] - eye[0], middle[1] - eye[1], middle[2] - eye[2]};
    for (int n = 0; n < task->solid_count; ++n) {
        const Solid& solid = solids[n];
        double enters = -1e9, leaves = 1e9;  // in lengths of the line
        for (int side = 0; side < 6; ++side) {
            double height, rise;  // over the side: of the camera, and from there to the object
            if (side < 4) {
                height = over(solid.sides[side], eye, task->near_ray);
                rise = solid.sides[side][0] * way[0] + solid.sides[side][1] * way[1];
            } else {
                const double up = side == 4 ? -1 : 1;
                height = up * (eye[2] - (side == 4 ? solid.low : solid.high)) - task->near_ray;
                rise = up * way[2];
            }
            if (rise < 0)
                enters = wp::max(enters, -height / rise);
            else if (rise > 0)
                leaves = wp::min(leaves, -height / rise);
            else if (height > 0)
                leaves = -1e9;
        }
        if (enters < leaves && leaves > 0.1 && leaves < 0.95 && enters < 0.9)
            return true;
    }
    return false;
};

for (int n = task->first; n < task->end; ++n) {
    const Support& support = supports[chosen[n]];
    const double* const u = draws + 5 * n;
    Place& place = places[n];
    const bool anywhere = !(support.behind < 1e9) || u[0] > task->wall_share || task->hiding;
    // The camera is where people stand: at -y of the support's axes.
    const double facing = task->ahead - half_turn / 2 + (anywhere ? half_turn : 1.25) * (2 * u[1] - 1);
    const double c = cos(facing), s = sin(facing);
    double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9};
    for (int p = 0; p < task->body_count; ++p) {
        const double x = body[2 * p], y = body[2 * p + 1], own[2] = {c * x + s * y, c * y - s * x};
        for (int axis = 0; axis < 2; ++axis) {
            low[axis] = wp::min(low[axis], own[axis]);
            high[axis] = wp::max(high[axis], own[axis]);
        }
    }
    double least[2], reach[2];  // of the object's origin
    for (int axis = 0; axis < 2; ++axis) {
        least[axis] = task->edge - support.half[axis] - low[axis];
        reach[axis] = support.half[axis] - task->edge - high[axis] - least[axis];
    }
    // Near the people on deep supports, anywhere along them.
    const double near = u[2] < 0.7 ? wp::min(1.0, 0.5 / wp::max(reach[1], 0.01)) : 1.0;
    const double x = least[0] + reach[0] * u[3], y = least[1] + reach[1] * u[4] * near;
    const double a = cos(support.turn), b = sin(support.turn), to_edge = least[1] - y;
    place.turn = facing - support.turn;
    place.slide[0] = -b * to_edge;
    place.slide[1] = a * to_edge;
    place.slide[2] = 0;
    place.spot[0] = support.centre[0] + a * x - b * y;
    place.spot[1] = support.centre[1] + b * x + a * y;
    place.spot[2] = support.centre[2];
    const double turned_c = cos(place.turn), turned_s = sin(place.turn);
    const double eye[3] = {
        place.spot[0] + task->slid * place.slide[0] + turned_c * task->eye[0] + turned_s * task->eye[1],
        place.spot[1] + task->slid * place.slide[1] - turned_s * task->eye[0] + turned_c * task->eye[1],
        place.spot[2] + task->eye[2],
    };
    const double middle[3] = {place.spot[0], place.spot[1], place.spot[2] + task->body_height / 2};
    if (reach[0] < 0 || reach[1] < 0 || task->body_height > support.clearance - task->edge)
        place.state = PLACE_TOO_SMALL;
    else if (!is_free(eye))
        place.state = PLACE_EYE;
    else if (task->hiding && !(eye[2] > place.spot[2] + support.clearance) && !is_crossed(eye, middle))
        place.state = PLACE_OPEN;  // nor does the camera look down past a board
    else
        place.state = PLACE_GOOD;
}
