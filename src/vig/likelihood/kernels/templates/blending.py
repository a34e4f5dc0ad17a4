"""Blending across occlusion edges: analytic coverage, its cotangents, its motion.

Between two neighbouring pixels an occlusion edge may pass, at a share t of the way from one centre to the
other. The nearer pixel is then partly the other's surface: by |t - 1/2|, which is its analytic coverage
along that direction. Log-likelihoods (not colours) are blended by it, so the objective is continuous and
differentiable in the edge's place (docs/objective.md lists where it is not). An edge is seen both by rows and
by columns; the shares nx^2 and ny^2 of its screen normal, interpolated along the edge, weigh the two, so that
area is kept and nothing jumps where one edge hands over to the next.

tests/vig/likelihood/reference.py computes the same value in plain torch.
"""

import warp as wp

# Squared albedo by which rows of edges are divided at least: a black object has edges, too.
least_brightness = real(1e-6)
# Nats per pixel added to an edge's gain, whose curvature would otherwise have a pole at no gain.
least_gain = real(0.1)


@wp.struct
class Blend:
    """How much of the front surface a target pixel takes, or gives to the surface behind.

    weight: of this axis, times fold. taken: weight times |t - 1/2|, negative when the target is the
    inner pixel and gives. front_irradiance: the target's own if it gives, else the edge's there, which
    stands `perspective` of the way from vertex i's. front_fit, back_fit: Eq. 3 of the target under
    either surface. gain: nats of the first over the second.
    """

    weight: real
    taken: real
    gives: bool
    at: wp.int32
    normal: vec3
    front_irradiance: real
    perspective: real
    observed: vec3
    front_fit: vec2
    back_fit: vec2
    gain: real


@wp.func
def blend_of(
    image: int,
    normal: vec3,
    edge: Edge,
    c: Crossing,
    sides: Sides,
    vertices: Vertices,
    photos: Photos,
    noise: Noise,
):
    blend = Blend()
    blend.normal = normal
    square = normal[0] * normal[0] + normal[1] * normal[1]
    # cos^2 of the angle between the edge's normal and this axis: the two axes' weights add up to 1.
    blend.weight = edge.fold * normal[c.axis] * normal[c.axis] / square
    # The nearer pixel is the target: beyond the half-way point that is the other one.
    blend.gives = (c.t < half) == (c.inside < real(0.0))
    edge_q = (one - c.share) * edge.a[2] + c.share * edge.b[2]
    # Share of the way in space from i to j, of a share of the way on the screen.
    blend.perspective = c.share * edge.b[2] / edge_q
    lit_a = vertices.irradiances[image, edge.i]
    lit_b = vertices.irradiances[image, edge.j]
    blend.at = c.outer
    blend.front_irradiance = lit_a + blend.perspective * (lit_b - lit_a)
    blend.taken = blend.weight * wp.abs(c.t - half)
    if blend.gives:
        blend.at = c.inner
        blend.front_irradiance = sides.front_seen[0]
        blend.taken = -blend.taken
    which = photos.photo[image]
    colour = photos.albedo[image]
    prior = photos.log_prior[which, blend.at]
    blend.observed = photos.observed[which, blend.at]
    blend.front_fit = explained(blend.observed, colour * blend.front_irradiance, prior, noise)
    # Behind the silhouette stands the background, whose likelihood is in the prior.
    blend.back_fit = vec2(prior[2], real(0.0))
    if sides.has_behind:
        blend.back_fit = explained(blend.observed, colour * sides.behind_seen[0], prior, noise)
    blend.gain = blend.front_fit[0] - blend.back_fit[0]
    return blend


@wp.func
def pull_normal(image: int, edge: Edge, c: Crossing, blend: Blend, cotangents: Cotangents):
    """Pull the weight's cotangent back to the edge's normals; the one on `share` is returned."""
    normal = blend.normal
    square = normal[0] * normal[0] + normal[1] * normal[1]
    on_weight = edge.fold * wp.abs(c.t - half) * blend.gain
    if blend.gives:
        on_weight = -on_weight
    # d weight / d normal in the image; columns have the complement of rows.
    turn = real(2.0) * normal[0] * normal[1] / (square * square) * on_weight
    if c.axis == 1:
        turn = -turn
    on_normal = vec3(turn * normal[1], -turn * normal[0], real(0.0))
    wp.atomic_add(cotangents.on_normal, image, edge.i, on_normal * (one - c.share))
    wp.atomic_add(cotangents.on_normal, image, edge.j, on_normal * c.share)
    return wp.dot(on_normal, edge.normal_b - edge.normal_a)


