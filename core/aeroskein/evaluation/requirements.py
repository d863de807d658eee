"""Rows of published requirement tables, as this program reads them.

ESASSP is EUROCONTROL-SPEC-0147 (surveillance for 3 and 5 NM separation), ED-142 the EUROCAE specification of wide area
multilateration, taken as a tighter second opinion. Both are read here from secondary sources, row by row, with the
measure that a fused file and a truth allow; a limit that is not certain says so. It is no statement of conformity: the
specifications ask for operational data, their own definitions and an assessor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from aeroskein.evaluation.figures import RequirementRow, Verdict

__all__ = ["COLUMNS", "RULES", "Rule", "rows_of"]

AT_MOST: Final = "<="
AT_LEAST: Final = ">="
MANDATORY: Final = "mandatory"
RECOMMENDED: Final = "recommended"

# Columns of the tables and the update interval that each is assessed at. [s]
COLUMNS: Final = {"3 NM": 5.0, "5 NM": 8.0}


@dataclass(frozen=True, slots=True)
class Rule:
    """One row: what is limited, how, and which measure answers it.

    Attributes
    ----------
    limits : (3 NM, 5 NM), None where the row has no such column. For ED-142: (TMA, en route).
    measure : key of the measures, or "" where a fused file and a truth cannot answer.
    is_sure : whether the limit is known well.
    note : how it is measured, or why it cannot be.
    """

    standard: str
    row: str
    item: str
    level: str
    sense: str
    limits: tuple[float | None, float | None]
    unit: str
    measure: str
    is_sure: bool
    note: str = ""


_ESASSP: Final = "ESASSP"
_ED142: Final = "ED-142"
_NO_TRUTH_CODE: Final = "truth carries no Mode A code"

RULES: Final[tuple[Rule, ...]] = (
    Rule(_ESASSP, "R1", "update interval, median", MANDATORY, AT_MOST, (5.0, 8.0), "s", "interval_s", True),
    Rule(_ESASSP, "R2", "probability of update, lowest flight", MANDATORY, AT_LEAST, (97.0, 97.0), "%",
         "update_lowest", True, "coasted points are no update"),
    Rule(_ESASSP, "R2", "probability of update, all flights", RECOMMENDED, AT_LEAST, (99.0, 99.0), "%",
         "update_all", False, "coasted points are no update"),
    Rule(_ESASSP, "R3", "missed updates in gaps beyond 3.3 intervals", MANDATORY, AT_MOST, (0.5, 0.5), "%",
         "long_gap", True, "horizontal position"),
    Rule(_ESASSP, "R4", "horizontal position, RMS", MANDATORY, AT_MOST, (300.0, 500.0), "m", "rms_m", True),
    Rule(_ESASSP, "R4", "horizontal position, RMS", RECOMMENDED, AT_MOST, (210.0, 350.0), "m", "rms_m", False),
    Rule(_ESASSP, "R5", "points in runs of 3 and more large errors", MANDATORY, AT_MOST, (0.03, 0.03), "%",
         "correlated", True, "large: 555 m and 926 m"),
    Rule(_ESASSP, "R6", "relative time of aircraft within 10 NM, RMS", RECOMMENDED, AT_MOST, (0.3, 0.3), "s",
         "", True, "depends on what the user extrapolates to"),
    Rule(_ESASSP, "R7", "age of forwarded pressure altitude, mean", MANDATORY, AT_MOST, (2.5, 4.0), "s",
         "", True, "points do not say how old their altitude is"),
    Rule(_ESASSP, "R8", "probability of update of correct pressure altitude", MANDATORY, AT_LEAST, (96.0, 96.0), "%",
         "altitude_update", True, "correct: within 300 ft; truth needs altitude_m"),
    Rule(_ESASSP, "R9", "incorrect pressure altitude", MANDATORY, AT_MOST, (0.1, 0.1), "%",
         "altitude_wrong", True, "off by more than 300 ft; truth needs altitude_m"),
    Rule(_ESASSP, "R10", "pressure altitude within 300 ft, level flight", MANDATORY, AT_LEAST, (99.9, 99.9), "%",
         "altitude_level", False, "truth needs altitude_m"),
    Rule(_ESASSP, "R10", "pressure altitude within 300 ft, climb and descent", MANDATORY, AT_LEAST, (98.5, 98.5), "%",
         "altitude_climb", False, "truth needs altitude_m"),
    Rule(_ESASSP, "R11", "delay of an emergency or SPI change", MANDATORY, AT_MOST, (7.5, 12.0), "s",
         "", True, "truth carries no such change"),
    Rule(_ESASSP, "R12", "delay of an identity change", MANDATORY, AT_MOST, (15.0, 24.0), "s",
         "", False, "truth carries no such change"),
    Rule(_ESASSP, "R13", "probability of update of correct aircraft identity", MANDATORY, AT_LEAST, (98.0, 98.0), "%",
         "callsign_update", True, "truth needs callsign"),
    Rule(_ESASSP, "R14", "incorrect aircraft identity", MANDATORY, AT_MOST, (0.1, 0.1), "%",
         "callsign_wrong", True, "truth needs callsign"),
    Rule(_ESASSP, "R15", "rate of climb, level flight, RMS", RECOMMENDED, AT_MOST, (250.0, 250.0), "ft/min",
         "rate_level", True),
    Rule(_ESASSP, "R15", "rate of climb, climb and descent, RMS", RECOMMENDED, AT_MOST, (500.0, 500.0), "ft/min",
         "rate_climb", True),
    Rule(_ESASSP, "R16", "velocity, straight flight, RMS", RECOMMENDED, AT_MOST, (4.0, 4.0), "m/s",
         "velocity_straight", True),
    Rule(_ESASSP, "R16", "velocity, turn, RMS", RECOMMENDED, AT_MOST, (8.0, 8.0), "m/s", "velocity_turn", True),
    Rule(_ESASSP, "R17", "track angle, straight flight, RMS", RECOMMENDED, AT_MOST, (10.0, 10.0), "deg",
         "angle_straight", True, "above 40 kt"),
    Rule(_ESASSP, "R17", "track angle, turn, RMS", RECOMMENDED, AT_MOST, (25.0, 25.0), "deg",
         "angle_turn", True, "above 40 kt"),
    Rule(_ESASSP, "R18", "density of uncorrelated false reports", MANDATORY, AT_MOST, (2.0, 10.0), "per area",
         "", False, "needs the area under surveillance"),
    Rule(_ESASSP, "R19", "falsely confirmed tracks near true ones", MANDATORY, AT_MOST, (1.0, 1.0), "per h",
         "false_per_hour", False, "counts every false track, near or not"),
    Rule(_ESASSP, "R20", "continuity of the service", MANDATORY, AT_MOST, (2.5e-5, 2.5e-5), "per h",
         "", True, "a statement about years of operation"),
    Rule(_ED142, "PD", "probability of position detection, lowest flight", MANDATORY, AT_LEAST, (97.0, 97.0), "%",
         "update_lowest", True, "coasted points are no detection"),
    Rule(_ED142, "gap", "probability of a long gap", MANDATORY, AT_MOST, (0.1, 1.0), "%",
         "ed_gap", False, "gaps beyond 16.5 s (TMA) and 16.4 s (en route), per update interval"),
    Rule(_ED142, "false", "false detection", MANDATORY, AT_MOST, (0.1, 0.1), "%",
         "false_position", True, "error beyond 1690 m (TMA) and 2100 m (en route)"),
    Rule(_ED142, "address", "probability of a correct 24-bit address", MANDATORY, AT_LEAST, (99.0, 99.0), "%",
         "address_update", True, "per update interval"),
    Rule(_ED142, "address", "false 24-bit address", MANDATORY, AT_MOST, (0.1, 0.1), "%", "address_wrong", True),
    Rule(_ED142, "Mode A", "probability of a correct Mode 3/A code", MANDATORY, AT_LEAST, (98.0, 98.0), "%",
         "", True, _NO_TRUTH_CODE),
    Rule(_ED142, "Mode C", "probability of a correct Mode C code", MANDATORY, AT_LEAST, (96.0, 96.0), "%",
         "altitude_update", True, "correct: within 300 ft; truth needs altitude_m"),
    Rule(_ED142, "RMS", "horizontal position, RMS", MANDATORY, AT_MOST, (150.0, 350.0), "m", "rms_m", True),
)  # fmt: skip

_ED142_COLUMNS: Final = {"3 NM": "TMA", "5 NM": "en route"}


def rows_of(measures: dict[str, dict[str, float | None]]) -> tuple[RequirementRow, ...]:
    """Hold measures against every rule.

    Parameters
    ----------
    measures : dict
        ``measures[column][key]``, for the columns of ``COLUMNS``; None or absent where it could not be measured.

    Returns
    -------
    tuple of RequirementRow
        Every rule once per column, in the order of ``RULES``.
    """
    rows = []
    for rule in RULES:
        for column, limit in zip(COLUMNS, rule.limits, strict=True):
            measured = measures[column].get(rule.measure) if rule.measure else None
            rows.append(
                RequirementRow(
                    standard=rule.standard,
                    row=rule.row,
                    column=_ED142_COLUMNS[column] if rule.standard == _ED142 else column,
                    item=rule.item,
                    level=rule.level,
                    sense=rule.sense,
                    limit=limit,
                    unit=rule.unit,
                    limit_is_sure=rule.is_sure,
                    measured=measured,
                    verdict=_verdict(rule.sense, limit, measured),
                    note=rule.note,
                )
            )
    return tuple(rows)


def _verdict(sense: str, limit: float | None, measured: float | None) -> Verdict:
    if measured is None or limit is None:
        return Verdict.NOT_MEASURABLE
    is_met = measured <= limit if sense == AT_MOST else measured >= limit
    return Verdict.MET if is_met else Verdict.NOT_MET
