"use strict";
// How numbers of voxels become colours: a layer or a sum of them, its limits, its colour map or its names.

const VALID = 0;
const NOWHERE = [0xb8, 0xbe, 0xc4];

class Shading {
  constructor(data) {
    this.data = data;
    this.layers = data.layers;
    this.count = data.layers.status.length;
    this.invalid = false; // whether voxels without a range are shown, at their true place
    this.hidden = new Set(); // statuses or objects that are switched off
    this.choose(data.shades[0]);
  }

  get names() {
    if (this.shade.scale === "status") return this.data.statuses.map((one) => one.name);
    return ["nothing", ...this.data.objects];
  }

  get statusColours() {
    return this.data.statuses.map((one) => (dark.matches ? one.colour_on_dark : one.colour));
  }

  get byName() {
    return this.shade.scale === "status" || this.shade.scale === "object";
  }

  /** Colour by another quantity: work out its values, and limits that leave out a hundredth at either end. */
  choose(shade) {
    this.shade = shade;
    this.hidden.clear();
    const layer = this.layers[shade.layer], minus = this.layers[shade.minus], over = this.layers[shade.over];
    const values = new Float32Array(this.count);
    for (let i = 0; i < this.count; i++) {
      let value = layer[i];
      if (minus) value -= minus[i];
      if (over) value /= over[i];
      values[i] = value * shade.factor;
    }
    this.values = values;
    if (this.byName) return;
    const good = values.filter((value, i) => Number.isFinite(value) && this.layers.status[i] === VALID && (shade.scale !== "logarithmic" || value > 0)).sort();
    const at = (share) => (good.length ? good[Math.min(good.length - 1, Math.floor(share * good.length))] : 1);
    [this.least, this.most] = [at(0), at(1)];
    [this.low, this.high] = [at(0.01), at(0.99)];
    if (shade.scale === "both") {
      const end = shade.over ? 3 : Math.max(Math.abs(at(0.02)), Math.abs(at(0.98)), 1e-9);
      [this.low, this.high] = [-end, end];
      [this.least, this.most] = [-2 * end, 2 * end];
    }
    if (!(this.high > this.low)) this.high = this.low + Math.max(1e-3 * Math.abs(this.low), 1e-6);
    this.most = Math.max(this.most, this.high);
    this.least = Math.min(this.least, this.low);
  }

  /** Return where a value lies between the limits, 0 to 1, or between other ends. */
  place(value, low = this.low, high = this.high) {
    if (this.shade.scale !== "logarithmic") return (value - low) / (high - low);
    return Math.log(value / low) / Math.log(high / low);
  }

  /** Return the value at a place between two ends. */
  valueAt(place, low, high) {
    return this.shade.scale === "logarithmic" ? low * Math.pow(high / low, place) : low + place * (high - low);
  }

  nameColour(code) {
    const colour = this.shade.scale === "status" ? this.statusColours[code] : this.data.palette[(code - 1) % this.data.palette.length];
    return code === 0 && this.shade.scale === "object" ? NOWHERE : bytesOf(colour);
  }

  /** Fill four bytes for each voxel: its colour, and whether it is shown in space. */
  fill(colours, positions) {
    const { values, layers, invalid, hidden, byName } = this;
    const status = layers.status, map = byName ? null : mapOf(this.shade.map);
    const names = byName ? this.names.map((_, code) => this.nameColour(code)) : null;
    const statuses = this.statusColours.map(bytesOf);
    for (let i = 0; i < this.count; i++) {
      let r, g, b;
      const value = values[i], good = status[i] === VALID;
      if (byName) [r, g, b] = names[value] ?? NOWHERE;
      else if (good && Number.isFinite(value)) {
        const at = 3 * Math.max(0, Math.min(255, Math.floor(256 * this.place(value))));
        [r, g, b] = [map[at], map[at + 1], map[at + 2]];
      } else [r, g, b] = good ? NOWHERE : statuses[status[i]];
      const shown = (good || invalid) && !(byName && hidden.has(value)) && Number.isFinite(positions[3 * i]);
      const at = 4 * i;
      colours[at] = r;
      colours[at + 1] = g;
      colours[at + 2] = b;
      colours[at + 3] = shown ? 255 : 0;
    }
  }

