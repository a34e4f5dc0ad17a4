from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.vig.likelihood.reference import shade
from vig.likelihood.geometry import Geometry
from vig.scene import EXPOSURE_L00, Camera, ObjectClass, irradiance, srgb8_from_linear
from vig.scene.light import Y00, linear_from_srgb
from vig_world.assets.models import packaged_props
from vig_world.assets.target import NO_DESIGN, shape_vertices
from vig_world.assets.things import Material
from vig_world.mesh import Mesh, vertex_normals
from vig_world.raster.draw import SurfaceSamples, depth, draw
from vig_world.raster.items import Item, Target
from vig_world.raster.packed import PackedAsset
from vig_world.raster.picture import Picture
from vig_world.raster.pyramid import TextureLevels
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View

HERE = np.eye(3), np.zeros(3)
EVEN, MAX_LIGHT = 0.6, 1.25
"""As in shade.cc."""
LIGHT = np.array([EXPOSURE_L00, 0.4, 1.2, -0.5, 0.1, -0.2, 0.2, 0.1, -0.1])
ABOVE = np.array([EXPOSURE_L00, 0, 1.0, 0, 0, 0, 0, 0, 0])


def stuff(value: float | np.ndarray, slot: str = "", emission: float = 0.0) -> Material:
    """A material without gloss."""
    texture = np.full((1, 1, 3), value, np.float32) if isinstance(value, float) else value
    return Material(texture, "cloth", 1.0, slot, emission)


def sheet(corners: list[list[float]], material: Material) -> PackedAsset:
    """A rectangle of four corners, counter-clockwise from its front; texture coordinates are metres."""
    points = np.array(corners, np.float32)
    a, b = points[1] - points[0], points[3] - points[0]
    uv = [[0, 0], [np.linalg.norm(a), 0], [np.linalg.norm(a), np.linalg.norm(b)], [0, np.linalg.norm(b)]]
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.array(uv, np.float32))
    return PackedAsset.of([(mesh, material)])


def floor(material: Material, z: float = 0.0, half: float = 1.0) -> Item:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return Item(sheet(corners, material), *HERE, owner=0, is_support=True)


def box(low: list[float], high: list[float], material: Material, inward: bool = False) -> PackedAsset:
    parts = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end, other in ((low, high), (high, low)):
            corners = np.zeros((4, 3), np.float32)
            corners[:, axis] = end[axis]
            corners[:, u] = [low[u], high[u], high[u], low[u]]
            corners[:, v] = [low[v], low[v], high[v], high[v]]
            outward = (end[axis] > other[axis]) != inward
            faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)[:, :: 1 if outward else -1]
            parts.append((Mesh(corners, faces, corners[:, [u, v]] - corners[0, [u, v]]), material))
    return PackedAsset.of(parts)


def target(teapot: ObjectClass, light: np.ndarray = LIGHT) -> Target:
    return target_of(teapot, np.full(teapot.shape_model.modes, 0.5), np.array([0.6, 0.4, 0.3]), light)


def target_of(known: ObjectClass, shape: np.ndarray, albedo: np.ndarray, light: np.ndarray) -> Target:
    return Target.of(known, shape_vertices(shape, NO_DESIGN, known), shape, albedo, light)


def linear(picture: Picture) -> np.ndarray:
    return linear_from_srgb(picture.image / 255)


