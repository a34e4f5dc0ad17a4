import numpy as np
import pytest

from vig.scene import linear_from_srgb, srgb8_from_linear, srgb_from_linear


def test_known_values() -> None:
    # IEC 61966-2-1: sRGB 0.5 is ((0.5 + 0.055) / 1.055) ** 2.4; 8-bit 188 is the code of half the light.
    assert linear_from_srgb(np.array(0.5)) == pytest.approx(0.21404114)
    np.testing.assert_array_equal(srgb8_from_linear(np.array([0.0, 0.5, 1.0])), [0, 188, 255])


def test_coding_is_undone_by_decoding() -> None:
    values, codes = np.linspace(0, 1, 1001), np.arange(256, dtype=np.uint8)
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(values)), values, atol=1e-7)
    np.testing.assert_array_equal(srgb8_from_linear(linear_from_srgb(codes / 255)), codes)


def test_both_curves_rise_without_a_step() -> None:
    values = np.linspace(0, 1, 100_001)
    for curve in (linear_from_srgb, srgb_from_linear):
        steps = np.diff(curve(values))
        assert steps.min() > 0
        assert steps.max() < 13.0e-5  # the steepest slope is 12.92


def test_light_outside_the_display_is_clipped() -> None:
    np.testing.assert_array_equal(srgb8_from_linear(np.array([-0.5, 7.0])), [0, 255])
    assert srgb_from_linear(np.array([-0.5, 7.0])).tolist() == pytest.approx([0, 1])
