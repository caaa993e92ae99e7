// Two flights of one mission: their difference in a sentence, where they part, what the other's
// action would have made of it, and the data of both over time.

import { at, escaped, momentAt, scaleOf, UAV } from "../player.js";
import { NETWORKS, button, chooser } from "./html.js";
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
 * sentence, or nothing if it does not explain who is ahead. Whoever is behind is asked first, if it
 * can fly on.
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
    const less = which === behind ? lead([found, own]) : lead([own, found]); // of the distance
    if (less < Math.max(WORTH, Math.abs(lead(results)) / 2)) continue;
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
  words: ["greedy", "random", ...NETWORKS, "collected and landed"],
  html(scene) {
    const { panel, state } = scene;
    const { who, headline: head, cause: why, parting: part, many } = panel;
    const duel = (k, wanted) => button(`${escaped(who[k].title)} ahead`, { kind: "duel", wanted });
    const hand = state.policies.includes("you");
    const more = `<div class="row">Find: ${duel(0, 1)}${duel(1, -1)}</div>
      <div class="row">${button("Fly 100 new missions", { kind: "many" })}</div>`;
    const look =
      part === null
        ? ""
        : `<div class="row">${button(`Where they part: after step ${part}`, { show: part })}</div>`;
    return `<h2 aria-live="polite">${escaped(head)}</h2>${chart(scene)}<p class="why">${escaped(why)}</p>${look}
      ${many ? hundred(many) : ""}${hand ? "" : more}`;
  },
  maps: 2,
  /** Both flights on each of two maps; where there is no room for the second, the first shows both. */
  over({ film, panel: { parting: part } }) {
    const scale = scaleOf(film.city.length);
    const ways = film.flights.map(({ path }, k) => way(path, k));
    const [row, col] = film.flights[0].path[part ?? 0];
    const ring = part === null ? "" : `<circle class="parting" cx="${col}" cy="${row}" r=".62"/>`;
    const line = (colour, k) => `<path class="heard of-${k}" style="--colour: ${colour}"/>`;
    const heard = COLOURS.map(line);
    const second = `<g class="uav second" style="--colour: ${COLOURS[1]}"><g transform="scale(${scale})">${UAV}</g></g>`;
    return `${ways.join("")}${ring}${heard.join("")}${second}`;
  },
  moment(stage, { film }, time) {
    film.flights.forEach((flight, k) => {
      const { place, served, now } = momentAt(flight, time);
      if (k) stage.find(".second").setAttribute("transform", at(place));
      const [row, col] = film.devices[served]?.cell ?? place;
      const last = flight.path.length - 1;
      const line = now > 0 && now < last ? `M${col} ${row}L${place[1]} ${place[0]}` : "";
      for (const each of stage.el.querySelectorAll(`.heard.of-${k}`)) each.setAttribute("d", line);
      const end = now === last ? `, ${flight.end}` : "";
      const text = `${inHand(flight, Math.floor(time)).toFixed(1)} units${end}`;
      stage.find(`.total-${k}`).textContent = text;
    });
    stage.find(".chart .now").setAttribute("d", `M${time} -1V1`);
  },
};

/** The way of a flight as one line, to the right of the cells' middles or to their left. */
function way(path, k) {
  const points = path.map(([row, col], step) => {
    const [before, after] = [path[Math.max(step - 1, 0)], path[step + 1] ?? path[step]];
    const [down, right] = [Math.sign(after[0] - before[0]), Math.sign(after[1] - before[1])];
    return `${col - (k ? -1 : 1) * SIDE * -down} ${row - (k ? -1 : 1) * SIDE * right}`;
  });
  return `<path class="way of-${k}" style="--colour: ${COLOURS[k]}" d="M${points.join("L")}"/>`;
}

const inHand = ({ left }, step, k = null) => {
  const now = left[Math.min(step, left.length - 1)];
  const each = now.slice(0, -1).map((amount, device) => left[0][device] - amount);
  return k === null ? each.reduce((total, amount) => total + amount, 0) : each[k];
};

/** The data in hand of both over time, by device: the first upwards, the second downwards. */
function chart({ film: { flights, devices }, panel: { who, parting: part }, state }) {
  const steps = Math.max(...flights.map(({ path }) => path.length - 1), 1);
  const all = flights[0].left[0].slice(0, -1).reduce((total, each) => total + each, 0);
  const areas = flights.map((flight, k) => {
    const times = [...flight.path.keys()];
    const line = (amounts) =>
      amounts.map((amount, step) => `${step} ${((k ? 1 : -1) * amount) / all}`);
    let below = times.map(() => 0);
    const layers = devices.map(({ colour }, device) => {
      const top = below.map((amount, step) => amount + inHand(flight, step, device));
      const d = `M${line(top).join("L")}L${line(below).reverse().join("L")}z`;
      below = top;
      return `<path d="${d}" fill="${colour}" class="end-${flight.end}"/>`;
    });
    return layers.join("");
  });
  const parts = part === null ? "" : `<path class="parts" d="M${part} -1V1"/>`;
  const told = flights.map((flight, k) => `${who[k].title}: ${flight.ending}`).join(" ");
  const name = (k, more = "") => `<figcaption>
    ${chooser(["blue", "orange"][k], `policy-${k}`, state.known, state.policies[k], COLOURS[k])}
    <b class="total-${k}"></b>${more}</figcaption>`;
  return `<figure class="chart">${name(0)}<svg viewBox="0 -1 ${steps} 2" preserveAspectRatio="none" role="img"
    aria-label="data in hand over time. ${escaped(told)}">${areas.join("")}
    ${parts}<path class="now"/></svg>${name(1, `<small>data in hand, ${steps} steps</small>`)}</figure>`;
}

const points = (mean) => `${mean < 0 ? "−" : "+"}${Math.abs(mean).toFixed(1)}`;
/** What both bring home from a hundred missions, and the difference, with their intervals. */
function hundred({ rows, difference: [mean, low, high] }) {
  const row = ({ who, both: [middle, from, to] }, k) =>
    `<div class="hand" style="--colour: ${COLOURS[k]}; --from: ${from}%; --share: ${to}%">
      <span>${escaped(who.title)}</span><i></i><output>${middle.toFixed(1)} %</output></div>`;
  const open = low < 0 && high > 0 ? ": it may be chance" : "";
  return `<div class="many" role="status"><p>Over 100 missions drawn just now, ${escaped(rows[0].who.subject)} has ${points(mean)} points
    (${points(low)} to ${points(high)}) of collected and landed${open}.</p>${rows.map(row).join("")}</div>`;
}
