// Two flights of one mission: their difference in a sentence, where they part, what the other's
// action would have made of it, and the data of both over time.

import { at, escaped, momentAt, scaleOf, UAV } from "../player.js";
import { button, chooser } from "./html.js";
import { counted, says, upper } from "./words.js";
import { ACTIONS } from "./world.js";

export const COLOURS = ["#0072b2", "#d55e00"]; // of the first flight and the second
const AHEAD = 2; // of the return: a lead that makes a duel
const WORTH = 0.5; // of the return, and half of the lead: what a cause changes at least
const SIDE = 0.13; // cells by which the two ways lie beside each other

const tenths = (value) => Number(value.toFixed(1));
/** By how much the first's return is ahead, as both are shown. */
export const lead = ([first, second]) => tenths(tenths(first.return) - tenths(second.return));

/** The first step in which two flights act differently, null if there is none. */
export function parting(first, second) {
  const step = first.action.findIndex((action, k) => action !== second.action[k]);
  return step < 0 || step >= second.action.length ? null : step;
}

/**
 * The difference between two flights, in a sentence.
 * @param {import("./words.js").Who[]} who
 * @param {object[]} results of both, from `numbers`
 */
export function headline(who, results) {
  if (results.some(({ steps }) => !steps)) return "One flight has not begun: fly it first.";
  if (!results.every(({ ended }) => ended)) return "One flight is still in the air.";
  if (!results.some(({ landed }) => landed)) return "Both crash: no data comes home.";
  const late = results.findIndex(({ landed }) => !landed);
  if (late >= 0) {
    const [lost, won] = [says(who[late], "crashes"), who[1 - late]];
    return `${upper(lost)}; ${says(won, "brings", `${results[1 - late].collected.toFixed(1)} units home`)}.`;
  }
  const more = tenths(tenths(results[0].collected) - tenths(results[1].collected));
  const sooner = results[1].steps - results[0].steps;
  const first = (more || sooner) >= 0 ? 0 : 1;
  const steps = sooner && counted(Math.abs(sooner), "step");
  if (more) {
    const when = first === Number(sooner < 0) ? "sooner" : "later";
    const home = `${Math.abs(more).toFixed(1)} units more`;
    return `${upper(says(who[first], "brings", home))}${sooner ? `, ${steps} ${when}` : ""}.`;
  }
  return sooner
    ? `${upper(says(who[first], "lands", `${steps} sooner`))}, with as much data.`
    : `Level: as much data in as many steps.`;
}

/** Whether the first (1) or the second (−1) wins a mission by enough to be worth a look. */
export const isDuel = (wanted, results) =>
  results[wanted > 0 ? 0 : 1].landed && wanted * lead(results) > AHEAD;

const DONE = { hover: "hovered", land: "landed" };
const done = (action) => DONE[action] ?? `flown ${action}`;

/**
 * What the other's action where they part would have made of a flight, flown on by itself: a
 * sentence, or nothing if it changes little. Whoever is behind is asked first, if it can fly on.
 * @param {number | null} part  @param {object[]} results
 * @param {(which: number, actions: number[]) => object | null} flyOn numbers of what begins so
 */
export function cause(who, flights, results, part, flyOn) {
  if (part === null || !results.every(({ ended }) => ended)) return "";
  const behind = lead(results) < 0 ? 0 : 1;
  for (const which of [behind, 1 - behind]) {
    const other = flights[1 - which].action[part];
    const found = flyOn(which, [...flights[which].action.slice(0, part), other]);
    if (!found) continue;
    const own = results[which];
    if (Math.abs(lead([found, own])) < Math.max(WORTH, Math.abs(lead(results)) / 2)) continue;
    const more = found.collected.toFixed(1);
    const data = more !== own.collected.toFixed(1);
    const brought = !found.landed
      ? "crashed"
      : data || !own.landed
        ? `brought ${more} units home, not ${own.landed ? own.collected.toFixed(1) : "crashed"}`
        : `landed ${counted(Math.abs(own.steps - found.steps), "step")} ${found.steps < own.steps ? "sooner" : "later"}`;
    const name = who[which].subject;
    return `Tried: had ${name} ${done(ACTIONS[other])} at step ${part + 1} and then flown on by itself, it would have ${brought}.`;
  }
  return "";
}

