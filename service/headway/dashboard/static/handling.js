// How people handle a vehicle: acknowledge, mute, resolve, note; each is stored by the service, and all pages see it.

import { $, setText, stamp } from "./dom.js";

const DONE = { acknowledge: "Acknowledged", mute: "Muted", resolve: "Resolved" };
const MUTES_S = { "1h": 3600, "1d": 86400, gone: null };

/** Whether a decision applies to a vehicle now, by its events. */
export function inForce(decision, events, isOpen, nowUs) {
  switch (decision?.action) {
    case "mute":
      return decision.until_us === null ? events.some((event) => isOpen(event) && event.first_us <= decision.t_us) : nowUs < decision.until_us;
    case "resolve":
      return events.every((event) => event.first_us <= decision.t_us);
    default:
      return decision?.action === "acknowledge";
  }
}

/** What is decided, by whom, and the newest note; empty where there is nothing. */
export function handlingText({ decision, note }) {
  const until = decision?.action === "mute" ? (decision.until_us === null ? " until it is gone" : ` until ${stamp(decision.until_us)}`) : "";
  const decided = decision && `${DONE[decision.action]}${until} by ${decision.by}${decision.note ? `: ${decision.note}` : ""}`;
  return [decided, note && `${note.by}: ${note.note}`].filter(Boolean).join(" · ");
}

export class HandlingPanel {
  #store; #vehicle = null; #waiting = "note";

  constructor(store) {
    this.#store = store;
    const form = $("handling");
    form.elements.by.value = localStorage.getItem("by") ?? "";
    form.addEventListener("click", ({ target }) => target.value && target.name === "action" && void this.send(target.value));
    form.addEventListener("submit", (event) => { event.preventDefault(); void this.send(this.#waiting); });
  }

  render(vehicle) {
    if (vehicle?.key !== this.#vehicle?.key) setText($("handling-note"), "");
    this.#vehicle = vehicle;
    $("handling").hidden = !vehicle;
    setText($("handling-state"), vehicle ? handlingText(vehicle) : "");
    $("handling").elements.unmute.hidden = !vehicle?.decision;
  }

  /** Asks the service for an action; a mute is named with its duration, as `mute-1h`. */
  async send(name) {
    const fields = $("handling").elements, [action, duration] = name.split("-");
    const by = fields.by.value.trim();
    if (!this.#vehicle) return;
    this.#waiting = by ? "note" : name; // Enter in the field of the name goes on with it
    if (!fields.by.reportValidity()) return;
    localStorage.setItem("by", by);
    const { site, id: vehicle } = this.#vehicle, lasts_s = MUTES_S[duration] ?? null;
    const until_us = lasts_s === null ? null : this.#store.nowUs + 1e6 * lasts_s;
    const body = JSON.stringify({ site, vehicle, action, by, until_us, note: fields.note.value.trim() });
    const answer = await fetch("/handling", { method: "POST", headers: { "Content-Type": "application/json" }, body }).catch(() => null);
    if (answer?.ok) fields.note.value = "";
    setText($("handling-note"), answer?.ok ? "Stored." : `Not stored: ${answer ? await answer.text() : "no contact with the dashboard"}`);
  }
}
