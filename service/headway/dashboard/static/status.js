// The status line: whether the road can be trusted, in one sentence. And the line of contact beside it.

import { $, duration, setText } from "./dom.js";
import { openVehicles } from "./vehicles.js";

/** Renders both, and returns the faulty vehicles; `quietMs` is how long the dashboard has sent nothing. */
export function renderStatus(store, quietMs) {
  const [state, text] = quietMs > 0 ? ["blind", `BLIND: no contact with the dashboard for ${duration(quietMs / 1000)}`] : statusOf(store);
  $("status").dataset.state = state;
  setText($("status"), text);
  const [contact, line] = quietMs > 0 ? ["down", "no contact with the dashboard"] : contactOf(store);
  $("line").dataset.state = contact;
  setText($("line"), line);
  document.body.dataset.stale = String(quietMs > 0);
  const { faulty } = openVehicles(store);
  document.title = faulty.length ? `(${faulty.length}) headway` : "headway";
  return faulty;
}

/** "ok", "alarm", "warn", "blind" or "waiting", and what is written. */
export function statusOf(store) {
  if (!store.connection) return ["waiting", "Connecting"];
  if (!store.connection.connected) return ["blind", `BLIND: no contact with the bus of ${store.sites.join(", ")}`];
  const sites = store.sites.map((site) => store.siteState(site));
  const silent = sites.filter(({ state }) => state === "silent");
  const { faulty, absent, muted } = openVehicles(store);
  const parts = [
    silent.length && `BLIND: ${silent.map(silence).join(", ")}`,
    faulty.length && `${cars(faulty.length)} not to be trusted`,
    absent.length && `${cars(absent.length)} silent`,
    muted.length && `${cars(muted.length)} muted`,
  ].filter(Boolean);
  if (parts.length) return [silent.length ? "blind" : faulty.length ? "alarm" : "warn", parts.join(" · ")];
  const unready = sites.filter(({ state }) => state !== "live").map(({ site }) => site);
  if (unready.length) return ["waiting", `Waiting for ${unready.join(", ")}`];
  return store.totals({}).vehicles > 0 ? ["ok", "Road OK"] : ["waiting", "No vehicle on the road"];
}

function contactOf(store) {
  if (!store.connection) return ["down", "connecting"];
  if (!store.connection.connected) return ["down", "dashboard up, no contact with the bus"];
  const sites = store.sites.map((site) => store.siteState(site));
  const silent = sites.filter(({ state }) => state === "silent");
  const { dropped, unreadable } = store.connection;
  const missing = sites.filter((site) => site.missing > 0).map(({ site, missing: n }) => `${n} instance${n > 1 ? "s" : ""} of ${site} silent`);
  const troubles = [...missing, dropped && `${dropped} not shown`, unreadable && `${unreadable} unreadable`].filter(Boolean);
  const live = sites.filter(({ state }) => state === "live").map(({ site }) => site);
  const [state, text] = silent.length ? ["down", silent.map(silence).join(", ")]
    : live.length < sites.length ? ["waiting", "connected, no instance ready yet"]
    : [missing.length ? "waiting" : "up", `live, ${live.join(", ")}`];
  return [state, [text, ...troubles].join(", ")];
}

const silence = ({ site, silent_us }) => (silent_us === null ? `nothing from ${site}` : `${site} silent for ${duration(silent_us / 1e6)}`);

const cars = (n) => `${n} car${n > 1 ? "s" : ""}`;
