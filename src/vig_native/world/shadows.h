// Shadows: planes of shadow are swept down through a grid of cells that are a little opaque, one for each direction of light.
#pragma once
#include <vector>

#include "scene.h"

namespace vig::world {

constexpr int SWEEP_MARGIN = 8;       // cells round a plane that are never in shadow; no shadow moves further at once
constexpr float GROUND_DEPTH = 0.02f; // metres below the ground to which its shadows still reach

// Directions of light: metres along x, y per metre of height (K, 2), and irradiance (K, 4) that is lost when blocked.
struct Sky {
    int count;
    const float *slopes, *weights;
};

// A sweep's result, and the memory that it takes.
struct SweepSpace {
    Grid grid;
    std::vector<float> opacity;  // (z - 1, y, x), shares of a cell's base
    std::vector<float> planes, gathered;
};

// Sweep opaque matter from above; a shadow fades to 1 / e over `reach` metres of height, 0: never. The grid's size is set,
// its width a multiple of LANES; its scale and values are filled.
void sweep(SweepSpace& space, const Sky& sky, float reach);

// Shadows that the object and props cast, on supports and on each other. reach: metres of the object along any axis.
void cast_shadows(SweepSpace& space, const std::vector<Item>& items, const Sky& sky, float reach);

}  // namespace vig::world