@wp.func
def pull_colours(
    painted: vec3,
    image: int,
    c: Crossing,
    sides: Sides,
    blend: Blend,
    noise: Noise,
    vertices: Vertices,
    photos: Photos,
    cotangents: Cotangents,
):
    """Pull the colours on both sides back to their faces. Returns `painted` with what is added to the
    cotangent on albedo, and the cotangent on the edge's own irradiance."""
    colour = photos.albedo[image]
    precision = real(2.0) * noise.half_precision
    error = blend.observed - colour * blend.front_irradiance
    strength = blend.taken * blend.front_fit[1] * precision
    strength = strength * pull(wp.dot(error, error) * noise.half_precision)
    painted += error * (strength * blend.front_irradiance)
    on_edge = strength * wp.dot(colour, error)
    if blend.gives:
        pull_pixel(image, sides.front, c.inner_pixel, sides.front_seen, on_edge, vertices, cotangents)
        on_edge = real(0.0)
    if sides.has_behind:
        error = blend.observed - colour * sides.behind_seen[0]
        strength = -blend.taken * blend.back_fit[1] * precision
        strength = strength * pull(wp.dot(error, error) * noise.half_precision)
        painted += error * (strength * sides.behind_seen[0])
        on_behind = strength * wp.dot(colour, error)
        pull_pixel(image, sides.behind, c.outer_pixel, sides.behind_seen, on_behind, vertices, cotangents)
    return painted, on_edge


@wp.func
def motion_of(edge: Edge, c: Crossing, blend: Blend):
    """Cotangents on the screen points of the edge's ends, through u, where it crosses the line."""
    # taken grows by weight for each pixel that the edge moves outwards, whichever pixel is the target.
    on_u = -c.inside * blend.weight * blend.gain
    on_a = (one - c.share) * on_u
    on_b = c.share * on_u
    # Where the ends move across the line, the crossing slides along the edge.
    slope = (edge.b[c.axis] - edge.a[c.axis]) / c.length
    return along(c.axis, on_a, -on_a * slope), along(c.axis, on_b, -on_b * slope)


@wp.func
def pull_edge(
    image: int,
    edge: Edge,
    c: Crossing,
    perspective: real,
    on_edge: real,
    on_share: real,
    motion_a: vec3,
    motion_b: vec3,
    vertices: Vertices,
    cotangents: Cotangents,
):
    """Pull cotangents on the edge's irradiance, on `share` and on u back to the edge's ends."""
    edge_q = (one - c.share) * edge.a[2] + c.share * edge.b[2]
    step = vertices.irradiances[image, edge.j] - vertices.irradiances[image, edge.i]
    on_perspective = on_edge * step
    # d perspective / d (q of i, q of j), by the quotient rule.
    by_q = on_perspective * c.share * (one - c.share) / (edge_q * edge_q)
    by_share = (on_share + on_perspective * edge.a[2] * edge.b[2] / (edge_q * edge_q)) / c.length
    on_a = motion_a + along(c.axis, real(0.0), -(one - c.share) * by_share)
    on_b = motion_b + along(c.axis, real(0.0), -c.share * by_share)
    lit_a = on_edge * (one - perspective)
    lit_b = on_edge * perspective
    wp.atomic_add(cotangents.on_corner, image, edge.i, vec4(on_a[0], on_a[1], -by_q * edge.b[2], lit_a))
    wp.atomic_add(cotangents.on_corner, image, edge.j, vec4(on_b[0], on_b[1], by_q * edge.a[2], lit_b))


@wp.func
def add_row(
    image: int,
    source: int,
    edge: Edge,
    blend: Blend,
    motion_a: vec3,
    motion_b: vec3,
    colour: vec3,
    curvature: real,
    mesh: Mesh,
    eye: Eye,
    rows: NormalRows,
):
    """The edge's motion along the line as a row of the normal matrix.

    Gauss-Newton has no residual here: the cusp of gain per pixel is taken one pixel wide.
    """
    slot = claim_row(image, source, rows)
    if slot >= 0:
        brightness = wp.max(wp.dot(colour, colour), least_brightness)
        steepness = wp.abs(blend.weight * blend.gain) + least_gain
        # (root x motion)^2 = curvature x steepness: a second derivative of the gain's size in a pixel.
        root = wp.sqrt(curvature / (steepness * brightness))
        world_from_camera = wp.transpose(eye.rotation)
        on_a = motion_a * root
        on_b = motion_b * root
        row = add_basis(shape_row(), mesh, edge.i, world_from_camera * camera_cotangent(eye, edge.a, on_a))
        row = add_basis(row, mesh, edge.j, world_from_camera * camera_cotangent(eye, edge.b, on_b))
        rows.normal_shape[image, slot] = row
        rows.normal_rest[image, slot] = moved(moved(rest_row(), eye, on_a, edge.a), eye, on_b, edge.b)
