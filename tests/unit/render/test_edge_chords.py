"""How an edge shares out the light of a beam: by chords, against closed forms and plain sums."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import ndtr

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config.scanner import Scanner
from scanner_sim.render.beam import edge_chords
from scanner_sim.render.beam.edge_chords import CHORDS, gauss_rules, swept_moments
from scanner_sim.render.beam.pattern import PatternTables, lanes_again, pattern_light, probe_pattern
from scanner_sim.render.beam.swept_beamlets import lengths
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
SCANNER = Scanner()
DISTANCE, SHOTS = 10.0, 48
SIGMA = 0.5 * float(
    beam_radius(DISTANCE, SCANNER.laser.waist_radius, SCANNER.laser.waist_distance, SCANNER.laser.wavelength)
)
WHOLE = {"material": {"reflectance": 0.5}, "position": (0.0, 0.0, DISTANCE)}

pytestmark = pytest.mark.usefixtures("device")


@pytest.mark.parametrize("row", [0, 3, 60, 130, 200, 255])
def test_a_rule_has_the_moments_of_a_swept_beam(row: int) -> None:
    """Claim: E[(x + L t)ⁿ] for n up to 13, by the binomial sum of normal and even moments."""
    length = float(lengths()[row])
    nodes, weights = (values[row] for values in gauss_rules())
    assert len(nodes) == CHORDS
    scale = math.sqrt(1.0 + length**2 / 12.0)
    for order in range(2 * CHORDS):
        wanted = sum(
            math.comb(order, k) * math.prod(range(1, k, 2)) * (0.5 * length) ** (order - k) / (order - k + 1)
            for k in range(0, order + 1, 2)
            if not (order - k) % 2
        )
        assert float(weights @ nodes**order) / scale**order == pytest.approx(
            wanted / scale**order, rel=1e-9, abs=1e-9
        )


@pytest.mark.parametrize("length", [0.0, 0.15, 0.25, 1.0, 6.0, 60.0])
def test_moments_below_a_place(length: float) -> None:
    """Claim: the share of the light below a place, and the mean place of it times that, by quadrature over the box.

    Below a length of 0.2 the beam is a wider Gaussian, whose fourth cumulant L⁴/120 is 1e-5 too large.
    """
    import mitsuba as mi

    places = np.array([-2.5, -0.7, 0.0, 0.4, 1.9]) * math.sqrt(1.0 + length**2 / 12.0)

    def over_box(law: Any, place: float) -> float:
        return float(quad(lambda t: law(place - length * t, length * t), -0.5, 0.5, epsabs=1e-10)[0])

    def share(z: float, _: float) -> float:
        return float(ndtr(z))

    def moment(z: float, shift: float) -> float:
        return float(shift * ndtr(z) - np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))

    found = swept_moments(mi.Float(places.astype(np.float32)), mi.Float(np.full(5, length, dtype=np.float32)))
    for values, law in zip(found, (share, moment), strict=True):
        wanted = [over_box(law, place) for place in places]
        np.testing.assert_allclose(values.numpy(), wanted, atol=3e-5 * (1.0 + length / 10.0))


def light(
    objects: list[dict[str, Any]], aims: Array, travel: Array, beamlets: int = 480
) -> tuple[Array, Array]:
    """Return power [W] and mean pixel of the light of shots, and how many beams one edge parts."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene

    sensor = SCANNER.position_sensor
    layout = OpticalLayout(
        SCANNER.laser, SCANNER.receiver, SCANNER.mirrors.axis_separation, 1.0, sensor.pitch, sensor.height,
        sensor.offset, sensor.diffusion,
    )  # fmt: skip
    loaded = load_scene(Scene.model_validate({"objects": objects}))
    columns = [mi.Float(np.ascontiguousarray(column, dtype=np.float32)) for column in (*aims.T, *travel.T)]
    shots, tables = Shots(dr.arange(mi.UInt32, len(aims)), *columns), PatternTables.of(beamlets)
    probes = probe_pattern(loaded, layout, tables, shots)
    lanes = lanes_again(probes.footprint.numpy())
    amount, place, *_ = (
        values.numpy().astype(np.float64).reshape(-1, len(aims))
        for values in pattern_light(loaded, layout, tables, shots, probes, *lanes)
    )
    return amount.sum(axis=0), (amount * place).sum(axis=0) / np.maximum(amount.sum(axis=0), 1e-300)


