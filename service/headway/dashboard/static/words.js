// Events in sentences: what is wrong, how certain it is, what to do. Pure: no document.

import { clock, number } from "./dom.js";
import { withUnit } from "./units.js";

export const SENSORS = { location: "position", speed: "speed", both: "position and speed", heading: "heading", link: "link" };

const SHAPES = {
  short: "Single wrong readings", noise: "Scatter", bias: "Constant offset", drift: "Growing offset",
  unknown: "An offset of a form that is not clear yet",
};

const LIMITS = {
  position_change: "Its position steps further than a car can", position_frozen: "Its position stays while it reports a speed",
  position_speed: "Its positions and speeds contradict each other", speed_value: "It reports a speed that no car has",
  speed_change: "Its speed changes faster than that of a car", speed_frozen: "Its speed stands still while it moves",
  acceleration: "It accelerates as no car can", heading: "Its heading contradicts its course", jerk: "Its acceleration changes as in no car",
  interval: "Its messages follow each other too fast", identity: "Two senders seem to use its id",
  contradiction: "Messages of one time differ", overlap: "It drives in the place of another vehicle",
  appearance: "It appeared in motion, in the middle of the road",
};

const ADVICE = {
  short: "Leave out the readings that are marked. If it comes back, have the receiver checked.",
  noise: "Do not use single readings of it. Have the antenna and its cable checked.",
  bias: "Do not use its readings. Have the calibration checked, and ask where it was changed.",
  drift: "Do not use its readings: the error grows. Have the receiver checked before the next drive.",
  miss: "See whether others go silent at the same place: that is coverage. If it is alone, check its radio.",
  response: "Do not use warnings about this pair. First see whether something is in the way on the road there.",
  range: "Do not use the gap between the two. Check the forward sensor of the one and the position of the other.",
  unknown: "Wait some seconds: the kind follows. Until then do not use its readings.",
};

/** Smaller deviations, in metres or metres per second, are not put into words. */
const LEAST = 0.005;

/** What is wrong, since when, and how certain that is: three sentences; `subject` begins the first. */
export function sentences(event, subject = `${event.suspect} `) {
  const claimed = claim(event);
  return [`${subject || claimed[0].toUpperCase()}${subject ? claimed : claimed.slice(1)}.`, `${form(event)} since ${clock(event.first_us)}.`, certainty(event)].filter(Boolean);
}

export const advice = (event) => ADVICE[event.kind];

/** What the vehicle sends, beside what is possible. */
export function claim(event) {
  const { suspect, leader, follower, kind, sensor } = event;
  if (kind === "miss") return "sends nothing";
  if (kind === "range") {
    return suspect === leader ? `is not where the forward sensor of ${follower} measures it`
      : `is not as far behind ${leader ?? "its leader"} as its forward sensor measures`;
  }
  if (kind === "response") {
    return suspect === leader ? `moves otherwise than ${follower} behind it responds` : `does not respond to ${leader ?? "its leader"} as a driver does`;
  }
  if (sensor === "link") return "contradicts what other vehicles send";
  if (sensor === "heading") return "reports a heading in which it does not drive";
  return deviations(event) || `reports a ${SENSORS[sensor]} that cannot be right`;
}

/** How far position and speed are off, and on which side where that stays the same; empty where neither is known. */
function deviations({ kind, sensor, deviation_m, deviation_mps, ahead, fast }) {
  const metres = sensor !== "speed" && deviation_m >= LEAST && withUnit("length", deviation_m, distance);
  const speed = sensor !== "location" && deviation_mps >= LEAST && withUnit("speed", deviation_mps, distance);
  const joined = (...parts) => parts.filter(Boolean).join(" and ");
  if (!metres && !speed) return "";
  if (kind === "noise" || (metres && ahead === null) || (speed && fast === null)) {
    return `reports ${joined(metres && `positions up to ${metres}`, speed && `speeds up to ${speed}`)} off`;
  }
  return `says it is ${joined(metres && `${metres} further ${ahead ? "ahead" : "back"}`, speed && `${speed} ${fast ? "faster" : "slower"}`)} than it can be`;
}

/** A deviation as text, in the unit that it is shown in. */
export const distance = (value) => (value >= 100 ? number(value) : value.toFixed(value < 10 ? 2 : 1));

function form({ kind, sensor, observations }) {
  if (kind === "miss") return "Silent";
  if (kind === "range") return "Positions and forward sensor contradict each other";
  if (kind === "response") return "Unexplained motion";
  if (kind === "unknown") return observations.length ? LIMITS[observations[0]] : SHAPES.unknown;
  return `${SHAPES[kind]} in ${SENSORS[sensor]}`;
}

/** How certain it is that something is wrong; what exactly is wrong is another question. */
export function certainty({ p_value, confidence, kind }) {
  const wrong = likelihood(p_value);
  if (kind === "miss" || kind === "unknown" || confidence === null || confidence >= 0.6) return wrong && `${wrong}.`;
  return `${wrong || "Likely"} that something is wrong; the kind is not certain yet.`;
}

export function likelihood(p_value) {
  if (p_value === null || p_value === undefined) return "";
  return p_value < 1e-6 ? "Nearly certain" : p_value < 1e-3 ? "Very likely" : "Likely";
}

/** Where the suspect is in the pair, never behind itself. */
export function place({ suspect, leader, follower }) {
  if (suspect === leader) return `ahead of ${follower}`;
  return leader ? `behind ${leader}` : "free road";
}

/** The largest deviation of an event or vehicle, in the units that it has. */
export function deviation({ deviation_m, deviation_mps, sensor }) {
  const parts = [];
  if (deviation_m !== null && sensor !== "speed") parts.push(withUnit("length", deviation_m, distance));
  if (deviation_mps !== null && sensor !== "location") parts.push(withUnit("speed", deviation_mps, distance));
  return parts.join(", ");
}
