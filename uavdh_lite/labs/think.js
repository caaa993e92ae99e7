// What a network expects of each action, and what changes that: a device away or moved, the time.

import { at, escaped, momentAt, scaleOf } from "../player.js";
import { NETWORKS, button, chooser, ramp, valued } from "./html.js";
import { listed, signed, upper } from "./words.js";
import { ACTIONS } from "./world.js";

const NONE = 0.05; // data units: all is collected
const SPARE = 10; // units of time more, to see whether the time decides
export const RANGE = 20; // units of time more or less that one can try

const bestOf = (values) => values.indexOf(Math.max(...values));

/** A state in which some devices are away or elsewhere, and the time is another. */
export function changed(state, { away = [], moved = {}, time = 0 }, city) {
  const copied = [state.deviceCells, state.dataInitial, state.dataLeft];
  const [deviceCells, dataInitial, dataLeft] = copied.map((each) => each.slice());
  for (const device of away) dataInitial[device] = dataLeft[device] = 0;
  for (const [device, cell] of Object.entries(moved)) deviceCells[device] = city.cell(cell);
  const timeLeft = Math.max(state.timeLeft + time, 1);
  return { ...state, deviceCells, dataInitial, dataLeft, timeLeft };
}

/**
 * What each device is worth in a state, the best value less that without it, and what it would do
 * without it and with more time: the network is asked again each time.
 * @param {(state: object) => Float32Array} valuesOf
 */
export function worths(state, valuesOf) {
  const values = valuesOf(state);
  const best = bestOf(values);
  const without = (device) => valuesOf(changed(state, { away: [device] }));
  const devices = [...state.dataLeft.keys()].filter((k) => state.dataLeft[k] >= NONE);
  return {
    devices: devices.map((device) => {
      const other = without(device);
      const action = bestOf(other);
      return { device, worth: values[best] - Math.max(...other), action };
    }),
    time: bestOf(valuesOf(changed(state, { time: SPARE }))),
  };
}

/** What an action is caused by: what, taken away alone, leads to another. */
function causes({ devices, time }, best) {
  const other = devices.filter(({ action }) => action !== best);
  const told = other.map(({ device, action }) => [`without device ${device}`, action]);
  if (time !== best) told.push([`with ${SPARE} more units of time`, time]);
  const chooses = ([why, action], k) => `${why} ${k ? "" : "it would choose "}${ACTIONS[action]}`;
  return told.length
    ? upper(`${listed(told.map(chooses))}.`)
    : devices.length
      ? "Without any one device it chooses the same."
      : "";
}

/** What a flight brought from a step on, as a Q-value counts it. */
export const cameOf = (rewards, step, discount) =>
  rewards.slice(step).reduceRight((total, reward) => reward + discount * total, 0);

