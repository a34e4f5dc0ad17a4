"""What a page says in words."""

import math

import numpy as np
import pytest

import vig
from vig.scene import Latents
from vig_app.examples import example_photos
from vig_app.report import words


@pytest.fixture(scope="module")
def described() -> dict:
    explanation = vig.Explainer("teapot").explain(example_photos()[0].photo, box=(20, 20, 100, 100))
    return explanation.to_dict()


def test_a_views_probability_says_of_what_it_is() -> None:
    view = Latents.from_vector(
        np.array([[*[0.0] * 3, math.radians(-90.2), 0.5, *[0.5] * 3, *[0.0] * 9]], np.float32)
    )
    assert words.view_words(view, 0.456) == "azimuth 270°, elevation 29°, 46% likely right"
    assert words.view_words(view, math.nan) == "azimuth 270°, elevation 29°"


def test_what_was_rejected_is_not_told_as_found(described: dict) -> None:
    absent = described | {"verdict": "absent", "present": 0.02, "trusted": []}
    assert "in the photo with a probability of 2%, below the 50% needed" in words.summary(absent)
    assert words.probabilities(absent) == [("in the photo (50% needed)", 0.02)]
    nearly = absent | {"present": 0.4999}  # is not said to be the 50% that are needed
    assert "in the photo with a probability of 49%, below the 50% needed" in words.summary(nearly)
    assert words.probabilities(nearly) == [("in the photo (50% needed)", 0.49)]
    assert "trusted" not in words.summary(absent)
    assert "rejected" in dict(words.table_rows(absent))["its elevation"]
    assert "rejected" not in dict(words.table_rows(described))["its elevation"]
