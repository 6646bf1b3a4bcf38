// The series of the plots, from the updates of an event. Pure: no document.

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

/** The reading that a update is about: the newest of its evidence. */
function judgedReading(update) {
  return readingsOf([update]).at(-1);
}

const known = (points) => points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y) && x !== null && y !== null);

export function speedSeries(readings, updates, zero_s) {
  const at = (reading) => reading.t_s - zero_s;
  const read = known(readings.map((r) => [at(r), r.v_mps]));
  const leader = known(readings.filter((r) => r.leader_v_mps !== null).map((r) => [r.leader_t_s - zero_s, r.leader_v_mps]));
  const predicted = updates.flatMap((s) => {
    const reading = judgedReading(s);
    return reading && s.innovation ? [[at(reading), reading.v_mps - s.innovation.v_mps]] : [];
  });
  const recovered = updates.filter((s) => s.recovered?.v_mps != null)
    .map((s) => [s.t_us / 1e6 - zero_s, s.recovered.v_mps, s.recovered.v_std_mps ?? 0]);
  return [
    { name: "leader", look: "leader", draw: "lines", points: leader },
    { name: "reading", look: "reading", draw: "dots", points: read },
    { name: "prediction", look: "prediction", draw: "marks", points: known(predicted) },
    { name: "recovered", look: "recovered", draw: "marks", points: known(recovered) },
  ];
}

/** Bumper to bumper behind a leader; on a free road, how far from where steady driving would be. */
export function placeSeries(readings, updates, zero_s) {
  const behind = readings.some((r) => r.leader_x_m !== null);
  const place = behind ? gapOf : steadyOf(readings[0]);
  const point = (reading, x_m, sigma) => [reading.t_s - zero_s, place(reading, x_m), sigma];
  const predicted = [], recovered = [];
  for (const update of updates) {
    const reading = judgedReading(update);
    if (!reading) continue;
    if (update.innovation?.x_m != null) predicted.push(point(reading, reading.x_m - update.innovation.x_m));
    if (update.recovered?.x_m != null) {
      recovered.push(point(reading, update.recovered.x_m, update.recovered.x_std_m ?? 0));
    }
  }
  const ranges = readings.filter((r) => r.range_m !== null).map((r) => [r.t_s - zero_s, r.range_m]);
  return {
    title: behind ? "Gap to the leader" : "Location less steady driving",
    unit: "m",
    series: [
      { name: "forward sensor", look: "range", draw: "lines", points: behind ? known(ranges) : [] },
      { name: "reading", look: "reading", draw: "dots", points: known(readings.map((r) => point(r, r.x_m))) },
      { name: "prediction", look: "prediction", draw: "marks", points: known(predicted) },
      { name: "recovered", look: "recovered", draw: "marks", points: known(recovered) },
    ],
  };
}

function gapOf(reading, x_m) {
  if (reading.leader_x_m === null) return NaN;
  const leader_x_m = reading.leader_x_m + (reading.leader_v_mps ?? 0) * (reading.t_s - reading.leader_t_s);
  return leader_x_m - (reading.leader_length_m ?? 0) - x_m;
}

const steadyOf = (first) => (reading, x_m) => x_m - first.x_m - first.v_mps * (reading.t_s - first.t_s);

export function statisticSeries(updates, pair, zero_s) {
  const judged = updates.filter((s) => s.statistic !== null);
  const end_s = (updates.at(-1).t_us / 1e6) - zero_s;
  const around = (pair?.trace ?? []).map(([t_us, statistic]) => [t_us / 1e6 - zero_s, statistic])
    .filter(([t]) => t > -15 && t < end_s + 15);
  const gate = judged.findLast((s) => s.gate !== null)?.gate;
  return [
    { name: "gate", look: "gate", draw: "level", points: gate == null ? [] : [[0, gate]] },
    { name: "pair state", look: "leader", draw: "lines", points: known(around) },
    { name: "statistic", look: "statistic", draw: "marks", points: judged.map((s) => [s.t_us / 1e6 - zero_s, s.statistic]) },
  ];
}
