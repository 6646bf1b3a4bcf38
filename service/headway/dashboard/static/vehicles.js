// Vehicles with events: one for each suspect and site, the worst first. Pure: no document.

import { inForce } from "./handling.js";
import { keyOf, matches } from "./store.js";

/** Metres, and metres per second over one second: a number to sort by. */
export const severity = ({ deviation_m, deviation_mps, sensor }) =>
  Math.max(sensor === "speed" ? 0 : deviation_m ?? 0, sensor === "location" ? 0 : deviation_mps ?? 0);

/** Vehicles of the events that match; `worst` is the event with the largest deviation, of the open ones if there are. */
export function vehiclesOf(store, filter) {
  const found = new Map();
  for (const event of store.events.values()) {
    if (!matches(event, filter)) continue;
    const key = keyOf(event.site, event.suspect);
    const vehicle = found.get(key) ?? { key, site: event.site, id: event.suspect, events: [], open: 0, missing: 0, count: 0,
      first_us: Infinity, last_us: 0, deviation_m: null, deviation_mps: null, kinds: new Set(), worst: null };
    add(vehicle, event, store.stateOf(event) === "open");
    found.set(key, vehicle);
  }
  for (const vehicle of found.values()) {
    const { decision, note } = store.handlings.get(vehicle.key) ?? {};
    vehicle.note = note;
    vehicle.decision = inForce(decision, vehicle.events, (event) => store.stateOf(event) === "open", store.nowUs) ? decision : undefined;
    vehicle.muted = vehicle.decision?.action === "mute";
    vehicle.resolved = vehicle.decision?.action === "resolve";
  }
  return [...found.values()].sort(worseFirst);
}

/** Vehicles of live sites with open events: those that are wrong, those that are only absent, and the muted ones. */
export function openVehicles(store) {
  const open = vehiclesOf(store, {}).filter((vehicle) => vehicle.open && store.isLive(vehicle.site));
  const loud = open.filter(({ muted }) => !muted);
  return {
    faulty: loud.filter((vehicle) => vehicle.open > vehicle.missing), absent: loud.filter((vehicle) => vehicle.open === vehicle.missing),
    muted: open.filter(({ muted }) => muted),
  };
}

function add(vehicle, event, isOpen) {
  vehicle.events.push(event);
  vehicle.open += isOpen ? 1 : 0;
  vehicle.missing += isOpen && event.kind === "miss" ? 1 : 0;
  vehicle.count += event.count;
  vehicle.first_us = Math.min(vehicle.first_us, event.first_us);
  vehicle.last_us = Math.max(vehicle.last_us, event.last_us);
  if (event.sensor !== "speed") vehicle.deviation_m = larger(vehicle.deviation_m, event.deviation_m);
  if (event.sensor !== "location") vehicle.deviation_mps = larger(vehicle.deviation_mps, event.deviation_mps);
  vehicle.kinds.add(event.kind);
  const worst = vehicle.worst;
  if (!worst || isOpen > worst.isOpen || (isOpen === worst.isOpen && severity(event) > severity(worst))) vehicle.worst = { ...event, isOpen };
}

const larger = (a, b) => (a === null || a === undefined ? b : b === null || b === undefined ? a : Math.max(a, b));

function worseFirst(a, b) {
  return a.muted - b.muted || a.resolved - b.resolved || (b.open > 0) - (a.open > 0) || (b.open > b.missing) - (a.open > a.missing) ||
    severity(b) - severity(a) || b.count - a.count || a.key.localeCompare(b.key);
}
