"""The basemap: tiles of an archive as they are stored, and a clear word about a file that is none."""

import gzip
from pathlib import Path

import pytest
from dashboard.archives import raster_archive, vector_archive
from dashboard.pageclient import PageClient
from fake_service import FakeFeed
from pmtiles.tile import Compression

from headway.dashboard.app import Features, create_app
from headway.dashboard.basemap import Basemap
from headway.dashboard.broadcast import Broadcaster
from headway.errors import UserError

TILE = gzip.compress(b"a vector tile")


def test_tiles_come_as_they_are_stored_and_nothing_where_there_is_none(tmp_path: Path) -> None:
    basemap = Basemap(vector_archive(tmp_path / "town.pmtiles", TILE, ["roads", "water"]))
    assert basemap.tile(0, 0, 0) == TILE
    assert [basemap.tile(*place) for place in ((1, 0, 0), (0, 1, 0), (0, 0, 7), (40, 0, 0))] == [None] * 4
    assert basemap.headers == {"Content-Type": "application/vnd.mapbox-vector-tile", "Content-Encoding": "gzip"}
    assert basemap.description["type"] == "vector"
    assert basemap.description["layers"] == ["roads", "water"]
    assert basemap.description["bounds"] == [-180, -85, 180, 85]


def test_a_file_that_is_no_basemap_is_refused_in_a_line(tmp_path: Path) -> None:
    other = tmp_path / "notes.txt"
    other.write_bytes(b"not tiles" * 100)
    brotli = vector_archive(tmp_path / "b.pmtiles", TILE, [], Compression.BROTLI)
    empty = tmp_path / "empty"
    empty.touch()
    for file, words in (
        (tmp_path / "absent", "No such file"),
        (other, "not a PMTiles archive"),
        (empty, "not a PMTiles archive"),
        (brotli, "compressed by gzip at most"),
    ):
        with pytest.raises(UserError, match=words) as raised:
            Basemap(file)
        assert "\n" not in str(raised.value)


def test_the_page_serves_the_tiles(tmp_path: Path) -> None:
    basemap = Basemap(raster_archive(tmp_path / "town.pmtiles", (1, 2, 3), [0]))
    client = PageClient(create_app(Broadcaster(FakeFeed(), ["local"]), features=Features(basemap=basemap)))
    assert client.get("/basemap").json()["type"] == "raster"
    assert client.get("/basemap/0/0/0").headers["content-type"] == "image/png"
    assert client.get("/basemap/5/0/0").status_code == 204
    assert PageClient(create_app(Broadcaster(FakeFeed(), ["local"]))).get("/basemap").json() is None
