"""The paper's class: what the pack holds, and what its scenes show."""

from pathlib import Path

import numpy as np
import pytest

from tools.classes.paper_teapot import COMPONENTS, paper_teapot
from tools.classes.teapot import teapot
from vig.scene import SHAPE_LIMIT, ObjectClass
from vig_paper.teapot_class import PACK, copy_class
from vig_world.assets.held_out import held_out_designs_of
from vig_world.assets.target import NO_DESIGN, draw_shape


def test_the_pack_is_what_the_code_builds(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the light of all panoramas and for random designs, which take long and are not in it."""
    monkeypatch.setattr("tools.classes.shapes.light_prior", lambda: (np.eye(9)[0], np.eye(9)))
    monkeypatch.setattr("tools.classes.teapot.drawn_designs", lambda *given, **named: ())
    monkeypatch.setattr("tools.classes.paper_teapot.teapot", teapot.__wrapped__)
    pack, built = ObjectClass.load(PACK), paper_teapot().build()
    assert pack.name == built.name == "teapot-paper"
    np.testing.assert_allclose(pack.shape_model.mean, built.shape_model.mean, atol=1e-6)
    np.testing.assert_allclose(pack.shape_model.basis, built.shape_model.basis, atol=1e-5)
    assert pack.shape_model.modes == COMPONENTS == 10  # the paper's, of 90 % of the variance or more
    assert pack.shape_model.explained_variance_ratio.sum() > 0.9
    assert pack.transfer is not None and pack.transfer.shape[0] == COMPONENTS + 1


def test_scenes_show_the_models_shapes_or_designs(tmp_path: Path) -> None:
    rng = np.random.default_rng
    copy_class(tmp_path / "model", designs=False)
    copy_class(tmp_path / "designs", designs=True)
    model, designs = (ObjectClass.load(tmp_path / name) for name in ("model", "designs"))
    assert held_out_designs_of(model) is None
    known = held_out_designs_of(designs)
    assert known is not None and set(known.splits) == {"test", "validation"}
    for split in ("train", "validation", "test"):
        shape, design = draw_shape(rng(3), model, split)
        assert design == NO_DESIGN
        np.testing.assert_array_equal(
            shape, rng(3).standard_normal(COMPONENTS).clip(-SHAPE_LIMIT, SHAPE_LIMIT)
        )
        _, design = draw_shape(rng(3), designs, split)
        assert design == NO_DESIGN if split == "train" else known.splits[design] == split
