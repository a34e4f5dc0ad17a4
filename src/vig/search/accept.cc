// Take one search's trial where it gains, and set damping as by Nielsen (1999): it shrinks smoothly with the ratio of
// gain to promise, and grows ever faster while steps fail.
const int n = points.shape.dims[1];
const size_t from = (size_t)search * n;
const real* const slope = (const real*)tried_gradient.data + from;
const double gain = tried_value.data[search] - value.data[search], hoped = promised.data[search];
bool better = gain > 0;
for (int i = 0; i < n; ++i)
    better &= slope[i] - slope[i] == 0;
if (better) {
    value.data[search] = tried_value.data[search];
    for (size_t i = from; i < from + n; ++i) {
        points.data[i] += step.data[i];
        gradient.data[i] = tried_gradient.data[i];
    }
    for (size_t i = from * n; i < (from + n) * n; ++i)
        normal.data[i] = tried_normal.data[i];
}
// How far the quadratic model held: 1 where the objective is quadratic.
const real off = 2 * real(gain / (hoped > 1e-9 ? hoped : 1e-9)) - 1, shrink = 1 - off * off * off;
const real least = real(1.0 / 3), shrunk = shrink < least ? least : shrink > 2 ? real(2) : shrink;
const real damped = damping.data[search] * (better ? shrunk : growth.data[search]);
damping.data[search] = damped > real(1e-7) ? damped : real(1e-7);
// Each failure in a row doubles the factor by which damping grows.
growth.data[search] = better ? real(3) : 2 * growth.data[search];
// A step that promises almost nothing need not be tried.
done.data[search] = (better & (gain < tolerance)) | (damped > give_up) | (hoped < 0.1 * tolerance);
