// The readings around one event, what was expected and what is estimated instead. It stays until another is chosen.

import { $, el, number, setText, stamp } from "./dom.js";
import { Charts } from "./chart.js";
import { renderExplanation } from "./explanation.js";
import { qualityText } from "./quality.js";
import { Replay } from "./replay.js";
import { placeChart, readingsOf, spanOfReadings, speedChart, statisticChart } from "./series.js";
import { keyOf } from "./store.js";
import { withUnit } from "./units.js";
import { SENSORS, advice, likelihood, place, sentences } from "./words.js";

export class EvidencePanel {
  #store; #chosen = null; #drawn = null; #asked = 0; #shown = null; #span = null;
  #charts = new Charts($("plots"));
  #replay = new Replay(this.#charts);

  constructor(store) {
    this.#store = store;
    $("fresh").addEventListener("click", () => void this.load());
    $("whole").addEventListener("click", () => this.#view($("whole").getAttribute("aria-pressed") !== "true"));
  }

  /** Key of the event. */
  get chosen() {
    return this.#chosen;
  }

  choose(key) {
    if (key === this.#chosen) return;
    this.#chosen = key;
    this.#drawn = null;
    this.#shown = null;
    this.#charts.clear();
    $("facts").replaceChildren();
    $("details").hidden = $("replay").hidden = $("whole").hidden = true;
    $("whole").setAttribute("aria-pressed", "false");
    this.render();
    if (key) void this.load();
  }

  /** Writes what is known of the event now; the readings stay as they were drawn. */
  render() {
    const event = this.#store.events.get(this.#chosen);
    $("evidence").dataset.event = event?.event_id ?? "";
    if (!event) {
      setText($("evidence-of"), "");
      setText($("verdict"), "Choose a vehicle or an alert to see the readings around it.");
      setText($("advice"), "");
      $("fresh").hidden = true;
      return;
    }
    const ended = this.#store.stateOf(event) === "cleared" ? ` Over since ${stamp(event.last_us)}.` : "";
    setText($("evidence-of"), `${event.suspect} · ${event.kind}, ${SENSORS[event.sensor]} · ${place(event)} · ${event.site}`);
    setText($("verdict"), sentences(event).join(" ") + ended);
    setText($("advice"), advice(event));
    const fresh = this.#drawn === null ? 0 : event.updates - this.#drawn;
    $("fresh").hidden = fresh <= 0;
    setText($("fresh"), `${fresh} new`);
  }

  /** Fetches the updates of the event and draws their readings, then the estimate with each of them. */
  async load() {
    const event = this.#store.events.get(this.#chosen), asked = ++this.#asked;
    if (!event) return;
    const address = `/event/${encodeURIComponent(event.event_id)}`, site = `?site=${encodeURIComponent(event.site)}`;
    const isLate = () => asked !== this.#asked || event.key !== this.#chosen;
    const answer = await fetch(address + site).catch(() => null);
    if (isLate()) return;
    if (!answer?.ok) {
      this.#charts.say(answer ? "The readings are not stored any more." : "No contact with the dashboard.");
      return;
    }
    const updates = await answer.json(), known = this.#store.events.get(event.key) ?? event;
    this.#drawn = Math.max(updates.length, known.updates);
    this.#draw(known, updates, []);
    this.render();
    renderExplanation(null);
    const explained = await fetch(`${address}/explanation${site}`).then((found) => (found.ok ? found.json() : null), () => null);
    if (isLate()) return;
    renderExplanation(explained);
    if (explained?.estimates.length) this.#draw(known, updates, explained.estimates);
    $("evidence").dataset.explained = event.event_id;
  }

  /** Draws the same again, in other colours or units. */
  redraw() {
    if (this.#shown) this.#draw(...this.#shown);
  }

  /** Shows the charts over the whole event, or over the readings at its begin. */
  #view(whole) {
    $("whole").setAttribute("aria-pressed", String(whole));
    this.#charts.view(whole ? null : this.#span);
  }

  #draw(event, updates, estimates) {
    this.#shown = [event, updates, estimates];
    const parts = { readings: readingsOf(updates), updates, estimates, zero_s: updates[0].t_us / 1e6,
      pair: this.#store.pairs.get(`${event.site}/${event.follower}`) };
    if (parts.readings.length) this.#charts.show([speedChart(parts), placeChart(parts), statisticChart(parts)]);
    else this.#charts.say("There is no reading to show.");
    this.#span = spanOfReadings(parts);
    $("whole").hidden = this.#span === null;
    if (this.#span) this.#view($("whole").getAttribute("aria-pressed") === "true");
    this.#replay.open(parts);
    $("details").hidden = false;
    $("facts").replaceChildren(...Object.entries(facts(event, updates, this.#store)).map(([name, value]) =>
      el("div", {}, el("dt", {}, name), el("dd", {}, value))));
  }
}

function facts(event, updates, store) {
  const newest = updates.findLast(({ statistic }) => statistic !== null) ?? updates.at(-1);
  const sure = event.confidence === null ? "–" : `${Math.round(event.confidence * 100)} % for ${event.kind} in ${SENSORS[event.sensor]}`;
  const quality = store.qualities.get(keyOf(event.site, event.suspect));
  return {
    leader: event.leader ?? "free road",
    "gap now": withUnit("length", store.pairs.get(keyOf(event.site, event.follower))?.gap_m, number),
    sensors: quality ? qualityText(quality) : "–",
    "highest statistic": `${number(event.statistic)}, gate ${number(event.gate)}`,
    "something is wrong": `${likelihood(event.p_value) || "–"}, p-value ${number(event.p_value)}`,
    "this kind and sensor": sure,
    "nis, newest": number(newest.nis),
    "latency": latency(newest.latency_us),
    limits: newest.observations.join(", ") || "kept",
    model: newest.model,
    configuration: newest.config_hash,
    updates: String(updates.length),
    event: event.event_id,
  };
}

/** Durations by stage; that on the wire spans two clocks, so it may be negative and is then no latency. */
function latency(latency_us) {
  const stages = Object.entries(latency_us).filter(([, us]) => us >= 0).map(([stage, us]) => `${stage} ${number(us / 1000)} ms`);
  if (latency_us.wire < 0) stages.unshift(`clock of the sender ahead by ${number(-latency_us.wire / 1000)} ms`);
  return stages.join(", ") || "–";
}
