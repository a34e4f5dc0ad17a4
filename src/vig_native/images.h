// Functions of whole images.
#pragma once
#include <cstdint>

namespace vig {

// Find the free pixels (H, W) that are visible in the cut of least capacity that has fewest of them, by preflows (Goldberg and
// Tarjan 1988). alone (H, W): the capacity lost where a pixel is hidden, less that where it is visible. links
// (8, H, W), used up: that lost where of a pixel and its neighbour one is visible, for the steps (0, 1), (1, 0), (1, 1),
// (1, -1), each before its opposite; 0 unless both are free.
void minimum_cut(int height, int width, const uint8_t* free, const int32_t* alone, int32_t* links, uint8_t* visible);

// Density (H * W) of each pixel's colour relative to uniform on the cube, pixels (H * W, 3) weighted by shares of sum 1:
// a trilinear histogram, smoothed by one cell.
void colour_density(int pixels, const double* colours, const double* shares, double* density);

}  // namespace vig
