"""Registration: takes the radars' systematic errors out of plots and estimates them while the picture runs.

The front of this package. Plots go through ``correct``; comparisons with references come back through ``update``.
Methods: ``kalman`` (a joint filter, ``estimator.py``) and ``feedback`` (the published loop, ``feedback.py``). What is
published is what a radar reports too much: true range = (range - bias) / (1 + gain), true azimuth = azimuth - bias,
true time = time - bias.
"""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np

from aeroskein.errors import SettingsError, SnapshotError
from aeroskein.events import RegistrationState
from aeroskein.geodesy import frame_rows
from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import RAD_PER_DEG, Comparisons, geometry_of
from aeroskein.registration.estimator import KalmanEstimator, preset_of, prior_sigma_of
from aeroskein.registration.feedback import FeedbackEstimator
from aeroskein.registration.handover import Handover
from aeroskein.registration.rows import Noise, anchored_rows, bias_jacobian, usable
from aeroskein.settings import EngineSettings
from aeroskein.units import wrap_azimuth_deg

__all__ = ["Registration"]

# Converged when the bias is known to this share of the radar's own noise, or as well as this, whichever is easier.
SHARE_OF_NOISE: Final = 0.3
RANGE_SIGMA_MIN_M: Final = 5.0
AZIMUTH_SIGMA_MIN_DEG: Final = 0.01
TIME_SIGMA_S: Final = 0.12
# Once converged it takes this much more to fall back.
HYSTERESIS: Final = 1.5
# Without a comparison for this long a radar is not being registered: its state is frozen. [s]
SILENT_S: Final = 120.0
# Sigmas of values that an operator sets: range m, azimuth deg, time s, gain.
SET_SIGMA: Final = np.array([10.0, 0.01, 0.05, 0.0])
# Slower flight says nothing of a latency. [m/s]
LATENCY_SPEED_MIN_MPS: Final = 40.0
VERSION: Final = 1
_NAMES: Final = ("range_bias_m", "azimuth_bias_deg", "time_bias_s", "range_gain")
_SIGMA_NAMES: Final = ("range_bias_sigma_m", "azimuth_bias_sigma_deg", "time_bias_sigma_s", "range_gain_sigma")