def aimed(offsets: Array, along: Array) -> Array:
    """Return Θ and φ of beams that land at places along a direction on a wall that faces the scanner."""
    x, y = (offsets[:, None] * along).T
    separation = SCANNER.mirrors.axis_separation
    # Eq 3 about the axis: x = R Θ, y = (R − D) φ for such small angles.
    return np.stack([np.arctan(x / DISTANCE), np.arctan(y / (DISTANCE - separation))], axis=1)


@pytest.mark.parametrize("turn", [0.0, 35.0, 90.0, 160.0])
@pytest.mark.parametrize("length", [0.0, 3.0, 8.0])
def test_a_straight_edge_leaves_its_share(turn: float, length: float) -> None:
    """Claim: of light on half a wall Φ of the distance to its edge is left, the mean over the way; within 0.002.

    Ten halvings of 7.2 σ leave 0.0035 σ at most, 0.0014 of the light on each chord, and chords differ. Counted by 160
    beamlets, the rms alone is 0.006.
    """
    normal = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))])
    offsets = np.random.default_rng(int(turn)).uniform(-2.2, 2.2, SHOTS) * SIGMA
    aims = aimed(offsets, normal)
    way = np.array([0.8, 0.6]) * length * SIGMA
    travel = np.tile([way[0] / DISTANCE, way[1] / (DISTANCE - SCANNER.mirrors.axis_separation)], (SHOTS, 1))
    half = WHOLE | {
        "name": "half", "shape": "rectangle", "size": (8.0, 8.0),
        "rotation": {"axis": "z", "angle": math.radians(turn)},
        "position": (-4.0 * normal[0], -4.0 * normal[1], DISTANCE),
    }  # fmt: skip
    wall = WHOLE | {"name": "wall", "shape": "rectangle", "size": (16.0, 16.0)}
    (left, _), (whole, _) = (light([one], aims, travel) for one in (half, wall))
    across = abs(float(way @ normal)) / SIGMA
    wanted = [
        quad(lambda t, at=at: float(ndtr(-at + across * t)), -0.5, 0.5, epsabs=1e-9)[0]
        for at in (offsets / SIGMA).tolist()
    ]
    np.testing.assert_allclose(left / whole, wanted, atol=2e-3)


def test_a_shadow_seen_from_the_lens_leaves_its_share() -> None:
    """Claim: where the lens sees a wall up to a place, hidden from there on by a plate before it that the laser passes,
    Φ of the distance to that place is left, within 0.01.

    Rays leave the wall a millimetre before it, which moves the place by 20 µm, 0.006 of the light. Counted by
    beamlets alone, up to 0.05 of it would be missing.
    """
    before, offsets = 0.5, np.linspace(-2.2, 2.2, SHOTS) * SIGMA
    aims, still = aimed(offsets, np.array([1.0, 0.0])), np.zeros((SHOTS, 2))
    # The line from the lens to the place on the axis passes the plane of the plate at its edge.
    edge = SCANNER.receiver.baseline * before / DISTANCE
    plate = {"name": "plate", "shape": "rectangle", "size": (2.0, 8.0)}
    hider = WHOLE | plate | {"position": (edge + 1.0, 0.0, DISTANCE - before)}
    wall = WHOLE | {"name": "wall", "shape": "rectangle", "size": (16.0, 16.0)}
    (left, _), (whole, _) = (light(objects, aims, still) for objects in ([wall, hider], [wall]))
    np.testing.assert_allclose(left / whole, ndtr(-offsets / SIGMA), atol=0.01)


def test_light_that_no_beamlet_meets_is_there() -> None:
    """Claim: of 19 beamlets none is farther out than 1.9 σ, and yet light beyond an edge there is Φ, within 0.002: that
    of a bright strip beside nothing, and that which is left of it beside the strip's dark end."""
    offsets = np.linspace(1.95, 2.3, SHOTS) * SIGMA
    aims, still = aimed(offsets, np.array([1.0, 0.0])), np.zeros((SHOTS, 2))
    sized = {"shape": "rectangle", "size": (8.0, 8.0)}
    bright = WHOLE | sized | {"name": "bright", "position": (-4.0, 0.0, DISTANCE)}
    black = (
        WHOLE | sized | {"name": "black", "position": (4.0, 0.0, DISTANCE), "material": {"reflectance": 0.01}}
    )
    wall = WHOLE | {"name": "wall", "shape": "rectangle", "size": (16.0, 16.0)}
    whole, _ = light([wall], aims, still)
    beyond = ndtr(-offsets / SIGMA)
    for objects, wanted in (([bright], beyond), ([bright, black], 0.02 + 0.98 * beyond)):
        found, _ = light(objects, aims, still, beamlets=57)
        np.testing.assert_allclose(found / whole, wanted, atol=2e-3)


