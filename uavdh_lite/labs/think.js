// What an agent expects at each step of its flight, and why it acts so: the facts of the tool Think.

import { NONE, emptied, turnsHome } from "./compare.js";
import { ACTIONS, CHANNEL, HOVER, LAND, REWARDS, kept, rate, sum } from "./world.js";

const CLOSE = 0.5; // a gap between Q-values below which a decision is called close
const ENOUGH = 0.5; // data units of a device that are worth a reason,
const SPARE = 1; // units of time more than the way home takes, with which it has to fly home
const STAKE = 1; // data units that are still to be had, without which no decision is called close
const WEIGHTS = [1, 0.5, 0.25, 0.125]; // of data against steps, by which a way is sought
const LESS = 0.05; // data units that the second best action brings less, so that data is a reason

/** The second best action, and how far the best is ahead of it; Infinity where nothing else is allowed. */
function runnerUp(values) {
  const [best, second] = [...values.keys()].sort((one, other) => values[other] - values[one]);
  return { second, gap: values[best] - values[second] };
}

/**
 * The step with the smallest gap while data is left to be had, else the smallest of all; then also where a later gap is smaller.
 * Null if no step leaves a choice.
 * @param {import("./flights.js").Flight} flight of an agent
 */
export function closestCall({ values, dataLeft }) {
  const all = values.map((each, step) => ({
    step,
    gap: runnerUp(each).gap,
    stake: sum(dataLeft[step]) >= STAKE,
  }));
  const open = all.filter(({ gap }) => Number.isFinite(gap));
  if (!open.length) return null;
  const serious = open.filter(({ stake }) => stake);
  const [closest, smallest] = [serious.length ? serious : open, open].map((some) =>
    some.reduce((one, other) => (other.gap < one.gap ? other : one)),
  );
  const { step, gap } = closest;
  return {
    step,
    gap,
    stake: serious.length > 0,
    smaller:
      smallest === closest
        ? null
        : { step: smallest.step, gap: smallest.gap, empty: sum(dataLeft[smallest.step]) < NONE },
  };
}

/**
 * What an agent does in each step, what for where its flight shows it, and how sure it is: facts. What the second
 * best action would bring in the same step, with the same fading, tells whether data is a reason.
 * @param {{mission: object, environment: import("./world.js").Environment}} where it was flown
 */
export function choices(flight, { mission, environment }) {
  const generator = mission.fading();
  return flight.values.map((values, step) => {
    const { second, gap } = runnerUp(values);
    const state = flight.states[step];
    const other = environment.transition(state, second, environment.drawFading(state, generator));
    const [brings, instead] = [
      sum(flight.dataLeft[step]) - sum(flight.dataLeft[step + 1]),
      sum(other.outcome.uploaded),
    ];
    const more = instead <= brings - LESS;
    const reason = reasonOf(flight, step, environment, other.state.uavCell, more);
    const now = reason?.kind === "gives" && reason.within === 1;
    const close = gap < CLOSE && sum(flight.dataLeft[step]) >= STAKE;
    return {
      kind: "chooses",
      action: ACTIONS[flight.action[step]],
      reason: now && !more ? null : reason,
      gap: Number.isFinite(gap) ? gap : null,
      second: ACTIONS[second],
      close,
      both:
        close || now
          ? { brings, instead, ...beside(flight, step, other, { mission, environment }) }
          : null,
    };
  });
}

/**
 * What is different after the second best action: it is `over`, `home` is so many steps farther, devices with data left are `hidden`
 * that the best action sees, or `seen` that it does not, and it `costs` so many refusals more. `alone`: nothing else can matter.
 */
function beside(
  { uavCell, dataLeft, intervened },
  step,
  { state, outcome },
  { mission, environment },
) {
  const [here, there, left] = [uavCell[step + 1], state.uavCell, dataLeft[step + 1]];
  const sees = (k, cell) => environment.sight(environment.city.cell(mission.devices[k]))[cell];
  const only = (one, other) =>
    [...mission.devices.keys()].filter((k) => left[k] >= NONE && sees(k, one) && !sees(k, other));
  return {
    over: state.landed,
    home: environment.timeToLand[there] - environment.timeToLand[here],
    hidden: only(here, there),
    seen: only(there, here),
    costs: outcome.intervened - intervened[step],
    alone: here === there || [left, state.dataLeft].every((each) => sum(each) < NONE),
  };
}

