"""Light of shots in NumPy's memory, and back on the device: what was traced once meets a detector again without rays.

It is the light before speckle, in the clusters by which the kernels know it, with what the beams meet: the truth, and
the positions on surfaces to which speckle belongs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.surface_positions import SurfacePositions, surface_positions
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene

_CLUSTER = ("amount", "position", "sigma", "coherence")
_VECTORS = ("point", "along", "across", "normal")


@dataclass(frozen=True)
class KeptGroup:
    """Shots whose light has as many clusters each, on the device: indices, light, and where their beams are."""

    index: NDArray[np.intp]
    light: Light
    surfaces: SurfacePositions


@dataclass(frozen=True)
class KeptLight:
    """Light of n shots, NumPy arrays.

    Attributes
    ----------
    clusters
        Number of clusters of each shot, shape (n,).
    amount, position, sigma, coherence
        Of the clusters, shot after shot, as in :class:`~scanner_sim.render.beam.light.Light`; no coherence where the
        surface tells it.
    reference
        What positions are counted from, shape (n,); None for 0.
    range, object, material
        What chief rays meet, as in :class:`~scanner_sim.render.beam.light.Truth`, shape (n,).
    point, along, across, normal
        Of :class:`~scanner_sim.render.beam.surface_positions.SurfacePositions`, shape (n, 3).
    radius, distance
        Likewise, shape (n,).
    """

    clusters: NDArray[np.int32]
    amount: NDArray[np.float32]
    position: NDArray[np.float32]
    sigma: NDArray[np.float32]
    coherence: NDArray[np.float32] | None
    reference: NDArray[np.float32] | None
    range: NDArray[np.float32]
    object: NDArray[np.int32]
    material: NDArray[np.int32]
    point: NDArray[np.float32]
    along: NDArray[np.float32]
    across: NDArray[np.float32]
    normal: NDArray[np.float32]
    radius: NDArray[np.float32]
    distance: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        loaded: LoadedScene,
        layout: OpticalLayout,
        shots: Shots,
        truth: Truth,
        lights: Iterable[Light],
    ) -> KeptLight:
        """Return the light of n shots from its groups, which hold every shot once."""
        groups = [(light.index.numpy(), light) for light in lights]
        n = dr.width(shots.theta)
        clusters = np.zeros(n, dtype=np.int32)
        for index, light in groups:
            clusters[index] = light.count
        first = _first(clusters)
        parts: dict[str, Any] = {}
        for index, light in groups:
            at = first[index] + np.arange(light.count)[:, None]
            for name in _CLUSTER:
                values = getattr(light, name)
                if values is not None:
                    flat = parts.setdefault(name, np.empty(int(clusters.sum()), dtype=np.float32))
                    flat[at.ravel()] = values.numpy()
            if light.reference is not None:
                parts.setdefault("reference", np.zeros(n, dtype=np.float32))[index] = light.reference.numpy()
        surfaces = surface_positions(loaded, layout, shots, truth)
        dr.eval(surfaces)
        return cls(
            clusters=clusters,
            coherence=parts.get("coherence"),
            reference=parts.get("reference"),
            **{name: parts[name] for name in _CLUSTER[:3]},
            range=truth.distance.numpy(),
            object=truth.object.numpy().astype(np.int32),
            material=truth.material.numpy().astype(np.int32),
            **{name: np.array(getattr(surfaces, name)).T.astype(np.float32) for name in _VECTORS},
            radius=np.array(surfaces.radius),
            distance=np.array(surfaces.distance),
        )

    def truth(self) -> Truth:
        """Return what chief rays meet."""
        numbers = (mi.UInt32(for_device(codes, np.uint32)) for codes in (self.object, self.material))
        return Truth(mi.Float(for_device(self.range)), *numbers)

    def groups(self, shot: NDArray[np.uint32]) -> Iterator[KeptGroup]:
        """Yield the shots by how many clusters their light has; ``shot`` are their numbers, shape (n,)."""
        first = _first(self.clusters)
        for count in np.unique(self.clusters).tolist():
            index = np.flatnonzero(self.clusters == count)
            at = (first[index] + np.arange(count)[:, None]).ravel()
            own: dict[str, Any] = {name: _on_device(getattr(self, name), at) for name in _CLUSTER}
            numbers = mi.UInt32(for_device(index, np.uint32)), mi.UInt32(for_device(shot[index], np.uint32))
            light = Light(*numbers, **own, reference=_on_device(self.reference, index))
            yield KeptGroup(index, light, self._surfaces(index))

    def _surfaces(self, index: NDArray[np.intp]) -> SurfacePositions:
        vectors = {
            name: mi.Vector3f(*(_on_device(getattr(self, name)[:, axis], index) for axis in range(3)))
            for name in _VECTORS
        }
        number = mi.UInt32(for_device(self.object[index], np.uint32))
        return SurfacePositions(
            **vectors,
            object=number,
            radius=_on_device(self.radius, index),
            distance=_on_device(self.distance, index),
        )


def speckled(light: Light, late: int, speckle: Callable[[Light], Float]) -> Light:
    """Return light whose clusters are multiplied by speckle, but for the last ones, which have none.

    Parameters
    ----------
    light
        Of m shots.
    late
        Number of the last clusters of each: light that met several surfaces.
    speckle
        Returns the factors of the clusters of such light, shape (c · m,).
    """
    direct, every = (light.count - late) * light.shots, dr.arange(mi.UInt32, dr.width(light.amount))
    before = dr.arange(mi.UInt32, direct)
    whole = replace(light, amount=dr.gather(mi.Float, light.amount, before)) if late else light
    factor, lit = speckle(whole), every < direct
    amount = (
        light.amount * dr.select(lit, dr.gather(mi.Float, factor, every, lit), 1.0)
        if late
        else (light.amount * factor)
    )
    dr.eval(amount)
    return replace(light, amount=amount)


def _first(clusters: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the index of each shot's first cluster."""
    return np.cumsum(clusters, dtype=np.int64) - clusters


def _on_device(values: NDArray[np.float32] | None, at: NDArray[np.intp]) -> Float | None:
    return None if values is None else mi.Float(for_device(values[at]))


def on_device(values: NDArray[np.float32]) -> Float:
    """Return numbers on the device, flat."""
    return mi.Float(for_device(values))
