"""Options that several commands share, declared once: what they are called, what they take, what they say in --help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AsJson",
    "Config",
    "Duration",
    "FusedFile",
    "MaxBad",
    "OptionalConfig",
    "Output",
    "Reports",
    "share",
]


def share(text: str | float) -> float:
    """A share given as ``0.01`` or ``1%``; raises ``typer.BadParameter``."""
    text = str(text)  # typer also shows the default to its parser, as the number it is
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no share such as 0.01 or 1%") from None
    if not 0.0 <= value <= 1.0:
        raise typer.BadParameter(f"{text!r} is not between 0 and 1, or 0% and 100%")
    return value


_CONFIG = typer.Option(
    "--config", "-c", metavar="FILE", envvar="AEROSKEIN_CONFIG", exists=True, dir_okay=False,
    help="Configuration file (TOML).",
)  # fmt: skip

Config = Annotated[Path, _CONFIG]
OptionalConfig = Annotated[Path | None, _CONFIG]
Reports = Annotated[
    Path,
    typer.Argument(metavar="REPORTS", exists=True, dir_okay=False, help="Report file (JSON Lines, .gz by suffix)."),
]
FusedFile = Annotated[Path, typer.Argument(metavar="FUSED", exists=True, dir_okay=False, help="Fused file.")]
Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", dir_okay=False, help="Where to write (.gz by suffix).")
]
Duration = Annotated[
    float | None, typer.Option("--duration", metavar="S", min=0.0, help="Stop after this many seconds.")
]
MaxBad = Annotated[
    float,
    typer.Option(
        "--max-bad", metavar="SHARE", parser=share, help="Share of broken lines above which the exit status is 1."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