export const THINK = {
  title: "Think",
  begins: true,
  words: ["Q-value", "score", ...NETWORKS],
  html(scene) {
    const { panel, state, film } = scene;
    if (!panel.agent)
      return `<h2>No network knows this city</h2><p>Choose another city, or paint one of at most 16 by 16 cells.</p>`;
    const { whatIf, agents } = panel;
    const edited = whatIf.away.length || Object.keys(whatIf.moved).length || whatIf.time;
    const row = ({ number, colour }, k) => {
      const away = whatIf.away.includes(k);
      const there = away || whatIf.moved[k];
      const word = away ? "with" : there ? "put back" : "without";
      const told = { kind: "whatIf", device: k, away: !there };
      return `<tr style="--colour: ${colour}"><th scope="row">device ${number}</th><td><i class="worth" data-worth="${k}"></i></td>
        <td class="amount" data-amount="${k}"></td><td>${button(word, told, `class="try-${k}" aria-label="${word} device ${number}"`)}</td></tr>`;
    };
    const look = (name, text) => `<label><input type="checkbox" data-set="${name}"
        ${state.looks[name] ? "checked" : ""}> ${text}</label>`;
    return `<h2 class="chosen" aria-live="polite"></h2>
      <svg class="rose" viewBox="-4.7 -3.1 9.4 6.2" role="img" aria-label="${panel.number}s of the actions"></svg>
      <p class="cause"></p>
      <table class="worths"><caption>worth: ${panel.number} lost without it</caption>${film.devices.map(row).join("")}</table>
      <div class="row"><label>what if: time <input type="range" data-set="whatif-time" min="-${RANGE}" max="${RANGE}" value="${whatIf.time}"
        aria-label="units of time more or less"></label><output class="time">${whatIf.time > 0 ? "+" : ""}${whatIf.time}</output>
        ${edited ? button("As it was", { kind: "whatIf", clear: true }) : "<small>or drag a device</small>"}</div>
      <div class="row">${look("centred", "see as it does, centred")}${look("value", "value of each cell")}
        ${agents.length > 1 ? chooser("network", "policy-0", agents, panel.name) : ""}</div>
      <div class="layer-scale"></div>`;
  },
  over({ panel, film }) {
    if (!panel.agent) return "";
    const gone = panel.whatIf.away.map((k) => {
      const [row, col] = film.devices[k].cell;
      return `<path class="gone" d="M${col - 0.5} ${row - 0.5}l1 1m0 -1l-1 1"/>`;
    });
    return `<g class="layer"></g>${gone.join("")}<g class="rose"></g>`;
  },
  moment(stage, scene, time, playing) {
    const { panel, film } = scene;
    if (!panel.agent) return;
    const [flight] = film.flights;
    const step = Math.min(Math.floor(time + 1e-9), panel.values.length - 1);
    const [values, other] = [panel.values[step], panel.other?.[step] ?? null];
    const best = bestOf(values.map((each) => each ?? -Infinity));
    const now = other ? bestOf(other.map((each) => each ?? -Infinity)) : best;
    const will = other
      ? `What if: ${ACTIONS[now]}${now === best ? ", as before" : `, not ${ACTIONS[best]}`}`
      : `Step ${step + 1}: ${ACTIONS[best]}`;
    stage.fill(".chosen", time >= flight.path.length - 1 ? `It has ${flight.end}.` : will);
    stage.fill(".tool .rose", rose(other ?? values, other ? values : null, true));
    const map = stage.find(".map .rose");
    if (map) {
      const scale = Math.max(0.75, scaleOf(film.city.length));
      map.setAttribute("transform", `${at(momentAt(flight, time).place)} scale(${scale})`);
      map.innerHTML = time >= flight.path.length - 1 ? "" : rose(other ?? values, null, false);
    }
    this.why(stage, panel, film, step, best, playing);
    this.layer(stage, scene, step, time);
  },
  why(stage, { why, expected, came, number, other }, { devices, flights }, step, best, playing) {
    const known = why?.step === step ? why : null;
    const most = Math.max(1, ...(known?.devices ?? []).map(({ worth }) => worth));
    devices.forEach((_, k) => {
      const found = known?.devices.find(({ device }) => device === k);
      const bar = stage.find(`[data-worth="${k}"]`);
      if (!bar) return;
      const share = found ? Math.max(found.worth, 0) / most : 0;
      bar.style.setProperty("--share", `${100 * share}%`);
      const empty = flights[0].left[step][k] < NONE;
      const text = empty ? "empty" : found ? signed(found.worth) : "";
      stage.find(`[data-amount="${k}"]`).textContent = text;
    });
    const promise =
      number === "Q-value" && !other
        ? `It expects ${signed(expected[step])} from here on, and got ${signed(came[step])}, with later rewards discounted. `
        : "";
    stage.fill(".cause", `${promise}${known && !other ? escaped(causes(known, best)) : ""}`);
    if (!known && !playing) stage.askWhenFree({ kind: "why", step });
  },
  layer(stage, { panel, film, state }, step, time) {
    const { value, centred } = state.looks;
    const known =
      value && panel.map?.step === step ? valued(panel.map.values, film.city.length) : null;
    stage.centre(centred ? momentAt(film.flights[0], time).place : null);
    stage.find(".main").classList.toggle("layered", value);
    const layer = stage.find(".layer");
    if (layer) layer.innerHTML = `${known?.cells ?? ""}${centred ? outside(film.city.length) : ""}`;
    const about = "the best value if the UAV were there";
    const scale = () => ramp(`${signed(known.low)} or less`, signed(known.high), about);
    stage.fill(".layer-scale", known ? scale() : "");
    if (value && !known) stage.askWhenFree({ kind: "values", step });
  },
};

const WAYS = { right: [0, 1, 0, -1, 0.72, 0.72], down: [-1, 0, 1, 0, -0.72, 0.72] }; // of the bars
/** Bars around the UAV, from the worst allowed action to the best; `before` as thin lines. */
export function rose(values, before, labelled) {
  const known = [...values, ...(before ?? [])].filter((each) => each !== null);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const best = bestOf(values.map((each) => each ?? -Infinity));
  const length = (value) => 0.15 + (1.5 * (value - low)) / (high - low || 1);
  const bar = (value, k, about) => {
    const [right, down] = [WAYS.right[k], WAYS.down[k]];
    const end = 0.55 + length(value);
    return `<path ${about} d="M${0.55 * right} ${0.55 * down}L${end * right} ${end * down}"/>`;
  };
  const drawn = values.map((value, k) => {
    const [right, down] = [WAYS.right[k], WAYS.down[k]];
    const line = value === null ? "" : bar(value, k, `class="${k === best ? "best" : ""}"`);
    const old = before && before[k] !== null ? bar(before[k], k, 'class="before"') : "";
    if (!labelled) return line;
    const to =
      value === null
        ? 1.2
        : 0.75 + Math.max(0.45, length(value), before?.[k] == null ? 0 : length(before[k]));
    const anchor = right ? (right < 0 ? "end" : "start") : "middle";
    const [x, y] = [to * right, to * down + (k < HALF ? 0.2 * down : 0)];
    const text = value === null ? "not allowed" : signed(value);
    return `${line}${old}<text x="${x}" y="${y}" dy=".35em" style="--anchor: ${anchor}" class="${k === best ? "best" : ""}">${ACTIONS[k]} ${text}</text>`;
  });
  return `${drawn.join("")}${labelled ? '<circle r=".42" class="hub"/>' : ""}`;
}
const HALF = 4; // of the actions are moves

/** All around a city of this size lies a no-fly zone, as far as the network sees. */
const outside = (size) =>
  `<path class="outside" d="M${-size} ${-size}h${3 * size}v${3 * size}h${-3 * size}zM-.5 -.5v${size}h${size}v${-size}z"/>`;
