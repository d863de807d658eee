"""A track begins with the first report that the following ones bear out."""

import numpy as np
import pytest
from tests.builders import measurements

from aeroskein.beginnings import first_believable
from aeroskein.buffers import ReportBuffers


def rings(off_m: list[float], **columns: object) -> np.ndarray:
    """A flight at 200 m/s to the east seen once a second; ``off_m`` is how far each report is off."""
    n = len(off_m)
    time = np.arange(n, dtype=np.float64)
    values = {"time_s": time, "east_m": 200.0 * time + np.array(off_m), "v_east_mps": 200.0, "v_north_mps": 0.0,
              "velocity_variance": 1.0} | columns  # fmt: skip
    buffers = ReportBuffers(1, 12)
    assert buffers.add(measurements(n, **values), np.full(n, -np.inf)).all()
    return buffers.rows[np.array([0])]


NO_VELOCITY = {"v_east_mps": np.nan, "v_north_mps": np.nan, "velocity_variance": np.nan}


@pytest.mark.parametrize("columns", [{}, NO_VELOCITY])
@pytest.mark.parametrize(
    ("off_m", "begins"),
    [
        ([0.0, 5.0, -5.0, 10.0], 0),
        ([30_000.0, 0.0, 5.0, -5.0], 1),
        ([30_000.0, -9_000.0, 0.0, 5.0, -5.0, 3.0], 2),
        ([0.0, 30_000.0, 5.0, -5.0], 0),
        ([0.0], 0),
        ([0.0, 30_000.0], 0),
    ],
)
def test_the_first_report_that_half_of_the_others_agree_with(
    off_m: list[float], begins: int, columns: dict[str, float]
) -> None:
    assert first_believable(rings(off_m, **columns)).tolist() == [begins]


def test_order_of_arrival_does_not_matter() -> None:
    rows = rings([30_000.0, 0.0, 5.0, -5.0])
    turned = rows[:, ::-1].copy()

    assert rows[0, first_believable(rows)[0], 0] == turned[0, first_believable(turned)[0], 0] == 1.0


def test_a_turn_is_no_outlier() -> None:
    time = np.arange(8.0)
    angle = np.radians(3.0) * time
    radius = 120.0 / np.radians(3.0)
    rows = rings(
        [0.0] * 8, east_m=radius * np.sin(angle), north_m=radius * (1.0 - np.cos(angle)),
        v_east_mps=120.0 * np.cos(angle), v_north_mps=120.0 * np.sin(angle),
    )  # fmt: skip

    assert first_believable(rows).tolist() == [0]


def test_where_nothing_agrees_the_oldest_report_stands() -> None:
    rows = rings([0.0, 40_000.0, -40_000.0, 90_000.0, -90_000.0, 150_000.0])

    assert first_believable(rows).tolist() == [0]


def test_tracks_are_looked_at_side_by_side() -> None:
    rows = np.concatenate([rings([0.0, 5.0, -5.0]), rings([30_000.0, 0.0, 5.0, -5.0])])

    assert first_believable(rows).tolist() == [0, 1]
