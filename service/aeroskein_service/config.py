"""The configuration: one frozen model over the core's settings and the service's own sections.

Layers, later ones winning: defaults, the TOML file, environment variables ``AEROSKEIN_FUSION__MODE=...``, the command
line. Everything is validated at once before anything starts; what is wrong becomes one sentence with the key's path.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.ahp import pairwise_weights
from aeroskein.errors import SettingsError, UnknownSensorError
from aeroskein.settings import (
    AssociationSettings,
    EngineSettings,
    FusionSettings,
    PatentSettings,
    RegistrationSettings,
    SensorSettings,
    TrackSettings,
)
from aeroskein.simulation.settings import SimulationSettings
from aeroskein_service.config_errors import ConfigError, sentence
from aeroskein_service.config_layers import environment_layer, file_layer, merge, override_layer
from aeroskein_service.keys import DEFAULT_PREFIX, default_instance, is_chunk, is_prefix
from aeroskein_service.link import Link

__all__ = [
    "AreaSettings",
    "Config",
    "ConfigError",
    "HttpSettings",
    "LogSettings",
    "OutputSettings",
    "ServiceSettings",
    "ZenohSettings",
    "load_config",
]

_STRICT: Final = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)


class AreaSettings(BaseModel):
    """What this configuration is for; only for reading."""

    model_config = _STRICT

    name: str = ""
    """A name for people: it stands in the log and on the page."""


class ZenohSettings(BaseModel):
    """How to reach the router, and under which prefix everything lives."""

    model_config = _STRICT

    prefix: str = DEFAULT_PREFIX
    """First chunks of every key."""
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Endpoints of the router, tried in order."""
    user: str = ""
    """User name, where the router asks for one."""
    password: str = Field(default="", repr=False)
    """Password of that user; better given as AEROSKEIN_ZENOH__PASSWORD than in a file."""
    tls_root_ca: str = ""
    """PEM file of the authority that signed the router's certificate; needed for tls/ endpoints."""
    tls_certificate: str = ""
    """PEM file of this process's own certificate, where the router asks for one (mutual TLS)."""
    tls_private_key: str = ""
    """PEM file of the key to it."""
    tls_verify_name: bool = True
    """Whether the router's certificate must carry the name in the endpoint."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not is_prefix(self.prefix):
            raise SettingsError("zenoh.prefix", f"expected key chunks such as 'atc/v1', got {self.prefix!r}")
        if not self.connect:
            raise SettingsError("zenoh.connect", "expected at least one endpoint")
        if bool(self.tls_certificate) != bool(self.tls_private_key):
            raise SettingsError("zenoh.tls_certificate", "tls_certificate and tls_private_key are given together")
        complaint = self.link.complaint()
        if complaint is not None:
            key, _, expected = complaint.partition(": ")
            raise SettingsError(key, expected)
        return self

    @property
    def link(self) -> Link:
        """What the transport needs to know."""
        return Link(**{name: getattr(self, name) for name in type(self).model_fields if name != "prefix"})


class ServiceSettings(BaseModel):
    """The process itself."""

    model_config = _STRICT

    state_dir: str = ""
    """Folder for what survives a restart (track numbers, registration, published elements); empty: nothing is kept."""
    instance: str = ""
    """Name of this process on its keys; empty: host and process number."""
    inbox_batches: int = Field(default=10_000, ge=1)
    """Batches of one sensor that may wait for the worker; more than that drops the oldest (reason overload)."""
    patience_s: float = Field(default=1.0, gt=0.0, le=60.0)
    """Input that waits longer for the worker is an overload: the oldest of the sensor with most waiting is dropped
    (reason overload). From half of this time on live points are thinned. [s]"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.instance and not is_chunk(self.instance):
            raise SettingsError("service.instance", f"expected one key chunk without / * $ ? #, got {self.instance!r}")
        return self

    @property
    def effective_instance(self) -> str:
        """``instance``, or host and process number."""
        return self.instance or default_instance()


class OutputSettings(BaseModel):
    """What is published."""

    model_config = _STRICT

    encoding: Literal["msgpack", "json"] = "msgpack"
    """Encoding of fused points, registration states and replies; the status is always JSON."""


