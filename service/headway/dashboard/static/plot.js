// One small chart as SVG: lines, dots and marks with error bars, over shared axes.

import { el, number, svg } from "./dom.js";

const LOG_FROM = 50;
const WIDTH = 300, HEIGHT = 175, LEFT = 44, RIGHT = 8, TOP = 8, BOTTOM = 26;

/**
 * `series`: [{name, look, draw: "lines" | "dots" | "marks" | "level", points: [[x, y, sigma?]]}]; `look` is a class.
 * A `level` is one y over the whole width. With `log` the y axis is logarithmic where the values are positive and span much.
 */
export function plot({ title, unit, series, log = false }) {
  const drawn = series.filter(({ points }) => points.length);
  const figure = el("figure", {}, caption(title, unit, drawn));
  if (drawn.length) figure.append(chart(title, drawn, log));
  return figure;
}

function caption(title, unit, series) {
  const keys = series.map(({ name, look }) => el("span", { class: `key ${look}` }, name));
  return el("figcaption", {}, el("b", {}, title), unit, ...keys);
}

function chart(title, series, log) {
  const xs = series.filter(({ draw }) => draw !== "level").flatMap(({ points }) => points.map(([x]) => x));
  const ys = series.flatMap(({ points }) => points.flatMap(([, y, sigma = 0]) => [y - sigma, y + sigma]));
  const wide = Math.min(...ys) > 0 && Math.max(...ys) > LOG_FROM * Math.min(...ys);
  const across = axis(xs, LEFT, WIDTH - RIGHT), up = axis(ys, HEIGHT - BOTTOM, TOP, log && wide);
  const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "plot", role: "img", "aria-label": title });
  for (const tick of across.ticks) {
    picture.append(line(across.at(tick), TOP, across.at(tick), HEIGHT - BOTTOM, "axis"),
      svg("text", { x: across.at(tick), y: HEIGHT - BOTTOM + 14, "text-anchor": "middle" }, number(tick)));
  }
  for (const tick of up.ticks) {
    picture.append(line(LEFT, up.at(tick), WIDTH - RIGHT, up.at(tick), "axis"),
      svg("text", { x: LEFT - 5, y: up.at(tick) + 3.5, "text-anchor": "end" }, number(tick)));
  }
  picture.append(svg("text", { x: WIDTH - RIGHT, y: HEIGHT - 1, "text-anchor": "end" }, "s"));
  for (const { look, draw, points } of series) {
    picture.append(svg("g", { class: look }, ...DRAW[draw](points, across, up)));
  }
  return picture;
}

const DRAW = {
  lines: (points, across, up) => [
    svg("path", { class: "lines", d: "M" + points.map(([x, y]) => `${across.px(x)},${up.px(y)}`).join("L") }),
  ],
  dots: (points, across, up) => points.map(([x, y]) => svg("circle", { class: "dots", cx: across.px(x), cy: up.px(y), r: 1.7 })),
  marks: (points, across, up) => points.flatMap(([x, y, sigma = 0]) => [
    line(across.at(x), up.at(y - sigma), across.at(x), up.at(y + sigma), "bars"),
    svg("circle", { class: "marks", cx: across.px(x), cy: up.px(y), r: 4 }),
  ]),
  level: ([[, y]], across, up) => [line(LEFT, up.at(y), WIDTH - RIGHT, up.at(y), "lines dash")],
};

function line(x1, y1, x2, y2, look) {
  return svg("line", { x1: x1.toFixed(1), y1: y1.toFixed(1), x2: x2.toFixed(1), y2: y2.toFixed(1), class: look });
}

function axis(values, from, to, log = false) {
  const scale = log ? Math.log10 : (v) => v;
  let low = Math.min(...values.map(scale)), high = Math.max(...values.map(scale));
  const room = Math.max((high - low) * 0.06, log ? 0.1 : 0.05);
  low -= room;
  high += room;
  const at = (v) => from + ((scale(v) - low) / (high - low)) * (to - from);
  return { at, px: (v) => at(v).toFixed(1), ticks: log ? decades(low, high) : ticks(low, high) };
}

export function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}

function decades(low, high) {
  const step = Math.max(1, Math.ceil((high - low) / 4)), found = [];
  for (let power = Math.ceil(low); power <= high; power += step) found.push(10 ** power);
  return found.length > 1 ? found : ticks(10 ** low, 10 ** high);
}
