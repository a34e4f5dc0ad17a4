import pytest

from vig.explainer import checked_box
from vig.io.errors import UserError


def test_the_message_is_always_one_line() -> None:
    assert str(UserError("expected a photo;\n  got\ta folder.")) == "expected a photo; got a folder."


def test_it_is_caught_as_a_value_error() -> None:
    with pytest.raises(ValueError, match="expected a box of four numbers"):
        checked_box((1, 2, 3))