/**
 * For each step of a flight that leaves data behind from where it `says` that it flies home, null for others: a fact about what could still
 * have been had in time.
 * `could` is a flight on from there that brings `least` or more beyond what its steps cost: how much more, from which devices, in how many
 * steps. It is null if none was found; `none`: there is none. All without fading.
 */
export function missed(flight, says, { environment }) {
  const { timeToLand } = environment;
  const end = flight.dataLeft.at(-1);
  const behind = [...end.keys()].filter((k) => end[k] >= NONE);
  if (!flight.landed || sum(end) < ENOUGH) return Array.from(flight.action, () => null);
  const goes = says.findIndex(({ reason }) => reason?.kind === "home" || reason?.home);
  const turns = Math.min(turnsHome(flight, timeToLand), goes < 0 ? Infinity : goes);
  const ways = waysOn(environment, flight.states[turns], behind);
  const of = (left) => sum(behind.map((k) => left[k]));
  let later = null; // it may fly on as it does and turn off then
  const facts = Array.from(flight.action, () => null);
  for (let step = flight.action.length - 1; step >= turns; step--) {
    const state = flight.states[step];
    const home = timeToLand[state.uavCell];
    const most = WEIGHTS.map(
      (weight) =>
        ways(behind, weight).most[state.timeLeft][state.uavCell] +
        of(end) -
        weight * of(state.dataLeft),
    );
    const none = Math.min(...most) - REWARDS.movement * (home - 1) < ENOUGH;
    const all = none
      ? []
      : WEIGHTS.map((weight) =>
          flownOn(environment, state, behind, (open) => ways(open, weight), end),
        );
    const gain = ({ amount, steps }) => amount + REWARDS.movement * (steps - home);
    const could = [...all, ...(later ? [{ ...later, steps: later.steps + 1 }] : [])].reduce(
      (one, other) => (gain(other) > gain(one) ? other : one),
      { amount: 0, steps: home },
    );
    later = gain(could) >= ENOUGH ? could : null;
    facts[step] = {
      kind: "missed",
      step,
      left: sum(end),
      least: ENOUGH,
      none,
      could: later,
      fades: !environment.meanSnrDb,
    };
  }
  return facts;
}

/** A flight on from a state by `ways`, without fading: how much less it leaves than `end`, at which devices, and in how many steps. */
function flownOn(environment, from, behind, ways, end) {
  const quiet = new Float32Array(CHANNEL.slots * from.deviceCells.length);
  let state = from;
  while (!state.landed) {
    const open = behind.filter((k) => state.dataLeft[k] >= NONE);
    const action = open.length
      ? ways(open).action[state.timeLeft][state.uavCell]
      : environment.wayHome[state.uavCell];
    ({ state } = environment.transition(state, action, quiet));
  }
  const { dataLeft } = state;
  return {
    amount: sum(end) - sum(dataLeft),
    devices: behind.filter((k) => end[k] - dataLeft[k] >= NONE),
    steps: from.timeLeft - state.timeLeft,
  };
}

/**
 * For some of the devices that are left `behind`, for each time left and cell: the `most` that data, times a weight, and steps can bring until
 * a landing in time, and the first action to it. A device gives up to all its data in each slot, as if it never ran empty. So no flight brings more
 * beyond its steps than this and 1 − weight times all that is left: it brings no more than that, and no more than this without the weight.
 */
