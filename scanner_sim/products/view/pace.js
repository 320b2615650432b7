"use strict";
// How many points are drawn while the camera moves: as many as leave 30 frames a second.

const DRAWING_MS = 16; // of the 33 of a frame: the rest is for the browser, which lays the picture into its page
const TOO_QUICK = 0.6; // of that: between the two nothing changes
const FRAMES_TOGETHER = 5; // whose median decides: one that is late by chance changes nothing
const LEAST_SHARE = 0.01;
const LEAST_POINTS = 4000;
const WIDER = 1.6; // strewn at random they leave more bare than on the grid of a raster: e to the −π/4, with this to the −2

/** Return the numbers below a count in an order of no pattern, the same each time: a part of it is an even choice. */
function shuffled(count) {
  const order = Uint32Array.from({ length: count }, (_, i) => i);
  let state = 1;
  for (let i = count - 1; i > 0; i--) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0; // a linear congruence, of Numerical Recipes
    const j = Math.floor((state / 2 ** 32) * (i + 1));
    [order[i], order[j]] = [order[j], order[i]];
  }
  return order;
}

/** Put those of an order that have an alpha to the front of an index, in that order; return how many they are. */
function indexShown(order, colours, index) {
  let count = 0;
  for (const i of order) if (colours[4 * i + 3]) index[count++] = i;
  return count;
}

/** Return how many of so many points are drawn for a share of them, and by what factor each is wider then. */
function thinned(count, share) {
  const drawn = Math.min(count, Math.max(LEAST_POINTS, Math.ceil(share * count)));
  return { drawn, wider: drawn < count ? WIDER * Math.sqrt(count / drawn) : 1 };
}

/** The share of the points that is drawn while the camera moves; it begins with one that is known to be quick. */
class Pace {
  constructor(share) {
    this.share = share;
    this.costs = [];
  }

  /** Learn what a frame with this share of the points took [ms]. */
  took(cost) {
    this.costs.push(cost);
    if (this.costs.length < FRAMES_TOGETHER) return;
    const typical = this.costs.sort((a, b) => a - b)[FRAMES_TOGETHER >> 1];
    if (typical > DRAWING_MS || typical < TOO_QUICK * DRAWING_MS) {
      const wanted = (0.85 * DRAWING_MS) / typical;
      this.share = Math.max(LEAST_SHARE, Math.min(1, this.share * Math.max(0.3, Math.min(2, wanted))));
    }
    this.costs = [];
  }
}
