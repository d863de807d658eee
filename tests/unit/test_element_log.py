"""The element log: twenty elements of every track, long or short, and nothing beyond them."""

from itertools import pairwise

import numpy as np
from tests.builders import RADAR2, Drive, Flight, adsb, engine_settings, radar

from aeroskein.element_log import KEEP

SECONDS = 200.0


def test_twenty_elements_of_every_track_are_kept_whether_they_are_short_or_long() -> None:
    fast, slow = Flight(), Flight(lat_deg=48.3, lon_deg=11.9, address=0x400001)
    drive = Drive.of(engine_settings(*engine_settings().sensors, RADAR2))
    drive.feed(
        [
            adsb(fast, np.arange(0.5, SECONDS), sigma_m=5.0),
            radar(slow, np.arange(1.0, SECONDS, 8.0), RADAR2, sensor=2, range_sigma_m=50.0),
        ]
    )

    log = drive.engine._state.element_log
    for flight, length_s in ((fast, 4.0), (slow, 8.0)):
        records = drive.engine.elements(f"{flight.address:06X}")
        assert records is not None
        spans = [record.content["span_s"] for record in records]
        assert len(spans) == KEEP
        assert all(end - start == length_s for start, end in spans)
        assert all(one[1] == following[0] for one, following in pairwise(spans))
        assert all(record.content["reports"] for record in records)
    kept = np.concatenate([p.elements["number"] for p in log._passes])
    # One more of each may wait for the next pass to be forgotten.
    assert np.bincount(kept)[1:].max() <= KEEP + 2
