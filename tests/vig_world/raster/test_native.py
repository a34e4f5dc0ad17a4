"""Native code of the rasteriser: its files, and the declarations that are put before them."""

from pathlib import Path

import pytest

from vig_world.raster import native, records


def test_every_file_of_native_code_is_a_function() -> None:
    root = Path(native.__file__).parents[1]
    files = (path.relative_to(root).with_suffix("").as_posix() for path in root.rglob("*.cc"))
    assert set(files) == set(native.FUNCTIONS)


@pytest.mark.parametrize("name", native.FUNCTIONS)
def test_a_function_is_declarations_a_task_and_its_body(name: str) -> None:
    text = native.source(name)
    assert text.count(f"{native.FUNCTIONS[name]}* const task = ") == 1
    assert "#include" not in text
    assert "constexpr float SLACK = 4.8e-07;" in text and "constexpr int LANES = 16;" in text


def test_records_are_declared_field_by_field_with_their_sizes() -> None:
    text = records.declarations()
    assert "struct Grid { float origin[3]; float cell; float rise[2]; int size[3]; float scale; " in text
    assert f"static_assert(sizeof(Task) == {records.TASK.itemsize}" in text
    assert "Grid grid;" in text.split("struct Sweep")[1]