def test_a_bent_edge_leaves_its_share() -> None:
    """Claim: of a disc 24 σ in radius by a sum over a fine grid, at rest; the mean place of its light within 0.03 σ.

    A straight edge in its place would err by up to 0.5 · φ(0)/24 = 0.008 of the light.
    """
    radius = 24.0 * SIGMA
    random = np.random.default_rng(7)
    offsets = radius + random.uniform(-2.0, 2.0, SHOTS) * SIGMA
    angle = random.uniform(0.0, 2.0 * np.pi, SHOTS)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    aims = np.concatenate(
        [aimed(offset[None], one[None]) for offset, one in zip(offsets, directions, strict=True)]
    )
    disc = WHOLE | {"name": "disc", "shape": "disc", "diameter": 2.0 * radius}
    wall = WHOLE | {"name": "wall", "shape": "rectangle", "size": (16.0, 16.0)}
    still = np.zeros((SHOTS, 2))
    (left, place), (whole, middle) = (light([one], aims, still) for one in (disc, wall))
    grid = np.linspace(-6.0, 6.0, 601)
    x, y = np.meshgrid(grid, grid)
    weight = np.exp(-0.5 * (x**2 + y**2))
    weight /= weight.sum()
    share, shift = np.empty(SHOTS), np.empty(SHOTS)
    for number, (offset, one) in enumerate(zip(offsets / SIGMA, directions, strict=True)):
        inside = (x + offset * one[0]) ** 2 + (y + offset * one[1]) ** 2 < (radius / SIGMA) ** 2
        share[number] = weight[inside].sum()
        shift[number] = (weight * x)[inside].sum() / share[number]
    np.testing.assert_allclose(left / whole, share, atol=2e-3)
    # Pixels per standard deviation along x, −f p/(z pitch), whatever their sign.
    per_sigma = SIGMA * SCANNER.receiver.focal_length / DISTANCE / SCANNER.position_sensor.pitch
    far = share > 0.03
    apart = (place - middle)[far] / per_sigma
    sign = np.sign(float(apart @ shift[far]))
    np.testing.assert_allclose(apart, sign * shift[far], atol=0.03)


def test_two_edges_are_left_to_beamlets() -> None:
    """Claim: of a strip 1.2 σ wide, whose chords end on the same ground, the light is that of beamlets, within 0.02."""
    offsets = np.linspace(-1.0, 1.0, SHOTS) * SIGMA
    aims, still = aimed(offsets, np.array([1.0, 0.0])), np.zeros((SHOTS, 2))
    strip = WHOLE | {"name": "strip", "shape": "rectangle", "size": (1.2 * SIGMA, 8.0)}
    wall = WHOLE | {"name": "wall", "shape": "rectangle", "size": (16.0, 16.0)}
    (left, _), (whole, _) = (light([one], aims, still) for one in (strip, wall))
    at = offsets / SIGMA
    np.testing.assert_allclose(left / whole, ndtr(0.6 - at) - ndtr(-0.6 - at), atol=0.02)


def test_scenes_in_several_kernels_are_lit_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: where a scene's surfaces allow no loop within one kernel, the chords are halved by one after the other, to
    the same light."""
    offsets = np.linspace(-1.5, 1.5, SHOTS) * SIGMA
    aims, still = aimed(offsets, np.array([0.6, 0.8])), np.zeros((SHOTS, 2))
    half = WHOLE | {
        "name": "half",
        "shape": "rectangle",
        "size": (8.0, 8.0),
        "position": (-4.0, 0.3, DISTANCE),
    }
    alone = light([half], aims, still)
    monkeypatch.setattr(edge_chords, "one_kernel", lambda _: False)
    np.testing.assert_allclose(light([half], aims, still), alone, rtol=1e-6)
