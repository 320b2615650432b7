"use strict";
// What the page says of one voxel or shot: where it points, what was measured, the truth, σ by its sources, its signals.

const WAYS = [["", "range"], ["tof.", "by time of flight"], ["fused.", "by both"]];

/** Finds the lines and waveforms of voxels by their place in the raster. */
class Signals {
  constructor(data) {
    this.sets = data.signals;
    this.step = data.step;
    this.indices = this.sets.map((set) => new Map(Array.from(set.row, (row, i) => [`${row} ${set.column[i]}`, i])));
  }

  /** Return what is drawn of each set for a voxel; null where its lines were left out. */
  of(row, column) {
    return this.sets.map((set, which) => {
      const i = this.indices[which].get(`${row} ${column}`);
      if (i === undefined) return { set, none: true };
      const wide = set.number.shape[1];
      const cut = (values) => values && values.subarray(i * wide, (i + 1) * wide);
      const expected = Array.from(cut(set.expected), (level) => set.expected_low + level * set.expected_scale);
      return { set, first: set.first[i], number: cut(set.number), expected, beneath: cut(set.beneath), place: set.place[i] };
    });
  }
}

function linePlot(one, layers, i) {
  const { set, first, number, expected, beneath, place } = one;
  const said = set.numbers, peak = layers.peak_px ? layers.peak_px[i] : NaN;
  const sigma = layers.sigma_peak_px ? layers.sigma_peak_px[i] : NaN;
  const under = (k) => (beneath ? beneath[k] : said.dark);
  const threshold = Array.from(number, (_, k) => [first + k, under(k) + said.threshold]);
  const top = Math.max(...number, ...expected, threshold[0][1]), low = Math.min(...number, said.dark);
  const marks = [];
  if (known(peak)) marks.push({ x: peak, colour: "var(--strong)", text: `peak ${peak.toFixed(2)}` });
  if (known(place)) marks.push({ x: place, colour: "var(--ink)", dashed: true, text: "true" });
  return el("div", {},
    el("h2", {}, "Line of the sensor"),
    plot({
      title: `Digital numbers of pixels ${first} to ${first + number.length - 1}`,
      x: { low: first - 0.5, high: first + number.length - 0.5, label: "pixel" },
      y: { low, high: top + 0.06 * (top - low), label: "digital number" },
      bars: Array.from(number, (value, k) => [first + k - 0.5, first + k + 0.5, value]), ground: low,
      curves: [{ points: expected.map((value, k) => [first + k, value]), colour: "var(--warm)" }, { points: threshold, colour: "var(--limit)", dashed: true }],
      bands: known(sigma) ? [{ from: peak - sigma, to: peak + sigma, colour: "var(--light-band)" }] : [],
      marks,
    }),
    key([["var(--bar)", "digital number"], ["var(--warm)", "the light alone"], ["var(--limit)", layers.background?.[i] > 0 && !beneath ? "threshold in the dark" : "threshold"], ["var(--light-band)", "peak ±σ"]]),
    el("p", { className: "aside" }, `One digital number is ${digits(said.electrons, 4)} electrons.`),
  );
}

function wavePlot(one, layers, i) {
  const { set, first, number, expected, place } = one;
  const said = set.numbers, at = (sample) => said.start_ns + sample * said.step_ns;
  const current = Array.from(number, (value) => value * said.microampere), light = expected.map((value) => value * said.microampere);
  const top = Math.max(...current, ...light), low = Math.min(...current, ...light);
  const echoes = layers["tof.echoes"] ? layers["tof.echoes"][i] : null;
  const marks = known(place) ? [{ x: at(place), colour: "var(--strong)", text: `echo ${at(place).toFixed(2)} ns` }] : [];
  return el("div", {},
    el("h2", {}, "Waveform", echoes === null ? "" : `, ${echoes} ${echoes === 1 ? "echo" : "echoes"}`),
    plot({
      title: "Current of the photodiode over time",
      x: { low: at(first - 0.5), high: at(first + number.length - 0.5), label: "time after the pulse [ns]" },
      y: { low: low - 0.03 * (top - low), high: top + 0.06 * (top - low), label: "current [µA]" },
      bars: current.map((value, k) => [at(first + k - 0.5), at(first + k + 0.5), value]),
      curves: [{ points: light.map((value, k) => [at(first + k), value]), colour: "var(--warm)" }],
      marks,
    }),
    key([["var(--bar)", "digitised"], ["var(--warm)", "the light alone"]]),
  );
}