@pytest.mark.parametrize("self_shadow", [False, True])
def test_the_object_alone_looks_as_the_model_shades_it(teapot: ObjectClass, self_shadow: bool) -> None:
    """Against the likelihood's reference: its irradiances, interpolated at four samples a pixel."""
    known = teapot if self_shadow else replace(teapot, transfer=None)
    shape, albedo = np.linspace(-1, 1, known.shape_model.modes), np.array([0.6, 0.4, 0.3])
    azimuth, elevation = 0.7, 0.5
    picture = draw([], target_of(known, shape, albedo, LIGHT), View.of(known, azimuth, elevation), LIGHT)

    geometry = Geometry(known.shape_model, np.float64, transfer=known.transfer)
    camera = Camera.standard(target_height=known.target_height)
    point = torch.tensor([*shape, azimuth, elevation, *albedo, *LIGHT, 0, 0, 0, 0], dtype=torch.float64)
    vertices = known.shape_model.vertices(shape[None].astype(np.float32))[0]
    faces, view = known.shape_model.faces, View.of(known, azimuth, elevation, 300)
    seen = rasterize(vertices, faces, view.rotation, view.translation, view.camera, cull=True)
    corners = shade(geometry, camera, point).irradiances.numpy()[faces[seen.face]]
    fine = np.where(seen.face >= 0, (corners * seen.barycentric).sum(-1), 0)[..., None] * albedo
    expected = srgb8_from_linear(fine.clip(0, 1).reshape(150, 2, 150, 2, 3).mean(axis=(1, 3)))

    covered = (seen.face >= 0).reshape(150, 2, 150, 2).sum(axis=(1, 3))
    off = np.abs(picture.image.astype(int) - expected).max(-1)
    # Four samples are shaded once, in the middle: only where faces meet the mean differs.
    assert off[covered == 4].max() <= 12 and (off[covered == 4] > 1).mean() < 0.02
    assert (picture.amodal != (covered >= 2)).mean() < 1e-3
    assert (picture.visible == picture.amodal).all()
    np.testing.assert_array_equal(picture.canvas[150:300, 150:300], picture.amodal)
    near = np.where(seen.face >= 0, seen.depth, np.inf).reshape(150, 2, 150, 2).min(axis=(1, 3))
    both = np.isfinite(near) & np.isfinite(picture.depth)
    assert (np.abs(picture.depth[both] - near[both]) < 1e-5).mean() > 0.999


def test_a_plane_under_and_behind_the_eye_is_cut_off_in_front_of_it(teapot: ObjectClass) -> None:
    """Depth of the plane z = -0.1 along each ray, 40 m wide so that most corners lie behind the eye."""
    view = View.of(teapot, 0.3, 0.2)
    ground = floor(stuff(0.5), -0.1, 20.0)
    far, owner = depth([ground], view)
    rows, columns = np.mgrid[:150, :150] + 0.5
    c = view.camera
    rays = np.stack([(columns - c.cx) / c.focal, (rows - c.cy) / c.focal, np.ones_like(rows)], -1)
    down = (rays @ view.rotation)[..., 2]
    expected = np.where(down < 0, (-0.1 - view.eye[2]) / np.minimum(down, -1e-9), np.inf)
    clear = expected < 10  # the horizon's neighbours see the plane's end
    np.testing.assert_allclose(far[clear], expected[clear], rtol=3e-4)
    assert (owner[clear] == 0).all() and (owner[down > 0.01] == -1).all()
    assert np.isinf(far[down > 0.01]).all()


def test_depth_and_owner_agree_with_the_fits_rasteriser(teapot: ObjectClass) -> None:
    view = View.of(teapot, 1.0, 0.6, 75)
    things, meshes = [], []
    for number, (family, at) in enumerate(
        {"mug": (0.05, 0.02), "book": (-0.06, -0.05), "bowl": (0, 0.1)}.items()
    ):
        parts = packaged_props("train")[family][0].read()
        place = np.array([*at, 0.0])
        things.append(Item(PackedAsset.of(parts), np.eye(3), place, owner=number + 4))
        meshes.append([(mesh.vertices + place, mesh.faces) for mesh, _ in parts])
    far, owner = depth(things, view)
    nearest, expected = np.full((75, 75), np.inf), np.full((75, 75), -1)
    for number, shapes in enumerate(meshes):
        for vertices, faces in shapes:
            seen = rasterize(vertices, faces, view.rotation, view.translation, view.camera, cull=True).depth
            expected[seen < nearest] = number + 4
            nearest = np.minimum(nearest, seen)
    assert (owner != expected).mean() < 2e-3
    same = owner == expected
    np.testing.assert_allclose(far[same], nearest[same], rtol=1e-4)


