from vig.errors import UserError


def test_the_message_is_always_one_line() -> None:
    assert str(UserError("expected a photo;\n  got\ta folder.")) == "expected a photo; got a folder."
