"""Small PMTiles archives."""

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

WHOLE = {
    "min_lon_e7": -1_800_000_000,
    "min_lat_e7": -850_000_000,
    "max_lon_e7": 1_800_000_000,
    "max_lat_e7": 850_000_000,
}


def raster_archive(file: Path, colour: tuple[int, int, int], zooms: Sequence[int]) -> Path:
    """Write an archive of one colour everywhere."""
    return _archive(file, _png(colour), TileType.PNG, Compression.NONE, zooms, {"attribution": "drawn for a test"})


def vector_archive(file: Path, tile: bytes, layers: Sequence[str], compression: Compression = Compression.GZIP) -> Path:
    """Write an archive with one tile of these layers, at zoom 0."""
    metadata = {"vector_layers": [{"id": name, "fields": {}} for name in layers]}
    return _archive(file, tile, TileType.MVT, compression, [0], metadata)


def _archive(
    file: Path, tile: bytes, kind: TileType, compression: Compression, zooms: Sequence[int], metadata: dict[str, object]
) -> Path:
    with write(str(file)) as writer:
        for zoom in zooms:
            for offset in range(4**zoom):
                writer.write_tile(zxy_to_tileid(zoom, 0, 0) + offset, tile)
        header = WHOLE | {"tile_type": kind, "tile_compression": compression}
        writer.finalize(header | {"center_zoom": 0, "center_lon_e7": 0, "center_lat_e7": 0}, metadata)
    return file


def _png(colour: tuple[int, int, int], size: int = 256) -> bytes:
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    rows = (b"\0" + bytes(colour) * size) * size
    head = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
