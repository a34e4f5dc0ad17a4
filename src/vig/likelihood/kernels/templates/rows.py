"""Rows: the derivative of one number with respect to every latent but albedo.

A row has a shape part and the rest, each a padded Warp vector. The rest has the blocks of `REST`
(likelihood/kernels/layout.py): a point's, with the irradiance itself in place of albedo (with it albedo's
derivative is made, as the colour is albedo times irradiance).
"""

import warp as wp

from vig.likelihood.kernels.layout import REST
from vig.scene.light import COSINE_LOBE, L_COUNT, Y00, Y1, Y2, Y20

azimuth = REST.at("azimuth")
elevation = REST.at("elevation")
framing = REST.at("framing")
light_at = REST.at("light")
irradiance_at = REST.at("irradiance")

# A_l times the constants of the real spherical harmonics of order 0, 1 and 2.
flat = real(COSINE_LOBE[0] * Y00)
linear = real(COSINE_LOBE[1] * Y1)
product = real(COSINE_LOBE[4] * Y2)
polar = real(COSINE_LOBE[6] * Y20)


@wp.func
def add_lobes(row: rest_row, change: lobe_vector):
    """Add to a row's light columns."""
    for i in range(L_COUNT):
        row[light_at + i] = row[light_at + i] + change[i]
    return row


@wp.func
def lobes(n: vec3):
    """A_l Y_lm(n) in a row's light columns."""
    row = rest_row()
    # Order (0,0), (1,-1), (1,0), (1,1), (2,-2) ... (2,2): docs/conventions.md.
    row[light_at + 0] = flat
    row[light_at + 1] = linear * n[1]
    row[light_at + 2] = linear * n[2]
    row[light_at + 3] = linear * n[0]
    row[light_at + 4] = product * n[0] * n[1]
    row[light_at + 5] = product * n[1] * n[2]
    row[light_at + 6] = polar * (real(3.0) * n[2] * n[2] - real(1.0))
    row[light_at + 7] = product * n[0] * n[2]
    row[light_at + 8] = real(0.5) * product * (n[0] * n[0] - n[1] * n[1])
    return row


@wp.func
def light_slope(light: rest_row, n: vec3):
    """d irradiance / d normal, the normal unconstrained; light is in a row's light columns."""
    return vec3(
        linear * light[light_at + 3]
        + product * (light[light_at + 4] * n[1] + light[light_at + 7] * n[2] + light[light_at + 8] * n[0]),
        linear * light[light_at + 1]
        + product * (light[light_at + 4] * n[0] + light[light_at + 5] * n[2] - light[light_at + 8] * n[1]),
        linear * light[light_at + 2]
        + product * (light[light_at + 5] * n[1] + light[light_at + 7] * n[0])
        + real(6.0) * polar * light[light_at + 6] * n[2],
    )


@wp.func
def add_basis(row: shape_row, mesh: Mesh, vertex: wp.int32, cotangent: vec3):
    """Add a cotangent on a vertex's position in the world, pulled back to the shape coefficients."""
    return (
        row
        + mesh.basis[vertex, 0] * cotangent[0]
        + mesh.basis[vertex, 1] * cotangent[1]
        + mesh.basis[vertex, 2] * cotangent[2]
    )


@wp.func
def moved(row: rest_row, eye: Eye, on_screen: vec3, screen: vec3):
    """Add a cotangent on a screen point, pulled back to pose and framing, to a row's rest."""
    point = camera_point(eye, screen)
    # The camera turns about the target, not about its own centre.
    arm = vec3(point[0], point[1], point[2] - eye.distance)
    pose = turned(eye, camera_cotangent(eye, screen, on_screen), arm)
    shift = framed(eye, on_screen, screen)
    row[azimuth] = row[azimuth] + pose[0]
    row[elevation] = row[elevation] + pose[1]
    row[framing] = row[framing] + shift[0]
    row[framing + 1] = row[framing + 1] + shift[1]
    row[framing + 2] = row[framing + 2] + shift[2]
    row[framing + 3] = row[framing + 3] + pose[2]
    return row


@wp.func
def claim_row(image: int, source: int, rows: NormalRows):
    """The place of a source's next row, -1 where its segment is full: where each source is one thread and
    has a segment, rows stand in the same order every time. Sources beyond the last segment share it."""
    segments = rows.row_counts.shape[1]
    length = rows.normal_shape.shape[1] / segments
    segment = wp.min(source, segments - 1)
    place = wp.atomic_add(rows.row_counts, image, segment, 1)
    if place >= length:
        return -1
    return segment * length + place
