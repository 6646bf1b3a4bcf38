// Figures of the sites that report.

import { $, clock, count, el, number, setText, svg } from "./dom.js";

const TILES = [
  ["vehicles", "Vehicles"], ["scored", "Scored per second", "scored_hz"], ["latency", "Latency p99", "p99_ms"],
  ["open", "Open alerts"], ["rejected", "Rejected"], ["lost", "Lost"], ["queue", "Queue"],
];

/** Makes the tiles; returns what renders them. */
export function tiles() {
  const parts = {};
  for (const [key, name, trend] of TILES) {
    const value = el("p", { class: "value" }, "–"), note = el("p", { class: "note" }, " ");
    const path = svg("path", {});
    const spark = svg("svg", { viewBox: "0 0 119 30", preserveAspectRatio: "none", "aria-hidden": "true" }, path);
    const tile = el("div", { class: "tile", id: `tile-${key}` }, el("p", { class: "name" }, name), value, note);
    if (trend) tile.append(spark);
    $("tiles").append(tile);
    parts[key] = { tile, value, note, path, trend };
  }
  return (store, filter, events) => {
    const sum = store.totals(filter), some = sum.instances > 0;
    const set = (key, value, note, alarm = false) => {
      setText(parts[key].value, some ? value : "–");
      setText(parts[key].note, some ? note : "no site reports");
      parts[key].tile.classList.toggle("alarm", some && alarm);
    };
    figures(set, sum, events.filter((event) => store.stateShown(event) === "open").length, events.length);
    if (some && (filter.vehicle || filter.kind)) set("vehicles", count(store.shownPairs().length), "of this filter");
    for (const { path, trend } of Object.values(parts)) if (trend) path.setAttribute("d", sparkline(store.trends[trend]));
  };
}

function figures(set, sum, open, known) {
  const { rates_hz, latency_ms } = sum, since = `since ${clock(sum.since_us)}`;
  const lost = total(sum.lost);
  set("vehicles", count(sum.vehicles), `${count(sum.pairs)} pairs, room for ${count(sum.capacity)}`);
  set("scored", count(rates_hz.scored), `${count(rates_hz.warming)} warming`);
  set("latency", latency_ms.p99 === undefined ? "–" : `${number(latency_ms.p99)} ms`,
    `p50 ${number(latency_ms.p50)}, max ${number(latency_ms.max)}`);
  set("open", count(open), `${count(known)} known`, open > 0);
  set("rejected", count(total(sum.rejected)), `${since}, ${number(rates_hz.rejected)} per s`);
  set("lost", count(lost), `${since}, ${number(rates_hz.lost)} per s`, (rates_hz.lost ?? 0) > 0);
  set("queue", count(sum.queue_depth), `of ${count(sum.queue_limit)}`, sum.queue_depth > sum.queue_limit / 2);
}

const total = (reasons) => Object.values(reasons).reduce((a, b) => a + b, 0);

function sparkline(values) {
  if (values.length < 2) return "";
  const most = Math.max(...values, 1e-9);
  return "M" + values.map((v, i) => `${119 - values.length + 1 + i},${(28 - 24 * v / most).toFixed(1)}`).join("L");
}
