// Pieces of HTML and SVG that the tools share, and what their words mean.

import { escaped, square } from "../player.js";

export const DIAL_WORDS = {
  "learning rate": "how far an update moves the network's numbers; seed: all that chance draws",
  "discount γ": "how much a reward counts that comes a step later",
  "exploration β": "how often an action is tried that seems worse than the best",
  target: "a second network that judges and follows at rate τ; double: the first one chooses",
  memory: "the steps that it learns from; return steps: rewards counted before the judge's value",
  "input scales": "small numbers for the network; layer norm: its neurons on one scale",
  "in place": "the map is not shifted so that the UAV is in the middle; ↻: restarts",
};
export const WORDS = {
  ...DIAL_WORDS,
  greedy: "a simple rule: fly to the nearest device with data, and home in time",
  random: "picks each action with equal probability",
  return: "the sum of rewards: 1 for a unit of data, −0.2 a step, −1 a refusal, −150 a crash",
  fading: "random changes of the radio link, the same for all who fly a mission",
  "Q-value": "the return expected from here on with this action; later rewards count less",
  score: "how strongly the network prefers this action, as the planner would that it copied",
  SNR: "signal-to-noise ratio: how far the signal is above the noise, in decibels",
  "SNR at 1 m": "1 m from the device, chosen so that the signal reaches the city's corners",
  slot: "a part of a step; the best signal gets it: log2(1 + SNR) units, the SNR as a ratio",
  value: "the Q-value or score of the best action if the UAV were over that cell now",
  "collected and landed": "the share of the data that was brought home; 0 after a crash",
  "path loss": "what the signal loses on its way, the same in dB for each tenfold distance",
  "hidden by buildings": "what the signal loses in addition without a line of sight",
  "DDQN agent": "a neural network that learned from its own trials, by double deep Q-learning",
  "imitation agent": "copied a planner and then learned on; a failsafe brings it home",
  "any-city agent": "one network for any city of at most 16 by 16 cells, with a failsafe",
};
export const NETWORKS = ["DDQN agent", "imitation agent", "any-city agent"]; // of those words
export const button = (name, about, more = "") =>
  `<button type="button" data-ask="${escaped(JSON.stringify(about))}" ${more}>${name}</button>`;
export function options(pairs, chosen) {
  const option = ([value, name]) =>
    `<option value="${escaped(`${value}`)}" ${value === chosen ? "selected" : ""}>${escaped(name)}</option>`;
  return pairs.map(option).join("");
}
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

/** What each cell is worth, drawn, and the scale; what is far below the best looks alike. */
export function valued(values, size) {
  const known = values.filter((value) => value !== null);
  const high = Math.max(...known);
  const low = Math.max(Math.min(...known), high - 15);
  const colour = (value) => colourOf((value - low) / (high - low || 1));
  return { low, high, cells: heat(values, size, colour) };
}