export const COMPARE = {
  title: "Compare",
  words: [
    "greedy",
    "random",
    "DDQN agent",
    "imitation agent",
    "any-city agent",
    "collected and landed",
  ],
  html(scene) {
    const { panel, state, film } = scene;
    const { who, headline: head, cause: why, parting: part, many } = panel;
    const colours = [0, 1].map((k) =>
      chooser(["blue", "orange"][k], `policy-${k}`, state.known, state.policies[k], COLOURS[k]),
    );
    const duel = (k, wanted) => button(`${escaped(who[k].title)} ahead`, { kind: "duel", wanted });
    const hand = state.policies.includes("you");
    const more = `<div class="row">Find: ${duel(0, 1)}${duel(1, -1)}</div>
      <div class="row">${button("Fly 100 new missions", { kind: "many" })}</div>`;
    const look =
      part === null
        ? ""
        : `<div class="row">${button(`Where they part: step ${part + 1}`, { show: part })}</div>`;
    return `<h2 aria-live="polite">${escaped(head)}</h2><div class="row">${colours.join("")}</div>
      ${chart(film, who, part)}<p class="why">${escaped(why)}</p>${look}
      ${many ? hundred(many) : ""}${hand ? "" : more}`;
  },
  over({ film, panel: { parting: part } }) {
    const scale = scaleOf(film.city.length);
    const ways = film.flights.map(({ path }, k) => way(path, k));
    const [row, col] = film.flights[0].path[part ?? 0];
    const ring = part === null ? "" : `<circle class="parting" cx="${col}" cy="${row}" r=".62"/>`;
    const heard = COLOURS.map((colour) => `<path class="heard" style="--colour: ${colour}"/>`);
    const second = `<g class="uav second" style="--colour: ${COLOURS[1]}"><g transform="scale(${scale})">${UAV}</g></g>`;
    return `${ways.join("")}${ring}${heard.join("")}${second}`;
  },
  moment(stage, { film }, time) {
    film.flights.forEach((flight, k) => {
      const { place, served, now } = momentAt(flight, time);
      if (k) stage.find(".second")?.setAttribute("transform", at(place));
      const [row, col] = film.devices[served]?.cell ?? place;
      const flies = now > 0 && now < flight.path.length - 1;
      const line = flies ? `M${col} ${row}L${place[1]} ${place[0]}` : "";
      stage.el.querySelectorAll(".heard")[k]?.setAttribute("d", line);
    });
    const chart = stage.find(".chart");
    const x = chart ? xOf(time, Number(chart.dataset.steps)) : 0;
    chart?.querySelector(".now").setAttribute("d", `M${x} 14V${HEIGHT - 14}`);
    film.flights.forEach((flight, k) => {
      const text = chart?.querySelector(`.total-${k}`);
      if (text) text.textContent = `${inHand(flight, Math.floor(time)).toFixed(1)} units`;
    });
  },
  /** The step of a place on the chart. */
  stepAt(chart, x) {
    return ((x - LEFT) / (WIDTH - LEFT - RIGHT)) * Number(chart.dataset.steps);
  },
};

/** The way of a flight as one line, to the right of the cells' middles or to their left. */
function way(path, k) {
  const points = path.map(([row, col], step) => {
    const [before, after] = [path[Math.max(step - 1, 0)], path[step + 1] ?? path[step]];
    const [down, right] = [Math.sign(after[0] - before[0]), Math.sign(after[1] - before[1])];
    return `${col - (k ? -1 : 1) * SIDE * -down} ${row - (k ? -1 : 1) * SIDE * right}`;
  });
  return `<path class="way" style="--colour: ${COLOURS[k]}" d="M${points.join("L")}"/>`;
}

const [WIDTH, HEIGHT, LEFT, RIGHT, MIDDLE] = [440, 230, 8, 8, 112];
const xOf = (step, steps) => LEFT + ((WIDTH - LEFT - RIGHT) * step) / Math.max(steps, 1);
const inHand = ({ left }, step, k = null) => {
  const now = left[Math.min(step, left.length - 1)];
  const each = now.slice(0, -1).map((amount, device) => left[0][device] - amount);
  return k === null ? each.reduce((total, amount) => total + amount, 0) : each[k];
};

