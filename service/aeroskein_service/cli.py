"""The command line: every command with its options; the work is in ``commands/<name>.py``, imported when it is called.

Nothing heavy is imported here, so that ``--help`` answers at once. Whatever fails becomes one sentence on standard
error and an exit status: 0 done, 1 something failed at run time, 2 wrong usage or configuration.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import typer

from aeroskein_service import cli_options as opt

__all__ = ["app", "main"]

DONE: Final = 0
FAILED: Final = 1
WRONG_USAGE: Final = 2
# What a shell reports for a process that ended by Ctrl-C.
INTERRUPTED: Final = 130

# typer keeps the base of its exceptions private; the public ``BadParameter`` is one of them.
_ClickException: Final[Any] = typer.BadParameter.__mro__[2]

app = typer.Typer(
    name="aeroskein",
    help="Streaming track fusion for air surveillance: ADS-B and radars in, one picture out, over Zenoh.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
config_app = typer.Typer(help="Show the effective configuration, or its JSON schema.", rich_markup_mode=None)
app.add_typer(config_app, name="config")


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"aeroskein {version('aeroskein')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
    debug: Annotated[bool, typer.Option("--debug", help="Show a traceback when something fails.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print it.")
    ] = False,
) -> int | None:
    """Streaming track fusion for air surveillance: ADS-B and radars in, one picture out, over Zenoh."""
    if context.invoked_subcommand is None:
        print(context.get_help(), file=sys.stderr)
        raise typer.Exit(WRONG_USAGE)
    return None


def _call(command: str, entry: str = "run", **arguments: Any) -> int:
    """Run ``entry`` of ``commands/<command>.py`` and give its exit status; an argument ``_Load`` is loaded first."""
    module = importlib.import_module(f"aeroskein_service.commands.{command}")
    for key, value in arguments.items():
        if isinstance(value, _Load):
            arguments[key] = _loaded(value)
    return int(getattr(module, entry)(**arguments) or DONE)


class _Load(NamedTuple):
    """A configuration to be loaded once the command is known to exist."""

    path: Path | None
    sensors_required: bool = True
    overrides: Mapping[str, Any] = {}


def _loaded(wanted: _Load) -> Any:
    from aeroskein_service.config import load_config
    from aeroskein_service.log import configure

    config = load_config(wanted.path, overrides=wanted.overrides, sensors_required=wanted.sensors_required)
    configure(config.log)
    return config


# -- running ---------------------------------------------------------------------------------------------------------
@app.command()
def demo(
    real: Annotated[bool, typer.Option("--real", help="Recorded ADS-B traffic, shifted in time to now.")] = False,
    duration: opt.Duration = None,
) -> int:
    """The whole job in one process tree: router, three sensors, service, page; says where to look."""
    return _call("demo", real=real, duration=duration)


@app.command("run")
def run_service(config: opt.Config) -> int:
    """The fusion service."""
    return _call("run", config=_Load(config))


@app.command()
def router(
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", metavar="FILE", exists=True, dir_okay=False, help="Zenoh's own file (JSON5)."),
    ] = None,
    listen: Annotated[
        list[str] | None, typer.Option("--listen", metavar="ENDPOINT", help="Instead of the file's; may be repeated.")
    ] = None,
) -> int:
    """A Zenoh router in this process."""
    return _call("router", config=config, listen=listen or ())


@app.command()
def simulate(
    config: opt.Config,
    scenario: Annotated[str | None, typer.Option("--scenario", help="What is flown; else as configured.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Same seed, same flights and reports.")] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", min=0.0, help="Times real time, into a file; else as fast as it goes.")
    ] = None,
    aircraft: Annotated[int | None, typer.Option("--aircraft", min=1, help="How many are in the air.")] = None,
    duration: opt.Duration = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="A report file and its truth, not Zenoh.")
    ] = None,
    sensor: Annotated[list[str] | None, typer.Option("--sensor", help="Only this sensor; may be repeated.")] = None,
    real: Annotated[bool, typer.Option("--real", help="Fly recorded ADS-B traffic instead of a scenario.")] = False,
    begin: Annotated[
        float | None,
        typer.Option("--begin", metavar="T", help="Play as if the traffic had begun then, so that processes agree."),
    ] = None,
) -> int:
    """Sensors from the scenario simulator: to Zenoh, or to a report file plus its truth."""
    return _call(
        "simulate", config=_Load(config), scenario=scenario, seed=seed, speed=speed, aircraft=aircraft,
        duration=duration, output=output, sensor=sensor, real=real, begin=begin,
    )  # fmt: skip


@app.command()
def web(
    config: opt.OptionalConfig = None,
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", exists=True, dir_okay=False, help="A fused or report file.")
    ] = None,
    listen: Annotated[str | None, typer.Option("--listen", metavar="HOST:PORT", help="Instead of http.listen.")] = None,
    connect: Annotated[str | None, typer.Option("--connect", metavar="ENDPOINT", help="The router.")] = None,
) -> int:
    """The page, as a consumer of the feed or over a fused or report file."""
    changes = {"http.listen": listen, "zenoh.connect": None if connect is None else [connect]}
    return _call("web", config=_Load(config, False, changes), file=file)


@app.command()
def watch(
    config: opt.OptionalConfig = None,
    connect: Annotated[str | None, typer.Option("--connect", metavar="ENDPOINT", help="The router.")] = None,
    product: Annotated[Literal["live", "element"], typer.Option("--product", help="Which product.")] = "live",
    track: Annotated[str | None, typer.Option("--track", help="Only this track: 3C6444 or T000123.")] = None,
    as_json: opt.AsJson = False,
) -> int:
    """A consumer: prints fused points as they come."""
    where = {"zenoh.connect": None if connect is None else [connect]}
    return _call("watch", config=_Load(config, False, where), product=product, track=track, as_json=as_json)


# -- files -----------------------------------------------------------------------------------------------------------
@app.command()
def fuse(
    config: opt.Config,
    reports: opt.Reports,
    output: opt.Output,
    mode: Annotated[
        Literal["information", "weighted", "patent"] | None, typer.Option("--mode", help="Instead of fusion.mode.")
    ] = None,
    product: Annotated[str, typer.Option("--product", help="Which products to write.")] = "element,live",
    registration_output: Annotated[
        Path | None, typer.Option("--registration-output", metavar="FILE", help="Registration states, one a line.")
    ] = None,
    lookahead: Annotated[int | None, typer.Option("--lookahead", min=0, help="Instead of fusion.lookahead.")] = None,
    select: Annotated[
        str | None,
        typer.Option(
            "--select", metavar="CONDITIONS", help='Only reports in: "bbox=48,11,49,12;time=t0,t1;speed=50,300".'
        ),
    ] = None,
    max_bad: opt.MaxBad = 0.01,
) -> int:
    """The same engine over a report file, as fast as it goes; same bytes for the same input."""
    return _call(
        "fuse", config=_Load(config, overrides={"fusion.mode": mode, "fusion.lookahead": lookahead}), reports=reports,
        output=output, product=product, registration_output=registration_output, select=select, max_bad=max_bad,
    )  # fmt: skip


@app.command()
def smooth(config: opt.Config, reports: opt.Reports, output: opt.Output, max_bad: opt.MaxBad = 0.01) -> int:
    """Offline: whole tracks smoothed forward and backward (RTS)."""
    return _call("smooth", config=_Load(config), reports=reports, output=output, max_bad=max_bad)


@app.command("filter")
def filter_sensor(
    config: opt.Config,
    reports: opt.Reports,
    sensor: Annotated[str, typer.Option("--sensor", help="Whose reports; several with commas between.")],
    output: opt.Output,
    model: Annotated[Literal["linear", "ukf", "imm"], typer.Option("--model", help="Which filter.")] = "imm",
    smooth: Annotated[bool, typer.Option("--smooth", help="Smooth backward as well.")] = False,
    estimate_errors: Annotated[
        bool,
        typer.Option("--estimate-errors", help="Use position and time errors estimated from straight flight."),
    ] = False,
    max_bad: opt.MaxBad = 0.01,
) -> int:
    """Filtering of one sensor's tracks."""
    return _call(
        "filter", config=_Load(config), reports=reports, sensor=sensor, model=model, smooth=smooth, output=output,
        estimate_errors=estimate_errors, max_bad=max_bad,
    )  # fmt: skip


