"""Kernels of the vertices: positions, normals and irradiance of a point, and the backward pass.

Points are rows of (1, latents in their order, framing).
"""

import warp as wp

from vig.likelihood.kernels.layout import LANES, RowLayout, native_file
from vig.scene.light import L_COUNT
from vig_renderer.raster import FACE_MASK, NEAR, NOTHING

near = real(NEAR)
widths = {"WIDTH": RowLayout(modes).shape, "REST": RowLayout(modes).rest}
ring = native_file(dtype, "ring.cc", WIDTH=widths["WIDTH"])

# Places of the blocks in a point, behind its leading 1.
_point = RowLayout(modes).point
shape_from = 1 + _point.at("shape")
azimuth_from = 1 + _point.at("azimuth")
elevation_from = 1 + _point.at("elevation")
light_from = 1 + _point.at("light")
framing_from = 1 + _point.at("framing")


@wp.func_native(snippet=ring + "return normal();")
def ring_normal(image: wp.int32, vertex: wp.int32, mesh: Mesh, vertices: Vertices) -> vec3: ...


@wp.func_native(snippet=ring + "write_row(mesh.basis, tangent, rows.shape_rows);")
def ring_row(
    image: wp.int32, vertex: wp.int32, tangent: vec3, mesh: Mesh, vertices: Vertices, rows: VertexRows
): ...


@wp.func_native(snippet=ring + "pull(tangent, in_world, cotangents.on_world);")
def ring_pull(
    image: wp.int32,
    vertex: wp.int32,
    tangent: vec3,
    in_world: vec3,
    mesh: Mesh,
    vertices: Vertices,
    cotangents: Cotangents,
): ...


@wp.kernel(module=module)
def look(points: wp.array2d(dtype=real), camera: vec3, view: View, lighting: Lighting):
    """The camera (focal length, cx, cy of the image as it is), light and shape of each point."""
    image = wp.tid()
    sa = wp.sin(points[image, azimuth_from])
    ca = wp.cos(points[image, azimuth_from])
    se = wp.sin(points[image, elevation_from])
    ce = wp.cos(points[image, elevation_from])
    sr = wp.sin(points[image, framing_from + 3])
    cr = wp.cos(points[image, framing_from + 3])
    # Roll about the optical axis, after the upright camera of azimuth and elevation.
    turn = mat33(cr, -sr, real(0.0), sr, cr, real(0.0), real(0.0), real(0.0), real(1.0))
    upright = mat33(ca, sa, real(0.0), se * sa, -se * ca, -ce, -ce * sa, ce * ca, -se)
    view.rotation[image] = turn * upright
    view.level[image] = vec2(cr, sr)
    width = real(view.width)
    view.intrinsics[image] = vec3(
        camera[0] * wp.exp(points[image, framing_from + 2]),
        camera[1] + points[image, framing_from] * width,
        camera[2] + points[image, framing_from + 1] * width,
    )
    row = rest_row()
    for i in range(L_COUNT):
        row[light_at + i] = points[image, light_from + i]
    lighting.light[image] = row
    coefficients = shape_row()
    for mode in range(modes):
        coefficients[mode] = points[image, shape_from + mode]
    lighting.coefficients[image] = coefficients


@wp.kernel(module=module)
def place(view: View, target: vec3, chunk: int, vertices: Vertices):
    """Vertices on the screen, q = 0 for one at or behind the eye."""
    image, part = wp.tid()
    turn = view.rotation[image]
    lens = view.intrinsics[image]
    first = part * chunk
    for vertex in range(first, wp.min(first + chunk, vertices.world.shape[1])):
        point = turn * (vertices.world[image, vertex] - target)
        # The camera's frame has its origin `distance` metres before the target.
        depth = point[2] + view.distance
        q = real(0.0)
        if depth > near:
            q = real(1.0) / depth
        scale = lens[0] * q
        vertices.screen[image, vertex] = vec3(point[0] * scale + lens[1], point[1] * scale + lens[2], q)


@wp.func_native(snippet=native_file(dtype, "use_seen.cc", FACE_MASK=FACE_MASK, NOTHING=NOTHING))
def use_faces(
    image: int, first: int, end: int, mesh: Mesh, keys: wp.array2d(dtype=wp.int64), vertices: Vertices
): ...


@wp.kernel(module=module)
def use_seen(mesh: Mesh, keys: wp.array2d(dtype=wp.int64), chunk: int, vertices: Vertices):
    """The vertices of the faces that a chunk of an image's pixels shows are used, and have rows."""
    image, part = wp.tid()
    end = wp.min((part + 1) * chunk, keys.shape[1])
    use_faces(image, part * chunk, end, mesh, keys, vertices)


