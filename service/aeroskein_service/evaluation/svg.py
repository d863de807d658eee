"""Small plots as inline SVG: two scales, a frame with ticks, and marks on it.

No plotting library and no script: the page is one file that needs nothing. Colours are CSS classes (``c0`` to ``c5``
for the columns, ``muted``, ``truth``), so that light and dark are the page's business.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final, Self

import numpy as np

from aeroskein.plots import Array

__all__ = ["FULL", "HALF", "THIRD", "TWO_THIRDS", "Plot", "Scale", "same_scale", "tick_text", "ticks_of"]

# Sizes of pictures in a row of the page, so that letters are as large in all of them. [px]
THIRD: Final = (370.0, 290.0)
HALF: Final = (565.0, 320.0)
TWO_THIRDS: Final = (765.0, 320.0)
FULL: Final = (1160.0, 320.0)
# Room around the frame for tick labels and axis names. [px]
_LEFT: Final = 54.0
_RIGHT: Final = 14.0
_TOP: Final = 10.0
_BOTTOM: Final = 42.0


@dataclass(frozen=True, slots=True)
class Scale:
    """From values to pixels, linear or logarithmic."""

    low: float
    high: float
    start: float
    end: float
    is_log: bool = False

    def __call__(self, value: Array | float) -> Array:
        """Pixels of values; values outside stay outside."""
        value = np.asarray(value, dtype=np.float64)
        if self.is_log:
            value = np.log10(np.maximum(value, 1e-12))
            low, high = math.log10(self.low), math.log10(self.high)
        else:
            low, high = self.low, self.high
        return np.asarray(self.start + (value - low) / ((high - low) or 1.0) * (self.end - self.start))

    @property
    def ticks(self) -> list[float]:
        """Round values inside the scale."""
        return ticks_of(self.low, self.high, is_log=self.is_log)


def ticks_of(low: float, high: float, *, is_log: bool = False, about: int = 5) -> list[float]:
    """Round numbers between two values: 1, 2, 5 times a power of ten."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low:
        return [low]
    if is_log:
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        steps = (1.0, 2.0, 5.0) if last - first <= 4 else (1.0,)
        ticks = [step * 10.0**power for power in range(first, last + 1) for step in steps]
        return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]
    raw = (high - low) / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def same_scale(points: Array, size: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y that show all points, with the same metres to a pixel both ways."""
    low, high = points.min(axis=0), points.max(axis=0)
    frame = np.array([size[0] - _LEFT - _RIGHT, size[1] - _TOP - _BOTTOM])
    per_px = max(float(np.max((high - low) / frame)), 1e-9) * 1.08
    corner, other = 0.5 * (low + high) - 0.5 * per_px * frame, 0.5 * (low + high) + 0.5 * per_px * frame
    return (float(corner[0]), float(other[0])), (float(corner[1]), float(other[1]))


def tick_text(value: float) -> str:
    """A tick label without needless zeros."""
    if value == 0.0:
        return "0"
    return f"{value:.10g}" if 1e-3 <= abs(value) < 1e6 else f"{value:.0e}"


class Plot:
    """A frame with axes, to which marks are added; every method returns the plot.

    Parameters
    ----------
    x, y : (low, high)
        Ranges of the axes.
    x_label, y_label : str
        Names of the axes with their unit.
    title : str
        What the picture shows, for those who cannot see it.
    size : (width, height)
        [px]
    x_log, y_log : bool
        Logarithmic axes.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        *,
        x_label: str,
        y_label: str,
        title: str,
        size: tuple[float, float] = (560.0, 300.0),
        x_log: bool = False,
        y_log: bool = False,
        left: float = _LEFT,
    ) -> None:
        self.width, self.height = size
        self.title, self.x_label, self.y_label, self.left = title, x_label, y_label, left
        self.x = Scale(*x, left, self.width - _RIGHT, x_log)
        self.y = Scale(*y, self.height - _BOTTOM, _TOP, y_log)
        self._marks: list[str] = []
        self.y_ticks: list[tuple[float, str]] | None = None

    def line(self, x: Array, y: Array, css: str) -> Self:
        """A line through points; it breaks where a value is missing."""
        px, py = self.x(x), self.y(y)
        known = np.isfinite(px) & np.isfinite(py)
        path, pen_down = [], False
        for is_known, a, b in zip(known.tolist(), px.tolist(), py.tolist(), strict=True):
            if is_known:
                path.append(f"{'L' if pen_down else 'M'}{a:.1f} {b:.1f}")
            pen_down = is_known
        return self.add(f'<path class="line {css}" d="{"".join(path)}"/>')

    def area(self, x: Array, low: Array, high: Array, css: str) -> Self:
        """The area between two lines."""
        known = np.isfinite(low) & np.isfinite(high)
        if not known.any():
            return self
        px = self.x(x[known])
        there = [f"{a:.1f} {b:.1f}" for a, b in zip(px, self.y(high[known]), strict=True)]
        back = [f"{a:.1f} {b:.1f}" for a, b in zip(px[::-1], self.y(low[known])[::-1], strict=True)]
        return self.add(f'<path class="area {css}" d="M{"L".join(there + back)}Z"/>')

    def dots(self, x: Array, y: Array, css: str, radius: float = 1.8) -> Self:
        """One dot a point, as a single path, so that thousands stay light."""
        r = f"{radius:.1f}"
        pairs = zip(self.x(x).tolist(), self.y(y).tolist(), strict=True)
        path = "".join(f"M{a - radius:.1f} {b:.1f}a{r} {r} 0 1 0 {2 * radius:.1f} 0a{r} {r} 0 1 0 -{2 * radius:.1f} 0"
                       for a, b in pairs)  # fmt: skip
        return self.add(f'<path class="dots {css}" d="{path}"/>')

    def bars(self, left: Array, right: Array, height: Array, css: str) -> Self:
        """Upright bars from the lower edge."""
        base = float(self.y(self.y.low))
        for a, b, top in zip(self.x(left), self.x(right), self.y(height), strict=True):
            width, tall = max(b - a - 1.0, 0.5), max(base - top, 0.0)
            box = f'x="{a + 0.5:.1f}" y="{top:.1f}" width="{width:.1f}" height="{tall:.1f}"'
            self.add(f'<rect class="bar {css}" {box}/>')
        return self

    def band(self, left: float, right: float, css: str, tip: str) -> Self:
        """A shaded part of the x axis, with a tip to hover."""
        a, b = float(self.x(left)), float(self.x(right))
        top, base = self.y.end, self.y.start
        box = f'x="{a:.1f}" y="{top:.1f}" width="{max(b - a, 0.0):.1f}" height="{base - top:.1f}"'
        return self.add(f'<rect class="band {css}" {box}><title>{escape(tip)}</title></rect>')

    def rule(self, *, x: float | None = None, y: float | None = None, css: str = "rule", text: str = "") -> Self:
        """A straight line across the frame, with a word beside it."""
        x1, x2 = (self.x.start, self.x.end) if x is None else (float(self.x(x)),) * 2
        y1, y2 = (self.y.start, self.y.end) if y is None else (float(self.y(y)),) * 2
        self.add(f'<line class="{css}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>')
        if text and x is not None:
            self.add(f'<text class="note" x="{x1 + 4:.1f}" y="{self.y.end + 11:.1f}">{escape(text)}</text>')
        elif text:
            self.add(f'<text class="note end" x="{x2 - 2:.1f}" y="{y1 - 4:.1f}">{escape(text)}</text>')
        return self

    def text(self, x: float, y: float, words: str, css: str = "note") -> Self:
        """Words at a point of the plot."""
        place = f'x="{float(self.x(x)):.1f}" y="{float(self.y(y)):.1f}"'
        return self.add(f'<text class="{css}" {place}>{escape(words)}</text>')

    def add(self, element: str) -> Self:
        """Any SVG element in pixels."""
        self._marks.append(element)
        return self

    def svg(self) -> str:
        """The picture."""
        clip = f"clip{zlib.crc32((self.title + ''.join(self._marks)).encode()):08x}"
        width, height = self.x.end - self.x.start, self.y.start - self.y.end
        box = f'x="{self.x.start:.1f}" y="{self.y.end:.1f}" width="{width:.1f}" height="{height:.1f}"'
        return "".join(
            [
                f'<svg viewBox="0 0 {self.width:g} {self.height:g}" role="img" aria-label="{escape(self.title)}">',
                f'<clipPath id="{clip}"><rect {box}/></clipPath>',
                *self._frame(),
                f'<g clip-path="url(#{clip})">',
                *self._marks,
                "</g></svg>",
            ]
        )

    def _frame(self) -> Sequence[str]:
        """Grid, ticks and names of the axes."""
        base, right = self.y.start, self.x.end
        parts = []
        for tick in self.x.ticks:
            at = float(self.x(tick))
            parts.append(f'<line class="gridline" x1="{at:.1f}" y1="{self.y.end:.1f}" x2="{at:.1f}" y2="{base:.1f}"/>')
            parts.append(f'<text class="tick mid" x="{at:.1f}" y="{base + 15:.1f}">{tick_text(tick)}</text>')
        for tick, label in self.y_ticks or [(tick, tick_text(tick)) for tick in self.y.ticks]:
            at = float(self.y(tick))
            parts.append(f'<line class="gridline" x1="{self.left:.1f}" y1="{at:.1f}" x2="{right:.1f}" y2="{at:.1f}"/>')
            parts.append(f'<text class="tick end" x="{self.left - 6:.1f}" y="{at + 3.5:.1f}">{escape(label)}</text>')
        middle = (self.left + right) / 2.0
        parts.append(f'<text class="axis mid" x="{middle:.1f}" y="{self.height - 6:.1f}">{escape(self.x_label)}</text>')
        if self.y_label:
            turn = (base + self.y.end) / 2.0
            place = f'x="{-turn:.1f}" y="13" transform="rotate(-90)"'
            parts.append(f'<text class="axis mid" {place}>{escape(self.y_label)}</text>')
        return parts
