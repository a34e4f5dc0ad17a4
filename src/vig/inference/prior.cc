// What one point's prior adds to value, gradient and normal matrix; see `Prior.value`. The light's Gaussian in the
// heading frame bends with azimuth: `rate` and `turned` are what light turned by minus the azimuth gains with it.
constexpr int LIGHT = 9;
const int n = points.shape.dims[1], peaks = azimuths.shape.dims[0];
const real* const x = (const real*)points.data + (size_t)point * n;
const real *const centre = (const real*)mean.data, *const sharp = (const real*)precision.data;
real* const slope = (real*)gradient.data + (size_t)point * n;
real* const curved = (real*)normal.data + (size_t)point * n * n;
real total = 0;
for (int i = 0; i < n; ++i) {
    real force = 0;
    for (int j = 0; j < n; ++j) {
        force += sharp[i * n + j] * (centre[j] - x[j]);
        curved[i * n + j] += sharp[i * n + j];
    }
    slope[i] += force;
    total += force * (centre[i] - x[i]);
}
if (heading_mean.shape.dims[0] == LIGHT) {
    const real *const wanted = (const real*)heading_mean.data, *const pull = (const real*)heading_precision.data;
    const real c1 = wp::cos(x[azimuth]), s1 = -wp::sin(x[azimuth]);
    const real c2 = wp::cos(2 * x[azimuth]), s2 = -wp::sin(2 * x[azimuth]);
    // Line m of the turn: it keeps c of m and takes s of its partner.
    const int partner[LIGHT] = {0, 3, 2, 1, 8, 7, 6, 5, 4};
    const real keep[LIGHT] = {1, c1, 1, c1, c2, c1, 1, c1, c2};
    const real take[LIGHT] = {0, s1, 0, -s1, s2, s1, 0, -s1, -s2};
    const real order[LIGHT] = {0, -1, 0, 1, -2, -1, 0, 1, 2};
    real turned[LIGHT];
    for (int m = 0; m < LIGHT; ++m)
        turned[m] = keep[m] * x[light + m] + take[m] * x[light + partner[m]];
    for (int m = 0; m < LIGHT; ++m) {
        const real rate = order[m] * turned[partner[m]], force = pull[m] * (wanted[m] - turned[m]);
        total += force * (wanted[m] - turned[m]);
        const int at[3] = {azimuth, light + m, light + partner[m]};
        const real gain[3] = {rate, keep[m], take[m]};
        for (int i = 0; i < 3; ++i) {
            slope[at[i]] += gain[i] * force;
            for (int j = 0; j < 3; ++j)
                curved[at[i] * n + at[j]] += gain[i] * pull[m] * gain[j];
        }
    }
}
if (peaks > 0) {
    const real around = real(6.283185307179586);
    real nearest = around;
    for (int i = 0; i < peaks; ++i) {
        const real off = fold * (((const real*)azimuths.data)[i] - x[azimuth]);
        const real turn = (off - around * wp::floor(off / around + real(0.5))) / (fold > 0 ? fold : real(1));
        if (wp::abs(turn) < wp::abs(nearest))
            nearest = turn;
    }
    total += azimuth_precision * nearest * nearest;
    slope[azimuth] += azimuth_precision * nearest;
    curved[azimuth * n + azimuth] += azimuth_precision;
}
((double*)value.data)[point] -= 0.5 * double(total);