function waysOn(environment, { deviceCells, timeLeft, dataLeft }, behind) {
  const { timeToLand, city } = environment;
  const near = [...timeToLand.keys()].filter((cell) => timeToLand[cell] <= timeLeft);
  const quiet = new Float32Array(CHANNEL.slots * behind.length);
  const devices = behind.map((k) => deviceCells[k]);
  const moves = near.map((uavCell) =>
    [...ACTIONS.keys()]
      .filter((action) => action !== LAND && !environment.forbidden(uavCell, action))
      .map((action) => {
        const ahead = environment.nextCell(uavCell, action);
        const heard = environment
          .snrDb({ uavCell, deviceCells: devices }, ahead, quiet)
          .map((snr, place) => Math.min(rate(snr), dataLeft[behind[place % behind.length]]));
        return { action, ahead, heard };
      }),
  );
  const made = new Map();
  return (open, weight) =>
    kept(made, [weight, ...open].join(), () => {
      const places = open.map((k) => behind.indexOf(k));
      const offer = ({ heard }) => {
        let all = 0;
        for (let slot = 0; slot < CHANNEL.slots; slot++)
          all += Math.max(...places.map((k) => heard[slot * behind.length + k]));
        return weight * all + REWARDS.movement;
      };
      const offers = moves.map((some) => some.map((move) => ({ ...move, brings: offer(move) })));
      const most = [new Float32Array(city.kinds.length).fill(-Infinity)];
      const action = [null];
      for (let time = 1; time <= timeLeft; time++) {
        const [before, values, actions] = [
          most.at(-1),
          most[0].slice(),
          new Uint8Array(city.kinds.length),
        ];
        near.forEach((cell, place) => {
          if (timeToLand[cell] > time) return;
          let [value, best] = city.landing[cell] ? [0, LAND] : [-Infinity, HOVER];
          for (const { action: move, ahead, brings } of offers[place]) {
            if (brings + before[ahead] > value) [value, best] = [brings + before[ahead], move];
          }
          [values[cell], actions[cell]] = [value, best];
        });
        most.push(values);
        action.push(actions);
      }
      return { most, action };
    });
}

function reasonOf(flight, step, environment, otherwise, more) {
  const { uavCell, dataLeft, landed, states } = flight;
  const { timeToLand } = environment;
  const [action, left] = [flight.action[step], flight.timeLeft[step]];
  const [home, after] = [timeToLand[uavCell[step]], timeToLand[uavCell[step + 1]]];
  const given = dataLeft
    .slice(step + 1)
    .map((later) => dataLeft[step].map((each, k) => each - later[k]));
  const within = given.findIndex((each) => Math.max(...each) >= ENOUGH) + 1;
  if (flight.intervened[step]) return { kind: "refused" };
  const since = emptied(flight);
  if (action === LAND)
    return since >= 0 && since <= step ? { kind: "done", since: since < step ? since : 0 } : null;
  const now = timeToLand[otherwise] >= home; // the second best action leads no nearer
  const nearer = landed && after < home;
  const goes = nearer && left <= home + SPARE;
  const way = nearer && step >= turnsHome(flight, timeToLand); // no later step leads away again
  if (goes && (now || (way && (within !== 1 || !more)))) return { kind: "home", home, left, now };
  const back =
    step > 0 && uavCell[step + 1] === uavCell[step - 1] && uavCell[step + 1] !== uavCell[step];
  if (back && within !== 1) return { kind: "back" };
  if (within) {
    const amount = Math.max(...given[within - 1]);
    const device = given[within - 1].indexOf(amount);
    const all = sum(given[within - 1]);
    const stays = uavCell.slice(step, step + within + 1).every((cell) => cell === uavCell[step]);
    const from = states[step].deviceCells[device];
    const heard = environment.meanSnrDb ? environment.tracedSnrs(from) : environment.rateMap(from); // how well, over each cell
    const nears =
      uavCell[step + 2] !== uavCell[step] &&
      uavCell.slice(step + 1, step + within + 1).some((cell) => heard[cell] > heard[uavCell[step]]);
    if (action === HOVER ? stays : within === 1 || nears)
      return {
        kind: "gives",
        device,
        amount,
        all,
        within,
        waits: action === HOVER,
        back,
        home: goes && way,
      };
  }
  if (way) return { kind: "home", home, left, now: false };
  if (since >= 0 && since <= step) return { kind: "idle", since: since < step ? since : 0 };
  if (action !== HOVER) return null;
  let until = step + 1; // steps after which it does something else
  while (flight.action[until] === HOVER) until += 1;
  const rest = sum(dataLeft[step].map((each) => Math.round(10 * each) / 10)); // as the bars show it
  return {
    kind: "stays",
    until: until > step + 1 ? until : 0,
    amount: sum(dataLeft[step]) - sum(dataLeft[until]),
    rest,
  };
}
