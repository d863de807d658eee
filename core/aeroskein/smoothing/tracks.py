"""Whole tracks offline: all reports of an aircraft, of all sensors, smoothed forwards and backwards into one track.

    reports ─► registration (what is known of the radars' biases) ─► flights ─► plane ─► reference smoother ─► elements

Identity is the address; reports without one have no place in an offline track. Nothing is associated here and nothing
is registered: the biases come from outside, and what is uncertain about them widens the radars' covariances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.conversion import Located, SensorTable
from aeroskein.events import RegistrationState
from aeroskein.flights import Flights, gather, interpolated, locate_flights, measure, split_at_holes, stale_rows
from aeroskein.lanes import continues
from aeroskein.measurements import Measurements
from aeroskein.planes import LocalPlanes, planes_of
from aeroskein.plots import ON_GROUND, Array, Bools, Ints, Plots
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.settings import EngineSettings
from aeroskein.smoothing.biases import bias_table, corrected, left_over
from aeroskein.smoothing.climb import smooth_altitude
from aeroskein.smoothing.elements import Elements, cut_elements
from aeroskein.smoothing.reference import ReferenceEstimates, smooth_tracks
from aeroskein.units import wrap_azimuth_deg

__all__ = ["SmoothingSummary", "smooth_reports"]

# Satellite geometry makes heights this much less accurate than positions along each axis.
HEIGHT_SIGMAS: Final = 1.5


@dataclass(slots=True)
class SmoothingSummary:
    """What was done with the reports, as counts."""

    reports: int = 0
    tracks: int = 0
    unidentified: int = 0
    duplicates: int = 0
    unconfirmed: int = 0
    stale: int = 0
    outliers: int = 0


@dataclass(slots=True, eq=False)
class _Scene:
    """Everything that is known of the flights before they are smoothed."""

    flights: Flights
    located: Located
    planes: LocalPlanes
    measurements: Measurements
    table: SensorTable


def smooth_reports(
    plots: Plots, engine: EngineSettings, registration: Sequence[RegistrationState] = ()
) -> tuple[FusedPoints | None, SmoothingSummary]:
    """Smooth the tracks of all aircraft that have an address.

    Parameters
    ----------
    plots : Plots
        Reports of all sensors, in any order.
    engine : EngineSettings
        Sensors; ``fusion.element_s`` is the length of an element, ``tracks.terminate_s`` the gap that ends a track,
        ``tracks.confirm_reports`` the number of reports that make one.
    registration : sequence of RegistrationState
        What is known of the radars' biases; a radar that is not listed has the biases of its settings, known as well
        as its priors say.

    Returns
    -------
    points : FusedPoints or None
        Element points of all tracks; None where no report has an address.
    summary : SmoothingSummary
        What was done.
    """
    summary = SmoothingSummary(reports=len(plots))
    scene = _scene(plots, engine, registration, summary)
    if scene is None:
        return None, summary
    flight = scene.flights.flight
    summary.tracks = int(flight[-1]) + 1
    period_s = scene.table.period_s[scene.flights.plots.sensor]
    elements = cut_elements(flight, scene.measurements.time_s, period_s, engine.fusion.element_s)
    estimates, accepted = smooth_tracks(scene.measurements, elements.flight, elements.centre_s)
    summary.outliers = int((~accepted & np.isfinite(scene.measurements.east_m)).sum())
    return _points(scene, elements, estimates, accepted, len(engine.sensors)), summary


def _scene(
    plots: Plots, engine: EngineSettings, registration: Sequence[RegistrationState], summary: SmoothingSummary
) -> _Scene | None:
    table = SensorTable(engine)
    biases = bias_table(engine, registration)
    flights = gather(corrected(plots, biases), engine.tracks.terminate_s)
    summary.unidentified, summary.duplicates = flights.unidentified, flights.duplicates
    stale = stale_rows(flights)
    summary.stale = int(stale.sum())
    flights = flights.keep(~stale)
    flights = split_at_holes(flights, np.ones(len(flights.plots), dtype=np.bool_), engine.tracks.terminate_s)
    confirmed = np.bincount(flights.flight) >= engine.tracks.confirm_reports
    summary.unconfirmed = int((~confirmed[flights.flight]).sum())
    flights = flights.keep(confirmed[flights.flight])
    if len(flights.plots) == 0:
        return None
    sigmas = left_over(flights.plots, biases)
    located = locate_flights(flights, table, sigmas)
    planes = planes_of("local", flights.flight, located.lat_deg, located.lon_deg)
    assert isinstance(planes, LocalPlanes)
    measurements = measure(flights, located, planes, table, table.time_sigma_s)
    measurements.time_variance = measurements.time_variance + sigmas[:, 2] ** 2
    return _Scene(flights, located, planes, measurements, table)


def _points(
    scene: _Scene, elements: Elements, estimates: ReferenceEstimates, accepted: Bools, sensors: int
) -> FusedPoints:
    plots, flight = scene.flights.plots, scene.flights.flight
    # Before a track's first believable report there is nothing to publish.
    kept = np.flatnonzero(np.isfinite(estimates.position_m[:, 0]))
    sources = np.zeros((len(elements), sensors), dtype=np.int32)
    np.add.at(sources, (elements.of_report[accepted], plots.sensor[accepted]), 1)
    rejected = np.bincount(elements.of_report[~accepted], minlength=len(elements)).astype(np.int32)
    coasted = sources.sum(axis=1) == 0
    flags = np.where(coasted, int(Flag.COASTED), 0)
    flags |= np.where(_any(elements, plots.flags & ON_GROUND > 0), int(Flag.ON_GROUND), 0)
    of_flight = elements.flight[kept]
    first = np.flatnonzero(~continues(flight))
    address, callsign, mode_a = _identity(scene.flights, first)
    index = np.arange(len(kept)) - np.searchsorted(of_flight, of_flight)
    altitude_m, height_m, rate_mps = _altitudes(scene, elements)
    return FusedPoints(
        product=Product.ELEMENT,
        slot=of_flight,
        track_number=of_flight + 1,
        label=address[of_flight],
        address=address[of_flight],
        mode_a=mode_a[of_flight],
        callsign=callsign[of_flight],
        seq=index,
        time_s=elements.centre_s[kept],
        altitude_m=altitude_m[kept],
        height_m=height_m[kept],
        vertical_rate_mps=rate_mps[kept],
        status=np.full(len(kept), Status.CONFIRMED, dtype=np.uint8),
        element=index,
        span_s=elements.span_s[kept],
        master=_masters(scene, elements, accepted, sensors)[kept],
        sources=sources[kept],
        rejected=rejected[kept],
        input_received_s=np.full(len(kept), np.nan),
        flags=flags[kept].astype(np.uint16),
        renamed_to=np.full(len(kept), -1, dtype=np.int32),
        **_kinematics(scene, estimates, height_m, kept),
    )


def _any(elements: Elements, where: Bools) -> Bools:
    """Elements with a report for which something holds."""
    return np.bincount(elements.of_report[where], minlength=len(elements)) > 0


def _identity(flights: Flights, first: Ints) -> tuple[NDArray[np.int32], NDArray[np.bytes_], NDArray[np.int16]]:
    """Address, callsign and Mode A of each flight: the last that was told."""
    plots, flight = flights.plots, flights.flight
    callsign, mode_a = np.zeros(len(first), dtype="S8"), np.full(len(first), -1, dtype=np.int16)
    named, coded = np.flatnonzero(plots.callsign != b""), np.flatnonzero(plots.mode_a >= 0)
    # Of repeated indices the last assignment stays.
    callsign[flight[named]] = plots.callsign[named]
    mode_a[flight[coded]] = plots.mode_a[coded]
    return plots.address[first], callsign, mode_a


def _masters(scene: _Scene, elements: Elements, accepted: Bools, sensors: int) -> NDArray[np.int16]:
    """Per element the sensor with the most accurate accepted report, -1 where there is none."""
    trace = scene.measurements.r_ee + scene.measurements.r_nn
    best = np.full((len(elements), sensors), np.inf)
    np.minimum.at(best, (elements.of_report[accepted], scene.flights.plots.sensor[accepted]), trace[accepted])
    return np.where(np.isfinite(best).any(axis=1), best.argmin(axis=1), -1).astype(np.int16)


def _altitudes(scene: _Scene, elements: Elements) -> tuple[Array, Array, Array]:
    """Altitude, height and vertical rate at the centres; NaN where the flight tells none."""
    plots, flight = scene.flights.plots, scene.flights.flight
    n, m = len(flight), len(elements)
    time_s = np.concatenate([scene.measurements.time_s, elements.centre_s])
    both = np.concatenate([flight, elements.flight])
    order = np.lexsort((np.repeat([0, 1], [n, m]), time_s, both))
    place = np.empty(n + m, dtype=np.int64)
    place[order] = np.arange(n + m)
    nothing = np.full(m, np.nan)
    encoder_m = scene.table.altitude_sigma_m[plots.sensor]
    # Geometric height comes from the receiver that gives the position, and is half as much worse again.
    receiver_m = HEIGHT_SIGMAS * np.sqrt(0.5 * (scene.measurements.r_ee + scene.measurements.r_nn))
    rate = np.concatenate([plots.vertical_rate_mps, nothing])[order]
    results = []
    for column, sigma in ((plots.altitude_m, encoder_m), (plots.height_m, receiver_m)):
        values = np.concatenate([column, nothing])[order]
        sigma_m = np.concatenate([sigma, np.ones(m)])[order]
        results.append([r[place[n:]] for r in smooth_altitude(both[order], time_s[order], values, sigma_m, rate)])
    (altitude, altitude_rate), (height, height_rate) = results
    return altitude, height, np.where(np.isnan(altitude_rate), height_rate, altitude_rate)


def _kinematics(scene: _Scene, estimates: ReferenceEstimates, height_m: Array, kept: Ints) -> dict[str, Array]:
    """Position, velocity and covariances in the local plane at each point, by column name."""
    flight, position = estimates.flight[kept], estimates.position_m[kept]
    lat_deg, lon_deg = scene.planes.from_plane(flight, position[:, 0], position[:, 1])
    known = interpolated(scene.flights.flight, scene.measurements.time_s, scene.located.height_m)
    typical = np.bincount(scene.flights.flight, weights=known) / np.bincount(scene.flights.flight)
    height = np.where(np.isnan(height_m[kept]), typical[flight], height_m[kept])
    back = geodesy.invert_axes(scene.planes.axes(flight, lat_deg, lon_deg, height))
    v_east, v_north = geodesy.rotate_vector(back, *estimates.velocity_mps[kept].T)
    packed = []
    for matrix in (estimates.position_cov_m2[kept], estimates.velocity_cov_m2ps2[kept]):
        upper = np.stack([matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]], axis=1)
        packed.append(geodesy.rotate_covariance(back, upper))
    return {
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "ground_speed_mps": np.hypot(v_east, v_north),
        "track_angle_deg": wrap_azimuth_deg(np.degrees(np.arctan2(v_east, v_north))),
        "position_cov_m2": packed[0],
        "velocity_cov_m2ps2": packed[1],
    }
