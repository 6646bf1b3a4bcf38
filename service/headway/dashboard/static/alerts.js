// The list of events, the newest first.

import { $, clock, el, number, setText } from "./dom.js";
import { KeyedList, More } from "./keyed.js";
import { SENSORS, deviation, place } from "./words.js";

const ROWS = 80;

export class AlertList {
  #rows; #more;

  /** `choose` is called with the key of an event that is clicked. */
  constructor(choose, changed) {
    this.#more = new More($("alerts-more"), ROWS, changed);
    this.#rows = new KeyedList($("alerts"), ({ key, event_id, site }) => {
      const parts = ["kind", "who", "small when", "small", "small", "small when"].map((name) => el("span", { class: name }));
      const button = el("button", { class: "alert", type: "button", "data-event": event_id, "data-site": site }, ...parts);
      button.addEventListener("click", () => choose(key));
      return el("li", {}, button);
    });
  }

  /** Shows events; returns those that have a row. The chosen one always has. */
  render(store, events, chosen) {
    $("alerts-empty").hidden = events.length > 0;
    const shown = this.#more.cut(events);
    if (chosen && !shown.some(({ key }) => key === chosen.key)) shown.push(chosen);
    this.#rows.render(shown, (row, event) => update(row.firstChild, event, store.stateShown(event), event.key === chosen?.key));
    return shown;
  }
}

function update(button, event, state, current) {
  const [kind, who, when, phase, about, worst] = button.children;
  button.dataset.state = kind.dataset.state = state;
  button.setAttribute("aria-current", String(current));
  setText(kind, event.kind);
  setText(who, event.suspect);
  setText(when, clock(event.first_us));
  setText(phase, event.count > 1 ? `${state} ×${number(event.count)}` : state);
  setText(about, `${SENSORS[event.sensor]}, ${place(event)} · ${event.site}`);
  setText(worst, deviation(event));
}
