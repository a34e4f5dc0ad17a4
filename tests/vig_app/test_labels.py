"""Labels of annotation tools as hints: what each format states, and what is wrong with some."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support import run_vig
from vig.io.errors import UserError
from vig.photo.images import png_bytes
from vig.photo.masks import run_lengths
from vig_app.cli.boxes import labels_of as labels_for
from vig_app.cli.options import PlaceOptions
from vig_app.examples import example_photos
from vig_app.labels import Label, _decode_runs, fill_polygon, read_labels
from vig_app.runs import Task
from vig_app.runs.work import apply_labels

WIDTH, HEIGHT = 12, 8
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[2:6, 3:9] = True
MASK[3:4, 5:6] = False  # a hole
SQUARE = ((3.0, 2.0), (9.0, 2.0), (9.0, 6.0), (3.0, 6.0))


def coco(**annotation: Any) -> dict[str, Any]:
    return {
        "images": [{"id": 7, "file_name": "a.png", "width": WIDTH, "height": HEIGHT}],
        "categories": [{"id": 3, "name": "teapot", "keypoints": ["spout", "handle"]}],
        "annotations": [{"id": 1, "image_id": 7, "category_id": 3, "iscrowd": 0, **annotation}],
    }


def labelme(*shapes: dict[str, Any]) -> dict[str, Any]:
    size = {"imageWidth": WIDTH, "imageHeight": HEIGHT}
    return {"version": "5.5.0", "imagePath": "..\\photos\\a.png", "shapes": [*shapes], **size}


def cvat(shapes: str) -> str:
    image = f'<image id="0" name="a.png" width="{WIDTH}" height="{HEIGHT}">{shapes}</image>'
    return f"<annotations><version>1.1</version>{image}</annotations>"


def labels_of(folder: Path, content: Any) -> list[Label]:
    path = folder / ("labels.xml" if isinstance(content, str) else "labels.json")
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    ((name, labels),) = read_labels(path, pytest.fail).items()
    assert name == "a.png"
    return labels


PART = MASK[2:6, 3:9]
SHAPE = {"label": "teapot", "group_id": None, "flags": {}}
ROWS = ", ".join(map(str, run_lengths(PART.T)["counts"]))
PNG = base64.b64encode(png_bytes(PART.astype(np.uint8) * 255)).decode()


@pytest.mark.parametrize(
    "content",
    [
        coco(segmentation=run_lengths(MASK), bbox=[3, 2, 6, 4]),
        labelme(SHAPE | {"shape_type": "mask", "points": [[3, 2], [8, 5]], "mask": PNG}),
        cvat(f'<mask label="teapot" rle="{ROWS}" left="3" top="2" width="6" height="4"/>'),
    ],
    ids=["coco", "labelme", "cvat"],
)
def test_masks_are_those_of_the_file(tmp_path: Path, content: Any) -> None:
    (label,) = labels_of(tmp_path, content)
    assert (label.name, label.box) == ("teapot", None)
    np.testing.assert_array_equal(label.hints(WIDTH, HEIGHT).mask, MASK)


@pytest.mark.parametrize(
    "content",
    [
        coco(segmentation=[[number for place in SQUARE for number in place]]),
        labelme(SHAPE | {"shape_type": "polygon", "points": SQUARE}),
        cvat('<polygon label="teapot" points="3.0,2.0;9.0,2.0;9.0,6.0;3.0,6.0"/>'),
    ],
    ids=["coco", "labelme", "cvat"],
)
def test_polygons_cover_the_pixels_whose_centres_they_hold(tmp_path: Path, content: Any) -> None:
    (label,) = labels_of(tmp_path, content)
    expected = MASK.copy()
    expected[3, 5] = True
    np.testing.assert_array_equal(label.hints(WIDTH, HEIGHT).mask, expected)


@pytest.mark.parametrize(
    "content",
    [
        coco(bbox=[1, 2, 5, 4], keypoints=[4, 3, 2, 0, 0, 0]),
        labelme(
            SHAPE | {"shape_type": "rectangle", "points": [[6, 6], [1, 2]]},
            SHAPE | {"shape_type": "point", "label": "spout", "points": [[4, 3]]},
            SHAPE | {"shape_type": "line", "points": [[4, 3], [5, 5]]},
        ),
        cvat('<box label="teapot" xtl="1" ytl="2" xbr="6" ybr="6"/><points label="spout" points="4,3"/>'),
    ],
    ids=["coco", "labelme", "cvat"],
)
def test_boxes_and_points(tmp_path: Path, content: Any) -> None:
    (label,) = labels_of(tmp_path, content)
    assert label.box == (1, 2, 5, 4) and label.hints(WIDTH, HEIGHT).mask is None
    assert label.points == {"spout": (4, 3)}


def test_a_cuboid_is_the_box_round_it(tmp_path: Path) -> None:
    sides = " ".join(
        f'x{end}{number}="{1 if "l" in end else 6}" y{end}{number}="{2 if "t" in end else 6}"'
        for end in ("tl", "bl", "tr", "br")
        for number in (1, 2)
    )
    (label,) = labels_of(tmp_path, cvat(f'<cuboid label="teapot" occluded="0" {sides}/>'))
    assert label.box == (1, 2, 5, 4)


def test_a_group_joins_shapes_and_others_are_objects_of_their_own(tmp_path: Path) -> None:
    piece = SHAPE | {"shape_type": "polygon", "points": SQUARE}
    apart = SHAPE | {"shape_type": "polygon", "points": [[0, 0], [2, 0], [2, 2]]}
    spout = {"shape_type": "point", "label": "spout", "points": [[4, 3]]}
    one = [shape | {"group_id": 1} for shape in (piece, apart, SHAPE | spout)]
    (label,) = labels_of(tmp_path, labelme(*one))
    assert len(label.polygons) == 2 and label.points == {"spout": (4, 3)}
    assert len(labels_of(tmp_path, labelme(piece, apart))) == 2


def test_compressed_run_lengths_are_those_of_coco() -> None:
    mask = pytest.importorskip("pycocotools.mask")
    pixels = np.random.default_rng(0).random((40, 31)) < 0.3
    pixels[:, 9:20] = True  # lengths of several characters
    encoded = mask.encode(np.asfortranarray(pixels.astype(np.uint8)))
    assert _decode_runs(encoded["counts"].decode()) == run_lengths(pixels)["counts"]


@pytest.mark.parametrize(
    "content, problem",
    [
        (coco(segmentation=[[3, 2, 9, 6, 9, 2, 3, 6]]), "a polygon that crosses itself"),
        (coco(segmentation=[[3, 2, 9, 6]]), "a polygon of 2 points"),
        (coco(segmentation={"size": [WIDTH, HEIGHT], "counts": [96]}), "where height, width is"),
        (coco(segmentation={"size": [HEIGHT, WIDTH], "counts": [90]}), "run lengths of 90 pixels"),
        (
            coco(
                bbox=[3, 2, 6, 4],
                segmentation={"size": [HEIGHT, WIDTH], "counts": run_lengths(MASK.T)["counts"]},
            ),
            "are they by rows",
        ),
        (
            cvat('<mask label="teapot" rle="0, 24" left="9" top="2" width="6" height="4"/>'),
            "a mask that reaches beyond the photo",
        ),
        (cvat('<mask label="teapot" rle="x" left="9" top="2" width="6" height="4"/>'), "a damaged one"),
        (labelme(SHAPE | {"shape_type": "mask", "points": [[3, 2], [8, 5]], "mask": "?"}), "a damaged one"),
    ],
)
def test_a_label_that_cannot_be_used_says_why(tmp_path: Path, content: Any, problem: str) -> None:
    (label,) = labels_of(tmp_path, content)
    with pytest.raises(UserError, match=f"expected labels for 12 x 8 pixels; got .*{problem}"):
        label.hints(WIDTH, HEIGHT)


def test_labels_of_another_size_are_refused(tmp_path: Path) -> None:
    (label,) = labels_of(tmp_path, coco(bbox=[3, 2, 6, 4]))
    with pytest.raises(
        UserError, match="expected labels for 24 x 16 pixels; got those of a picture of 12 x 8"
    ):
        label.hints(24, 16)


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", "<html/>", "<annotations", '{"shapes": 3, "imagePath": ""}']
)
def test_other_files_are_refused_and_passed_over_in_a_folder(tmp_path: Path, text: str) -> None:
    (tmp_path / "b.json").write_text(text)
    with pytest.raises(UserError, match="expected labels of COCO, labelme or CVAT at .*b.json"):
        read_labels(tmp_path / "b.json", pytest.fail)
    (tmp_path / "c.json").write_text(json.dumps(coco(bbox=[3, 2, 6, 4])))
    lines: list[str] = []
    assert list(read_labels(tmp_path, lines.append)) == ["a.png"]
    assert len(lines) == 1 and "b.json" in lines[0]


def test_whole_masks_of_vig_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "annotations_amodal.json"
    file.write_text(json.dumps(coco(bbox=[3, 2, 6, 4])))
    with pytest.raises(UserError, match="masks of what is seen"):
        read_labels(file, pytest.fail)


def test_annotations_of_images_that_are_not_there_are_counted_in_a_line(tmp_path: Path) -> None:
    content = coco(bbox=[1, 2, 3, 4])
    content["annotations"].append({**content["annotations"][0], "image_id": 99})
    (tmp_path / "a.json").write_text(json.dumps(content))
    lines: list[str] = []
    assert [len(labels) for labels in read_labels(tmp_path / "a.json", lines.append).values()] == [1]
    assert lines == [f"{tmp_path / 'a.json'}: 1 of 2 annotations are of images not listed"]


def test_an_unknown_category_is_named_by_its_number(tmp_path: Path) -> None:
    (label,) = labels_of(tmp_path, coco(category_id=9, bbox=[3, 2, 6, 4]))
    assert label.name == "category 9" and not label.problem


def test_points_are_those_of_the_one_object_of_the_class(tmp_path: Path) -> None:
    spout = {"shape_type": "point", "label": "spout", "points": [[4, 3]]}
    knob = {"shape_type": "point", "label": "antenna", "points": [[4, 3]]}
    boxes = [
        {"shape_type": "rectangle", "label": name, "points": [[1, 1], [5, 5]]} for name in ("Teapot", "dog")
    ]
    (tmp_path / "a.json").write_text(json.dumps(labelme(*(SHAPE | each for each in (spout, knob, *boxes)))))
    photo = tmp_path / "a.png"
    ((label,),) = labels_for(PlaceOptions(labels=tmp_path / "a.json"), [photo], ["teapot"]).values()
    assert label.name == "teapot" and label.box == (1, 1, 4, 4) and label.points == {"spout": (4, 3)}


def test_small_slips_of_the_hand_are_no_crossing() -> None:
    drawn = fill_polygon((*SQUARE, (3.0, 2.5), (2.9, 2.4)), WIDTH, HEIGHT)
    np.testing.assert_array_equal(drawn, fill_polygon(SQUARE, WIDTH, HEIGHT))


def test_a_run_goes_on_past_labels_that_cannot_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first of four photos is fitted with its box; size, count, crossing are errors of the others."""
    photos = [example.photo for example in example_photos()[1:5]]
    rows = [
        ((150, 150), ["teapot"], {"bbox": [35, 39, 80, 79]}),
        ((300, 300), ["teapot"], {"bbox": [70, 78, 160, 158]}),
        ((150, 150), ["teapot", "teapot"], {"bbox": [35, 39, 80, 79]}),
        ((150, 150), ["teapot", "dog"], {"segmentation": [[20, 20, 90, 90, 90, 20, 20, 90]]}),
    ]
    names = ["teapot", "dog"]
    content = {
        "images": [
            {"id": n, "file_name": photo.name, "width": size[0], "height": size[1]}
            for n, (photo, (size, _, _)) in enumerate(zip(photos, rows, strict=True))
        ],
        "categories": [{"id": n, "name": name} for n, name in enumerate(names)],
        "annotations": [
            {"image_id": n, "category_id": names.index(name), **row}
            for n, (_, objects, row) in enumerate(rows)
            for name in objects
        ],
    }
    (tmp_path / "labels.json").write_text(json.dumps(content))
    arguments = ["fit", *map(str, photos), "--labels", str(tmp_path / "labels.json"), "--json"]
    assert run_vig(*arguments, "--out", tmp_path / "out", "--files", "mask.png") == 1
    printed = capsys.readouterr()
    answer = json.loads(printed.out)
    assert [result["box"] is not None for result in answer["results"].values()] == [True]
    size, count, crossing = answer["errors"].values()
    assert (
        "those of a picture of 300 x 300" in size and "expected labels of 1 object in a photo; got 2" in count
    )
    assert "crosses itself" in crossing
    assert "labels of others than teapot passed over: dog" in printed.err
    for option in (["--class", "mug"], ["--box", "1,2,30,40"]):
        assert run_vig(*arguments, *option, "--out", tmp_path / "other") == 2
        assert not (tmp_path / "other").exists()
    assert "expected labels of mug" in capsys.readouterr().err


def test_boxes_of_several_labels_are_explained_together(tmp_path: Path) -> None:
    photo = example_photos()[1].photo
    boxes = ((35.0, 39.0, 80.0, 79.0), (2.0, 40.0, 40.0, 80.0))
    labels = tuple(Label("teapot", (150, 150), box=box) for box in boxes)
    task = apply_labels(Task(photo, tmp_path, labels=labels, most=2))
    assert task.objects == (("teapot", boxes[0]), ("teapot", boxes[1]))
    with pytest.raises(UserError, match="got points alone"):
        apply_labels(Task(photo, tmp_path, labels=(Label("teapot", points={"spout": (9, 9)}),), most=2))
