// Rays against triangles: a bounding volume hierarchy, the first hit, and the shape as seen from its vertices.
#pragma once
#include <vector>

#include "vectors.h"

namespace vig {

constexpr int32_t NO_HIT = -1, SEEN_FROM_BEHIND = -2;

// The first triangle that a ray meets, or NO_HIT; of several at the same distance the first. distance: in lengths of the
// ray's direction. behind: its corners are seen clockwise.
struct Hit {
    int32_t face;
    bool behind;
    float distance, weights[3];
};

// A hierarchy of boxes in which every node has LANES children, tested side by side. Triangles are ordered by median
// splits; LANES of them in a row are a leaf, LANES leaves in a row have a node, and so on. A ray's hit does not depend
// on the order.
class RayMesh {
  public:
    // vertices (V, 3), corners (F, 3). A triangle of which a corner is not finite is never met.
    RayMesh(const float* vertices, const int32_t* corners, int faces);
    Hit first_hit(Vec3<float> origin, Vec3<float> direction) const;

  private:
    struct Leaf {
        float corner[3][3][LANES];  // corner, axis
        int32_t face[LANES];
    };
    struct Node {
        float bound[2][3][LANES];  // low and high of its children, axis
    };
    std::vector<Leaf> leaves_;
    std::vector<std::vector<Node>> levels_;  // children of those in levels_[0] are leaves; the last level has one node
};

// Directions of R rays into the hemisphere about each of V points. That of ray r from point v is sqrt(u) cos(a),
// sqrt(u) sin(a), sqrt(1 - u) in the point's frame, with u = patterns[v / chunk, r, 0] and
// a = 2 pi (patterns[v / chunk, r, 1] + turns[v]).
struct HemisphereRays {
    int points, rays, chunk;
    const double* position;  // (V, 3)
    const double* frames;    // (V, 3, 3) rows: tangent, bitangent, normal
    const double* patterns;  // (C, R, 2)
    const double* turns;     // (V,)
    double offset;           // along the normal, at which rays start
};

// blocked (V, 9): the sum of the spherical harmonics Y(w) of directions w that meet something. faces (V, R): the face met,
// or NO_HIT, or SEEN_FROM_BEHIND. weights (V, R, 3) of its corners, 0 where nothing is met.
void cast_hemisphere_rays(const RayMesh& mesh, const HemisphereRays& from, double* blocked, int32_t* faces, float* weights);

}  // namespace vig
