"""Groups of objects: the same for the same seed, labels that agree, objects that overlap and are seen."""

from typing import Any

import numpy as np
import pytest

from benchmarks import groups as grouping
from benchmarks.groups import MIN_SEEN, OVERLAP, Group, make_group
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import CompositionError, sample
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library

COUNT = 3


@pytest.fixture(scope="module")
def classes() -> list[ObjectClass]:
    return [ObjectClass.load("teapot"), ObjectClass.load("mug")]


@pytest.fixture(scope="module")
def groups(classes: list[ObjectClass]) -> list[Group]:
    library = Library("validation")
    return [make_group(library, classes, 7, index) for index in range(COUNT)]


def test_objects_overlap_and_each_is_seen(groups: list[Group]):
    for group in groups:
        assert 2 <= len(group.amodal) <= 4
        assert (group.visible.sum((1, 2)) >= 0.8 * MIN_SEEN * group.amodal.sum((1, 2))).all()
        for number in range(1, len(group.amodal)):
            mine = group.amodal[number]
            shared = [(mine & other).sum() / min(mine.sum(), other.sum()) for other in group.amodal[:number]]
            assert max(shared) > 0.5 * OVERLAP


def test_no_pixel_shows_two_objects_and_what_hides_is_where_both_are(groups: list[Group]):
    for group in groups:
        assert group.visible.sum(0).max() == 1
        assert not (group.visible & ~group.amodal).any()
        for i, j in np.argwhere(group.occludes):
            assert (group.amodal[i] & group.amodal[j] & ~group.visible[j]).any()


def test_masks_are_where_each_view_projects_its_mesh(groups: list[Group], classes: list[ObjectClass]):
    by_name = {each.name: each for each in classes}
    for group in groups:
        for member, view, mask in zip(group.spec.members, group.views, group.amodal, strict=True):
            object_class = by_name[member.class_name]
            vertices = target_vertices(member.scene, object_class)
            drawn = np.isfinite(view.depth(vertices, object_class.shape_model.faces))
            assert (drawn ^ mask).sum() < 0.05 * mask.sum()


def test_angles_are_those_of_the_eye_about_each_object(groups: list[Group], classes: list[ObjectClass]):
    heights = {each.name: each.target_height for each in classes}
    for group in groups:
        for member, view in zip(group.spec.members, group.views, strict=True):
            x, y, z = view.eye - [0, 0, heights[member.class_name]]
            assert np.arctan2(x, -y) % (2 * np.pi) == pytest.approx(member.scene.azimuth % (2 * np.pi))
            assert np.arctan2(z, np.hypot(x, y)) == pytest.approx(member.scene.elevation, abs=1e-6)


def test_same_seed_and_index_give_the_same_photo(groups: list[Group], classes: list[ObjectClass]):
    again = make_group(Library("validation"), classes, 7, 1)
    assert np.array_equal(again.photo, groups[1].photo)
    assert again.spec == groups[1].spec


def test_a_group_that_no_room_takes_is_drawn_anew(
    classes: list[ObjectClass], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*given: Any, draw: int, **named: Any) -> SceneSpec:
        draws.append(draw)
        if draw < 2:
            raise CompositionError("no room")
        return sample(*given, draw=draw, **named)

    draws: list[int] = []
    monkeypatch.setattr(grouping, "sample", failing)
    spec = grouping.sample_group(Library("validation"), classes, 7, 0)
    assert draws[: 2 * grouping.GROUPS] == [0] * grouping.GROUPS + [1] * grouping.GROUPS
    assert spec.members[0].scene.rejected["scene"] == 2
    monkeypatch.setattr(grouping, "REDRAWN", 1)
    with pytest.raises(UserError, match="group 0 of seed 7: expected a place for it; got none"):
        grouping.sample_group(Library("validation"), classes, 7, 0)
