"""The command line: every command of the contract, quick help, one sentence and an exit status."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from aeroskein.errors import AeroskeinError, SettingsError
from aeroskein_service import cli, log
from aeroskein_service.config import Config

CONFIG = str(Path(__file__).parents[2] / "deploy" / "fusion.toml")
COMMANDS = (
    "demo", "run", "router", "simulate", "web", "watch", "fuse", "smooth", "filter", "evaluate", "record", "replay",
    "recover", "export", "health", "config",
)  # fmt: skip


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as left:
        cli.main(arguments)
    return left.value.code


@pytest.fixture
def called(monkeypatch):
    """Stands for every command; keeps the arguments it was called with."""
    kept: dict[str, object] = {}

    def load(name: str) -> SimpleNamespace:
        kept["command"] = name.rpartition(".")[2]

        def run(**arguments: object) -> int:
            kept.update(arguments)
            if isinstance(kept.get("raises"), BaseException):
                raise kept["raises"]
            return kept.get("status", 0)

        return SimpleNamespace(run=run)

    monkeypatch.setattr(cli.importlib, "import_module", load)
    monkeypatch.setattr(log, "configure", lambda settings: None)
    return kept


@pytest.fixture
def report_file(tmp_path):
    path = tmp_path / "reports.jsonl"
    path.write_text("")
    return str(path)


# -- help ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS), ["config", "show"], ["config", "schema"]])
def test_every_command_of_the_contract_explains_itself(command, capsys):
    assert call(*command, "--help") == 0
    assert "Usage: aeroskein" in capsys.readouterr().out


def test_help_imports_nothing_heavy():
    code = (
        "import sys; sys.argv = ['aeroskein', '--help']\n"
        "from aeroskein_service.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'zenoh', 'pydantic', 'msgspec', 'rich', 'starlette', 'structlog'} & set(sys.modules)\n"
        "sys.exit(f'imported {sorted(heavy)}' if heavy else 0)"
    )

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)

    assert done.returncode == 0, done.stderr


def test_version_is_printed(capsys):
    assert call("--version") == 0
    assert capsys.readouterr().out.startswith("aeroskein 0.")


def test_no_command_is_wrong_usage_with_help(capsys):
    assert call() == 2
    assert "Usage: aeroskein" in capsys.readouterr().err


# -- wrong usage ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["--nonsense"],
        ["run"],
        ["run", "--config", "/nowhere.toml"],
        ["fuse", "--config", CONFIG, "/nowhere.jsonl", "--output", "x"],
        ["fuse", "--config", CONFIG, CONFIG, "--output", "x", "--mode", "best"],
        ["fuse", "--config", CONFIG, CONFIG, "--output", "x", "--lookahead", "-1"],
        ["fuse", "--config", CONFIG, CONFIG, "--output", "x", "--max-bad", "150%"],
        ["fuse", "--config", CONFIG, CONFIG, "--output", "x", "--max-bad", "few"],
        ["watch", "--product", "both"],
        ["config"],
        ["config", "nonsense"],
        ["evaluate"],
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(arguments, capsys):
    assert call(*arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert len(said.err.strip().splitlines()) == 1 or "Usage:" in said.err


# -- errors --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (SettingsError("fusion.mode", "expected something"), 2, "aeroskein: fusion.mode: expected something"),
        (AeroskeinError("the picture is torn"), 1, "aeroskein: the picture is torn"),
        (
            FileNotFoundError(2, "No such file or directory", "x.jsonl"),
            1,
            "aeroskein: no such file or directory: x.jsonl",
        ),
        (OSError(28, "No space left on device"), 1, "aeroskein: No space left on device"),
        (ZeroDivisionError("division by zero"), 1, "internal error: ZeroDivisionError: division by zero"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_failure_is_one_sentence_and_a_status(called, capsys, error, status, said):
    called["raises"] = error

    assert call("demo") == status
    shown = capsys.readouterr().err
    assert said in shown
    assert "Traceback" not in shown


@pytest.mark.parametrize("action", ["show", "schema"])
def test_reader_that_goes_away_is_no_reason_for_a_traceback(action):
    code = f"import sys; sys.argv = ['aeroskein', 'config', '{action}']; from aeroskein_service.cli import main; main()"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()

    said = process.stderr.read()
    process.stderr.close()

    assert process.wait(timeout=60) == 1
    assert said == b""


@pytest.mark.parametrize("arguments", [["--debug", "demo"], ["demo", "--debug"]])
def test_debug_shows_where_wherever_it_stands(called, arguments):
    called["raises"] = ZeroDivisionError("division by zero")

    with pytest.raises(ZeroDivisionError):
        cli.main(arguments)


def test_status_of_a_command_is_the_status_of_the_process(called):
    called["status"] = 1

    assert call("demo") == 1


def test_wrong_configuration_is_status_2(tmp_path, capsys):
    path = tmp_path / "x.toml"
    path.write_text("[fusion]\nmdoe = 'patent'\n")

    assert call("config", "show", "--config", str(path)) == 2
    assert "did you mean fusion.mode?" in capsys.readouterr().err


# -- what commands get ---------------------------------------------------------------------------------------------
def test_fuse_gets_its_options_and_a_configuration_changed_by_them(called, report_file):
    status = call(
        "fuse", "--config", CONFIG, report_file, "--output", "out.jsonl", "--mode", "patent", "--lookahead", "2",
        "--product", "live", "--select", "speed=1,2", "--registration-output", "reg.jsonl", "--max-bad", "5%",
    )  # fmt: skip

    assert status == 0
    config = called.pop("config")
    assert isinstance(config, Config)
    assert (config.fusion.mode, config.fusion.lookahead) == ("patent", 2)
    assert called == {
        "command": "fuse", "reports": Path(report_file), "output": Path("out.jsonl"), "product": "live",
        "registration_output": Path("reg.jsonl"), "select": "speed=1,2", "max_bad": 0.05,
    }  # fmt: skip


def test_watch_needs_no_configuration_and_takes_a_router(called):
    assert call("watch", "--connect", "tcp/h:1", "--product", "element", "--track", "3C6444", "--json") == 0
    assert called["config"].zenoh.connect == ("tcp/h:1",)
    assert (called["product"], called["track"], called["as_json"]) == ("element", "3C6444", True)


def test_environment_changes_what_a_command_gets(called, report_file, monkeypatch):
    monkeypatch.setenv("AEROSKEIN_CONFIG", CONFIG)
    monkeypatch.setenv("AEROSKEIN_FUSION__MODE", "weighted")

    assert call("fuse", report_file, "--output", "out.jsonl") == 0
    assert called["config"].fusion.mode == "weighted"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["demo", "--real", "--duration", "30"], {"command": "demo", "real": True, "duration": 30.0}),
        (["demo"], {"command": "demo", "real": False, "duration": None}),
        (["health"], {"command": "health", "url": "http://127.0.0.1:8080"}),
        (["router", "--listen", "tcp/0:1"], {"command": "router", "config": None, "listen": ["tcp/0:1"]}),
        (["config", "schema"], {"command": "config", "action": "schema", "config": None}),
    ],
)
def test_command_gets_its_options(called, arguments, expected):
    assert call(*arguments) == 0
    assert called == expected


EVERY_OPTION = {
    "demo": ["--real", "--duration", "1"],
    "run": ["--config", CONFIG],
    "router": ["--config", CONFIG, "--listen", "tcp/0:1"],
    "simulate": ["--config", CONFIG, "--scenario", "hold", "--seed", "2", "--speed", "2", "--aircraft", "3",
                 "--duration", "5", "--output", "x", "--sensor", "adsb", "--real"],
    "web": ["--config", CONFIG, CONFIG],
    "watch": ["--config", CONFIG, "--connect", "tcp/h:1", "--product", "live", "--track", "T000001", "--json"],
    "fuse": ["--config", CONFIG, CONFIG, "--output", "x"],
    "smooth": ["--config", CONFIG, CONFIG, "--output", "x", "--max-bad", "0"],
    "filter": ["--config", CONFIG, CONFIG, "--sensor", "adsb", "--model", "ukf", "--smooth", "--output", "x"],
    "evaluate": [CONFIG, "--truth", CONFIG, "--json"],
    "record": ["--config", CONFIG, "--output", "x"],
    "replay": ["--config", CONFIG, CONFIG],
    "recover": [CONFIG, "--output", "x"],
    "export": [CONFIG, "--output", "x"],
    "health": ["--url", "http://h:1"],
    "config": ["show", "--config", CONFIG],
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_what_the_command_line_gives_it(command, request):
    module = pytest.importorskip(f"aeroskein_service.commands.{command}", exc_type=ModuleNotFoundError)
    called = request.getfixturevalue("called")

    assert call(command, *EVERY_OPTION[command]) == 0

    assert called.pop("command") == command
    inspect.signature(module.run).bind(**called)


# -- config --------------------------------------------------------------------------------------------------------
def test_config_schema_prints_json(capsys):
    assert call("config", "schema") == 0
    assert "fusion" in json.loads(capsys.readouterr().out)["properties"]


def test_config_show_prints_what_is_in_force_and_why(capsys, monkeypatch):
    monkeypatch.setenv("AEROSKEIN_FUSION__MODE", "patent")

    assert call("config", "show", "--config", CONFIG) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("mode ="))
    assert line.split() == ["mode", "=", '"patent"', "#", "environment", "AEROSKEIN_FUSION__MODE"]
