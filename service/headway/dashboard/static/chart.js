// One small chart by uPlot: lines with bands, dots and marks over a shared time, with zoom and a shared cursor.

import { el, number } from "./dom.js";
import { unitOf } from "./units.js";
import uPlot from "./vendor/uplot/uPlot.esm.js";

const LOG_FROM = 50;
const HEIGHT = 190;
const AXIS_PX = 52;
const SYNC = "evidence";
const DOT_PX = 3.5, MARK_PX = 8;

/** Charts that share their zoom and their cursor. */
export class Charts {
  #node; #charts = []; #zooming = false;

  constructor(node) {
    this.#node = node;
    new ResizeObserver(() => this.#resize()).observe(node);
  }

  /** Draws one chart for each of `specs`; see `chart`. */
  show(specs) {
    this.clear();
    const drawn = specs.map((spec) => chart(spec, (range) => this.#zoom(range)));
    this.#node.replaceChildren(...drawn.map(({ figure }) => figure));
    this.#charts = drawn.map(({ plot }) => plot).filter(Boolean);
    this.#resize();
  }

  say(text) {
    this.clear();
    this.#node.replaceChildren(el("p", { class: "none" }, text));
  }

  clear() {
    for (const plot of this.#charts) plot.destroy();
    this.#charts = [];
    this.#node.replaceChildren();
  }

  /** Shows the times from `min` to `max` in all charts; null shows all. */
  view(span) {
    for (const plot of this.#charts.slice(0, 1)) plot.setScale("x", span ?? { min: plot.data[0][0], max: plot.data[0].at(-1) });
  }

  /** Puts the cursor of all charts at a time. */
  point(t_s) {
    for (const plot of this.#charts) plot.setCursor({ left: plot.valToPos(t_s, "x"), top: 10 }, true, false);
  }

  #zoom({ min, max }) {
    if (this.#zooming) return;
    this.#zooming = true;
    for (const plot of this.#charts) if (plot.scales.x.min !== min || plot.scales.x.max !== max) plot.setScale("x", { min, max });
    this.#zooming = false;
  }

  #resize() {
    for (const plot of this.#charts) {
      const width = plot.root.parentElement.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    }
  }
}

/**
 * `spec`: {title, quantity, series: [{name, look, draw, points: [[x, y, sigma?]]}], log}; `look` is a class of style.css.
 * `draw` is "line", "dots", "marks" or "level", a line of steps. Points with a sigma have a band. With `log`
 * the y axis is logarithmic where the values are positive and span much. Returns {figure, plot}.
 */
function chart({ title, quantity, series, log = false }, zoomed) {
  const [factor, unit] = unitOf(quantity);
  const drawn = series.filter(({ points }) => points.length);
  const values = drawn.map(() => el("span", { class: "at" }));
  const keys = drawn.map(({ name, look }, i) => el("span", { class: `key ${look}`, "data-points": drawn[i].points.length }, name, values[i]));
  const figure = el("figure", { "aria-label": title }, el("figcaption", {}, el("b", {}, title), unit, ...keys));
  if (!drawn.length) return { figure, plot: null };
  const { data, columns } = aligned(drawn, factor), ys = data.slice(1).flat().filter((y) => y !== null);
  const isLog = log && Math.min(...ys) > 0 && Math.max(...ys) > LOG_FROM * Math.min(...ys);
  figure.dataset.scale = isLog ? "log" : "linear";
  const colour = (look) => () => getComputedStyle(figure).getPropertyValue(`--${COLOURS[look] ?? look}`).trim();
  const lines = columns.flatMap(({ look, draw, sigma }) => [lineOf(draw, colour(look)), ...(sigma ? [edge(), edge()] : [])]);
  const axis = (of) => ({ stroke: colour("dim"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, font: "11px system-ui", ...of });
  const plot = new uPlot({
    width: 300, height: HEIGHT, legend: { show: false },
    cursor: { y: false, sync: { key: SYNC }, drag: { x: true, y: false }, points: { show: false } },
    scales: { x: { time: false }, y: { distr: isLog ? 3 : 1 } },
    axes: [axis({ size: 30, values: (_, ticks) => ticks.map((tick) => `${number(tick)} s`) }), axis({ size: AXIS_PX })],
    series: [{}, ...lines],
    bands: columns.filter(({ sigma }) => sigma).map(({ at, look }) => ({ series: [at + 2, at + 1], fill: () => `${colour(look)()}33` })),
    hooks: {
      setScale: [(made, key) => key === "x" && zoomed(made.scales.x)],
      setCursor: [({ cursor: { left }, data: shown, posToVal }) => {
        const t_s = left >= 0 ? posToVal(left, "x") : null;
        columns.forEach(({ at }, i) => {
          const value = t_s === null ? null : nearest(shown[0], shown[at], t_s);
          values[i].textContent = value === null ? "" : ` ${number(value)}`;
        });
      }],
    },
  }, data, figure);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", title);
  return { figure, plot };
}

const COLOURS = { reading: "normal", statistic: "normal", gate: "anomalous", range: "silent" };

/** Columns over the union of all times; a series with sigmas has two more, its upper and lower edge. */
function aligned(drawn, factor) {
  const times = [...new Set(drawn.flatMap(({ points }) => points.map(([x]) => x)))].sort((a, b) => a - b);
  const place = new Map(times.map((x, i) => [x, i])), data = [times], columns = [];
  for (const { look, draw, points } of drawn) {
    const sigma = points.some(([, , s]) => s > 0);
    columns.push({ look, draw, sigma, at: data.length });
    for (const side of sigma ? [0, 1, -1] : [0]) {
      const column = Array(times.length).fill(null);
      for (const [x, y, s = 0] of points) column[place.get(x)] = (y + side * s) * factor;
      data.push(column);
    }
  }
  return { data, columns };
}

function lineOf(draw, stroke) {
  if (draw === "line") return { stroke, width: 1.5, spanGaps: true, points: { show: false } };
  if (draw === "level") return { stroke, width: 1.5, dash: [5, 4], spanGaps: true, points: { show: false }, paths: uPlot.paths.stepped({ align: 1 }) };
  return { stroke, paths: () => null, points: { show: true, size: draw === "dots" ? DOT_PX : MARK_PX, fill: stroke, width: 0 } };
}

const edge = () => ({ width: 0, spanGaps: true, points: { show: false } });

/** The value of a column next to a time; null where it has none within half a second. */
function nearest(times, column, t_s) {
  let best = null, least = 0.5;
  for (let i = 0; i < times.length; i++) {
    const apart = Math.abs(times[i] - t_s);
    if (column[i] !== null && apart < least) [best, least] = [column[i], apart];
  }
  return best;
}
