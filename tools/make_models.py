"""Makes the packaged props and furniture from furniture catalogues: `models.npz` and `models.csv`.

    apt-get download sweethome3d-furniture && dpkg-deb -x sweethome3d-furniture_*.deb /tmp/furniture
    pip install pyfqmr==0.5.0
    python tools/make_models.py /tmp/furniture/usr/share/sweethome3d/furniture [--sheets FOLDER]

`models.toml` beside this file says which models are taken, what they are and which split shows them; their
names are those of the folders that `mesh_folder` unpacks. Each model's parts of one colour are joined, faces
that nothing outside sees are dropped, the rest is decimated and turned to the side from which it is seen.
"""

import argparse
import csv
import io
import re
import tomllib
import zipfile
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyfqmr
from PIL import Image
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from vig.scene import Camera, srgb_from_linear
from vig_world.assets.materials import ROUGHNESS
from vig_world.assets.models.catalogue import FOLDER, KINDS, SLOTS, STEPS, ModelRow
from vig_world.assets.own.catalogue import mesh_folder, read_sources
from vig_world.assets.own.load import MeshPiece
from vig_world.assets.own.meshes.obj import read_obj
from vig_world.assets.own.siblings import Siblings
from vig_world.assets.own.simplify import simplified
from vig_world.assets.own.supports import level_areas
from vig_world.assets.own.surfaces import paint
from vig_world.assets.things import ZONE_NAMES
from vig_world.raster.rasterize import rasterize

SELECTION = Path(__file__).with_name("models.toml")
PAGE = Path(__file__).parents[1] / "docs" / "models.md"
CC_BY = "https://creativecommons.org/licenses/by/3.0/"
VIEWS, VIEW_PIXELS = 60, 400
"""From which a model is looked at, to find what can be seen of it."""
RIM = 0.01
"""Metres along the edges of a support on which nothing stands."""
MORE = 1.3
"""Factor by which a model may have more faces than wanted."""
BOTH_SIDES = 0.2
"""A face that shows its back in more than this share of its pixels has two sides."""
MAX_LEAF = 2.2
"""Factor by which the remaining leaves of a thinned plant are larger at most."""
PARTS = 6
"""Colours of a model at most."""
PICTURE_SIDE, PALETTE = 64, 32
PICTURE_SPREAD = 0.035
"""Standard deviation of a picture's linear values, below which it counts by its mean."""
WORDS = {
    "metal": "metal chrome steel inox alu iron brass gold silver copper acier",
    "glass": "glass verre crystal vitre window",
    "wood": "wood oak pine teak bois walnut cherry timber beech",
    "cloth": "fabric cloth leather tissu cuir cushion textile seat velvet",
    "leaf": "leaf leaves plant flower grass feuille stem",
    "paper": "paper book page cover carton",
    "ceramic": "ceramic porcelain clay",
}
assert set(ROUGHNESS) == set(KINDS) and set(WORDS) <= set(KINDS)
KIND_OF = {word: kind for kind, words in WORDS.items() for word in words.split()}


@dataclass
class Part:
    """Triangles of one material: metres, texture coordinates and linear albedo as `MeshPiece` has them."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    kind: str
    slot: str = ""

    @property
    def area(self) -> float:
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@dataclass
class Model:
    """A model as it is packed, with its line of the table."""

    row: ModelRow
    parts: list[Part]
    supports: list[tuple[float, ...]]


def read_parts(folder: Path, name: str, default: str) -> list[Part]:
    """Read a model's parts, those of one colour or picture together."""
    path = folder / name / f"{name}.obj"
    parts: dict[Any, Part] = {}
    for mesh in read_obj(path.read_bytes(), Siblings(folder, path)):
        words = re.findall(r"[a-z]+", " ".join(mesh.names).lower())
        kind = next((KIND_OF[word] for word in words if word in KIND_OF), default)
        if mesh.surface is not None and mesh.surface.opacity < 0.9:
            kind = "glass"
        for vertices, faces, uv, texture in paint(mesh):
            if texture.size > 3 and texture.reshape(-1, 3).std(0).max() < PICTURE_SPREAD:
                texture = texture.mean((0, 1), keepdims=True)
            used, faces = np.unique(faces, return_inverse=True)
            part = Part(vertices[used], faces.reshape(-1, 3), uv[used], texture, kind)
            key = kind, texture.shape, texture.tobytes()
            parts[key] = _join([parts[key], part]) if key in parts else part
    return _with_few_colours(list(parts.values()))


