// Lengths and speeds in the units that the person chose: metres and metres per second, or feet and miles per hour.

export const FOOT_M = 0.3048;
const MILE_M = 1609.344;
const METRIC = { length: [1, "m"], speed: [1, "m/s"] };
const IMPERIAL = { length: [1 / FOOT_M, "ft"], speed: [3600 / MILE_M, "mph"] };

export const inFeet = () => localStorage.getItem("units") === "feet";

export function chooseFeet(feet) {
  localStorage.setItem("units", feet ? "feet" : "metres");
}

/** Factor and name of the unit of a "length" or a "speed"; other quantities have neither. */
export function unitOf(quantity) {
  return (inFeet() ? IMPERIAL : METRIC)[quantity] ?? [1, ""];
}

/** A value of SI with its unit, a dash where there is none; `write` makes the number. */
export function withUnit(quantity, value, write) {
  if (value === null || value === undefined) return "–";
  const [factor, unit] = unitOf(quantity);
  return `${write(value * factor)} ${unit}`;
}
