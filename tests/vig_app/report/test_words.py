"""What a page says in words."""

from __future__ import annotations

import pytest

import vig
from vig_app.examples import example_photos
from vig_app.report import words


@pytest.fixture(scope="module")
def described() -> dict:
    explanation = vig.Explainer("teapot").explain(example_photos()[0].photo, box=(20, 20, 100, 100))
    return explanation.to_dict()


def test_what_was_rejected_is_not_told_as_found(described: dict) -> None:
    absent = described | {"verdict": "absent", "present": 0.02, "trusted": []}
    assert "in the photo with a probability of 2%" in words.summary(absent)
    assert "trusted" not in words.summary(absent)
    assert "rejected" in dict(words.table_rows(absent))["its elevation"]
    assert "rejected" not in dict(words.table_rows(described))["its elevation"]
