#!/usr/bin/env python3
"""Write a router configuration in which nothing is allowed but what each participant needs.

    make_router.py --sensor adsb --sensor radar1 --login certificates > router.json5

One table (``rules_of``) says what each identity may do; this program spells it as Zenoh's access rules. An identity is
the common name of a certificate, or a user name. Zenoh refuses a subscription that is wider than its rule as a whole,
``**`` does not match the hidden keys (``@adv``) of Advanced pub/sub, and a publisher sends nothing unless it may learn
of its subscriber: hence the pairs of ingress and egress rules. Only the standard library is needed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import Any

# What a message is called on its way in (from the participant to the router) and out.
PUT = ["put", "delete"]
ASKS = ["query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"]
ANSWERS = ["put", "reply", "declare_queryable", "liveliness_token"]

Rule = tuple[str, str, list[str], list[str]]  # name, flow, messages, keys


def publishes(name: str, keys: list[str]) -> list[Rule]:
    """Put, and learn who wants it."""
    return [(f"{name}-put", "ingress", PUT, keys), (f"{name}-wanted", "egress", ["declare_subscriber"], keys)]


def keeps_cache(name: str, keys: list[str]) -> list[Rule]:
    """Repeat on demand what was put (Advanced publisher): its own answers in, questions of others out."""
    hidden = [f"{key}/@adv/**" for key in keys]
    return [
        (f"{name}-cache", "ingress", ANSWERS, hidden),
        (f"{name}-repeat", "ingress", ["reply"], keys),
        (f"{name}-asked", "egress", ASKS, hidden),
    ]


def follows(name: str, keys: list[str]) -> list[Rule]:
    """Subscribe."""
    return [(f"{name}-subscribe", "ingress", ["declare_subscriber"], keys), (f"{name}-get", "egress", PUT, keys)]


def recovers(name: str, keys: list[str]) -> list[Rule]:
    """Ask again for what was missed (Advanced subscriber)."""
    hidden = [f"{key}/@adv/**" for key in keys]
    return [
        (f"{name}-ask-again", "ingress", ASKS, hidden),
        (f"{name}-had-again", "egress", ANSWERS, hidden),
        (f"{name}-again", "egress", ["reply"], keys),
    ]


def answers(name: str, keys: list[str]) -> list[Rule]:
    """Serve queries."""
    return [
        (f"{name}-answer", "ingress", ["declare_queryable", "reply"], keys),
        (f"{name}-question", "egress", ["query"], keys),
    ]


def asks(name: str, keys: list[str]) -> list[Rule]:
    """Query."""
    return [
        (f"{name}-ask", "ingress", ["query"], keys),
        (f"{name}-answered", "egress", ["declare_queryable", "reply"], keys),
    ]


def lives(name: str, keys: list[str]) -> list[Rule]:
    """Hold a liveliness token, and see that it is there (the health check)."""
    return [
        (f"{name}-alive", "ingress", ["liveliness_token", "liveliness_query", "declare_liveliness_subscriber"], keys),
        (f"{name}-alive-told", "egress", ["liveliness_token", "reply"], keys),
    ]


def rules_of(prefix: str, sensors: list[str]) -> Iterator[tuple[str, list[Rule]]]:
    """Every identity with what it may do."""
    for sensor in sensors:
        own = [f"{prefix}/reports/{sensor}/**"]
        yield (
            sensor,
            publishes(sensor, own) + keeps_cache(sensor, own) + lives(sensor, [f"{prefix}/alive/sensor-{sensor}/*"]),
        )
    reports, feed = [f"{prefix}/reports/**"], [f"{prefix}/feed/**"]
    said = [f"{prefix}/{what}/**" for what in ("fused", "feed", "registration", "status")]
    questions = [f"{prefix}/query/**"]
    yield (
        "fusion",
        follows("fusion", reports)
        + recovers("fusion-reports", reports)
        + publishes("fusion", [*said, f"{prefix}/debug/dispositions/**"])
        + keeps_cache("fusion-feed", feed)
        + answers("fusion", [*questions, f"{prefix}/control/**"])
        + lives("fusion", [f"{prefix}/alive/fusion/**"]),
    )
    yield (
        "consumer",
        follows("consumer", said)
        + recovers("consumer", feed)
        + asks("consumer", [f"{prefix}/query/tracks"])
        + lives("consumer", [f"{prefix}/alive/watch/*"]),
    )
    # The page is a consumer that may look into elements and reports; it can change nothing.
    yield (
        "web",
        follows("web", [*said, f"{prefix}/debug/dispositions/**"])
        + recovers("web", feed)
        + asks("web", questions)
        + lives("web", [f"{prefix}/alive/web/*"]),
    )
    yield "operator", asks("operator", [*questions, f"{prefix}/control/**"]) + follows("operator", said)
    # Not a participant: the router's own health check.
    yield "router", lives("router", [f"{prefix}/alive/router/*"])


def configuration(prefix: str, sensors: list[str], login: str) -> dict[str, Any]:
    """The router's whole configuration."""
    table = list(rules_of(prefix, sensors))
    property_ = "cert_common_names" if login == "certificates" else "usernames"
    protocol = "tls" if login == "certificates" else "tcp"
    transport: dict[str, Any] = {
        "shared_memory": {"enabled": False},
        "link": {"tx": {"queue": {"size": {"data": 16}}}},
    }
    folder = "/run/aeroskein"
    if login == "certificates":
        transport["link"]["tls"] = {
            "root_ca_certificate": f"{folder}/ca.pem",
            "listen_certificate": f"{folder}/cert.pem",
            "listen_private_key": f"{folder}/key.pem",
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }
    else:
        transport["auth"] = {"usrpwd": {"dictionary_file": f"{folder}/users"}}
    return {
        "mode": "router",
        "listen": {"endpoints": [f"{protocol}/0.0.0.0:7447"]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "transport": transport,
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": [
                {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
                for _, rules in table
                for name, flow, messages, keys in rules
            ],
            "subjects": [{"id": identity, property_: [identity]} for identity, _ in table],
            "policies": [
                {"subjects": [identity], "rules": [name for name, _, _, _ in rules]} for identity, rules in table
            ],
        },
    }


def spelled(value: Any, indent: str = "") -> str:
    """JSON with one line for every innermost list or rule, so that the file can be read and compared."""
    inner = json.dumps(value)
    if not isinstance(value, dict | list) or len(inner) + len(indent) <= 118:
        return inner
    deeper = indent + "  "
    if isinstance(value, list):
        return "[\n" + ",\n".join(deeper + spelled(item, deeper) for item in value) + f"\n{indent}]"
    lines = (f"{deeper}{json.dumps(key)}: {spelled(item, deeper)}" for key, item in value.items())
    return "{\n" + ",\n".join(lines) + f"\n{indent}}}"


def main() -> None:
    """Print the configuration."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--prefix", default="atc/v1", help="as zenoh.prefix")
    parser.add_argument("--sensor", action="append", required=True, help="a sensor's id; may be repeated")
    parser.add_argument("--login", choices=("certificates", "passwords"), default="certificates")
    given = parser.parse_args()
    call = " ".join(f"--sensor {sensor}" for sensor in given.sensor)
    print(f"// Made by make_router.py --prefix {given.prefix} {call} --login {given.login}: do not edit.")
    print(spelled(configuration(given.prefix, given.sensor, given.login)))


if __name__ == "__main__":
    main()
