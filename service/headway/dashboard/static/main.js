// Puts the parts together: one stream of frames in, everything else drawn from the store.

import { readAddress, writeAddress } from "./address.js";
import { AlertList } from "./alerts.js";
import { DesktopNotices } from "./desktop.js";
import { $, el, instant, localTime, number, setText } from "./dom.js";
import { EvidencePanel } from "./evidence.js";
import { HandlingPanel, handlingText } from "./handling.js";
import { History } from "./history.js";
import { listenKeys } from "./keys.js";
import { legend } from "./legend.js";
import { Road } from "./road.js";
import { saveBy } from "./save.js";
import { renderService } from "./service.js";
import { renderStatus } from "./status.js";
import { KINDS, keyOf, matches, Store } from "./store.js";
import { tiles } from "./tiles.js";
import { chooseFeet, inFeet, unitOf } from "./units.js";
import { VehicleList } from "./vehiclelist.js";
import { vehiclesOf } from "./vehicles.js";

const QUIET_MS = 4000;
const CATCH_MS = 3000;
const SLOW_MS = 1000;
const EVENT_COLUMNS = ["event_id", "site", "suspect", "leader", "follower", "kind", "sensor", "phase", "first_us", "last_us", "count",
  "deviation_m", "deviation_mps", "statistic", "gate", "p_value", "confidence"];
const VEHICLE_COLUMNS = ["vehicle", "site", "open", "count", "first_us", "last_us", "deviation_m", "deviation_mps", "kinds", "handling"];

const store = new Store();
const filter = { site: "", kind: "", vehicle: "" };
let suspect = ""; // the vehicle whose events are listed; empty: all
let wanted = ""; // an event that the address names and that is not here yet
let receivedMs = 0, loaded = 0;
let shownEvents = [], shownVehicles = [];

const evidence = new EvidencePanel(store);
const history = new History(store, chooseEvent);
const alerts = new AlertList(chooseEvent, render);
const vehicles = new VehicleList(chooseVehicle, render);
const road = new Road($("road"), $("tip"), store, choosePair);
const desktop = new DesktopNotices();
const handling = new HandlingPanel(store);
const renderTiles = tiles();
const renderLegend = legend($("legend"));

function chooseEvent(key) {
  wanted = "";
  evidence.choose(key);
  render();
}

/** Opens or closes the map; where it cannot be opened the road stays as it is drawn, with the reason. */
async function toggleMap() {
  $("map").disabled = true;
  $("ground").hidden = false;
  const [ground, reason] = await road.toggleMap($("ground")).then((map) => [map, ""], (error) => [null, error.message]);
  $("ground").hidden = !ground;
  $("map").setAttribute("aria-pressed", String(ground !== null));
  setText($("attribution"), ground?.attribution ?? reason);
  $("map").disabled = false;
}

/** Lists the events of a vehicle and shows its worst one; the same vehicle again lists all. */
function chooseVehicle(key) {
  suspect = suspect === key ? "" : key;
  const vehicle = suspect && vehiclesOf(store, filter).find((known) => known.key === key);
  chooseEvent(vehicle ? vehicle.worst.key : null);
  if (vehicle) road.centre(key);
}

function choosePair({ key, follower }) {
  if (vehiclesOf(store, filter).some((vehicle) => vehicle.key === key)) {
    if (suspect !== key) chooseVehicle(key);
    return;
  }
  road.centre(key);
  $("filter").elements.vehicle.value = follower;
  settled();
}

function take(frame) {
  receivedMs = performance.now();
  const changed = store.take(frame);
  store.markShown(filter);
  road.received(receivedMs);
  sites();
  announce(changed);
  if (wanted && store.events.has(wanted)) chooseEvent(wanted);
  if (changed.length) history.take(changed);
  render();
  if ($("line").dataset.state !== "up") slow();
  if (frame.connection.connections !== loaded && frame.connection.connected) {
    loaded = frame.connection.connections;
    void loadHistory();
  }
}

function render() {
  const events = store.eventsNewestFirst({ ...filter, suspect });
  const chosen = store.events.get(evidence.chosen);
  const current = chosen ? keyOf(chosen.site, chosen.suspect) : suspect, found = vehiclesOf(store, filter);
  shownVehicles = vehicles.render(store, found, current);
  handling.render(found.find(({ key }) => key === current));
  shownEvents = alerts.render(store, events, chosen);
  evidence.render();
  setText($("alerts-of"), suspect ? `of ${suspect.slice(suspect.indexOf("/") + 1)}` : "of all vehicles");
  $("all").hidden = !suspect;
  renderTiles(store, filter, store.eventsNewestFirst(filter));
  const tally = {}, pairs = store.shownPairs();
  for (const { standing } of pairs) tally[standing] = (tally[standing] ?? 0) + 1;
  renderLegend(tally);
  $("road").setAttribute("aria-label", `${pairs.length} vehicles, ${tally.anomalous ?? 0} anomalous, ${tally.silent ?? 0} silent`);
  for (const button of $("road-sites").children) button.setAttribute("aria-pressed", String(button.dataset.site === $("road").dataset.site));
  const faulty = renderStatus(store, quietMs());
  if (store.connection) desktop.take(faulty);
  if (!wanted) writeAddress({ ...filter, car: suspect, event: evidence.chosen, from: isoOf("from"), to: isoOf("to") });
}

