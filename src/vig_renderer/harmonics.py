"""Real spherical harmonics (SH) up to degree 2, orthonormal, in the order (0,0), (1,-1), (1,0), ..., (2,2).

A Lambertian surface reflects albedo x max(0, sum A_l L_lm Y_lm(n)) with A = (1, 2/3, 1/4): the clamped
cosine's coefficients (pi, 2 pi / 3, pi / 4) over pi (Ramamoorthi and Hanrahan, 2001).
"""

import math

from vig_renderer.arrays import Array, floating, namespace

L_COUNT = 9
COSINE_LOBE = (1.0, *([2.0 / 3.0] * 3), *([0.25] * 5))  # A_l repeated over m: nine numbers

Y00 = 0.5 / math.sqrt(math.pi)
Y1 = math.sqrt(3 / (4 * math.pi))
Y2 = 0.5 * math.sqrt(15 / math.pi)
Y20 = 0.25 * math.sqrt(5 / math.pi)


def sh_basis(directions: Array) -> Array:
    """Return real orthonormal SH up to degree 2 of unit directions: (..., 3) to (..., 9)."""
    directions = floating(directions)
    functions = namespace(directions)
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    basis = [
        functions.full_like(x, Y00),
        Y1 * y,
        Y1 * z,
        Y1 * x,
        Y2 * x * y,
        Y2 * y * z,
        Y20 * (3 * z * z - 1),
        Y2 * x * z,
        0.5 * Y2 * (x * x - y * y),
    ]
    return functions.stack(basis, -1)
