"""GPS time of a moment: what LAS and E57 count in."""

from __future__ import annotations

from datetime import datetime

import erfa

_GPS_START = datetime(1980, 1, 6)
_TAI_LESS_GPS = 19.0
"""Seconds: GPS time began when TAI was that much ahead of UTC."""
_ADJUSTMENT = 1e9
"""What adjusted standard GPS time is less than GPS time [s]."""


def gps_time(moment: datetime) -> float:
    """Return a moment of UTC as GPS time [s]: since 6 January 1980, without leap seconds."""
    plain = moment.replace(tzinfo=None)
    day = (plain - datetime(plain.year, plain.month, plain.day)).total_seconds() / 86_400.0
    ahead = float(erfa.dat(plain.year, plain.month, plain.day, day))
    return (plain - _GPS_START).total_seconds() + ahead - _TAI_LESS_GPS


def adjusted_time(moment: datetime) -> float:
    """Return a moment of UTC as adjusted standard GPS time [s]."""
    return gps_time(moment) - _ADJUSTMENT
