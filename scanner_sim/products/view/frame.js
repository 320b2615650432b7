"use strict";
// What both kinds of page draw about their points, and what the keys and the pointer do.

const RING = 72; // sides of an outline: a circle to 1/1000 of its radius

/** Add what is drawn about the points: outlines of the field of view, axes, the Sun; return what shows or hides it. */
function drawSurroundings(space, around) {
  const parts = [], labels = [];
  const far = around.drawn_far;
  for (const { name, points } of around.outlines) {
    const pairs = new Float32Array(2 * (points.length - 3));
    for (let i = 0; i < points.length / 3 - 1; i++) pairs.set(points.subarray(3 * i, 3 * i + 6), 6 * i);
    parts.push(space.addLines(pairs, "--frame", name === "ray" ? 0.35 : 0.8));
  }
  const end = (name) => around.outlines.find((one) => one.name === name).points;
  const [near, distant] = [end("near"), end("far")];
  const say = (points, text) => labels.push(space.addLabel(text, points.slice(-3)));
  if (around.near > 0) say(near, `near ${digits(around.near, 3)} m`);
  say(distant, around.far === null ? `far: no end` : `far ${digits(around.far, 3)} m`);
  const long = 0.06 * far;
  for (const [axis, name] of [[0, "x"], [1, "y"], [2, "z"]]) {
    const tip = [0, 0, 0];
    tip[axis] = long;
    parts.push(space.addLines(new Float32Array([0, 0, 0, ...tip]), "--faint"));
    labels.push(space.addLabel(name, tip));
  }
  labels.push(space.addLabel("scanner", [0, 0, 0]));
  if (around.sun) sunArrow(space, around, parts, labels);
  return (shown) => {
    for (const part of parts) part.visible = shown;
    for (const label of labels) label.hidden = !shown;
    space.draw();
  };
}

/** Draw an arrow from the middle of the points towards the Sun. */
function sunArrow(space, around, parts, labels) {
  const to = new THREE.Vector3(...around.sun), from = space.middle;
  const tip = from.clone().addScaledVector(to, 0.45 * space.extent);
  const across = new THREE.Vector3(to.y, to.z, to.x).cross(to).normalize();
  const other = new THREE.Vector3().crossVectors(to, across);
  const head = [across, other, across.clone().negate(), other.clone().negate()].flatMap((way) => [
    ...tip.toArray(), ...tip.clone().addScaledVector(to, -0.04 * space.extent).addScaledVector(way, 0.014 * space.extent).toArray(),
  ]);
  parts.push(space.addLines(new Float32Array([...from.toArray(), ...tip.toArray(), ...head]), "--sun"));
  labels.push(space.addLabel(around.sun_visible > 0 ? "to the Sun" : "to the Sun, which the Earth hides", tip.toArray(), "sun"));
}

/** Return the outline of a target about its place, of two half axes, as pairs of points. */
function ring(centre, halves) {
  const points = new Float32Array(6 * RING);
  for (let part = 0; part < 2 * RING; part++) {
    const angle = (2 * Math.PI * ((part + 1) >> 1)) / RING, across = Math.cos(angle), up = Math.sin(angle);
    for (let k = 0; k < 3; k++) points[3 * part + k] = centre[k] + across * halves[k] + up * halves[3 + k];
  }
  return points;
}

/** Return a cross of three lines about a point, as pairs of points. */
function cross(at, size) {
  const points = [];
  for (let axis = 0; axis < 3; axis++)
    for (const sign of [-1, 1]) {
      const end = Array.from(at);
      end[axis] += sign * size;
      points.push(...end);
    }
  return new Float32Array(points);
}

/** Add the buttons of the views, and the keys that both kinds of page have; `more` takes other keys. */
function views(space, more) {
  const all = [["scanner", "Scanner", "1"], ["top", "Top", "2"], ["side", "Side", "3"], ["all", "All", "0"]];
  for (const [name, words, letter] of all) byId("views").append(el("button", { type: "button", title: `key ${letter}`, onclick: () => space.look(name) }, words));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const view = all.find(([, , letter]) => letter === event.key);
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    if (view) space.look(view[0]);
    else if (event.key === "+" || event.key === "=") space.turn(0, 0, 1.15);
    else if (event.key === "-") space.turn(0, 0, 1 / 1.15);
    else if (event.shiftKey && event.key in turns) space.turn(...turns[event.key]);
    else if (!more(event.key)) return;
    event.preventDefault();
  });
}

const VIEW_KEYS = [["1 2 3 0", "views from the scanner, the top, the side, all"], ["+ −", "nearer, farther"], ["Shift ← → ↑ ↓", "turn"]];

/** Show words beside the pointer over a point, and choose it with a click that is no turn. */
function watchPointer(space, cloud, choose, words) {
  if (!space.renderer) return;
  const canvas = space.renderer.domElement, tip = byId("tip");
  let pressed = null, waiting = false;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => (pressed = place(event)));
  canvas.addEventListener("pointerup", (event) => {
    const at = place(event);
    if (pressed && Math.hypot(at[0] - pressed[0], at[1] - pressed[1]) < 4) {
      const i = space.under(cloud, ...at);
      if (i >= 0) choose(i);
    }
    pressed = null;
  });
  canvas.addEventListener("pointerleave", () => (tip.hidden = true));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons || waiting) return (tip.hidden = tip.hidden || event.buttons !== 0);
    waiting = true;
    const at = place(event);
    requestAnimationFrame(() => {
      waiting = false;
      const i = space.under(cloud, ...at);
      tip.hidden = i < 0;
      if (i < 0) return;
      tip.textContent = words(i);
      tip.style.left = `${Math.min(at[0] + 14, space.host.clientWidth - 170)}px`;
      tip.style.top = `${at[1] + 14}px`;
    });
  });
}
