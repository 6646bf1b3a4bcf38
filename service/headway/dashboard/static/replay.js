// The seconds around an event, played again: where the vehicle says it is, where it is by the estimate, and its leader.

import { $, svg } from "./dom.js";
import { gapOf } from "./series.js";
import { withUnit } from "./units.js";
import { distance } from "./words.js";

const STEP_MS = 100;
const REACH_M = 60;
const HEIGHT = 80, Y = 34, ABOVE = -16, BELOW = 28, LOWEST = 41;

export class Replay {
  #charts; #readings = []; #estimates = new Map(); #zero_s = 0; #timer = 0;

  constructor(charts) {
    this.#charts = charts;
    $("moment").addEventListener("input", () => { this.#stop(); this.#show(); });
    $("play").addEventListener("click", () => (this.#timer ? this.#stop() : this.#play()));
    new ResizeObserver(() => { if (!$("replay").hidden) this.#show(); }).observe($("strip"));
  }

  /** Takes the readings of an event and the estimate with each; none hides it. */
  open({ readings, estimates, zero_s }) {
    this.#stop();
    this.#readings = readings.filter((reading) => reading.x_m !== null);
    this.#estimates = new Map(estimates.filter(({ x_m }) => x_m !== null).map((row) => [row.t_s, row]));
    this.#zero_s = zero_s;
    $("replay").hidden = this.#readings.length < 2;
    if ($("replay").hidden) return;
    $("moment").max = this.#readings.length - 1;
    $("moment").value = this.#readings.length - 1;
    this.#show();
  }

  #play() {
    if (Number($("moment").value) >= this.#readings.length - 1) $("moment").value = 0;
    $("play").textContent = "Pause";
    this.#timer = setInterval(() => {
      if (Number($("moment").value) >= this.#readings.length - 1) this.#stop();
      else { $("moment").value = Number($("moment").value) + 1; this.#show(); }
    }, STEP_MS);
  }

  #stop() {
    clearInterval(this.#timer);
    this.#timer = 0;
    $("play").textContent = "Replay";
  }

  #show() {
    const reading = this.#readings[Number($("moment").value)], estimate = this.#estimates.get(reading.t_s);
    const width = $("strip").clientWidth;
    const at = (x_m) => 0.4 * width + (x_m - (estimate?.x_m ?? reading.x_m)) * (width / 2 / REACH_M);
    const add = (x_m, ...named) => marks.push(...car(at(x_m), width, ...named));
    const marks = [svg("path", { class: "road", d: `M0 ${Y + 12}H${width}` })];
    if (reading.leader_x_m !== null) add(reading.x_m + gapOf(reading, reading.x_m) + (reading.leader_length_m ?? 0), "leader", "leader", LOWEST);
    if (estimate) add(estimate.x_m, "recovered", "estimate", BELOW);
    add(reading.x_m, "reading", "says", ABOVE);
    $("strip").setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    $("strip").replaceChildren(...marks);
    const t_s = reading.t_s - this.#zero_s;
    $("at").textContent = sentence(t_s, reading, estimate);
    $("moment").setAttribute("aria-valuetext", $("at").textContent);
    this.#charts.point(t_s);
  }
}

function sentence(t_s, reading, estimate) {
  const parts = [`${(Math.round(10 * t_s) / 10 || 0).toFixed(1)} s`, `says ${withUnit("speed", reading.v_mps, distance)}`];
  if (reading.leader_x_m !== null) parts.push(`gap ${withUnit("length", gapOf(reading, reading.x_m), distance)}`);
  if (estimate) {
    parts.push(`estimate ${withUnit("speed", estimate.v_mps, distance)}, ${withUnit("length", Math.abs(reading.x_m - estimate.x_m), distance)} ` +
      `${reading.x_m < estimate.x_m ? "ahead of" : "behind"} where it says`);
  }
  return parts.join(", ");
}

/** A car whose front is at x of `width`, and its name above or below; that above is lifted off the road. */
function car(x, width, look, name, nameY) {
  const inside = Math.min(Math.max(x, 34), width - 34);
  return [svg("path", { class: look, d: `M${inside.toFixed(1)} ${Y - (nameY < 0 ? 7 : 0)}l-14 -5v10z` }),
    svg("text", { class: look, x: inside.toFixed(1), y: Y + nameY, "text-anchor": "middle" }, inside === x ? name : `${name} ${x < inside ? "←" : "→"}`)];
}
