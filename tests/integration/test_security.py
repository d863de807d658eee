"""Logging in: user and password, TLS, and mutual TLS, on a real router that enforces them."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest
from tests.integration.harness import ADDRESSES, Sensor, flight, free_port, make_config, running, wait_until

from aeroskein_service.link import Link
from aeroskein_service.transport import OpenCancelledError, Router, TransportError, open_session

CERTIFICATES = Path(__file__).parent / "certificates"


def router_file(folder: Path, endpoint: str, transport: dict) -> Path:
    path = folder / "router.json5"
    settings = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": transport,
    }
    path.write_text(json.dumps(settings))
    return path


def refused(link: Link) -> list[str]:
    """What is said while a router refuses us; fails when it lets us in."""
    said: list[str] = []
    stop = threading.Event()

    def announce(sentence: str) -> None:
        said.append(sentence)
        stop.set()

    with pytest.raises(OpenCancelledError):
        open_session(link, announce=announce, stop=stop).close()
    return said


def fuses(folder: Path, keys, link: Link, overrides: dict) -> None:
    """A service with this login fuses what a sensor with the same login sends."""
    config = make_config(folder, link.connect[0], keys.prefix, overrides)
    assert config.zenoh.link == link
    with open_session(link) as session, running(config) as service:
        sensor = Sensor(session, keys)
        sensor.send(flight(ADDRESSES[0], time.time()))
        wait_until(lambda: service.status and service.status["sensors"]["adsb"]["accepted"] == 12, "reports")


def test_user_and_password_let_the_service_in(tmp_path, keys):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    users = tmp_path / "users"
    users.write_text("fusion:secret\n")
    login = {"auth": {"usrpwd": {"user": "router", "password": "other", "dictionary_file": str(users)}}}
    with Router(config_file=router_file(tmp_path, endpoint, login)):
        fuses(
            tmp_path,
            keys,
            Link(connect=(endpoint,), user="fusion", password="secret"),
            {"zenoh.user": "fusion", "zenoh.password": "secret"},
        )


@pytest.mark.parametrize("link", [{"user": "fusion", "password": "wrong"}, {}], ids=["wrong password", "no login"])
def test_wrong_login_says_that_the_router_refuses_it(tmp_path, link):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    users = tmp_path / "users"
    users.write_text("fusion:secret\n")
    login = {"auth": {"usrpwd": {"user": "router", "password": "other", "dictionary_file": str(users)}}}
    with Router(config_file=router_file(tmp_path, endpoint, login)):
        (said,) = refused(Link(connect=(endpoint,), **link))
    assert "it answers but refuses us" in said
    assert "wrong" not in said


def tls(mutual: bool) -> dict:
    return {
        "link": {
            "tls": {
                "root_ca_certificate": str(CERTIFICATES / "ca.pem"),
                "listen_private_key": str(CERTIFICATES / "router.key"),
                "listen_certificate": str(CERTIFICATES / "router.pem"),
                "enable_mtls": mutual,
            }
        }
    }


def test_tls_needs_only_the_authority(tmp_path, keys):
    endpoint, ca = f"tls/localhost:{free_port()}", str(CERTIFICATES / "ca.pem")
    with Router(config_file=router_file(tmp_path, endpoint, tls(mutual=False))):
        fuses(tmp_path, keys, Link(connect=(endpoint,), tls_root_ca=ca), {"zenoh.tls_root_ca": ca})


def test_mutual_tls_needs_a_certificate_of_our_own(tmp_path, keys):
    endpoint = f"tls/localhost:{free_port()}"
    files = {
        "tls_root_ca": str(CERTIFICATES / "ca.pem"),
        "tls_certificate": str(CERTIFICATES / "fusion.pem"),
        "tls_private_key": str(CERTIFICATES / "fusion.key"),
    }
    with Router(config_file=router_file(tmp_path, endpoint, tls(mutual=True))):
        fuses(tmp_path, keys, Link(connect=(endpoint,), **files), {f"zenoh.{k}": v for k, v in files.items()})
        (said,) = refused(Link(connect=(endpoint,), tls_root_ca=files["tls_root_ca"]))
    assert "refuses us" in said


def test_certificate_that_is_not_there_is_named(tmp_path):
    link = Link(connect=("tls/localhost:1",), tls_root_ca=str(tmp_path / "missing.pem"))
    with pytest.raises(TransportError, match=r"zenoh\.tls_root_ca: no such file: .*missing\.pem"):
        open_session(link)
