"""Several objects in one photo: what hides what, masks that exclude each other, files, and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import vig
from benchmarks.groups import Group, make_group
from tests.support import run_vig
from vig.explanation import Explanation
from vig.io.errors import UserError
from vig.several import MAX_OBJECTS, SceneExplanation, explain_found, explain_together, order
from vig.several.explain import ghosts
from vig.several.joint import _Refit, _without, _without_cycles
from vig_app.exports import export_run
from vig_app.results import read_results
from vig_world.library import Library

pytestmark = pytest.mark.usefixtures("remembered_networks")

SEED, INDEX = 7, 44
"""Four objects; the fit alone of the second takes much of what is before it for its own."""


@pytest.fixture(scope="module")
def explainers() -> dict[str, vig.Explainer]:
    return {name: vig.Explainer(name) for name in ("teapot", "mug")}


@pytest.fixture(scope="module")
def group(explainers: dict[str, vig.Explainer]) -> Group:
    classes = [each.object_class for each in explainers.values()]
    return make_group(Library("validation"), classes, SEED, INDEX)


@pytest.fixture(scope="module")
def scene(group: Group, explainers: dict[str, vig.Explainer]) -> SceneExplanation:
    chosen = [explainers[member.class_name] for member in group.spec.members]
    return explain_together(group.photo, chosen, boxes_of(group))


@pytest.fixture(scope="module")
def alone(group: Group, explainers: dict[str, vig.Explainer]) -> list[Explanation]:
    members = zip(group.spec.members, boxes_of(group), strict=True)
    return [explainers[member.class_name].explain(group.photo, box) for member, box in members]


def boxes_of(group: Group) -> list[tuple[float, float, float, float]]:
    return [(float(x), float(y), float(w), float(h)) for x, y, w, h in group.boxes]


@pytest.fixture
def photo(group: Group, tmp_path: Path) -> Path:
    """The group's photo, with boxes for it and its copy."""
    Image.fromarray(group.photo).save(tmp_path / "photo.png")
    objects = [
        {"box": box, "class": member.class_name}
        for box, member in zip(group.boxes, group.spec.members, strict=True)
    ]
    (tmp_path / "boxes.json").write_text(json.dumps({"photo.png": objects}))
    return tmp_path / "photo.png"


def test_masks_exclude_each_other_and_are_where_each_object_is_seen(group: Group, scene: SceneExplanation):
    assert scene.masks.sum(0).max() == 1
    for mask, visible in zip(scene.masks, group.visible, strict=True):
        assert (mask & visible).sum() > 0.6 * (mask | visible).sum()


def test_what_hides_what_is_told(group: Group, scene: SceneExplanation):
    one_way = group.occludes & ~group.occludes.T
    assert one_way.any()
    assert (scene.occludes & ~scene.occludes.T)[one_way].all()


def test_order_follows_who_is_seen_where_both_are(
    scene: SceneExplanation, explainers: dict[str, vig.Explainer]
):
    one, other = scene.objects[:2]
    shape = one.fit.coverage.shape
    everywhere = np.ones(shape, np.float32)
    pair = [
        replace(each, window=one.window, fit=replace(each.fit, coverage=everywhere)) for each in (one, other)
    ]
    explainer = explainers[one.object_class.name]
    predicted = explainer.recognizer(np.zeros((1, *shape, 3), np.float32))
    seen = replace(predicted, mask=np.tile(np.float32([0.9, 0.05, 0.05]), (1, *shape, 1)))
    hidden = replace(predicted, mask=np.tile(np.float32([0.05, 0.9, 0.05]), (1, *shape, 1)))
    assert order(pair, [seen, hidden]).tolist() == [[False, True], [False, False]]
    assert order(pair, [hidden, seen]).tolist() == [[False, False], [True, False]]