@app.command()
def evaluate(
    fused: Annotated[list[Path], typer.Argument(metavar="FUSED...", exists=True, dir_okay=False, help="Fused files.")],
    truth: Annotated[Path, typer.Option("--truth", exists=True, dir_okay=False, help="Truth file.")],
    reports: Annotated[
        Path | None,
        typer.Option("--reports", exists=True, dir_okay=False, help="Report file: raw sensors are judged too."),
    ] = None,
    config: opt.OptionalConfig = None,
    as_json: opt.AsJson = False,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", dir_okay=False, help="Write a page with plots.")
    ] = None,
    from_s: Annotated[
        float, typer.Option("--from-s", "--from", metavar="S", min=0.0, help="Skip each flight's beginning.")
    ] = 30.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the confidence intervals.")] = 1,
    max_bad: opt.MaxBad = 0.01,
) -> int:
    """Errors against truth; with --reports of the raw sensors too (radars need --config for their sites)."""
    loaded = None if config is None else _Load(config, sensors_required=False)
    return _call(
        "evaluate", fused=fused, truth=truth, reports=reports, config=loaded, as_json=as_json, html=html, from_s=from_s,
        seed=seed, max_bad=max_bad,
    )  # fmt: skip


# -- recordings ------------------------------------------------------------------------------------------------------
@app.command()
def record(config: opt.Config, output: opt.Output, duration: opt.Duration = None) -> int:
    """Record what the sensors send and what the service publishes."""
    return _call("record", config=_Load(config), output=output, duration=duration)