/** The data in hand of both over time, by device: the first upwards, the second downwards. */
function chart({ flights, devices }, who, part) {
  const steps = Math.max(...flights.map(({ path }) => path.length - 1));
  const all = flights[0].left[0].slice(0, -1).reduce((total, each) => total + each, 0);
  const areas = flights.map((flight, k) => {
    const y = (amount) => MIDDLE + (k ? 1 : -1) * (3 + ((MIDDLE - 20) * amount) / all);
    const times = [...flight.path.keys()];
    let below = times.map(() => 0);
    const layers = devices.map(({ colour }, device) => {
      const top = below.map((amount, step) => amount + inHand(flight, step, device));
      const line = (amounts) => amounts.map((amount, step) => `${xOf(step, steps)} ${y(amount)}`);
      const d = `M${line(top).join("L")}L${line(below).reverse().join("L")}z`;
      below = top;
      return `<path d="${d}" fill="${colour}" class="end-${flight.end}"/>`;
    });
    const [last, end] = [times.length - 1, { landed: "◆", crashed: "✸" }[flight.end] ?? ""];
    const name = `<text x="${LEFT + 4}" y="${k ? HEIGHT - 4 : 12}" fill="${COLOURS[k]}">${escaped(who[k].title)}
      <tspan class="total-${k}" dx="8"></tspan></text>`;
    return `${layers.join("")}<text class="end" x="${Math.min(xOf(last, steps), WIDTH - 8)}" y="${y(below.at(-1)) + (k ? 12 : -3)}">${end}</text>${name}`;
  });
  const parts =
    part === null ? "" : `<path class="parts" d="M${xOf(part, steps)} 16V${HEIGHT - 16}"></path>`;
  const told = flights.map((flight, k) => `${who[k].title}: ${flight.ending}`).join(" ");
  return `<svg class="chart" viewBox="0 0 ${WIDTH} ${HEIGHT}" data-steps="${steps}" role="img" aria-label="data in hand over time. ${escaped(told)}">
    <path class="axis" d="M${LEFT} ${MIDDLE}H${WIDTH - RIGHT}"/>${areas.join("")}${parts}<path class="now"/>
    <text class="about" x="${WIDTH - RIGHT}" y="${HEIGHT - 4}">data in hand, ${steps} steps</text></svg>`;
}

const points = (mean) => `${mean < 0 ? "−" : "+"}${Math.abs(mean).toFixed(1)}`;
/** What both bring home from a hundred missions, and the difference, with their intervals. */
function hundred({ rows, difference: [mean, low, high] }) {
  const least = Math.max(0, 10 * Math.floor(Math.min(...rows.map(({ both }) => both[1])) / 10 - 1));
  const x = (percent) => 130 + (260 * (percent - least)) / (100 - least);
  const row = ({ who, both: [middle, from, to] }, k) =>
    `<g stroke="${COLOURS[k]}" fill="${COLOURS[k]}"><text x="4" y="${20 + 24 * k}" stroke="none">${escaped(who.title)}</text>
      <path d="M${x(from)} ${16 + 24 * k}H${x(Math.min(to, 100))}" stroke-width="3"/><circle cx="${x(middle)}" cy="${16 + 24 * k}" r="5"/>
      <text x="${WIDTH - 4}" y="${20 + 24 * k}" stroke="none" text-anchor="end">${middle.toFixed(1)}</text></g>`;
  const ticks = [least, 100].map(
    (tick) =>
      `<path class="axis" d="M${x(tick)} 4V56"/><text class="about" x="${x(tick)}" y="70">${tick} %</text>`,
  );
  const open = low < 0 && high > 0 ? ": they may be level" : "";
  return `<div class="many" role="status"><p>Over 100 missions drawn just now, ${escaped(rows[0].who.subject)} has ${points(mean)} points
    (${points(low)} to ${points(high)}) of collected and landed${open}.</p>
    <svg viewBox="0 0 ${WIDTH} 74" role="img" aria-label="means with 95 % intervals">${ticks.join("")}${rows.map(row).join("")}</svg></div>`;
}
