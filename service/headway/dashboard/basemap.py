"""A basemap for the road: a PMTiles archive on disk, of vector or raster tiles."""

from pathlib import Path
from typing import Any, Final

from pmtiles.reader import MmapSource, Reader
from pmtiles.tile import Compression, TileType

from headway.errors import UserError

_MEDIA: Final = {
    TileType.MVT: "application/vnd.mapbox-vector-tile",
    TileType.PNG: "image/png",
    TileType.JPEG: "image/jpeg",
    TileType.WEBP: "image/webp",
}
_ENCODINGS: Final = {Compression.NONE: {}, Compression.GZIP: {"Content-Encoding": "gzip"}}


class Basemap:
    """Reads single tiles of an archive.

    Raises
    ------
    UserError
        The file cannot be read, it is no PMTiles archive, or browsers cannot read its tiles.
    """

    def __init__(self, file: Path) -> None:
        try:
            with file.open("rb") as opened:
                self._reader = Reader(MmapSource(opened))
            header, metadata = self._reader.header(), self._reader.metadata()
        except OSError as error:
            raise UserError(f"basemap {file}: {error.strerror or error}") from None
        except Exception as error:  # noqa: BLE001 - the library has no errors of its own
            raise UserError(f"basemap {file}: not a PMTiles archive of version 3 ({error})") from None
        media, encoding = _MEDIA.get(header["tile_type"]), _ENCODINGS.get(header["tile_compression"])
        if media is None or encoding is None:
            raise UserError(f"basemap {file}: tiles must be MVT, PNG, JPEG or WebP, and compressed by gzip at most")
        self._zooms = range(header["min_zoom"], header["max_zoom"] + 1)
        self.headers: dict[str, str] = {"Content-Type": media} | encoding
        """Headers of a response with a tile."""
        self.description: dict[str, Any] = {
            "type": "vector" if header["tile_type"] is TileType.MVT else "raster",
            "minzoom": header["min_zoom"],
            "maxzoom": header["max_zoom"],
            "bounds": [header[f"{name}_e7"] / 1e7 for name in ("min_lon", "min_lat", "max_lon", "max_lat")],
            "layers": [layer["id"] for layer in metadata.get("vector_layers", [])],
            "attribution": metadata.get("attribution", ""),
        }
        """What the page needs to know of it."""

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile as it is stored; None where there is none."""
        if z not in self._zooms or not (0 <= x < 1 << z and 0 <= y < 1 << z):
            return None
        found: bytes | None = self._reader.get(z, x, y)
        return found
