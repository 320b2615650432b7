"""Names for arrays on the device, for signatures: what an array holds, where its class cannot be said.

The class of an array is that of the variant which is active when it is made, and the type stubs of Mitsuba and of
Dr.Jit name different classes for one and the same. So a type checker sees :data:`~typing.Any` behind each of these, and
a reader sees what is meant. All arrays are as wide as a batch: entry i belongs to shot, lane or beamlet i.
"""

from __future__ import annotations

from typing import Any, TypeAlias

Float: TypeAlias = Any
"""Single precision, shape (n,)."""
FloatLike: TypeAlias = Any
"""A number, a NumPy array or a :data:`Float`: for laws that are written for all three."""
Int32: TypeAlias = Any
"""Signed whole numbers, shape (n,)."""
UInt32: TypeAlias = Any
"""Whole numbers, shape (n,): indices and counts."""
UInt64: TypeAlias = Any
"""Long whole numbers, shape (n,): counters of random numbers."""
Mask: TypeAlias = Any
"""Truth values, shape (n,)."""
Vector2f: TypeAlias = Any
"""Two single-precision numbers each: coordinates in a plane."""
Vector3f: TypeAlias = Any
"""Directions and points in space [m], single precision."""
Vector4f: TypeAlias = Any
"""Four single-precision numbers each."""
Matrix3f: TypeAlias = Any
"""Rotations, 3 × 3 each."""
Matrix4f: TypeAlias = Any
"""Rigid motions, 4 × 4 each."""
Spectrum: TypeAlias = Any
"""Reflectance, radiance or importance at the one wavelength of the variant."""
Local: TypeAlias = Any
"""A small array of each lane's own, :class:`drjit.Local`."""
SurfaceInteraction3f: TypeAlias = Any
"""Where rays meet surfaces, :class:`mitsuba.SurfaceInteraction3f`."""
Ray3f: TypeAlias = Any
"""Rays, :class:`mitsuba.Ray3f`."""
Shape: TypeAlias = Any
"""A shape of a scene, :class:`mitsuba.Shape`."""
BSDF: TypeAlias = Any
"""What a surface makes of light, :class:`mitsuba.BSDF`."""
MitsubaScene: TypeAlias = Any
"""What rays are traced in, :class:`mitsuba.Scene`."""
