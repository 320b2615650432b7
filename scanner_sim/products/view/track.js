"use strict";
// The page of a tracking run: targets, patterns and poses at a moment, and what was measured until then.

const MEASURED = 0;
const SPEEDS = [0.1, 0.25, 1, 4];
const FADED = 0.35;
const AXIS_COLOURS = ["#c0504a", "#4f9d69", "#4a84c4"]; // x, y, z

/** Return for each target the numbers of its visits, in the order of time. */
function visitsOf(data) {
  const found = data.targets.map(() => []);
  data.visits.target.forEach((target, i) => found[target].push(i));
  return found;
}

/** Return the place of the last of ascending times that is not after a moment; −1 before the first. */
function lastBefore(times, moment, at = (i) => i, count = times.length) {
  let low = 0, high = count;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[at(middle)] <= moment) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** Return the ends of three axes of a pose, as pairs of points; hidden at the origin where there is none. */
function axes(position, rotation, i, length) {
  const points = new Float32Array(18);
  const origin = [position[3 * i], position[3 * i + 1], position[3 * i + 2]];
  if (!Number.isFinite(origin[0])) return points;
  for (let axis = 0; axis < 3; axis++)
    for (let part = 0; part < 3; part++) {
      points[6 * axis + part] = origin[part];
      points[6 * axis + 3 + part] = origin[part] + length * rotation[9 * i + 3 * part + axis];
    }
  return points;
}

class TrackView {
  constructor(data, space) {
    Object.assign(this, { data, space, visits: visitsOf(data), time: 0, target: 0, playing: false, speed: 1 });
    const { visits, patterns, poses } = data;
    const measured = (i) => visits.status[i] === MEASURED;
    const places = visits.point.map((value, k) => (measured(Math.floor(k / 3)) ? value : visits.truth_point[k]));
    space.surround(places, () => true);
    this.trail = space.addPoints(places, 0.0012);
    this.pattern = patterns && space.addPoints(patterns.point, 0.0008);
    this.truth = data.targets.map(() => space.addLines(new Float32Array(18), "--ink"));
    this.rims = data.targets.map((_, target) => space.addLines(new Float32Array(6 * RING), this.colour(target)));
    this.labels = data.targets.map((target) => space.addLabel(target.name, [0, 0, 0]));
    const long = 0.12 * space.extent;
    // Of several methods the last is drawn: it uses most.
    const drawn = poses.filter((pose, n) => !poses.slice(n + 1).some((other) => other.object === pose.object));
    this.axes = drawn.map((pose) => ({
      pose, long,
      lines: AXIS_COLOURS.map((colour) => space.addLines(new Float32Array(6), colour)),
      truth: space.addLines(new Float32Array(18), "--ink", FADED),
      label: space.addLabel(pose.object, [0, 0, 0]),
    }));
    const signals = patterns ? Array.from(patterns.signal).sort((a, b) => a - b) : [];
    this.signalEnds = [signals[Math.floor(0.02 * signals.length)] ?? 0, signals[Math.floor(0.98 * signals.length)] ?? 1];
  }

  colour(target) {
    return this.data.palette[target % this.data.palette.length];
  }

  /** Return the visit of a target that is the last one now; −1 before the first. */
  current(target) {
    const own = this.visits[target];
    const at = lastBefore(this.data.visits.time, this.time, (i) => own[i], own.length);
    return at < 0 ? -1 : own[at];
  }

  /** Show a moment [s]. */
  show(time) {
    this.time = Math.max(0, Math.min(this.data.duration, time));
    this.showPoints();
    this.showPoses();
    this.space.draw();
  }

  showPoints() {
    const { visits, patterns } = this.data;
    const colours = this.trail.colours;
    visits.time.forEach((time, i) => {
      const [r, g, b] = bytesOf(this.colour(visits.target[i]));
      colours.set([r, g, b, time <= this.time && visits.status[i] === MEASURED ? 255 : 0], 4 * i);
    });
    this.pattern?.colours.fill(0);
    const map = mapOf("signal");
    this.data.targets.forEach((_, target) => {
      const i = this.current(target), seen = i >= 0;
      this.truth[target].visible = this.rims[target].visible = seen;
      this.labels[target].hidden = !seen;
      if (!seen) return;
      const at = visits.truth_point.subarray(3 * i, 3 * i + 3);
      this.space.move(this.truth[target], cross(at, 0.012 * this.space.extent));
      this.space.move(this.rims[target], ring(at, visits.outline.subarray(6 * i, 6 * i + 6)));
      this.labels[target].at.set(...at);
      for (let k = patterns ? patterns.first[i] : 0; k < (patterns ? patterns.first[i + 1] : 0); k++) {
        const place = (patterns.signal[k] - this.signalEnds[0]) / (this.signalEnds[1] - this.signalEnds[0] || 1);
        const level = 3 * Math.max(0, Math.min(255, Math.floor(256 * place)));
        this.pattern.colours.set([map[level], map[level + 1], map[level + 2], 255], 4 * k);
      }
    });
    this.space.changed(this.trail);
    if (this.pattern) this.space.changed(this.pattern);
  }

