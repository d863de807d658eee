"""Configuration layers, strictness, and one sentence for whatever is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from aeroskein_service.config import Config, ConfigError, load_config

SENSORS = """
[[sensors]]
id = "adsb"
kind = "adsb"

[[sensors]]
id = "radar-1"
kind = "ssr"
lat_deg = 48.35
lon_deg = 11.78
height_m = 460.0
"""


def load(tmp_path: Path, text: str = SENSORS, env: dict[str, str] | None = None, **arguments: object) -> Config:
    path = tmp_path / "fusion.toml"
    path.write_text(text, encoding="utf-8")
    return load_config(path, environ=env or {}, **arguments)


def complaint(tmp_path: Path, text: str, env: dict[str, str] | None = None, **arguments: object) -> str:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text, env, **arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# -- layers --------------------------------------------------------------------------------------------------------
def test_everything_but_the_sensors_has_a_default(tmp_path):
    config = load(tmp_path)

    assert (config.fusion.mode, config.zenoh.prefix, config.output.encoding) == ("information", "atc/v1", "msgpack")
    assert config.origin("fusion", "mode") == "default"


def test_file_wins_over_the_default(tmp_path):
    config = load(tmp_path, SENSORS + "[fusion]\nmode = 'weighted'\n")

    assert config.fusion.mode == "weighted"
    assert config.origin("fusion", "mode") == f"file {tmp_path / 'fusion.toml'}"


def test_environment_wins_over_the_file(tmp_path):
    config = load(tmp_path, SENSORS + "[fusion]\nmode = 'weighted'\n", {"AEROSKEIN_FUSION__MODE": "patent"})

    assert config.fusion.mode == "patent"
    assert config.origin("fusion", "mode") == "environment AEROSKEIN_FUSION__MODE"


def test_command_line_wins_over_the_environment(tmp_path):
    config = load(
        tmp_path,
        env={"AEROSKEIN_FUSION__MODE": "patent"},
        overrides={"fusion.mode": "weighted", "fusion.lookahead": None},
    )

    assert config.fusion.mode == "weighted"
    assert config.origin("fusion", "mode") == "command line"
    assert config.origin("fusion", "lookahead") == "default"


@pytest.mark.parametrize(
    ("name", "text", "path", "value"),
    [
        ("AEROSKEIN_FUSION__ELEMENT_S", "8", ("fusion", "element_s"), 8.0),
        ("AEROSKEIN_FUSION__LIVE", "false", ("fusion", "live"), False),
        ("AEROSKEIN_TRACKS__CAPACITY", "2048", ("tracks", "capacity"), 2048),
        ("AEROSKEIN_SERVICE__INSTANCE", "7", ("service", "instance"), "7"),
        ("AEROSKEIN_ZENOH__CONNECT", '["tcp/a:1", "tcp/b:2"]', ("zenoh", "connect"), ("tcp/a:1", "tcp/b:2")),
        ("AEROSKEIN_ZENOH__CONNECT", "tcp/a:1, tcp/b:2", ("zenoh", "connect"), ("tcp/a:1", "tcp/b:2")),
        ("AEROSKEIN_SIMULATION__RADIUS_M", "50000", ("simulation", "radius_m"), 50_000.0),
    ],
)
def test_text_in_the_environment_becomes_the_type_of_its_key(tmp_path, name, text, path, value):
    config = load(tmp_path, env={name: text})

    section, key = path
    assert getattr(getattr(config, section), key) == value


@pytest.mark.parametrize(
    "name", ["AEROSKEIN_SENSORS__RADAR_1__RANGE_BIAS_M", "AEROSKEIN_SENSORS__radar-1__RANGE_BIAS_M"]
)
def test_environment_changes_one_value_of_one_sensor_by_its_id(tmp_path, name):
    config = load(tmp_path, env={name: "80"})

    assert [sensor.range_bias_m for sensor in config.sensors] == [0.0, 80.0]
    assert config.origin("sensors", 1, "range_bias_m") == f"environment {name}"


def test_variables_without_the_double_underscore_are_not_ours(tmp_path):
    config = load(tmp_path, env={"AEROSKEIN_PORT": "tcp://10.0.0.1:80", "AEROSKEIN_SERVICE_HOST": "x", "PATH": "/bin"})

    assert config.fusion.mode == "information"


def test_fingerprint_tells_configurations_apart_but_keeps_the_password(tmp_path):
    plain = load(tmp_path).fingerprint()

    assert load(tmp_path, env={"AEROSKEIN_FUSION__MODE": "patent"}).fingerprint() != plain
    assert load(tmp_path, env={"AEROSKEIN_ZENOH__PASSWORD": "secret"}).fingerprint() == plain


def test_password_does_not_show_when_the_configuration_is_printed(tmp_path):
    assert "secret" not in repr(load(tmp_path, env={"AEROSKEIN_ZENOH__PASSWORD": "secret"}))


def test_sensors_keep_their_order_and_give_the_engine_its_settings(tmp_path):
    config = load(tmp_path)

    assert config.sensor_ids == ("adsb", "radar-1")
    assert config.engine.sensors == config.sensors


def test_program_that_needs_no_sensors_may_have_none(tmp_path):
    assert load(tmp_path, "", sensors_required=False).sensors == ()


# -- what is wrong -------------------------------------------------------------------------------------------------
WRONG = {
    "misspelt key": ("[fusion]\nmdoe = 'patent'", "fusion.mdoe: unknown key, did you mean fusion.mode?"),
    "key of another section": ("[fusion]\nhalf_width_m = 1", "did you mean patent.half_width_m?"),
    "misspelt section": ("[fusoin]\nmode = 'patent'", "fusoin: unknown key, did you mean fusion?"),
    "key like no other": ("[output]\nzzz = 1", "output.zzz: unknown key, expected one of encoding"),
    "text for a number": ("[fusion]\nelement_s = '4'", "fusion.element_s: expected a number, got '4'"),
    "truth for a number": ("[fusion]\nelement_s = true", "fusion.element_s: expected a number, got true"),
    "fraction for an integer": ("[fusion]\nlookahead = 1.5", "fusion.lookahead: expected an integer, got 1.5"),
    "number for a truth": ("[fusion]\nlive = 1", "fusion.live: expected true or false, got 1"),
    "number for a text": ("[area]\nname = 3", "area.name: expected a text in quotes, got 3"),
    "date for a text": ("[area]\nname = 2026-01-01", "area.name: expected a text in quotes, got a date or time"),
    "text for a list": ("[zenoh]\nconnect = 'tcp/a:1'", "zenoh.connect: expected a list, got 'tcp/a:1'"),
    "number in a list": ("[zenoh]\nconnect = [1]", "zenoh.connect[0]: expected a text in quotes, got 1"),
    "word out of a set": ("[fusion]\nmode = 'best'", "expected 'information', 'weighted' or 'patent', got 'best'"),
    "impossible value": ("[fusion]\nelement_s = 99", "fusion.element_s: expected 0.5 to 30 s, got 99"),
    "not a number": ("[fusion]\nelement_s = nan", "fusion.element_s: expected 0.5 to 30 s"),
    "infinite": ("[patent]\nhalf_width_m = inf", "patent.half_width_m: expected a number above 0"),
    "no endpoint": ("[zenoh]\nconnect = ['here']", "zenoh.connect: 'here' is no endpoint"),
    "no endpoints": ("[zenoh]\nconnect = []", "zenoh.connect: expected at least one endpoint"),
    "prefix with a wildcard": ("[zenoh]\nprefix = 'atc/*'", "zenoh.prefix: expected key chunks"),
    "certificate without key": ("[zenoh]\ntls_certificate = 'x'", "zenoh.tls_certificate"),
    "missing certificate": ("[zenoh]\ntls_root_ca = '/nowhere/ca.pem'", "zenoh.tls_root_ca: no such file"),
    "instance with a slash": ("[service]\ninstance = 'a/b'", "service.instance: expected one key chunk"),
    "address without a port": ("[http]\nlisten = 'localhost'", "http.listen: expected host:port"),
    "port out of range": ("[http]\nlisten = 'localhost:99999'", "http.listen: expected host:port"),
    "sensor twice": ("[[sensors]]\nid = 'adsb'\nkind = 'adsb'", "sensors.id: sensor 'adsb' stands twice"),
    "sensor without kind": ("[[sensors]]\nid = 'x'", "sensors.x.kind: missing"),
    "sensor without id": ("[[sensors]]\nkind = 'adsb'", "sensors[2].id: missing"),
    "bad sensor id": ("[[sensors]]\nid = 'A b'\nkind = 'adsb'", "sensors.id: expected 1 to 32 of a-z 0-9 - _"),
    "radar without a site": ("[[sensors]]\nid = 'x'\nkind = 'psr'", "sensors.x.lat_deg: a radar needs its site"),
    "wrong value of a sensor": ("[[sensors]]\nid = 'x'\nkind = 'adsb'\nperiod_s = 'x'", "sensors.x.period_s: expected"),
    "errors of nobody": ("[[simulation.errors]]\nsensor = 'x'", "simulation.errors: no sensor 'x'"),
    "wrong error": ("[[simulation.errors]]\nsensor = 'adsb'\nlatency_s = 'x'", "errors.adsb.latency_s: expected"),
    "matrix of a wrong shape": ("[association]\npairwise = [[1.0]]", "association.pairwise: expected 4 rows"),
    "matrix that contradicts itself": (
        "[association]\npairwise = [[1,2,2,2],[2,1,2,2],[2,2,1,2],[2,2,2,1]]",
        "association.pairwise: expected u_ji"
    ),
    "comparisons in a circle": (
        "[association]\npairwise = [[1,9,0.111111,1],[0.111111,1,9,1],[9,0.111111,1,1],[1,1,1,1]]",
        "association.pairwise: ",
    ),
    "section that is a value": ("[area]\n[fusion.mode]", "fusion.mode: expected"),
    "no TOML": ("[fusion", "is not valid TOML"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(WRONG))
def test_fault_is_named_in_one_sentence_with_its_file(tmp_path, name):
    text, expected = WRONG[name]

    said = complaint(tmp_path, SENSORS + text + "\n")

    assert expected in said
    assert str(tmp_path / "fusion.toml") in said


def test_section_that_is_a_number_is_named(tmp_path):
    assert "fusion: expected a table, got 3" in complaint(tmp_path, "fusion = 3\n" + SENSORS)


def test_further_faults_are_counted(tmp_path):
    said = complaint(tmp_path, SENSORS + "[fusion]\nelement_s = 'x'\nlookahead = 'y'\nlive = 'z'\n")

    assert said.endswith("; 2 more after this")


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("AEROSKEIN_FUSION__MDOE", "patent", "fusion.mdoe: unknown key, did you mean fusion.mode?"),
        ("AEROSKEIN_FUSOIN__MODE", "patent", "did you mean"),
        ("AEROSKEIN_FUSION__ELEMENT_S", "long", "fusion.element_s: expected a number, got 'long'"),
        ("AEROSKEIN_FUSION__ELEMENT_S", "99", "fusion.element_s: expected 0.5 to 30 s, got 99"),
        ("AEROSKEIN_FUSION__MODE", "", "fusion.mode: expected 'information'"),
        ("AEROSKEIN_SENSORS__RADAR9__PERIOD_S", "4", "sensors.radar9: no sensor of this id"),
        ("AEROSKEIN_SENSORS__RADAR_1__PERIODS", "4", "did you mean sensors.period_s?"),
        ("AEROSKEIN_ZENOH__CONNECT", '["tcp/a:1"', "zenoh.connect: expected a list"),
    ],
)
def test_fault_in_the_environment_names_the_variable(tmp_path, name, text, expected):
    said = complaint(tmp_path, SENSORS, {name: text})

    assert expected in said
    assert name in said


def test_fault_on_the_command_line_says_so(tmp_path):
    assert "(in command line)" in complaint(tmp_path, SENSORS, overrides={"fusion.lookahead": 99})


def test_configuration_without_sensors_is_refused_where_they_are_needed(tmp_path):
    assert "at least one sensor is needed" in complaint(tmp_path, "[fusion]\nmode = 'patent'\n")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"no such configuration file: .*nowhere\.toml"):
        load_config(tmp_path / "nowhere.toml", environ={})


def test_file_that_is_a_folder_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot read the configuration file"):
        load_config(tmp_path, environ={})


def test_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")

    with pytest.raises(ConfigError, match="is not UTF-8 text"):
        load_config(tmp_path / "x.toml", environ={})


# -- what the sections make of their values ------------------------------------------------------------------------
def test_link_has_what_the_transport_needs(tmp_path):
    config = load(tmp_path, SENSORS + "[zenoh]\nuser = 'u'\npassword = 'p'\nconnect = ['tls/h:1']\n")

    assert (config.zenoh.link.user, config.zenoh.link.password, config.zenoh.link.connect) == ("u", "p", ("tls/h:1",))


@pytest.mark.parametrize(
    ("listen", "address"), [("127.0.0.1:8080", ("127.0.0.1", 8080)), ("[::1]:0", ("::1", 0)), ("", None)]
)
def test_listening_address_is_host_and_port_or_switched_off(tmp_path, listen, address):
    assert load(tmp_path, SENSORS + f"[http]\nlisten = '{listen}'\n").http.address == address


def test_empty_instance_becomes_host_and_process(tmp_path):
    assert load(tmp_path).service.effective_instance
    assert load(tmp_path, SENSORS + "[service]\ninstance = 'a1'\n").service.effective_instance == "a1"


def test_configuration_cannot_be_changed_once_it_is_loaded(tmp_path):
    config = load(tmp_path)

    with pytest.raises(ValueError, match="frozen"):
        config.fusion = None
    with pytest.raises(AttributeError):
        config.fusion.mode = "patent"


def test_schema_is_json_and_describes_every_key():
    schema = json.loads(json.dumps(Config.model_json_schema()))

    for name, section in schema["$defs"].items():
        assert section.get("description"), name
        for key, content in section["properties"].items():
            assert content.get("description"), f"{name}.{key}"