def test_a_textured_floor_shows_its_texels_lit_by_the_light(teapot: ObjectClass) -> None:
    """From straight above, texels' middles show albedo times the irradiance of a level surface."""
    rng = np.random.default_rng(0)
    texture = rng.uniform(0.1, 0.7, (4, 4, 3)).astype(np.float32)
    picture = draw(
        [floor(stuff(texture, "floor"), -0.4)], target(teapot), View.of(teapot, 0.0, np.pi / 2), LIGHT
    )
    expected = irradiance(np.array(LIGHT, np.float32), np.array([0.0, 0.0, 1.0], np.float64)).item()
    view, seen = View.of(teapot, 0.0, np.pi / 2), linear(picture)
    for x in np.arange(-0.3625, 0.4, 0.25):  # texture coordinates start at -1, and a repeat is 1 m
        for y in (-0.375, 0.375):
            point = view.rotation @ [x, y, -0.4] + view.translation
            column, row = (view.camera.focal * point[:2] / point[2] + 75).astype(int)
            if not (0 <= column < 150 and 0 <= row < 150) or picture.amodal[row, column]:
                continue
            square = x**2 + y**2 + 0.4**2  # the light is more even, the further from the object
            here = expected + EVEN * square / (square + 1) * (LIGHT[0] * Y00 - expected)
            texel = texture[int((1 - (y + 1) % 1) * 4), int((x + 1) % 1 * 4)]
            np.testing.assert_allclose(seen[row, column], (texel * here).clip(0, 1), atol=0.03)