  showPoses() {
    for (const { pose, long, lines, truth, label } of this.axes) {
      const i = lastBefore(pose.time, this.time), there = i >= 0 && pose.good[i] === 1;
      for (const one of [...lines, truth]) one.visible = there;
      label.hidden = !there;
      if (!there) continue;
      const ends = axes(pose.position, pose.rotation, i, long);
      lines.forEach((line, axis) => this.space.move(line, ends.subarray(6 * axis, 6 * axis + 6)));
      this.space.move(truth, axes(pose.truth_position, pose.truth_rotation, i, 1.3 * long));
      label.at.set(...pose.position.subarray(3 * i, 3 * i + 3));
    }
  }

  /** Return the table of the targets now. */
  targetTable(choose) {
    const { visits, targets, modes, statuses } = this.data;
    const head = ["", "target", "state", "error [mm]", "σ", "error/σ"].map((word, i) => el("th", { className: i > 2 ? "number" : "" }, word));
    const rows = targets.map((target, number) => {
      const i = this.current(number), found = i >= 0 && visits.status[i] === MEASURED;
      const swatch = el("span", { className: "swatch" });
      swatch.style.background = this.colour(number);
      const error = found ? visits.error[i] : NaN;
      const state = i < 0 ? "not yet" : found ? modes[visits.after[i]] : `${modes[visits.after[i]]}, ${statuses[visits.status[i]].name}`;
      const cells = [`${error > 0 ? "+" : ""}${digits(1e3 * error, 3)}`, found ? digits(1e3 * visits.sigma[i], 3) : "–", found ? digits(error / visits.sigma[i], 2) : "–"];
      return el("tr", { className: number === this.target ? "chosen" : "", tabIndex: 0, onclick: () => choose(number), onkeydown: (event) => event.key === "Enter" && choose(number) },
        el("td", {}, swatch), el("td", {}, target.name), el("td", {}, state), ...cells.map((cell) => el("td", { className: "number" }, cell)));
    });
    return el("table", { id: "targets" }, el("thead", {}, el("tr", {}, ...head)), el("tbody", {}, ...rows));
  }

  /** Return the plot of a target's errors over time, with σ as bars. */
  errorPlot(target, jump) {
    const { visits, duration, targets } = this.data;
    const own = this.visits[target].filter((i) => visits.status[i] === MEASURED);
    if (!own.length) return el("p", { className: "aside" }, `${targets[target].name} was never measured.`);
    const errors = own.map((i) => 1e3 * visits.error[i]);
    const sorted = errors.map(Math.abs).sort((a, b) => a - b);
    const sigmas = own.map((i) => 1e3 * visits.sigma[i]).sort((a, b) => a - b);
    const end = 1.2 * Math.max(sorted[Math.floor(0.97 * (sorted.length - 1))], 2 * sigmas[Math.floor(sigmas.length / 2)]);
    return plot({
      title: `Errors of the range of ${targets[target].name} over time`,
      x: { low: 0, high: duration || 1, label: "time [s]" }, y: { low: -end, high: end, label: "error of the range [mm], ±σ" },
      dots: own.map((i, k) => ({ x: visits.time[i], y: errors[k], colour: this.colour(target), error: 1e3 * visits.sigma[i] })),
      curves: [{ points: [[0, 0], [duration, 0]], colour: "var(--faint)" }],
      marks: [{ x: this.time, colour: "var(--warm)" }], pick: jump,
    });
  }

  /** Return the table of the poses now: where, and how far from the truth. */
  poseTable() {
    const head = ["object", "method", "mm off", "σ", "mrad off", "σ"].map((word, i) => el("th", { className: i > 1 ? "number" : "" }, word));
    const rows = this.data.poses.map((pose) => {
      const i = lastBefore(pose.time, this.time);
      if (i < 0 || !pose.good[i]) return el("tr", {}, el("td", {}, pose.object), el("td", {}, pose.method), el("td", { colSpan: 4, className: "number" }, i < 0 ? "not yet" : "none"));
      const cells = [pose.error[2 * i], pose.sigma[2 * i], pose.error[2 * i + 1], pose.sigma[2 * i + 1]].map((value) => digits(1e3 * value, 3));
      return el("tr", {}, el("td", {}, pose.object), el("td", {}, pose.method), ...cells.map((cell) => el("td", { className: "number" }, cell)));
    });
    return el("table", {}, el("thead", {}, el("tr", {}, ...head)), el("tbody", {}, ...rows));
  }