class HttpSettings(BaseModel):
    """The page and the health checks."""

    model_config = _STRICT

    listen: str = "127.0.0.1:8080"
    """Address of the page, with /livez, /readyz and /metrics behind it; empty switches all of them off."""
    origins: tuple[str, ...] = ()
    """Further origins whose pages may connect, such as https://tower.example: the page behind a proxy."""
    viewers: int = Field(default=50, ge=1, le=10_000)
    """Browsers that may look at the page at a time."""
    layers: tuple[str, ...] = ()
    """GeoJSON files that are drawn on the map: airspace, routes."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.listen:
            host, _, port = self.listen.rpartition(":")
            if not host or not port.isdigit() or not 0 <= int(port) <= 65535:
                raise SettingsError("http.listen", f"expected host:port such as '127.0.0.1:8080', got {self.listen!r}")
        return self

    @property
    def address(self) -> tuple[str, int] | None:
        """Host and port, None where switched off."""
        if not self.listen:
            return None
        host, _, port = self.listen.rpartition(":")
        return host.strip("[]"), int(port)


class LogSettings(BaseModel):
    """The log on standard error."""

    model_config = _STRICT

    level: Literal["debug", "info", "warning", "error"] = "info"
    """The least important lines that are still written."""
    format: Literal["auto", "console", "json"] = "auto"
    """auto: for people on a terminal, JSON lines elsewhere."""


class Config(BaseModel):
    """Everything that can be set."""

    model_config = _STRICT

    area: AreaSettings = AreaSettings()
    sensors: tuple[SensorSettings, ...] = ()
    """The sensors; their order is the order of their indices in columns."""
    fusion: FusionSettings = FusionSettings()
    patent: PatentSettings = PatentSettings()
    tracks: TrackSettings = TrackSettings()
    registration: RegistrationSettings = RegistrationSettings()
    association: AssociationSettings = AssociationSettings()
    filter: AdsbFilterSettings = AdsbFilterSettings()
    zenoh: ZenohSettings = ZenohSettings()
    service: ServiceSettings = ServiceSettings()
    output: OutputSettings = OutputSettings()
    http: HttpSettings = HttpSettings()
    log: LogSettings = LogSettings()
    simulation: SimulationSettings = SimulationSettings()

    _origins: dict[tuple[str | int, ...], str] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.sensors:
            _ = self.engine
        pairwise_weights(self.association.pairwise)  # refuses comparisons that contradict each other
        try:
            self.simulation.check_sensors(self.sensors)
        except UnknownSensorError as error:
            raise SettingsError("simulation.errors", str(error)) from None
        return self

    @property
    def engine(self) -> EngineSettings:
        """What the engine needs to know. Raises ``SettingsError`` where there is no sensor."""
        return EngineSettings(
            sensors=self.sensors,
            fusion=self.fusion,
            patent=self.patent,
            tracks=self.tracks,
            registration=self.registration,
            association=self.association,
        )

    @property
    def sensor_ids(self) -> tuple[str, ...]:
        """Ids by index."""
        return tuple(sensor.id for sensor in self.sensors)

    def origin(self, *path: str | int) -> str:
        """Where the value at this path comes from: ``default``, a file, a variable or the command line."""
        for length in range(len(path), 0, -1):
            found = self._origins.get(path[:length])
            if found is not None:
                return found
        return "default"

    def fingerprint(self) -> str:
        """Twelve hex digits that change with every effective value but the password."""
        content = self.model_dump(mode="json", exclude={"zenoh": {"password"}})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


def load_config(
    path: Path | None = None,
    *,
    overrides: Mapping[str, Any] | None = None,
    environ: Mapping[str, str] | None = None,
    sensors_required: bool = True,
) -> Config:
    """Read, merge and check the configuration.

    Parameters
    ----------
    path : Path, optional
        The TOML file; None: defaults, environment and overrides only.
    overrides : mapping, optional
        What the command line sets, by dotted key: ``{"fusion.mode": "patent"}``. None values set nothing.
    environ : mapping, optional
        The environment; the process's own where absent.
    sensors_required : bool
        Whether a configuration without sensors is an error, as it is for everything that fuses.

    Raises
    ------
    ConfigError
        With one sentence for the user: the key's path and what was expected.
    """
    layers = [] if path is None else [file_layer(path)]
    layers.append(environment_layer(Config, os.environ if environ is None else environ))
    layers.append(override_layer(overrides or {}))
    content, origins = merge(layers)
    try:
        # Only in JSON mode are types strict and yet lists accepted for tuples, and tables for dataclasses.
        config = Config.model_validate_json(json.dumps(content, default=_unknown_type), strict=True)
        if sensors_required:
            _ = config.engine
    except ValidationError as error:
        raise ConfigError(sentence(error, Config, content, origins)) from None
    except SettingsError as error:
        where = "" if path is None else f" (in {path})"
        raise ConfigError(f"{error}{where}") from None
    config._origins.update(origins)
    return config


def _unknown_type(value: object) -> dict[str, str]:
    """A date or time of TOML: no key takes one, so it becomes something that no key takes."""
    return {"date or time": str(value)}
