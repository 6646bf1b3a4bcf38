// The series of the charts, from the updates of an event and what the detector estimates. Pure: no document.

/** Readings of all updates, each once, oldest first, as objects. */
export function readingsOf(updates) {
  const byTime = new Map();
  for (const { evidence } of updates) {
    for (const row of evidence?.readings ?? []) {
      const reading = Object.fromEntries(evidence.columns.map((column, i) => [column, row[i]]));
      byTime.set(reading.t_s, reading);
    }
  }
  return [...byTime.values()].sort((a, b) => a.t_s - b.t_s);
}

/** The reading that an update is about: the newest of its evidence. */
function testedReading(update) {
  return readingsOf([update]).at(-1);
}

const known = (points) => points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y) && x !== null && y !== null);

/** The estimate with each reading, where it was computed again, as a line, and that with each later update as marks. */
function estimateSeries({ estimates, updates, zero_s }, axis, place = (_, value) => value) {
  const [value, std] = axis === "x" ? ["x_m", "x_std_m"] : ["v_mps", "v_std_mps"];
  const end_s = estimates.at(-1)?.t_s ?? -Infinity;
  const point = (t_s, row) => [t_s - zero_s, place(t_s, row[value]), row[std] ?? 0];
  const later = updates.filter(({ t_us, recovered }) => t_us / 1e6 > end_s && recovered?.[value] != null).map(({ t_us, recovered }) => point(t_us / 1e6, recovered));
  return [
    { name: "estimate", look: "recovered", draw: "line", points: known(estimates.filter((row) => row[value] !== null).map((row) => point(row.t_s, row))) },
    { name: estimates.length ? "estimate later" : "estimate", look: "recovered", draw: "marks", points: known(later) },
  ];
}

/** The times of the readings, where the event goes on for long after them; null where one picture shows both. */
export function spanOfReadings({ readings, updates, zero_s }) {
  if (readings.length < 2) return null;
  const min = readings[0].t_s - zero_s, max = readings.at(-1).t_s - zero_s, length = max - min;
  return updates.at(-1).t_us / 1e6 - zero_s > max + 3 * length ? { min, max: max + length } : null;
}

export function speedChart(parts) {
  const { readings, zero_s } = parts;
  const leader = readings.filter((r) => r.leader_v_mps !== null).map((r) => [r.leader_t_s - zero_s, r.leader_v_mps]);
  return {
    title: "Speed", quantity: "speed",
    series: [
      { name: "leader", look: "leader", draw: "line", points: known(leader) },
      ...estimateSeries(parts, "v"),
      { name: "reading", look: "reading", draw: "dots", points: known(readings.map((r) => [r.t_s - zero_s, r.v_mps])) },
    ],
  };
}

/** Bumper to bumper behind a leader; on a free road, how far from where steady driving would be. */
export function placeChart(parts) {
  const { readings, updates, zero_s } = parts;
  const behind = readings.some((r) => r.leader_x_m !== null);
  const place = behind ? gapOf : steadyOf(readings[0]), byTime = new Map(readings.map((r) => [r.t_s, r]));
  const tested = updates.map(testedReading).filter(Boolean);
  const placed = (t_s, x_m) => {
    const reading = byTime.get(t_s) ?? tested.find((r) => Math.abs(r.t_s - t_s) < 0.05);
    return reading ? place(reading, x_m) : NaN;
  };
  const ranges = readings.filter((r) => r.range_m !== null).map((r) => [r.t_s - zero_s, r.range_m]);
  return {
    title: behind ? "Gap to the leader" : "Location less steady driving", quantity: "length",
    series: [
      { name: "forward sensor", look: "range", draw: "line", points: behind ? known(ranges) : [] },
      ...estimateSeries(parts, "x", placed),
      { name: "reading", look: "reading", draw: "dots", points: known(readings.map((r) => [r.t_s - zero_s, place(r, r.x_m)])) },
    ],
  };
}

/** Bumper to bumper; the leader is brought to the time of the reading. */
export function gapOf(reading, x_m) {
  if (reading.leader_x_m === null) return NaN;
  const leader_x_m = reading.leader_x_m + (reading.leader_v_mps ?? 0) * (reading.t_s - reading.leader_t_s);
  return leader_x_m - (reading.leader_length_m ?? 0) - x_m;
}

const steadyOf = (first) => (reading, x_m) => x_m - first.x_m - first.v_mps * (reading.t_s - first.t_s);

export function statisticChart({ readings, updates, estimates, pair, zero_s }) {
  const tested = updates.filter((update) => update.statistic !== null), gated = updates.filter(({ gate }) => gate !== null);
  const at = ({ t_us }) => t_us / 1e6 - zero_s, end_s = at(updates.at(-1)), begin_s = (readings[0]?.t_s ?? zero_s) - zero_s;
  const around = (pair?.trace ?? []).map(([t_us, statistic]) => [t_us / 1e6 - zero_s, statistic])
    .filter(([t]) => t > -15 && t < end_s + 15);
  return {
    title: "Statistic", quantity: "", log: true,
    series: [
      { name: "gate", look: "gate", draw: "level", points: gated.length ? [[begin_s, gated[0].gate], ...gated.map((update) => [at(update), update.gate])] : [] },
      { name: "each reading", look: "leader", draw: "line", points: known(estimates.map((row) => [row.t_s - zero_s, row.statistic])) },
      { name: "pair state", look: "prediction", draw: "line", points: known(around) },
      { name: "statistic", look: "statistic", draw: "marks", points: tested.map((update) => [at(update), update.statistic]) },
    ],
  };
}
