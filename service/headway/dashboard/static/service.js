// The instances of the service: how each is, and what they rejected and lost.

import { $, clock, count, duration, el, number, setText } from "./dom.js";

export function renderService(store, filter) {
  const shown = store.instancesOf(filter.site);
  $("instances").replaceChildren(...(shown.length ? shown.map((health) => instance(health, store.silentUs(health))) : [none("No instance yet.")]));
  const { rejected, lost, since_us, instances } = store.totals(filter);
  setText($("totals-since"), instances ? `Counted since ${clock(since_us)}.` : "");
  $("rejected").replaceChildren(...reasons(rejected));
  $("lost").replaceChildren(...reasons(lost));
  const copies = store.copies.filter(({ site }) => !filter.site || site === filter.site);
  $("copies").replaceChildren(...(copies.length ? copies.map((copy) => el("li", { title: copy.detail },
    `${clock(copy.received_us)} `, el("b", {}, copy.reason), ` ${copy.sender ?? "unknown"}${copy.count > 1 ? ` ×${copy.count}` : ""} ${copy.detail}`))
    : [el("li", { class: "none" }, "None.")]));
}

function instance(health, silent_us) {
  const state = silent_us ? `silent for ${duration(silent_us / 1e6)}` : health.ready ? "ready" : "not ready";
  const ms = Object.entries(health.latency_ms).map(([name, value]) => `${name} ${number(value)}`).join(", ");
  return el("div", { class: "instance", "data-ready": String(health.ready && !silent_us), "data-silent": String(silent_us > 0) },
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
