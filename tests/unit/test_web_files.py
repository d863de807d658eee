"""What the page ships: no request outside, no text that becomes code, readable files, and the map it came from."""

from __future__ import annotations

import hashlib
import importlib.util
import re
import struct
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STATIC = ROOT / "service" / "aeroskein_service" / "web" / "static"
SCRIPTS = [STATIC / "start.js", *sorted((STATIC / "js").glob("*.js"))]
PAGES = [*SCRIPTS, *sorted((STATIC / "css").glob("*.css")), STATIC / "index.html"]
# Names of XML kinds, which nobody fetches.
NAMES = ("http://www.w3.org/2000/svg",)


def name(path: Path) -> str:
    return path.name


@pytest.mark.parametrize("path", PAGES, ids=name)
def test_nothing_is_fetched_from_elsewhere(path):
    text = path.read_text(encoding="utf-8")
    for known in NAMES:
        text = text.replace(known, "")
    assert not re.findall(r"https?://|//[a-z]+\.[a-z]", text.replace("${location", ""))


@pytest.mark.parametrize("path", SCRIPTS, ids=name)
def test_no_text_becomes_code_or_html(path):
    text = path.read_text(encoding="utf-8")
    assert not re.findall(r"\beval\(|new Function|innerHTML|outerHTML|insertAdjacentHTML|document\.write", text)
    assert not re.findall(r"setTimeout\(\s*[\"'`]|setInterval\(\s*[\"'`]", text)


@pytest.mark.parametrize("path", SCRIPTS, ids=name)
def test_script_opens_with_what_it_makes_and_fits_on_some_screens(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("// ")
    assert len(lines) < 400


@pytest.mark.parametrize("path", SCRIPTS, ids=name)
def test_every_import_is_a_file_with_that_name_in_it(path):
    text = path.read_text(encoding="utf-8")
    for names, source in re.findall(r"import\s+(?:\{([^}]*)\}|\*\s+as\s+\w+)\s+from\s+\"([^\"]+)\"", text):
        target = (path.parent / source).resolve()
        assert target.is_file(), source
        exported = set(re.findall(r"export (?:class|function|const|async function) (\w+)", target.read_text("utf-8")))
        assert {n.strip().split(" as ")[0] for n in names.split(",") if n.strip()} <= exported, source


def test_page_loads_only_files_that_are_there():
    html = (STATIC / "index.html").read_text(encoding="utf-8")
    for link in re.findall(r"(?:href|src)=\"/static/([^\"]+)\"", html):
        assert (STATIC / link).is_file(), link
    assert "<style" not in html
    assert " style=" not in html
    assert not re.findall(r"<script(?![^>]*src=)", html)
    assert not re.findall(r"\son\w+=", html)


# -- the map -----------------------------------------------------------------------------------------------------------
def converter():
    spec = importlib.util.spec_from_file_location("convert_map", ROOT / "tools" / "convert_map.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# Two squares side by side on a grid of one degree: the edge between them is a border, everything else coast.
TOPOLOGY = {
    "transform": {"scale": [1.0, 1.0], "translate": [-180.0, -90.0]},
    "arcs": [
        [[190, 100], [0, 10]],
        [[190, 110], [-10, 0], [0, -10], [10, 0]],
        [[190, 100], [10, 0], [0, 5], [0, 5], [-10, 0]],
    ],
    "objects": {
        "countries": {
            "type": "GeometryCollection",
            "geometries": [{"type": "Polygon", "arcs": [[0, 1]]}, {"type": "MultiPolygon", "arcs": [[[2, -1]]]}],
        },
        "land": {"type": "GeometryCollection", "geometries": [{"type": "MultiPolygon", "arcs": [[[1, 2]]]}]},
    },
}


class Reader:
    """Reads the map as ``map_file.js`` does."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 52
        self.counts = struct.unpack_from("<III", content, 8)
        self.grid = struct.unpack_from("<dddd", content, 20)

    def number(self) -> int:
        value = shift = 0
        while True:
            byte = self.content[self.at]
            self.at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    @staticmethod
    def unzigzag(value: int) -> int:
        return -(value + 1) // 2 if value % 2 else value // 2

    def arc(self) -> tuple[int, list[tuple[float, float, int]]]:
        kind, n, x, y, points = self.number(), self.number(), 0, 0, []
        for _ in range(n):
            packed = self.number()
            x, y = x + self.unzigzag(packed >> 2), y + self.unzigzag(self.number())
            points.append((self.grid[2] + x * self.grid[0], self.grid[3] + y * self.grid[1], packed & 3))
        return kind, points

    def ring(self) -> list[int]:
        return [self.unzigzag(self.number()) for _ in range(self.number())]


def test_converted_map_has_the_arcs_kinds_and_rings_of_the_topology():
    content = converter().convert(TOPOLOGY)
    reader = Reader(content)
    assert content[:6] == b"ASKM\x01\x03"
    assert reader.counts == (3, 1, 2)
    arcs = [reader.arc() for _ in range(3)]
    assert [kind for kind, _ in arcs] == [1, 0, 0]
    assert [point[:2] for point in arcs[0][1]] == [(10.0, 10.0), (10.0, 20.0)]
    assert [point[:2] for point in arcs[2][1]] == [(10.0, 10.0), (20.0, 10.0), (20.0, 15.0), (20.0, 20.0), (10.0, 20.0)]
    assert reader.ring() == [1, 2]
    assert reader.at == len(content)


def test_vertex_on_a_straight_line_is_needed_for_the_finest_level_only():
    reader = Reader(converter().convert(TOPOLOGY))
    _, _, (_, points) = (reader.arc() for _ in range(3))
    assert [level for *_, level in points] == [0, 0, 2, 0, 0]


def test_shipped_map_is_the_one_that_its_provenance_names():
    content = (STATIC / "map" / "world.bin").read_bytes()
    source = (STATIC / "map" / "SOURCE.md").read_text(encoding="utf-8")
    assert hashlib.sha256(content).hexdigest() in source
    reader = Reader(content)
    arcs, rings, references = reader.counts
    read = [reader.arc() for _ in range(arcs)]
    assert {kind for kind, _ in read} == {0, 1}
    assert all(abs(lon) <= 180.001 and abs(lat) <= 90.001 for _, points in read for lon, lat, _ in points)
    assert sum(len(reader.ring()) for _ in range(rings)) == references
    assert reader.at == len(content)