@wp.func
def write_rows(
    image: int,
    vertex: int,
    row: rest_row,
    total: real,
    mesh: Mesh,
    vertices: Vertices,
    lighting: Lighting,
    vertex_rows: VertexRows,
):
    """A vertex's row of derivatives, whose light columns are given and whose irradiance is `total`."""
    tangent = vec3()
    # Irradiance is max(0, .): a vertex in the dark has no derivative.
    if total > real(0.0):
        normal = vertices.normals[image, vertex]
        slope = light_slope(lighting.light[image], normal) * mesh.reflectance[vertex]
        # d (n / |n|) = (1 - n n^T) dn / |n|.
        tangent = (slope - normal * wp.dot(slope, normal)) * vertices.inverse_lengths[image, vertex]
        row[irradiance_at] = total
    else:
        row = rest_row()
    ring_row(image, vertex, tangent, mesh, vertices, vertex_rows)
    if lighting.shadowed != 0 and total > real(0.0):
        rates = lighting.shadow_rates[image, vertex] * mesh.reflectance[vertex]
        vertex_rows.shape_rows[image, vertex] = vertex_rows.shape_rows[image, vertex] + rates
    vertex_rows.rest_rows[image, vertex] = row


@wp.func_native(snippet=native_file(dtype, "shadow.cc", LOBES=L_COUNT, LIGHT=light_at, LANES=LANES, **widths))
def shadow(image: int, vertex: int, differentiate: int, lighting: Lighting) -> lobe_vector: ...


@wp.kernel(module=module)
def shade(
    mesh: Mesh,
    lighting: Lighting,
    chunk: int,
    differentiate: int,
    vertices: Vertices,
    vertex_rows: VertexRows,
):
    """Normals and irradiance of the vertices in use; with differentiate = 2 rows of those that are seen."""
    image, part = wp.tid()
    first = part * chunk
    for vertex in range(first, wp.min(first + chunk, vertices.used.shape[1])):
        if vertices.used[image, vertex] != wp.uint8(0):
            normal = ring_normal(image, vertex, mesh, vertices)
            length = wp.length(normal)
            inverse = real(0.0)
            if length > real(0.0):
                inverse = real(1.0) / length
            normal = normal * inverse
            row = lobes(normal)
            if lighting.shadowed != 0:
                row = add_lobes(row, shadow(image, vertex, differentiate, lighting))
            row = row * mesh.reflectance[vertex]
            total = wp.dot(row, lighting.light[image])
            vertices.normals[image, vertex] = normal
            vertices.inverse_lengths[image, vertex] = inverse
            vertices.irradiances[image, vertex] = wp.max(total, real(0.0))
            if differentiate > 1 and vertices.used[image, vertex] == wp.uint8(2):
                write_rows(image, vertex, row, total, mesh, vertices, lighting, vertex_rows)


@wp.kernel(module=module)
def unshade(
    mesh: Mesh,
    view: View,
    vertices: Vertices,
    lighting: Lighting,
    chunk: int,
    cotangents: Cotangents,
    sums: wp.array2d(dtype=rest_row),
    shadow_sums: wp.array2d(dtype=shape_row),
):
    """Backward pass: cotangents on the screen, irradiance and camera-frame normals of the vertices become
    those on world places, on pose, light and framing (sums, one per chunk), and on shape through the
    transfer (shadow_sums)."""
    image, part = wp.tid()
    shining = lighting.light[image]
    eye = eye_of(image, view)
    world_from_camera = wp.transpose(eye.rotation)
    total = rest_row()
    by_shape = shape_row()
    first = part * chunk
    for vertex in range(first, wp.min(first + chunk, vertices.used.shape[1])):
        if vertices.used[image, vertex] != wp.uint8(0):
            spot = vertices.screen[image, vertex]
            pulled = cotangents.on_corner[image, vertex]
            pull = vec3(pulled[0], pulled[1], pulled[2])
            total = moved(total, eye, pull, spot)
            in_world = world_from_camera * camera_cotangent(eye, spot, pull)
            normal = vertices.normals[image, vertex]
            by_normal = vec3()
            if vertices.irradiances[image, vertex] > real(0.0):
                strength = pulled[3] * mesh.reflectance[vertex]
                row = lobes(normal)
                if lighting.shadowed != 0:
                    row = add_lobes(row, lighting.lobe_changes[image, vertex])
                    by_shape = by_shape + lighting.shadow_rates[image, vertex] * strength
                total = total + row * strength
                by_normal = light_slope(shining, normal) * strength
            turning = cotangents.on_normal[image, vertex]
            if turning[0] != real(0.0) or turning[1] != real(0.0):
                pose = turned(eye, turning, eye.rotation * normal)
                total[azimuth] = total[azimuth] + pose[0]
                total[elevation] = total[elevation] + pose[1]
                total[framing + 3] = total[framing + 3] + pose[2]
                by_normal = by_normal + world_from_camera * turning
            tangent = by_normal - normal * wp.dot(by_normal, normal)
            tangent = tangent * vertices.inverse_lengths[image, vertex]
            ring_pull(image, vertex, tangent, in_world, mesh, vertices, cotangents)
    sums[image, part] = total
    shadow_sums[image, part] = by_shape
