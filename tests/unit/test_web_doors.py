"""Who may come in, and which map layers are taken."""

from __future__ import annotations

import pytest

from aeroskein_service.web.doors import POLICY, Doors
from aeroskein_service.web.layers import LayerError, LayerFiles

OWN = {"host": "127.0.0.1:8080"}


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_loopback_names_are_known_on_loopback(host):
    assert Doors("127.0.0.1").knows_host({"host": host})


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8080", "", "10.0.0.5:8080"])
def test_other_names_are_not_known_on_loopback(host):
    assert not Doors("127.0.0.1").knows_host({"host": host})


def test_any_name_is_known_to_who_listens_for_others():
    assert Doors("0.0.0.0").knows_host({"host": "tower.example:8080"})


def test_program_without_origin_may_come():
    assert Doors("127.0.0.1").knows_origin(OWN)


@pytest.mark.parametrize("origin", ["http://127.0.0.1:8080", "HTTP://127.0.0.1:8080"])
def test_own_page_may_come(origin):
    assert Doors("127.0.0.1").knows_origin(OWN | {"origin": origin})


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:9090", "file://127.0.0.1:8080", "http://127.0.0.1:8080.evil"],
)
def test_page_of_another_may_not(origin):
    assert not Doors("127.0.0.1").knows_origin(OWN | {"origin": origin})


def test_page_behind_a_proxy_may_come_when_it_is_named():
    doors = Doors("127.0.0.1", ["https://tower.example"])
    headers = {"host": "tower.example", "origin": "https://tower.example"}
    assert doors.knows_host(headers)
    assert doors.knows_origin(headers)


def test_policy_lets_the_page_talk_to_its_own_server_only():
    assert "http" not in POLICY
    assert "default-src 'none'" in POLICY
    assert "unsafe-inline" not in POLICY


def test_layers_keep_their_order_and_names(tmp_path):
    for name in ("routes", "airspace"):
        (tmp_path / f"{name}.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    layers = LayerFiles([tmp_path / "routes.geojson", tmp_path / "airspace.geojson"])
    assert layers.names() == ["routes", "airspace"]
    assert b"FeatureCollection" in layers.content(1)
    assert layers.content(2) is None
    assert layers.content(-1) is None


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"type": "Topology"}', '{"type": 3}', "not json"])
def test_file_that_is_no_geojson_is_one_sentence(tmp_path, content):
    path = tmp_path / "wrong.geojson"
    path.write_text(content)
    with pytest.raises(LayerError, match=r"http\.layers: .*wrong\.geojson is no GeoJSON"):
        LayerFiles([path])


def test_layer_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(LayerError, match="no such file"):
        LayerFiles([tmp_path / "nothing.geojson"])
