"""Bar plots of benchmark results, as PNG files; without matplotlib (``make bench`` installs it) there are none."""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = ["FOLDER", "plot_bars"]

# Where plots go unless told otherwise.
FOLDER: Final = Path("build/benchmarks")


def plot_bars(path: Path, title: str, values: dict[str, float], unit: str, *, log: bool = False) -> None:
    """Horizontal bars with their values beside them, the first on top; says where the file is."""
    try:
        import matplotlib
    except ImportError:
        print(f"    no plot {path.name}: matplotlib is not installed")
        return
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.0, 0.45 * len(values) + 1.1), layout="constrained")
    bars = axes.barh(list(values), list(values.values()), color="#3b6ea5", log=log)
    axes.bar_label(bars, fmt="%.3g", padding=4)
    axes.invert_yaxis()
    axes.margins(x=0.18)
    axes.set_xlabel(unit)
    axes.set_title(title, fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
    print(f"    plot: {path}")
