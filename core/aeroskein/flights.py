"""Flights: the reports of a file, gathered per aircraft and put into a plane, for the offline methods.

A flight is what one aircraft (by address, or by a sensor's own track number where one sensor is asked for) reported
without a long gap. Its reports, of any sensor, are ordered by time and turned into measurements in the flight's plane:
positions with their covariance, velocities where an ADS-B or WAM report has them, time jitter apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.conversion import Located, SensorTable, locate, velocity_sigma_mps
from aeroskein.lanes import continues, flight_quantile, held_rows
from aeroskein.measurements import Measurements
from aeroskein.planes import Planes
from aeroskein.plots import Array, Bools, Ints, Plots

__all__ = ["Flights", "gather", "heights", "interpolated", "locate_flights", "measure", "split_at_holes", "stale_rows"]

# One sigma of the difference between geometric height and pressure altitude where nobody tells it, and where the
# flight's own reports do: the spread over recorded traffic, and one altimeter's wandering along a flight. [m]
UNKNOWN_OFFSET_SIGMA_M: Final = 100.0
KNOWN_OFFSET_SIGMA_M: Final = 15.0

# A target slower than this may repeat its position honestly. [m/s]
STANDING_MPS: Final = 2.0


@dataclass(slots=True, eq=False)
class Flights:
    """Reports ordered by flight, then time.

    Attributes
    ----------
    plots : Plots
        The reports.
    flight : (n,) int64
        Flight of each, from 0 without holes.
    unidentified, duplicates : int
        Reports left out: without an identity; with the time of another of the same sensor.
    """

    plots: Plots
    flight: Ints
    unidentified: int = 0
    duplicates: int = 0

    def keep(self, rows: Bools) -> Flights:
        """The given rows, flights renumbered."""
        flight = self.flight[rows]
        return Flights(self.plots.take(rows), np.cumsum(~continues(flight)) - 1, self.unidentified, self.duplicates)


def gather(plots: Plots, split_after_s: float, *, by_local_track: bool = False) -> Flights:
    """Order reports by aircraft and time, and cut where there is a long gap.

    Parameters
    ----------
    plots : Plots
        Reports of any number of aircraft in any order.
    split_after_s : float
        A longer gap starts a new flight. [s]
    by_local_track : bool
        Whether reports without address are told apart by the sensor's own track number; else they are left out.

    Returns
    -------
    Flights
        With what was left out.
    """
    identity = plots.address.astype(np.int64)
    if by_local_track:
        own = (plots.sensor.astype(np.int64) << 48) + (plots.local_track << 24)
        identity = np.where((identity < 0) & (plots.local_track >= 0), own + (1 << 62), identity)
    known = np.flatnonzero(identity >= 0)
    order = known[np.lexsort((plots.received_s[known], plots.sensor[known], plots.time_s[known], identity[known]))]
    ordered, identity = plots.take(order), identity[order]
    same = continues(identity) & (np.diff(ordered.time_s, prepend=-np.inf) == 0.0)
    twice = same & (np.diff(ordered.sensor, prepend=-1) == 0)
    ordered, identity = ordered.take(~twice), identity[~twice]
    cut = ~continues(identity) | (np.diff(ordered.time_s, prepend=-np.inf) > split_after_s)
    return Flights(ordered, np.cumsum(cut) - 1, len(plots) - len(known), int(twice.sum()))


def split_at_holes(flights: Flights, usable: Bools, split_after_s: float) -> Flights:
    """Cut flights where no usable report came for too long, though others did.

    Parameters
    ----------
    flights : Flights
        The reports.
    usable : (n,) bool
        Reports that say something new.
    split_after_s : float
        A longer hole starts a new flight, with the usable report that ends it. [s]
    """
    flight, time_s = flights.flight, flights.plots.time_s
    at = np.flatnonzero(usable)
    cut = ~continues(flight)
    ends_hole = continues(flight[at]) & (np.diff(time_s[at], prepend=-np.inf) > split_after_s)
    cut[at[ends_hole]] = True
    return Flights(flights.plots, np.cumsum(cut) - 1, flights.unidentified, flights.duplicates)


def stale_rows(flights: Flights) -> Bools:
    """Rows that repeat the latitude and longitude of the same sensor's report before, though the target moves."""
    plots = flights.plots
    order = np.lexsort((plots.sensor, flights.flight))
    group = flights.flight[order] * 32768 + plots.sensor[order]
    lat, lon = plots.lat_deg[order], plots.lon_deg[order]
    same = continues(group)
    same[1:] &= (lat[1:] == lat[:-1]) & (lon[1:] == lon[:-1])
    standing = plots.ground_speed_mps[order] < STANDING_MPS  # false where unknown
    stale = np.zeros(len(plots), dtype=np.bool_)
    stale[order] = same & ~standing
    return stale


