"""Light in NumPy's memory and back, and the speckle that multiplies a part of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.render.beam import kept_light
from scanner_sim.render.beam.kept_light import KeptLight, speckled
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.surface_positions import SurfacePositions

Array = NDArray[np.float64]
mi: Any = mitsuba

pytestmark = pytest.mark.usefixtures("device")

CLUSTERS = np.array([3, 1, 3, 2, 1, 3])
PARTS = ("amount", "position", "sigma", "coherence")


def value(part: int, shot: int, cluster: int) -> float:
    return 100.0 * (part + 1) + 10.0 * shot + cluster + 0.25


def light_of(count: int, **none: None) -> Light:
    """Light of the shots with so many clusters, all of whose numbers are different."""
    index = np.flatnonzero(count == CLUSTERS)
    parts = {
        name: auto.Float([value(part, shot, cluster) for cluster in range(count) for shot in index.tolist()])
        for part, name in enumerate(PARTS)
    }
    numbers = (auto.UInt32(values.astype(np.uint32)) for values in (index, 40 + index))
    return Light(*numbers, **{**parts, **none}, reference=auto.Float(index + 0.5))


@pytest.mark.parametrize("late", [0, 1, 2])
def test_speckle_multiplies_the_light_of_one_surface_alone(late: int) -> None:
    """Claim: of c clusters the last that met several surfaces keep their light, the others are multiplied each by its
    own factor; the law of speckle is asked for these alone."""
    light = light_of(3)
    asked: list[Any] = []

    def speckle(whole: Light) -> Any:
        asked.append(whole.amount.numpy())
        return auto.Float(1.0 + 0.01 * np.arange(len(asked[0])))

    found = speckled(light, late, speckle)
    amount = light.amount.numpy()
    direct = (3 - late) * 3
    np.testing.assert_array_equal(asked[0], amount[:direct])
    factor = np.append(1.0 + 0.01 * np.arange(direct), np.ones(9 - direct))
    np.testing.assert_allclose(found.amount.numpy(), amount * factor, rtol=1e-6)
    for name in ("index", "shot", *PARTS[1:], "reference"):
        np.testing.assert_array_equal(getattr(found, name).numpy(), getattr(light, name).numpy())


@pytest.mark.parametrize("plain", [False, True])
def test_light_that_is_kept_comes_back_group_by_group(plain: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the clusters of each shot stand one after the other, shot after shot, and come back with as many others,
    beside what its own beam meets; the numbers of shots are those that are given, and there is no coherence and no
    reference where there was none."""
    count = len(CLUSTERS)
    each = np.arange(float(count))
    vectors = {
        name: np.stack([each + 10.0 * number + axis / 4.0 for axis in range(3)], axis=1)
        for number, name in enumerate(("point", "along", "across", "normal"), start=1)
    }
    surfaces = SurfacePositions(
        **{
            name: mi.Vector3f(*(auto.Float(column) for column in values.T))
            for name, values in vectors.items()
        },
        object=auto.UInt32([1, 2, 0, 2, 1, 3]),
        radius=auto.Float(each + 0.125),
        distance=auto.Float(each + 5.0),
    )
    monkeypatch.setattr(kept_light, "surface_positions", lambda *_: surfaces)
    truth = Truth(auto.Float(each + 7.0), auto.UInt32([1, 2, 0, 2, 1, 3]), auto.UInt32([4, 5, 0, 5, 4, 6]))
    nothing: Any = {"coherence": None, "reference": None} if plain else {}
    lights = [
        light_of(number, **{k: v for k, v in nothing.items() if k == "coherence"}) for number in (3, 1, 2)
    ]
    if plain:
        for one in lights:
            one.reference = None
    shots: Any = SimpleNamespace(theta=auto.Float(each))
    none: Any = None
    kept = KeptLight.of(none, none, shots, truth, lights)
    assert kept.clusters.tolist() == CLUSTERS.tolist()
    for part, name in enumerate(PARTS):
        wanted = [value(part, shot, cluster) for shot in range(count) for cluster in range(CLUSTERS[shot])]
        if plain and name == "coherence":
            assert kept.coherence is None
        else:
            np.testing.assert_array_equal(getattr(kept, name), np.float32(wanted))
    assert kept.reference is None if plain else kept.reference.tolist() == (each + 0.5).tolist()  # type: ignore[union-attr]
    back = kept.truth()
    np.testing.assert_array_equal(back.distance.numpy(), each + 7.0)
    assert (back.object.numpy().tolist(), back.material.numpy().tolist()) == (
        [1, 2, 0, 2, 1, 3],
        [4, 5, 0, 5, 4, 6],
    )
    groups = list(kept.groups(np.arange(80, 80 + count, dtype=np.uint32)))
    assert [group.light.count for group in groups] == [1, 2, 3]
    for group, light in zip(groups, (lights[1], lights[2], lights[0]), strict=True):
        index = light.index.numpy()
        np.testing.assert_array_equal(group.index, index)
        np.testing.assert_array_equal(group.light.shot.numpy(), 80 + index)
        for name in ("index", *PARTS, "reference"):
            one, other = getattr(group.light, name), getattr(light, name)
            assert (one is None) == (other is None)
            if one is not None:
                np.testing.assert_array_equal(one.numpy(), other.numpy())
        for name, values in vectors.items():
            np.testing.assert_array_equal(getattr(group.surfaces, name).numpy().T, values[index])
        for name in ("object", "radius", "distance"):
            np.testing.assert_array_equal(
                getattr(group.surfaces, name).numpy(), getattr(surfaces, name).numpy()[index]
            )
