// Figures, alerts and the state of the service.

import { $, clock, count, duration, el, number, setText, svg } from "./dom.js";
import { SENSORS } from "./store.js";

const ALERTS_MOST = 80;
const STALE_US = 5e6;

const TILES = [
  ["vehicles", "Vehicles"], ["scored", "Scored per second", "scored_hz"], ["latency", "Latency p99", "p99_ms"],
  ["open", "Open alerts"], ["rejected", "Rejected"], ["lost", "Lost"], ["queue", "Queue"],
];

/** Makes the tiles; returns what renders them. */
export function tiles(place) {
  const parts = {};
  for (const [key, name, trend] of TILES) {
    const value = el("p", { class: "value" }, "–"), note = el("p", { class: "note" }, " ");
    const path = svg("path", {});
    const spark = svg("svg", { viewBox: "0 0 119 30", preserveAspectRatio: "none", "aria-hidden": "true" }, path);
    const tile = el("div", { class: "tile", id: `tile-${key}` }, el("p", { class: "name" }, name), value, note);
    if (trend) tile.append(spark);
    place.append(tile);
    parts[key] = { tile, value, note, path, trend };
  }
  return (store, filter) => {
    const sum = store.totals(filter), { rates_hz, latency_ms } = sum;
    const some = sum.instances > 0;
    const set = (key, value, note, alarm = false) => {
      setText(parts[key].value, some ? value : "–");
      setText(parts[key].note, some ? note : " ");
      parts[key].tile.classList.toggle("alarm", some && alarm);
    };
    const total = (reasons) => Object.values(reasons).reduce((a, b) => a + b, 0);
    const events = [...store.events.values()].filter((event) => !filter.site || event.site === filter.site);
    const open = events.filter((event) => store.stateOf(event) === "open").length;
    const lost = total(sum.lost);
    set("vehicles", count(sum.vehicles), `${count(sum.pairs)} pairs, room for ${count(sum.capacity)}`);
    set("scored", count(rates_hz.scored), `${count(rates_hz.warming)} warming`);
    set("latency", latency_ms.p99 === undefined ? "–" : `${number(latency_ms.p99)} ms`,
      `p50 ${number(latency_ms.p50)}, max ${number(latency_ms.max)}`);
    set("open", count(open), `${count(events.length)} known`, open > 0);
    set("rejected", count(total(sum.rejected)), `${number(rates_hz.rejected)} per second`);
    set("lost", count(lost), `${number(rates_hz.lost)} per second`, (rates_hz.lost ?? 0) > 0);
    set("queue", count(sum.queue_depth), `of ${count(sum.queue_limit)}`, sum.queue_depth > sum.queue_limit / 2);
    for (const { path, trend } of Object.values(parts)) if (trend) path.setAttribute("d", sparkline(store.trends[trend]));
  };
}

function sparkline(values) {
  if (values.length < 2) return "";
  const most = Math.max(...values, 1e-9);
  return "M" + values.map((v, i) => `${119 - values.length + 1 + i},${(28 - 24 * v / most).toFixed(1)}`).join("L");
}

/** The newest events; rows stay in place while they change, so that focus does. */
export class AlertList {
  #list; #choose; #rows = new Map();

  constructor(list, choose) {
    this.#list = list;
    this.#choose = choose;
  }

  render(store, filter, chosen) {
    const events = store.eventsNewestFirst(filter, ALERTS_MOST);
    const rows = events.map((event) => this.#row(event, store.stateOf(event), event.id === chosen));
    rows.forEach((row, i) => {
      if (this.#list.children[i] !== row) this.#list.insertBefore(row, this.#list.children[i] ?? null);
    });
    const kept = new Set(events.map(({ id }) => id));
    for (const [id, row] of this.#rows) {
      if (kept.has(id)) continue;
      row.remove();
      this.#rows.delete(id);
    }
    return events;
  }

  #row(event, state, current) {
    let row = this.#rows.get(event.id);
    if (!row) {
      row = el("li", {}, el("button", { class: "alert", type: "button", "data-event": event.id },
        el("span", { class: "kind" }), el("span", { class: "who" }), el("span", { class: "small when" }),
        el("span", { class: "small" }), el("span", { class: "small" }), el("span", { class: "small when" })));
      row.firstChild.addEventListener("click", () => this.#choose(event.id));
      this.#rows.set(event.id, row);
    }
    const button = row.firstChild, [kind, who, when, phase, about, ratio] = button.children;
    const { last, first, worst } = event;
    button.dataset.state = kind.dataset.state = state;
    button.setAttribute("aria-current", String(current));
    setText(kind, last.kind);
    setText(who, last.suspect);
    setText(when, clock(first.detected_us));
    setText(phase, state);
    setText(about, `${SENSORS[last.sensor]}${last.leader ? `, behind ${last.leader}` : ", free road"} · ${last.site}`);
    setText(ratio, worst.statistic === null ? "" : `${number(worst.statistic)} / ${number(worst.gate)}`);
    return row;
  }
}

export function renderService(store, filter) {
  const shown = [...store.instances.values()].filter(({ site }) => !filter.site || site === filter.site);
  $("instances").replaceChildren(...(shown.length ? shown.map((health) => instance(health, store.nowUs)) : [none("No instance yet.")]));
  const { rejected, lost } = store.totals(filter);
  $("rejected").replaceChildren(...reasons(rejected));
  $("lost").replaceChildren(...reasons(lost));
  const copies = store.copies.filter(({ site }) => !filter.site || site === filter.site);
  $("copies").replaceChildren(...(copies.length ? copies.map((copy) => el("li", { title: copy.detail },
    `${clock(copy.received_us)} `, el("b", {}, copy.reason), ` ${copy.sender ?? "unknown"}${copy.count > 1 ? ` ×${copy.count}` : ""} ${copy.detail}`))
    : [none("None.")]));
}

function instance(health, nowUs) {
  const silent_us = nowUs - health.t_us, stale = silent_us > STALE_US;
  const state = stale ? `no word for ${duration(silent_us / 1e6)}` : health.ready ? "ready" : "not ready";
  const ms = Object.entries(health.latency_ms).map(([name, value]) => `${name} ${number(value)}`).join(", ");
  return el("div", { class: "instance", "data-ready": String(health.ready && !stale) },
    el("p", { class: "who" }, `${health.instance} · ${health.site} · ${state}`),
    el("p", { class: "small" }, `${health.model} ${health.config_hash}, version ${health.version}, up ${duration(health.uptime_s)}` +
      (health.rss_mb === null ? "" : `, ${number(health.rss_mb)} MB`)),
    el("p", { class: "small" }, `latency ${ms || "–"} ms · queue ${count(health.queue_depth)} of ${count(health.queue_limit)}`));
}

function reasons(counts) {
  const entries = Object.entries(counts).filter(([, n]) => n > 0).sort((a, b) => b[1] - a[1]);
  if (!entries.length) return [none("None.")];
  return entries.map(([reason, n]) => el("div", { class: "reason" }, el("span", {}, reason), el("span", {}, count(n)),
    el("progress", { max: entries[0][1], value: n, "aria-hidden": "true" })));
}

const none = (text) => el("p", { class: "none" }, text);