def interpolated(flight: Ints, time_s: Array, values: Array) -> Array:
    """Fill missing values of a column linearly in time within each flight, held at its ends, shape ``(n,)``."""
    before, after = held_rows(flight, np.isfinite(values))
    none = (before < 0) & (after < 0)
    before = np.where(before < 0, np.maximum(after, 0), before)
    after = np.where(after < 0, before, after)
    apart = time_s[after] - time_s[before]
    share = np.where(apart > 0.0, (time_s - time_s[before]) / np.where(apart > 0.0, apart, 1.0), 0.0)
    filled = values[before] + share * (values[after] - values[before])
    return np.where(none, np.nan, filled)


def heights(flights: Flights, altitude_sigma_m: Array) -> tuple[Array, Array]:
    """Height above the ellipsoid of every report and its sigma, from whoever of its flight tells it.

    Reported heights are taken as they are. Elsewhere it is the pressure altitude plus the flight's median difference
    of the two, or, where the flight never tells both, the median over all flights.

    Parameters
    ----------
    flights : Flights
        The reports.
    altitude_sigma_m : (sensors,) array
        One sigma of each sensor's pressure altitude. [m]

    Returns
    -------
    height_m, sigma_m : (n,) arrays
        NaN where the flight has neither height nor altitude. [m]
    """
    plots, flight = flights.plots, flights.flight
    altitude_m = interpolated(flight, plots.time_s, plots.altitude_m)
    difference = plots.height_m - plots.altitude_m
    told = np.isfinite(difference)
    offset_m = np.full(int(flight[-1]) + 1 if len(flight) else 0, np.nan)
    if told.any():
        teaching = np.unique(flight[told])
        offset_m[teaching] = flight_quantile(np.searchsorted(teaching, flight[told]), difference[told], 0.5)
    common = float(np.median(difference[told])) if told.any() else 0.0
    known = np.isfinite(offset_m)[flight]
    offset = np.where(known, offset_m[flight], common)
    height_m = np.where(np.isnan(plots.height_m), altitude_m + offset, plots.height_m)
    height_m = np.where(np.isnan(height_m), interpolated(flight, plots.time_s, plots.height_m), height_m)
    spread = np.where(known, KNOWN_OFFSET_SIGMA_M, UNKNOWN_OFFSET_SIGMA_M)
    return height_m, np.hypot(altitude_sigma_m[plots.sensor], spread)


def locate_flights(flights: Flights, table: SensorTable, bias_sigmas: Array) -> Located:
    """Find the position of every report; radar measurements are corrected already.

    Parameters
    ----------
    flights : Flights
        The reports.
    table : SensorTable
        The sensors.
    bias_sigmas : (n, 4) array
        One sigma of what registration left in range, azimuth, time and gain. [m, deg, s, 1]
    """
    return locate(flights.plots, table, *heights(flights, table.altitude_sigma_m), bias_sigmas)


def measure(
    flights: Flights, located: Located, planes: Planes, table: SensorTable, time_sigma_s: Array
) -> Measurements:
    """Bring located reports into the planes of their flights; ``slot`` is the flight.

    Parameters
    ----------
    flights, located : Flights, Located
        The reports.
    planes : Planes
        A plane for each flight.
    table : SensorTable
        The sensors.
    time_sigma_s : array by sensor
        One sigma of each sensor's time stamps. [s]
    """
    plots, flight = flights.plots, flights.flight
    east, north = planes.to_plane(flight, located.lat_deg, located.lon_deg)
    axes = planes.axes(flight, located.lat_deg, located.lon_deg, located.height_m)
    covariance = geodesy.rotate_covariance(axes, located.covariance)
    angle = np.radians(plots.track_angle_deg)
    speed = plots.ground_speed_mps
    v_east, v_north = geodesy.rotate_vector(axes, speed * np.sin(angle), speed * np.cos(angle))
    # A radar's own tracked velocity lags behind the flight and is no independent measurement.
    own = ~table.is_radar[plots.sensor] & np.isfinite(v_east)
    usable = located.feasible & np.isfinite(east)
    return Measurements(
        slot=flight,
        time_s=plots.time_s,
        received_s=plots.received_s,
        sensor=plots.sensor.astype(np.float64),
        east_m=np.where(usable, east, np.nan),
        north_m=np.where(usable, north, np.nan),
        r_ee=covariance[:, 0],
        r_en=covariance[:, 1],
        r_nn=covariance[:, 2],
        v_east_mps=np.where(own, v_east, np.nan),
        v_north_mps=np.where(own, v_north, np.nan),
        velocity_variance=np.where(own, velocity_sigma_mps(plots, table) ** 2, np.nan),
        time_variance=time_sigma_s[plots.sensor] ** 2,
        altitude_m=plots.altitude_m,
        vertical_rate_mps=plots.vertical_rate_mps,
        height_m=plots.height_m,
        stamp_s=plots.time_s,
        range_m=plots.range_m,
        azimuth_deg=plots.azimuth_deg,
    )
