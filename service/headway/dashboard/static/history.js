// Events of the past, a page at a time as the journals answer; those that go on, and new ones, follow by themselves.

import { $, clock, el, setText, stamp } from "./dom.js";
import { KeyedList } from "./keyed.js";
import { matches } from "./store.js";
import { SENSORS, deviation, likelihood, place } from "./words.js";

const PAGE = 100;
const RETRY_MS = 5000;
const NONE = "No event matches.";
const UNENDED = new Set(["open", "not known"]);

export class History {
  #store; #rows; #events = new Map(); #filter = {}; #before_us = null; #asked = 0;

  constructor(store, choose) {
    this.#store = store;
    this.#rows = new KeyedList($("history"), ({ key, event_id }) => {
      const open = el("button", { type: "button", "data-event": event_id });
      open.addEventListener("click", () => choose(key));
      return el("tr", {}, el("td", {}, open), ...Array.from({ length: 8 }, (_, i) => el("td", { class: i > 5 ? "number" : null })));
    });
    $("older").addEventListener("click", () => this.#load(this.#before_us));
  }

  get shown() {
    return [...this.#events.values()].sort((a, b) => b.last_us - a.last_us);
  }

  /** Starts over with a filter. */
  load(filter) {
    this.#filter = filter;
    return this.#load(null);
  }

  /** Takes over events that changed. */
  take(changed) {
    const { to_us, from_us } = this.#filter;
    for (const event of changed) {
      if (!matches(event, this.#filter)) this.#events.delete(event.key);
      else if ((!to_us || event.last_us < to_us) && (!from_us || event.last_us >= from_us)) this.#events.set(event.key, event);
    }
    this.#render();
  }

  async #load(before_us) {
    const asked = ++this.#asked, { from_us, to_us } = this.#filter;
    if (from_us && to_us && from_us >= to_us) {
      setText($("history-note"), "This cannot be searched: From is not before To.");
      return;
    }
    const answer = await fetch(`/history?${this.#query(before_us)}`).catch(() => null);
    if (asked !== this.#asked) return;
    if (!answer?.ok) {
      setText($("history-note"), answer ? `This cannot be searched: ${await answer.text()}` : "No contact with the dashboard.");
      return;
    }
    const page = await answer.json();
    if (before_us === null) this.#events.clear();
    for (const event of page.events) {
      const known = this.#store.put(event);
      this.#events.set(known.key, known);
    }
    this.#before_us = page.before_us;
    $("older").hidden = page.before_us === null;
    this.#render();
    setText($("history-note"), this.#note(page));
    if (page.answers === 0) setTimeout(() => asked === this.#asked && this.load(this.#filter), RETRY_MS);
  }

  #render() {
    if (this.#events.size && $("history-note").textContent === NONE) setText($("history-note"), "");
    this.#rows.render(this.shown, (row, event) => {
      const [open, ...cells] = row.children;
      setText(open.firstChild, stamp(event.first_us));
      const state = this.#store.stateShown(event);
      const texts = [UNENDED.has(state) ? state : `until ${clock(event.last_us)}`, event.kind,
        SENSORS[event.sensor], event.suspect, place(event), event.site, deviation(event), likelihood(event.p_value)];
      cells.forEach((cell, i) => setText(cell, texts[i]));
    });
  }

  #query(before_us) {
    const { site, kind, vehicle, from_us, to_us } = this.#filter;
    const asked = { newest: true, limit: PAGE, site, kind, vehicle_part: vehicle, from_us, to_us, before_us };
    return new URLSearchParams(Object.entries(asked).filter(([, value]) => value));
  }

  #note({ answers, problems }) {
    if (problems.length) return problems.join("; ");
    if (answers === 0) return "No journal answered.";
    return this.#events.size ? "" : NONE;
  }
}
