// The search of a layout: where the object stands, and where its occluders may be.
#pragma once
#include <vector>

#include "drawing.h"

namespace vig::world {

// The N pixels that show the object: numbers, depths there, and whether something is before it already.
struct ObjectPixels {
    int count;
    const int64_t* indices;
    const float* depths;
    const uint8_t* hidden;
};

// Move items along a line, metres per unit of offset, until they, with earlier occluders, hide a share of the object;
// `offset` is the last one tried. At the least offset they hide most. Returns why there is no offset, "" where there
// is: too much is hidden at the greatest, too little at the least, or the search ended.
const char* settle(Drawing& drawing, const std::vector<Item>& items, const Camera& camera, Vec3<double> motion, double least,
                   double most, const ObjectPixels& pixels, double level, double tolerance, double& offset);

struct Support {
    double turn, clearance, behind;  // metres to things above, and to a wall or back, inf none
    double half[2], centre[3];
};

// A piece of furniture: outward normals and offsets of its sides, and its ends along z.
struct Solid {
    double sides[4][3], low, high;
};

enum PlaceState { PLACE_GOOD, PLACE_TOO_SMALL, PLACE_EYE, PLACE_OPEN };  // no room for it, for the camera; nothing before it

struct Place {
    double turn;  // radians, layout to world
    double spot[3], slide[3];  // object's place in the layout; from there to the support's edge on the side of the people
    PlaceState state;
};

// A room, and an object to be placed in it, outline (N, 2), metres.
struct PlaceSearch {
    const double *body, *outline;
    const Solid* solids;
    int body_count, corner_count, solid_count;
    bool hiding;  // whether something is to be before the object
    double body_height;
    Vec3<double> eye;  // in the world
    double ahead;      // radians, of the direction away from the camera
    double slid;       // share of the slide
    // Metres: camera from walls and furniture, camera over the floor (2), object from the support's edge, line of sight
    // from furniture; and the share of views from the side where people stand.
    double clearance, lowest, highest, edge, near_ray, wall_share;
    // The place that five numbers in [0, 1) draw on a support.
    Place propose(const Support& support, const double* draws) const;

  private:
    bool is_free(const double* eye) const;
    bool is_crossed(const double* eye, const double* middle) const;
};

// The object as seen from its camera, and its support.
struct Stage {
    Camera camera;
    std::vector<int64_t> sums;  // (H + 1, W + 1), how many of its pixels lie above and left of each corner
    int pixel_count;
    bool closer;  // whether nearness to the camera is drawn on a log scale
    double middle[2];           // row and column
    Vec3<double> ahead, aside;  // unit vectors in the ground plane
    double body_front;          // metres from the object's axis towards the camera
    double body_depth;          // its least coordinate along the direction of view
    double scale, margin, nearest, gap, widest_gap;  // the last two between the object and things before it
    Mat3<double> support;         // its axes, as rows
    Vec3<double> support_origin;  // along these
    double half[2], clearance, hand_inside;  // the last pixels
};

// Points (N, 3) of a prop, the farthest ones.
struct Cloud {
    const double* points;
    int count;
};

enum OccluderKind { STANDING, IN_HAND, ARM, TWIG, BOARD };
constexpr const char* OCCLUDER_KINDS[] = {"standing", "in hand", "arm", "twig", "board"};

// A prop that may hide the object, and a hand that holds it.
struct Occluder {
    Mat3<double> turn, hand_turn;
    Vec3<double> position, hand_position, motion;
    double least, most;  // offsets
    double front;        // least coordinate along the direction of view
    double bound;        // share hidden at most at the least offset
};

// A request: the share to be hidden, the share that is hidden already, the prop's axis of least extent, and
// the ends of the offset of occluders in mid-air.
struct OccluderRequest {
    OccluderKind kind;
    int thin;
    double level, hidden, first, last;
};

// Whether there is room between camera and object for a prop as drawn by numbers in [0, 1), three for `STANDING`, else
// seven, and three of the normal distribution for occluders in mid-air. No hand where it has no points.
bool draw_occluder(const Stage& stage, const OccluderRequest& request, Cloud prop, Cloud hand, const double* uniform,
                   const double* normal, Occluder& to);

}  // namespace vig::world
