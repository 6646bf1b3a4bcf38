// The legend of the road: how many vehicles are in each state.

import { el, setText, svg } from "./dom.js";
import { STANDINGS } from "./store.js";

/** Makes it in `list`; returns what renders a tally by state. */
export function legend(list) {
  const counts = {};
  for (const standing of STANDINGS) {
    counts[standing] = el("span", {}, "0");
    const shape = svg("path", { d: "M6 1l4 10-4-2.5-4 2.5z" });
    const hollow = standing === "silent";
    shape.setAttribute(hollow ? "stroke" : "fill", `var(--${standing})`);
    shape.setAttribute(hollow ? "fill" : "stroke", "none");
    list.append(el("li", {}, svg("svg", { viewBox: "0 0 12 12", "aria-hidden": "true" }, shape), `${standing} `, counts[standing]));
  }
  const arrow = svg("path", { d: "M6 1l4 10-4-2.5-4 2.5z", stroke: "var(--recovered)", fill: "none" });
  list.append(el("li", {}, svg("svg", { viewBox: "0 0 12 12", "aria-hidden": "true" }, arrow), "estimate of an anomalous one"));
  return (tally) => STANDINGS.forEach((standing) => setText(counts[standing], String(tally[standing] ?? 0)));
}