  /** Return the plots of the errors of the poses that are drawn, of place and attitude over time, beside their σ. */
  posePlots(jump) {
    const duration = this.data.duration || 1;
    return this.axes.flatMap(({ pose }) => {
      const good = Array.from(pose.time.keys()).filter((i) => pose.good[i]);
      if (!good.length) return [];
      return [["place", "mm"], ["attitude", "mrad"]].map(([word, unit], part) => {
        const sigma = good.map((i) => [pose.time[i], 1e3 * pose.sigma[2 * i + part]]), values = good.map((i) => 1e3 * pose.error[2 * i + part]);
        const sorted = [...values, ...sigma.map(([, value]) => value)].filter(known).sort((a, b) => a - b);
        return plot({
          title: `Errors of the ${word} of ${pose.object} over time, and their σ`,
          x: { low: 0, high: duration, label: "time [s]" },
          y: { low: 0, high: 1.2 * (sorted[Math.floor(0.97 * (sorted.length - 1))] || 1), label: `${pose.object}: error of ${word} [${unit}], line: σ` },
          dots: good.map((i, k) => ({ x: pose.time[i], y: values[k], colour: "var(--strong)" })),
          curves: [{ points: sigma, colour: "var(--limit)" }],
          marks: [{ x: this.time, colour: "var(--warm)" }], pick: jump,
        });
      });
    });
  }
}

/** Add slider, buttons and speed; return what shows a moment there. */
function timeline(view, show) {
  const slider = el("input", { type: "range", id: "time", min: 0, max: 10000, value: 0, "aria-label": "time" });
  const said = el("output"), speed = el("select", { "aria-label": "speed" }, ...SPEEDS.map((one) => el("option", { value: one, selected: one === 1 }, `${one}×`)));
  speed.style.width = "auto";
  const play = el("button", { type: "button", id: "play", title: "key: space" }, "Play");
  let before = 0;
  const step = (now) => {
    if (!view.playing) return;
    show(view.time + (Number(speed.value) * (now - before)) / 1e3);
    before = now;
    if (view.time >= view.data.duration) toggle();
    else requestAnimationFrame(step);
  };
  function toggle() {
    view.playing = !view.playing;
    play.textContent = view.playing ? "Pause" : "Play";
    if (!view.playing) return;
    if (view.time >= view.data.duration) show(0);
    before = performance.now();
    requestAnimationFrame(step);
  }
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => show((slider.value / 10000) * view.data.duration));
  byId("timeline").append(play, slider, said, speed);
  byId("timeline").hidden = false;
  const say = () => {
    slider.value = Math.round((10000 * view.time) / (view.data.duration || 1));
    said.textContent = `${view.time.toFixed(3)} s`;
  };
  return { say, toggle };
}

async function showTrack() {
  const data = await unpackAll(DATA);
  byId("about").textContent = data.about;
  const space = new Space(byId("space")), view = new TrackView(data, space);
  const targets = el("div"), errors = el("div"), poses = el("div");
  const keys = [...VIEW_KEYS, ["space", "play, pause"], ["← →", "the visit before, after"], ["↑ ↓", "the target above, below"], ["f", "field of view"]];
  byId("panel").append(el("h2", {}, "Targets"), targets, errors, ...(data.poses.length ? [el("h2", {}, "Poses"), poses, el("p", { className: "aside" }, "Axes in red, green, blue: estimated x, y, z; grey and longer: true. σ is that of the place and of the attitude, each of all three axes together.")] : []), ...foot(keys));
  const line = timeline(view, show);

  function show(time) {
    view.show(time);
    line.say();
    targets.replaceChildren(view.targetTable(choose));
    errors.replaceChildren(view.errorPlot(view.target, show));
    poses.replaceChildren(view.poseTable(), ...view.posePlots(show));
  }

  function choose(target) {
    view.target = (target + data.targets.length) % data.targets.length;
    show(view.time);
  }

  const frame = drawSurroundings(space, data.surroundings);
  const shown = el("input", { type: "checkbox", id: "frame", checked: true, onchange: () => frame(shown.checked) });
  byId("tools").append(el("p", { className: "aside" }, "Dots: measured places, in the target's colour. Crosses and rings: true places and outlines at the last visit. Cloud: voxels of each target's last pattern, by signal."), el("label", {}, shown, "field of view, Sun"));
  views(space, (letter) => {
    const now = lastBefore(data.visits.time, view.time);
    if (letter === " ") line.toggle();
    else if (letter === "ArrowLeft") show(data.visits.time[Math.max(now - 1, 0)]);
    else if (letter === "ArrowRight") show(data.visits.time[Math.min(now + 1, data.visits.time.length - 1)]);
    else if (letter === "ArrowUp") choose(view.target - 1);
    else if (letter === "ArrowDown") choose(view.target + 1);
    else if (letter === "f") shown.click();
    else return false;
    return true;
  });
  watchPointer(space, view.trail, (i) => choose(data.visits.target[i]), (i) => `${data.targets[data.visits.target[i]].name} at ${data.visits.time[i].toFixed(3)} s\nerror ${millimetres(data.visits.error[i], true)}`);
  dark.addEventListener("change", () => show(view.time));
  space.theme();
  space.look("all");
  const wanted = new URLSearchParams(location.hash.slice(1));
  show(wanted.has("time") ? Number(wanted.get("time")) : data.duration);
  if (wanted.has("view")) space.look(wanted.get("view"));
  document.documentElement.dataset.state = "ready";
  return { space, view, show, data };
}

const page = showTrack();
