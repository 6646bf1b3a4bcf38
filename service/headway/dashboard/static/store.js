// What the page knows. Pure: no document, no clock, no network.

const PAIR_TTL_US = 60e6;
const LAPSE_US = 60e6;
const SILENT_US = 4e6;
const SILENT_REPORTS = 2.5;
const FIRST_REPORT_US = 6e6;
const EVENTS_MOST = 2000;
const TRACE_MOST = 90;
const TREND_MOST = 120;
const COPIES_MOST = 30;

export const KINDS = ["short", "noise", "bias", "drift", "miss", "response", "range", "unknown"];
export const STANDINGS = ["normal", "warming", "anomalous", "silent"];

/** Name of an event or of a vehicle among all sites. */
export const keyOf = (site, id) => `${site}/${id}`;

export class Store {
  constructor() {
    this.nowUs = 0;
    this.startedUs = 0;
    this.sites = [];
    this.connection = null;
    this.pairs = new Map(); // "site/follower" -> the newest state, with a short trace of its statistic
    this.events = new Map(); // "site/event_id" -> the event as it is known now
    this.instances = new Map(); // "site/instance" -> health
    this.qualities = new Map(); // "site/vehicle" -> sensor quality
    this.handlings = new Map(); // "site/vehicle" -> {decision, note}, the newest of each
    this.copies = []; // rejected messages, newest first
    this.trends = { scored_hz: [], p99_ms: [] };
  }

  /** Takes in a frame; returns the events that it changed. */
  take(frame) {
    this.nowUs = frame.now_us;
    this.startedUs ||= frame.now_us;
    this.sites = frame.sites;
    this.connection = frame.connection;
    const { columns, rows } = frame.pairs;
    for (const row of rows) this.#pair(columns, row);
    for (const [key, pair] of this.pairs) {
      if (pair.received_us > this.nowUs - PAIR_TTL_US) break; // the stalest come first
      this.pairs.delete(key);
      this.qualities.delete(key);
    }
    for (const quality of frame.qualities) this.qualities.set(keyOf(quality.site, quality.vehicle), quality);
    for (const handling of frame.handlings) this.#handling(handling);
    for (const health of frame.instances) this.instances.set(keyOf(health.site, health.instance), health);
    if (frame.instances.length) this.#trend();
    if (frame.copies.length) this.copies = [...frame.copies.reverse(), ...this.copies].slice(0, COPIES_MOST);
    return frame.events.map((event) => this.put(event));
  }

  /** Keeps an event, live or from the history, unless a newer state of it is known; returns what is known. */
  put(event) {
    const key = keyOf(event.site, event.event_id), known = this.events.get(key);
    if (known && (known.last_us > event.last_us || (known.last_us === event.last_us && known.updates > event.updates))) return known;
    const kept = { ...event, key, first_us: Math.min(event.first_us, known?.first_us ?? event.first_us) };
    this.events.delete(key);
    this.events.set(key, kept);
    if (this.events.size > EVENTS_MOST) this.events.delete(this.events.keys().next().value);
    return kept;
  }

  /** "open", "cleared", or "lapsed" where the last update came long ago. */
  stateOf(event) {
    if (event.phase === "cleared") return "cleared";
    return this.nowUs - event.last_us > LAPSE_US ? "lapsed" : "open";
  }

  /** The same for people: an open event of a silent site may have ended since. */
  stateShown(event) {
    const state = this.stateOf(event);
    return state === "open" && !this.isLive(event.site) ? "not known" : state;
  }

  isLive(site) {
    return this.siteState(site).state !== "silent";
  }

  eventsNewestFirst(filter) {
    const wanted = [...this.events.values()].filter((event) => matches(event, filter));
    return wanted.sort((a, b) => b.first_us - a.first_us);
  }

  /** How long an instance has been silent beyond its own interval; 0 while it reports. */
  silentUs(health) {
    const silent_us = this.nowUs - health.received_us;
    return silent_us > Math.max(SILENT_US, SILENT_REPORTS * health.interval_us) ? silent_us : 0;
  }

  instancesOf(site) {
    return [...this.instances.values()].filter((health) => !site || health.site === site);
  }

  /** A site is "live", "waiting" for its first report, "starting", or "silent" with the time since its last report. */
  siteState(site) {
    const instances = this.instancesOf(site);
    const live = instances.filter((health) => !this.silentUs(health));
    if (live.some(({ ready }) => ready)) return { site, state: "live", missing: instances.length - live.length };
    if (live.length) return { site, state: "starting" };
    if (instances.length) return { site, state: "silent", silent_us: Math.min(...instances.map((health) => this.silentUs(health))) };
    const waited_us = this.nowUs - this.startedUs;
    return waited_us < FIRST_REPORT_US ? { site, state: "waiting" } : { site, state: "silent", silent_us: null };
  }

  /** Marks the pairs that the filter shows; those of a silent site are old, so never. */
  markShown(filter) {
    const live = new Set(this.sites.filter((site) => this.isLive(site)));
    const suspects = new Set();
    if (filter.kind) {
      for (const event of this.events.values()) {
        if (event.kind === filter.kind && this.stateOf(event) === "open") suspects.add(keyOf(event.site, event.suspect));
      }
    }
    for (const pair of this.pairs.values()) {
      pair.shown = live.has(pair.site) && (!filter.site || pair.site === filter.site) &&
        (!filter.vehicle || pair.follower.includes(filter.vehicle)) && (!filter.kind || suspects.has(pair.key));
    }
  }

  shownPairs() {
    return [...this.pairs.values()].filter((pair) => pair.shown);
  }

  /** Sums over the instances that report, of the site or of all. */
  totals({ site }) {
    const sum = { instances: 0, vehicles: 0, pairs: 0, capacity: 0, queue_depth: 0, queue_limit: 0, since_us: Infinity,
      rates_hz: {}, rejected: {}, lost: {}, latency_ms: {} };
    for (const health of this.instancesOf(site)) {
      if (this.silentUs(health)) continue;
      sum.instances += 1;
      sum.since_us = Math.min(sum.since_us, health.t_us - 1e6 * health.uptime_s);
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
    const key = keyOf(state.site, state.follower);
    const before = this.pairs.get(key);
    const trace = before?.trace ?? [];
    if (state.statistic !== null && trace.at(-1)?.[0] !== state.t_us) trace.push([state.t_us, state.statistic, state.gate]);
    if (trace.length > TRACE_MOST) trace.shift();
    this.pairs.delete(key);
    this.pairs.set(key, Object.assign(before ?? {}, state, { key, trace, received_us: this.nowUs }));
  }

  #handling(handling) {
    const key = keyOf(handling.site, handling.vehicle);
    this.handlings.set(key, { ...this.handlings.get(key), [handling.action === "note" ? "note" : "decision"]: handling });
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

/** Whether an event is of the filter's site, kind, vehicle (a part of an id is enough) and chosen suspect. */
export function matches(event, { site, kind, vehicle, suspect }) {
  return (!site || event.site === site) && (!kind || event.kind === kind) &&
    (!suspect || keyOf(event.site, event.suspect) === suspect) &&
    (!vehicle || [event.suspect, event.follower, event.leader].some((id) => id?.includes(vehicle)));
}
