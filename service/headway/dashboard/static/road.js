// The road: every vehicle where it says it is, coloured by how its newest reading was judged.

import { $, number, setText } from "./dom.js";
import { DrivenRoad } from "./driven.js";
import { STANDINGS } from "./store.js";
import { Paths } from "./paths.js";
import { FOOT_M, inFeet, withUnit } from "./units.js";
import { Plane, View } from "./view.js";

const EASE_S = 0.18;
const COAST_S = 1.5;
const SLOW_MAP_MS = 100;
const LABELS_MOST = 24;
const PICK_PX = 14;
const APART_M = 5000;
const CENTRED_SCALE = 2;
const OFFSET_LEAST_M = 1;
const still = matchMedia("(prefers-reduced-motion: reduce)");

export class Road {
  #canvas; #pen; #store; #tip; #colours = {};
  #view = new View();
  #plane = null;
  #following = true;
  #drawnMs = 0;
  #fittedMs = 0;
  #movedMs = 0;
  #pointer = null;
  #filter = {};
  #paths = new Paths();
  #driven = new DrivenRoad();
  #ground = null;
  #site = null;
  #centred = null;

  /** `choose` is called with the vehicle that was clicked. */
  constructor(canvas, tip, store, choose) {
    this.#canvas = canvas;
    this.#pen = canvas.getContext("2d");
    this.#tip = tip;
    this.#store = store;
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#listen(choose);
    this.recolour();
    requestAnimationFrame((ms) => this.#frame(ms));
  }

  recolour() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["normal", "warming", "anomalous", "silent", "text", "dim", "line", "ground", "recovered", "map-driven"]) {
      this.#colours[name] = style.getPropertyValue(`--${name}`).trim();
    }
    this.#ground?.recolour();
  }

  fit() {
    this.#following = true;
    this.#centred = null;
    this.#fittedMs = 0;
  }

  /** Keeps a vehicle in the middle, until the view is moved; one that is not shown changes nothing. */
  centre(key) {
    const pair = this.#store.pairs.get(key);
    if (!pair?.shown || pair.shown_e === undefined) return;
    if (this.#canvas.dataset.site) this.#site = pair.site;
    this.#following = false;
    this.#centred = pair;
    this.#view.unfold();
    this.#view.scale = Math.max(this.#view.scale, CENTRED_SCALE);
  }

  /** Shows one site, or all (empty); null leaves it to where the sites are. */
  showSite(site) {
    this.#site = site;
    this.fit();
  }

  /** Opens the map in `node`, or closes it; returns it if it is open, and fails as `Ground.open` does. */
  async toggleMap(node) {
    const ground = this.#ground;
    this.#ground = null;
    ground?.close();
    if (!ground) {
      const { Ground } = await import("./ground.js");
      this.#ground = await Ground.open(node, this.#paths);
    }
    this.#canvas.dataset.map = String(this.#ground !== null);
    this.#fittedMs = 0;
    return this.#ground;
  }

  filter(filter) {
    if (filter.site !== this.#filter.site) this.showSite(filter.site || null);
    this.#filter = filter;
  }

  /** New states came: where each vehicle is heading for, from now on. */
  received(nowMs) {
    for (const pair of this.#store.pairs.values()) {
      if (pair.placed_us === pair.t_us || pair.lat === null || pair.lon === null) continue;
      this.#plane ??= new Plane(pair.lat, pair.lon);
      [pair.east, pair.north] = this.#plane.at(pair.lat, pair.lon);
      pair.placed_us = pair.t_us;
      pair.placed_ms = nowMs;
      pair.shown_e ??= pair.east;
      pair.shown_n ??= pair.north;
      pair.crumb = this.#paths.add(pair.site, pair.crumb, pair.east, pair.north);
    }
  }

  /** The vehicles of the site that is shown; of sites far apart, one is. */
  #shown() {
    const pairs = [...this.#store.pairs.values()].filter((pair) => pair.shown && pair.shown_e !== undefined);
    const site = this.#site ?? (areApart(pairs) ? pairs[0].site : "");
    const shown = site ? pairs.filter((pair) => pair.site === site) : pairs;
    this.#canvas.dataset.site = site;
    $("road-empty").hidden = shown.length > 0;
    setText($("road-empty"), site ? `No vehicle of ${site}.` : "No vehicle.");
    return shown;
  }

  #frame(ms) {
    requestAnimationFrame((next) => this.#frame(next));
    const elapsed_s = Math.min((ms - this.#drawnMs) / 1000, 0.2);
    this.#drawnMs = ms;
    const pairs = this.#shown();
    for (const pair of pairs) move(pair, ms, elapsed_s);
    if (this.#following && ms - this.#fittedMs > 1000) {
      this.#view.fit(pairs.map((pair) => [pair.shown_e, pair.shown_n]), this.#ground === null);
      this.#fittedMs = ms;
    }
    if (this.#centred && !(this.#centred.shown && this.#store.pairs.has(this.#centred.key))) this.fit();
    if (this.#centred && (!this.#ground?.isSlow || ms - this.#movedMs > SLOW_MAP_MS)) {
      Object.assign(this.#view, { east: this.#centred.shown_e, north: this.#centred.shown_n });
      this.#movedMs = ms;
    }
    this.#canvas.dataset.centred = this.#centred?.key ?? "";
    if (this.#plane) this.#ground?.follow(this.#view, this.#plane, this.#canvas.dataset.site, ms);
    this.#draw(pairs);
    this.#point(pairs);
  }

  #draw(pairs) {
    const pen = this.#pen, view = this.#view, colours = this.#colours;
    pen.clearRect(0, 0, view.width, view.height);
    if (pairs.length === 0) return;
    const groups = Object.fromEntries(STANDINGS.map((standing) => [standing, []]));
    for (const pair of pairs) {
      [pair.px, pair.py, pair.row] = view.at(pair.shown_e, pair.shown_n);
      groups[pair.standing].push(pair);
    }
    this.#rows();
    if (!this.#ground) this.#driven.draw(pen, view, this.#paths, this.#canvas.dataset.site, colours["map-driven"], this.#drawnMs);
    this.#links(pairs.filter((pair) => pair.standing !== "anomalous"), colours.line, 1.5);
    this.#links(groups.anomalous, colours.anomalous, 2);
    const size = Math.min(Math.max(view.scale * 3, 3.5), 9);
    for (const standing of STANDINGS) {
      pen.beginPath();
      for (const pair of groups[standing]) arrow(pen, pair, view.angle, standing === "anomalous" ? size + 2 : size);
      pen.fillStyle = pen.strokeStyle = colours[standing];
      pen.lineWidth = 1.5;
      if (standing === "silent") pen.stroke();
      else pen.fill();
    }
    rings(pen, groups.anomalous, size + 7, colours.anomalous);
    this.#estimates(groups.anomalous, size);
    if (this.#centred) rings(pen, [this.#centred], size + 11, colours.text);
    this.#labels(pairs, groups.anomalous);
    this.#scaleBar();
    this.#compass();
  }

  #rows() {
    const pen = this.#pen, { rows, width, height } = this.#view;
    pen.strokeStyle = this.#colours.line;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let row = 1; row < rows; row++) {
      pen.moveTo(0, (row * height) / rows);
      pen.lineTo(width, (row * height) / rows);
    }
    pen.stroke();
  }

  /** Where anomalous vehicles are by the estimate, if that is elsewhere than they say. */
  #estimates(anomalous, size) {
    const pen = this.#pen, view = this.#view;
    pen.beginPath();
    for (const pair of anomalous) {
      if (Math.abs(pair.offset_m ?? 0) < OFFSET_LEAST_M || pair.heading_deg === null) continue;
      const heading = (pair.heading_deg * Math.PI) / 180;
      const [px, py, row] = view.at(pair.shown_e - pair.offset_m * Math.sin(heading), pair.shown_n - pair.offset_m * Math.cos(heading));
      if (row === pair.row) {
        pen.moveTo(pair.px, pair.py);
        pen.lineTo(px, py);
      }
      arrow(pen, { ...pair, px, py }, view.angle, size + 1);
    }
    pen.strokeStyle = this.#colours.recovered;
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  #links(followers, colour, width) {
    const pen = this.#pen;
    pen.beginPath();
    for (const pair of followers) {
      const leader = pair.leader && this.#store.pairs.get(`${pair.site}/${pair.leader}`);
      if (leader?.px === undefined || leader.row !== pair.row) continue;
      pen.moveTo(pair.px, pair.py);
      pen.lineTo(leader.px, leader.py);
    }
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
  }

  #labels(pairs, anomalous) {
    const pen = this.#pen, { vehicle } = this.#filter;
    const named = vehicle ? pairs.filter((pair) => pair.follower.includes(vehicle)) : [...anomalous];
    if (this.#centred) named.unshift(this.#centred);
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    pen.textAlign = "center";
    pen.lineWidth = 3;
    pen.strokeStyle = this.#colours.ground;
    pen.fillStyle = this.#colours.text;
    const taken = [];
    for (const pair of named) {
      if (taken.length >= LABELS_MOST) break;
      if (taken.some(([x, y]) => Math.abs(x - pair.px) < 70 && Math.abs(y - pair.py) < 14)) continue;
      taken.push([pair.px, pair.py]);
      const above = pair.py > 32 ? -19 : 27;
      pen.strokeText(pair.follower, pair.px, pair.py + above);
      pen.fillText(pair.follower, pair.px, pair.py + above);
    }
  }

  #scaleBar() {
    const pen = this.#pen, view = this.#view;
    const unit_m = inFeet() ? FOOT_M : 1, span = niceBelow(110 / view.scale / unit_m), length = span * unit_m * view.scale, y = view.height - 14;
    pen.strokeStyle = pen.fillStyle = this.#colours.dim;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(14, y - 4);
    pen.lineTo(14, y);
    pen.lineTo(14 + length, y);
    pen.lineTo(14 + length, y - 4);
    pen.stroke();
    pen.textAlign = "left";
    pen.fillText(inFeet() ? `${span} ft` : span >= 1000 ? `${span / 1000} km` : `${span} m`, 18, y - 5);
  }

  #compass() {
    const pen = this.#pen, view = this.#view, x = view.width - 24, y = 26;
    const dx = Math.sin(view.angle), dy = -Math.cos(view.angle);
    pen.beginPath();
    pen.moveTo(x - dx * 9, y - dy * 9);
    pen.lineTo(x + dx * 9, y + dy * 9);
    pen.stroke();
    pen.textAlign = "center";
    pen.fillText("N", x + dx * 16, y + dy * 16 + 4);
  }

  #point(pairs) {
    const near = this.#pointer && nearest(pairs, this.#pointer);
    this.#tip.hidden = !near;
    if (!near) return;
    setText(this.#tip, describe(near));
    const left = Math.min(near.px + 14, this.#view.width - this.#tip.offsetWidth - 4);
    const top = Math.min(near.py + 14, this.#view.height - this.#tip.offsetHeight - 4);
    this.#tip.style.transform = `translate(${left}px, ${top}px)`;
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    this.#canvas.width = width * devicePixelRatio;
    this.#canvas.height = height * devicePixelRatio;
    this.#pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    Object.assign(this.#view, { width, height });
    this.#ground?.resize();
    this.#fittedMs = 0;
  }

  #listen(choose) {
    const canvas = this.#canvas;
    let pressed = null;
    const free = (act) => { this.#following = false; this.#centred = null; act(); };
    canvas.addEventListener("pointerdown", (event) => {
      pressed = { x: event.offsetX, y: event.offsetY };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      this.#pointer = { x: event.offsetX, y: event.offsetY };
      if (pressed && event.buttons) free(() => this.#view.pan(event.movementX, event.movementY));
    });
    canvas.addEventListener("pointerup", (event) => {
      const moved = pressed && Math.hypot(event.offsetX - pressed.x, event.offsetY - pressed.y) > 4;
      const near = !moved && nearest(this.#shown(), { x: event.offsetX, y: event.offsetY });
      pressed = null;
      if (near) choose(near);
    });
    canvas.addEventListener("pointerleave", () => { this.#pointer = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      free(() => this.#view.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const { width, height } = this.#view;
      const act = {
        ArrowLeft: () => this.#view.pan(60, 0), ArrowRight: () => this.#view.pan(-60, 0),
        ArrowUp: () => this.#view.pan(0, 60), ArrowDown: () => this.#view.pan(0, -60),
        "+": () => this.#view.zoom(1.4, width / 2, height / 2), "-": () => this.#view.zoom(1 / 1.4, width / 2, height / 2),
      }[event.key];
      if (!act) return;
      event.preventDefault();
      free(act);
    });
  }
}

/** Between two states a vehicle coasts on as it went, and the picture follows without a jump. */
function move(pair, ms, elapsed_s) {
  const age_s = Math.min((ms - pair.placed_ms) / 1000, COAST_S);
  const coast_m = pair.heading_deg === null || pair.standing === "silent" ? 0 : (pair.v_mps ?? 0) * Math.max(age_s, 0);
  const heading = (pair.heading_deg ?? 0) * Math.PI / 180;
  const east = pair.east + coast_m * Math.sin(heading), north = pair.north + coast_m * Math.cos(heading);
  const share = still.matches ? 1 : 1 - Math.exp(-elapsed_s / EASE_S);
  pair.shown_e += (east - pair.shown_e) * share;
  pair.shown_n += (north - pair.shown_n) * share;
}

/** Whether the middles of the sites lie further from each other than a picture shows. */
function areApart(pairs) {
  const sums = new Map();
  for (const { site, shown_e, shown_n } of pairs) {
    const [e, n, count] = sums.get(site) ?? [0, 0, 0];
    sums.set(site, [e + shown_e, n + shown_n, count + 1]);
  }
  const middles = [...sums.values()].map(([e, n, count]) => [e / count, n / count]);
  return middles.some(([e, n]) => Math.hypot(e - middles[0][0], n - middles[0][1]) > APART_M);
}

function arrow(pen, pair, angle, size) {
  const turn = (pair.heading_deg ?? 0) * Math.PI / 180 + angle;
  const dx = Math.sin(turn) * size, dy = -Math.cos(turn) * size;
  pen.moveTo(pair.px + dx, pair.py + dy);
  pen.lineTo(pair.px - dx - dy * 0.7, pair.py - dy + dx * 0.7);
  pen.lineTo(pair.px - dx * 0.5, pair.py - dy * 0.5);
  pen.lineTo(pair.px - dx + dy * 0.7, pair.py - dy - dx * 0.7);
  pen.lineTo(pair.px + dx, pair.py + dy);
}

function rings(pen, pairs, radius, colour) {
  pen.beginPath();
  for (const { px, py } of pairs) {
    pen.moveTo(px + radius, py);
    pen.arc(px, py, radius, 0, 2 * Math.PI);
  }
  pen.strokeStyle = colour;
  pen.stroke();
}

function nearest(pairs, { x, y }) {
  let best = null, least = PICK_PX;
  for (const pair of pairs) {
    const distance = Math.hypot(pair.px - x, pair.py - y);
    if (distance < least) [best, least] = [pair, distance];
  }
  return best;
}

function describe(pair) {
  const off = Math.abs(pair.offset_m ?? 0) < OFFSET_LEAST_M ? "" : `\n${withUnit("length", Math.abs(pair.offset_m), number)} ${pair.offset_m > 0 ? "ahead of" : "behind"} the estimate`;
  const behind = pair.leader ? `\n${withUnit("length", pair.gap_m, number)} behind ${pair.leader}` : "\nfree road";
  return `${pair.follower}  ${pair.standing}\n${withUnit("speed", pair.v_mps, number)}${behind}\n` +
    `statistic ${number(pair.statistic)} of ${number(pair.gate)}${off}`;
}

export function niceBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((step) => step * power <= value);
}
