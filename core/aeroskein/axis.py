"""The axis of a flight as a polyline: arc length, the coordinates (s, c) of points along and across it, its borders.

The element method measures everything along the axis of the flight and across it. Published with one chord from end to
end, for which a single direction would do; a flight that turns leaves the strip beside its chord, so here the axis may
have any number of pieces, of which the chord is the case of one. Axes come in columns: ``(n, P, 2)`` for n flights
with P points each; a shorter one repeats its last point.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["SHORTEST_PIECE_M", "axis_stations", "border_lines", "interpolate_on_axis", "project_on_axis", "sagitta"]

# A border keeps its distance round a corner until the axis turns by more than 120 degrees; beyond, the mitre would
# run away from the flight, so it is cut off there.
SMALLEST_MITRE_COSINE: Final = 0.5

# A shorter piece has no direction worth the name, only the rounding of its ends. [m]
SHORTEST_PIECE_M: Final = 1e-6


def axis_stations(axis: Array) -> Array:
    """Arc length at each point of the axes: ``(n, P, 2)`` gives ``(n, P)``, from 0. [m]"""
    pieces = np.diff(axis, axis=-2)
    lengths = np.hypot(pieces[..., 0], pieces[..., 1])
    return np.concatenate([np.zeros((*lengths.shape[:-1], 1)), np.cumsum(lengths, axis=-1)], axis=-1)


def project_on_axis(points: Array, axis: Array, allowed: Bools | None = None) -> tuple[Array, Array, Ints]:
    """Give points their coordinates along and across the nearest piece of their axis.

    The first piece is prolonged backwards and the last one forwards, so a point before the start has s < 0. Outside a
    corner a point belongs to the corner, and its cross distance is that to the corner. On an axis without length
    (hovering) s is 0 and c the distance from it, so that ``|c| <= b`` is the disc around it.

    Parameters
    ----------
    points : (n, K, 2) array
        Points of each flight; NaN gives NaN. [m]
    axis : (n, P, 2) array
        Axes, P of at least 2. [m]
    allowed : (n, K, P - 1) bool array, optional
        Which pieces a point may belong to; in a hold, those flown at about its time, so that it cannot fall on another
        lap. A point with none has s and c NaN.

    Returns
    -------
    s_m : (n, K) array
        Arc length of the foot of the perpendicular. [m]
    c_m : (n, K) array
        Signed distance from the axis, positive on the left of the flight. [m]
    piece : (n, K) int array
        Index of the piece.
    """
    start, vector = axis[:, None, :-1], np.diff(axis, axis=1)[:, None]
    length = np.hypot(vector[..., 0], vector[..., 1])
    real = length > SHORTEST_PIECE_M
    unit = vector / np.where(real, length, 1.0)[..., None]
    # arrays over (flight, point, piece) from here
    away = points[:, :, None, :] - start
    along = away[..., 0] * unit[..., 0] + away[..., 1] * unit[..., 1]
    across = unit[..., 0] * away[..., 1] - unit[..., 1] * away[..., 0]
    within = np.clip(along, 0.0, length)
    distance = np.hypot(along - within, across)
    hovering = real.sum(axis=-1) == 0
    choice = np.where(real | hovering[..., None], distance, np.inf)
    if allowed is not None:
        choice = np.where(allowed, choice, np.inf)
    piece = choice.argmin(axis=-1)
    rows, columns = np.ogrid[: piece.shape[0], : piece.shape[1]]
    picked = (rows, columns, piece)
    # Only the two ends are prolonged; the last piece with a length may be followed by repeated points.
    first = real.argmax(axis=-1)
    last = real.shape[-1] - 1 - real[..., ::-1].argmax(axis=-1)
    beyond = along[picked] - within[picked]
    prolonged = ((piece == first) & (beyond < 0.0)) | ((piece == last) & (beyond > 0.0))
    s_m = axis_stations(axis)[rows, piece] + np.where(prolonged, along[picked], within[picked])
    c_m = np.where(prolonged, across[picked], np.copysign(distance[picked], across[picked]))
    c_m = np.where(hovering, np.hypot(away[..., 0], away[..., 1])[picked], c_m)
    somewhere = np.isfinite(choice[picked])
    return np.where(somewhere, s_m, np.nan), np.where(somewhere, c_m, np.nan), piece


def interpolate_on_axis(stations: Array, values: Array, at: Array) -> Array:
    """Read times or positions off the axis at given stations, linearly, prolonged at both ends.

    Parameters
    ----------
    stations : (n, P) array
        Non-decreasing, from ``axis_stations``, or times.
    values : (n, P) or (n, P, d) array
        What is known at them: times, or points.
    at : (n, K) array
        Where to read.

    Returns
    -------
    (n, K) or (n, K, d) array
        Interpolated values; at a repeated station, one of its values.
    """
    rows = np.arange(len(stations))[:, None]
    # The first station not before the point closes its interval; at the ends the outermost interval with a width is
    # prolonged, because repeated stations have no direction.
    after = (stations[:, None, :] < at[:, :, None]).sum(axis=-1)
    first = (stations <= stations[:, :1]).sum(axis=-1)[:, None]
    last = (stations < stations[:, -1:]).sum(axis=-1)[:, None]
    high = np.maximum(np.minimum(np.maximum(after, first), last), 1)
    low = high - 1
    width = stations[rows, high] - stations[rows, low]
    share = (at - stations[rows, low]) / np.where(width > 0.0, width, np.inf)
    if values.ndim == 3:
        share = share[..., None]
    below: Array = values[rows, low]
    read: Array = below + share * (values[rows, high] - below)
    return read


def border_lines(axis: Array, half_width_m: Array | float) -> tuple[Array, Array]:
    """The boundary lines T1 and T2 left and right of the axis, one point beside each of its points.

    Beside a chord they are the two published parallels; at a corner they follow its bisector.

    Parameters
    ----------
    axis : (n, P, 2) array
        Axes. [m]
    half_width_m : (n,) array or float
        Distance of each border from the axis. [m]

    Returns
    -------
    left, right : (n, P, 2) arrays
        Points of the borders; on the axis itself where it has no length. [m]
    """
    normals, mitre = _corner_normals(axis)
    offset = np.broadcast_to(np.asarray(half_width_m, dtype=np.float64), (len(axis),))[:, None] / mitre
    step = normals * offset[..., None]
    return axis + step, axis - step


def sagitta(length_m: Array, turn_rad: Array) -> Array:
    """How far an arc of this length that turns by this angle bulges from its chord: length x turn / 8. [m]"""
    return np.abs(length_m * turn_rad) / 8.0


def _corner_normals(axis: Array) -> tuple[Array, Array]:
    """Unit normals at the points of the axes, and the cosine of half the turn there."""
    unit = _directions(axis)
    arriving = np.concatenate([unit[:, :1], unit], axis=1)
    leaving = np.concatenate([unit, unit[:, -1:]], axis=1)
    mean = 0.5 * (arriving + leaving)
    cosine = np.hypot(mean[..., 0], mean[..., 1])
    # Where the flight reverses on the spot there is no bisector; the direction of arrival serves.
    turned = cosine > 1e-6
    mean = np.where(turned[..., None], mean / np.where(turned, cosine, 1.0)[..., None], arriving)
    normals = np.stack([-mean[..., 1], mean[..., 0]], axis=-1)
    return normals, np.maximum(cosine, SMALLEST_MITRE_COSINE)


def _directions(axis: Array) -> Array:
    """Unit vectors of the pieces; one without length has that of the piece before it, or of the first with a length."""
    vector = np.diff(axis, axis=1)
    length = np.hypot(vector[..., 0], vector[..., 1])
    real = length > SHORTEST_PIECE_M
    unit = vector / np.where(real, length, 1.0)[..., None]
    source = np.maximum.accumulate(np.where(real, np.arange(real.shape[1]), -1), axis=1)
    source = np.where(source < 0, real.argmax(axis=1)[:, None], source)
    directions: Array = unit[np.arange(len(unit))[:, None], source]
    return directions
