import numpy as np
import pytest

from tools.classes.shapes import fit_shape_model
from vig.scene import ShapeModel
from vig_world.assets.target import nearest_coefficients

COUNT, VERTICES = 8, 30
FACES = np.array([[0, 1, 2], [2, 1, 3]])
PARTS = np.zeros(VERTICES, np.int32)


@pytest.fixture
def designs() -> np.ndarray:
    return np.random.default_rng(0).normal(0, 0.1, (COUNT, VERTICES, 3))


def fit(designs: np.ndarray, modes: int) -> ShapeModel:
    return fit_shape_model(designs, FACES, PARTS, ("all",), modes)


def test_all_modes_reproduce_the_designs(designs: np.ndarray) -> None:
    model = fit(designs, COUNT - 1)
    coefficients = nearest_coefficients(model, designs)
    np.testing.assert_allclose(model.vertices(coefficients), designs, atol=1e-6)
    assert model.explained_variance_ratio.sum() == pytest.approx(1)


def test_components_are_one_standard_deviation_each(designs: np.ndarray) -> None:
    model = fit(designs, COUNT - 1)
    coefficients = nearest_coefficients(model, designs)
    # The designs' own coefficients have mean 0 and unit, uncorrelated variance.
    np.testing.assert_allclose(coefficients.mean(0), 0, atol=1e-5)
    np.testing.assert_allclose(np.cov(coefficients.T), np.eye(COUNT - 1), atol=1e-5)
    flat = model.basis.reshape(COUNT - 1, -1)
    gram = flat @ flat.T
    np.testing.assert_allclose(gram, np.diag(np.diag(gram)), atol=1e-6)


def test_components_are_sorted_and_their_share_is_of_the_whole_variance(designs: np.ndarray) -> None:
    model = fit(designs, 3)
    total = designs.reshape(COUNT, -1).var(axis=0, ddof=1).sum()
    np.testing.assert_allclose(
        model.explained_variance_ratio, (model.basis**2).sum((1, 2)) / total, rtol=1e-5
    )
    assert (np.diff(model.explained_variance_ratio) <= 0).all()
    assert model.modes == 3


def test_the_largest_displacement_of_a_component_is_positive(designs: np.ndarray) -> None:
    for component in fit(designs, 5).basis.reshape(5, -1):
        assert component[np.abs(component).argmax()] > 0
    # Reflected designs have reflected deviations: the convention undoes the sign.
    mirrored = fit(2 * designs.mean(0) - designs, 5)
    np.testing.assert_allclose(mirrored.basis, fit(designs, 5).basis, atol=1e-6)


def test_coefficients_undo_vertices(designs: np.ndarray) -> None:
    model = fit(designs, 4)
    coefficients = np.random.default_rng(1).normal(size=(6, 4))
    again = nearest_coefficients(model, model.vertices(coefficients))
    np.testing.assert_allclose(again, coefficients, atol=1e-6)


@pytest.mark.parametrize("modes", [0, COUNT, 50])
def test_more_modes_than_designs_can_give_are_refused(designs: np.ndarray, modes: int) -> None:
    with pytest.raises(ValueError, match=f"modes must be from 1 to 7 for 8 designs; got {modes}"):
        fit(designs, modes)
