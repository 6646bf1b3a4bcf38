// Puts the parts together: one stream of frames in, everything else drawn from the store.

import { $, el, setText } from "./dom.js";
import { EvidencePanel } from "./evidence.js";
import { History } from "./history.js";
import { AlertList, renderService, tiles } from "./panels.js";
import { legend, Road } from "./road.js";
import { KINDS, Store } from "./store.js";

const QUIET_MS = 4000;
const CATCH_MS = 3000;
const SLOW_MS = 1000;

const store = new Store();
const filter = { site: "", kind: "", vehicle: "" };
const evidence = new EvidencePanel(store);
const history = new History(store, choose);
const alerts = new AlertList($("alerts"), choose);
const road = new Road($("road"), $("tip"), store, (pair) => {
  $("filter").elements.vehicle.value = pair.follower;
  refilter();
});
const renderTiles = tiles($("tiles"));
const renderLegend = legend($("legend"));
let receivedMs = 0;
let loaded = 0;

function choose(id) {
  $("follow").checked = false;
  show(id);
}

function show(id) {
  evidence.choose(id);
  void evidence.refresh(performance.now());
  alerts.render(store, filter, evidence.chosen);
}

function take(frame) {
  receivedMs = performance.now();
  const changed = store.take(frame);
  road.received(receivedMs);
  sites();
  announce(changed);
  render();
  if ($("line").dataset.state !== "up") slow();
  if (frame.connection.connections !== loaded && frame.connection.connected) {
    loaded = frame.connection.connections;
    void history.load({ ...filter });
  }
}

function render() {
  const shown = alerts.render(store, filter, evidence.chosen);
  $("alerts-empty").hidden = shown.length > 0;
  if ($("follow").checked && shown.length && shown[0].id !== evidence.chosen) evidence.choose(shown[0].id);
  void evidence.refresh(performance.now());
  renderTiles(store, filter);
  const tally = {};
  for (const { site, standing } of store.pairs.values()) {
    if (!filter.site || filter.site === site) tally[standing] = (tally[standing] ?? 0) + 1;
  }
  renderLegend(tally);
  $("road-empty").hidden = store.pairs.size > 0;
  $("road").setAttribute("aria-label", `${store.pairs.size} vehicles, ${tally.anomalous ?? 0} anomalous, ${tally.silent ?? 0} silent`);
}

function slow() {
  line();
  renderService(store, filter);
}

function line() {
  const quiet = performance.now() - receivedMs > QUIET_MS;
  const { connection } = store;
  const [state, text] = quiet || !connection ? ["down", "no contact with the dashboard"]
    : !connection.connected ? ["down", "dashboard up, no contact with the bus"]
    : store.instances.size === 0 ? ["waiting", "connected, no instance yet"]
    : ["up", `live, ${[...new Set([...store.instances.values()].map(({ site }) => site))].join(", ")}`];
  const troubles = connection ? [connection.dropped && `${connection.dropped} not shown`, connection.unreadable && `${connection.unreadable} unreadable`].filter(Boolean) : [];
  $("line").dataset.state = state;
  setText($("line"), [text, ...troubles].join(", "));
}

function announce(changed) {
  const fresh = [...changed].filter((event) => event.last.phase === "onset" && store.nowUs - event.last.detected_us < 5e6);
  if (fresh.length === 1) setText($("announce"), `Alert: ${fresh[0].last.kind}, ${fresh[0].last.suspect}`);
  else if (fresh.length) setText($("announce"), `${fresh.length} new alerts`);
}

function sites() {
  const select = $("filter").elements.site;
  if (select.options.length - 1 === store.sites.length) return;
  select.replaceChildren(el("option", { value: "" }, "all"), ...store.sites.map((site) => el("option", { value: site }, site)));
}

function refilter() {
  const fields = new FormData($("filter"));
  Object.assign(filter, { site: fields.get("site"), kind: fields.get("kind"), vehicle: fields.get("vehicle").trim() });
  road.filter({ ...filter });
  render();
  slow();
}

function settled() {
  refilter();
  void history.load({ ...filter });
}

function listen() {
  const stream = new EventSource("/stream");
  stream.addEventListener("message", (event) => take(JSON.parse(event.data)));
  stream.addEventListener("error", () => {
    if (stream.readyState === EventSource.CLOSED) setTimeout(listen, CATCH_MS);
  });
}

function theme(choice) {
  document.documentElement.dataset.theme = choice;
  localStorage.setItem("theme", choice);
  road.recolour();
}

for (const kind of KINDS) $("filter").elements.kind.append(el("option", { value: kind }, kind));
$("filter").addEventListener("input", refilter);
$("filter").addEventListener("change", settled);
$("filter").addEventListener("reset", () => setTimeout(settled));
$("filter").addEventListener("submit", (event) => { event.preventDefault(); settled(); });
$("fit").addEventListener("click", () => road.fit());
$("follow").addEventListener("change", render);
$("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "light" ? "dark" : "light"));
theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));
setInterval(slow, SLOW_MS);
listen();
