"""What integrity is shown, and when."""

from __future__ import annotations

import numpy as np
import pytest
from tests.builders import START_S, Drive, Flight, adsb, radar

from aeroskein.believing import GATHER_S
from aeroskein.integrity import Belief, Looks
from aeroskein.plots import Plots


def flown(tick_s: float, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int, list[Belief]]:
    """Eight aircraft for 20 s; how often integrity was shown plots, how many, and what it believes."""
    shown: list[int] = []
    drive = Drive.of()
    integrity = drive.engine._receiver.believing._integrity
    looks = integrity.looks

    def counted(plots: Looks) -> None:
        shown.append(len(plots.slot))
        looks(plots)

    monkeypatch.setattr(integrity, "looks", counted)
    monkeypatch.setattr("tests.builders.TICK_S", tick_s)
    flights = [Flight(lat_deg=48.0 + 0.1 * k, address=0x400000 + k) for k in range(8)]
    # The radar's plots come a twentieth of a second apart.
    plots = [adsb(f, np.arange(0.5, 20.0)) for f in flights]
    plots += [radar(f, np.arange(1.0 + 0.05 * k, 20.0, 4.0)) for k, f in enumerate(flights)]
    drive.feed(Plots.concatenate(plots), until_s=25.0)
    return len(shown), sum(shown), [Belief(b) for b in integrity.belief(np.arange(8)).tolist()]


def test_small_batches_are_shown_to_integrity_together(monkeypatch: pytest.MonkeyPatch) -> None:
    at_once, together = flown(0.25, monkeypatch), flown(0.05, monkeypatch)

    assert together[1:] == at_once[1:] == (40, [Belief.VERIFIED] * 8)
    assert together[0] <= 20


def test_nothing_waits_longer_than_the_next_judgement(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = Drive.of()
    believing = drive.engine._receiver.believing
    monkeypatch.setattr("tests.builders.TICK_S", 0.05)
    drive.feed(adsb(Flight(), np.append(np.arange(0.5, 10.0), 9.6)))
    assert believing._own
    assert drive.now_s - believing._shown_s < GATHER_S

    believing.check(START_S + 11.0)

    assert not believing._own
