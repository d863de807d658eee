"""Known biases of the radars, taken out of whole files: what a radar reports too much, and what remains uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from aeroskein.events import RegistrationState
from aeroskein.plots import Array, Bools, Plots
from aeroskein.settings import EngineSettings, SensorSettings
from aeroskein.units import wrap_azimuth_deg

__all__ = ["BiasTable", "bias_table", "corrected", "left_over"]

# A radar that nobody registered: its mounting and its range zero are as good as these. [m, deg]
PRIOR_RANGE_SIGMA_M: Final = 300.0
PRIOR_AZIMUTH_SIGMA_DEG: Final = 0.5


@dataclass(slots=True, eq=False)
class BiasTable:
    """Biases by sensor index; zero, and certain, where the sensor is no radar.

    Attributes
    ----------
    bias, sigma : (sensors, 4) float64
        Range, azimuth, time and range gain. [m, deg, s, 1]
    is_radar : (sensors,) bool
        Which sensors are radars.
    """

    bias: Array
    sigma: Array
    is_radar: Bools


def bias_table(engine: EngineSettings, registration: Sequence[RegistrationState]) -> BiasTable:
    """Biases of all sensors from registration states, else from their settings.

    A radar whose own processor applies the registration reports without bias; so does one for which registration is
    switched off, apart from what its settings say.
    """
    states = {state.sensor: state for state in registration}
    rows = [_row(sensor, states.get(sensor.id), engine.registration.enabled) for sensor in engine.sensors]
    return BiasTable(
        np.array([bias for bias, _ in rows]),
        np.array([sigma for _, sigma in rows]),
        np.array([sensor.is_radar for sensor in engine.sensors], dtype=np.bool_),
    )


def _row(sensor: SensorSettings, state: RegistrationState | None, enabled: bool) -> tuple[list[float], list[float]]:
    nothing = [0.0, 0.0, 0.0, 0.0]
    if not sensor.is_radar or sensor.correction == "sensor":
        return nothing, nothing
    if state is not None and state.state != "off":
        bias = [state.range_bias_m, state.azimuth_bias_deg, state.time_bias_s, state.range_gain]
        sigma = [
            state.range_bias_sigma_m, state.azimuth_bias_sigma_deg, state.time_bias_sigma_s, state.range_gain_sigma,
        ]  # fmt: skip
        return bias, sigma
    preset = [sensor.range_bias_m, sensor.azimuth_bias_deg, sensor.time_bias_s, sensor.range_gain]
    prior = [PRIOR_RANGE_SIGMA_M, PRIOR_AZIMUTH_SIGMA_DEG, sensor.time_bias_sigma_s, 0.0]
    return preset, prior if enabled else nothing


def corrected(plots: Plots, table: BiasTable) -> Plots:
    """The reports without the radars' biases: true range = (range - bias) / (1 + gain), azimuth and time minus bias."""
    radar = table.is_radar[plots.sensor]
    bias = table.bias[plots.sensor]
    columns = {f.name: getattr(plots, f.name) for f in fields(plots)}
    columns["range_m"] = np.where(radar, (plots.range_m - bias[:, 0]) / (1.0 + bias[:, 3]), plots.range_m)
    columns["azimuth_deg"] = np.where(radar, wrap_azimuth_deg(plots.azimuth_deg - bias[:, 1]), plots.azimuth_deg)
    columns["time_s"] = np.where(radar, plots.time_s - bias[:, 2], plots.time_s)
    return replace(plots, **columns)


def left_over(plots: Plots, table: BiasTable) -> Array:
    """One sigma of what remains in range, azimuth, time and gain of each report, ``(n, 4)``, for its covariance."""
    sigma = table.sigma[plots.sensor].copy()
    # An uncertain gain is an uncertain range.
    sigma[:, 0] = np.hypot(sigma[:, 0], np.nan_to_num(sigma[:, 3] * plots.range_m))
    return sigma
