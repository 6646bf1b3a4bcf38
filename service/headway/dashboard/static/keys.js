// The keyboard: / filters, j and k move, Enter opens, a acknowledges, m mutes, ? helps.

import { $ } from "./dom.js";

/** `send` handles the chosen vehicle. */
export function listenKeys(send) {
  const acts = {
    "/": () => $("filter").elements.vehicle.focus(),
    j: () => move(1),
    k: () => move(-1),
    a: () => send("acknowledge"),
    m: () => send("mute-1h"),
    "?": () => $("help").showModal(),
  };
  document.addEventListener("keydown", (event) => {
    const { target, key, ctrlKey, altKey, metaKey } = event;
    if (ctrlKey || altKey || metaKey || target.closest("input, select, textarea, dialog[open]")) return;
    const act = acts[key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  $("keys").addEventListener("click", acts["?"]);
}

/** Moves the focus to another row of the list that has it; of the vehicles where none has. */
function move(step) {
  const list = document.activeElement.closest(".list") ?? $("vehicles"), rows = [...list.querySelectorAll("button")];
  const at = rows.indexOf(document.activeElement);
  const row = rows[at < 0 ? (step > 0 ? 0 : rows.length - 1) : Math.min(Math.max(at + step, 0), rows.length - 1)];
  row?.focus();
}
