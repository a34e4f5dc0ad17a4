// Change of a vertex's lobes, c_l = T_0l + sum_k T_kl shape_k, which is returned and kept, and for derivatives the
// irradiance's rates sum_l T_kl light_l.
const real* const by_shape = (const real*)lighting.transfer_by_shape.data + (size_t)vertex * LOBES * WIDTH;
const real* const mean = (const real*)lighting.transfer_mean.data + (size_t)vertex * LOBES;
const real* const shape = (const real*)lighting.coefficients.data + (size_t)image * WIDTH;
const real* const light = (const real*)lighting.light.data + (size_t)image * REST + LIGHT;
const size_t place = (size_t)image * lighting.lobe_changes.shape.dims[1] + vertex;
wp::vec_t<LOBES, real> change;
real rates[WIDTH] = {};
for (int lobe = 0; lobe < LOBES; ++lobe) {
    const real* const row = by_shape + lobe * WIDTH;
    real parts[LANES] = {};
    for (int from = 0; from < WIDTH; from += LANES)
        for (int n = 0; n < LANES; ++n)
            parts[n] += row[from + n] * shape[from + n];
    // Halves are added to halves: sums of a whole register are no chain of additions.
    for (int half = LANES / 2; half; half /= 2)
        for (int n = 0; n < half; ++n)
            parts[n] += parts[n + half];
    change[lobe] = mean[lobe] + parts[0];
    for (int n = 0; n < WIDTH; ++n)
        rates[n] += row[n] * light[lobe];
}
((wp::vec_t<LOBES, real>*)lighting.lobe_changes.data)[place] = change;
if (differentiate > 0)
    for (int n = 0; n < WIDTH; ++n)
        ((real*)lighting.shadow_rates.data)[place * WIDTH + n] = rates[n];
return change;
