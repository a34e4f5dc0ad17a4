import numpy as np
import pytest
import torch

from vig_train.evaluation.metrics import (
    angle_error_deg,
    appearance_error,
    illumination_error,
    segmentation_iou,
    shape_error_mm,
    shape_ratio,
)


def test_angles_are_compared_round_the_circle() -> None:
    predicted = np.radians([10.0, 359.0, 0.0, 725.0, -90.0])
    true = np.radians([350.0, 2.0, 180.0, 5.0, 90.0])
    np.testing.assert_allclose(angle_error_deg(predicted, true), [20, 3, 180, 0, 180], atol=1e-9)


def test_elevation_needs_no_wrapping() -> None:
    np.testing.assert_allclose(angle_error_deg(np.radians([80.0]), np.radians([15.5])), [64.5])


def test_appearance_of_known_colours() -> None:
    # sRGB red is (a, b) = (80.09, 67.20) in CIE Lab, blue (79.19, -107.86); every grey is (0, 0).
    red, blue, grey, dark = [1.0, 0, 0], [0, 0, 1.0], [0.5] * 3, [0.1] * 3
    errors = appearance_error(np.array([red, blue, dark, red]), np.array([grey, grey, grey, blue]))
    expected = np.array(
        [np.hypot(80.09, 67.20), np.hypot(79.19, 107.86), 0, np.hypot(80.09 - 79.19, 67.20 + 107.86)]
    )
    np.testing.assert_allclose(errors, expected / 255, atol=1e-4)


def test_appearance_clips_what_no_surface_has() -> None:
    assert appearance_error(np.array([[1.7, -0.2, 0.0]]), np.array([[1.0, 0.0, 0.0]])) == 0


def test_appearance_of_the_mean_baseline_is_the_papers() -> None:
    """The paper's 0.140 (Table 1, a median) for albedo U(0.2, 0.8) against its mean; the mean is 0.146.

    The standard error of the median of 100,000 draws is 0.0003.
    """
    true = np.random.default_rng(0).uniform(0.2, 0.8, (100_000, 3))
    errors = appearance_error(np.full_like(true, 0.5), true)
    assert np.median(errors) == pytest.approx(0.1400, abs=0.001)
    assert errors.mean() == pytest.approx(0.1464, abs=0.001)


def test_illumination_ignores_the_predictions_scale() -> None:
    true = np.random.default_rng(1).normal(size=(5, 9))
    np.testing.assert_allclose(illumination_error(-3.7 * true, true), 0, atol=1e-15)


def test_illumination_by_hand() -> None:
    # The truth is pi (3, 4, 0, ...), in the paper's unit (3, 4, 0, ...). Predicted along the first axis only,
    # the best scale gives 3 and leaves 4: 4^2 / 9. Predicted as nothing: (3^2 + 4^2) / 9.
    true = np.zeros((2, 9))
    true[:, 0], true[:, 1] = 3 * np.pi, 4 * np.pi
    predicted = np.zeros((2, 9))
    predicted[0, 0] = 0.01
    np.testing.assert_allclose(illumination_error(predicted, true), [16 / 9, 25 / 9])


def test_shape_by_hand() -> None:
    # Four vertices: two in place, one 3-4-5 mm off, one 1 mm off: (0 + 0 + 5 + 1) / 4.
    true = np.zeros((1, 4, 3))
    predicted = true.copy()
    predicted[0, 2] = [0.003, 0, 0.004]
    predicted[0, 3] = [0, -0.001, 0]
    np.testing.assert_allclose(shape_error_mm(predicted, true), [1.5])


def test_the_median_of_the_shape_ratio_is_the_ratio_of_the_medians() -> None:
    np.testing.assert_allclose(shape_ratio([1.0, 2.0, 6.0], [4.0, 8.0, 100.0]), [0.125, 0.25, 0.75])


def test_iou_by_hand() -> None:
    true = np.zeros((4, 2, 3), bool)
    predicted = np.zeros_like(true)
    true[0, 0] = predicted[0, :, 0] = True  # a row of 3 and a column of 2 share 1 of 4
    predicted[1, 0, 0] = True  # predicted, not there
    true[3] = predicted[3] = True  # all
    np.testing.assert_allclose(segmentation_iou(predicted, true), [0.25, 0, 1, 1])


def test_torch_tensors_are_taken_with_their_gradients_and_floats() -> None:
    predicted = torch.zeros(2, 4, 3, requires_grad=True)
    np.testing.assert_allclose(
        shape_error_mm(predicted, torch.full((2, 4, 3), 0.001)), [3**0.5] * 2, rtol=1e-6
    )
    assert segmentation_iou(torch.ones(1, 2, 2, dtype=torch.bool), np.ones((1, 2, 2), bool)) == 1


@pytest.mark.parametrize(
    ("metric", "a", "b"),
    [
        (angle_error_deg, (3,), (4,)),
        (angle_error_deg, (3,), (3, 1)),
        (appearance_error, (3, 4), (3, 4)),
        (illumination_error, (9,), (9,)),
        (shape_error_mm, (2, 5, 3), (1, 5, 3)),
    ],
)
def test_shapes_that_differ_are_refused_and_shown(metric, a, b) -> None:
    with pytest.raises(ValueError, match="expected two arrays") as caught:
        metric(np.zeros(a), np.zeros(b))
    assert str(a) in str(caught.value) and str(b) in str(caught.value)


def test_masks_must_be_boolean() -> None:
    with pytest.raises(ValueError, match="masks must be bool; got float64 and bool"):
        segmentation_iou(np.zeros((1, 2, 2)), np.zeros((1, 2, 2), bool))
