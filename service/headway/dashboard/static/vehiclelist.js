// The list of vehicles with events: what is wrong with each, since when, how often, how far.

import { $, clock, count, el, setText } from "./dom.js";
import { handlingText } from "./handling.js";
import { KeyedList, More } from "./keyed.js";
import { deviation, sentences } from "./words.js";

const ROWS = 50;

export class VehicleList {
  #rows; #more;

  /** `choose` is called with the vehicle of a row that is clicked. */
  constructor(choose, changed) {
    this.#more = new More($("vehicles-more"), ROWS, changed);
    this.#rows = new KeyedList($("vehicles"), ({ key, site, id }) => {
      const parts = ["who", "small state", "what", "small since", "small worst", "small kinds", "small handled"].map((name) => el("span", { class: name }));
      const button = el("button", { class: "vehicle", type: "button", "data-vehicle": id, "data-site": site }, ...parts);
      button.addEventListener("click", () => choose(key));
      return el("li", {}, button);
    });
  }

  /** Shows vehicles; returns those that have a row. */
  render(store, vehicles, chosen) {
    $("vehicles-empty").hidden = vehicles.length > 0;
    const shown = this.#more.cut(vehicles);
    this.#rows.render(shown, (row, vehicle) => update(row.firstChild, vehicle, store, vehicle.key === chosen));
    return shown;
  }
}

function update(button, vehicle, store, current) {
  const [who, state, what, since, worst, kinds, handled] = button.children;
  const known = stateOf(vehicle, store);
  button.dataset.state = known;
  button.dataset.handling = vehicle.decision?.action ?? "";
  setText(handled, handlingText(vehicle));
  button.setAttribute("aria-current", String(current));
  setText(who, vehicle.id);
  setText(state, `${known} · ${vehicle.site}`);
  setText(what, sentences(vehicle.worst, "").join(" "));
  setText(since, `${count(vehicle.count)} event${vehicle.count > 1 ? "s" : ""}, ${clock(vehicle.first_us)} to ${clock(vehicle.last_us)}`);
  setText(worst, deviation(vehicle) && `worst ${deviation(vehicle)}`);
  setText(kinds, [[...vehicle.kinds].sort().join(", "), quality(store.qualities.get(vehicle.key))].filter(Boolean).join(" · "));
}

const stateOf = ({ open, missing, site }, store) => (!open ? "over" : !store.isLive(site) ? "not known" : open > missing ? "open" : "silent");

/** What was learnt of the sensors while they had no fault. */
const quality = (known) => known && `sensors ${known.level === "good" ? "otherwise good" : known.level}`;
