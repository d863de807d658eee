"""What can be set in the ADS-B filter: every threshold of the published method, with its unit and its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from aeroskein.errors import SettingsError

__all__ = ["AdsbFilterSettings", "Model"]

Model = Literal["linear", "ukf", "imm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AdsbFilterSettings:
    """The published ADS-B filter."""

    projection: Literal["local", "lambert"] = "local"
    """Plane of each flight: local (exact tangent plane) or lambert (as published)."""
    indicators: Literal["innovation", "published"] = "innovation"
    """How bad positions are found: innovation (by their statistical distance to the prediction) or published (limits on
    differences between neighbours, and interpolation, before the filter)."""
    use_velocity: bool = True
    """Whether reported velocities are measurements too; as published only positions are."""
    split_after_s: float = 120.0
    """A longer gap starts a new flight of the same aircraft; nothing holds it together. [s]"""
    spike_angle_deg: float = 20.0
    """A position is a spike where its track turns back with a smaller angle than this (published: 20). [deg]"""
    spike_leg_m: float = 50.0
    """Shorter legs make no spike: noise of a slow aircraft has every angle; 0 as published. [m]"""
    max_speed_mps: float = 340.0
    """Limit of reported and implied speed (published: 340). [m/s]"""
    max_acceleration_mps2: float = 5.0
    """Limit of acceleration from speeds or from three positions (published: 5). [m/s²]"""
    linear_sigma_mps2: float = 0.5
    """Model linear: change of the acceleration between two reports. [m/s²]"""
    acceleration_sigma_mps2: float = 0.3
    """Models ukf and imm: change of the acceleration along the flight within one second. [m/s²]"""
    yaw_rate_sigma_radps: float = 0.01
    """Models ukf and imm: change of the yaw rate within one second. [rad/s]"""
    start_speed_mps: float | None = None
    """Speed at the start, from statistics of past take-offs; absent: reported, or from two positions. [m/s]"""
    start_acceleration_mps2: float = 0.0
    """Acceleration at the start, from statistics of past take-offs. [m/s²]"""
    gap_s: float = 10.0
    """After a longer interval the predicted covariance is multiplied. [s]"""
    gap_inflation: float = 2.0
    """By this."""
    outlier_sigmas: float = 6.0
    """A position or velocity further from its prediction than this is an outlier and not used."""
    reopen_after: int = 4
    """After this many outliers in a row the next position is believed: the filter is wrong, not the reports."""
    max_mean_correction: float = 3.0
    """Divergence: largest mean distance between result and reports, in sigmas of the reports."""
    max_across_sigmas: float = 8.0
    """Divergence: largest distance of a result across the original track, in sigmas of the reports..."""
    max_across_m: float = 200.0
    """...and never less than this. [m]"""

    def __post_init__(self) -> None:
        for name in ("split_after_s", "max_speed_mps", "max_acceleration_mps2", "linear_sigma_mps2", "gap_s",
                     "acceleration_sigma_mps2", "yaw_rate_sigma_radps", "outlier_sigmas", "max_mean_correction",
                     "max_across_sigmas"):  # fmt: skip
            self._require(name, getattr(self, name) > 0.0, "a number above 0")
        for name in ("spike_leg_m", "max_across_m"):
            self._require(name, getattr(self, name) >= 0.0, "a number of 0 or more")
        self._require("spike_angle_deg", 0.0 <= self.spike_angle_deg <= 180.0, "0 to 180")
        self._require("gap_inflation", self.gap_inflation >= 1.0, "a number of 1 or more")
        self._require("reopen_after", self.reopen_after >= 1, "1 or more")
        self._require("start_speed_mps", self.start_speed_mps is None or self.start_speed_mps >= 0.0, "0 or more")
        self._require("start_acceleration_mps2", True, "a number")

    def _require(self, name: str, condition: bool, expected: str) -> None:
        value = getattr(self, name)
        if not condition or (isinstance(value, float) and not math.isfinite(value)):
            raise SettingsError(f"filter.{name}", f"expected {expected}, got {value}")