@app.command()
def replay(
    config: opt.Config,
    file: Annotated[Path, typer.Argument(metavar="FILE", exists=True, help="A recording or a report file.")],
) -> int:
    """Send recorded reports again, as their sensors, shifted in time to now."""
    return _call("replay", config=_Load(config), file=file)


@app.command()
def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE", exists=True, help="A recording that was cut off.")],
    output: opt.Output,
) -> int:
    """Save what is readable of a recording that was cut off."""
    return _call("recover", file=file, output=output)


@app.command()
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", exists=True, help="A recording.")],
    output: opt.Output,
    what: Annotated[Literal["reports", "fused"], typer.Option("--what", help="Which part of it.")] = "reports",
) -> int:
    """Write a recording as a report file or a fused file."""
    return _call("export", file=file, output=output, what=what)


# -- operation -------------------------------------------------------------------------------------------------------
@app.command()
def health(
    url: Annotated[str, typer.Option("--url", help="Of the service.")] = "http://127.0.0.1:8080",
    alive: Annotated[
        str | None, typer.Option("--alive", metavar="PROCESS", help="Ask Zenoh: router, sensor-adsb, watch, fusion.")
    ] = None,
) -> int:
    """Exit status 0 when the service is ready, or the process alive."""
    if alive is None:
        return _call("health", url=url)
    return _call("health", entry="run_alive", config=_Load(None, sensors_required=False), service=alive)


@config_app.command("show")
def config_show(config: opt.OptionalConfig = None) -> int:
    """Every effective value, and where it comes from."""
    return _call("config", action="show", config=config)


@config_app.command("schema")
def config_schema(config: opt.OptionalConfig = None) -> int:
    """The JSON schema of the configuration, with a description of every key."""
    return _call("config", action="schema", config=config)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command ``aeroskein``; always leaves by ``SystemExit``."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given or bool(os.environ.get("AEROSKEIN_DEBUG"))
    given = [argument for argument in given if argument != "--debug"]
    try:
        status = app(given, prog_name="aeroskein", standalone_mode=False)
        sys.stdout.flush()
    except BaseException as error:
        if debug and not isinstance(error, SystemExit):
            raise
        status = _status_of(error)
    sys.exit(status)


def _status_of(error: BaseException) -> int | str | None:
    """Say what went wrong in one sentence and give the exit status."""
    if isinstance(error, SystemExit):
        return error.code
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        return INTERRUPTED
    if isinstance(error, BrokenPipeError):
        # Whoever read our output has gone; what is left in the buffer must not raise again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    sentence, status = _sentence(error)
    print(f"aeroskein: {sentence}", file=sys.stderr)
    return status


def _sentence(error: BaseException) -> tuple[str, int]:
    from aeroskein.errors import AeroskeinError, SettingsError

    if isinstance(error, _ClickException):
        command = getattr(getattr(error, "ctx", None), "command_path", "aeroskein")
        return f"{error.format_message().rstrip('.')} (see {command} --help)", WRONG_USAGE
    if isinstance(error, SettingsError) or getattr(error, "exit_status", FAILED) == WRONG_USAGE:
        return str(error), WRONG_USAGE
    if isinstance(error, OSError) and error.strerror:
        where = f" {error.filename}" if error.filename is not None else ""
        return f"{error.strerror[:1].lower()}{error.strerror[1:]}:{where}" if where else error.strerror, FAILED
    if isinstance(error, AeroskeinError):
        return str(error), FAILED
    return f"internal error: {type(error).__name__}: {error} (--debug shows where)", FAILED
