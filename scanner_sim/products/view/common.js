"use strict";
// What both kinds of page share: the data, elements whose texts are texts, numbers in words.

const DATA = JSON.parse(document.getElementById("data").textContent);
const byId = (name) => document.getElementById(name);
const TYPES = { u1: Uint8Array, u2: Uint16Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };

/** Return the typed array of what packing.py packed: base64, zlib, then bytes of one place after the other. */
async function unpack(said) {
  const text = atob(said.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const wide = TYPES[said.type].BYTES_PER_ELEMENT;
  const count = planes.length / wide;
  const whole = new Uint8Array(planes.length);
  for (let plane = 0; plane < wide; plane++) {
    const start = plane * count;
    for (let i = 0; i < count; i++) whole[i * wide + plane] = planes[start + i];
  }
  const values = new TYPES[said.type](whole.buffer);
  values.shape = said.shape;
  return values;
}

/** Return an object with every packed array of another unpacked, however deep it lies. */
async function unpackAll(value) {
  if (Array.isArray(value)) return Promise.all(value.map(unpackAll));
  if (value === null || typeof value !== "object") return value;
  if (typeof value.data === "string" && value.type in TYPES) return Object.assign(await unpack(value), { unit: value.unit, meaning: value.meaning });
  const names = Object.keys(value);
  const parts = await Promise.all(names.map((name) => unpackAll(value[name])));
  return Object.fromEntries(names.map((name, i) => [name, parts[i]]));
}

/** Return an element; strings among its children become texts, never markup. */
function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

const known = (value) => value !== null && value !== undefined && Number.isFinite(value);

/** Return a number with so many significant digits, a minus sign, and no needless exponent. */
function digits(value, count = 4) {
  if (!known(value)) return "–";
  const size = Math.abs(value);
  const text = size !== 0 && (size < 1e-3 || size >= 1e7) ? value.toExponential(count - 1) : String(Number(value.toPrecision(count)));
  return (size >= 1e4 && size < 1e7 ? Number(text).toLocaleString("en") : text).replace("-", "−");
}

const metres = (value) => (known(value) ? `${value.toFixed(4)} m` : "none");
const millimetres = (value, sign = false) =>
  known(value) ? `${sign && value > 0 ? "+" : ""}${digits(1e3 * value, 3)} mm` : "–";
const degrees = (value) => `${((180 / Math.PI) * value).toFixed(3).replace("-", "−")}°`;
const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dark = window.matchMedia("(prefers-color-scheme: dark)");

/** Return a table of words and phrases; a phrase may be an element. */
function table(rows) {
  return el("table", {}, el("tbody", {}, ...rows.map(([word, phrase]) => el("tr", {}, el("th", { scope: "row" }, word), el("td", {}, phrase)))));
}

/** Return the foot of every page: notes, keys, scenario, versions. */
function foot(keys) {
  const made = Object.entries(DATA.made_by).map(([program, number]) => `${program} ${number}`);
  const listed = keys.map(([key, what]) => el("tr", {}, el("th", { scope: "row" }, el("kbd", {}, key)), el("td", {}, what)));
  return [
    ...DATA.notes.map((note) => el("p", { className: "note" }, note)),
    el("details", {}, el("summary", {}, "Keys"), el("table", {}, el("tbody", {}, ...listed))),
    el("details", {}, el("summary", {}, "Scenario"), el("pre", { tabIndex: 0 }, DATA.scenario)),
    el("p", { className: "aside" }, made.join(", ")),
  ];
}

const colourMaps = {};
for (const [name, grounds] of Object.entries(DATA.maps)) {
  colourMaps[name] = {};
  for (const [ground, text] of Object.entries(grounds)) colourMaps[name][ground] = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
}
/** Return the 256 colours of a map on the ground of now. */
const mapOf = (name) => colourMaps[name][dark.matches ? "dark" : "light"];
/** Return the three bytes of a colour "#rrggbb". */
const bytesOf = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
