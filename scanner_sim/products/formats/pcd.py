"""Points as PCD 0.7 of the Point Cloud Library, which PCL and Open3D read; organised where there are rows.

What has no range stays as NaN, with its status, so that rows and columns keep their neighbours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.formats.cloud import FRAME, Cloud

_TYPES = {"f": "F", "u": "U", "i": "I"}


def write_pcd(path: Path, cloud: Cloud, *, ascii_numbers: bool = False) -> None:
    """Write all shots of a cloud; an existing file is overwritten.

    Fields are ``x y z intensity``, then the columns of the cloud and ``time`` [s] where it is known. The viewpoint is
    the scanner's: the frame's origin, not turned.

    Parameters
    ----------
    path
        The file.
    cloud
        The points.
    ascii_numbers
        Write text, each number with as many digits as give it again, in the place of bytes.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    table = packed(cloud)
    rows, columns = cloud.shape or (1, len(table))
    fields = [(name, table.dtype[name]) for name in table.dtype.names or ()]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        f"# {FRAME}",
        f"# intensity and signal in electrons; {cloud.software}; seed {cloud.seed}",
        *(
            f"# {name} {number} {word}"
            for name, words in cloud.legends.items()
            for number, word in words.items()
        ),
        "VERSION 0.7",
        f"FIELDS {' '.join(name for name, _ in fields)}",
        f"SIZE {' '.join(str(kind.itemsize) for _, kind in fields)}",
        f"TYPE {' '.join(_TYPES[kind.kind] for _, kind in fields)}",
        f"COUNT {' '.join('1' for _ in fields)}",
        f"WIDTH {columns}",
        f"HEIGHT {rows}",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(table)}",
        f"DATA {'ascii' if ascii_numbers else 'binary'}\n",
    ]
    with open(path, "wb") as stream:
        stream.write("\n".join(header).encode())
        stream.write(_lines(table).encode() if ascii_numbers else table.tobytes())


def packed(cloud: Cloud) -> NDArray[np.void]:
    """Return the shots as a table without gaps: ``x y z intensity``, the columns, and the time where it is known."""
    arrays: dict[str, NDArray[Any]] = {name: cloud.points[:, axis] for axis, name in enumerate("xyz")}
    arrays["intensity"] = cloud.signal.astype(np.float32)
    arrays |= {column.name: column.values for column in cloud.columns}
    if cloud.time is not None:
        arrays["time"] = cloud.time
    table = np.empty(
        len(cloud.valid), dtype=[(name, values.dtype.newbyteorder("<")) for name, values in arrays.items()]
    )
    for name, values in arrays.items():
        table[name] = values
    return table


def _lines(table: NDArray[np.void]) -> str:
    """Return a line for each shot; NumPy spells a number with as many digits as its type needs."""
    columns = [table[name].astype("U32").tolist() for name in table.dtype.names or ()]
    return "".join(" ".join(line) + "\n" for line in zip(*columns, strict=True))