  /** Return how many voxels have each name: all of them for statuses, those with a range for objects. */
  counts() {
    const counts = new Array(this.names.length).fill(0);
    for (let i = 0; i < this.count; i++)
      if (this.shade.scale === "status" || this.layers.status[i] === VALID) counts[this.values[i]]++;
    return counts;
  }
}

/** Return the tools of the page: what colours show, their limits, and what is drawn; `changed` is called after a change. */
function tools(shading, cloud, frame, changed) {
  const legend = el("div");
  const select = el("select", { id: "shade", onchange: () => pick(select.selectedIndex) }, ...shading.data.shades.map((one) => el("option", {}, one.name)));
  const invalid = el("input", { type: "checkbox", id: "invalid", onchange: () => { shading.invalid = invalid.checked; changed(); } });
  const shownFrame = el("input", { type: "checkbox", id: "frame", checked: true, onchange: () => frame(shownFrame.checked) });
  const size = el("input", { type: "range", id: "size", min: -10, max: 15, value: 0, oninput: () => { cloud.uniforms.size.value = Math.pow(10, size.value / 15); changed(); } });

  function limits() {
    const { shade } = shading;
    const texts = [el("span"), el("span")];
    const say = () => texts.forEach((text, i) => (text.textContent = digits([shading.low, shading.high][i], 3)));
    const slider = (end) => {
      const value = Math.round(1000 * shading.place(shading[end], shading.least, shading.most));
      const label = end === "low" ? "Colours begin at" : "Colours end at";
      const input = el("input", { type: "range", min: 0, max: 1000, value, "aria-label": label, id: end });
      input.addEventListener("input", () => {
        const wanted = shading.valueAt(input.value / 1000, shading.least, shading.most);
        shading[end] = end === "low" ? Math.min(wanted, shading.high - 1e-9) : Math.max(wanted, shading.low + 1e-9);
        say();
        changed();
      });
      return input;
    };
    const bar = el("canvas", { className: "bar", width: 256, height: 1 });
    const dots = new ImageData(256, 1), map = mapOf(shade.map);
    for (let i = 0; i < 256; i++) dots.data.set([map[3 * i], map[3 * i + 1], map[3 * i + 2], 255], 4 * i);
    bar.getContext("2d").putImageData(dots, 0, 0);
    say();
    return [bar, el("div", { className: "ends" }, texts[0], el("span", { className: "aside" }, `${shade.unit}${shade.scale === "logarithmic" ? ", logarithmic" : ""}`), texts[1]), slider("low"), slider("high")];
  }

  function kinds() {
    const counts = shading.counts();
    const rows = shading.names.map((name, code) => {
      if (!counts[code]) return "";
      const [r, g, b] = shading.nameColour(code);
      const swatch = el("span", { className: "swatch" });
      swatch.style.background = `rgb(${r},${g},${b})`;
      const tick = el("input", { type: "checkbox", checked: !shading.hidden.has(code), onchange: () => { shading.hidden[tick.checked ? "delete" : "add"](code); changed(); } });
      return el("label", {}, tick, swatch, el("span", {}, name), el("span", {}, counts[code].toLocaleString("en")));
    });
    return [el("div", { className: "kinds" }, ...rows)];
  }

  function pick(index) {
    select.selectedIndex = index;
    shading.choose(shading.data.shades[index]);
    if (shading.shade.scale === "status") invalid.checked = shading.invalid = true;
    legend.replaceChildren(...(shading.byName ? kinds() : limits()));
    changed();
  }

  byId("tools").append(
    el("label", { className: "whole" }, "Coloured by", select), legend,
    el("label", {}, "Points", size), el("label", {}, invalid, "without a range too"), el("label", {}, shownFrame, "field of view, Sun"),
  );
  dark.addEventListener("change", () => pick(select.selectedIndex));
  pick(0);
  return { next: () => pick((select.selectedIndex + 1) % shading.data.shades.length), pick, toggleFrame: () => shownFrame.click(), toggleInvalid: () => invalid.click() };
}
