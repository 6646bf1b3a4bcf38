// What the page knows. Pure: no document, no clock, no network.

const PAIR_TTL_US = 60e6;
const LAPSE_US = 60e6;
const EVENTS_MOST = 1000;
const UPDATES_MOST = 200;
const TRACE_MOST = 90;
const TREND_MOST = 120;
const COPIES_MOST = 30;

export const KINDS = ["short", "noise", "bias", "drift", "miss", "response", "range", "unknown"];
export const SENSORS = { location: "location", speed: "speed", both: "location and speed", link: "link" };
export const STANDINGS = ["normal", "warming", "anomalous", "silent"];

export class Store {
  constructor() {
    this.nowUs = 0;
    this.sites = [];
    this.connection = null;
    this.pairs = new Map(); // "site/follower" -> the newest state, with a short trace of its statistic
    this.events = new Map(); // event_id -> {id, site, updates, first, last}
    this.instances = new Map(); // "site/instance" -> health
    this.copies = []; // rejected messages, newest first
    this.trends = { scored_hz: [], p99_ms: [] };
  }

  /** Takes in a frame; returns the events that it changed. */
  take(frame) {
    this.nowUs = frame.now_us;
    this.sites = frame.sites;
    this.connection = frame.connection;
    const { columns, rows } = frame.pairs;
    for (const row of rows) this.#pair(columns, row);
    for (const [key, pair] of this.pairs) {
      if (pair.received_us > this.nowUs - PAIR_TTL_US) break; // the stalest come first
      this.pairs.delete(key);
    }
    const changed = new Set(frame.updates.map((update) => this.update(update)));
    for (const health of frame.instances) this.instances.set(`${health.site}/${health.instance}`, health);
    if (frame.instances.length) this.#trend();
    if (frame.copies.length) this.copies = [...frame.copies.reverse(), ...this.copies].slice(0, COPIES_MOST);
    return changed;
  }

  /** Adds one event update, live or from the history; returns its event. */
  update(update) {
    const id = update.event_id;
    let event = this.events.get(id);
    if (!event) {
      event = { id, site: update.site, updates: [] };
      this.events.set(id, event);
      if (this.events.size > EVENTS_MOST) this.events.delete(this.events.keys().next().value);
    }
    const same = (s) => s.detected_us === update.detected_us && s.phase === update.phase;
    if (!event.updates.some(same)) {
      event.updates.push(update);
      event.updates.sort((a, b) => a.detected_us - b.detected_us);
      if (event.updates.length > UPDATES_MOST) event.updates.splice(1, 1); // the onset stays
    }
    event.first = event.updates[0];
    event.last = event.updates.at(-1);
    event.worst = event.updates.reduce((a, b) => ((b.statistic ?? 0) > (a.statistic ?? 0) ? b : a));
    return event;
  }

  /** "open", "cleared", or "lapsed" where the last word came long ago. */
  stateOf(event) {
    if (event.last.phase === "cleared") return "cleared";
    return this.nowUs - event.last.detected_us > LAPSE_US ? "lapsed" : "open";
  }

  eventsNewestFirst(filter, most) {
    const wanted = [...this.events.values()].filter((event) => matches(event.last, filter));
    return wanted.sort((a, b) => b.first.detected_us - a.first.detected_us).slice(0, most);
  }

  /** Sums over the instances of the site, or of all. */
  totals(filter) {
    const sum = { instances: 0, ready: 0, vehicles: 0, pairs: 0, capacity: 0, queue_depth: 0, queue_limit: 0,
      rates_hz: {}, rejected: {}, lost: {}, latency_ms: {} };
    for (const health of this.instances.values()) {
      if (filter.site && health.site !== filter.site) continue;
      sum.instances += 1;
      sum.ready += health.ready ? 1 : 0;
      for (const name of ["vehicles", "pairs", "capacity", "queue_depth", "queue_limit"]) sum[name] += health[name];
      for (const group of ["rates_hz", "rejected", "lost"]) {
        for (const [name, n] of Object.entries(health[group])) sum[group][name] = (sum[group][name] ?? 0) + n;
      }
      for (const [name, ms] of Object.entries(health.latency_ms)) {
        if (ms !== null) sum.latency_ms[name] = Math.max(sum.latency_ms[name] ?? 0, ms);
      }
    }
    return sum;
  }

  #pair(columns, row) {
    const state = {};
    columns.forEach((column, i) => { state[column] = row[i]; });
    const key = `${state.site}/${state.follower}`;
    const before = this.pairs.get(key);
    const trace = before?.trace ?? [];
    if (state.statistic !== null && trace.at(-1)?.[0] !== state.t_us) trace.push([state.t_us, state.statistic, state.gate]);
    if (trace.length > TRACE_MOST) trace.shift();
    this.pairs.delete(key);
    this.pairs.set(key, Object.assign(before ?? {}, state, { key, trace, received_us: this.nowUs }));
  }

  #trend() {
    const { rates_hz, latency_ms } = this.totals({});
    for (const [name, value] of [["scored_hz", rates_hz.scored], ["p99_ms", latency_ms.p99]]) {
      if (value === undefined) continue;
      this.trends[name].push(value);
      if (this.trends[name].length > TREND_MOST) this.trends[name].shift();
    }
  }
}

/** Whether a update is about the filter's site, kind and vehicle; a part of an id will do. */
export function matches(update, { site, kind, vehicle }) {
  return (!site || update.site === site) && (!kind || update.kind === kind) &&
    (!vehicle || [update.suspect, update.follower, update.leader].some((id) => id?.includes(vehicle)));
}
