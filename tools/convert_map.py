"""Coastlines and borders from TopoJSON to the one compact file that the page ships.

    python tools/convert_map.py countries-50m.json

The input is ``countries-50m.json`` of the npm package ``world-atlas`` (Natural Earth 1:50 m). Its arcs are kept as
arcs: one that two countries share is a border, any other one is coast. Every vertex gets the coarsest of three levels
of detail that it is needed for (Douglas and Peucker 1973, arc by arc, so that neighbours stay neighbours), and land is
kept as rings of arcs, to be filled. ``service/aeroskein_service/web/static/js/map_file.js`` reads the file.

Layout, little endian: magic ``ASKM``, version byte, number of levels, two zero bytes; uint32 arcs, rings, ring
references; float64 x scale, y scale, x offset, y offset of the grid [deg]; then one stream of LEB128 numbers:
for each arc its kind (0 coast, 1 border), its number of points, and for each point the zigzag difference of x to the
point before, shifted left by two with the level in the low bits, and the zigzag difference of y; for each ring its
number of arcs and their zigzag indices (negative: reversed, as ``~index``).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MAGIC: Final = b"ASKM"
VERSION: Final = 1
# A vertex of level 0 is needed when the whole world is shown, of level 1 for a continent, of level 2 for a country.
TOLERANCES_DEG: Final = (0.25, 0.05)
COAST, BORDER = 0, 1
STATIC: Final = Path(__file__).parents[1] / "service" / "aeroskein_service" / "web" / "static" / "map"

Points = NDArray[np.int64]


def read_arcs(topology: dict[str, Any]) -> list[Points]:
    """The arcs as absolute grid points, ``(n, 2)`` each."""
    return [np.cumsum(np.array(arc, dtype=np.int64), axis=0) for arc in topology["arcs"]]


def arc_lists(geometry: dict[str, Any]) -> Iterator[list[int]]:
    """The rings of a polygon, a multipolygon or a collection, as lists of arc indices."""
    if geometry["type"] == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from arc_lists(part)
    elif geometry["type"] == "Polygon":
        yield from geometry["arcs"]
    elif geometry["type"] == "MultiPolygon":
        for polygon in geometry["arcs"]:
            yield from polygon


def index_of(reference: int) -> int:
    """The arc that a reference means; a reversed one is written ``~index``."""
    return ~reference if reference < 0 else reference


def kinds(topology: dict[str, Any]) -> list[int]:
    """Border where two countries share the arc, coast elsewhere."""
    users: list[set[int]] = [set() for _ in topology["arcs"]]
    for number, country in enumerate(topology["objects"]["countries"]["geometries"]):
        for ring in arc_lists(country):
            for reference in ring:
                users[index_of(reference)].add(number)
    return [BORDER if len(of) > 1 else COAST for of in users]


def needed(points_deg: NDArray[np.float64], tolerance_deg: float) -> NDArray[np.bool_]:
    """Which vertices of a line are needed so that no other lies farther off than the tolerance."""
    keep = np.zeros(len(points_deg), dtype=np.bool_)
    keep[[0, -1]] = True
    open_pieces = [(0, len(points_deg) - 1)]
    while open_pieces:
        start, end = open_pieces.pop()
        if end - start < 2:
            continue
        chord = points_deg[end] - points_deg[start]
        away = points_deg[start + 1 : end] - points_deg[start]
        length = np.hypot(*chord)
        if length > 0.0:
            distance = np.abs(chord[0] * away[:, 1] - chord[1] * away[:, 0]) / length
        else:
            distance = np.hypot(away[:, 0], away[:, 1])
        farthest = int(distance.argmax())
        if distance[farthest] > tolerance_deg:
            middle = start + 1 + farthest
            keep[middle] = True
            open_pieces += [(start, middle), (middle, end)]
    return keep


def levels(points: Points, scale: NDArray[np.float64]) -> NDArray[np.int64]:
    """The coarsest level of detail that each vertex is needed for."""
    level = np.full(len(points), len(TOLERANCES_DEG), dtype=np.int64)
    for number, tolerance_deg in reversed(list(enumerate(TOLERANCES_DEG))):
        level[needed(points * scale, tolerance_deg)] = number
    return level


def zigzag(value: int) -> int:
    """A signed number as an unsigned one, small where the number is near zero."""
    return value << 1 if value >= 0 else (-value << 1) - 1


def leb128(value: int) -> bytes:
    """An unsigned number, seven bits a byte, lowest first."""
    made = bytearray()
    while value >= 0x80:
        made.append(value & 0x7F | 0x80)
        value >>= 7
    made.append(value)
    return bytes(made)


def convert(topology: dict[str, Any]) -> bytes:
    """The file's content."""
    arcs = read_arcs(topology)
    scale = np.array(topology["transform"]["scale"])
    stream = bytearray()
    for points, kind in zip(arcs, kinds(topology), strict=True):
        stream += leb128(kind) + leb128(len(points))
        steps = np.diff(points, axis=0, prepend=np.zeros((1, 2), dtype=np.int64))
        for (dx, dy), level in zip(steps.tolist(), levels(points, scale).tolist(), strict=True):
            stream += leb128(zigzag(dx) << 2 | level) + leb128(zigzag(dy))
    rings = list(arc_lists(topology["objects"]["land"]))
    for ring in rings:
        stream += leb128(len(ring)) + b"".join(leb128(zigzag(reference)) for reference in ring)
    head = MAGIC + struct.pack("<BBH", VERSION, len(TOLERANCES_DEG) + 1, 0)
    head += struct.pack("<III", len(arcs), len(rings), sum(len(ring) for ring in rings))
    head += struct.pack("<dddd", *topology["transform"]["scale"], *topology["transform"]["translate"])
    return head + bytes(stream)


def main() -> None:
    """Convert, and say what came out."""
    parser = argparse.ArgumentParser(description="Convert a TopoJSON map to the file that the page ships.")
    parser.add_argument("topojson", type=Path, help="countries-50m.json of the npm package world-atlas")
    parser.add_argument("--output", type=Path, default=STATIC / "world.bin")
    options = parser.parse_args()
    source = options.topojson.read_bytes()
    content = convert(json.loads(source))
    options.output.write_bytes(content)
    print(f"from {options.topojson.name}, SHA-256 {hashlib.sha256(source).hexdigest()}")
    print(f"to   {options.output.name}, {len(content)} bytes, SHA-256 {hashlib.sha256(content).hexdigest()}")


if __name__ == "__main__":
    main()
