"""Kernels that put the parts of Eq. 4 together: its value, gradient and normal matrix."""

import warp as wp

from vig.likelihood.kernels.layout import RowLayout

_point = RowLayout(modes).point
albedo_from = _point.at("albedo")
coefficients_from = _point.at("shape")
shape_columns = RowLayout(modes).shape


@wp.kernel(module=module)
def add_values(
    line_values: wp.array2d(dtype=real),
    edge_values: wp.array2d(dtype=real),
    background: wp.array(dtype=wp.float64),
    photo: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float64),
):
    image = wp.tid()
    # Sums of many pixels are kept in double precision: nats of a whole image reach 1e5.
    total = background[photo[image]]
    for i in range(line_values.shape[1]):
        total = total + wp.float64(line_values[image, i])
    for i in range(edge_values.shape[1]):
        total = total + wp.float64(edge_values[image, i])
    value[image] = total


@wp.kernel(module=module)
def assemble(
    columns: wp.array(dtype=wp.int32),
    shape_gradient: wp.array2d(dtype=real),
    sums: wp.array2d(dtype=rest_row),
    shadow_sums: wp.array2d(dtype=shape_row),
    line_albedo: wp.array2d(dtype=vec3),
    edge_albedo: wp.array2d(dtype=vec3),
    albedo: wp.array(dtype=vec3),
    products: wp.array3d(dtype=real),
    gradient: wp.array2d(dtype=real),
    normal: wp.array3d(dtype=real),
):
    """One of a point's numbers: its gradient, and its line of the normal matrix.

    A colour channel's row is albedo times the shared row, and irradiance in that channel's albedo place;
    summed over the channels only |albedo|^2, albedo and 1 are left of them.
    """
    image, i = wp.tid()
    column = columns[i]
    colour = albedo[image]
    channel = i - albedo_from
    painted = channel >= 0 and channel < 3
    slope = real(0.0)
    if i >= coefficients_from and i < coefficients_from + modes:
        slope = shape_gradient[image, i - coefficients_from]
        for part in range(shadow_sums.shape[1]):
            slope = slope + shadow_sums[image, part][i - coefficients_from]
    elif painted:
        for part in range(line_albedo.shape[1]):
            slope = slope + line_albedo[image, part][channel]
        for part in range(edge_albedo.shape[1]):
            slope = slope + edge_albedo[image, part][channel]
    else:
        lane = column - shape_columns
        for part in range(sums.shape[1]):
            slope = slope + sums[image, part][lane]
    gradient[image, i] = slope
    for j in range(columns.shape[0]):
        other = j - albedo_from
        # Sum over the channels of d colour / d one times d colour / d other, irradiance taken out.
        factor = wp.dot(colour, colour)
        if painted:
            factor = colour[channel]
            if other >= 0 and other < 3:
                factor = real(0.0)
                if other == channel:
                    factor = real(1.0)
        elif other >= 0 and other < 3:
            factor = colour[other]
        normal[image, i, j] = factor * products[image, column, columns[j]]
