"""explanation.json is what its schema says."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np
import pytest

from tests.golden import results
from vig import record
from vig.hints import Hints as GivenHints
from vig.inference.settings import Verdict
from vig.io.checks import decode
from vig.record import Explanation
from vig_app.cli.results import schema_of
from vig_app.results import COLUMNS, POSE, kind_of


@pytest.fixture(scope="module")
def explanations() -> list[dict[str, Any]]:
    """The golden ones, which leave out the version; objects, not the photo of several."""
    golden = json.loads(results.EXPLANATIONS.read_text())
    del golden["machine"]
    return [{**each, "vig": "0"} for each in golden.values() if each["format"] == 2]


def test_explanations_have_the_fields_of_the_schema_and_no_others(explanations: list[dict[str, Any]]) -> None:
    assert len(explanations) >= 10
    for explanation in explanations:
        decoded = decode(Explanation, explanation)
        assert decoded.verdict == explanation["verdict"]


def test_the_schema_is_that_of_the_types(explanations: list[dict[str, Any]]) -> None:
    described = schema_of("explanation")
    required = described["$defs"]["Explanation"]["required"]
    assert {"class", "verdict", "camera", "hints"} <= set(required) and "class_" not in required
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(described)
    validator = jsonschema.Draft202012Validator(described)
    for explanation in explanations:
        validator.validate(explanation)
        damaged = explanation | {"camera": explanation["camera"] | {"K": [[1, 0, 0]]}}
        assert not validator.is_valid(damaged) and not validator.is_valid(explanation | {"verdict": "sure"})


def test_verdicts_and_hints_are_those_of_the_core() -> None:
    verdicts = get_args(get_type_hints(Explanation)["verdict"])
    assert set(verdicts) == {verdict.name.lower() for verdict in Verdict}
    assert set(record.Hints.__struct_fields__) == {field.name for field in fields(GivenHints)} - {"strokes"}
    full = GivenHints(
        mask=np.ones((2, 3), bool),
        marks=np.ones((2, 3), np.uint8),
        visible=True,
        points={"spout": (1.0, 2.0)},
        azimuth_deg=0.0,
        elevation_deg=2.0,
        roll_deg=3.0,
        pose=np.eye(4),
    )
    described = full.to_plain()
    assert msgspec.to_builtins(decode(record.Hints, described)) == described and len(described) == 8


def test_the_docs_name_every_field_and_every_column() -> None:
    docs = Path(__file__).parents[2] / "docs"
    fields_text, columns_text = ((docs / name).read_text() for name in ("explanation.md", "many.md"))
    names = [each.encode_name for each in msgspec.structs.fields(Explanation)]
    assert [name for name in names if f"`{name}`" not in fields_text] == []
    assert [name for name in COLUMNS.keys() - POSE.keys() if f"`{name}`" not in columns_text] == []


def test_columns_have_the_types_of_the_record() -> None:
    kinds = {name: kind_of(column) for name, column in COLUMNS.items()}
    assert {kinds[name] for name in POSE} == {kinds["confidence"]} == {float}
    assert {kinds["class"], kinds["focal_from"]} == {str} and kinds["mask_trusted"] is bool
    assert kinds["box_x"] is kinds["width"] is int
