"""docs/messages.md says what the code does: the same names, the same limits, examples that parse."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from tests.wire_samples import adsb_report, batch, decode

from aeroskein.cleaning import LIMITS, QUALITY_LIMITS
from aeroskein.reasons import Reason
from aeroskein_service.keys import Keys
from aeroskein_service.messages import FLAG_NAMES, FusedPoint, RegistrationMessage, Report, ReportBatch
from aeroskein_service.selecting import _READERS

PAGE = (Path(__file__).parents[2] / "docs" / "messages.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """The text below a heading, up to the next heading of its level or above."""
    found = re.search(rf"^(#+) {re.escape(title)}$(.*?)(?=^#{{1,2}} |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, title
    return found.group(2)


def table_names(title: str) -> list[str]:
    """Names in code marks in the first column of all tables of a section."""
    rows = [line.split("|")[1] for line in section(title).splitlines() if line.startswith("| `")]
    return [name for row in rows for name in re.findall(r"`([^`]+)`", row)]


def accepted(name: str) -> str:
    """What a field of a report accepts, as the page says."""
    rows = [line.split("|") for line in section("Target report").splitlines() if line.startswith("|")]
    return next(row[4].strip() for row in rows if f"`{name}`" in row[1])


def test_every_reason_is_on_the_page_and_no_other():
    assert set(table_names("Rejection reasons")) == {reason.wire_name for reason in Reason if reason}


@pytest.mark.parametrize(
    ("title", "message"),
    [("Target report", Report), ("Report batch", ReportBatch), ("Registration state", RegistrationMessage)],
)
def test_every_field_is_on_the_page_and_no_other(title, message):
    assert sorted(table_names(title)) == sorted(message.__struct_fields__)


def test_every_field_and_flag_of_a_fused_point_is_on_the_page_and_no_other():
    assert sorted(table_names("Fused point")) == sorted([*FusedPoint.__struct_fields__, *FLAG_NAMES])


def test_every_query_parameter_is_on_the_page():
    names = {name.partition("=")[0] for name in table_names("Queries")}

    assert set(_READERS) | {"limit"} <= names


@pytest.mark.parametrize("name", ["altitude_m", "ground_speed_mps", "vertical_rate_mps", "lat_deg", "range_m"])
def test_limits_on_the_page_are_those_that_are_checked(name):
    numbers = accepted(name).replace("−", "-").replace(",", "").replace("10⁶", "1000000")
    low, high = (float(number) for number in re.findall(r"-?\d+", numbers)[:2])

    assert (low, high) == LIMITS[name]


@pytest.mark.parametrize("name", list(QUALITY_LIMITS))
def test_highest_category_on_the_page_is_the_one_that_is_checked(name):
    assert accepted(name) == f"0 to {QUALITY_LIMITS[name]}"


def test_every_key_is_on_the_page():
    keys, page = Keys("<prefix>"), section("Keys")

    made = [
        keys.reports("<sensor>"), keys.reports_below("<sensor>"), keys.fused("live", "<track>"),
        keys.fused("element", "<track>"), keys.feed("<product>", "<instance>"), keys.registration("<sensor>"),
        keys.status("<instance>"), keys.dispositions("<sensor>"), keys.alive_fusion("<instance>", "<shard>"),
        keys.alive("<service>", "<instance>"), keys.query("tracks"), keys.query("reports"), keys.query("elements"),
        keys.control("registration", "<sensor>"), keys.control("sensor", "<sensor>"),
    ]  # fmt: skip
    listed = re.findall(r"^(<prefix>\S+)", page, re.MULTILINE)
    assert sorted(listed) == sorted(made)


def test_every_example_is_json():
    examples = re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)

    assert len(examples) > 4
    for example in examples:
        json.loads(example)


@pytest.mark.parametrize("count", [1, 500])
def test_batch_of_the_stated_size_is_taken(count):
    assert len(decode(batch([adsb_report()] * count)).plots) == count
