// What `headway explain` says of the event: the stored numbers beside those computed again from the readings.

import { $, el, number, setText } from "./dom.js";

/** Null while it is computed, and where the dashboard cannot. */
export function renderExplanation(explained) {
  $("explanation").replaceChildren();
  setText($("explained"), explained ? sentenceOf(explained) : "");
  for (const { phase, numbers } of explained?.updates ?? []) {
    for (const [name, { stored, recomputed }] of Object.entries(numbers)) {
      $("explanation").append(el("tr", { "data-same": String(stored === recomputed) },
        ...[phase, name, text(stored), text(recomputed)].map((cell) => el("td", {}, cell))));
    }
  }
  $("explanation-table").hidden = $("explanation").childElementCount === 0;
}

function sentenceOf({ same, updates, here }) {
  const numbers = updates.flatMap((update) => Object.values(update.numbers));
  if (numbers.length === 0) return `Not computed again: ${updates[0]?.problem ?? "there is no evidence"}.`;
  return same ? `Computed again from the stored readings by version ${here.version}: all ${numbers.length} numbers are equal to the last bit.`
    : "Computed again from the stored readings: some numbers differ.";
}

const text = (value) => (typeof value === "number" ? number(value) : String(value ?? "–"));
