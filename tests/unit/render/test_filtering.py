"""The filter of slowly varying light: its weights on a plane, and that no light crosses to another surface."""

from __future__ import annotations

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.render.background.filtering import Features, convolve_rows, smooth

pytestmark = pytest.mark.usefixtures("device")

SIDE = 65
"""Twice the reach of all strides to either side of the middle."""


def filtered(
    light: NDArray[np.float64],
    depth: NDArray[np.float64],
    normal: NDArray[np.float64],
    material: NDArray[np.int64] | int = 1,
) -> NDArray[np.float32]:
    """Return filtered light of surfaces at depths [m], shapes (SIDE, SIDE), 10 mm from entry to entry."""
    y, x = 0.01 * np.indices((SIDE, SIDE))
    kind = np.concatenate([normal, np.broadcast_to(material, (SIDE, SIDE))[..., None]], axis=-1)
    point = np.stack([x, y, depth, np.zeros_like(depth)], axis=-1)
    features = Features(*(auto.Float(part.ravel().astype(np.float32)) for part in (kind, point)))
    layer = auto.Float(light.ravel().astype(np.float32))
    first, second = smooth([layer, 2.0 * layer], features, SIDE, SIDE, 1.0)
    dr.eval(first, second)
    np.testing.assert_allclose(second.numpy(), 2.0 * first.numpy(), rtol=1e-6)
    return first.numpy().reshape(SIDE, SIDE)


FLAT = np.full((SIDE, SIDE), 5.0)
FACING = np.broadcast_to([0.0, 0.0, -1.0], (SIDE, SIDE, 3))


def test_on_a_plane_the_weights_are_those_of_the_wavelets() -> None:
    """Claim: a point of light keeps 4⁻⁴, as no later stride comes back to it, and none is lost.

    Its variance is that of four strides of ¼, ½, ¼: ½ (1 + 4 + 16 + 64).
    """
    light = np.zeros((SIDE, SIDE))
    light[32, 32] = 1.0
    found = filtered(light, FLAT, FACING).astype(np.float64)
    assert found[32, 32] == pytest.approx(4.0**-4, rel=1e-5)
    assert found.sum() == pytest.approx(1.0, rel=1e-5)
    assert (found.sum(axis=0) * (np.arange(SIDE) - 32.0) ** 2).sum() == pytest.approx(42.5, rel=1e-4)


@pytest.mark.parametrize("apart", ["a step", "a fold", "a material"])
def test_light_stays_on_its_surface(apart: str) -> None:
    """Claim: a plane gives no light to the plane 0.5 m behind or the wall at right angles, with weights below e⁻¹⁴, nor
    to a part of it that is of another material, or to the sky."""
    left = np.arange(SIDE) < 32
    light = np.where(left, 1.0, 3.0) * np.ones((SIDE, 1))
    depth, normal, material = FLAT, FACING, np.ones(SIDE, dtype=int)
    if apart == "a material":
        material = np.where(left, 2, 0)
    elif apart == "a step":
        depth = np.where(left, 5.0, 5.5) * np.ones((SIDE, 1))
    else:
        normal = np.where(left[None, :, None], FACING, [-1.0, 0.0, 0.0])
    np.testing.assert_allclose(filtered(light, depth, normal, material), light, rtol=1e-5)


def test_features_have_room_for_four_numbers_of_each_entry() -> None:
    features = Features.empty(7)
    assert (dr.width(features.kind), dr.width(features.point)) == (28, 28)


@pytest.mark.parametrize("reach", [0, 2, 40])
def test_each_row_is_convolved_by_itself_and_its_ends_go_on(reach: int) -> None:
    """Claim: by NumPy's convolution of each of three rows, whose first and last entries are repeated beyond; of several
    layers at once, and of weights beyond what one kernel holds."""
    random = np.random.default_rng(6)
    half = random.random(reach + 1)
    weights = np.concatenate([half[::-1], half[1:]])
    layers = random.normal(size=(2, 3, 23))
    found = convolve_rows([auto.Float(layer.ravel().astype(np.float32)) for layer in layers], 23, weights)
    for told, layer in zip(found, layers, strict=True):
        wanted = [np.convolve(np.pad(row, reach, mode="edge"), weights, "valid") for row in layer]
        np.testing.assert_allclose(told.numpy().reshape(3, 23), wanted, rtol=1e-4, atol=1e-4)