class Registration:
    """State of all radars' registration.

    Parameters
    ----------
    settings : EngineSettings
        Sensors and the section ``registration``.
    """

    def __init__(self, settings: EngineSettings) -> None:
        self._settings = settings
        sensors = settings.sensors
        self.radars: Bools = np.array([s.is_radar for s in sensors])
        self.sites = np.zeros((len(sensors), 12))
        for k in np.flatnonzero(self.radars):
            s = sensors[k]
            # SettingsError is raised for a radar without its site.
            assert s.lat_deg is not None
            assert s.lon_deg is not None
            assert s.height_m is not None
            self.sites[k] = frame_rows(np.array([s.lat_deg]), np.array([s.lon_deg]), s.height_m)[0]
        self._preset, self._prior = preset_of(settings), prior_sigma_of(settings)
        by_sensor = np.array([s.is_radar and s.correction == "sensor" for s in sensors])
        self._handover = Handover(by_sensor, self._preset)
        feedback = settings.registration.method == "feedback"
        made = FeedbackEstimator(settings, self.sites) if feedback else KalmanEstimator(settings, self.sites)
        self._estimator: KalmanEstimator | FeedbackEstimator = made
        for k in np.flatnonzero(by_sensor):
            # What the radar applies from its configuration is no longer in its plots.
            self._estimator.restart(int(k), np.zeros(4), self._prior[k])
        self._noise = Noise.of(settings)
        noise = np.array([[s.range_sigma_m, s.azimuth_sigma_deg] for s in sensors])
        floor = np.array([RANGE_SIGMA_MIN_M, AZIMUTH_SIGMA_MIN_DEG])
        self._good = np.c_[np.maximum(SHARE_OF_NOISE * noise, floor), np.full(len(sensors), TIME_SIGMA_S)]
        self._converged = np.zeros(len(sensors), dtype=np.bool_)
        self._refresh()

    # -- correcting plots ----------------------------------------------------------------------------------------
    def correct(self, sensor: Ints, range_m: Array, azimuth_deg: Array, time_s: Array) -> tuple[Array, Array, Array]:
        """Take the present biases out of plots, ``(n,)`` each.

        Rows of sensors that are no radars, or that correct themselves, pass unchanged.

        Returns
        -------
        range_m, azimuth_deg, time_s : (n,) arrays
            Corrected; 0 <= azimuth < 360. [m, deg, s since the epoch]
        """
        bias = self._correction[sensor]
        return (
            (range_m - bias[:, 0]) / (1.0 + bias[:, 3]),
            wrap_azimuth_deg(azimuth_deg - bias[:, 1]),
            time_s - bias[:, 2],
        )

    def table(self) -> tuple[Array, Array, Bools]:
        """What is in force now, by sensor: corrections ``(sensors, 4)``, sigmas left ``(sensors, 4)``, uncertain."""
        every = np.arange(len(self.radars))
        return self._correction.copy(), self.bias_sigmas(every), self._uncertain.copy()

    def bias_sigmas(self, sensor: Ints) -> Array:
        """One sigma of ``[range m, azimuth deg, time s, gain]`` left after correction, ``(n, 4)``."""
        return np.sqrt(np.diagonal(self._left_over[sensor], axis1=1, axis2=2))

    def uncertain(self, sensor: Ints) -> Bools:
        """Which rows come from a radar whose registration has not converged, ``(n,)``."""
        return self._uncertain[sensor]

    def bias_covariance(
        self, sensor: Ints, range_m: Array, ground_m: Array, azimuth_deg: Array, v_east_mps: Array, v_north_mps: Array
    ) -> Array:
        """What the uncertainty of the biases adds to the covariance of plots.

        Parameters
        ----------
        sensor : (n,) int64
            Sensor of each plot.
        range_m, ground_m, azimuth_deg : (n,) array
            Slant range, ground range and azimuth from the radar. [m, m, deg]
        v_east_mps, v_north_mps : (n,) array
            Velocity, for the time bias; NaN counts as 0. [m/s]

        Returns
        -------
        (n, 3) array
            ``[ee, en, nn]`` in the radar's east and north; zero where the sensor is no radar. [m²]
        """
        n = len(sensor)
        sin, cos = np.sin(azimuth_deg * RAD_PER_DEG), np.cos(azimuth_deg * RAD_PER_DEG)
        v_e, v_n = np.nan_to_num(v_east_mps), np.nan_to_num(v_north_mps)
        radial, across = v_e * sin + v_n * cos, v_e * cos - v_n * sin
        polar = bias_jacobian(range_m, ground_m, radial, across)
        axes = np.empty((n, 2, 2))
        axes[:, 0, 0], axes[:, 1, 0] = sin, cos
        axes[:, 0, 1], axes[:, 1, 1] = cos, -sin
        of_bias = axes @ polar
        plane = of_bias @ self._left_over[sensor] @ of_bias.swapaxes(1, 2)
        return np.where(self.radars[sensor, None], plane[:, [0, 0, 1], [0, 1, 1]], 0.0)

    # -- estimating ----------------------------------------------------------------------------------------------
    def update(self, rows: Comparisons) -> None:
        """Learn from comparisons; rows of sensors that are no radars are left out."""
        if not self._settings.registration.enabled or len(rows) == 0:
            return
        keep = self.radars[rows.sensor] & self._handover.usable(rows.sensor, rows.time_s)
        if keep.any() and self._estimator.add(rows if keep.all() else rows.take(keep)):
            self._refresh()

    def lateness(self, rows: Comparisons) -> tuple[Array, Array, Array]:
        """What plots of converged radars say of the latency of the aircraft's ADS-B.

        A radar sees the aircraft where it is and ADS-B where it was, so the plot lies ``v l`` ahead of the reference;
        what the radar's bias makes of it is taken out.

        Parameters
        ----------
        rows : Comparisons
            Their references must stand on the stamps of ADS-B as reported.

        Returns
        -------
        late_s, noise_s2, floor_s2 : (n,) arrays
            Latency, variance of its noise, and of what is not known of the bias; NaN where a plot says nothing.
            [s, s², s²]
        """
        found = np.full((3, len(rows)), np.nan)
        good = rows.anchored & ~self._uncertain[rows.sensor]
        if not good.any():
            return found[0], found[1], found[2]
        geometry = geometry_of(rows, self.sites)
        good &= usable(rows, geometry)
        at = np.flatnonzero(good & (np.hypot(geometry.radial_mps, geometry.across_mps) > LATENCY_SPEED_MIN_MPS))
        if len(at):
            rows = rows.take(at)
            seen = anchored_rows(rows, geometry.take(at), self._noise)
            velocity = seen.of_aircraft[:, :, 0]
            error = seen.error_m - np.einsum("nij,nj->ni", seen.of_sensor, self._correction[rows.sensor])
            weight = np.linalg.solve(seen.covariance_m2, velocity[:, :, None])[:, :, 0]
            information = np.einsum("ni,ni->n", weight, velocity)
            of_bias = np.einsum("ni,nij->nj", weight, seen.of_sensor)
            found[0, at] = np.einsum("ni,ni->n", weight, error) / information
            found[1, at] = 1.0 / information
            left = np.einsum("ni,nij,nj->n", of_bias, self._left_over[rows.sensor], of_bias)
            found[2, at] = left / information**2
        return found[0], found[1], found[2]

    def advance(self, *, now_s: float) -> None:
        """Let time pass: uncertainty grows, and radars that correct themselves get a new value when it is due."""
        if not self._settings.registration.enabled:
            return
        self._estimator.advance(now_s)
        rest, sigma = self._estimator.means(), self._sigmas(self._estimator.covariances())
        for k in self._handover.due(now_s, rest, sigma, self._converged):
            self._estimator.adjust(int(k), *self._handover.hand_over(int(k), rest[k], now_s))
        self._refresh()

    def states(self, now_s: float) -> list[RegistrationState]:
        """State of every radar, in the order of the settings."""
        mean = self._published()
        sigma = self._sigmas(self._estimator.covariances())
        samples, aircraft = self._estimator.counts()
        return [
            RegistrationState(
                sensor=self._settings.sensors[k].id,
                time_s=now_s,
                state=self._state_name(int(k), now_s),
                **dict(zip(_NAMES, mean[k].tolist(), strict=True)),
                **dict(zip(_SIGMA_NAMES, sigma[k].tolist(), strict=True)),
                samples=int(samples[k]),
                aircraft=int(aircraft[k]),
            )
            for k in np.flatnonzero(self.radars)
        ]

    def estimates(self) -> tuple[Array, Array]:
        """Published means ``(sensors, 4)`` and covariances ``(sensors, 4, 4)`` of range, azimuth, time and gain."""
        return self._published(), self._estimator.covariances()

    def alarms(self) -> list[str]:
        """What an operator should know, one sentence each."""
        ids = [s.id for s in self._settings.sensors]
        return [f"{ids[k]} does not apply the registration it is sent" for k in np.flatnonzero(self._handover.ignored)]

    def jumps(self) -> Ints:
        """Jumps of each sensor's biases found so far, ``(sensors,)``."""
        return self._estimator.jumps()

    # -- control -------------------------------------------------------------------------------------------------
    def control(
        self, sensor_id: str, action: Literal["freeze", "release", "reset", "set"], *, now_s: float, **values: float
    ) -> RegistrationState:
        """Freeze, release, reset or set one radar's biases; returns what is now in force.

        Parameters
        ----------
        sensor_id : str
            A radar.
        action : str
            ``freeze``: hold the mean. ``release``: estimate again. ``reset``: back to the configured values.
            ``set``: take ``values`` (names as in ``RegistrationState``; what is not named stays) and go on from there.

        Raises
        ------
        UnknownSensorError
            No such sensor.
        SettingsError
            The sensor is no radar, or a value has an unknown name or is not finite.
        """
        k = self._settings.sensor_index(sensor_id)
        if not self.radars[k]:
            raise SettingsError(f"sensors.{sensor_id}", "only a radar has a registration")
        if action in ("freeze", "release"):
            self._estimator.hold(k, action == "freeze")
        elif action == "reset":
            self._begin(k, self._preset[k], self._prior[k])
        else:
            mean = self._published()[k]
            for name, value in values.items():
                if name not in _NAMES or not np.isfinite(value):
                    raise SettingsError(f"registration.{name}", f"expected a finite {' or '.join(_NAMES)}")
                mean[_NAMES.index(name)] = value
            self._begin(k, mean, np.minimum(SET_SIGMA, self._prior[k]))
        self._refresh()
        return next(s for s in self.states(now_s) if s.sensor == sensor_id)

    def _begin(self, k: int, mean: Array, sigma: Array) -> None:
        self._handover.restart(k, mean)
        own = self._handover.by_sensor[k]
        self._estimator.restart(k, np.zeros(4) if own else mean, sigma)
        self._converged[k] = False

    # -- state that survives a restart ---------------------------------------------------------------------------
    def snapshot(self) -> dict[str, Any]:
        """Plain content (lists, numbers, strings) from which ``restore`` goes on."""
        return {
            "version": VERSION,
            "method": self._settings.registration.method,
            "sensors": [s.id for s in self._settings.sensors],
            "converged": self._converged.tolist(),
            "handover": self._handover.export(),
            "estimator": self._estimator.export(),
        }

    def restore(self, content: dict[str, Any]) -> None:
        """Take a snapshot over; radars that are no longer configured are left out, a changed method begins anew.

        Raises
        ------
        SnapshotError
            The content is not a snapshot that this version can read.
        """
        try:
            if content["version"] != VERSION:
                raise SnapshotError(f"registration snapshot of version {content['version']!r}, expected {VERSION}")
            if content["method"] != self._settings.registration.method:
                return
            ids = [s.id for s in self._settings.sensors]
            same = {
                old: ids.index(name)
                for old, name in enumerate(content["sensors"])
                if name in ids and self.radars[ids.index(name)]
            }
            old, new = np.array(list(same), dtype=np.int64), np.array(list(same.values()), dtype=np.int64)
            self._estimator.load(content["estimator"], same)
            self._handover.load(content["handover"], old, new)
            self._converged[new] = np.array(content["converged"], dtype=np.bool_)[old]
        except (KeyError, TypeError, ValueError, IndexError) as error:
            if isinstance(error, SnapshotError):
                raise
            raise SnapshotError(f"registration snapshot cannot be read: {error!r}") from error
        self._refresh()

    # -- inside --------------------------------------------------------------------------------------------------
    def _published(self) -> Array:
        """What the radars report too much, ``(sensors, 4)``: all of it, where they correct themselves too."""
        mean = self._estimator.means()
        known = self._handover.by_sensor & ~self._handover.ignored
        return np.where(known[:, None], self._handover.applied, mean + self._handover.applied)

    def _refresh(self) -> None:
        mean, own = self._estimator.means(), self._estimator.covariances()
        relative = self._estimator.relative_covariances()
        by_sensor = self._handover.by_sensor
        self._correction = np.where((self.radars & ~by_sensor)[:, None], mean, 0.0)
        sigma = self._sigmas(relative)[:, :3]
        limit = self._good * np.where(self._converged, HYSTERESIS, 1.0)[:, None]
        self._converged = (sigma <= limit).all(axis=1) & self.radars
        if not self._settings.registration.enabled:
            # The operator vouches for the configured values.
            self._left_over = np.zeros_like(own)
            self._uncertain = np.zeros(len(self.radars), dtype=np.bool_)
            return
        self._left_over = relative
        # What a radar should take out but has not yet is still in its plots.
        rest = np.where(by_sensor[:, None], mean, 0.0)
        self._left_over = self._left_over + rest[:, :, None] * rest[:, None, :]
        self._uncertain = self.radars & ~self._converged

    def _sigmas(self, covariance: Array) -> Array:
        return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))

    def _state_name(self, k: int, now_s: float) -> str:
        if not self._settings.registration.enabled:
            return "off"
        last_s = self._estimator.last_s()[k]
        silent = np.isfinite(last_s) and now_s - last_s > SILENT_S
        if self._estimator.held()[k] or silent:
            return "frozen"
        return "converged" if self._converged[k] else "converging"
