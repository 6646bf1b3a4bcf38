// The map below the vehicles, by MapLibre GL: the road as driven and, if the dashboard has one, a basemap. Loaded when opened.

import { el } from "./dom.js";

const LIBRARY = "/static/vendor/maplibre/maplibre-gl";
const TILE_PX = 512;
const ROAD_MS = 2000;
/** Names of what draws WebGL by the processor: in Chromium, in Mesa, and in Windows. */
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const KINDS = [
  [/water|ocean/, "fill", "map-water"], [/earth|^land$/, "fill", "map-land"], [/land|park|green/, "fill", "map-green"], [/building/, "fill", "map-building"],
  [/road|transport|street|highway/, "line", "map-road"], [/bound/, "line", "line"],
];

export class Ground {
  #map; #seen = ""; #paths; #drawn = -1; #drawnMs = -ROAD_MS; #base;

  constructor(map, paths, base, isSlow) {
    this.#map = map;
    this.#paths = paths;
    this.#base = base;
    /** Whether the processor draws it: each change of the view costs more than a frame. */
    this.isSlow = isSlow;
  }

  /** Opens the map in `node`. Fails with a sentence where the canvas alone is better: without WebGL, or where it is slow and shows no more. */
  static async open(node, paths) {
    const drawnBy = renderer(), isSlow = BY_PROCESSOR.test(drawnBy);
    if (!drawnBy) throw new Error("No WebGL in this browser: the road is drawn without a map.");
    const base = await fetch("/basemap").then((answer) => answer.json());
    if (isSlow && !base) throw new Error("No graphics card draws WebGL here, and there is no basemap: the road is drawn without a map.");
    document.head.append(el("link", { rel: "stylesheet", href: `${LIBRARY}.css` }));
    const { Map: GlMap } = await import(`${LIBRARY}.mjs`);
    const map = new GlMap({ container: node, style: styleOf(base), interactive: false, attributionControl: false, fadeDuration: 0, maxZoom: 24 });
    await map.once("load");
    return new Ground(map, paths, base, isSlow);
  }

  get attribution() {
    return this.#base?.attribution ?? "";
  }

  /** Shows what a view shows, and the road anew when there is more of it. */
  follow(view, plane, site, nowMs) {
    const lon = plane.lon + view.east / plane.eastPerDegree, lat = plane.lat + view.north / plane.northPerDegree;
    const camera = { center: [lon, lat], zoom: Math.log2((360 * view.scale * plane.eastPerDegree) / TILE_PX), bearing: (-view.angle * 180) / Math.PI };
    const seen = JSON.stringify([camera, view.width, view.height]);
    if (seen !== this.#seen) this.#map.jumpTo(camera);
    this.#seen = seen;
    if (this.#paths.changes !== this.#drawn && nowMs - this.#drawnMs > ROAD_MS) this.#road(plane, site, nowMs);
  }

  recolour() {
    this.#map.setStyle(styleOf(this.#base));
    this.#drawn = -1;
  }

  resize() {
    this.#map.resize();
    this.#seen = "";
  }

  close() {
    this.#map.remove();
  }

  #road(plane, site, nowMs) {
    const place = (e, n) => [plane.lon + e / plane.eastPerDegree, plane.lat + n / plane.northPerDegree];
    const coordinates = this.#paths.of(site).map(([, e0, n0, e1, n1]) => [place(e0, n0), place(e1, n1)]);
    const source = this.#map.getSource("driven");
    if (!source) return; // the style is on its way
    source.setData({ type: "MultiLineString", coordinates });
    this.#drawn = this.#paths.changes;
    this.#drawnMs = nowMs;
  }
}

/** What draws WebGL; empty where nothing does. */
function renderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return "";
  const info = gl.getExtension("WEBGL_debug_renderer_info"), name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

function styleOf(base) {
  const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(`--${name}`).trim();
  const sources = { driven: { type: "geojson", data: { type: "MultiLineString", coordinates: [] } } };
  const layers = [{ id: "ground", type: "background", paint: { "background-color": colour("ground") } }];
  if (base) {
    const { type, minzoom, maxzoom, bounds } = base;
    sources.base = { type, minzoom, maxzoom, bounds, tileSize: type === "raster" ? 256 : TILE_PX, tiles: [`${location.origin}/basemap/{z}/{x}/{y}`] };
    layers.push(...(type === "raster" ? [{ id: "base", type: "raster", source: "base" }] : baseLayers(base, colour)));
  }
  layers.push({ id: "driven", type: "line", source: "driven", layout: { "line-cap": "round" },
    paint: { "line-color": colour("map-driven"), "line-width": ["interpolate", ["exponential", 2], ["zoom"], 13, 2, 19, 16] } });
  return { version: 8, sources, layers };
}

/** One layer for each layer of the tiles whose name says what it is, areas first. */
function baseLayers({ layers }, colour) {
  return KINDS.flatMap(([name, type, look]) => layers.filter((layer) => KINDS.find(([pattern]) => pattern.test(layer))?.[0] === name).map((layer) => ({
    id: `base-${layer}`, type, source: "base", "source-layer": layer,
    ...(type === "fill" ? { filter: ["==", ["geometry-type"], "Polygon"] } : {}),
    paint: type === "fill" ? { "fill-color": colour(look) } : { "line-color": colour(look), "line-width": 1.5 },
  })));
}
