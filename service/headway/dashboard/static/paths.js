// The road as vehicles have driven it: short segments of their paths, each stretch once. Pure: no document.

const STEP_M = 10, JUMP_M = 80;
const CELL_M = 8;
const SEGMENTS_MOST = 8000;

export class Paths {
  #segments = new Map(); // cell and direction -> [site, east, north, east, north]
  changes = 0;

  /** Takes a place where a vehicle was; `last` is the one before that counted, or undefined. Returns the one that counts. */
  add(site, last, east, north) {
    if (!last) return [east, north];
    const [e, n] = last, length = Math.hypot(east - e, north - n);
    if (length < STEP_M) return last;
    if (length > JUMP_M) return [east, north]; // a gap, or a position that cannot be right
    const turn = Math.round(Math.atan2(north - n, east - e) * 4 / Math.PI) & 7;
    const cell = `${site}/${Math.round((e + east) / 2 / CELL_M)}/${Math.round((n + north) / 2 / CELL_M)}/${turn}`;
    if (!this.#segments.has(cell)) {
      this.#segments.set(cell, [site, e, n, east, north]);
      this.changes += 1;
      if (this.#segments.size > SEGMENTS_MOST) this.#segments.delete(this.#segments.keys().next().value);
    }
    return [east, north];
  }

  of(site) {
    return [...this.#segments.values()].filter(([at]) => !site || at === site);
  }
}