def _join(parts: list[Part]) -> Part:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    largest = max(parts, key=lambda part: part.area)
    return Part(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.uv for part in parts]),
        largest.texture,
        largest.kind,
    )


def _with_few_colours(parts: list[Part]) -> list[Part]:
    """Drop pictures of small parts, then join the two plain parts nearest in colour until there are few."""
    whole = sum(part.area for part in parts)
    for part in parts:
        if part.texture.size > 3 and part.area < 0.04 * whole:
            part.texture = part.texture.mean((0, 1), keepdims=True)
    while len(parts) > PARTS:
        plain = [n for n, part in enumerate(parts) if part.texture.size == 3]
        if len(plain) < 2:
            smallest = min((p for p in parts if p.texture.size > 3), key=lambda part: part.area)
            smallest.texture = smallest.texture.mean((0, 1), keepdims=True)
            continue
        colours = np.array([srgb_from_linear(parts[n].texture).reshape(3) for n in plain])
        areas = np.array([parts[n].area for n in plain]) / whole
        cost = np.abs(colours[:, None] - colours[None]).sum(-1) * np.minimum(areas[:, None], areas[None])
        cost[np.diag_indices(len(plain))] = np.inf
        one, other = np.unravel_index(int(cost.argmin()), cost.shape)
        joined = _join([parts[plain[one]], parts[plain[other]]])
        parts = [p for n, p in enumerate(parts) if n not in (plain[one], plain[other])] + [joined]
    return parts


