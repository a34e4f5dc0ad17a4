import math

import numpy as np
import pytest

from tests.support import assert_close
from vig.scene import irradiance, rotate_z, rotations_z, sh_basis
from vig_world.assets.panoramas.light import project_panorama


def sphere(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) and weights (N,) of a quadrature of the sphere (Gauss-Legendre in z)."""
    z, weight = np.polynomial.legendre.leggauss(rows)
    phi = (np.arange(columns) + 0.5) * 2 * math.pi / columns
    radius = np.sqrt(1 - z**2)[:, None]
    directions = np.stack(
        np.broadcast_arrays(radius * np.cos(phi), radius * np.sin(phi), z[:, None]), axis=-1
    ).reshape(-1, 3)
    weights = np.repeat(weight * 2 * math.pi / columns, columns)
    return directions, weights


def unit(rng: np.random.Generator, count: int) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def pixel_direction(row: int, column: int, height: int, width: int) -> np.ndarray:
    theta, phi = (row + 0.5) * math.pi / height, (column + 0.5) * 2 * math.pi / width
    return np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])


def test_the_basis_is_orthonormal() -> None:
    directions, weights = sphere(6, 12)  # exact for polynomials of degree 4
    basis = sh_basis(directions)
    assert_close(basis.T @ (basis * weights[:, None]), np.eye(9), atol=1e-13, rtol=0)


def test_the_order_is_that_of_degree_and_order() -> None:
    # Y_1m are proportional to (y, z, x); of Y_2m only (2,0) and (2,2) live on the axes.
    basis = sh_basis(np.eye(3))
    linear, polar = math.sqrt(3 / (4 * math.pi)), math.sqrt(5 / (16 * math.pi))
    across = math.sqrt(15 / (16 * math.pi))
    flat = 1 / math.sqrt(4 * math.pi)
    expected = [
        [flat, 0, 0, linear, 0, 0, -polar, 0, across],
        [flat, linear, 0, 0, 0, 0, -polar, 0, -across],
        [flat, 0, linear, 0, 0, 0, 2 * polar, 0, 0],
    ]
    assert_close(basis, np.array(expected), atol=1e-14, rtol=0)


@pytest.mark.parametrize(("row", "column"), [(0, 0), (5, 20), (16, 40), (31, 63)])
def test_a_delta_light_has_the_known_band_norms(row: int, column: int) -> None:
    panorama = np.zeros((32, 64, 3))
    panorama[row, column] = (1.0, 2.0, 3.0)
    light = project_panorama(panorama)
    for channel in light.T:
        # Addition theorem: |Y_l|^2 = (2 l + 1) / (4 pi) in every direction.
        assert np.linalg.norm(channel[1:4]) / channel[0] == pytest.approx(math.sqrt(3), rel=1e-12)
        assert np.linalg.norm(channel[4:]) / channel[0] == pytest.approx(math.sqrt(5), rel=1e-12)
        towards = channel[[3, 1, 2]] / np.linalg.norm(channel[1:4])
        np.testing.assert_allclose(towards, pixel_direction(row, column, 32, 64), atol=1e-12)
    np.testing.assert_allclose(light[:, 1:], light[:, :1] * (2.0, 3.0), rtol=1e-12)


def test_projection_recovers_a_light_of_degree_two() -> None:
    light = np.random.default_rng(1).normal(size=9)
    height, width = 64, 128
    grid = [[pixel_direction(row, column, height, width) for column in range(width)] for row in range(height)]
    radiance = (sh_basis(np.array(grid)) @ light)[..., None].repeat(3, axis=2)
    np.testing.assert_allclose(project_panorama(radiance), light[:, None].repeat(3, 1), atol=1e-3)


def test_turning_the_coefficients_is_turning_the_panorama() -> None:
    panorama = np.random.default_rng(2).uniform(0, 5, (16, 48, 3))
    for columns in (1, 7, 24, -5):
        turned = project_panorama(np.roll(panorama, columns, axis=1))  # azimuth grows with the column
        angle = columns * 2 * math.pi / 48
        light = project_panorama(panorama).T
        np.testing.assert_allclose(rotate_z(light, angle).T, turned, atol=1e-12)


def test_turned_light_is_the_light_seen_from_turned_directions() -> None:
    rng = np.random.default_rng(3)
    light, directions = rng.normal(size=(5, 9)), unit(rng, 40)
    angle = rng.uniform(-7, 7, 5)
    turned = rotate_z(light, angle)
    for i in range(5):
        c, s = math.cos(angle[i]), math.sin(angle[i])
        back = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # Rz(-angle)
        assert_close(sh_basis(directions) @ turned[i], sh_basis(directions @ back.T) @ light[i])
    assert_close(rotate_z(turned, -angle), light)


def test_irradiance_of_a_light_of_degree_two_is_exact() -> None:
    # The clamped cosine is applied band by band, so a band-limited radiance loses nothing.
    rng = np.random.default_rng(4)
    light = rng.normal(0, 0.3, 9)
    light[0] = 4.0  # radiance positive everywhere
    directions, weights = sphere(200, 400)
    radiance = sh_basis(directions) @ light
    assert radiance.min() > 0
    normals = unit(rng, 12)
    integral = (normals @ directions.T).clip(0) @ (radiance * weights) / math.pi
    assert_close(irradiance(light, normals), integral, atol=2e-5, rtol=0)


def test_irradiance_of_any_light_is_within_the_degree_two_error() -> None:
    # Up to degree 2 the clamped cosine is 1/4 + c/2 + (15 c^2 - 5)/32; it is farthest off at c = 0, by 3/32.
    rng = np.random.default_rng(5)
    directions = np.array([[pixel_direction(r, c, 64, 128) for c in range(128)] for r in range(64)])
    edges = np.cos(np.linspace(0, math.pi, 65))
    solid_angle = (edges[:-1] - edges[1:])[:, None] * 2 * math.pi / 128
    normals = unit(rng, 200)
    worst = 0.0
    for lamps in (1, 20):
        panorama = np.zeros((64, 128, 3))
        panorama[rng.integers(0, 64, lamps), rng.integers(0, 128, lamps)] = 100.0
        flux = panorama[..., 0] * solid_angle
        exact = np.einsum("hwd,nd,hw->nhw", directions, normals, flux).clip(0).sum((1, 2)) / math.pi
        approximate = irradiance(project_panorama(panorama)[:, 0], normals)
        error = np.abs(approximate - exact).max() / (flux.sum() / math.pi)
        assert error <= 3 / 32 + 1e-9
        worst = max(worst, error)
    assert worst > 0.09  # one lamp and 200 normals come near the bound: it is the bound, not a loose one


def test_irradiance_is_never_negative() -> None:
    assert irradiance(np.eye(9)[2], np.array([[0.0, 0.0, -1.0]])) == 0.0


def test_rotation_matrices_turn_as_rotate_z() -> None:
    rng = np.random.default_rng(9)
    angle, light = rng.uniform(-7, 7, 20), rng.normal(size=(20, 9))
    turned = (rotations_z(angle) @ light[:, :, None])[:, :, 0]
    assert_close(turned, rotate_z(light, angle), rtol=0, atol=1e-13)
