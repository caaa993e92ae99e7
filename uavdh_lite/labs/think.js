// What an agent expects at each step of its flight, and why it acts so: the facts of the tool Think.

import { ACTIONS, HOVER, LAND, sum } from "./world.js";

const CLOSE = 0.5; // a gap between Q-values below which a decision is called close
const ENOUGH = 0.5; // data units of a device that are worth a reason,
const SOON = 3; // and the steps until then
const SPARE = 1; // units of time more than the way home takes, with which it has to fly home
const STAKE = 1; // data units that are still to be had, without which no decision is called close
const NONE = 0.05; // data units: all is collected

/** The second best action, and how far the best is ahead of it; Infinity where nothing else is allowed. */
function runnerUp(values) {
  const [best, second] = [...values.keys()].sort((one, other) => values[other] - values[one]);
  return { second, gap: values[best] - values[second] };
}

/**
 * The step with the smallest gap while data is left to be had, else the smallest of all.
 * @param {import("./flights.js").Flight} flight of an agent
 */
export function closestCall({ values, dataLeft }) {
  const all = values.map((each, step) => ({ step, gap: runnerUp(each).gap, stake: sum(dataLeft[step]) >= STAKE }));
  const serious = all.filter(({ gap, stake }) => stake && Number.isFinite(gap));
  const { step, gap } = (serious.length ? serious : all).reduce((one, other) => (other.gap < one.gap ? other : one));
  return { step, gap, stake: serious.length > 0 };
}

/**
 * What an agent does in a step, what for where its flight shows it, and how sure it is: a fact.
 * @param {{mission: object, environment: import("./world.js").Environment}} where it was flown
 */
export function choice(flight, step, where) {
  const { second, gap } = runnerUp(flight.values[step]);
  const close = gap < CLOSE && sum(flight.dataLeft[step]) >= STAKE;
  return {
    kind: "chooses",
    action: ACTIONS[flight.action[step]],
    reason: reasonOf(flight, step, where.environment.timeToLand),
    gap: Number.isFinite(gap) ? gap : null,
    second: ACTIONS[second],
    instead: close ? broughtBy(second, flight.states, step, where) : null,
  };
}

/** Data units that another action would bring in a step, with the same fading. */
function broughtBy(action, states, step, { mission, environment }) {
  const generator = mission.fading();
  const draws = states.slice(0, step + 1).map((state) => environment.drawFading(state, generator));
  return sum(environment.transition(states[step], action, draws[step]).outcome.uploaded);
}

function reasonOf(flight, step, timeToLand) {
  const { uavCell, dataLeft, landed } = flight;
  const [action, left] = [flight.action[step], flight.timeLeft[step]];
  const [home, after] = [timeToLand[uavCell[step]], timeToLand[uavCell[step + 1]]];
  const given = dataLeft.slice(step + 1).map((later) => dataLeft[step].map((each, k) => each - later[k]));
  const within = given.findIndex((each) => Math.max(...each) >= ENOUGH) + 1;
  if (flight.intervened[step]) return { kind: "refused" };
  const since = dataLeft.findIndex((each) => sum(each) < NONE); // after this step nothing is left
  if (action === LAND) return since >= 0 && since <= step ? { kind: "done", since: since < step ? since : 0 } : null;
  if (landed && after < home && left <= home + SPARE) return { kind: "home", home, left, now: true };
  const back = step > 0 && uavCell[step + 1] === uavCell[step - 1] && uavCell[step + 1] !== uavCell[step];
  if (back && within !== 1) return { kind: "back" };
  if (within) {
    const amount = Math.max(...given[within - 1]);
    const device = given[within - 1].indexOf(amount);
    const stays = within <= SOON && uavCell.slice(step, step + within + 1).every((cell) => cell === uavCell[step]);
    if (action !== HOVER || stays) return { kind: "gives", device, amount, within, way: within > SOON, back };
    return null;
  }
  return landed && after < home ? { kind: "home", home, left, now: false } : null;
}
