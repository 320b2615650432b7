"use strict";
// Small plots at the side: bars, curves, bands and marks over one axis.

const SVG = "http://www.w3.org/2000/svg";

function svg(tag, properties, text = "") {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) element.setAttribute(name, value);
  element.textContent = text;
  return element;
}

/** Return ticks at round numbers between two ends. */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return found;
}

/**
 * Return a plot. `x`, `y`: {low, high, label}. `bars`: [[left, right, value], …] from `ground`. `curves`: {points, colour, dashed}.
 * `bands`: {from, to, colour} over x. `marks`: {x, colour, text, dashed}. `levels`: {y, colour, text}. `dots`: {x, y, colour, error}.
 */
function plot({ title, x, y, bars = [], ground = 0, curves = [], bands = [], marks = [], levels = [], dots = [], pick = null }) {
  const wide = 360, high = 190, left = 46, right = 6, top = 16, bottom = 34;
  const across = (value) => left + ((wide - left - right) * (value - x.low)) / (x.high - x.low || 1);
  const down = (value) => high - bottom - ((high - top - bottom) * (value - y.low)) / (y.high - y.low || 1);
  const inside = (value) => Math.max(top, Math.min(high - bottom, down(value)));
  const picture = svg("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img", "aria-label": title });
  const add = (tag, properties, text) => picture.append(svg(tag, properties, text));
  for (const { from, to, colour } of bands) add("rect", { x: across(from), width: Math.max(across(to) - across(from), 0.5), y: top, height: high - top - bottom, fill: colour });
  for (const tick of ticks(y.low, y.high, 4)) {
    add("line", { x1: left, x2: wide - right, y1: down(tick), y2: down(tick), stroke: "var(--line)" });
    add("text", { x: left - 5, y: down(tick) + 3, "text-anchor": "end" }, digits(tick, 4));
  }
  for (const [from, to, value] of bars) {
    const [one, other] = [inside(value), inside(ground)];
    add("rect", { x: across(from), width: Math.max(across(to) - across(from) - 0.6, 0.6), y: Math.min(one, other), height: Math.abs(one - other), fill: "var(--bar)" });
  }
  for (const { y: level, colour, text } of levels) {
    if (level < y.low || level > y.high) continue;
    add("line", { x1: left, x2: wide - right, y1: down(level), y2: down(level), stroke: colour, "stroke-dasharray": "4 3" });
    add("text", { x: wide - right, y: down(level) - 3, "text-anchor": "end", style: "" }, text);
  }
  for (const { points, colour, dashed } of curves) {
    const path = points.filter(([, value]) => Number.isFinite(value)).map(([at, value], i) => `${i ? "L" : "M"}${across(at).toFixed(1)} ${inside(value).toFixed(1)}`).join("");
    add("path", { d: path, fill: "none", stroke: colour, "stroke-width": 1.3, "stroke-dasharray": dashed ? "3 3" : "" });
  }
  for (const { x: at, y: value, colour, error } of dots) {
    if (value < y.low || value > y.high) continue;
    if (error) add("line", { x1: across(at), x2: across(at), y1: inside(value - error), y2: inside(value + error), stroke: colour, "stroke-opacity": 0.4 });
    add("circle", { cx: across(at), cy: down(value), r: 1.6, fill: colour });
  }
  marks.filter((mark) => mark.x >= x.low && mark.x <= x.high).forEach(({ x: at, colour, text, dashed }, i) => {
    add("line", { x1: across(at), x2: across(at), y1: top, y2: high - bottom, stroke: colour, "stroke-width": 1.3, "stroke-dasharray": dashed ? "3 3" : "" });
    const end = across(at) > 0.75 * wide ? "end" : across(at) < 0.25 * wide ? "start" : "middle";
    add("text", { x: across(at), y: top - 4 - (marks.length > 1 ? 0 : 0) + (i ? 14 : 0), "text-anchor": i ? (end === "middle" ? "start" : end) : end, dx: i ? (end === "end" ? -4 : 4) : 0 }, text ?? "");
  });
  add("line", { x1: left, x2: wide - right, y1: high - bottom, y2: high - bottom, stroke: "var(--ink)", "stroke-width": 0.7 });
  for (const tick of ticks(x.low, x.high, 6)) add("text", { x: across(tick), y: high - bottom + 12, "text-anchor": "middle" }, digits(tick, 5));
  add("text", { x: 0.5 * (left + wide - right), y: high - 6, "text-anchor": "middle" }, x.label);
  add("text", { x: 4, y: 9 }, y.label);
  if (pick) {
    picture.style.cursor = "pointer";
    picture.addEventListener("click", (event) => {
      const box = picture.getBoundingClientRect();
      pick(x.low + (((event.clientX - box.left) / box.width) * wide - left) / (wide - left - right) * (x.high - x.low));
    });
  }
  return picture;
}

/** Return words beside swatches, which say what a plot's colours mean. */
function key(entries) {
  const found = el("p", { className: "aside" });
  for (const [colour, words] of entries) {
    const swatch = el("span", { className: "swatch" });
    swatch.style.background = colour;
    found.append(swatch, ` ${words}   `);
  }
  return found;
}
