// Events of the past, a page at a time, as the journals answer.

import { $, el, number, setText, stamp } from "./dom.js";

const PAGE = 100;
const RETRY_MS = 5000;

export class History {
  #store; #choose; #filter = {}; #oldest = null; #asked = 0;

  constructor(store, choose) {
    this.#store = store;
    this.#choose = choose;
    $("range").addEventListener("submit", (event) => {
      event.preventDefault();
      this.load(this.#filter);
    });
    $("older").addEventListener("click", () => this.#load(this.#oldest));
  }

  /** Starts over with a filter. */
  load(filter) {
    this.#filter = filter;
    return this.#load(null);
  }

  async #load(before_us) {
    const asked = ++this.#asked;
    const answer = await fetch(`/history?${this.#query(before_us)}`).catch(() => null);
    if (asked !== this.#asked) return;
    if (!answer?.ok) {
      setText($("history-note"), answer ? await answer.text() : "no contact");
      return;
    }
    const { updates, answers, problems } = await answer.json();
    if (before_us === null) $("history").replaceChildren();
    $("history").append(...updates.map((update) => this.#row(update)));
    this.#oldest = updates.at(-1)?.detected_us ?? null;
    $("older").hidden = updates.length < PAGE;
    setText($("history-note"), this.#note(answers, problems));
    if (answers === 0) setTimeout(() => asked === this.#asked && this.load(this.#filter), RETRY_MS);
  }

  #query(before_us) {
    const { site, kind, vehicle } = this.#filter, range = new FormData($("range"));
    const us = (name) => range.get(name) && Date.parse(range.get(name)) * 1000;
    const asked = { phase: "onset", limit: PAGE, site, kind, vehicle, from_us: us("from"), to_us: us("to"), before_us };
    return new URLSearchParams(Object.entries(asked).filter(([, value]) => value));
  }

  #note(answers, problems) {
    const shown = $("history").children.length;
    if (problems.length) return problems.join("; ");
    if (answers === 0) return "No journal answered.";
    if (shown) return `${shown} events`;
    return this.#filter.vehicle ? "Nothing; the vehicle must be a whole id here." : "Nothing.";
  }

  #row(update) {
    const open = el("button", { type: "button", "data-event": update.event_id }, stamp(update.detected_us));
    open.addEventListener("click", () => {
      this.#store.update(update);
      this.#choose(update.event_id);
    });
    const numbers = [number(update.statistic), number(update.gate),
      update.confidence === null ? "–" : `${Math.round(update.confidence * 100)} %`];
    return el("tr", {}, el("td", {}, open),
      ...[update.kind, update.sensor, update.suspect, update.leader ?? "–", update.site].map((text) => el("td", {}, text)),
      ...numbers.map((text) => el("td", { class: "number" }, text)));
  }
}
