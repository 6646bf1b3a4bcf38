// What is known of the sensors of a vehicle, in words.

import { number } from "./dom.js";
import { withUnit } from "./units.js";

const PARTS = [
  ["position_noise_m", "position ±", "length"], ["position_age_s", "positions late by ", "time"], ["speed_noise_mps", "speed ±", "speed"],
  ["speed_bias_mps", "speed off by ", "speed"],
];

export function qualityText(quality) {
  const parts = PARTS.filter(([name]) => quality[name] !== null)
    .map(([name, words, of]) => words + (of === "time" ? `${number(quality[name])} s` : withUnit(of, quality[name], number)));
  return [quality.level, ...parts].join(", ");
}
