"""Background light in the photodiode's field of view, from panoramas about its own lens.

Not modelled: the corners of the round field, which counts as a square of the same solid angle, and the errors of the
mirrors in φ.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float
from scanner_sim.render.background.panorama import Panorama, known_panorama
from scanner_sim.render.background.view import PanoramaView, Rows
from scanner_sim.render.beam.light import Light
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.light.lighting import Sky

_BINS = 8
"""Bins of the panorama across the field, at most a pixel of the line each, and positions that are averaged."""


@dataclass(frozen=True)
class Field:
    """The square of the solid angle of a photodiode's round field.

    Attributes
    ----------
    side
        Its side [rad].
    aside
        Angle from its middle to the beam [rad]: 0 for a lens on the laser's axis; beside it half the round field, which
        reaches from infinity inwards.
    baseline
        Distance of the lens from the laser [m].
    """

    side: float
    aside: float
    baseline: float


def field_panorama(
    loaded: LoadedScene,
    layout: OpticalLayout,
    field: Field,
    sky: Sky,
    rows: Rows,
    settings: Transport,
    seed: int,
) -> Panorama:
    """Path-trace what the photodiode sees in some rows, averaged across the row over its field.

    Parameters
    ----------
    loaded, layout, sky
        Scene, optics of the triangulation, Sun and Earth.
    field
        The photodiode's field.
    rows
        The rows.
    settings, seed
        How finely light is followed, and the seed of its paths.
    """
    optics = field_optics(layout, field)
    step = optics.pitch / optics.receiver.focal_length
    margin = 0.5 * field.side + 2.0 * step
    first, last = (end - field.aside for end in rows.horizontal)
    bins = math.ceil((last - first + 2.0 * margin) / step) + 1
    view = PanoramaView(rows.phi, first - margin, step, bins, rows.time, rows.between)
    return known_panorama(loaded, optics, sky, view, settings, seed)


def field_optics(layout: OpticalLayout, field: Field) -> OpticalLayout:
    """Return the optics whose pixels would see what is averaged over a field: its bins, as high as the field."""
    f = layout.receiver.focal_length
    step = max(field.side / _BINS, layout.pitch / f)
    # A lens on the laser's axis is no part that a scenario can hold, hence the copy that is not checked.
    receiver = layout.receiver.model_copy(update={"baseline": field.baseline})
    return dataclasses.replace(layout, receiver=receiver, pitch=step * f, height=field.side * f)


def field_light(
    panorama: Panorama | None, field: Field, shots: Shots, columns: int, collected: tuple[float, float]
) -> Float:
    """Return the light on the photodiode [W] of n shots, a Dr.Jit array of shape (n,).

    Parameters
    ----------
    panorama
        From :func:`field_panorama`; None in the dark.
    field
        The field.
    shots
        The shots; their numbers tell the rows.
    columns
        Voxels of a row.
    collected
        Light on the photodiode from a field of one radiance, in band and out of band [W], per radiance over the Sun's
        irradiance [1/sr].
    """
    if panorama is None:
        return dr.zeros(mi.Float, dr.width(shots.theta))
    weights = [dr.opaque(mi.Float, part / _BINS) for part in collected]
    place_of_all = dr.arange(mi.UInt32, dr.width(shots.theta))
    panorama = panorama.seen_by(place_of_all)
    row, power = panorama.view.row(shots, place_of_all, columns), mi.Float(0.0)
    for part in range(_BINS):
        position = field.side * ((part + 0.5) / _BINS - 0.5) - field.aside
        at = shots.theta + dr.opaque(mi.Float, position)
        for weight, layer in zip(weights, (panorama.in_band, panorama.out_of_band), strict=True):
            power = dr.fma(weight, panorama.look(layer, row, at), power)
    dr.eval(power)
    return power


def batches_of_echoes(groups: Iterator[Light], light: Float, most: int) -> Iterator[tuple[Light, Float]]:
    """Yield echoes in parts of no more than ``most`` shots, each with the background of its shots [W]."""
    for echoes in groups:
        for start in range(0, echoes.shots, most):
            indices = dr.arange(mi.UInt32, min(most, echoes.shots - start)) + dr.opaque(mi.UInt32, start)
            some = echoes if echoes.shots <= most else echoes.part(indices)
            yield some, dr.gather(mi.Float, light, some.index)