def see_faces(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how many pixels show each face's front and back, (F,) each, over all views."""
    middle = (vertices.min(0) + vertices.max(0)) / 2
    points = (vertices - middle) / np.linalg.norm(vertices - middle, axis=1).max()
    normals = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    front, back = np.zeros(len(faces)), np.zeros(len(faces))
    camera = Camera(VIEW_PIXELS, VIEW_PIXELS, 5.8 * VIEW_PIXELS / 2, VIEW_PIXELS / 2, VIEW_PIXELS / 2, 6.0)
    golden = np.pi * (3 - np.sqrt(5))
    for number in range(VIEWS):
        elevation = np.arcsin(1 - 2 * (number + 0.5) / VIEWS) * 0.97
        matrix = camera.camera_from_world(golden * number % (2 * np.pi), elevation)
        seen = rasterize(points, faces, matrix[:3, :3], matrix[:3, 3], camera).face
        counts = np.bincount(seen[seen >= 0], minlength=len(faces))
        eye = -matrix[:3, :3].T @ matrix[:3, 3]
        towards = ((eye - points[faces[:, 0]]) * normals).sum(1) > 0
        front += counts * towards
        back += counts * ~towards
    return front, back


def keep_seen(parts: list[Part], turn: bool) -> list[Part]:
    """Return parts without faces that no view shows; with `turn` all face the side from which they are seen,
    and those seen from both are there twice."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    front, back = see_faces(vertices, faces)
    result, at = [], 0
    for part in parts:
        ahead, behind = front[at : at + len(part.faces)], back[at : at + len(part.faces)]
        at += len(part.faces)
        # Faces smaller than a pixel count as their neighbours do.
        near = [
            np.maximum.reduce([_spread(part, count)[part.faces[:, k]] for k in range(3)]) / 1e3
            for count in (ahead, behind)
        ]
        total = ahead + behind
        ahead, behind = (np.where(total > 0, own, n) for own, n in zip((ahead, behind), near, strict=True))
        total = ahead + behind
        if not turn:
            kept = part.faces[total > 0]
        else:
            both = (np.minimum(ahead, behind) > BOTH_SIDES * total) & (total > 0)
            flipped = (behind > ahead) & ~both
            kept = np.where(flipped[:, None], part.faces[:, ::-1], part.faces)
            kept = np.concatenate([kept[total > 0], part.faces[both][:, ::-1]])
        if len(kept):
            used, kept = np.unique(kept, return_inverse=True)
            result.append(
                Part(
                    part.vertices[used],
                    kept.reshape(-1, 3),
                    part.uv[used],
                    part.texture,
                    part.kind,
                    part.slot,
                )
            )
    return result


def _spread(part: Part, count: np.ndarray) -> np.ndarray:
    """The mean of a count of faces at each vertex."""
    total = np.zeros(len(part.vertices))
    np.add.at(total, part.faces.ravel(), np.repeat(count, 3))
    return total


def weld(part: Part, size: float, seams: bool = True) -> Part:
    """Return the part with vertices of one place made one; with `seams`, only of one place in the picture."""
    key = np.round(part.vertices / (1e-4 * size)).astype(np.int64)
    if seams and part.texture.size > 3:
        key = np.hstack([key, np.round(part.uv * 512).astype(np.int64)])
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1)[part.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return Part(
        part.vertices[first], faces[np.sort(once)], part.uv[first], part.texture, part.kind, part.slot
    )


def decimate(parts: list[Part], most: int) -> list[Part]:
    """Return parts with some `most` faces together, each in proportion to the root of its faces and area."""
    if sum(len(part.faces) for part in parts) <= most:
        return parts
    shares = _shares([len(part.faces) for part in parts], [part.area for part in parts], most, 12)
    result = []
    for part, share in zip(parts, shares, strict=True):
        if share >= len(part.faces) or len(part.faces) < 16:
            result.append(part)
            continue
        closed = weld(part, float(np.ptp(part.vertices, axis=0).max()), seams=False)
        pieces = _thinned(_connected(closed), share) if part.kind == "leaf" else _connected(closed)
        own = _shares([len(piece.faces) for piece in pieces], [piece.area for piece in pieces], share, 6)
        joined = _join([_coarser(piece, int(count)) for piece, count in zip(pieces, own, strict=True)])
        result.append(_with_picture(part, joined.vertices, joined.faces))
    if sum(len(part.faces) for part in result) > MORE * most:  # many small pieces, as pages of a book
        return _cluster(result, most)
    return result


def _shares(counts: list[int], areas: list[float], most: float, least: int) -> np.ndarray:
    """Return how many of `most` faces each gets, of those it has and at least `least`."""
    weight = np.sqrt(np.array(counts, float) * (np.array(areas) / max(sum(areas), 1e-12) + 1e-6))
    return np.minimum(counts, np.maximum(most * weight / weight.sum(), least))


def _connected(part: Part) -> list[Part]:
    """Return the pieces of a welded part that hang together."""
    links = coo_matrix(
        (np.ones(2 * len(part.faces)), (part.faces[:, [0, 0]].ravel(), part.faces[:, [1, 2]].ravel())),
        (len(part.vertices),) * 2,
    )
    label = connected_components(links, directed=False)[1][part.faces[:, 0]]
    order = np.argsort(label, kind="stable")
    pieces = []
    for faces in np.split(part.faces[order], np.flatnonzero(np.diff(label[order])) + 1):
        used, faces = np.unique(faces, return_inverse=True)
        pieces.append(
            replace(part, vertices=part.vertices[used], faces=faces.reshape(-1, 3), uv=part.uv[used])
        )
    return pieces


def _thinned(pieces: list[Part], share: float) -> list[Part]:
    """Return as many of a plant's leaves as fit into a share of faces, larger as they are fewer."""
    each = max(4.0, min(8.0, float(np.mean([len(piece.faces) for piece in pieces]))))
    count = max(int(share / each), 1)
    if len(pieces) < 30 or count >= len(pieces):
        return pieces
    factor = min(np.sqrt(len(pieces) / count), MAX_LEAF)
    kept = [pieces[n] for n in np.linspace(0, len(pieces) - 1, count).astype(int)]
    lowest = [-np.inf, -np.inf, min(float(piece.vertices[:, 2].min()) for piece in pieces)]
    middles = [piece.vertices.mean(0) for piece in kept]
    return [
        replace(piece, vertices=np.maximum(middle + factor * (piece.vertices - middle), lowest))
        for piece, middle in zip(kept, middles, strict=True)
    ]


def _coarser(piece: Part, count: int) -> Part:
    """Return a piece with some `count` faces: its edges stay where that is possible, its extent always."""
    if count >= len(piece.faces):
        return piece
    extent = np.ptp(piece.vertices, axis=0)
    results = []
    for borders in (True, False):
        simplifier = pyfqmr.Simplify()
        simplifier.setMesh(piece.vertices.astype(np.float64), piece.faces.astype(np.int32))
        simplifier.simplify_mesh(count, aggressiveness=6, preserve_border=borders, verbose=False)
        points, faces, _ = simplifier.getMesh()
        if not len(faces):
            continue
        faces = np.asarray(faces, np.int64)
        used, faces = np.unique(faces, return_inverse=True)
        result = replace(
            piece, vertices=np.asarray(points)[used], faces=faces.reshape(-1, 3), uv=np.zeros((len(used), 2))
        )
        lost = (extent - np.ptp(result.vertices, axis=0)).max() / extent.max()
        if lost < 0.05 and result.area > 0.75 * piece.area:
            results.append(result)
            if len(result.faces) <= MORE * count + 8:
                return result
    return min([piece, *results], key=lambda each: len(each.faces))


def _cluster(parts: list[Part], most: int) -> list[Part]:
    """Return parts whose near vertices are joined, those of one cell of a grid."""
    pieces = [MeshPiece(part.vertices, part.faces, part.uv, np.full(1, n)) for n, part in enumerate(parts)]
    result = []
    for piece in simplified(pieces, most):
        part = parts[int(piece.texture[0])]
        result.append(replace(part, vertices=piece.vertices, faces=piece.faces, uv=piece.uv))
    return result


def _with_picture(part: Part, points: np.ndarray, faces: np.ndarray) -> Part:
    """Return decimated faces with the texture coordinates that their part has nearest to each corner, those
    of one face from one chart, so that no face lies across a seam."""
    corners = points[faces]
    if part.texture.size == 3:
        return replace(part, vertices=points, faces=faces, uv=np.zeros((len(points), 2)))
    links = coo_matrix(
        (np.ones(2 * len(part.faces)), (part.faces[:, [0, 0]].ravel(), part.faces[:, [1, 2]].ravel())),
        (len(part.vertices),) * 2,
    )
    chart = connected_components(links, directed=False)[1]
    inside = (corners + 2 * corners.mean(1, keepdims=True)) / 3
    middles = part.vertices[part.faces].mean(1)
    votes = chart[part.faces[cKDTree(middles).query(inside.reshape(-1, 3))[1]][:, 0]].reshape(-1, 3)
    of_face = np.where(votes[:, 1] == votes[:, 2], votes[:, 1], votes[:, 0])
    uv = np.empty((len(faces), 3, 2))
    for each in np.unique(of_face):
        own, here = np.flatnonzero(chart == each), of_face == each
        nearest = own[cKDTree(part.vertices[own]).query(corners[here].reshape(-1, 3))[1]]
        uv[here] = part.uv[nearest].reshape(-1, 3, 2)
    index = np.arange(3 * len(faces)).reshape(-1, 3)
    return replace(part, vertices=corners.reshape(-1, 3), faces=index, uv=uv.reshape(-1, 2))


def give_slots(parts: list[Part], slots: list[str], supports: list[tuple[float, ...]]) -> None:
    """Give the finishes that samples choose to a piece's large parts: `top` below the largest support, the
    first other slot to the largest remaining part, and to others that look like it."""
    left = [part for part in parts if part.kind not in ("glass", "metal", "leaf")]
    whole = sum(part.area for part in parts)
    if "top" in slots and supports and len(left) > 1:
        top = max(left, key=lambda part: _share_under(part, supports[0]))
        top.slot = "top"
        left = [part for part in left if part is not top]
    for slot in [each for each in slots if each != "top"]:
        left = [part for part in left if not part.slot]
        if not left:
            break
        main = max(left, key=lambda part: part.area)
        if main.area > 0.08 * whole:
            colour = main.texture.mean((0, 1))
            for part in left:
                if np.abs(part.texture.mean((0, 1)) - colour).max() < 0.12 and part.area > 0.02 * whole:
                    part.slot = slot
    for part in parts:
        if part.slot:
            part.texture = part.texture.mean((0, 1), keepdims=True)


def _share_under(part: Part, support: tuple[float, ...]) -> float:
    """Level area of a part at the height of a support."""
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    level = (np.abs((a + b + c)[:, 2] / 3 - support[3]) < 0.01) & (np.abs(normal[:, 2]) > 0)
    return float(np.abs(normal[level, 2]).sum())


def make_model(folder: Path, name: str, family: str, role: str, settings: dict[str, Any]) -> Model:
    """Make one model. ValueError where it cannot be used."""
    parts = read_parts(folder, name, settings.get("kind", "plastic"))
    turn = np.deg2rad(settings.get("turn", 0.0))
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    scale = settings.get("scale", 1.0)
    for part in parts:
        part.vertices = scale * part.vertices @ rotation.T
    size = float(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0).max())
    for part in parts:
        if settings.get("plain"):
            part.texture = part.texture.mean((0, 1), keepdims=True)
    parts = [weld(part, size) for part in parts]
    parts = keep_seen(parts, turn=False)
    most = settings.get("faces", 700 if role == "prop" else 500)
    whole, wanted = parts, most
    while True:
        parts = [weld(part, size) for part in decimate(whole, wanted)]
        parts = keep_seen([part for part in parts if len(part.faces)], turn=True)
        count = sum(len(part.faces) for part in parts)
        if count <= MORE * most or wanted < 60:
            break
        wanted = int(wanted * max(most / count, 0.4))
    points = np.concatenate([part.vertices for part in parts])
    low, high = points.min(0), points.max(0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    for part in parts:
        part.vertices = part.vertices - shift
    supports: list[tuple[float, ...]] = []
    if settings.get("glow"):
        brightest = max((part for part in parts if part.area > 0), key=lambda part: part.texture.mean())
        brightest.kind = "glow"
    if role == "furniture":
        supports = find_supports(parts, settings)
        give_slots(parts, settings.get("slots", []), supports)
    sides = high - low
    if role == "prop":
        parts = [part for part in parts if part.area > 0]
    count = sum(len(part.faces) for part in parts)
    row = ModelRow(role, name, family, "train", " ".join(settings.get("zones", ())) if role == "prop" else "",
                   "", "", "", "", *(f"{side:.3f}" for side in sides), str(count))  # fmt: skip
    return Model(row, parts, supports)


def find_supports(parts: list[Part], settings: dict[str, Any]) -> list[tuple[float, ...]]:
    """Return a piece's supports, the largest first: zone's number, centre, half, turn, clearance, behind."""
    zones = settings.get("zones", [])
    if not zones:
        return []
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    areas = [area for area in level_areas(vertices, faces) if min(area.half) >= 0.08]
    areas = [area for area in areas if area.centre[2] >= settings.get("lowest", 0.05)]
    areas = areas[: settings.get("supports", 6)]
    return [
        (
            ZONE_NAMES.index(zones[n % len(zones)]),
            *area.centre,
            *(side - RIM for side in area.half),
            area.turn,
            area.clearance,
            area.behind,
        )
        for n, area in enumerate(areas)
    ]


def pack(models: list[Model]) -> dict[str, np.ndarray]:
    """Return the arrays of the file, see `vig_world.assets.models.catalogue._arrays`."""
    ends, boxes, table, colours, uv_boxes, supports = [], [], [], [], [], []
    vertices, faces, uvs, pictures, palettes = [], [], [], [], []
    known: dict[bytes, int] = {}
    counts = np.zeros(3, int)
    for model in models:
        points = np.concatenate([part.vertices for part in model.parts])
        low, size = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-6)
        boxes.append([*low, *size])
        for part in model.parts:
            order = _in_order_of_use(part.faces)
            part.vertices, part.uv = part.vertices[order], part.uv[order]
            place = np.empty(len(order), int)
            place[order] = np.arange(len(order))
            part.faces = place[part.faces]
            quantised = np.round((part.vertices - low) / size * STEPS).astype(np.uint16)
            picture, box = -1, np.zeros(4)
            if part.texture.size > 3:
                indexed, palette = _indexed(part.texture)
                if (key := indexed.tobytes() + palette.tobytes()) not in known:
                    known[key] = len(pictures)
                    pictures.append(indexed)
                    palettes.append(palette)
                picture = known[key]
                corner, extent = part.uv.min(0), np.maximum(np.ptp(part.uv, axis=0), 1e-6)
                box = np.concatenate([corner, extent])
                uvs.append(np.round((part.uv - corner) / extent * STEPS).astype(np.uint16))
                counts[2] += len(part.uv)
            vertices.append(quantised)
            faces.append(part.faces.astype(np.uint16))
            counts[:2] += len(part.vertices), len(part.faces)
            kind = len(KINDS) if part.kind == "glow" else KINDS.index(part.kind)
            table.append([*counts, picture, SLOTS.index(part.slot), kind])
            colours.append(np.round(255 * srgb_from_linear(part.texture.mean((0, 1)))).astype(np.uint8))
            uv_boxes.append(box)
        supports += model.supports
        ends.append([len(table), len(supports)])
    return {
        "ends": np.array(ends, np.int32),
        "boxes": np.array(boxes, np.float32),
        "parts": np.array(table, np.int32),
        "colours": np.array(colours, np.uint8),
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "uv": np.concatenate([*uvs, np.zeros((0, 2), np.uint16)]),
        "uv_boxes": np.array(uv_boxes, np.float32),
        "pictures": np.array(pictures, np.uint8).reshape(-1, PICTURE_SIDE, PICTURE_SIDE),
        "palettes": np.array(palettes, np.uint8).reshape(-1, PALETTE, 3),
        "supports": np.array(supports, np.float32).reshape(-1, 9),
    }


