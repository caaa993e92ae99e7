// What an agent expects at each step of its flight, and why it acts so: the facts of the tool Think.

import { ACTIONS, HOVER, LAND, sum } from "./world.js";

const CLOSE = 0.5; // a gap between Q-values below which a decision is called close
const ENOUGH = 0.5; // data units of a device that are worth a reason,
const SOON = 3; // and the steps until then
const SPARE = 1; // units of time more than the way home takes, with which it has to fly home
const STAKE = 1; // data units that are still to be had


/** The two largest of a step's values, as `[number, number]` of actions, the best first. */
const order = (values) => [...values.keys()].sort((one, other) => values[other] - values[one]);

/** How far the best action is ahead of the second at each step; Infinity where nothing else is allowed. */
const gaps = (values) =>
  values.map((each) => {
    const [best, second] = order(each);
    return each[best] - each[second];
  });

/**
 * The step with the smallest gap while data is left to be had, else the smallest of all.
 * @param {Float32Array[]} values of each step
 * @param {import("./flights.js").Flight} flight
 */
export function closestCall(values, flight) {
  const all = gaps(values);
  const stake = all.map((_, k) => sum(flight.dataLeft[k]) >= STAKE);
  const some = all.some((gap, k) => stake[k] && Number.isFinite(gap));
  const step = all.reduce(
    (best, gap, k) => ((stake[k] || !some) && gap < (all[best] ?? Infinity) ? k : best),
    -1,
  );
  return { step: Math.max(step, 0), gap: all[Math.max(step, 0)], stake: some };
}

/**
 * What it does in a step, what for where its flight shows it, and how sure it is: a fact.
 * @param {(cell: number) => number} timeToLand
 */
export function choice(flight, values, step, timeToLand) {
  const [best, second] = order(values[step]);
  const gap = values[step][best] - values[step][second];
  return {
    kind: "chooses",
    action: ACTIONS[flight.action[step]],
    reason: reasonOf(flight, step, timeToLand),
    gap: Number.isFinite(gap) ? gap : null,
    second: ACTIONS[second],
    close: gap < CLOSE,
  };
}

function reasonOf(flight, step, timeToLand) {
  const { uavCell, dataLeft, landed } = flight;
  const [action, left] = [flight.action[step], flight.timeLeft[step]];
  const [home, after] = [timeToLand(uavCell[step]), timeToLand(uavCell[step + 1])];
  const given = dataLeft.slice(step + 1).map((later) => dataLeft[step].map((each, k) => each - later[k]));
  const within = given.findIndex((each) => Math.max(...each) >= ENOUGH) + 1;
  if (flight.intervened[step]) return { kind: "refused" };
  if (action === LAND) return sum(dataLeft[step]) < 0.05 ? { kind: "done" } : null;
  if (landed && after < home && left <= home + SPARE) return { kind: "home", home, left, now: true };
  const back = step > 0 && uavCell[step + 1] === uavCell[step - 1] && uavCell[step + 1] !== uavCell[step];
  if (back) return { kind: "back" };
  if (within) {
    const amount = Math.max(...given[within - 1]);
    const device = given[within - 1].indexOf(amount);
    if (within <= SOON || action !== HOVER) return { kind: "gives", device, amount, within, way: within > SOON };
    return null;
  }
  return landed && after < home ? { kind: "home", home, left, now: false } : null;
}
