"""Users' furniture: where things can stand on it is found from its triangles."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from vig.io.errors import UserError
from vig_world.assets.own.furniture import read_furniture
from vig_world.assets.own.supports import largest_rectangle


def board(size: tuple[float, float, float], middle: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(middle)
    return mesh


def table() -> list[trimesh.Trimesh]:
    legs = [board((0.06, 0.06, 0.7), (x, y, 0.35)) for x in (-0.5, 0.5) for y in (-0.3, 0.3)]
    return [board((1.2, 0.8, 0.05), (0, 0, 0.725)), *legs]


def bookcase(doors: bool = False) -> list[trimesh.Trimesh]:
    """1 m wide, 0.3 m deep, boards at 0.1, 0.5, 0.9 and 1.3 m; closed at +y."""
    boards = [board((1.0, 0.3, 0.02), (0, 0, z)) for z in (0.09, 0.49, 0.89, 1.29)]
    sides = [board((0.02, 0.3, 1.3), (x, 0, 0.65)) for x in (-0.51, 0.51)]
    back = board((1.04, 0.02, 1.3), (0, 0.16, 0.65))
    front = [board((1.04, 0.02, 1.25), (0, -0.16, 0.675))] if doors else []
    return [*boards, *sides, back, *front]


def save(path: Path, parts: list[trimesh.Trimesh], y_up: bool = False) -> None:
    mesh = trimesh.util.concatenate(parts)
    if y_up:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    mesh.export(path)


@pytest.mark.parametrize(("name", "y_up"), [("table.glb", True), ("table.obj", True), ("table.stl", False)])
def test_on_a_table_things_stand_on_its_top(tmp_path: Path, name: str, y_up: bool) -> None:
    save(tmp_path / name, table(), y_up)
    ((own,), problems) = read_furniture(tmp_path)
    assert problems == [] and own.family == "table"
    (support,) = own.read().supports
    assert support.zone == "dining" and support.clearance == support.behind == float("inf")
    np.testing.assert_allclose(support.centre, [0, 0, 0.75], atol=0.02)
    np.testing.assert_allclose(support.half, [0.6, 0.4], atol=0.03)
    assert support.half[0] <= 0.6 and support.half[1] <= 0.4  # nothing stands over the edge


def test_a_bookcase_has_its_boards_with_their_clearance_and_back(tmp_path: Path) -> None:
    save(tmp_path / "old_bookcase.glb", bookcase(), y_up=True)
    ((own,), _) = read_furniture(tmp_path)
    boards = sorted(own.read().supports, key=lambda support: support.centre[2])
    np.testing.assert_allclose([s.centre[2] for s in boards], [0.1, 0.5, 0.9, 1.3], atol=1e-3)
    np.testing.assert_allclose([s.clearance for s in boards[:3]], 0.38, atol=1e-3)
    assert boards[3].clearance == float("inf") and {s.turn for s in boards} == {0.0}
    assert all(s.behind < 0.03 for s in boards[:3]) and boards[3].behind == float("inf")
    assert [s.zone for s in boards] == ["storage", "storage", "display", "display"]


def test_a_support_faces_the_open_side(tmp_path: Path) -> None:
    parts = bookcase()
    for part in parts:  # its open side to +x
        part.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1]))
    save(tmp_path / "shelf.glb", parts, y_up=True)
    ((own,), _) = read_furniture(tmp_path)
    lower = [s for s in own.read().supports if s.centre[2] < 1.2]
    assert len(lower) == 3
    for support in lower:
        assert abs(support.turn - np.pi / 2) < 1e-9 and support.behind < 0.03
        np.testing.assert_allclose(support.half, [0.5, 0.15], atol=0.02)  # along its own axes
    (tmp_path / "vig.toml").write_text("[defaults]\nturn = -90\n")
    assert {s.turn for s in read_furniture(tmp_path)[0][0].read().supports} == {0.0}


def test_behind_shut_doors_nothing_stands(tmp_path: Path) -> None:
    save(tmp_path / "cabinet.glb", bookcase(doors=True), y_up=True)
    ((own,), _) = read_furniture(tmp_path)
    assert [round(s.centre[2], 2) for s in own.read().supports] == [1.3]


def test_zones_and_family_can_be_told(tmp_path: Path) -> None:
    save(tmp_path / "thing.glb", bookcase(), y_up=True)
    (tmp_path / "vig.toml").write_text('[defaults]\nzones = ["desk", "display"]\nfamily = "shelf"\n')
    ((own,), _) = read_furniture(tmp_path)
    assert own.family == "shelf"
    assert {s.zone for s in own.read().supports} == {"desk", "display"}


def test_what_holds_nothing_is_kept_if_tall_and_said(tmp_path: Path) -> None:
    trimesh.creation.cone(0.3, 1.5).export(tmp_path / "cone.stl")
    save(tmp_path / "low.stl", [board((0.1, 0.8, 0.1), (0, 0, 0.05))])
    ((own,), problems) = read_furniture(tmp_path)
    assert own.name == "cone.stl" and own.read().supports == ()
    assert len(problems) == 2 and any("cone.stl: found no level area" in problem for problem in problems)
    assert any("low.stl: expected furniture" in problem for problem in problems)


def test_a_prop_is_no_furniture(tmp_path: Path) -> None:
    save(tmp_path / "cup.glb", [board((0.0001, 0.0001, 0.0001), (0, 0, 0))], y_up=True)
    with pytest.raises(UserError, match="a piece of furniture of 0.3 to 4 m"):
        read_furniture(tmp_path)


def test_the_largest_rectangle_equals_the_one_found_by_trying_all() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        grid = rng.uniform(size=(6, 8)) < 0.7
        best = max(
            (b - t) * (r - le)
            for t in range(6) for b in range(t + 1, 7) for le in range(8) for r in range(le + 1, 9)
            if grid[t:b, le:r].all()
        )  # fmt: skip
        top, bottom, left, right = largest_rectangle(grid)
        assert grid[top:bottom, left:right].all() and (bottom - top) * (right - left) == best
    assert largest_rectangle(np.zeros((3, 3), bool)) == (0, 0, 0, 0)
