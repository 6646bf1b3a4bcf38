// Where things are on the canvas. Pure: metres east and north in, pixels out.

const EARTH_M = 6371008.8;
const RADIAN = Math.PI / 180;
const ELONGATED = 3;
const SPAN_LEAST_M = 120;
const MARGIN_PX = 32;
const ROW_LEAST_PX = 52;

/** A local plane around a first point: good to a few metres over tens of kilometres, which is a picture's need. */
export class Plane {
  constructor(lat, lon) {
    this.lat = lat;
    this.lon = lon;
    this.eastPerDegree = EARTH_M * RADIAN * Math.cos(lat * RADIAN);
    this.northPerDegree = EARTH_M * RADIAN;
  }

  at(lat, lon) {
    return [(lon - this.lon) * this.eastPerDegree, (lat - this.lat) * this.northPerDegree];
  }
}

/** Angle that lays a long road along the screen, 0 for a cloud that has no direction. */
export function roadAngle(points) {
  let e = 0, n = 0, ee = 0, nn = 0, en = 0;
  for (const [x, y] of points) { e += x; n += y; }
  e /= points.length;
  n /= points.length;
  for (const [x, y] of points) { ee += (x - e) ** 2; nn += (y - n) ** 2; en += (x - e) * (y - n); }
  const spread = Math.hypot((ee - nn) / 2, en), middle = (ee + nn) / 2;
  if (middle + spread < ELONGATED ** 2 * Math.max(middle - spread, 1e-9)) return 0;
  return Math.atan2(2 * en, ee - nn) / 2;
}

/**
 * Turned by `angle`, scaled about a centre; `scale` is pixels per metre. A long straight road is folded into `rows`, read
 * like lines of text; whoever pans or zooms unfolds it.
 */
export class View {
  constructor() {
    Object.assign(this, { east: 0, north: 0, scale: 1, width: 1, height: 1 });
    this.#turn(0);
    this.unfold();
  }

  /** Pixels of a place, as [x, y, row]. */
  at(e, n) {
    const along = (e - this.east) * this.cos + (n - this.north) * this.sin;
    const up = ((n - this.north) * this.cos - (e - this.east) * this.sin) * this.scale;
    if (this.rows === 1) return [this.width / 2 + along * this.scale, this.height / 2 - up, 0];
    const into = along / this.rowLength + this.rows / 2, row = Math.min(Math.max(Math.floor(into), 0), this.rows - 1);
    return [MARGIN_PX + (into - row) * this.rowLength * this.scale, (row + 0.5) * (this.height / this.rows) - up, row];
  }

  /** Shows the points, less the few far out: one wrong position does not shrink the road. */
  fit(points, mayFold = true) {
    if (points.length === 0) return;
    this.#turn(roadAngle(points));
    const [a0, a1] = extent(points.map(([e, n]) => e * this.cos + n * this.sin));
    const [c0, c1] = extent(points.map(([e, n]) => n * this.cos - e * this.sin));
    const length = Math.max(a1 - a0, SPAN_LEAST_M), breadth = Math.max(c1 - c0, SPAN_LEAST_M / 4);
    const a = (a0 + a1) / 2, c = (c0 + c1) / 2;
    this.east = a * this.cos - c * this.sin;
    this.north = a * this.sin + c * this.cos;
    const scale = (rows) => Math.min((this.width - 2 * MARGIN_PX) / (length / rows),
      (this.height / rows - (rows > 1 ? 24 : 2 * MARGIN_PX)) / breadth);
    this.rows = 1;
    const most = this.angle === 0 || !mayFold ? 1 : Math.floor(this.height / ROW_LEAST_PX);
    for (let rows = 2; rows <= most; rows++) if (scale(rows) > scale(this.rows) * 1.05) this.rows = rows;
    this.scale = scale(this.rows);
    this.rowLength = length / this.rows;
  }

  unfold() {
    this.rows = 1;
  }

  pan(dx, dy) {
    this.unfold();
    this.east -= (dx * this.cos + dy * this.sin) / this.scale;
    this.north -= (dx * this.sin - dy * this.cos) / this.scale;
  }

  /** Keeps the place under the pixel (x, y). */
  zoom(factor, x, y) {
    const dx = x - this.width / 2, dy = y - this.height / 2;
    this.pan(-dx, -dy);
    this.scale = Math.min(Math.max(this.scale * factor, 1e-3), 60);
    this.pan(dx, dy);
  }

  #turn(angle) {
    this.angle = angle;
    this.cos = Math.cos(angle);
    this.sin = Math.sin(angle);
  }
}

/** Least and most, where those beyond the middle 96 % by more than a quarter of its span do not count. */
function extent(values) {
  values.sort((a, b) => a - b);
  const cut = Math.floor(values.length * 0.02), low = values[cut], high = values[values.length - 1 - cut];
  const reach = Math.max((high - low) / 4, SPAN_LEAST_M);
  return [Math.max(values[0], low - reach), Math.min(values.at(-1), high + reach)];
}