def _in_order_of_use(faces: np.ndarray) -> np.ndarray:
    """Return the vertices in the order in which faces name them, which packs better."""
    used, first = np.unique(faces.ravel(), return_index=True)
    return used[np.argsort(first)]


def _indexed(texture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a texture as (S, S) numbers in a palette (C, 3), sRGB."""
    srgb = np.round(255 * srgb_from_linear(texture)).astype(np.uint8)
    image = Image.fromarray(srgb).resize((PICTURE_SIDE, PICTURE_SIDE), Image.Resampling.BOX)
    reduced = image.quantize(PALETTE, dither=Image.Dither.NONE)
    palette = np.zeros(PALETTE * 3, np.uint8)
    given = reduced.getpalette()[: PALETTE * 3]
    palette[: len(given)] = given
    return np.asarray(reduced, np.uint8), palette.reshape(PALETTE, 3)


def write(arrays: dict[str, np.ndarray], models: list[Model], folder: Path) -> None:
    """Write the two files; the same models give the same bytes."""
    with zipfile.ZipFile(folder / "models.npz", "w", zipfile.ZIP_LZMA) as file:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array))
            file.writestr(zipfile.ZipInfo(f"{name}.npy", (2020, 1, 1, 0, 0, 0)), buffer.getvalue(),
                          zipfile.ZIP_LZMA)  # fmt: skip
    with (folder / "models.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(ModelRow)])
        writer.writerows(astuple(model.row) for model in models)


def licence_of(text: str) -> str:
    """Return the short name of a licence as catalogues state it."""
    if "Attribution 3.0" in text:
        return "CC-BY 3.0 US" if "United States" in text else "CC-BY 3.0"
    if "Public domain" in text:
        return "Public domain"
    raise ValueError(f"expected the public domain or CC-BY 3.0; got {text}")


def authors_page(rows: list[ModelRow]) -> str:
    """Return docs/models.md: who made what, under which licence."""
    lines = [
        "# Who made the packaged models?", "",
        "The [generator](world.md#packaged-models) shows changed versions of these models: simplified,",
        "with parts of like colours joined and pictures reduced.", "",
        "| author | licence | catalogue | models |", "|---|---|---|---|",
    ]  # fmt: skip
    titles: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        titles.setdefault((row.author, row.licence, row.catalogue), []).append(row.title)
    for (author, licence, catalogue), own in sorted(titles.items()):
        page = CC_BY + ("us/" if licence.endswith("US") else "")
        stated = f"[{licence}]({page})" if "CC-BY" in licence else licence
        lines.append(f"| {author} | {stated} | {catalogue} | {', '.join(sorted(own))} |")
    return "\n".join(lines) + "\n"


def write_authors(rows: list[ModelRow]) -> None:
    """Write the page of authors and licences, for the site and for the wheel."""
    page = authors_page(rows)
    PAGE.write_text(page, encoding="utf-8")
    text = page.replace("[generator](world.md#packaged-models)", "generator of vig")
    (FOLDER / "LICENSES.md").write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("catalogues", type=Path, help="the folder of .sh3f files")
    parser.add_argument("--out", type=Path, default=FOLDER)
    arguments = parser.parse_args()
    folder = mesh_folder(arguments.catalogues)
    sources = {Path(source.file).parent.name: source for source in read_sources(folder).models}
    selection = tomllib.loads(SELECTION.read_text())
    models = []
    for role in ("prop", "furniture"):
        for family, settings in sorted(selection[role].items()):
            own = settings.get("of", {})
            for split in ("train", "test", "validation"):
                for name in settings.get(split, []):
                    model = make_model(folder, name, family, role, {**settings, **own.get(name, {})})
                    source = sources[name]
                    author = source.creator or source.catalogue.removesuffix(".sh3f")
                    row = {**vars(model.row), "split": split, "title": source.name, "author": author,
                           "licence": licence_of(source.licence), "catalogue": source.catalogue}  # fmt: skip
                    model.row = ModelRow(**row)
                    models.append(model)
                    print(f"{role} {family} {split} {name}: {model.row.faces} faces, "
                          f"{len(model.parts)} parts, {len(model.supports)} supports")  # fmt: skip
    write(pack(models), models, arguments.out)
    write_authors([model.row for model in models])
    size = (arguments.out / "models.npz").stat().st_size
    print(f"{len(models)} models, {sum(int(m.row.faces) for m in models):,} faces, {size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
