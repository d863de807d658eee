"""Why a report was not used: the closed list of rejection reasons, as numbers in columns and names on the wire."""

from enum import IntEnum

__all__ = ["Reason"]


class Reason(IntEnum):
    """What became of a report. ``ACCEPTED`` is zero, so a column of reasons is false where accepted."""

    ACCEPTED = 0
    MALFORMED = 1
    BAD_VALUE = 2
    BAD_ADDRESS = 3
    NO_POSITION = 4
    TOO_OLD = 5
    FUTURE = 6
    LATE = 7
    DUPLICATE = 8
    STALE = 9
    DUPLICATE_BATCH = 10
    IMPLAUSIBLE = 11
    OUTSIDE_BOUNDARY = 12
    OUTLIER = 13
    SENSOR_OFF = 14
    UNASSOCIATED = 15
    OVERLOAD = 16
    BAD_ENCODING = 17
    BAD_VERSION = 18
    WRONG_SENSOR = 19
    TOO_MANY_REPORTS = 20
    BAD_CALLSIGN = 21
    BAD_MODE_A = 22

    @property
    def wire_name(self) -> str:
        """The name used in messages: lower case with underscores."""
        return self.name.lower()