def test_round_things_are_shaded_by_their_interpolated_normals(teapot: ObjectClass) -> None:
    """A ball below the ground, out of all shadows, against the same in numpy."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13), indexing="ij")
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
    corner = (np.arange(24)[:, None] * 13 + np.arange(12)).ravel()
    quads = np.stack([corner, corner + 1, corner + 14, corner, corner + 14, corner + 13], -1)
    faces = quads.reshape(-1, 3).astype(np.int32)
    mesh = Mesh((0.08 * points).astype(np.float32), faces, np.zeros((len(points), 2), np.float32))
    place, view = np.array([0.2, 0.1, -0.3]), View.of(teapot, 0.4, 1.4)
    ball = Item(PackedAsset.of([(mesh, stuff(0.5))]), np.eye(3), place, 1)
    picture = draw([ball], target(teapot), view, LIGHT)

    fine = View.of(teapot, 0.4, 1.4, 300)
    seen = rasterize(mesh.vertices + place, faces, fine.rotation, fine.translation, fine.camera, cull=True)
    corners = faces[seen.face]
    across = (vertex_normals(mesh.vertices, faces)[corners] * seen.barycentric[..., None]).sum(2)
    across /= np.linalg.norm(across, axis=-1, keepdims=True) + 1e-12
    square = (((mesh.vertices + place)[corners] * seen.barycentric[..., None]).sum(2) ** 2).sum(-1)
    light = irradiance(np.array(LIGHT, np.float32), across)
    light += EVEN * square / (square + 1) * (LIGHT[0] * Y00 - light)
    expected = srgb8_from_linear((0.5 * light).clip(0, 1).reshape(150, 2, 150, 2).mean(axis=(1, 3)))
    whole = (seen.face >= 0).reshape(150, 2, 150, 2).all(axis=(1, 3))
    whole &= picture.depth > seen.depth.reshape(150, 2, 150, 2).min(axis=(1, 3)) - 1e-4  # not the object
    off = np.abs(picture.image[..., 1].astype(int) - expected)[whole]
    assert whole.sum() > 500 and off.max() <= 4 and (off > 1).mean() < 0.03


def test_the_samples_of_the_object_lie_on_what_is_seen_of_it(teapot: ObjectClass) -> None:
    """A screen hides its left half: the other samples have the places and normals of `rasterize`.

    With the albedo that the object had anyway the picture is the same as without their colouring.
    """
    view, pot = View.of(teapot, 0.7, 0.5), target(teapot)
    front = view.eye - 0.3 * (view.eye / np.linalg.norm(view.eye))
    left, down = -view.rotation[0], view.rotation[1]
    corners = [front + a * left + b * down for a, b in ((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0))]
    screen = Item(sheet([corner.tolist() for corner in corners], stuff(0.5)), *HERE, 1)
    found = []

    def colouring(at: SurfaceSamples) -> np.ndarray:
        found.append((at.points.copy(), at.normals.copy(), at.vertices.copy()))
        return np.outer(at.irradiance, pot.albedo)

    picture = draw([screen], pot, view, LIGHT, colouring)
    points, normals, vertices = found[0]
    fine, faces = view.scale(2), teapot.shape_model.faces
    seen = rasterize(pot.vertices, faces, view.rotation, view.translation, fine.camera, cull=True)
    place = view.rotation @ points + view.translation[:, None]
    x, y = fine.camera.focal * place[:2] / place[2] + np.array([[fine.camera.cx], [fine.camera.cy]])
    assert np.abs(np.stack([x, y]) % 1 - 0.5).max() < 0.01, "at samples' middles"
    row, column = y.astype(int), x.astype(int)
    face, weights = seen.face[row, column], seen.barycentric[row, column]
    assert 1000 < len(row) < (seen.face >= 0).sum() and column.min() >= 149, "none behind the screen"
    assert len(np.unique(row * 300 + column)) == len(row), "each once"
    inside = weights.min(1) > 0.01  # at an edge either face is right
    np.testing.assert_allclose(place[2][inside], seen.depth[row, column][inside], atol=1e-5)
    assert (faces[face[inside]] == vertices[inside, None]).any(1).all()
    across = (vertex_normals(pot.vertices, faces)[faces[face]] * weights[..., None]).sum(1)
    np.testing.assert_allclose(normals.T[inside], across[inside], atol=2e-3)

    plain = draw([screen], pot, view, LIGHT)
    off = np.abs(picture.image.astype(int) - plain.image)
    assert off.max() <= 6 and (off > 1).mean() < 0.002


def test_parts_of_meshes_outside_the_frame_are_left_out_alone(teapot: ObjectClass) -> None:
    """A long wavy strip, of which a camera near to it sees a few of many clusters, in order or shuffled."""
    rng, view = np.random.default_rng(5), View.of(teapot, 0.0, np.pi / 2, 75)
    u, v = np.meshgrid(np.linspace(-3, 3, 601), np.linspace(-0.1, 0.1, 5), indexing="ij")
    vertices = np.stack([u, v, 0.05 * np.sin(9 * u)], -1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(600)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.stack([corner, corner + 5, corner + 6, corner, corner + 6, corner + 1], -1).reshape(-1, 3)
    expected = rasterize(vertices, faces, view.rotation, view.translation, view.camera, cull=True).depth
    for shuffled in (faces, rng.permutation(faces)):
        mesh = Mesh(vertices, shuffled.astype(np.int32), np.zeros((len(vertices), 2), np.float32))
        far, _ = depth([Item(PackedAsset.of([(mesh, stuff(0.5))]), *HERE)], view)
        assert 500 < np.isfinite(far).sum() < 75 * 75
        np.testing.assert_allclose(far, expected, rtol=1e-5)


def test_nothing_is_nowhere(teapot: ObjectClass) -> None:
    far, owner = depth([], View.of(teapot, 0.0, 0.5, 20))
    assert np.isinf(far).all() and (owner == -1).all()


def test_finishes_replace_what_stands_in_for_a_slot(teapot: ObjectClass) -> None:
    """A striped texture of 2 texels at 8 cm a repeat: stripes of 4 cm; other slots keep their own."""
    stripes = np.zeros((1, 2, 3), np.float32)
    stripes[0, 0] = [0.4, 0, 0]
    ground = replace(floor(stuff(0.2, "top")), finishes={"top": (TextureLevels.of(stripes), 0.08)})
    view = View.of(teapot, 0.0, np.pi / 2)
    row = linear(draw([ground], target(teapot), view, LIGHT))[8, :, 0] > 0.15
    changes = np.nonzero(np.diff(row.astype(int)))[0]
    scale = view.camera.focal / (0.4 + teapot.target_height)
    assert np.median(np.diff(changes)) == pytest.approx(0.04 * scale, abs=1.1)
    plain = draw(
        [replace(ground, finishes={"wall": (TextureLevels.of(stripes), 0.08)})], target(teapot), view, LIGHT
    )
    np.testing.assert_allclose(plain.image[8, :].max(0), plain.image[8, :].min(0), atol=3)


def test_what_glows_is_seen_without_light(teapot: ObjectClass) -> None:
    dark = np.zeros(9)
    lamp = floor(stuff(0.5, emission=0.6))
    picture = draw([lamp], target(teapot, dark), View.of(teapot, 0.0, 1.2), dark)
    np.testing.assert_allclose(linear(picture)[5, 5], 0.3, atol=0.005)
    assert np.median(picture.image[picture.visible]) == 0


def test_props_and_object_darken_the_ground_beside_and_behind_them(teapot: ObjectClass) -> None:
    """Light from above and +X: the shadow of a block falls towards -X; the object itself is not shaded."""
    light = np.array([EXPOSURE_L00, 0, 1.0, 1.6, 0, 0, 0, 0, 0])
    view = View.of(teapot, 0.0, 1.2)
    block = Item(
        box([-0.03, -0.03, 0], [0.03, 0.03, 0.12], stuff(0.5)), np.eye(3), np.array([0.0, 0.13, 0]), 1
    )
    ground = floor(stuff(0.5))
    empty = draw([ground], target(teapot, light), view, light)
    filled = draw([ground, block], target(teapot, light), view, light)

    def shade_at(x: float, y: float) -> float:
        point = view.rotation @ [x, y, 0.0] + view.translation
        column, row = (view.camera.focal * point[:2] / point[2] + 75).astype(int)
        return float(linear(filled)[row, column].mean() / linear(empty)[row, column].mean())

    away, towards, beside = shade_at(-0.06, 0.14), shade_at(0.06, 0.14), shade_at(0.12, 0.13)
    assert away < 0.8 and away < towards - 0.1 and beside > 0.93
    both = empty.visible & filled.visible
    inside = both & ~np.isinf(empty.depth)
    unchanged = (empty.image == filled.image).all(-1)[inside]
    assert unchanged.mean() > 0.97  # all but pixels that it shares with the ground


def test_a_rooms_corner_is_dimmer_than_its_wall(teapot: ObjectClass) -> None:
    light = np.zeros(9)
    light[0] = EXPOSURE_L00
    room = Item(box([-1.5, -1, -0.8], [1.5, 0.6, 1.6], stuff(0.5), inward=True), *HERE, 0, is_support=True)
    picture = linear(draw([room], target(teapot, light), View.of(teapot, 0.9, 0.1), light))[..., 1]
    wall = picture[10:40, 10:140]
    assert wall.max() > 1.08 * wall.min()
    assert wall.max() < 0.5 * EXPOSURE_L00 * Y00 * MAX_LIGHT


def test_what_hides_the_object_is_told_apart(teapot: ObjectClass) -> None:
    """A screen 10 cm in front of the object, as furniture or as a prop, hides its left half."""
    view = View.of(teapot, 0.0, 0.2)
    # From the eye, on -Y, the left is -X.
    screen = sheet([[-0.3, -0.2, -0.1], [0, -0.2, -0.1], [0, -0.2, 0.4], [-0.3, -0.2, 0.4]], stuff(0.5))
    for is_support in (True, False):
        picture = draw([Item(screen, *HERE, 1, is_support=is_support)], target(teapot), view, LIGHT)
        hidden = picture.amodal & ~picture.visible
        assert hidden[:, :74].sum() == picture.amodal[:, :74].sum() and not hidden[:, 77:].any()
        assert picture.by_support.sum() == (hidden.sum() if is_support else 0)
        assert picture.cause == ("support" if is_support else "occluder")


def test_the_same_bytes_on_any_thread(teapot: ObjectClass) -> None:
    rng = np.random.default_rng(1)
    items = [floor(stuff(rng.uniform(0, 1, (8, 8, 3)).astype(np.float32)))]
    for number in range(3):
        parts = packaged_props("train")["mug"][0].read()
        items.append(
            Item(PackedAsset.of(parts), np.eye(3), np.array([0.1 * number - 0.1, 0.15, 0]), number + 1)
        )

    def once(azimuth: float) -> bytes:
        return draw(items, target(teapot), View.of(teapot, azimuth, 0.6), LIGHT).image.tobytes()

    angles = [0.1, 1.0, 2.0, 0.1, 1.0, 2.0]
    expected = [once(angle) for angle in angles]
    assert expected[:3] == expected[3:]
    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(once, angles)) == expected