def test_the_scenes_file_shows_all_on_one_ground_where_the_photo_does(
    scene: SceneExplanation, tmp_path: Path
) -> None:
    scene.save(tmp_path, files=["object.glb"])
    data = (tmp_path / "scene.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    described, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    *nodes, eye = described["nodes"]
    assert [node["name"] for node in nodes] == list(scene.names) and eye["name"] == "camera"
    extras = described["cameras"][0]["extras"]
    camera_from_world = np.diag([1, -1, -1, 1]) @ np.linalg.inv(np.reshape(eye["matrix"], (4, 4)).T)
    for node, each, (matrix, pose) in zip(nodes, scene.objects, scene.poses, strict=True):
        np.testing.assert_allclose(extras["K"], matrix)
        (primitive, *_) = described["meshes"][node["mesh"]]["primitives"]
        view = described["bufferViews"][
            described["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]
        ]
        stored = np.frombuffer(binary, "<f4", view["byteLength"] // 4, view["byteOffset"]).reshape(-1, 3)
        assert len(stored) > len(each.vertices), "doubled along the texture's seams"
        points, turn = np.c_[stored, np.ones(len(stored))].T, np.reshape(node["matrix"], (4, 4)).T
        seen, expected = (matrix @ (to_camera @ points)[:3] for to_camera in (camera_from_world @ turn, pose))
        np.testing.assert_allclose(seen[:2] / seen[2], expected[:2] / expected[2], atol=1e-6)
        assert 1 / 1.5 <= node["extras"]["scale"] <= 1.5
        assert abs(turn[1, 3]) < 1e-9, "its foot is on the ground"
        assert turn[1, 2] / node["extras"]["scale"] > 0.99, "and it stands upright"
    scene.save(tmp_path, files=["mask.png"])
    assert not (tmp_path / "scene.glb").exists()


def test_one_object_is_explained_as_alone(
    group: Group, explainers: dict[str, vig.Explainer], alone: list[Explanation]
):
    found = explain_together(group.photo, [explainers[group.spec.members[0].class_name]], boxes_of(group)[:1])
    assert found.objects[0].azimuth_deg == alone[0].azimuth_deg
    assert not found.occludes.any()


def test_a_find_within_another_with_an_improbable_mask_is_a_ghost(alone: list[Explanation]):
    def with_mask(each: Explanation, confidence: float, view: float = 0.2) -> Explanation:
        return replace(each, fit=replace(each.fit, mask_confidence=confidence, confidence=view))

    first, elsewhere = (with_mask(each, 0.9) for each in alone[:2])
    assert ghosts([first, elsewhere, with_mask(first, 0.01)]) == [False, False, True]
    assert not any(ghosts([first, with_mask(first, 0.06)])), "its mask may be right"
    assert not any(ghosts([first, with_mask(first, float("nan"))])), "nothing was learned of it"
    assert not any(ghosts([first, with_mask(first, 0.01, 0.9)])), "its view is right"
    assert not any(ghosts([with_mask(elsewhere, 0.01), first])), "an object of its own"
    hidden = replace(with_mask(elsewhere, 0.01), others=np.ones(elsewhere.amodal.shape, bool))
    assert ghosts([hidden, first]) == [True, False]
    assert not any(ghosts([with_mask(first, 0.01)] * 2)), "one of them stays"


def test_what_cannot_be_explained_is_refused(
    group: Group, scene: SceneExplanation, explainers: dict[str, vig.Explainer], tmp_path: Path
):
    teapot, box, grey = explainers["teapot"], boxes_of(group)[0], np.full((120, 160, 3), 90, np.uint8)
    given: list[vig.Explainer]
    for given, boxes in (([teapot], [box, box]), ([], []), ([teapot] * 25, [box] * 25)):
        with pytest.raises(UserError, match=f"1 to {MAX_OBJECTS} objects"):
            explain_together(group.photo, given, boxes)
    with pytest.raises(UserError, match="got a str in it"):
        explain_together(group.photo, ["teapot"], [box])  # type: ignore[list-item]
    for count, words in ((2, "found none. Give boxes"), (0, "objects; got 0")):
        with pytest.raises(UserError, match=words):
            explain_found(grey, [explainers["mug"]], count)
    with pytest.raises(UserError, match=r"expected files of .* got 'picture.png'"):
        scene.save(tmp_path / "scene", files=["mask.png", "picture.png"])
    assert not (tmp_path / "scene").exists()


def test_command_writes_a_folder_for_each_object_and_its_row(photo: Path, scene: SceneExplanation):
    out = photo.parent / "out"
    other = photo.with_name("other.png")
    other.write_text("no photo")
    command = ["fit", str(photo), str(other), "--boxes", str(photo.parent / "boxes.json"), "--out", str(out)]
    assert run_vig(*command, "--quiet") == 1
    told = json.loads((out / "photo" / "scene.json").read_text())
    assert told["objects"] == list(scene.names)
    assert told["before"] == scene.to_dict()["before"]
    rows = [row for row in read_results(out) if row["photo"] == str(photo)]
    assert [row["folder"] for row in rows] == [f"photo/{name}" for name in scene.names]
    assert [row["object"] for row in rows] == list(range(1, len(rows) + 1))
    numbers = np.asarray(Image.open(out / "photo" / "mask.png"))
    for number, (row, mask) in enumerate(zip(rows, scene.masks, strict=True), 1):
        folder = out / row["folder"]
        assert np.array_equal(np.asarray(Image.open(folder / "mask.png")) == 255, mask)
        assert np.array_equal(numbers == number, mask)
        assert (folder / "report.html").exists()
    assert "is before" in (out / "photo" / "report.html").read_text()
    assert len(export_run(out, ["bop"])[0].read_text().splitlines()) == 1 + len(rows)
    before = (out / "photo" / "scene.json").stat().st_mtime_ns
    assert run_vig(*command, "--quiet") == 1
    assert (out / "photo" / "scene.json").stat().st_mtime_ns == before  # done before


def test_each_is_fitted_again_and_what_is_before_it_is_not_its_own(
    group: Group, scene: SceneExplanation, alone: list[Explanation]
):
    behind = 1
    infront, _ = _Refit(alone, scene.occludes, behind)._others()
    taken, left = ((each[behind].fit.mask & infront).sum() for each in (alone, scene.objects))
    assert taken > 50
    assert left < 0.25 * taken
    visible = group.visible[behind]
    before, after = (
        (each.mask & visible).sum() / (each.mask | visible).sum()
        for each in (alone[behind], scene.objects[behind])
    )
    assert after > max(0.65, before + 0.3), ".33 and .92 when this was written"
    assert np.allclose(scene.poses[behind][0], scene.poses[0][0])  # one camera


def test_elevation_and_light_are_drawn_to_those_that_the_others_tell(
    alone: list[Explanation], explainers: dict[str, vig.Explainer]
):
    refit = _Refit(alone, np.zeros((len(alone),) * 2, bool), 0)
    recognizer = explainers[alone[0].object_class.name].recognizer
    prediction = recognizer(np.zeros((1, 150, 150, 3), np.float32))
    place = prediction.layout["elevation"]
    level = replace(prediction, numbers=np.full_like(prediction.numbers, 1.4))
    drawn = refit._level(level)
    assert float(drawn.numbers[0, place][0]) < 1.3
    assert (drawn.deviation[0, place] < level.deviation[0, place]).all()
    dark = replace(prediction, numbers=np.zeros_like(prediction.numbers))
    lit = refit._share_light(dark, 0.05)
    light = scene_light(alone[1:])
    before, after = (np.abs(each.numbers[0, each.layout["light"]] - light).sum() for each in (dark, lit))
    assert after < 0.8 * before


def scene_light(objects: list[Explanation]) -> np.ndarray:
    return SceneExplanation(tuple(objects), np.zeros((len(objects),) * 2, bool)).light


def test_others_are_painted_out():
    cut = np.full((40, 40, 3), 0.7, np.float32)
    infront, elsewhere = np.zeros((2, 40, 40), bool)
    infront[:10], elsewhere[20:30, 20:30] = True, True
    cut[20:30, 20:30] = 0.0
    painted = _without(cut, infront, elsewhere)
    assert np.allclose(painted[:10], 0.18)
    assert np.allclose(painted[12:], 0.7, atol=1e-3)


def test_no_object_is_before_itself_by_way_of_others():
    before = _without_cycles({(0, 1): 5.0, (1, 2): 4.0, (0, 2): -1.0}, 3)
    assert before.tolist() == [[False, True, True], [False, False, True], [False, False, False]]
    four = _without_cycles({(0, 1): 9.0, (2, 3): 8.0, (1, 2): 7.0, (0, 3): -6.0}, 4)
    assert four[0, 3] and not four[3, 0]


def test_a_folder_of_other_boxes_is_not_taken_for_done(photo: Path):
    out, boxes, copy = photo.parent / "out", photo.parent / "boxes.json", photo.with_name("other.png")
    copy.write_bytes(photo.read_bytes())
    command = ["fit", str(photo), str(copy), "--boxes", str(boxes), "--out", str(out), "--quiet"]
    two = json.loads(boxes.read_text())["photo.png"][:2]
    kept = []
    for given in (two, two[0]["box"], two):
        boxes.write_text(json.dumps({"photo.png": given, "other.png": two[0]["box"]}))
        (out / "photo" / "mine.txt").write_text("stays") if out.exists() else None
        assert run_vig(*command) == 0
        for row in read_results(out):
            written = json.loads((out / row["folder"] / "explanation.json").read_text())
            assert row["azimuth_deg"] == pytest.approx(written["azimuth_deg"])
        kept.append(sorted(path.name for path in (out / "photo").iterdir()))
    assert "1-" not in "".join(kept[1]) and "object.glb" in kept[1]
    assert kept[2] == sorted([*kept[0], "mine.txt"])


@pytest.mark.parametrize(
    ("told", "arguments", "words"),
    [
        ({"photo.png": []}, [], "something in it"),
        ({"photo.png": [[1, 2, 3]]}, [], "boxes by the photos"),
        ({"photo.png": [{"class": "mug"}]}, [], "box"),
        ({"photo.png": [[0, 0, 50, 50]] * 25}, [], "more than 24"),
        ([], [], "boxes by the photos"),
        ({"photo.png": [[0, 0, 50, 50]] * 2}, ["--azimuth", "0"], "one object"),
        ({"photo.png": [{"box": [0, 0, 50, 50], "Class": "mug"}]}, [], "'Class'"),
        ({"photo.png": [{"box": [0, 0, 50, 50], "class": "nothing"}]}, [], "got 'nothing'"),
        ({"photo.png": [[0, 0, 50, 50], [0, 0, 5000, 50]]}, [], "in the photo"),
        (None, ["--objects", "0"], "1 to 24"),
        (None, ["--objects", "2", "--box", "1,1,50,50"], "two of them"),
        (None, ["--class", "teapot,mug"], "one --class"),
    ],
)
def test_bad_input_is_told_in_one_line(
    photo: Path, told: object, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
):
    if told is not None:
        boxes = photo.parent / "boxes.json"
        boxes.write_text(json.dumps(told))
        arguments = [*arguments, "--boxes", str(boxes)]
    assert run_vig("fit", photo, "--out", photo.parent / "out", *arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
