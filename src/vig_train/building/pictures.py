"""Contact sheets of meshes, and curves, for each stage of building a class."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from vig.io.files import atomic_write
from vig_train.building.model import Components
from vig_train.building.surface import camera_rotation, draw_alone, sphere_of
from vig_world.mesh import vertex_normals

ASIDE = (0.35, -1.0, 0.45)  # direction from which meshes are shown, not of unit length
ABOVE = (0.0, -0.02, 1.0)  # direction of the view from above
LIGHT = np.array([0.3, -0.5, -0.8]) / math.sqrt(0.98)  # direction of the light in the camera's frame

Drawable = tuple[np.ndarray, np.ndarray]  # vertices (V, 3) and faces (F, 3)


def shade_mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    direction: tuple[float, float, float],
    side: int,
    colours: np.ndarray | None = None,
    frame: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Return a picture (side, side, 3) uint8 of a mesh on white.

    colours: (V, 3) of the vertices, in [0, 1]. frame: middle (3,) and radius of the sphere that fills the
    picture; the mesh's own by default.
    """
    towards = np.array(direction) / np.linalg.norm(direction)
    rotation = camera_rotation(towards, np.array([0, 0, 1]))
    sphere = frame or sphere_of(vertices)
    covered, face, weights = draw_alone(vertices, faces, rotation, sphere, side, 1.03)
    corners = faces[face]
    normal = np.einsum("nk,nkd->nd", weights, vertex_normals(vertices, faces)[corners]) @ rotation.T
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
    light = 0.15 + 0.8 * np.abs(normal @ LIGHT)
    picture = np.full((side, side, 3), 255.0)
    colour = 0.9 if colours is None else np.einsum("nk,nkd->nd", weights, colours[corners])
    picture[covered] = 255 * light[:, None] * colour
    return picture.clip(0, 255).astype(np.uint8)


def save_mesh_sheet(
    path: Path,
    meshes: list[Drawable],
    above: bool = False,
    side: int = 150,
    checks: np.ndarray | None = None,
    labels: Sequence[str] = (),
    arrow: str = "",
) -> None:
    """Write a sheet of meshes with their labels, by default their numbers from 1 on.

    above: Show each from above too. arrow: Name of the part at +X, which gets an arrow. checks: (V, 3)
    places on the template by which each vertex is coloured, so that the same colours are the same places.
    """
    colours = None
    if checks is not None:
        colours = 0.55 + 0.45 * np.sin(30 * (checks - checks.min(0)) / np.ptp(checks, axis=0).max())
    tiles = []
    for number, (vertices, faces) in enumerate(meshes):
        views = [shade_mesh(vertices, faces, ASIDE, side, colours)]
        if above:
            views.append(shade_mesh(vertices, faces, ABOVE, side, colours))
        tile = _label_tile(np.concatenate(views), labels[number] if labels else str(number + 1))
        tiles.append(_with_arrow(tile, arrow) if arrow else tile)
    _save(path, _grid(tiles))


def save_component_sheet(path: Path, model: Components, faces: np.ndarray) -> None:
    """Write a sheet of the mean and of each component at -2 and +2 standard deviations."""
    frame = sphere_of(model.mean)
    frame = frame[0], 1.15 * frame[1]
    tiles = [
        _label_tile(np.concatenate([shade_mesh(model.mean, faces, ASIDE, 150, None, frame)] * 2), "mean")
    ]
    for number, component in enumerate(model.basis, 1):
        pair = [
            shade_mesh(model.mean + sign * 2 * component, faces, ASIDE, 150, None, frame) for sign in (-1, 1)
        ]
        tiles.append(_label_tile(np.concatenate(pair), f"{number}: -2, +2"))
    _save(path, _grid(tiles))


def save_error_curve(path: Path, model: Components) -> None:
    """Write the curve of the leave-one-out error by number of components."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"font.size": 9}):
        figure = Figure(figsize=(5, 3), dpi=110, layout="constrained")
        axes = figure.add_subplot()
        if model.errors:
            axes.plot(range(len(model.errors)), 100 * np.array(model.errors), "o-", markersize=3)
            axes.axvline(len(model.basis), color="0.6", linewidth=1)
            axes.set_ylim(0)
        axes.set_xlabel("components")
        axes.set_ylabel("leave-one-out error, % of size")
        with atomic_write(path) as temporary:
            figure.savefig(temporary, metadata={"Software": None})


def _label_tile(tile: np.ndarray, text: str) -> np.ndarray:
    image = Image.fromarray(tile)
    ImageDraw.Draw(image).text((4, 2), text, fill=(200, 30, 30))
    return np.asarray(image)


def _with_arrow(tile: np.ndarray, text: str) -> np.ndarray:
    """Return a tile with an arrow to the right at its foot, in whose views +X is on the right."""
    height, width = tile.shape[:2]
    image, y, tip = Image.fromarray(tile), height - 8, width - 6
    draw, colour = ImageDraw.Draw(image), (30, 60, 200)
    draw.line([(width * 0.55, y), (tip, y)], fill=colour, width=2)
    draw.polygon([(tip + 3, y), (tip - 6, y - 4), (tip - 6, y + 4)], fill=colour)
    draw.text((width * 0.55, y - 4), text[:13], fill=colour, anchor="rm")
    return np.asarray(image)


def _grid(tiles: list[np.ndarray]) -> np.ndarray:
    columns = min(len(tiles), max(1, math.ceil(math.sqrt(1.8 * len(tiles)))))
    blank = np.full_like(tiles[0], 255)
    rows = [tiles[start : start + columns] for start in range(0, len(tiles), columns)]
    rows[-1] = rows[-1] + [blank] * (columns - len(rows[-1]))
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def _save(path: Path, picture: np.ndarray) -> None:
    with atomic_write(path) as temporary:
        Image.fromarray(picture).save(temporary)
