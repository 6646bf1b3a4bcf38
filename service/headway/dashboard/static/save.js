// Rows as a file, made in the browser: comma-separated values (RFC 4180) or JSON.

import { $ } from "./dom.js";

const FORMULA = /^[=+\-@\t\r]/;

/** Text of the file: one line for the names of `columns` and one for each row, an object with these names. */
function toCsv(columns, rows) {
  return [columns, ...rows.map((row) => columns.map((name) => row[name]))].map((cells) => cells.map(cell).join(",") + "\r\n").join("");
}

/** A text that a spreadsheet would take for a formula gets an apostrophe in front. */
function cell(value) {
  if (value === null || value === undefined) return "";
  const text = typeof value === "string" && FORMULA.test(value) ? `'${value}` : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** The rows as a JSON array of objects with the names of `columns`. */
function toJson(columns, rows) {
  return JSON.stringify(rows.map((row) => Object.fromEntries(columns.map((name) => [name, row[name] ?? null]))), null, 1) + "\n";
}

/** Makes the buttons `NAME-csv` and `NAME-json` save what `rows` returns. */
export function saveBy(name, columns, rows) {
  $(`${name}-csv`).addEventListener("click", () => download(`${name}.csv`, "text/csv", toCsv(columns, rows())));
  $(`${name}-json`).addEventListener("click", () => download(`${name}.json`, "application/json", toJson(columns, rows())));
}

function download(name, type, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
