"""Reports that wait for their element are placed where the aircraft was, with the radar's errors taken out."""

from __future__ import annotations

import numpy as np
import pytest
from tests.wire_samples import NOW_S

from aeroskein.geodesy import frame_rows
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein_service.web.waiting_reports import place_reports

SITE = {"lat_deg": 48.35, "lon_deg": 11.78, "height_m": 460.0}
TRUE_LAT, TRUE_LON, HEIGHT_M = 48.9, 12.7, 10_500.0


def plot(**changes: float) -> dict[str, float]:
    """What a perfect radar at the site says about the aircraft."""
    rows = frame_rows(*(np.array([v]) for v in SITE.values()))
    slant, azimuth, _ = geodetic_to_radar(rows, np.array([TRUE_LAT]), np.array([TRUE_LON]), np.array([HEIGHT_M]))
    return {"time_s": NOW_S, "range_m": float(slant[0]), "azimuth_deg": float(azimuth[0])} | changes


def test_radar_plot_lies_where_the_aircraft_is():
    placed = place_reports({"radar1": [plot()]}, {"radar1": SITE}, {}, height_m=HEIGHT_M, after_s=0.0)
    assert placed[0]["lat_deg"] == pytest.approx(TRUE_LAT, abs=1e-8)
    assert placed[0]["lon_deg"] == pytest.approx(TRUE_LON, abs=1e-8)


def test_known_errors_are_taken_out():
    perfect = plot()
    raw = plot(
        range_m=perfect["range_m"] * 1.0001 + 80.0, azimuth_deg=perfect["azimuth_deg"] + 0.15, time_s=NOW_S + 0.3
    )
    state = {"range_bias_m": 80.0, "azimuth_bias_deg": 0.15, "time_bias_s": 0.3, "range_gain": 1e-4}
    placed = place_reports({"radar1": [raw]}, {"radar1": SITE}, {"radar1": state}, height_m=HEIGHT_M, after_s=0.0)
    assert placed[0]["lat_deg"] == pytest.approx(TRUE_LAT, abs=1e-8)
    assert placed[0]["time_s"] == pytest.approx(NOW_S)


def test_only_reports_after_the_last_element_wait_in_order_of_time():
    reports = {"adsb": [{"time_s": NOW_S + t, "lat_deg": 48.0, "lon_deg": 11.0} for t in (3.0, -1.0, 1.0)]}
    placed = place_reports(reports, {}, {}, height_m=None, after_s=NOW_S)
    assert [report["time_s"] - NOW_S for report in placed] == [1.0, 3.0]


@pytest.mark.parametrize("sensors", [{}, {"radar1": {"lat_deg": 48.0, "lon_deg": None, "height_m": 1.0}}])
def test_radar_without_a_known_site_is_left_out(sensors):
    assert place_reports({"radar1": [plot()]}, sensors, {}, height_m=HEIGHT_M, after_s=0.0) == []


def test_plot_below_the_slant_range_of_its_height_is_left_out():
    assert place_reports({"radar1": [plot(range_m=100.0)]}, {"radar1": SITE}, {}, height_m=HEIGHT_M, after_s=0.0) == []
