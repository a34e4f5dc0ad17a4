// Moves items along a line until, with what hides an object already, they hide a share of it.
//
// Regula falsi with every other step a bisection, as what is hidden falls with the offset, but not smoothly.
// The body of a function of `Search* const task`; `native.py` puts the declarations before it.

Search& search = *task;
Task& scene = *(Task*)search.scene;
Item* const items = (Item*)scene.items;
const double* const starts = (const double*)search.starts;
const wp::int64* const pixels = (const wp::int64*)search.pixels;
const float* const own = (const float*)search.own;
const unsigned char* const hidden = (const unsigned char*)search.hidden;
const float* const q_image = (const float*)scene.q;
auto draw = [](Task* const task) {
#include <draw>
};
// The share hidden at an offset, less the one wanted.
auto excess = [&](double offset) {
#pragma clang fp contract(off)
    for (int n = 0; n < scene.item_count; ++n)
        for (int r = 0; r < 3; ++r)
            items[n].translation[r] = starts[3 * n + r] + offset * search.motion[r];
    draw(&scene);
    int count = 0;
    for (int n = 0; n < search.pixel_count; ++n)
        count += hidden[n] | (1 / q_image[pixels[n]] < own[n]);
    search.offset = offset;
    return (double)count / search.pixel_count - search.level;
};
auto fits = [&](double over) { return over <= search.tolerance && -over <= search.tolerance; };
auto find = [&]() {
#pragma clang fp contract(off)
    double low = search.least, high = search.most;
    double below = excess(high);
    if (fits(below))
        return FOUND;
    if (below > 0)
        return NOT_OUT_OF_THE_WAY;
    double above = excess(low);
    if (fits(above))
        return FOUND;
    if (above < 0)
        return TOO_SMALL;
    for (int step = 0; step < STEPS; ++step) {
        double share = 0.5;
        if (step % 2 == 0)
            share = wp::min(wp::max(above / (above - below), 0.05), 0.95);
        const double offset = low + share * (high - low);
        const double over = excess(offset);
        if (fits(over))
            return FOUND;
        if (over > 0) {
            low = offset;
            above = over;
        } else {
            high = offset;
            below = over;
        }
    }
    return NO_OFFSET;
};
search.outcome = find();
