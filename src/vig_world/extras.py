"""Packages of extras: imported where they are used, named in one line where they are missing."""

from collections.abc import Iterator
from contextlib import contextmanager

from vig.io.errors import UserError


@contextmanager
def optional_import(extra: str) -> Iterator[None]:
    """Turn a missing package in the imports of the `with` block into a `UserError`.

    Args:
        extra: The extra of vig that brings the package, such as "world".
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise UserError(
            f"expected the package {error.name}; it is not installed. Run pip install 'vig[{extra}]'."
        ) from error
