import numpy as np
import pytest

from vig.scene import ShapeModel


@pytest.fixture
def model() -> ShapeModel:
    """Two components and 30 vertices."""
    rng = np.random.default_rng(0)
    mean, basis = rng.normal(0, 0.1, (30, 3)), rng.normal(0, 0.01, (2, 30, 3))
    faces, parts = np.array([[0, 1, 2], [2, 1, 3]], np.int32), np.zeros(30, np.int32)
    return ShapeModel(
        mean.astype(np.float32),
        basis.astype(np.float32),
        faces,
        parts,
        ("all",),
        np.array([0.6, 0.3], np.float32),
    )


def test_vertices_are_the_mean_and_components_times_coefficients(model: ShapeModel) -> None:
    found = model.vertices(np.array([[2.0, -1.0]]))[0]
    np.testing.assert_allclose(found, model.mean + 2.0 * model.basis[0] - model.basis[1], atol=1e-7)
    assert model.modes == 2


def test_vertices_keep_the_coefficients_precision(model: ShapeModel) -> None:
    assert model.vertices(np.zeros((3, 2), np.float32)).dtype == np.float32
    zero = model.vertices(np.zeros((1, 2)))
    assert zero.dtype == np.float64
    np.testing.assert_array_equal(zero[0], model.mean)


@pytest.mark.parametrize("shape", [(1, 3), (2,), (1, 1, 2)])
def test_coefficients_of_another_width_are_refused(model: ShapeModel, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"coefficients must be \(B, 2\)"):
        model.vertices(np.zeros(shape))
