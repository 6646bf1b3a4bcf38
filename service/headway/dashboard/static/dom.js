// Small helpers for the document and for the words and numbers in it.

export const $ = (id) => document.getElementById(id);

/** Makes an element; text always as text, so nothing that a sender wrote becomes markup. */
export function el(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

const whole = new Intl.NumberFormat("en-US", { maximumFractionDigits: 0 });
export const count = (n) => (n === null || n === undefined ? "–" : whole.format(n));

/** Three significant digits, whole from 100 on. */
export function number(x) {
  if (x === null || x === undefined) return "–";
  if (x !== 0 && (Math.abs(x) >= 1e6 || Math.abs(x) < 1e-3)) return x.toExponential(1);
  return Math.abs(x) >= 100 ? whole.format(x) : String(Number(x.toPrecision(3)));
}

const two = (n) => String(n).padStart(2, "0");

const timeOf = (d) => `${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;

/** The time of day, with the date where that is not today. */
export function clock(us) {
  const d = new Date(us / 1000);
  return d.toDateString() === new Date().toDateString() ? timeOf(d) : stamp(us);
}

export function stamp(us) {
  const d = new Date(us / 1000);
  return `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())} ${timeOf(d)}`;
}

export function duration(s) {
  if (s < 120) return `${Math.floor(s)} s`;
  if (s < 7200) return `${Math.floor(s / 60)} min`;
  return s < 172800 ? `${Math.floor(s / 3600)} h` : `${Math.floor(s / 86400)} d`;
}

/** The value of a `datetime-local` field as ISO 8601 in UTC; empty where it is none. */
export function instant(local) {
  const ms = Date.parse(local);
  return Number.isNaN(ms) ? "" : new Date(ms).toISOString();
}

/** The other way: ISO 8601 as the value of a `datetime-local` field. */
export function localTime(iso) {
  const ms = Date.parse(iso);
  return Number.isNaN(ms) ? "" : stamp(ms * 1000).replace(" ", "T");
}
