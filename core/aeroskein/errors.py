"""The errors of the core: one small tree, each naming what was wrong and keeping it as an attribute.

    AeroskeinError
    ├── SettingsError (ValueError)     a setting that cannot work; raised before anything runs
    ├── UnknownSensorError (KeyError)  a sensor id that is not configured
    └── SnapshotError (ValueError)     a snapshot that this version cannot read

Bad *data* never raises: it comes back as a rejection with a reason (``reasons.py``).
"""


class AeroskeinError(Exception):
    """Base of all errors raised on purpose."""


class SettingsError(AeroskeinError, ValueError):
    """A setting that cannot work.

    Parameters
    ----------
    key : str
        Path of the setting as the configuration file spells it.
    expected : str
        What would have been accepted.
    """

    def __init__(self, key: str, expected: str) -> None:
        super().__init__(f"{key}: {expected}")
        self.key = key
        self.expected = expected


class UnknownSensorError(AeroskeinError, KeyError):
    """A sensor id that the configuration does not contain."""

    def __init__(self, sensor_id: str) -> None:
        super().__init__(sensor_id)
        self.sensor_id = sensor_id

    def __str__(self) -> str:
        return f"no sensor {self.sensor_id!r} in the configuration"


class SnapshotError(AeroskeinError, ValueError):
    """A snapshot that this version cannot read."""