/** Return in words what was measured by a way, and what is true. */
function rangeRows(data, i) {
  const { layers, statuses } = data, true_ = layers["truth.range_m"]?.[i], rows = [];
  for (const [prefix, words] of WAYS) {
    const r = layers[`${prefix}range_m`]?.[i];
    if (r === undefined || (prefix && !("fused.range_m" in layers))) continue;
    const sigma = layers[`${prefix}sigma_range_m`]?.[i], error = r - true_;
    const code = layers[`${prefix}status`]?.[i];
    rows.push([words, known(r) ? `${metres(r)} ± ${millimetres(sigma)}` : prefix && statuses[code] ? `none: ${statuses[code].sentence}` : "none"]);
    if (known(error)) rows.push(["error", `${millimetres(error, true)}${sigma > 0 ? ` = ${digits(error / sigma, 3)} σ` : ""}`]);
  }
  if (true_ !== undefined) rows.push(["true range", known(true_) ? metres(true_) : "the beam's axis meets nothing"]);
  return rows;
}

function sigmaRows(layers, i) {
  const sigma = layers.sigma_range_m?.[i], texture = layers.sigma_texture_m?.[i], rows = [];
  if (!known(sigma)) return rows;
  rows.push(["σ of the range", millimetres(sigma)]);
  if (known(texture)) {
    rows.push(["– noise of the signal", millimetres(Math.sqrt(Math.max(sigma ** 2 - texture ** 2, 0)))]);
    rows.push(["– uneven light in the spot", millimetres(texture)]);
  }
  if (known(layers.sigma_peak_px?.[i])) rows.push(["σ of the peak", `${digits(layers.sigma_peak_px[i], 3)} pixel`]);
  for (const [prefix, words] of WAYS.slice(1)) if (known(layers[`${prefix}sigma_range_m`]?.[i])) rows.push([`σ ${words}`, millimetres(layers[`${prefix}sigma_range_m`][i])]);
  return rows;
}

/** Return all that is said of a voxel, by its number among those of the page. */
function voxelPart(data, signals, i) {
  const { layers, statuses, step } = data, rows = [];
  const columns = data.shape[1], row = data.raster ? step * Math.floor(i / columns) : 0, column = data.raster ? step * (i % columns) : 0;
  rows.push(data.raster ? ["voxel", `row ${row}, column ${column}`] : ["shot", `${i * step}, at ${digits(1e3 * data.time[i], 5)} ms`]);
  rows.push(["direction", `Θ ${degrees(data.theta[i])}, φ ${degrees(data.phi[i])}`]);
  const status = statuses[layers.status[i]];
  rows.push(["status", `${status.name}: ${status.sentence}`]);
  rows.push(...rangeRows(data, i));
  const object = layers["truth.object"]?.[i], material = layers["truth.material"]?.[i];
  if (object !== undefined) rows.push(["true object", object ? `${data.objects[object - 1]}${material ? `, ${data.materials[material - 1]}` : ""}` : "nothing"]);
  if (known(layers["truth.incidence_rad"]?.[i])) rows.push(["true incidence", degrees(layers["truth.incidence_rad"][i])]);
  if (layers.Y) rows.push(["signal", `${digits(layers.Y[i], 4)} electrons`]);
  if (layers.background?.[i] > 0) rows.push(["background", `${digits(layers.background[i], 4)} electrons`]);
  if (known(layers.snr_detection?.[i])) rows.push(["over its noise", digits(layers.snr_detection[i], 3)]);
  const parts = [el("h2", {}, data.raster ? "Voxel" : "Shot"), table(rows)];
  const drawn = data.raster ? signals.of(row, column) : [];
  for (const one of drawn) {
    if (one.none) parts.push(el("p", { className: "aside" }, `Its ${one.set.kind} was left out to keep the page small.`));
    else parts.push(one.set.kind === "line" ? linePlot(one, layers, i) : wavePlot(one, layers, i));
  }
  const sources = sigmaRows(layers, i);
  if (sources.length) parts.push(el("h2", {}, "σ by source"), table(sources));
  return parts;
}

/** Return the few words that stand beside the pointer. */
function tipOf(data, i) {
  const { layers, step } = data;
  const where = data.raster ? `row ${step * Math.floor(i / data.shape[1])}, column ${step * (i % data.shape[1])}` : `shot ${i * step}`;
  const r = layers.range_m[i];
  return `${where}\n${known(r) ? `${metres(r)} ± ${millimetres(layers.sigma_range_m?.[i])}` : data.statuses[layers.status[i]].name}`;
}