function slow() {
  store.markShown(filter);
  renderStatus(store, quietMs());
  renderService(store, filter);
}

/** How long the dashboard has sent nothing; 0 where that is usual. */
function quietMs() {
  const quiet = performance.now() - receivedMs;
  return quiet > QUIET_MS ? quiet : 0;
}

function announce(changed) {
  const fresh = changed.filter((event) => event.phase === "onset" && store.nowUs - event.last_us < 5e6);
  if (fresh.length === 1) setText($("announce"), `Alert: ${fresh[0].kind}, ${fresh[0].suspect}`);
  else if (fresh.length) setText($("announce"), `${fresh.length} new alerts`);
}

function sites() {
  const select = $("filter").elements.site;
  if (select.options.length - 1 === store.sites.length) return;
  select.replaceChildren(el("option", { value: "" }, "all"), ...store.sites.map((site) => el("option", { value: site }, site)));
  select.value = filter.site;
  $("road-sites").hidden = store.sites.length < 2;
  $("road-sites").replaceChildren(...["", ...store.sites].map((site) => {
    const button = el("button", { type: "button", class: "quiet", "data-site": site }, site || "all sites");
    button.addEventListener("click", () => road.showSite(site));
    return button;
  }));
}

/** Shows what the filter lets through; the evidence of an event that it does not is closed. */
function refilter() {
  const fields = new FormData($("filter"));
  Object.assign(filter, { site: fields.get("site"), kind: fields.get("kind"), vehicle: fields.get("vehicle").trim() });
  if (suspect && !vehiclesOf(store, filter).some(({ key }) => key === suspect)) suspect = "";
  const chosen = store.events.get(evidence.chosen);
  if (chosen && !matches(chosen, { ...filter, suspect })) evidence.choose(null);
  store.markShown(filter);
  road.filter({ ...filter });
  render();
  slow();
}

function settled() {
  refilter();
  void loadHistory();
}

function loadHistory() {
  const us = (name) => Date.parse(isoOf(name)) * 1000 || 0;
  return history.load({ ...filter, from_us: us("from"), to_us: us("to") });
}

function isoOf(name) {
  return instant($("range").elements[name].value);
}

/** Takes over what the address says, and asks for the event that it names. */
function openAddress() {
  const state = readAddress(), fields = $("filter").elements;
  Object.assign(filter, { site: state.site, kind: state.kind, vehicle: state.vehicle });
  [fields.kind.value, fields.vehicle.value] = [state.kind, state.vehicle];
  for (const name of ["from", "to"]) $("range").elements[name].value = localTime(state[name]);
  suspect = state.car;
  wanted = state.event;
  if (wanted) void fetchWanted();
}

async function fetchWanted() {
  const [site, id] = wanted.split("/");
  const answer = await fetch(`/history?${new URLSearchParams({ newest: true, site, event: id })}`).catch(() => null);
  if (answer?.ok) for (const event of (await answer.json()).events) store.put(event);
  if (wanted && store.events.has(wanted)) chooseEvent(wanted);
}

async function copyLink() {
  writeAddress({ ...filter, car: suspect, event: evidence.chosen, from: isoOf("from"), to: isoOf("to") });
  const done = await navigator.clipboard.writeText(location.href).then(() => "Link copied", () => location.href);
  setText($("copied"), done);
  setTimeout(() => setText($("copied"), ""), 5000);
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
  evidence.redraw();
}

/** Shows all lengths and speeds in feet and miles per hour, or in metres. */
function units(feet) {
  chooseFeet(feet);
  setText($("units"), unitOf("length")[1]);
  evidence.redraw();
  render();
}

/** The time zone of all times on the page, such as "Europe/Berlin, UTC+2". */
function zone() {
  const minutes = -new Date().getTimezoneOffset(), hours = number(Math.abs(minutes) / 60), name = Intl.DateTimeFormat().resolvedOptions().timeZone;
  return name === "UTC" ? name : `${name}, UTC${minutes < 0 ? "−" : "+"}${hours}`;
}

const vehicleRow = (vehicle) => ({ ...vehicle, vehicle: vehicle.id, kinds: [...vehicle.kinds].join(" "), handling: handlingText(vehicle) });

for (const kind of KINDS) $("filter").elements.kind.append(el("option", { value: kind }, kind));
$("filter").addEventListener("input", refilter);
$("filter").addEventListener("change", settled);
$("filter").addEventListener("reset", () => setTimeout(settled));
$("filter").addEventListener("submit", (event) => { event.preventDefault(); settled(); });
$("range").addEventListener("submit", (event) => { event.preventDefault(); settled(); });
$("all").addEventListener("click", () => { suspect = ""; render(); });
$("map").addEventListener("click", () => void toggleMap());
$("fit").addEventListener("click", () => road.fit());
$("link").addEventListener("click", () => void copyLink());
saveBy("vehicles", VEHICLE_COLUMNS, () => shownVehicles.map(vehicleRow));
saveBy("alerts", EVENT_COLUMNS, () => shownEvents);
saveBy("history", EVENT_COLUMNS, () => history.shown);
$("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "light" ? "dark" : "light"));
theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));
setText($("zone"), `Times: ${zone()}`);
$("units").addEventListener("click", () => units(!inFeet()));
setText($("units"), unitOf("length")[1]);
listenKeys((action) => void handling.send(action));
openAddress();
setInterval(slow, SLOW_MS);
listen();
