import pytest

from vig_world.assets.own.copies import cut_at_level, shape_copies


@pytest.mark.parametrize(
    "names",
    [
        "mug_LOD0 mug_LOD1 mug.lod2 mug-LOD3 mugLod4",
        "mug mug_LOD1",
        "LOD0/mug lod1/mug",
        "mug/model mug/LOD2",
        "mug_high mug-low mug_mid mug_lowpoly mug_decimated",
        "mug/google_64k/textured mug/google_16k/textured",
        "mug UCX_mug_00 UCX_mug_01 mug_collision mug-colonly mug_convex_hull mug_vhacd12",
        "meshes/visual/mug meshes/collision/mug",
        "mug/mug mug/collision",
    ],
)
def test_all_but_the_first_repeat_the_first(names: str) -> None:
    words = names.split()
    faces = range(len(words), 0, -1)
    copies = shape_copies([*words, "cup"], [*faces, 9], lambda *pair: True)
    assert copies == dict.fromkeys(range(1, len(words)), 0)


@pytest.mark.parametrize(
    "names",
    ["mug1 mug2", "explod1 explod2", "chair_high chair_low", "UCX_a UCX_b", "LOD1/a LOD0/b", "col hull"],
)
def test_what_is_not_the_same_by_name_or_by_shape_stays(names: str) -> None:
    assert not shape_copies(names.split(), [2, 1], lambda *pair: False)


def test_a_part_of_a_ship_may_be_its_hull() -> None:
    assert not shape_copies(["ship", "ship/hull"], [2, 1])
    assert shape_copies(["ship", "UCX_ship"], [2, 1]) == {1: 0}
    assert cut_at_level("root/car_LOD1/body") == "root/car_LOD1" and cut_at_level("root/car") == "root/car"
