"""The part of a class that is dark on most of its meshes."""

import numpy as np
import pytest
import trimesh

from tests.source_meshes import BLACK, RED, box, piece
from vig_train.building.materials import GLASS_RATIO, dark_part
from vig_world.assets.own.load import MeshPiece
from vig_world.assets.source_meshes import SourceMesh

SOLID = trimesh.creation.box((0.4, 0.2, 0.2)).subdivide().subdivide().subdivide()
VERTICES, FACES = np.array(SOLID.vertices) + [0, 0, 0.1], np.array(SOLID.faces)
FRONT = VERTICES[:, 0] > 0.11


def two_halves(body: MeshPiece, front: MeshPiece) -> SourceMesh:
    return SourceMesh.of([body, front], np.eye(3), np.zeros(3), VERTICES, 0, "train")


def made(front: tuple[float, float, float], opacity: float = 1.0, body: tuple = RED) -> SourceMesh:
    """A box whose front quarter is of a colour of its own."""
    return two_halves(
        piece(box((0.3, 0.2, 0.2), (-0.05, 0, 0.1)), body),
        piece(box((0.1, 0.2, 0.2), (0.15, 0, 0.1)), front, opacity),
    )


def test_what_is_dark_on_most_meshes_is_a_part() -> None:
    meshes = [made(BLACK), made(BLACK, body=(0.1, 0.4, 0.8)), made(BLACK), made((0.8, 0.8, 0.8))]
    found = dark_part(meshes, VERTICES, FACES)
    assert found is not None
    dark, reflectance = found
    assert (dark == FRONT).mean() > 0.9
    assert 0.03 <= reflectance < 0.2


def test_glass_is_dark() -> None:
    found = dark_part([made((0.8, 0.8, 0.8), opacity=0.3)] * 3, VERTICES, FACES)
    assert found is not None and found[1] == pytest.approx(GLASS_RATIO)


def test_one_mesh_tells_of_its_own_class() -> None:
    found = dark_part([made(BLACK)], VERTICES, FACES)
    assert found is not None and (found[0] == FRONT).mean() > 0.9


@pytest.mark.parametrize(
    "meshes",
    [
        [],
        [made(BLACK), made(BLACK)],  # too few to speak for a class
        [made(BLACK), made((0.8, 0.8, 0.8)), made((0.8, 0.2, 0.8))],  # they do not agree
        [made(RED)] * 3,  # nothing is dark
        [made(RED, body=BLACK)] * 3,  # most is dark: that is the colour of the thing
    ],
)
def test_what_tells_nothing_makes_no_part(meshes: list[SourceMesh]) -> None:
    assert dark_part(meshes, VERTICES, FACES) is None
