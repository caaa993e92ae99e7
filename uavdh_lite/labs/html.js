// Pieces of HTML and SVG that the tools share, and what their words mean.

import { escaped, square } from "../player.js";

export const WORDS = {
  greedy: "a simple rule: fly to the nearest device with data, and home in time",
  random: "every action is equally likely",
  return:
    "the sum of rewards: each unit of data counts 1, each step −0.2 (a landing nothing), a refused action −1, a crash −150",
  fading:
    "random changes of the radio link, by their standard deviation; the same for all who fly a mission",
  "Q-value":
    "the return that the network expects from here on if it takes this action now; later rewards count less",
  score: "how surely the planner that the agent copied would take this action",
  SNR: "signal-to-noise ratio: how far the signal is above the noise, in decibels",
  "SNR at 1 m": "1 m from the device; set by the city's size, so that −15 dB are left at a corner",
  slot: "a quarter of a step; each goes to the device that is heard best, and brings log2(1 + SNR) units",
  value: "the Q-value or score of the best action if the UAV were over that cell now",
  "collected and landed": "the share of the data that was brought home; 0 after a crash",
  "path loss": "what the signal loses on its way: 22.7 dB each time the distance grows tenfold",
  "hidden by buildings": "what the signal loses in addition without a line of sight",
  "DDQN agent": "a neural network that learned from its own trials, by double deep Q-learning",
  "imitation agent":
    "a network that copied a planner and then learned on; a failsafe brings it home",
  "any-city agent": "one network for any city of at most 16 by 16 cells, with a failsafe",
};
export const button = (name, about, more = "") =>
  `<button type="button" data-ask="${escaped(JSON.stringify(about))}" ${more}>${name}</button>`;
export const options = (pairs, chosen) =>
  pairs
    .map(
      ([value, name]) =>
        `<option value="${escaped(String(value))}" ${value === chosen ? "selected" : ""}>${escaped(name)}</option>`,
    )
    .join("");
/** A list with its label, or with a line in its colour in place of one. */
export function chooser(label, name, pairs, chosen, colour = null) {
  const key = colour ? `<i class="key" style="--colour: ${colour}"></i>` : label;
  const all = options(pairs, chosen);
  return `<span class="chooser">${key} <select data-set="${name}" aria-label="${label}">${all}</select></span>`;
}
// Colours of a scale from 0 to 1, which colour-blind readers can follow too (viridis)
const SCALE = ["68 1 84", "59 82 139", "33 145 140", "94 201 98", "253 231 37"].map((rgb) =>
  rgb.split(" ").map(Number),
);
export function colourOf(share) {
  const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(place), SCALE.length - 2);
  return `rgb(${SCALE[k].map((low, c) => Math.round(low + (place - k) * (SCALE[k + 1][c] - low))).join(" ")})`;
}
const GRADIENT = `linear-gradient(to right, ${[0, 0.25, 0.5, 0.75, 1].map(colourOf).join(", ")})`;
export const ramp = (low, high, about) =>
  `<div class="ramp"><span>${low}</span><i style="background: ${GRADIENT}"></i><span>${high}</span><small>${about}</small></div>`;

/** Squares in the colours of the values of cells, by number; null is left out. */
export const heat = (values, size, colour, opacity = 0.85) =>
  `<g fill-opacity="${opacity}" shape-rendering="crispEdges">${values
    .map((each, cell) =>
      each === null
        ? ""
        : `<path d="${square([Math.floor(cell / size), cell % size])}" fill="${colour(each)}"/>`,
    )
    .join("")}</g>`;

/** The outline of the cells, by number, for which something holds. */
export function outline(values, size, holds) {
  const inside = (y, x) => y >= 0 && y < size && x >= 0 && x < size && holds(values[y * size + x]);
  let d = "";
  values.forEach((_, cell) => {
    const [y, x] = [Math.floor(cell / size), cell % size];
    if (!inside(y, x)) return;
    const [left, top] = [x - 0.5, y - 0.5];
    if (!inside(y - 1, x)) d += `M${left} ${top}h1`;
    if (!inside(y + 1, x)) d += `M${left} ${top + 1}h1`;
    if (!inside(y, x - 1)) d += `M${left} ${top}v1`;
    if (!inside(y, x + 1)) d += `M${left + 1} ${top}v1`;
  });
  return `<path class="outline" d="${d}"/>`;
}
