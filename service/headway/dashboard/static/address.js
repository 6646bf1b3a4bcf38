// The address of the page is its state: filter, vehicle, event and time. A copied address shows the same.

const NAMES = ["site", "kind", "vehicle", "car", "event", "from", "to"];

/** What the address says; names that it lacks are empty. */
export function readAddress() {
  const parameters = new URLSearchParams(location.search);
  return Object.fromEntries(NAMES.map((name) => [name, parameters.get(name) ?? ""]));
}

export function writeAddress(state) {
  const parameters = new URLSearchParams(NAMES.filter((name) => state[name]).map((name) => [name, state[name]]));
  const address = parameters.size ? `${location.pathname}?${parameters}` : location.pathname;
  if (address !== location.pathname + location.search) history.replaceState(null, "", address);
}
